"""FMUs without source as views: the same residuals as the part cut from the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from modelica_fmu.errors import InputError, RunError
from pneugantry.engine.answer.confirm import replays
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.foreign import (
    ForeignFmu,
    ForeignPlant,
    foreign_signals,
    foreign_views,
    parameters_read,
)
from pneugantry.engine.views.subsystem import SubsystemView
from pneugantry.engine.views.synthetic import Nominal
from pyfmi_runner.build import build_fmu
from pyfmi_runner.driven import DrivenFmu
from pyfmi_runner.fmu import FmuFile

PERIOD = 2e-3
HALVES = """package Halves
  model Actuator
    parameter Real tau = 0.1;
    parameter Real K = 2.0;
    input Real u;
    output Real f(start = 0.0, fixed = true);
  equation
    tau * der(f) = K * u - f;
  end Actuator;
  model Mass
    parameter Real m = 1.0;
    parameter Real c = 0.5;
    parameter Boolean locked = false;
    parameter Integer bodies = 1;
    input Real f;
    input Boolean brake;
    output Real v(start = 0.0, fixed = true);
    output Integer gear;
  equation
    bodies * m * der(v) = if locked or brake then -50 * v else f - c * v;
    gear = if brake then 0 else 3;
  end Mass;
  model Leak
    parameter Real rate = 2.0;
    output Real f(start = 1.0, fixed = true);
  equation
    der(f) = -rate * f;
  end Leak;
