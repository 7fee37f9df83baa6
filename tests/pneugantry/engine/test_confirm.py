"""Confirmation: replay of the whole plant, gap, location, and the result that is made of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from modelica_fmu.errors import RunError
from pneugantry.blind.score import judged
from pneugantry.commands.diagnose import print_diagnosis
from pneugantry.engine.answer.confirm import (
    Gap,
    Replay,
    draws,
    floor_of,
    gap_of,
    noise_levels,
    replay,
    replays,
    values_on,
)
from pneugantry.engine.answer.confirmed import worsens
from pneugantry.engine.answer.location import where
from pneugantry.engine.answer.regimes import THROUGHOUT, area, regime_of
from pneugantry.engine.answer.result import Answer, Diagnosis, answer_set, causes_of, to_json
from pneugantry.engine.chances import Chances
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.noise import LONGEST
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.hypotheses.hypothesis import Coordinate, Hypothesis
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.selection.search import Search
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.simulation import Point
from pneugantry.engine.views.synthetic import Nominal
from pneugantry.engine.views.view import View

ROOT = Path(__file__).parents[3]
CAMPAIGNS = ROOT / ".." / "shared" / "campaigns"
RULES = Rules()
OFF = {"K": 2.05, "m": 0.97, "spring": 1.0}


def measured(
    plant: Plant, record: Record, cache: Path, values: Mapping[str, float], level: float = 1.0
) -> Record:
    """The record on a plant with these values, `level` times the quoted noise."""
    rng = np.random.default_rng(len(record.name))
    other = replace(plant, parameters={**plant.parameters, **values})
    found = Nominal(other, [s.variable for s in plant.signals], cache).record(record)
    noisy = {
        s.name: found.signals[s.name] + level * s.sigma * rng.standard_normal(found.rows)
        for s in plant.signals
    }
    return replace(found, signals=noisy)


def made(squares: Array, name: str = "r") -> Replay:
    """A replay with these squares of one signal."""
    residuals = np.sqrt(squares)[:, None]
    return Replay(name, ("s",), 0 * residuals, residuals, residuals, np.ones(1), 1e-3)


def test_the_true_values_replay_a_record_to_the_noise(
    cart: Plant, push: Record, cache: Path
) -> None:
    record = measured(cart, push, cache, OFF)
    assert replay(cart, record, OFF, cache).gap == pytest.approx(1.0, abs=0.03)
    assert replay(cart, record, {}, cache).gap > 10
    wrong_mass = replay(cart, record, {**OFF, "m": 1.1}, cache).by_signal
    assert wrong_mass["force"] == pytest.approx(1.0, abs=0.05)
    assert wrong_mass["speed"] > 2


def test_rows_at_the_start_that_do_not_count_are_left_out(
    cart: Plant, push: Record, cache: Path
) -> None:
    record = measured(cart, push, cache, OFF)
    spoilt = {n: np.where(np.arange(record.rows) < 100, 9.0, v) for n, v in record.signals.items()}
    record = replace(record, signals=spoilt)
    assert replay(cart, record, OFF, cache).gap > 10
    assert replay(cart, replace(record, skip=0.2), OFF, cache).gap == pytest.approx(1.0, abs=0.03)


def test_sensors_with_errors_say_what_they_would(cart: Plant, push: Record, cache: Path) -> None:
    """Each hears what the other's sensor makes of its signal: r = (I + C) (G t + b)."""
    record = measured(cart, push, cache, {})
    errors = {
        "sensors.force.scale": 1.1,
        "sensors.force.bias": 0.3,
        "sensors.force.from.speed": 0.05,
        "sensors.speed.from.force": -0.04,
    }
    true = replay(cart, record, {}, cache).simulated
    said = replay(cart, record, errors, cache).simulated
    leak = np.array([[0.0, 0.05], [-0.04, 0.0]])
    expected = (true * [1.1, 1.0] + [0.3, 0.0]) @ (np.eye(2) + leak).T
    np.testing.assert_allclose(said, expected, atol=1e-5)


