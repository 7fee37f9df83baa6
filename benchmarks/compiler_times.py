"""Build time of the gantry's FMU, time of its steps, and whether two builds give the same bytes.

    python -m benchmarks.compiler_times [--before COMMIT] [--json FILE]

CPU seconds, because other work may share the machine. cold: a new process, nothing in the cache;
warm: a new process that finds the FMU up to date. A step: 1 ms of the core at rest, the shortest of
several rounds. --before: the gantry's FMU as that commit builds it, model and compiler, beside
today's: fmi2DoStep with commands, inputs and outputs in one compiled loop, the two in turn; the
ratio of their times pair by pair, and the largest difference of their outputs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.stiff import Counted
from modelica_fmu.compiler import compile_model
from pyfmi_runner.build import build_fmu, default_model
from pyfmi_runner.cache import CACHE_VARIABLE
from pyfmi_runner.campaign import LogSetup
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import PERIOD, SIGMA
from pyfmi_runner.plant import DEFAULT_CLASS, OUTPUTS
from pyfmi_runner.replay import Replayer

ROUNDS, STEPS = 15, 2000
PAIRS, ROWS, HOLD = 200, 20_000, 400  # of the comparison; ms of its runs, and of each command
ROOT = Path(__file__).resolve().parents[1]


def build_seconds(out: Path) -> float:
    """CPU time of `pneugantry build --out DIR` in a process of its own, compiler included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "pneugantry", "build", "--out", str(out)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def step_seconds(folder: Path) -> float:
    """CPU time of one step of 1 ms of the gantry's core."""
    counted = Counted(compile_model(default_model(), DEFAULT_CLASS), folder)
    times = np.arange(STEPS + 1) * 1e-3
    spent = []
    for _ in range(ROUNDS):
        start = time.process_time()
        counted.run(times, 1e-4, 1e-3)
        spent.append(time.process_time() - start)
    return min(spent) / STEPS


def built_by(commit: str, folder: Path) -> Path:
    """The gantry's FMU from a commit's own model and compiler."""
    packed = subprocess.run(
        ["git", "archive", commit], cwd=ROOT, check=True, capture_output=True
    ).stdout
    subprocess.run(["tar", "x", "-C", str(folder)], input=packed, check=True)
    command = [sys.executable, "-m", "pneugantry", "build", "--out", str(folder / "fmu")]
    of_its_own = {"PYTHONPATH": str(folder), CACHE_VARIABLE: str(folder / "cache")}
    subprocess.run(
        command, cwd=folder, env=os.environ | of_its_own, check=True, stdout=subprocess.DEVNULL
    )
    return next((folder / "fmu").glob("*.fmu"))


def beside(before: Path, now: Path) -> dict[str, Any]:
    """Ratios of the times of two FMUs, now / before, over pairs of the same run."""
    drawn = np.random.default_rng(0).uniform(-1.5, 1.5, (ROWS // HOLD, 2))
    commands = np.repeat(drawn, HOLD, axis=0)
    time_ = np.asarray(PERIOD * np.arange(ROWS), dtype=np.float64)
    setup = LogSetup(start_x=0.5, start_z=0.05)
    with Replayer(FmuFile.read(before)) as one, Replayer(FmuFile.read(now)) as other:
        outputs = [fmu.drive(setup, commands, time_) for fmu in (one, other)]
        spent = np.empty((PAIRS, 2))
        for pair in range(PAIRS):
            order = ((0, one), (1, other)) if pair % 2 else ((1, other), (0, one))
            for place, fmu in order:
                start = time.process_time()
                fmu.drive(setup, commands, time_)
                spent[pair, place] = time.process_time() - start
    ratios = spent[:, 1] / spent[:, 0]
    scale = np.array([SIGMA[name] for name in OUTPUTS])
    return {
        "before_us": round(1e6 * float(spent[:, 0].min()) / ROWS, 3),
        "now_us": round(1e6 * float(spent[:, 1].min()) / ROWS, 3),
        "ratio": [round(float(q), 4) for q in np.quantile(ratios, (0.25, 0.5, 0.75))],
        "apart_sigma": float(np.max(np.abs(outputs[1] - outputs[0]) / scale)),
    }


def measured() -> dict[str, Any]:
    with TemporaryDirectory(prefix="times-") as temporary:
        folder = Path(temporary)
        cold, warm = build_seconds(folder / "a"), build_seconds(folder / "a")
        build_seconds(folder / "b")
        hashes = {
            hashlib.sha256(path.read_bytes()).hexdigest()
            for name in ("a", "b")
            for path in (folder / name).glob("*.fmu")
        }
        return {
            "cold_s": round(cold, 2),
            "warm_s": round(warm, 2),
            "step_us": round(1e6 * step_seconds(folder), 3),
            "same_bytes": len(hashes) == 1,
        }


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--before", metavar="COMMIT")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    found = measured()
    if options.before is not None:
        with TemporaryDirectory(prefix="before-") as folder:
            found |= beside(built_by(options.before, Path(folder)), build_fmu().path)
    for name, value in found.items():
        print(f"{name:12} {value}")
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
