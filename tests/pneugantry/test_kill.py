"""kill -9 at any moment: what stands at a final path is whole, what was killed is run again; for
`sweep`: tests/pneugantry/studies/test_sweep.py.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from pneugantry.plants.gantry.catalogue import FOLDER
from pyfmi_runner.build import build_fmu
from pyfmi_runner.log import read_log

FIXED = 'workpiece = "straight"\nseed = 1\nstart = { x = 0.95, z = 0.038 }\n'
SHORT = FIXED + "phases = { approach = [0.0, 1.0], contact = [1.0, 2.0], contour = [2.0, 3.0] }\n"
LONG = 'workpiece = "straight"\nseed = 1\nphases = "thesis"\n'  # 45 s
KILLING = """
import os, signal, sys
from pneugantry.cli import main
replace, left = os.replace, [int(sys.argv.pop(1))]
def kill(*paths):
    left[0] -= os.path.basename(os.path.dirname(os.fspath(paths[1]))) == "out"
    if left[0] < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(*paths)
os.replace = kill
sys.exit(main())
"""  # dies where it would put its N-th result in place (not what it remembers of stages' times)


@pytest.fixture(scope="module", autouse=True)
def fmu() -> Path:
    return build_fmu().path  # so that no run builds it


def whole(folder: Path) -> set[str]:
    """Names of the files at final paths, each read to its end; a hidden one is what was being
    written.
    """
    found = set()
    for path in folder.rglob("*"):
        if path.is_dir() or path.name.startswith(".") or path.suffix == ".toml":
            continue
        found.add(path.name)
        if path.suffix in (".parquet", ".csv"):
            assert len(read_log(path)) in (3000, 45_000)
        elif path.suffix == ".json":
            assert json.loads(path.read_text(encoding="utf-8"))["schema"]
        elif path.suffix == ".html":
            assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
        else:
            assert path.suffix == ".png"
            assert path.read_bytes().endswith(b"IEND\xaeB`\x82")
    return found


def killed(arguments: list[str], seconds: float) -> bool:
    """Runs the command and kills it after so long; whether it was still alive."""
    with started(arguments) as process:
        with suppress(subprocess.TimeoutExpired):
            process.wait(seconds)
        process.kill()
        return process.wait() == -signal.SIGKILL


@contextmanager
def started(arguments: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """The command in a process group of its own, of which nothing is left afterwards."""
    command = [sys.executable, "-m", "pneugantry", *arguments]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def killed_at_each_file(arguments: list[str]) -> Iterator[int]:
    """Kills the command where it would put its first file in place, then its second, ...; gives the
    number that it could.
    """
    for files in range(10):
        done = subprocess.run(
            [sys.executable, "-c", KILLING, str(files), *arguments],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != -signal.SIGKILL:
            assert done.returncode == 0, done.stderr
            return
        yield files


def kill_at_random(arguments: list[str], out: Path, names: set[str], kills: int, seed: int) -> None:
    """Kills over the command's whole life, half of them in its last quarter, where it writes; on
    old files and on none.
    """
    life, rng = seconds_of(arguments), random.Random(seed)
    assert whole(out) == names
    alive = 0
    for k in range(kills):
        if k % 3 == 2:
            shutil.rmtree(out, ignore_errors=True)
        before = whole(out)
        alive += killed(
            arguments, life * (rng.uniform(0.05, 0.75) if k % 2 else rng.uniform(0.75, 1.0))
        )
        assert before <= whole(out) <= names
    assert alive > 0
    assert not killed(arguments, 600.0)
    assert whole(out) == names


def seconds_of(arguments: list[str]) -> float:
    start = time.perf_counter()
    assert not killed(arguments, 600.0)
    return time.perf_counter() - start


def run_arguments(folder: Path, scenario: str, log: str) -> list[str]:
    (folder / "scenario.toml").write_text(scenario, encoding="utf-8")
    out = folder / "out"
    return [
        "run",
        str(folder / "scenario.toml"),
        "--out",
        str(out / log),
        "--plot",
        str(out / "a.png"),
        "--json",
        str(out / "a.json"),
    ]


@pytest.fixture
def diagnose_arguments(tmp_path: Path) -> list[str]:
    """One short log and a catalogue of one effect."""
    (tmp_path / "scenario.toml").write_text(SHORT, encoding="utf-8")
    assert not killed(
        ["run", str(tmp_path / "scenario.toml"), "--out", str(tmp_path / "log.parquet")], 600.0
    )
    (tmp_path / "catalogue").mkdir()
    shutil.copy(FOLDER / "force_bias.toml", tmp_path / "catalogue")
    out = tmp_path / "out"
    return [
        "diagnose",
        str(tmp_path / "log.parquet"),
        "--catalogue",
        str(tmp_path / "catalogue"),
        "--html",
        str(out / "d.html"),
        "--json",
        str(out / "d.json"),
    ]


def test_a_killed_run_leaves_whole_files(tmp_path: Path) -> None:
    arguments, out = run_arguments(tmp_path, LONG, "a.parquet"), tmp_path / "out"
    for seconds in (1.7, 3.1):
        killed(arguments, seconds)
        assert whole(out) <= {"a.parquet", "a.png", "a.json"}
    shutil.rmtree(out, ignore_errors=True)
    for files in killed_at_each_file(arguments):
        assert whole(out) == set(["a.parquet", "a.png", "a.json"][:files])
        shutil.rmtree(out)
    assert whole(out) == {"a.parquet", "a.png", "a.json"}


def test_a_killed_diagnosis_leaves_whole_files(
    tmp_path: Path, diagnose_arguments: list[str]
) -> None:
    for seconds in (3.7, 8.2):
        killed(diagnose_arguments, seconds)
        assert whole(tmp_path / "out") <= {"d.html", "d.json"}
    shutil.rmtree(tmp_path / "out", ignore_errors=True)
    done = subprocess.run(
        [sys.executable, "-c", KILLING, "1", *diagnose_arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert whole(tmp_path / "out") == {"d.json"}


@pytest.mark.slow
@pytest.mark.parametrize("log", ["a.parquet", "a.csv"])
def test_many_kills_of_a_run(tmp_path: Path, log: str) -> None:
    arguments, out, names = (
        run_arguments(tmp_path, LONG, log),
        tmp_path / "out",
        {log, "a.png", "a.json"},
    )
    kill_at_random(arguments, out, names, kills=20, seed=3)


@pytest.mark.slow
def test_many_kills_of_a_diagnosis_with_the_whole_catalogue(
    tmp_path: Path, diagnose_arguments: list[str]
) -> None:
    at = diagnose_arguments.index("--catalogue")
    del diagnose_arguments[at : at + 2]
    kill_at_random(diagnose_arguments, tmp_path / "out", {"d.html", "d.json"}, kills=8, seed=4)


@pytest.mark.slow
def test_a_killed_batch_of_diagnoses_goes_on_where_it_was(
    tmp_path: Path, diagnose_arguments: list[str]
) -> None:
    """`diagnose FOLDER_OF_CAMPAIGNS`: each campaign's result is on disk as soon as it exists, and
    stays.
    """
    many = tmp_path / "many"
    for name in "abc":
        (many / name).mkdir(parents=True)
        shutil.copy(tmp_path / "log.parquet", many / name / "log.parquet")
        text = '[log.log]\nloop = "closed"\nworkpiece = "straight"\n' + SHORT.split("\n", 2)[2]
        (many / name / "campaign.toml").write_text(text, encoding="utf-8")
    arguments = [
        "diagnose",
        str(many),
        "--workers",
        "1",
        *diagnose_arguments[2:4],
        "--json",
        str(tmp_path / "all.json"),
    ]
    with started(arguments) as process:
        while not (many / "a" / "diagnosis.json").exists():
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(0.05)
        process.kill()
    before = (many / "a" / "diagnosis.json").stat().st_mtime_ns
    whole(many)
    assert not (tmp_path / "all.json").exists()
    assert not killed(arguments, 600.0)
    assert (many / "a" / "diagnosis.json").stat().st_mtime_ns == before
    assert set(json.loads((tmp_path / "all.json").read_text(encoding="utf-8"))["campaigns"]) == {
        "a",
        "b",
        "c",
    }
