"""Circuits of the standard library whose stored reference results are inexact, solved anew from
their equations: a Schmitt trigger switches a little late (the amplifier's lag, LAG), and a run that
misses that is far off after twenty periods. Nothing of the library's source.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

TIGHT = 1e-11  # relative, of the integration
POINTS = 20_000  # of a solution
BEYOND = 1e-9  # s, step beyond a corner, from which the next stretch is integrated
LIMIT = 15.0  # V, of an amplifier's output
GAIN, LAG = 15e3, 1e-5  # of an amplifier without load; s

Signals = dict[str, np.ndarray]  # "time", s, and each signal


def switched(rates: Callable[[float, Any], Any], start: list[float], stop: float) -> Signals:
    """States 0, 1, ... over time; the integration stops at each corner, |state 0| = LIMIT."""

    def corner(side: float) -> Callable[[float, Any], float]:
        def distance(t: float, y: Any) -> float:
            return float(y[0]) - side * LIMIT

        distance.terminal = True  # type: ignore[attr-defined]
        return distance

    corners = [corner(1.0), corner(-1.0)]
    tight: dict[str, Any] = {"method": "Radau", "rtol": TIGHT, "atol": 100 * TIGHT}
    grid = np.linspace(0, stop, POINTS + 1)
    time, states = [np.zeros(1)], [np.array(start)[:, None]]
    now, y = 0.0, np.array(start)
    while now < stop:
        ran = solve_ivp(
            rates, (now, stop), y, events=corners, dense_output=True, first_step=1e-9, **tight
        )
        end = float(ran.t[-1])
        inside = np.append(grid[(grid > now) & (grid < end)], end)
        time.append(inside)
        states.append(ran.sol(inside))
        y = ran.y[:, -1]
        if end < stop:
            end = min(stop, end + BEYOND)
            y = solve_ivp(rates, (end - BEYOND, end), y, **tight).y[:, -1]
        now = end
    found = np.concatenate(states, axis=1)
    return {"time": np.concatenate(time)} | {str(k): row for k, row in enumerate(found)}


def limited(v: Any) -> Any:
    return np.clip(v, -LIMIT, LIMIT)


def multivibrator(stop: float) -> Signals:
    """v: amplifier before its limit, c: capacitor. LAG v' = GAIN (out/2 - c) - v, R C c' = out - c;
    a divider 1:1 to the positive input, R C to the negative one.
    """
    resistance, frequency = 1e3, 10.0
    capacity = 1 / frequency / (2 * resistance * np.log(3.0))

    def rates(t: float, y: Any) -> list[float]:
        out = limited(y[0])
        return [(GAIN * (out / 2 - y[1]) - y[0]) / LAG, (out - y[1]) / (resistance * capacity)]

    ran = switched(rates, [-LIMIT, 1.0], stop)
    out, c = limited(ran["0"]), ran["1"]
    current = -((out - c) / resistance + out / (2 * resistance))
    return {"time": ran["time"], "c.v": c, "opAmp.out.v": out, "opAmp.out.i": current}


def signal_generator(stop: float) -> Signals:
    """A Schmitt trigger (v, limited: first) whose output an amplifier integrates onto c: second.

    Its input p divides first and second by R1 : R2 = 2 : 3; the integrator's own gain is finite:
    second = c / (1 + 1/GAIN), its input -second / GAIN.
    """
    r1, r2, resistance, frequency = 1e3, 1.5e3, 1e3, 10.0
    capacity = (r2 / r1) / (4 * frequency * resistance)

    def second(c: Any) -> Any:
        return c / (1 + 1 / GAIN)

    def divided(first: Any, other: Any) -> Any:
        return (first / r2 + other / r1) / (1 / r1 + 1 / r2)

    def rates(t: float, y: Any) -> list[float]:
        first, other = limited(y[0]), second(y[1])
        p = divided(first, other)
        return [(GAIN * p - y[0]) / LAG, -(first + other / GAIN) / (resistance * capacity)]

    ran = switched(rates, [-LIMIT, 0.0], stop)
    first, other = limited(ran["0"]), second(ran["1"])
    p, charging = divided(first, other), (first + other / GAIN) / resistance
    return {
        "time": ran["time"],
        "c.v": ran["1"],
        "opAmp1.out.v": first,
        "opAmp1.out.i": -((first - p) / r2 + charging),
        "opAmp2.out.v": other,
        "opAmp2.out.i": -((other - p) / r1 - charging),
    }


SOLUTIONS: dict[str, Callable[[float], Signals]] = {
    "Modelica.Electrical.Analog.Examples.OpAmps.Multivibrator": multivibrator,
    "Modelica.Electrical.Analog.Examples.OpAmps.SignalGenerator": signal_generator,
}