end Halves;
"""


def built(plant: Plant, folder: Path, fmi: str = "2.0") -> FmuFile:
    result = build_fmu(plant.class_name, plant.model, fmi=fmi, out=folder / fmi)  # type: ignore[arg-type]
    return FmuFile.read(result.path)


def of_fmus(plant: Plant, *fmus: ForeignFmu) -> ForeignPlant:
    own = {k: v for k, v in vars(plant).items() if k != "fmus"}
    return ForeignPlant(**own, fmus=fmus)


def seen(plant: ForeignPlant, names: list[str] | None = None) -> list[SubsystemView]:
    measured = names or [s.name for s in plant.signals]
    views, notes = foreign_views(plant, measured, PERIOD, 100.0)
    assert not notes
    return views


@pytest.fixture(scope="module")
def whole(cart: Plant, push: Record, cache: Path) -> Record:
    """A rig of other parameters, with noise."""
    rig = replace(cart, parameters={"K": 2.2, "m": 1.05})
    record = Nominal(rig, ["f", "v"], cache).record(push)
    draw = np.random.default_rng(1)
    noisy = {n: v + 0.01 * draw.standard_normal(len(v)) for n, v in record.signals.items()}
    return replace(record, signals=noisy)


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def foreign(
    request: pytest.FixtureRequest, cart: Plant, tmp_path_factory: pytest.TempPathFactory
) -> ForeignPlant:
    file = built(cart, tmp_path_factory.mktemp("fmu"), request.param)
    return of_fmus(cart, ForeignFmu(file, "cart", {"u": "u"}, {"f": "force", "v": "speed"}))


SETS = [
    {},
    {"K": 2.5, "tau": 0.2},
    {"m": 1.3, "spring": 4.0, "sensors.force.bias": 0.1, "sensors.speed.scale": 1.1},
]


def test_an_fmu_leaves_the_same_residuals_as_the_part_cut_from_its_source(
    foreign: ForeignPlant, cart: Plant, whole: Record, cache: Path
) -> None:
    (view,) = seen(foreign)
    assert view.signals == ("force", "speed")
    assert set(view.blocks) == {"cart"}
    found = np.stack(view.residuals([(whole, v) for v in SETS]))
    for i, name in enumerate(view.signals):  # each cut as if it alone were measured
        (own,) = build_views(cart, [name], cache, PERIOD, Rules(observer=0.008))
        expected = np.stack(own.residuals([(whole, v) for v in SETS]))
        assert np.ptp(expected) > 0.1
        np.testing.assert_allclose(found[:, :, i], expected[:, :, 0], rtol=0, atol=1e-6)


def test_the_same_instance_gives_the_same_bits_again(foreign: ForeignPlant, whole: Record) -> None:
    (view,) = seen(foreign)
    runs = [(whole, v) for v in SETS]
    first = view.residuals(runs)
    np.testing.assert_array_equal(view.residuals(runs[::-1])[::-1], first)


def test_several_steps_a_row_come_to_the_same(foreign: ForeignPlant, whole: Record) -> None:
    (view,) = seen(foreign)
    fine = replace(foreign, fmus=(replace(foreign.fmus[0], step=0.7e-3),))
    (other,) = seen(fine)
    found, expected = other.residuals([(whole, {})]), view.residuals([(whole, {})])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_what_an_output_depends_on_is_read_from_the_model_structure(foreign: ForeignPlant) -> None:
    """Our own FMUs list every parameter as known at the start; others tell."""
    (fmu,) = foreign.fmus
    names = {"tau", "K", "m", "c", "spring"}
    assert names <= parameters_read(fmu.file, ["f"])
    first = {"der(f)": ("tau", "K"), "der(v)": ("m", "c", "spring"), "der(s)": ()}
    told = replace(
        fmu.file, description=replace(fmu.file.description, depends_first=first, n_indicators=0)
    )
    assert parameters_read(told, ["f"]) & names == {"tau", "K"}
    assert names <= parameters_read(told, ["v"])
    with_events = replace(told, description=replace(told.description, n_indicators=1))
    assert names <= parameters_read(with_events, ["f"])
    (view,) = seen(replace(foreign, fmus=(replace(fmu, file=told),)), ["force"])
    assert view.depends_on("K")
    assert not view.depends_on("m")
    assert view.depends_on("sensors.force.scale")
    assert not view.depends_on("sensors.speed.scale")
    assert view.defaults["K"] == 2.0


def test_a_fit_with_an_fmu_finds_what_is_off(foreign: ForeignPlant, whole: Record) -> None:
    rules = replace(Rules(), thinning=1)
    fitter = Fitter(foreign, seen(foreign), [whole], rules)
    try:
        fit = fitter.null()
    finally:
        fitter.close()
    found = fit.values(None)
    assert found["K"] / found["m"] == pytest.approx(2.2 / 1.05, rel=0.02)
    (noise,) = fit.noise.values()
    quoted = fitter.simulation.views[next(iter(fit.noise))[0]].sigmas
    for whitener, sigma in zip(noise, quoted, strict=True):
        assert whitener.sigma == pytest.approx(sigma, rel=0.15)


@pytest.fixture(scope="module")
def halves(cart: Plant, tmp_path_factory: pytest.TempPathFactory) -> dict[str, FmuFile]:
    """Actuator as FMI 2.0, mass as FMI 3.0."""
    folder = tmp_path_factory.mktemp("halves")
    model = folder / "Halves.mo"
    model.write_text(HALVES, encoding="utf-8")
    return {
        name: built(replace(cart, model=model, class_name=f"Halves.{name}"), folder, fmi)
        for name, fmi in (("Actuator", "2.0"), ("Mass", "3.0"), ("Leak", "2.0"))
    }


def chain(halves: dict[str, FmuFile]) -> tuple[ForeignFmu, ForeignFmu]:
    return (
        ForeignFmu(halves["Actuator"], "drive", {"u": "u"}, {"f": "force"}),
        ForeignFmu(halves["Mass"], "mass", {"f": "force", "brake": "brake"}, {"v": "speed"}),
    )


def braked(cart: Plant, record: Record, brake: float = 0.0) -> tuple[Plant, Record]:
    inputs = {**record.inputs, "brake": np.full(record.rows, brake)}
    return replace(cart, inputs=("u", "brake")), replace(record, inputs=inputs)


def test_an_fmu_fed_by_a_measured_signal_is_the_view_between_both(
    cart: Plant, whole: Record, cache: Path, halves: dict[str, FmuFile]
) -> None:
    plant, record = braked(cart, whole)
    views = {v.signals: v for v in seen(of_fmus(plant, *chain(halves)))}
    assert set(views) == {("force",), ("speed",)}
    assert not views["speed",].depends_on("K")
    sets = [{}, {"m": 1.2, "sensors.force.scale": 1.05}]
    for view in build_views(cart, ["force", "speed"], cache, PERIOD, Rules(observer=0.008)):
        found = views[view.signals].residuals([(record, v) for v in sets])
        expected = view.residuals([(whole, v) for v in sets])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_a_signal_that_is_missing_makes_the_view_reach_further(
    cart: Plant, whole: Record, cache: Path, halves: dict[str, FmuFile]
) -> None:
    """The mass is then fed by the actuator's FMU, whose parameters its view reads."""
    plant, record = braked(cart, whole)
    (view,) = seen(of_fmus(plant, *chain(halves)), ["speed"])
    assert view.depends_on("K")
    assert view.depends_on("m")
    assert not view.depends_on("sensors.force.scale")
    (own,) = build_views(cart, ["speed"], cache, PERIOD, Rules(observer=0.008))
    sets = [{}, {"K": 2.4}]
    found = view.residuals([(record, v) for v in sets])
    expected = own.residuals([(whole, v) for v in sets])
    # the actuator's force runs on in steps of a row's mean between both FMUs
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-4)
    assert np.ptp(found[1] - found[0]) > 0.05


