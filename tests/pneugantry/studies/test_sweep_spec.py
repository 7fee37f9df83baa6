"""A study's file: what it means, and how it is refused."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from modelica_fmu.errors import InputError
from pneugantry.sweep.cases import Axis, sample_cases
from pneugantry.sweep.check import check_spec
from pneugantry.sweep.spec import Spec, read_spec
from pneugantry.sweep.store import column_types
from pneugantry.sweep.vary import changed
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile


def spec_of(folder: Path, text: str) -> Spec:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return read_spec(path)


def test_a_grid_is_every_combination_the_last_name_fastest(tmp_path: Path) -> None:
    spec = spec_of(
        tmp_path,
        '[grid]\nplant.contact.K_c = [1e4, 2e4]\nworkpiece = ["straight", '
        '"curved"]\nseed = [1, 2, 3]',
    )
    assert spec.varied == ["plant.contact.K_c", "workpiece", "seed"]
    assert len(spec.cases) == 12
    assert spec.cases[0] == {"plant.contact.K_c": 1e4, "workpiece": "straight", "seed": 1}
    assert spec.cases[1]["seed"] == 2
    assert [str(kind) for kind in column_types(spec.cases).values()] == [
        "double",
        "string",
        "int64",
    ]


@pytest.mark.parametrize("method", ["lhs", "latin_hypercube", "sobol"])
def test_a_sample_stays_in_its_bounds_and_comes_back_with_its_seed(
    tmp_path: Path, method: str
) -> None:
    text = f"""
