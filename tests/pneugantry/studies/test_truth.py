"""The independent truth plant: integrator against an oracle, replay of the recorded campaign,
effects, cases.
"""

from __future__ import annotations

import ast
import shutil
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pneugantry.truth.campaign import generate, write
from pneugantry.truth.case import LEAST_VISIBLE, MIXTURE, draw_case, plan_case, run_case
from pneugantry.truth.effects import ALL_FORMS, KNOWN_FORMS, UNKNOWN_FORMS, draw_cause, names
from pneugantry.truth.form import Cause
from pneugantry.truth.integrate import Accuracy, advance, solver_of
from pneugantry.truth.kept import stamp
from pneugantry.truth.loop import run_loop
from pneugantry.truth.parameters import CHANNELS, DAHL, SIGMA, nominal, with_smooth_friction
from pneugantry.truth.plant import MODES, STATES, WIDTH, Acting, Plant
from pneugantry.truth.replay import read_campaign, residuals
from pneugantry.truth.run import draws, run
from pneugantry.truth.setups import campaign_setups
from pneugantry.truth.tolerance import with_tolerance
from pneugantry.truth.workpiece import edge_table

HERE = Path(__file__).resolve()
TRUTH = HERE.parents[3] / "pneugantry" / "truth"
SHARED = HERE.parents[4] / "shared" / "campaigns"
recorded = pytest.mark.skipif(
    not SHARED.is_dir(), reason="../shared/campaigns is not on this machine"
)
BLOCKS = {"valve_x", "valve_z", "friction_x", "friction_z", "contact", "sensors", "timing"}


# --- compiled once


def test_what_is_kept_is_named_by_every_file_of_the_plant(tmp_path: Path) -> None:
    copy = tmp_path / "truth"
    shutil.copytree(TRUTH, copy)
    assert stamp(copy) == stamp()
    with (copy / "friction.py").open("a", encoding="utf-8") as file:
        file.write("\n")
    stamp.cache_clear()
    assert stamp(copy) != stamp()
    assert run_loop.py_func.__qualname__ == f"run_loop-{stamp()}"


def test_the_loop_takes_one_set_of_types() -> None:
    """Two processes that keep two of them at once would mix them up."""
    for name, setup in campaign_setups().items():
        short = replace(setup, seconds=0.05)
        run(nominal(), short)
        run(nominal(), short, draw=draws(50, 1), commands=np.zeros((100, 2))[::2])
        assert len(run_loop.signatures) == 1, name


# --- integrator and events


def oracle_z(times: np.ndarray, u: float) -> np.ndarray:
    """z [m], v_z [m/s], f_az [N] of the z axis alone pushed against a straight edge, by scipy with
    terminal events.
    """
    m, c, f_s, f_d, f_w, v_th = 2.25, 40, 20, 15, 5, 0.01
    gain, u_0, tau, k_c, c_c, gap = 100, 0.735, 0.15, 1e4, 30, 0.04

    def touch(y):
        return max(k_c * (y[0] - gap) + c_c * y[1], 0.0) if y[0] > gap else 0.0

    def rates(_, y, mode):
        force = (k_c * (y[0] - gap) + c_c * y[1]) if mode[1] == 1 else 0.0
        drive = y[2] - force - f_w
        coulomb = {"stuck": drive, "up": f_s, "down": -f_s, "slide_up": f_d, "slide_down": -f_d}[
            mode[0]
        ]
        return [y[1], (drive - coulomb - c * y[1]) / m, (gain * (u - u_0) - y[2]) / tau]

    def mode_of(y):
        drive = y[2] - touch(y) - f_w
        slide = "slide_up" if y[1] > v_th else "slide_down" if y[1] < -v_th else ""
        stick = "up" if drive > f_s else "down" if drive < -f_s else "stuck"
        return slide or stick, int(touch(y) > 0.0)

    def guards(y):
        drive = y[2] - touch(y) - f_w
        return [
            y[1] - v_th,
            y[1] + v_th,
            drive - f_s,
            drive + f_s,
            y[0] - gap,
            k_c * (y[0] - gap) + c_c * y[1],
        ]

    events = [lambda _, y, mode, i=i: guards(y)[i] for i in range(6)]
    for event in events:
        event.terminal = True
    y, now, out = np.zeros(3), 0.0, np.empty((len(times), 3))
    while now < times[-1]:
        ahead = y + 1e-9 * np.array(
            rates(now, y, mode_of(y))
        )  # just past the event that ended the last piece
        mode = mode_of(ahead)
        piece = solve_ivp(
            rates,
            (now, times[-1]),
            ahead,
            args=(mode,),
            events=events,
            rtol=1e-10,
            atol=1e-12,
            dense_output=True,
        )
        inside = (times >= now) & (times <= piece.t[-1])
        out[inside] = piece.sol(times[inside]).T
        now, y = piece.t[-1] + 1e-9, piece.y[:, -1]
    return out


