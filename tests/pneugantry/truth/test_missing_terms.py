"""Terms that no list names: their laws, their labels, and that random functions absorb no known
one.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pneugantry.blind.sets import SETS
from pneugantry.truth.effects import KNOWN_FORMS, MISSING_FORMS, RANDOM_FORMS, UNKNOWN_FORMS
from pneugantry.truth.effects_random import CONTACT, FRICTION
from pneugantry.truth.form import Cause
from pneugantry.truth.friction import speed_force
from pneugantry.truth.parameters import nominal
from pneugantry.truth.random_term import TURN, random_row, term_value
from pneugantry.truth.run import run
from pneugantry.truth.setups import Setup
from pneugantry.truth.valve import compressor, steady_force

SHUT = ((1.0, 0.0, 0.0),)


def cause(effect: str, axis: str, size: float) -> Cause:
    form = next(f for f in [*MISSING_FORMS, *RANDOM_FORMS] if f.effect == effect)
    return Cause(form, axis, size, 3)


def test_twelve_kinds_that_no_other_list_names() -> None:
    kinds = {form.effect for form in MISSING_FORMS}
    assert len(kinds) == 12
    assert not kinds & {form.effect for form in [*KNOWN_FORMS, *UNKNOWN_FORMS]}
    assert all(form.regressors and form.formula for form in MISSING_FORMS)


def test_the_set_has_every_kind_at_every_severity_in_36_seeds() -> None:
    plans = [SETS["unknown12"].plan(seed) for seed in range(78400, 78436)]
    causes = [plan.causes[0] for plan in plans]
    assert set(Counter(c.form.effect for c in causes).values()) == {3}
    by_kind: dict[str, list[float]] = {}
    for c in causes:
        by_kind.setdefault(c.form.effect, []).append(c.size)
    assert all(max(sizes) > 1.5 * min(sizes) for sizes in by_kind.values())


def test_drag_is_quadratic_and_grease_thins_with_work() -> None:
    rig, drawn = cause("quadratic_drag", "z", 200.0).apply(nominal())
    a = rig.axis[1]
    extra = speed_force(a, -0.2, 0.0) + a["viscous"] * 0.2
    assert extra == pytest.approx(-drawn["coefficient"] * 0.04)
    rig, drawn = cause("thinning_grease", "z", 0.5).apply(nominal())
    warm = speed_force(rig.axis[1], 0.1, drawn["work"])
    assert warm == pytest.approx(4.0 * (1 - 0.5 * (1 - math.exp(-1))))


def test_a_curved_valve_gives_less_at_the_top() -> None:
    a = cause("valve_curvature", "x", 0.3).apply(nominal())[0].axis[0]
    assert steady_force(a, 0.635 + 0.5, 0.0) == pytest.approx(186 * 0.5 * (1 - 0.15))


def test_the_supply_cycles_for_both_valves_at_once() -> None:
    rig, drawn = cause("supply_cycling", "", 0.1).apply(nominal())
    assert np.array_equal(rig.axis["cycle_phase"], [drawn["cycle_phase"]] * 2)
    times = np.linspace(0, drawn["cycle_time"], 400)
    low = [compressor(rig.axis[0], t) for t in times]
    assert min(low) >= 0.0
    assert max(low) == pytest.approx(1.0, abs=0.02)
    label = cause("supply_cycling", "", 0.1).entry(nominal())
    assert label["blocks"] == ["valve_x", "valve_z"]


def test_an_elastic_base_swings_as_an_oracle_says() -> None:
    """z free on an elastic base, friction smooth and none, against scipy on the pair of masses."""
    rig = nominal()
    rig.axis["base_ratio"][1], rig.axis["base_omega"][1], rig.axis["base_zeta"][1] = 0.3, 45.0, 0.05
    rig.axis["static"][1] = rig.axis["dynamic"][1] = rig.axis["cable"][1] = 0.0
    pulses = ((0.1, 0.735, 0.735), (0.4, 0.9, 0.9))
    got = run(rig, Setup("free", 0.4, (0.5, 0.02), (SHUT, pulses), (np.inf, 0.0))).true
    m, big = 2.25, 2.25 / 0.3
    k, c = 45.0**2 * big, 2 * 0.05 * 45.0 * big

    def rates(t: float, y: np.ndarray) -> list[float]:
        _, v, b, w, f = y
        push = f - 40.0 * v  # on the piston; the base takes the reaction
        a_b = (-k * b - c * w - push) / big
        return [v, push / m - a_b, w, a_b, (100 * 0.165 * (t >= 0.1) - f) / 0.15]

    grid = np.arange(400) / 1000
    want = solve_ivp(rates, (0, 0.4), [0.02, 0, 0, 0, 0], t_eval=grid, max_step=1e-3, rtol=1e-9)
    assert np.abs(got[:, 1] - want.y[0]).max() < 2e-5
    assert np.abs(got[:, 3] - want.y[1]).max() < 1e-3


def test_a_force_cell_with_play_reads_a_loop() -> None:
    rig, drawn = cause("cell_hysteresis", "z", 0.3).apply(nominal())
    steps = ((1.0, 1.3, 1.3), (1.0, 1.6, 1.6), (1.0, 0.8, 0.8))
    setup = Setup("push", 3.0, (0.95, 0.04), (SHUT, steps), (np.inf, 0.0), "straight", 0.04)
    out = run(rig, setup)
    error = out.readings[:, 5] - out.true[:, 5]
    assert error.max() - error.min() == pytest.approx(2 * 0.3 * drawn["half_width"], rel=0.3)


@pytest.mark.parametrize("seed", range(6))
def test_a_random_function_holds_nothing_that_has_a_name(seed: int) -> None:
    row = random_row(np.random.default_rng(seed), 3.0, FRICTION[1], alone=False)
    side = np.linspace(-1, 1, 41)
    middle, half = FRICTION[1].T
    values, columns = [], []
    for p in side:
        for q in side:
            signals = list(middle)
            signals[int(row[1])] += p * half[int(row[1])]
            signals[int(row[4])] += q * half[int(row[4])]
            values.append(term_value(row, tuple(signals)))
            columns.append([1.0, p, q, math.tanh(TURN * p), math.tanh(TURN * q)])
    assert np.sqrt(np.mean(np.square(values))) == pytest.approx(3.0, rel=1e-6)
    found = np.linalg.lstsq(np.array(columns), np.array(values), rcond=None)[0]
    assert np.abs(found).max() < 1e-9


def test_a_random_function_of_one_signal_ignores_the_others() -> None:
    row = random_row(np.random.default_rng(1), 1.0, CONTACT, alone=True)
    signals = [1e-3, 0.02, 0.6, 0.05]
    before = term_value(row, tuple(signals))
    signals[int(row[4])] *= 1.5
    assert term_value(row, tuple(signals)) == pytest.approx(before, abs=1e-9) or row[9] != 0.0


def test_random_terms_strike_every_block_and_name_their_signals() -> None:
    plans = [SETS["random"].plan(seed) for seed in range(78500, 78540)]
    entries = [plan.causes[0].entry(plan.rig) for plan in plans]
    assert {e["block"].split("_")[0] for e in entries} == {
        "valve",
        "friction",
        "contact",
        "sensors",
    }
    assert all(1 <= len(e["regressors"]) <= 2 for e in entries)
    assert not any("{" in name for e in entries for name in e["regressors"])
