"""One study run in every way a sweep can run, and killed: the same results bit for bit? `python -m
benchmarks.sweep_check [--cases N]`

Each way is `pneugantry sweep` in a process of its own, on the same FMU; workers, cluster workers
and the command itself are killed with SIGKILL when two fifths of the results are on disk.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from modelica_fmu.errors import RunError
from pyfmi_runner.build import build_fmu
from pyfmi_runner.log import write_atomically

__all__ = ["Way", "cluster", "kill_when", "main", "parts_of", "sweep", "worker_of"]

SPEC = """name = "check"
[base]
workpiece = "curved"
phases = "short"
gains = "table_4_6"
[sample]
method = "latin_hypercube"
n = {cases}
seed = 1
[sample.bounds]
f_nd = [20.0, 40.0]
seed = [0, 999]
"gains.Kp_vx" = [0.5, 1.5]
"plant.contact.K_c" = {{ low = 1e4, high = 4e4, scale = "log" }}
"""
KILL_AT = 0.4  # of the cases
LIMIT = 600.0  # s, for any one way
CLUSTER, WORKER, COMMAND = "cluster of 2 workers", "a worker", "the command, then resumed"
WAYS: tuple[tuple[str, tuple[str, ...], str], ...] = (  # name, options, what is killed
    ("1 process", ("--workers", "1"), ""),
    ("2 processes", ("--workers", "2"), ""),
    ("2 processes", ("--workers", "2"), WORKER),
    ("2 processes", ("--workers", "2"), COMMAND),
    (CLUSTER, ("--scheduler",), ""),
    (CLUSTER, ("--scheduler",), WORKER),
)


@dataclass(frozen=True)
class Way:
    """One way of running the study."""

    name: str
    seconds: float  # wall time of the commands, their start included
    cpu: float  # s, processor time of all that was started for it
    sha256: str  # of results.parquet
    killed: str = ""
    on_disk: int = 0  # results that the second command found, where the first was killed


def sweep(
    spec: Path,
    out: Path,
    *options: str,
    meanwhile: Callable[[subprocess.Popen[bytes]], object] | None = None,
    program: tuple[str, ...] = ("-m", "pneugantry"),
) -> float:
    """Runs the command; `meanwhile` looks on. Seconds; raises RunError where it ends badly without
    having been killed.

    Its JSON and what it says stand beside `out`. program: what Python runs.
    """
    started = time.perf_counter()
    out.parent.mkdir(parents=True, exist_ok=True)
    command = [
        sys.executable,
        *program,
        "sweep",
        str(spec),
        "--out",
        str(out),
        "--json",
        str(out.with_suffix(".json")),
        *options,
    ]
    with (
        (out.parent / f"{out.name}.log").open("ab") as text,
        subprocess.Popen(command, stdout=text, stderr=text) as process,
    ):
        try:
            if meanwhile is not None:
                meanwhile(process)
            process.wait(LIMIT)
        finally:
            process.kill()
    if process.returncode not in (0, -signal.SIGKILL):
        raise RunError(
            f"the sweep ended with code {process.returncode}; see {out.parent / out.name}.log"
        )
    return time.perf_counter() - started


def parts_of(out: Path) -> list[Path]:
    return sorted((out / "parts").glob("*.parquet"))


def worker_of(out: Path) -> int:
    """Process of the worker that wrote the last result."""
    newest = max(parts_of(out), key=lambda path: path.stat().st_mtime_ns)
    return int(pq.ParquetFile(newest).read(["worker"])[0][0].as_py().rpartition(":")[2])


def kill_when(
    out: Path, count: int, victim: Callable[[subprocess.Popen[bytes]], int]
) -> Callable[[subprocess.Popen[bytes]], None]:
    """For `meanwhile`: SIGKILL to a process once `count` results are on disk."""

    def look_on(process: subprocess.Popen[bytes]) -> None:
        while len(parts_of(out)) < count:
            if process.poll() is not None:
                raise RunError(
                    f"the sweep ended before it was killed; see {out.parent / out.name}.log"
                )
            time.sleep(0.002)
        os.kill(victim(process), signal.SIGKILL)

    return look_on


@contextmanager
def cluster(folder: Path, workers: int = 2, *options: str) -> Iterator[tuple[str, list[int]]]:
    """A Dask cluster of processes on this machine, without nannies: its address and the workers'
    processes. options: of a worker.
    """
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    dask, common = [sys.executable, "-m", "dask"], ["--scheduler-file", str(file), "--no-dashboard"]
    with (folder / "cluster.log").open("ab") as text, contextlib.ExitStack() as stack:

        def start(*arguments: str) -> subprocess.Popen[bytes]:
            process = stack.enter_context(
                subprocess.Popen([*dask, *arguments, *common], stdout=text, stderr=text)
            )
            stack.callback(process.kill)  # before the wait of its context
            return process

        start("scheduler", "--port", "0", "--host", "127.0.0.1")
        _wait_for(file.is_file, "the scheduler does not start")
        address = json.loads(file.read_text())["address"]
        alone = ("--no-nanny", "--nthreads", "1", "--local-directory", str(folder / "dask"))
        hands = [start("worker", *alone, *options) for _ in range(workers)]
        yield address, [hand.pid for hand in hands]


def _wait_for(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        if time.monotonic() > deadline:
            raise RunError(what)
        time.sleep(0.05)


def measure(folder: Path, cases: int, tell: Callable[[Way], object]) -> list[Way]:
    """Every way in turn. Raises RunError where one fails or leaves an unreadable file."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    fmu, spec, count = folder / "plant.fmu", folder / "check.toml", max(int(KILL_AT * cases), 1)
    shutil.copyfile(build_fmu().path, fmu)
    spec.write_text(SPEC.format(cases=cases), encoding="utf-8")
    ways: list[Way] = []

    for name, options, killed in WAYS:
        out, before = folder / f"way_{len(ways) + 1}", _cpu()
        with (
            cluster(folder) if name == CLUSTER else contextlib.nullcontext(("", [0])) as (
                address,
                workers,
            )
        ):
            run = (*options, *((address,) if name == CLUSTER else ()), "--fmu", str(fmu))
            victim = partial(_victim, killed, out, workers[0])
            seconds = sweep(
                spec, out, *run, meanwhile=kill_when(out, count, victim) if killed else None
            )
            if killed == COMMAND:
                for path in out.rglob("*.parquet"):
                    pq.ParquetFile(path).read()  # every file that the killed one left
                seconds += sweep(spec, out, *run)
        report = json.loads(out.with_suffix(".json").read_text())
        ways.append(
            Way(name, seconds, _cpu() - before, report["sha256"], killed, report["resumed"])
        )
        tell(ways[-1])
    return ways


