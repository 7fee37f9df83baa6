"""`import pneugantry as pg`: typed results, pandas in and out, the command line's own functions."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import control
import numpy as np
import pandas as pd
import pytest

import pneugantry as pg
from pneugantry.api.html import html_table
from pneugantry.cli import main

PHASES = {"approach": (0.0, 1.0), "contact": (1.0, 2.0), "contour": (2.0, 3.0)}
SCENARIO = pg.Scenario(name="run", workpiece="straight", start_z=0.038, phases=PHASES, seed=1)


@pytest.fixture(scope="module")
def done() -> pg.TrackingRun:
    return pg.run(SCENARIO)


def test_importing_the_package_imports_no_library() -> None:
    code = "import sys, pneugantry as pg; dir(pg); print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in said.stdout.split()}
    assert not loaded & {"numpy", "pandas", "numba", "casadi", "control", "matplotlib", "fmpy"}


def test_every_name_is_there_and_typed_where_it_is_loaded_from() -> None:
    for name in pg.__all__:
        assert getattr(pg, name).__doc__, name
    assert set(pg.__all__) <= set(dir(pg))
    tree = ast.parse(Path(pg.__file__).read_text(encoding="utf-8"))
    imported = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module != "__future__"
        for alias in node.names
    }
    loaded = dict(pg._MODULE_OF)
    assert {k: v for k, v in imported.items() if k in loaded} == loaded
    assert set(loaded) == set(pg.__all__)
    with pytest.raises(AttributeError, match="no attribute 'diagnos'"):
        pg.diagnos  # noqa: B018


def test_a_run_is_a_table_and_figures_of_merit(done: pg.TrackingRun) -> None:
    assert done.outcome == "done"
    assert done.metrics is not None
    assert len(done.table) == 3000
    assert isinstance(done.table, pd.DataFrame)
    assert done.as_json()["metrics"] == done.metrics._asdict()
    assert f"{done.metrics.rmse_fn:.4g}" in done._repr_html_()
    assert done.figure().axes


def test_the_command_gives_what_the_function_gives(
    done: pg.TrackingRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.toml").write_text(
        'workpiece = "straight"\nstart = { x = 0.95, z = 0.038 }\nseed = 1\n'
        "phases = { approach = [0.0, 1.0], contact = [1.0, 2.0], contour = [2.0, 3.0] }\n"
    )
    assert main(["run", str(tmp_path / "run.toml"), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["metrics"] == done.as_json()["metrics"]


def test_what_differs_from_the_scenario_is_said_by_name(done: pg.TrackingRun) -> None:
    other = pg.run(SCENARIO, controller="dfv", parameters={"contact.K_c": 2e4}, seed=2)
    assert other.scenario.controller == "dfv"
    assert other.log.provenance["parameters"] == {"contact.K_c": 2e4}
    assert not np.array_equal(other.log["f_z"], done.log["f_z"])
    with pytest.raises(pg.InputError, match="unknown controller 'pi_fw'"):
        pg.run(SCENARIO, controller="pi_fw")


def test_a_pandas_table_is_replayed_as_its_log_is(done: pg.TrackingRun) -> None:
    by_log, by_table = pg.replay(done.log), pg.replay(done.table)
    assert by_table.channels.loc["table", "gap"] == by_log.channels.loc["run", "gap"]
    assert 0.95 < float(by_log.channels.loc["run", "gap"]) < 1.05
    assert {"log", "block", "gap", "floor"} == set(by_log.blocks.columns)
    assert "v_z" in by_log._repr_html_()
    assert by_log.campaign.notes == []


def test_a_table_without_its_setup_is_noted_and_a_bad_one_refused(done: pg.TrackingRun) -> None:
    bare = pd.DataFrame(done.table.to_dict("list"))
    assert any("nothing says how" in note for note in pg.replay(bare).campaign.notes)
    said = pg.replay(bare, setup=done.log.provenance["setup"])
    assert said.campaign.notes == []
    with pytest.raises(pg.InputError, match="f_az: column is missing"):
        pg.replay(bare.drop(columns="f_az"))
    with pytest.raises(pg.InputError, match="workpeace: unknown key"):
        pg.replay(bare, setup={"workpeace": "straight"})


@pytest.mark.usefixtures("unoptimised")
def test_a_table_is_diagnosed_as_a_campaign_of_one(done: pg.TrackingRun) -> None:
    found = pg.diagnose(done.table)
    assert found.json["schema"] == "gap/1"
    assert found.verdict == found.json["verdict"]
    assert list(found.where.columns) == ["block", "share", "logs", "regime"]
    assert set(found.causes["effect"]) == {c["effect"] for c in found.json["causes"]}
    assert found.gap is not None
    assert found.gap.floor > 0
    assert f"verdict: {found.verdict}" in found._repr_html_()


@pytest.mark.usefixtures("unoptimised")
def test_a_build_is_read_and_stepped(tmp_path: Path) -> None:
    built = pg.build(out=tmp_path)
    assert built.path.parent == tmp_path
    assert next(iter(built.manifest["compilers"])) in built._repr_html_()
    with built.session({"contact.z_0": 0.04}) as fmu:
        fmu.step(1e-3, time=0.0)
        assert fmu.get("z") == pytest.approx(0.0, abs=1e-6)
    assert pg.build(controller="pi_fv", out=tmp_path).path.name.endswith("pi_fv.fmu")


def test_linear_models_are_python_control_objects() -> None:
    model = pg.linearize("contact_sliding", outputs=["f_n"])
    assert isinstance(model, control.StateSpace)
    assert model.output_labels == ["f_n"]
    locus = pg.rootlocus("z", lag="none")
    assert isinstance(locus.loop.plant, control.StateSpace)
    assert sorted(np.round(locus.poles.imag)) == [-65.0, 65.0]  # Fig. 5.7
    with pytest.raises(pg.InputError, match="unknown point 'contact'"):
        pg.linearize("contact")


def test_cells_of_a_table_are_escaped() -> None:
    assert "&lt;b&gt;" in html_table(["<b>"], [[1.23456]])
    assert "1.235" in html_table(["<b>"], [[1.23456]])