def test_fmus_in_series_replay_a_record_as_the_whole_model(
    cart: Plant, whole: Record, cache: Path, halves: dict[str, FmuFile]
) -> None:
    """Driven by the inputs alone; the actuator's FMU stands second in the description."""
    plant, record = braked(cart, whole)
    sets = [{}, {"K": 2.2, "m": 1.05, "sensors.speed.bias": 0.02}]
    found = replays(of_fmus(plant, *reversed(chain(halves))), record, sets, cache)
    for one, expected in zip(found, replays(cart, whole, sets, cache), strict=True):
        assert one is not None
        assert expected is not None
        assert one.signals == expected.signals == ("force", "speed")
        np.testing.assert_allclose(one.simulated, expected.simulated, rtol=0, atol=1e-3)
    assert found[1] is not None
    assert found[1].by_signal["force"] == pytest.approx(1.0, abs=0.1)


def test_a_plant_that_cannot_be_replayed_says_why(
    cart: Plant, whole: Record, cache: Path, halves: dict[str, FmuFile]
) -> None:
    mass = chain(halves)[1]
    plant, record = braked(cart, whole)
    with pytest.raises(RunError, match=r"no FMU, or only a ring .* input f on the way to speed"):
        replays(of_fmus(plant, mass), record, [{}], cache)


def test_an_fmu_without_inputs_drives_the_one_behind_it(
    cart: Plant, whole: Record, cache: Path, halves: dict[str, FmuFile]
) -> None:
    plant, record = braked(cart, whole)
    leak = ForeignFmu(halves["Leak"], "leak", {}, {"f": "force"})
    fed = of_fmus(plant, leak, chain(halves)[1])
    views = {v.signals: v for v in seen(fed)}
    falls = np.exp(-2.0 * PERIOD * np.arange(record.rows))
    (alone,) = views["force",].simulate([(record, {})])
    np.testing.assert_allclose(alone[:, 0], falls, rtol=0, atol=1e-6)
    (replay,) = replays(fed, record, [{"rate": 0.0}], cache)
    assert replay is not None
    rises = 2.0 * (1.0 - np.exp(-0.5 * PERIOD * np.arange(record.rows)))
    np.testing.assert_allclose(replay.simulated[:, 1], rises, rtol=0, atol=1e-6)