def _victim(killed: str, out: Path, cluster_worker: int, process: subprocess.Popen[bytes]) -> int:
    return process.pid if killed == COMMAND else cluster_worker or worker_of(out)


def _cpu() -> float:
    """Processor time of all processes that ended below this one [s]."""
    times = os.times()
    return times.children_user + times.children_system


def main(arguments: list[str] | None = None) -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--cases", type=int, default=1000, metavar="N")
    options.add_argument("--out", type=Path, default=Path("out/sweep_check"), metavar="DIR")
    options.add_argument("--json", type=Path, metavar="FILE")
    chosen = options.parse_args(arguments)
    head = (
        "| how | killed with SIGKILL | seconds | against 1 process | processor seconds | "
        "found on disk | results.parquet |"
    )
    print(f"{chosen.cases} runs of 16 s, curved edge\n\n{head}\n" + "|---" * 7 + "|")
    first: list[Way] = []

    def tell(way: Way) -> None:
        first.append(way)
        disk, against = str(way.on_disk or ""), way.seconds / first[0].seconds
        print(
            f"| {way.name} | {way.killed} | {way.seconds:.1f} | {against:.2f} | "
            f"{way.cpu:.1f} | {disk} | {way.sha256[:12]} |",
            flush=True,
        )

    ways = measure(chosen.out, chosen.cases, tell)
    same = len({way.sha256 for way in ways}) == 1
    print("\nthe same results, bit for bit" if same else "\nTHE RESULTS DIFFER")
    if chosen.json:
        report: dict[str, Any] = {
            "schema": "sweep_check/1",
            "cases": chosen.cases,
            "same": same,
            "ways": [asdict(way) for way in ways],
        }
        write_atomically(
            chosen.json,
            lambda temporary: temporary.write_text(
                json.dumps(report, indent=2) + "\n", encoding="utf-8"
            ),
        )
    return 0 if same else 1


if __name__ == "__main__":
    raise SystemExit(main())
