"""A sweep gives the same table however it was run, killed and resumed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from benchmarks.sweep_check import cluster, kill_when, parts_of, sweep, worker_of
from modelica_fmu.errors import InputError
from pneugantry.analysis.metrics import tracking_metrics
from pneugantry.cli import main
from pneugantry.jobs.job import Ended, Factory, Job, answer
from pneugantry.sweep import work
from pneugantry.sweep.spec import Spec, read_spec
from pneugantry.sweep.store import BLOCK, Store, column_types
from pneugantry.sweep.study import Swept, run_sweep
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import read_log
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import scenario_from

Watcher = Callable[["subprocess.Popen[bytes]"], object]
BASE = """
[base]
workpiece = "straight"
start = { x = 0.95, z = 0.038 }
phases = { approach = [0.0, 0.5], contact = [0.5, 0.7], contour = [0.7, 0.9] }
"""
GRID = f"""name = "grid"
{BASE}
[grid]
"plant.contact.K_c" = [1e4, 2e4]
seed = {list(range(16))}
"""
CASES = 32
PROGRAM = Path(__file__).with_name("sweep_in_python.py")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Holds the study's file and a copy of the FMU, so that nothing rebuilds it in between."""
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "grid.toml").write_text(GRID, encoding="utf-8")
    shutil.copyfile(build_fmu().path, folder / "plant.fmu")
    return folder


@pytest.fixture(scope="module")
def fmu(folder: Path) -> FmuFile:
    return FmuFile.read(folder / "plant.fmu")


@pytest.fixture(scope="module")
def spec(folder: Path) -> Spec:
    return read_spec(folder / "grid.toml")


def in_this_process(factory: Factory, jobs: Sequence[Job], **_: object) -> Iterator[Ended]:
    """In place of `run_jobs`: no worker has to start."""
    function = factory()
    return (answer(function, job) for job in jobs)


@pytest.fixture
def no_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pneugantry.sweep.study.run_jobs", in_this_process)