def test_approach_and_impact_agree_with_scipy_events():
    setup = campaign_setups()["contour_straight"]
    outcome = run(nominal(), setup, commands=np.full((1500, 2), [0.0, 1.05]))
    times = np.arange(1500) / 1000.0
    expected = oracle_z(times, 1.05)
    got = outcome.true[:, [1, 3, 7]]
    assert outcome.events >= 4
    assert np.abs((got - expected) / SIGMA[[1, 3, 7]]).max() < 1e-3


def test_order_of_the_integrator_is_five():
    """Ringing contact without a change of mode, at fixed steps."""
    rig = nominal()
    rig.contact["stiffness"], rig.axis["law"], rig.axis["stiffness"] = (
        2e5,
        DAHL,
        0.0,
    )  # no friction but C v
    plant = Plant(rig.axis, rig.contact, rig.profile, edge_table("straight", rig), 0.04, rig.terms)
    ends = []
    for step in (2e-3, 1e-3, 5e-4, 5e-5):
        y, modes = np.zeros(STATES), np.zeros(MODES, np.int64)
        y[0], y[WIDTH], y[WIDTH + 1], y[WIDTH + 2] = 0.95, 0.0404, 0.0, 55.0
        act = Acting(np.array([0.0, 55.0]), np.array([True, False]))
        solver = solver_of(plant, Accuracy(1e15, step))
        assert advance(y, modes, 0.0, 8e-3, act, solver) == 0
        ends.append([300.0 * y[WIDTH], y[WIDTH + 1]])
    errors = np.linalg.norm(np.array(ends[:3]) - ends[3], axis=1)
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 4.3)


@pytest.mark.parametrize(
    "name", ["free_motion", "contact_steps", "contour_straight", "contour_curved"]
)
def test_default_accuracy_is_converged(name):
    setup = campaign_setups()[name]
    commands = run(nominal(), setup, draw=draws(setup.rows, 3)).commands
    usual = run(nominal(), setup, commands=commands)
    tight = run(nominal(), setup, commands=commands, accuracy=Accuracy(1e-4, 2e-4))
    assert np.abs((usual.true - tight.true) / SIGMA).max() < 1e-3
    assert usual.events == tight.events


def test_smooth_friction_stays_within_its_limit_force():
    rig = with_smooth_friction(nominal(), 1)
    setup = campaign_setups()["contact_steps"]
    true = run(rig, setup).true
    a = rig.axis[1]
    acceleration = np.gradient(true[:, 3], 1e-3)
    friction = (
        true[:, 7] - true[:, 5] - a["cable"] - a["viscous"] * true[:, 3] - a["mass"] * acceleration
    )
    free = (true[:, 1] > 1e-4) & (true[:, 1] < 0.1)
    assert np.percentile(np.abs(friction[free]), 99) <= 1.02 * a["limit_ratio"] * a["dynamic"]


# --- recorded campaign


@recorded
def test_nominal_campaign_replays_to_the_noise_floor():
    for name, (setup, frame) in read_campaign(SHARED / "nominal").items():
        gaps = np.sqrt(np.mean(residuals(nominal(), setup, frame) ** 2, axis=0))
        assert gaps == pytest.approx(1.0, abs=0.02), name