def test_values_under_which_the_model_stops_are_told(
    cart: Plant, push: Record, cache: Path
) -> None:
    record = measured(cart, push, cache, {})
    bad = {"m": 0.0}
    assert [r is None for r in replays(cart, record, [{}, bad], cache)] == [False, True]
    with pytest.raises(RunError, match="push: the model stops"):
        replay(cart, record, bad, cache)


def test_a_gap_shrinks_by_the_squares_above_the_floor() -> None:
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(20000) ** 2
    found = gap_of(made(100 * noise), made(4 * noise), RULES, 1e-3, floor=1.5)
    assert found.nominal == pytest.approx(10 * np.sqrt(noise.mean()))
    assert found.shrink == pytest.approx(1 - (4 - 2.25) / (100 - 2.25), abs=2e-3)
    assert found.ci95[0] < found.shrink < found.ci95[1]
    assert found.ci95[1] - found.ci95[0] < 0.02
    assert found.parted is None
    assert gap_of(made(noise), made(0.9 * noise), RULES, 1e-3).shrink == 0.0  # nothing to shrink
    assert gap_of(made(4 * noise), made(9 * noise), RULES, 1e-3).shrink < 0


def test_a_short_record_has_stretches_as_a_long_one_has() -> None:
    """Half a second is nothing particular: what is drawn together depends on the record, too."""
    assert RULES.stretch(1e-3, 10_000) == 500
    assert RULES.stretch(2e-5, 2000) == 250
    assert RULES.stretch(1.0, 400) == 4
    noise = np.random.default_rng(2).standard_normal(2000) ** 2
    for period in (1e-3, 2e-5):
        low, high = gap_of(made(9 * noise), made(4 * noise[::-1]), RULES, period).ci95
        assert high - low > 0.005


def test_a_replay_that_leaves_the_record_for_good_says_when() -> None:
    noise = np.random.default_rng(1).standard_normal(10000) ** 2
    for_good, for_a_while = noise.copy(), noise.copy()
    for_good[6000:] += 400
    for_a_while[6000:7000] += 400
    assert gap_of(made(noise), made(for_good), RULES, 1e-3).parted == pytest.approx(6.0)
    assert gap_of(made(noise), made(for_a_while), RULES, 1e-3).parted is None
    others = [made(for_good), *(made(noise) for _ in range(9)), None]
    found = gap_of(made(noise), made(for_good), RULES, 1e-3, others=others)
    assert found.bifurcates
    assert not gap_of(made(noise), made(noise), RULES, 1e-3, others=others[1:]).bifurcates


@pytest.mark.parametrize("level", [0.7, 1.0, 1.35])
def test_the_size_of_the_noise_is_read_off_a_moving_record(
    cart: Plant, push: Record, cache: Path, level: float
) -> None:
    found = noise_levels(cart, measured(cart, push, cache, OFF, level), RULES)
    assert found == {n: pytest.approx(level, rel=0.1) for n in ("force", "speed")}
    assert floor_of(found) == pytest.approx(level, rel=0.08)


def fit_of(coordinates: tuple[Coordinate, ...], theta: list[float], sigma: float = 0.1) -> Fit:
    at = np.array(theta)
    point = Point(coordinates, at, {})
    covariance = sigma**2 * np.eye(len(at))
    return Fit(Hypothesis(), point, {}, {}, {}, {}, covariance, 1.0, {}, 0.0)


def test_what_belongs_to_one_record_is_carried_over_as_far_as_the_others_agree() -> None:
    own = tuple(Coordinate("start", 1.0, 0.01, record=r) for r in ("a", "b", "c"))
    shared = Coordinate("m", 2.0, 0.1)
    unseen = Record("d", 1e-3, {}, {}, {"start": 3.0})
    agreed = values_on(fit_of((*own, shared), [2.0, 2.0, 2.0, 1.0]), unseen)
    assert agreed == {"m": pytest.approx(2.1), "start": pytest.approx(3.02)}
    apart = values_on(fit_of((*own, shared), [2.0, -2.0, 0.3, 1.0]), unseen)
    assert abs(apart["start"] - 3.0) < 0.001
    seen = values_on(fit_of((*own, shared), [2.0, -2.0, 0.3, 1.0]), replace(unseen, name="b"))
    assert seen["start"] == pytest.approx(0.98)
    drawn = [v["m"] for v in draws(fit_of((*own, shared), [2.0, 2.0, 2.0, 1.0]), unseen, (), 200)]
    assert np.std(drawn) == pytest.approx(0.01, rel=0.15)


