"""Build time of the gantry's FMU, time of its steps, and whether two builds give the same bytes.

    python -m benchmarks.compiler_times [--json FILE]

CPU seconds, because other work may share the machine. cold: a new process, nothing in the cache;
warm: a new process that finds the FMU up to date. A step: 1 ms of the core at rest, the shortest of
several rounds.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.stiff import Counted
from modelica_fmu.compiler import compile_model
from pyfmi_runner.build import default_model
from pyfmi_runner.plant import DEFAULT_CLASS

ROUNDS, STEPS = 15, 2000


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


def measured() -> dict[str, float | bool]:
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
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    found = measured()
    for name, value in found.items():
        print(f"{name:12} {value}")
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