@pytest.fixture(scope="module")
def reference(folder: Path, spec: Spec, fmu: FmuFile) -> Swept:
    """The study in one process, in the compiled loop."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pneugantry.sweep.study.run_jobs", in_this_process)
        return run_sweep(spec, fmu, folder / "reference")


def command(
    folder: Path, out: Path, *options: str, meanwhile: Watcher | None = None
) -> dict[str, Any]:
    """The command in a process of its own: its JSON, empty where it was killed."""
    sweep(
        folder / "grid.toml",
        out,
        "--fmu",
        str(folder / "plant.fmu"),
        *options,
        meanwhile=meanwhile,
        program=(str(PROGRAM),),
    )
    report = out.with_suffix(".json")
    return json.loads(report.read_text()) if report.is_file() else {}


def test_a_row_is_what_the_run_alone_gives(reference: Swept, spec: Spec, fmu: FmuFile) -> None:
    table = pd.read_parquet(reference.results)
    assert list(table.columns) == [
        "case",
        "plant.contact.K_c",
        "seed",
        "rmse_fn",
        "me_fn",
        "rmse_vt",
        "me_vt",
        "status",
        "reason",
    ]
    assert list(table["case"]) == list(range(CASES))
    row = table.iloc[21]
    alone = tracking_metrics(
        run_scenario(scenario_from(spec.base | {"plant": {"contact.K_c": 2e4}, "seed": 5}), fmu).log
    )
    assert (row["plant.contact.K_c"], row["seed"], row["status"]) == (2e4, 5, "done")
    assert tuple(row[["rmse_fn", "me_fn", "rmse_vt", "me_vt"]]) == tuple(alone)
    about = json.loads(pq.ParquetFile(reference.results).schema_arrow.metadata[b"pneugantry"])
    assert (about["fmu"], about["units"]["rmse_fn"]) == (fmu.sha256, "N")
    assert len(pd.read_parquet(reference.results.parent / "timings.parquet")) == CASES


def test_two_processes_of_which_one_is_killed_give_the_same_bits(
    tmp_path: Path, folder: Path, reference: Swept
) -> None:
    out = tmp_path / "out"
    report = command(
        folder, out, "--workers", "2", meanwhile=kill_when(out, 5, lambda _: worker_of(out))
    )
    assert report["sha256"] == reference.sha256
    assert 2 <= pd.read_parquet(out / "timings.parquet")["worker"].nunique() <= 3


def test_a_killed_sweep_leaves_readable_files_and_goes_on_where_it_was(
    tmp_path: Path, folder: Path, reference: Swept
) -> None:
    out = tmp_path / "out"
    assert (
        command(
            folder, out, "--workers", "1", meanwhile=kill_when(out, 5, lambda process: process.pid)
        )
        == {}
    )
    left = [pq.ParquetFile(path).read().num_rows for path in parts_of(out)]
    assert 5 <= sum(left) < CASES
    assert not (out / "results.parquet").exists()
    orphan = worker_of(out)
    parts_of(out)[0].write_bytes(b"PAR1")  # as a power cut may leave it: its case runs again
    report = command(folder, out, "--workers", "2")
    assert (report["resumed"], report["sha256"]) == (sum(left) - 1, reference.sha256)
    assert sorted(path.name for path in out.iterdir()) == [
        ".lock",
        "results.parquet",
        "study.json",
        "timings.parquet",
    ]
    with pytest.raises(ProcessLookupError):
        os.kill(orphan, 0)


def test_a_cluster_that_loses_a_worker_gives_the_same_bits(
    tmp_path: Path, folder: Path, reference: Swept
) -> None:
    pytest.importorskip("distributed")
    out = tmp_path / "out"
    with cluster(tmp_path, 2, "--preload", str(PROGRAM)) as (address, workers):
        report = command(
            folder, out, "--scheduler", address, meanwhile=kill_when(out, 5, lambda _: workers[0])
        )
    assert report["sha256"] == reference.sha256


@pytest.mark.usefixtures("no_workers")
def test_a_failing_case_is_a_row_with_its_reason(
    tmp_path: Path,
    fmu: FmuFile,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(work, "run_scenario", partial(run_scenario, compiled=False))
    path = tmp_path / "mixed.toml"
    path.write_text(
        f'keep_logs = true\n{BASE}\n[grid]\ncontroller = ["pid_fv", "pi_fv"]\ngains = '
        f'["table_3_11", "table_3_5"]'
    )
    assert main(["sweep", str(path), "--out", str(tmp_path / "out"), "--fmu", str(fmu.path)]) == 0
    assert "4 cases: 3 done, 1 failed" in capsys.readouterr().out
    table = pd.read_parquet(tmp_path / "out" / "results.parquet")
    assert list(table["status"]) == ["done", "done", "done", "failed"]
    assert "v_z.k_d" in table["reason"][3] or "derivative" in table["reason"][3]
    assert np.isnan(table["rmse_fn"][3])
    assert sorted(p.name for p in (tmp_path / "out" / "logs").iterdir()) == [
        f"{case:06d}.parquet" for case in range(3)
    ]
    log = read_log(tmp_path / "out" / "logs" / "000001.parquet")
    assert tracking_metrics(log).rmse_fn == table["rmse_fn"][1]
    assert log.provenance["seed"] == 0


@pytest.mark.usefixtures("no_workers")
def test_an_edge_of_ones_own_travels_with_the_study(tmp_path: Path, fmu: FmuFile) -> None:
    edge = tmp_path / "edge.csv"
    edge.write_text("x,z_w\n" + "".join(f"{k / 20},{1e-4 * k}\n" for k in range(21)))
    path = tmp_path / "own.toml"
    path.write_text(f"{BASE.replace('straight', 'edge.csv')}\n[grid]\nstandoff = [0.04]")
    swept = run_sweep(read_spec(path), fmu, tmp_path / "out")
    assert swept.failures == {}
    edge.write_text(edge.read_text().replace("0.0005", "0.0006"))
    with pytest.raises(InputError, match="spec: the results there are of another one"):
        run_sweep(read_spec(path), fmu, tmp_path / "out")


def test_results_of_another_study_or_sweep_are_not_touched(
    folder: Path, spec: Spec, fmu: FmuFile, reference: Swept, tmp_path: Path
) -> None:
    out = reference.results.parent
    (tmp_path / "grid.toml").write_text(GRID.replace("2e4", "3e4"))
    with pytest.raises(InputError, match=r"study\.json: spec: .*choose another --out"):
        run_sweep(read_spec(tmp_path / "grid.toml"), fmu, out)
    again = run_sweep(spec, fmu, out)
    assert (again.resumed, again.sha256) == (CASES, reference.sha256)
    with (
        Store(tmp_path / "busy", {}, {}, {}),
        pytest.raises(InputError, match="another sweep is at work there"),
    ):
        run_sweep(spec, fmu, tmp_path / "busy")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "results.parquet").touch()
    with pytest.raises(InputError, match="holds results of something else"):
        run_sweep(spec, fmu, tmp_path / "full")
    (tmp_path / "full" / "study.json").write_text("{")
    with pytest.raises(InputError, match="is damaged"):
        run_sweep(spec, fmu, tmp_path / "full")


def test_parts_are_gathered_and_a_store_reads_what_it_wrote(tmp_path: Path) -> None:
    rows = [
        {"seed": k, "gains": {"Kp_vx": float(k)}, "f_nd": k if k else 0.5, "big": 2**70}
        for k in range(BLOCK + 10)
    ]
    columns = column_types(rows)
    with Store(tmp_path, {"spec": "1"}, columns, {}) as store:
        for case, row in reversed(list(enumerate(rows))):
            store.add({"case": case, **row})
    assert len(parts_of(tmp_path)) == 11
    with Store(tmp_path, {"spec": "1"}, columns, {}) as store:
        assert len(store.rows) == len(rows)
        assert [store.rows[3][name] for name in rows[3]] == [3, '{"Kp_vx": 3.0}', 3.0, str(2**70)]
        assert list(pd.read_parquet(store.finish())["case"]) == list(range(len(rows)))
    assert parts_of(tmp_path) == []


def test_the_command_refuses_in_one_line(
    tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments in (
        ["none.toml"],
        [str(folder / "grid.toml"), "--workers", "0"],
        [str(folder / "grid.toml"), "--workers", "2", "--scheduler", "x"],
    ):
        capsys.readouterr()
        assert main(["sweep", *arguments]) == 2
        assert capsys.readouterr().err.count("\n") == 1