@pytest.fixture(scope="module")
def fitted(
    cart: Plant, push: Record, cache: Path, catalogue: dict[str, Effect]
) -> tuple[Fitter, Search]:
    """A cart with a spring: tolerance alone, then with the spring."""
    plant = replace(cart, blocks={"f": "motor", "v": "cart"})
    record = measured(plant, push, cache, OFF)
    views = build_views(plant, ["force", "speed"], cache, push.period, RULES)
    fitter = Fitter(plant, views, [record], RULES)
    null = fitter.null()
    effect = catalogue["spring"]
    best = fitter.explore(Hypothesis().plus(effect, effect.forms[0]), null)
    return fitter, Search(null, best, (), (null, best))


def test_what_tolerance_leaves_lies_in_the_view_that_shows_it(
    fitted: tuple[Fitter, Search],
) -> None:
    fitter, found = fitted
    places = where(fitter, found, found.null)
    assert places[0].block == "cart"
    assert places[0].share > 0.9
    assert places[0].records == ("push",)
    assert places[0].explained == 0.0


def test_what_an_effect_explains_lies_in_its_block(fitted: tuple[Fitter, Search]) -> None:
    fitter, found = fitted
    places = where(fitter, found, found.best)
    assert places[0].block == "cart"
    assert places[0].explained == pytest.approx(found.null.evidence - found.best.evidence)
    assert sum(p.share for p in places) == pytest.approx(1.0)


class Reading:
    """A view that reads the signals "own" and "other", one row in one."""

    name = block = "view"
    signals = ("own",)
    sigmas = (0.01,)
    decimation = 1
    remembers = True
    defaults: Mapping[str, float] = {}

    def shows(self, record: Record) -> bool:
        return True

    def depends_on(self, parameter: str) -> bool:
        return parameter.split(".")[1] in ("own", "other")

    def residuals(self, runs: object) -> list[Array]:
        raise NotImplementedError


def test_a_regime_is_named_by_the_signal_that_tells_it(cart: Plant) -> None:
    time = 2e-3 * np.arange(3000)
    own, other = np.sin(3 * time), 2 + np.cos(1.7 * time)
    signals = tuple(replace(cart.signals[0], name=n) for n in ("own", "other", "unread"))
    plant = replace(cart, inputs=(), signals=signals)
    record = Record("r", 2e-3, {}, {"own": own, "other": other, "unread": own}, {})
    view: View = Reading()
    weights = {
        "own > 0": own > 0,
        "small other": other < 1.5,
        "large own": np.abs(own) > 0.8,
        "reversals of own": np.abs(np.mod(3 * time + 0.5, np.pi) - 0.5) < 0.1,
        THROUGHOUT: np.ones(3000),
    }
    for said, rows in weights.items():
        row = np.asarray(rows, dtype=float)[LONGEST:]
        assert regime_of(plant, view, [(record, row)]) in (
            said,
            said.replace("reversals of own", "small own"),
        )
    assert area(np.arange(4.0), np.array([0, 0, 0, 1.0])) == 0.875


def result(fitted: tuple[Fitter, Search], catalogue: dict[str, Effect]) -> Diagnosis:
    fitter, found = fitted
    answers = [Answer(("spring",), 0.9, found.best), Answer(("unknown",), 0.08), Answer((), 0.02)]
    return Diagnosis(
        verdict="identified",
        where=where(fitter, found, found.best),
        causes=causes_of(answers, catalogue, ("spring",), Chances().temper),
        answer_set=answer_set(answers),
        gap=Gap(9.0, 5.0, 1.0, 0.7, (0.6, float("nan")), "push", {}, (1.1, 5.2), 2.0),
        seconds=1.0,
        probabilities={"none": 0.02, "unknown": 0.08},
    )