def test_a_replay_that_fails_frees_its_fmus(
    cart: Plant, whole: Record, halves: dict[str, FmuFile], monkeypatch: pytest.MonkeyPatch
) -> None:
    freed = []

    def failing(*_: object) -> None:
        raise RunError("gone")

    monkeypatch.setattr(DrivenFmu, "run", failing)
    monkeypatch.setattr(DrivenFmu, "close", lambda own: freed.append(own.file.path))
    plant, record = braked(cart, whole)
    with pytest.raises(RunError, match="gone"):
        foreign_signals(of_fmus(plant, *chain(halves)), record, [{}])
    assert len(freed) == 2


def test_an_input_that_nothing_feeds_is_said(cart: Plant, halves: dict[str, FmuFile]) -> None:
    mass = chain(halves)[1]
    plant = of_fmus(braked(cart, Record("r", PERIOD, {}, {"v": np.zeros(9)}, {}))[0], mass)
    views, notes = foreign_views(plant, ["speed"], PERIOD, 100.0)
    assert not views
    assert "input f is not measured" in notes[0]


def test_inputs_and_parameters_of_all_types_reach_the_fmu(
    cart: Plant, whole: Record, halves: dict[str, FmuFile]
) -> None:
    mass = chain(halves)[1]
    gears = replace(mass, outputs={"v": "speed", "gear": "force"}, inputs=mass.inputs)
    known = replace(gears, inputs={"f": "u", "brake": "brake"})
    plant, record = braked(cart, whole, 1.0)
    signals = tuple(
        replace(s, variable={"force": "gear", "speed": "v"}[s.name]) for s in cart.signals
    )
    plant = replace(plant, signals=signals)
    (view,) = seen(of_fmus(plant, known))
    assert view.signals == ("speed", "force")
    stopped = view.simulate([(record, {})])[0]
    np.testing.assert_allclose(stopped, 0.0, atol=1e-9)
    released = replace(braked(cart, whole)[1], name="released")
    free, locked, two = view.simulate(
        [(released, v) for v in ({}, {"locked": 1.0}, {"bodies": 2.0})]
    )
    assert set(free[:, 1]) == {3.0}
    assert np.ptp(free[:, 0]) > 1.3 * np.ptp(two[:, 0]) > 0.1
    np.testing.assert_allclose(locked[:, 0], 0.0, atol=1e-9)


def test_two_components_of_one_file_are_told_apart(
    cart: Plant, whole: Record, halves: dict[str, FmuFile]
) -> None:
    left, _ = chain(halves)
    pair = (
        replace(left, prefix="left."),
        replace(left, prefix="right.", outputs={"f": "speed"}),
    )
    signals = (
        replace(cart.signals[0], variable="left.f"),
        replace(cart.signals[1], variable="right.f"),
    )
    views = {v.signals: v for v in seen(of_fmus(replace(cart, signals=signals), *pair))}
    assert views["force",].depends_on("left.K")
    assert not views["force",].depends_on("right.K")
    base, moved = views["speed",].simulate([(whole, {}), (whole, {"right.K": 4.0})])
    np.testing.assert_allclose(moved, 2 * base, rtol=0, atol=1e-6)


def test_a_refused_parameter_is_nan_and_the_next_run_is_sound(
    foreign: ForeignPlant, whole: Record
) -> None:
    (view,) = seen(foreign)
    good, bad, again = view.simulate([(whole, v) for v in ({}, {"tau": float("nan")}, {})])
    assert np.isnan(bad).all()
    np.testing.assert_array_equal(good, again)


def test_a_name_that_the_fmu_lacks_is_one_clear_line(foreign: ForeignPlant) -> None:
    wrong = replace(foreign.fmus[0], inputs={"voltage": "u"})
    with pytest.raises(InputError, match=r"voltage: is no input of the FMU; use some of u"):
        seen(replace(foreign, fmus=(wrong,)))