@recorded
def test_programmes_are_those_of_the_recorded_campaign():
    for name, (recorded_setup, frame) in read_campaign(SHARED / "nominal").items():
        setup = campaign_setups()[name]
        assert (setup.start, setup.release, setup.standoff) == (
            recorded_setup.start,
            recorded_setup.release,
            recorded_setup.standoff,
        )
        if setup.loop == "open":
            assert np.abs(setup.commands() - frame[["u_x", "u_z"]].to_numpy(float)).max() < 1e-4


@recorded
@pytest.mark.parametrize("name", ["contour_straight", "contour_curved"])
def test_regenerated_closed_loop_scores_like_the_recorded_one(name):
    def scores(frame):
        f_n = np.hypot(frame.f_x[7000:].astype(float), frame.f_z[7000:].astype(float))
        return np.sqrt(np.mean((30.0 - f_n) ** 2)), np.abs(30.0 - f_n).max(), frame.u_x[7000:].std()

    setup = campaign_setups()[name]
    made = generate(nominal(), 7, {name: setup})[name]
    there = read_campaign(SHARED / "nominal")[name][1]
    assert np.abs(made.u_z[3000:].astype(float) - there.u_z[3000:]).median() < 2e-3
    assert scores(made)[0] == pytest.approx(scores(there)[0], rel=0.03)
    assert scores(made)[1:] == pytest.approx(
        scores(there)[1:], rel=0.25
    )  # the largest error is one draw of noise


@recorded
def test_written_campaign_reads_like_the_recorded_one(tmp_path):
    setups = {
        name: setup for name, setup in campaign_setups().items() if name.startswith("contour")
    }
    made = generate(nominal(), 3, setups)
    write(tmp_path, made, setups)
    there = tomllib.loads((SHARED / "nominal" / "campaign.toml").read_text())["log"]
    assert tomllib.loads((tmp_path / "campaign.toml").read_text())["log"] == {
        n: there[n] for n in setups
    }
    for name, (_, frame) in read_campaign(tmp_path).items():
        assert frame.equals(made[name])
        assert frame.dtypes.equals(read_campaign(SHARED / "nominal")[name][1].dtypes)


# --- effects


@pytest.fixture(scope="module")
def plain():
    setup = campaign_setups()["contour_curved"]
    draw = draws(setup.rows, 11)
    return setup, draw, run(nominal(), setup, draw=draw)


EVERY = [
    pytest.param(form, axis, id=f"{form.effect}-{form.form}-{axis}")
    for form in ALL_FORMS
    for axis in form.axes
]


@pytest.mark.parametrize(("form", "axis"), EVERY)
def test_effect_shows_at_its_largest_and_not_at_zero(form, axis, plain):
    setup, draw, without = plain
    rig = Cause(form, axis, form.high, 5).apply(nominal())[0]
    changed = run(rig, setup, draw=draw)
    assert np.isfinite(changed.true).all()
    assert (
        np.sqrt(np.mean(((changed.readings - without.readings) / SIGMA) ** 2, axis=0)).max() > 0.3
    )
    neutral = Cause(form, axis, 0.0, 5).apply(nominal())[0]
    for name in ("axis", "contact", "sensor", "timing", "profile"):
        assert np.array_equal(getattr(neutral, name), getattr(nominal(), name))


# Another friction law, whole holds: a small size has no small effect. Fast stages: too stiff to
# follow at such a size.
NOT_FADING = {"presliding", "dropout", "oscillating_spool"}
FADING = [
    p
    for p in EVERY
    if p.values[0].part != "timing"
    and p.values[0].effect not in NOT_FADING
    and "two_stage" not in p.id
]


@pytest.fixture(scope="module")
def undrawn():
    setups = {name: campaign_setups()[name] for name in ("free_motion", "contact_steps")}
    return {name: (setup, run(nominal(), setup)) for name, setup in setups.items()}