def test_a_result_keeps_to_its_schema_and_is_read_by_what_reads_it(
    fitted: tuple[Fitter, Search],
    catalogue: dict[str, Effect],
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = json.loads(json.dumps(to_json(result(fitted, catalogue)), allow_nan=False))
    schema = ROOT / "docs" / "reference" / "schemas" / "gap.json"
    Draft202012Validator(json.loads(schema.read_text(encoding="utf-8"))).validate(told)
    size = told["causes"][0]["parameters"]["spring"]
    assert size["ci95"][0] < OFF["spring"] < size["ci95"][1]
    assert told["answer_set"] == [["spring"], ["unknown"]]
    assert any("bifurcates" in note for note in told["notes"])
    told["gap"]["ci95"][1] = 0.8
    print_diagnosis(told)
    assert "cause: spring" in capsys.readouterr().out
    truth = {"kind": "one", "causes": [{"effect": "spring", "axis": "", "block": "cart"}]}
    case = judged("toy", truth, told)
    assert case.right
    assert case.block
    assert case.held
    assert case.none == (0.02, False)


@pytest.mark.skipif(not CAMPAIGNS.is_dir(), reason="no stored campaigns")
def test_the_gantry_s_gap_is_that_of_its_fmu() -> None:
    from pneugantry.plants.gantry.describe import plant_of, record_of
    from pyfmi_runner.build import build_fmu, cache_folder
    from pyfmi_runner.campaign import read_campaign
    from pyfmi_runner.fmu import FmuFile
    from pyfmi_runner.log import MEASURED
    from pyfmi_runner.replay import SIGMAS, Replayer

    campaign = read_campaign(CAMPAIGNS / "rig_coulomb_level_x")
    plant, values = plant_of(thinning=1), {"axis_x.friction.F_d": 40.0}
    for name in ("contact_steps", "contour_straight"):
        run = campaign.logs[name]
        record = record_of(name, run)
        with Replayer(FmuFile.read(build_fmu().path)) as fmu:
            known = [fmu.simulate(run), fmu.simulate(run, values)]
        left = [np.sqrt((((run.log.measured() - k) / SIGMAS) ** 2).mean(axis=0)) for k in known]
        before, after = (float(np.sqrt(np.mean(each**2))) for each in left)
        nominal, moved = replays(plant, record, [{}, values], cache_folder() / "parts")
        assert nominal is not None
        assert moved is not None
        found = gap_of(nominal, moved, RULES, record.period)
        assert found.nominal == pytest.approx(before, rel=0.01)
        assert found.augmented == pytest.approx(after, rel=0.01)
        assert found.shrink == pytest.approx(1 - (after**2 - 1) / (before**2 - 1), abs=0.01)
        for i, channel in enumerate(MEASURED):
            gaps = float(left[0][i]), float(left[1][i])
            assert found.by_signal[channel] == pytest.approx(gaps, rel=0.01), channel


def test_a_record_is_judged_up_to_where_its_replay_leaves_it() -> None:
    noise = np.random.default_rng(2).standard_normal(10000) ** 2
    before, after, plain = 25 * noise, noise.copy(), 24 * noise
    after[7000:] += 900
    found = gap_of(made(before), made(after), RULES, 1e-3)
    assert found.augmented > 2 * found.nominal
    assert found.early is not None
    assert found.early.nominal == pytest.approx(5.0, rel=0.05)
    assert found.early.augmented == pytest.approx(1.0, rel=0.05)
    assert found.early.ci95[0] > 0.9
    assert not worsens(found, made(plain))
    after[:7000] *= 100
    after[7000:] *= 100
    assert worsens(gap_of(made(before), made(after), RULES, 1e-3), made(plain))
    assert gap_of(made(before), made(before), RULES, 1e-3).early is None
