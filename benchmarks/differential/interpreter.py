"""Runs a drawn model by its functions: scipy's DOP853 between events, which it locates itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.differential.model import Action, Crossing, Model, Values

RELATIVE, ABSOLUTE = 1e-9, 1e-11
LONGEST = 0.02  # s, of a step: conditions on time and states are looked at so often
AT_ONCE = 1e-9  # s


def values_at(model: Model, time: float, states: np.ndarray, discretes: Values) -> Values:
    values = model.parameters | discretes | dict(zip(model.states, states, strict=True))
    values["time"] = time
    for put in model.algebra:
        put(values)
    return values


def run(model: Model, times: np.ndarray) -> dict[str, np.ndarray]:
    """Values of what is compared, at times [s] at which no tick falls."""
    x, discretes = np.array(list(model.states.values()), float), dict(model.discretes)
    due = [tick.start for tick in model.ticks]
    now, rows = 0.0, []
    for until in times:
        while now < until:
            now, x, discretes = _stretch(model, now, min([until, *due]), x, discretes)
            for i, tick in enumerate(model.ticks):
                if due[i] <= now + AT_ONCE:
                    x, discretes = _acted(model, tick.action, now, x, discretes)
                    due[i] += tick.interval
        values = values_at(model, until, x, discretes)
        rows.append([float(values[name]) for name in model.compared])
    return dict(zip(model.compared, np.array(rows, float).T, strict=True))


def _stretch(
    model: Model, now: float, until: float, x: np.ndarray, discretes: Values
) -> tuple[float, np.ndarray, Values]:
    """To `until` or the first event before it, which has acted then."""
    if until <= now:
        return now, x, discretes

    def rate(time: float, states: np.ndarray) -> list[float]:
        values = values_at(model, time, states, discretes)
        return [f(values) for f in model.rates.values()]

    def guard(crossing: Crossing) -> Any:
        def margin(time: float, states: np.ndarray) -> float:
            return crossing.guard(values_at(model, time, states, discretes))

        known: Any = margin  # scipy reads what an event does from the function
        known.terminal, known.direction = True, 1.0
        return known

    if not model.states:
        return until, x, discretes
    guards = [guard(c) for c in model.crossings]
    made = solve_ivp(
        rate,
        (now, until),
        x,
        "DOP853",
        rtol=RELATIVE,
        atol=ABSOLUTE,
        max_step=LONGEST,
        events=guards or None,
    )
    if not made.success:
        raise ArithmeticError(made.message)
    now, x = float(made.t[-1]), made.y[:, -1]
    for i, crossing in enumerate(model.crossings):
        if made.status == 1 and len(made.t_events[i]):
            x, discretes = _acted(model, crossing.action, now, x, discretes)
    return now, x, discretes


def _acted(
    model: Model, action: Action, now: float, x: np.ndarray, discretes: Values
) -> tuple[np.ndarray, Values]:
    new = action(values_at(model, now, x, discretes))
    states = [new.get(name, value) for name, value in zip(model.states, x, strict=True)]
    return np.array(states, float), {d: new.get(d, value) for d, value in discretes.items()}