[sample]
method = "{method}"
n = 64
seed = 5
[sample.bounds]
f_nd = [20.0, 40.0]
plant.contact.K_c = {{ low = 1e3, high = 1e5, scale = "log" }}
seed = [1, 8]
workpiece = {{ choices = ["straight", "curved"] }}
"""
    spec = spec_of(tmp_path, text)
    assert (
        spec.cases
        == spec_of(tmp_path, text).cases
        != spec_of(tmp_path, text.replace("seed = 5", "seed = 6")).cases
    )
    forces, stiffness = (
        [case[name] for case in spec.cases] for name in ("f_nd", "plant.contact.K_c")
    )
    assert all(20.0 <= f <= 40.0 for f in forces)
    assert (
        sum(k < 1e4 for k in stiffness) == 32
    )  # half of the points below the middle of the log scale
    assert sorted(case["seed"] for case in spec.cases) == sorted([*range(1, 9)] * 8)
    assert sum(case["workpiece"] == "curved" for case in spec.cases) == 32


def test_a_point_never_leaves_its_axis() -> None:
    top = 1.0 - 2.0**-53
    assert Axis(1.0, 3.0, whole=True).at(top) == 3
    assert Axis(1.0, 3.0, log=True).at(top) <= 3.0
    assert Axis(choices=("a", "b")).at(top) == "b"
    assert len(sample_cases("sobol", {"x": Axis()}, 5, 0)) == 5


def test_sobol_off_a_power_of_two_is_noted(tmp_path: Path) -> None:
    assert (
        "n = 100, next is 128"
        in spec_of(
            tmp_path, '[sample]\nmethod = "sobol"\nn = 100\nbounds = { f_nd = [20, 40] }'
        ).notes[0]
    )
    assert (
        spec_of(tmp_path, '[sample]\nmethod = "sobol"\nn = 128\nbounds = { f_nd = [20, 40] }').notes
        == ()
    )


def test_the_base_is_a_table_or_a_file(tmp_path: Path) -> None:
    (tmp_path / "edge.csv").write_text("x,z_w\n" + "".join(f"{k / 20},0.0\n" for k in range(21)))
    (tmp_path / "scenario.toml").write_text('workpiece = "edge.csv"\nf_nd = 25.0')
    spec = spec_of(tmp_path, 'base = "scenario.toml"\n[grid]\nworkpiece = ["edge.csv", "straight"]')
    assert spec.base["workpiece"] == str(tmp_path / "edge.csv") == spec.cases[0]["workpiece"]
    assert spec.base["f_nd"] == 25.0
    assert spec_of(tmp_path, "[base]\nf_nd = 25.0\n[grid]\nseed = [1]").base == {"f_nd": 25.0}


def test_changes_go_to_their_place_and_leave_the_base_alone() -> None:
    base = {"gains": "table_4_6", "plant": {"valve_z.tau": 0.1}}
    table = changed(
        base,
        {
            "plant.contact.K_c": 1e4,
            "gains.Kp_vx": 2.0,
            "start.x": 0.9,
            "sensors.sigma.z": 0.0,
            "f_nd": 20.0,
        },
    )
    assert table["plant"] == {"valve_z.tau": 0.1, "contact.K_c": 1e4}
    assert (table["gains"]["Kp_vx"], table["gains"]["Ki_vx"]) == (2.0, 4.0)
    assert (table["start"], table["sensors"], table["f_nd"]) == (
        {"x": 0.9},
        {"sigma": {"z": 0.0}},
        20.0,
    )
    assert base == {"gains": "table_4_6", "plant": {"valve_z.tau": 0.1}}


def test_the_studies_of_the_documents_are_ones(tmp_path: Path) -> None:
    page = Path(__file__).parents[3] / "docs" / "how-to" / "parameter-studies.md"
    grid, sample = re.findall(
        r"```toml[^\n]*\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL
    )
    fmu = FmuFile.read(build_fmu().path)
    for text, cases in ((grid, 4), (sample, 4)):
        spec = spec_of(tmp_path, text)
        check_spec(spec, fmu)
        assert len(spec.cases) == cases


GRID = "[grid]\n"
BOUNDS = "[sample]\nn = 4\n[sample.bounds]\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "grid or sample: is missing; write one of them"),
        (f"{GRID}seed = [1]\n{BOUNDS}f_nd = [1, 2]", "grid or sample: both are given"),
        ("sweep = 1", "sweep: unknown key"),
        (f'name = "a/b"\n{GRID}seed = [1]', "name: is 'a/b'"),
        (f'base = "none.toml"\n{GRID}seed = [1]', "base: no such file"),
        (f"base = 3\n{GRID}seed = [1]", "base: is 3, expected a table or a file"),
        (f"[base]\nf_nd = -1.0\n{GRID}seed = [1]", "base.f_nd: is -1.0, expected 0..150"),
        ("grid = 3", "grid: is 3"),
        (GRID, "grid: is empty"),
        (f"{GRID}seed = 3", "grid.seed: is 3, expected a list of values"),
        (f"{GRID}seed = []", "grid.seed: is [], expected a list"),
        (f"{GRID}seed = [1, 1]", "grid.seed: holds a value twice"),
        (
            f"{GRID}seed = {list(range(2000))}\nf_nd = {[k / 20 for k in range(2000)]}",
            "grid: has 4000000 combinations",
        ),
        (
            f'{GRID}gains = ["table_4_6"]\n"gains.Kp_vx" = [1.0]',
            "grid.gains.Kp_vx: varies a part of gains",
        ),
        (f'{GRID}workpiece = ["gone.csv"]', "grid.workpiece: no such file"),
        ("[sample]\nbounds = { f_nd = [1, 2] }", "sample.n: is 0, expected 1..1000000"),
        ('[sample]\nmethod = "grid"', "sample.method: is 'grid'; use latin_hypercube, lhs, sobol"),
        ("[sample]\nn = 4\nseed = -1", "sample.seed: is -1"),
        ("[sample]\nn = 4", "sample.bounds: is empty"),
        (f"{BOUNDS}f_nd = 3", "sample.bounds.f_nd: is 3, expected low and high"),
        (f"{BOUNDS}f_nd = [3, 3]", "sample.bounds.f_nd: goes from 3.0 to 3.0; write low < high"),
        (f'{BOUNDS}f_nd = [3, "x"]', "sample.bounds.f_nd.high: is 'x', expected a number"),
        (
            f'{BOUNDS}f_nd = {{ low = 0, high = 1, scale = "log" }}',
            "sample.bounds.f_nd.low: is 0, a log scale needs > 0",
        ),
        (
            f'{BOUNDS}f_nd = {{ low = 0, high = 1, scale = "ln" }}',
            "sample.bounds.f_nd.scale: is 'ln'",
        ),
        (f"{BOUNDS}f_nd = {{ choices = [] }}", "sample.bounds.f_nd.choices: needs values"),
        (f"{BOUNDS}seed = [1.5, 3]", "sample.bounds.seed: goes from 1.5 to 3"),
    ],
)
def test_a_bad_spec_is_one_line_with_file_field_and_mend(
    tmp_path: Path, text: str, said: str
) -> None:
    with pytest.raises(InputError) as refused:
        spec_of(tmp_path, text)
    assert said in str(refused.value)
    assert refused.value.file
    assert refused.value.hint
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            f'{GRID}"contact.K_c" = [1e4]',
            "grid.contact.K_c: unknown key; did you mean plant.contact.K_c?",
        ),
        (f"{GRID}force = [1.0]", "grid.force: unknown key; name a field of a scenario"),
        (f"{GRID}f_nd = [30.0, 500.0]", "grid.f_nd: is 500.0, expected 0..150"),
        (f"{GRID}start.y = [1.0]", "grid.start.y: unknown key"),
        (
            f'{GRID}controller = ["pi_fv", "pi_vf"]',
            "grid.controller: unknown controller 'pi_vf'; nearest is 'pi_fv'",
        ),
        (f"{GRID}plant.contact.K_k = [1.0]", "grid.plant.contact.K_k: "),
        (f"{BOUNDS}plant.contact.K_c = [-1.0, 1.0]", "sample.bounds.plant.contact.K_c: "),
        (f'{GRID}"gains.Kp_vx" = [1.0, 2.0]', "grid.gains.Kp_vx: is one gain of several"),
        (
            f'[base]\ngains = "table_4_6"\n{GRID}"gains.Kp_xx" = [1.0]',
            "grid.gains.Kp_xx: unknown gain",
        ),
    ],
)
def test_what_scenario_controller_or_fmu_refuse_is_refused_before_the_first_case(
    tmp_path: Path, text: str, said: str
) -> None:
    spec = spec_of(tmp_path, text)
    with pytest.raises(InputError) as refused:
        check_spec(spec, FmuFile.read(build_fmu().path))
    assert said in str(refused.value)
    assert str(tmp_path / "study.toml") in str(refused.value)
    assert refused.value.hint
