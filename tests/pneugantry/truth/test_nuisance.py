"""Ordinary rigs: spreads as asked, effects clear of them, and the same seed the same rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pneugantry.truth.case import DEVELOPMENT, CaseSet, plan_case
from pneugantry.truth.effects import KNOWN_FORMS
from pneugantry.truth.nuisance import CLEAR, NUISANCE, PLAIN, SCALED, draw_rig, tolerated_size
from pneugantry.truth.parameters import nominal

DRAWN = [draw_rig(np.random.default_rng([s, 1]), s, NUISANCE) for s in range(300)]


@pytest.mark.parametrize(
    ("names", "middle", "spread"),
    [
        (("mass_x", "mass_z", "gain_x", "lag_z", "contact_stiffness"), 1.0, 0.03),
        (("offset_x", "offset_z"), 1.0, 0.01),
        (("band_x", "band_z"), 1.0, 0.05),
        (tuple(f"scale_{name}" for name in SCALED), 1.0, 0.003),
        (("bias_f_x", "bias_f_z"), 0.0, 0.1),
        (("bias_f_ax", "bias_f_az"), 0.0, 0.3),
        (("standoff",), 0.0, 4e-4),
    ],
)
def test_spreads_are_those_of_measured_rigs(
    names: tuple[str, ...], middle: float, spread: float
) -> None:
    values = np.array([[rig.off[name] for name in names] for rig in DRAWN]).ravel()
    assert np.mean(values) == pytest.approx(middle, abs=4 * spread / np.sqrt(len(values)))
    assert np.std(values) == pytest.approx(spread, rel=0.15)


def test_noise_is_one_factor_for_all_channels_within_its_bounds() -> None:
    factors = np.array([rig.rig.sensor["noise"] for rig in DRAWN])
    assert np.ptp(factors, axis=1).max() == 0.0
    assert factors.min() >= 0.7
    assert factors.max() <= 1.4
    assert np.ptp(factors) > 0.6


def test_a_plain_rig_has_parameters_off_and_nothing_else() -> None:
    drawn = draw_rig(np.random.default_rng([5, 1]), 5, PLAIN)
    assert drawn.standoff == 0.0
    assert np.array_equal(drawn.rig.sensor, nominal().sensor)
    assert np.array_equal(drawn.rig.axis["offset"], nominal().axis["offset"])
    assert not np.array_equal(drawn.rig.axis["mass"], nominal().axis["mass"])


def test_causes_are_the_same_with_and_without_nuisances() -> None:
    with_nuisances = replace(DEVELOPMENT, rig=replace(PLAIN, standoff=1e-4))
    for seed in range(78900, 78930):
        plain, ordinary = DEVELOPMENT.plan(seed), with_nuisances.plan(seed)
        assert plain.causes == ordinary.causes
        assert np.array_equal(plain.rig.axis, ordinary.rig.axis)
        assert ordinary.standoff != 0.0


def test_effects_stand_clear_of_the_tolerance_that_looks_like_them() -> None:
    cases = CaseSet("one", {"one": 1.0})
    for seed in range(78900, 79100):
        for cause in cases.plan(seed).causes:
            assert cause.size >= tolerated_size(cause.form, NUISANCE) - 1e-12
            assert cause.size <= cause.form.high + 1e-9
    mass = next(form for form in KNOWN_FORMS if form.effect == "payload_mass")
    assert tolerated_size(mass, NUISANCE) == pytest.approx(CLEAR * 0.03)


def test_a_missing_channel_changes_only_the_rigs_that_live_on_it() -> None:
    whole, without = CaseSet("all"), CaseSet("nofa", missing=("f_ax", "f_az"))
    same = 0
    for seed in range(78900, 79100):
        given, cut = whole.plan(seed), without.plan(seed)
        lost = [c for c in given.causes if c.form.effect == "pressure_gain"]
        assert not any(c.form.effect == "pressure_gain" for c in cut.causes)
        if not lost:
            same += 1
            assert given.causes == cut.causes
    assert same > 150


def test_severity_scales_sizes_and_levels_replace_their_draw() -> None:
    seed, pair = 78901, (("stribeck", "z"),)
    usual = CaseSet("usual").plan(seed, effects=pair).causes[0]
    faint = CaseSet("faint", severity=0.4).plan(seed, effects=pair).causes[0]
    assert faint.size == pytest.approx(0.4 * usual.size)
    top = CaseSet("top", levels=(1.0,)).plan(seed, effects=pair).causes[0]
    assert top.size == pytest.approx(usual.form.high)


def test_what_every_rig_of_a_set_has_stands_beside_what_is_drawn() -> None:
    own = ("quantisation", "")
    cases = CaseSet("coarse", {"none": 0.5, "one": 0.5}, always=(own,))
    kinds = {"one": 0, "two": 0}
    for seed in range(78900, 78960):
        case = cases.plan(seed)
        pairs = [(c.form.effect, c.axis) for c in case.causes]
        assert pairs[0] == own
        assert len(set(pairs)) == len(pairs)
        assert case.kind == ("one" if len(pairs) == 1 else "two")
        kinds[case.kind] += 1
    assert min(kinds.values()) > 15


def test_a_known_seed_keeps_its_causes() -> None:
    case = plan_case(78006)  # a case of the sealed set of seed 78000
    assert [c.form.effect for c in case.causes] == ["stribeck", "valve_lag"]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"mixture": {"four": 1.0}}, "mixture must be of"),
        ({"unknown": ("valve_lag",)}, "unknown must be of"),
        ({"missing": ("f_q",)}, "missing must be of"),
        ({"severity": 0.0}, "severity must be > 0"),
    ],
)
def test_a_wrong_set_is_refused(wrong: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        CaseSet("wrong", **wrong)
