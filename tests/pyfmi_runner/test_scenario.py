"""Scenarios: defaults, TOML round trip, refusals."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from modelica_fmu.errors import InputError
from pyfmi_runner.scenario import Scenario, read_scenario, scenario_text, thesis_phases
from pyfmi_runner.sensors import SensorParams
from pyfmi_runner.timing import LoopTiming

TEXT = st.text(st.characters(codec="utf-8"), max_size=10)
VALUES = st.floats(-1e6, 1e6)
SCENARIOS = st.builds(
    Scenario,
    name=TEXT,
    workpiece=st.sampled_from(["straight", "incline_7", "incline_30", "curved"]),
    standoff=st.none() | st.floats(0.0, 0.101),
    surface_finish=st.booleans(),
    start_x=st.floats(0.0, 1.0),
    f_nd=st.floats(0.0, 150.0),
    gains=TEXT | st.dictionaries(TEXT, VALUES, min_size=1, max_size=3),
    plant=st.dictionaries(TEXT, VALUES, max_size=3),
    sensors=st.tuples(st.booleans(), VALUES, st.floats(0.0, 1.0)).map(
        lambda drawn: SensorParams(
            noise=drawn[0], bias_f_z=drawn[1], tau_v_x=drawn[2], quantum=(0.1,) * 8
        )
    ),
    timing=st.floats(0.0, 0.01).map(lambda delay: LoopTiming(delay=delay)),
    seed=st.integers(0, 2**63),
)


@settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(scenario=SCENARIOS)
def test_a_scenario_survives_the_round_trip(tmp_path: Path, scenario: Scenario) -> None:
    (tmp_path / "s.toml").write_text(scenario_text(scenario), encoding="utf-8")
    assert read_scenario(tmp_path / "s.toml") == scenario


def test_an_empty_file_is_the_campaigns_curved_run(tmp_path: Path) -> None:
    (tmp_path / "plain.toml").write_text("")
    scenario = read_scenario(tmp_path / "plain.toml")
    assert scenario == Scenario(name="plain")
    assert scenario.phases == {
        "approach": (0.0, 3.0),
        "contact": (3.0, 7.0),
        "contour": (7.0, 16.0),
    }
    assert (scenario.z_0, scenario.samples, scenario.noise) == (0.090, 16_000, True)
    assert scenario.windows("x")[0][1] == 7.0
    assert scenario.windows("z") == []


@pytest.mark.parametrize(
    ("workpiece", "length"), [("incline_16", 4.5), ("incline_30", 2.4), ("incline_7", 9.0)]
)
def test_contouring_ends_where_the_stroke_does(workpiece: str, length: float) -> None:
    start, end = Scenario(workpiece=workpiece).phases["contour"]
    assert end - start == pytest.approx(length)


def test_the_thesis_run_lasts_45_s(tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_text('phases = "thesis"\n')
    scenario = read_scenario(tmp_path / "t.toml")
    assert scenario.duration == 45.0
    assert scenario.phases["contour"] == (22.0, 32.0)
    assert scenario.phases == thesis_phases("curved")


def test_whole_numbers_are_read_as_floats(tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_text("f_nd = 40\n[plant]\nm_x = 7\n")
    scenario = read_scenario(tmp_path / "t.toml")
    assert isinstance(scenario.f_nd, float)
    assert isinstance(scenario.plant["m_x"], float)


def test_a_workpiece_file_is_taken_from_the_scenarios_folder(tmp_path: Path) -> None:
    (tmp_path / "edge.csv").write_text("x,z_w\n0.3,0\n0.5,-0.01\n0.8,-0.02\n0.95,0\n")
    (tmp_path / "t.toml").write_text('workpiece = "edge.csv"\n')
    scenario = read_scenario(tmp_path / "t.toml")
    assert Path(scenario.workpiece) == tmp_path / "edge.csv"
    assert scenario.z_0 == pytest.approx(0.090)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("f_ndd = 3", "f_ndd: unknown key; did you mean f_nd"),
        ('f_nd = "a"', "f_nd: is 'a', expected a number"),
        ('workpiece = "a\\u0000.csv"', "workpiece: no such file"),
        ("f_nd = true", "f_nd: is True, expected a number"),
        ("f_nd = nan", "f_nd: is nan"),
        ("f_nd = 1e9", r"f_nd: .* expected 0\.\.150"),
        ("standoff = 40", "standoff: .* expected"),
        ("start = [1, 2]", "start: .* expected a table"),
        ('phases = "thesi"', "phases: unknown preset"),
        ("phases = { contour = [0, 3] }", "phases: contact is missing"),
        ("phases = { aproach = [0, 1] }", "phases.aproach: unknown key; did you mean approach"),
        (
            "phases = { contact = [0, 3], contour = [4, 6] }",
            "phases.contour: starts at 4 s, expected 3 s",
        ),
        (
            "phases = { contact = [0, 3], contour = [2, 6] }",
            "phases.contour: starts at 2 s, before",
        ),
        ("phases = { contact = [3, 1] }", "phases.contact: ends at 1 s"),
        ('workpiece = "curvd"', "workpiece: unknown workpiece 'curvd'; did you mean curved"),
        ('workpiece = "no.csv"', "workpiece: no such file"),
        ('clamped = ["y"]', "clamped: has 'y'"),
        ('clamped = ["x until retreat"]', "clamped: .*no phase 'retreat'"),
        ("timing = { jitter = 0.0001 }", "timing: .*delay must be at least"),
        ("timing = { delay = 1e300 }", "timing: delay must be 0..600 s"),
        (
            "timing = { period = 1e-6 }",
            "timing.period: gives 1.6e.07 samples, expected 5000000 or fewer",
        ),
        ("[sensors]\ntau_v_x = -1", "sensors: tau_v_x must be >= 0"),
        ("[sensors.sigma]\nq = 3", "sensors.sigma.q: unknown key"),
        ('[plant]\nm_x = "heavy"', "plant.m_x: is 'heavy'"),
        ("seed = -1", "seed: is -1"),
        ("seed = 1.5", "seed: is 1.5, expected a whole number"),
        ("gains = 3", "gains: is 3, expected a table"),
        ("a = \nb = 1", "not valid TOML.*line 1"),
    ],
)
def test_unusable_scenarios_are_refused_naming_file_key_and_mend(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_scenario(path)
    assert str(caught.value).startswith(str(path))
    assert "; " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_values_are_checked_in_python_too() -> None:
    with pytest.raises(InputError, match="f_nd"):
        Scenario(f_nd=-1.0)
    with pytest.raises(InputError, match="no such file"):
        read_scenario("/nowhere/at_all.toml")
