"""A friction effect so large that a loosely led carriage sticks where the rig moves: a tight lead
finds it all the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pneugantry.diagnosis.bench import Bench, Choice, Outcome
from pneugantry.diagnosis.candidates import (
    Candidate,
    additions,
    chosen_seconds,
    joining,
    most_promising,
)
from pneugantry.diagnosis.diagnose import split_campaign
from pneugantry.diagnosis.evidence import Search, Trial
from pneugantry.diagnosis.fit import Fit
from pneugantry.diagnosis.tight_lead import first_fit, large_misfits, tightly_led
from pneugantry.engine.catalogue import read_catalogue
from pneugantry.truth.campaign import write
from pneugantry.truth.case import plan_case, run_case
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile

CATALOGUE = read_catalogue()
SEED = 1010  # of development: friction that grows by 23 % of its level at 10 N
VIEW = "friction_x"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder: Path = tmp_path_factory.mktemp("load")
    campaign, _ = run_case(plan_case(SEED, effects=(("friction_load", "x"),)))
    write(folder, campaign)
    fitted, _ = split_campaign(read_campaign(folder))
    with Bench(fitted, FmuFile.read(build_fmu().path)) as opened:
        valves = opened.settle(["valve_x"])
        opened.drive(valves["valve_x"].values)
        yield opened


@pytest.fixture(scope="module")
def null(bench: Bench) -> Outcome:
    return bench.settle([VIEW])[VIEW]


def test_the_right_effect_comes_first_and_starts_near_its_value(
    bench: Bench, null: Outcome
) -> None:
    assert large_misfits({VIEW: null}) == [VIEW]
    found = Search({VIEW: null}, {VIEW})
    catalogue = {key: effect for key, effect in CATALOGUE.items() if effect.block == VIEW}
    ranked = tightly_led(bench, list(additions(bench, catalogue, found, None)), [VIEW], None)
    assert ranked[0].choice.keys == ("friction_load/x",)
    loose = bench.fit(ranked[0].choice, (VIEW,), start_values=ranked[0].known)
    assert loose.rms(VIEW) < 1.02 < 3.0 < null.rms(VIEW)


def test_every_law_of_friction_is_led_tightly_not_only_the_plain_one(
    bench: Bench, null: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A Stribeck curve with bristles is far from a Dahl law: under that alone the effect came
    last.
    """
    presliding = {"presliding/x": CATALOGUE["presliding/x"]}
    tried: list[str] = []
    whole = first_fit

    def noted(bench: Bench, c: Candidate) -> Outcome:
        tried.append(c.choice.effects[-1][1].name)
        return whole(bench, c)

    monkeypatch.setattr("pneugantry.diagnosis.tight_lead.first_fit", noted)
    ranked = tightly_led(
        bench, list(additions(bench, presliding, Search({VIEW: null}, {VIEW}), None)), [VIEW], None
    )
    assert set(tried) == {form.name for form in presliding["presliding/x"].forms}
    assert [c.choice.keys for c in ranked] == [("presliding/x",)]


def _fail(bench: Bench) -> None:
    with bench.led_tighter((VIEW,), 0.1):
        raise ZeroDivisionError


def test_a_lead_is_as_before_after_a_tighter_one_even_after_an_error(
    bench: Bench, null: Outcome
) -> None:
    guided, before = bench.friction["x"].guided, bench.white(bench.all[VIEW], null.values)
    with bench.led_tighter((VIEW,), 0.1):
        assert bench.friction["x"].guided == pytest.approx(0.1 * guided)
        tight = bench.white(bench.all[VIEW], null.values)
        assert tight @ tight < before @ before
    with pytest.raises(ZeroDivisionError):
        _fail(bench)
    assert bench.friction["x"].guided == guided
    np.testing.assert_array_equal(bench.white(bench.all[VIEW], null.values), before)