@pytest.mark.parametrize(("form", "axis"), FADING)
def test_effect_fades_with_its_size(form, axis, undrawn):
    free = form.part in ("valve", "friction")
    setup, without = undrawn["free_motion" if free else "contact_steps"]
    rig = Cause(form, axis, 1e-4 * form.low, 5).apply(nominal())[0]
    change = (run(rig, setup).readings - without.readings) / SIGMA
    assert np.sqrt(np.mean(change**2, axis=0)).max() < 0.3


def test_catalogue_is_whole_and_unknown_effects_are_not_in_it():
    known, unknown = {form.effect for form in KNOWN_FORMS}, {form.effect for form in UNKNOWN_FORMS}
    assert len(known) == 30
    assert len(unknown) >= 12
    assert not known & unknown
    assert {form.block(axis) for form in ALL_FORMS for axis in form.axes} == BLOCKS


def test_unknown_name_is_refused_by_name():
    with pytest.raises(ValueError, match="got valve_lag/y"):
        draw_cause(np.random.default_rng(0), "valve_lag", "y")


# --- cases


def test_tolerance_has_the_asked_spread_and_keeps_static_above_dynamic():
    factors = []
    for seed in range(300):
        rig, drawn = with_tolerance(nominal(), np.random.default_rng(seed), 0.02)
        assert np.all(rig.axis["static"] >= rig.axis["dynamic"])
        factors.append(list(drawn.values()))
    assert np.std(factors) == pytest.approx(0.02, rel=0.05)


def test_mixture_of_kinds():
    kinds = [plan_case(seed).kind for seed in range(1500)]
    for kind, share in MIXTURE.items():
        assert kinds.count(kind) / 1500 == pytest.approx(share, abs=0.04)


@pytest.mark.parametrize("kind", list(MIXTURE))
def test_case_is_deterministic_and_its_label_well_formed(kind):
    campaign, label = draw_case(41, kind)
    again, label_again = run_case(plan_case(41, kind))
    assert label == label_again
    assert list(campaign) == list(campaign_setups())
    assert all(campaign[name].equals(again[name]) for name in campaign)
    assert label["kind"] == kind
    assert len(label["causes"]) == {"none": 0, "one": 1, "two": 2, "unknown": 1}[kind]
    pairs = [(cause["effect"], cause["axis"]) for cause in label["causes"]]
    assert len(set(pairs)) == len(pairs)
    for cause in label["causes"]:
        assert cause["block"] in BLOCKS
        assert (cause["effect"], cause["axis"]) in names(
            UNKNOWN_FORMS if kind == "unknown" else KNOWN_FORMS
        )
        assert all(isinstance(value, float) for value in cause["parameters"].values())
        assert label["visibility"] <= cause["visibility"]
    assert kind == "none" or label["visibility"] >= LEAST_VISIBLE


def test_a_faint_cause_is_redrawn_larger():
    case = plan_case(9, effects=(("slew_limit", "x"),))
    faint = Cause(case.causes[0].form, "x", 1e-4, 1)  # 10 kN/s limits nothing
    _, label = run_case(type(case)(9, "unknown", case.rig, case.tolerance, (faint,)))
    assert label["causes"][0]["size"] > 1e-4
    assert label["visibility"] >= LEAST_VISIBLE


def test_truth_plant_imports_nothing_of_the_product():
    allowed = {"numpy", "scipy", "numba", "pandas", "pyarrow", "pneugantry"} | set(
        sys.stdlib_module_names
    )
    files = sorted(TRUTH.rglob("*.py"))
    assert TRUTH / "plant.py" in files
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            modules = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            modules += [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
            for module in modules:
                assert module.split(".")[0] in allowed, f"{path.name} imports {module}"
                assert module.split(".")[0] != "pneugantry" or module.startswith(
                    "pneugantry.truth"
                ), path.name


def test_channels_and_noise_line_up():
    assert len(CHANNELS) == len(SIGMA) == 8
    noise = draws(20000, 1).noise
    assert np.std(noise, axis=0) == pytest.approx(SIGMA, rel=0.03)