def test_tolerance_under_a_tight_lead_leaves_the_loose_ones_slopes_alone(
    bench: Bench, null: Outcome
) -> None:
    columns = dict(bench.columns)
    with bench.led_tighter((VIEW,), 0.1):
        bench.fit(Choice(), (VIEW,), start_values=null.values)
    assert bench.columns.keys() == columns.keys()
    assert all(bench.columns[key] is columns[key] for key in columns)


def test_settling_forgets_the_columns_of_a_high_observer_gain(bench: Bench, null: Outcome) -> None:
    """So that what is fitted next does not depend on what this process had fitted before."""
    with bench.led_tighter((VIEW,), 0.1):
        bench.fit(Choice(), (VIEW,), start_values=null.values)
    before = dict(bench._led_columns)
    assert before
    assert any(before.values())
    bench.settle([VIEW])
    assert bench._led_columns == {}
    bench._led_columns = before


def trial(bench: Bench, key: str, **theta: float) -> Trial:
    """A single effect in its first form with given thetas, 0 for the rest."""
    choice = Choice(((CATALOGUE[key], CATALOGUE[key].forms[0]),))
    coordinates = bench.coordinates(choice, (VIEW,))
    values = np.array([theta.get(c.name.rsplit(".", 1)[-1], 0.0) for c in coordinates])
    fit = Fit(tuple(coordinates), values, np.eye(len(values)), 0.0, {})
    return Trial(choice, Outcome(choice, fit, {VIEW: 1.0}, {VIEW: 1}, {VIEW: 1.0}, (VIEW,)))


def test_two_effects_as_a_pair_start_from_both_their_values(bench: Bench) -> None:
    """The first one's mass is the second one's tolerance."""
    heavy, loaded = (
        trial(bench, "payload_mass/x", m=1.0),
        trial(bench, "friction_load/x", load_share=0.5, C=2.0),
    )
    (pair,) = joining(bench, heavy, loaded)
    assert pair.choice.keys == ("payload_mass/x", "friction_load/x")
    assert (
        pair.known["axis_x.m"] == heavy.outcome.values["axis_x.m"] > 1.1 * bench.nominal["axis_x.m"]
    )
    assert (
        pair.known["axis_x.friction.load_share"]
        == loaded.outcome.values["axis_x.friction.load_share"]
        > 0
    )
    assert list(joining(bench, heavy, heavy)) == []


def test_an_effect_that_frees_what_its_base_strains_is_tried_whatever_others_promise(
    bench: Bench,
) -> None:
    strained = trial(bench, "friction_load/x", C=20.0).outcome
    candidates = []
    for key, promise in (
        ("payload_mass/x", 90.0),
        ("cable_force/x", 80.0),
        ("viscous_level/x", 9.0),
        ("stribeck/x", 9.0),
    ):
        choice = strained.choice.plus(CATALOGUE[key], CATALOGUE[key].forms[0])
        candidates.append(Candidate(choice, (VIEW,), {}, {}, strained, promise=promise))
    chosen = [c.choice.keys[-1] for c in chosen_seconds(candidates, 2, ())]
    assert chosen == ["payload_mass/x", "cable_force/x", "viscous_level/x"]


def test_an_effect_of_one_view_alone_keeps_its_place_beside_those_that_promise_of_others(
    bench: Bench,
) -> None:
    choices = {
        key: Choice(((CATALOGUE[key], CATALOGUE[key].forms[0]),))
        for key in CATALOGUE
        if not CATALOGUE[key].forms[0].settings
    }
    of_many = [
        Candidate(choice, (VIEW, "friction_z"), {}, {}, promise=90.0)
        for choice in list(choices.values())[:20]
    ]
    own = Candidate(
        Choice(((CATALOGUE["cable_force/x"], CATALOGUE["cable_force/x"].forms[0]),)),
        (VIEW,),
        {},
        {},
        promise=9.0,
    )
    assert own in most_promising([*of_many, own], {VIEW})
