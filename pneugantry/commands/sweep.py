"""`pneugantry sweep`."""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from modelica_fmu.errors import InputError
from pneugantry.options import out_folder
from pneugantry.progress import bar

if TYPE_CHECKING:
    from pneugantry.jobs.job import Ended
    from pneugantry.sweep.study import Swept

HELP = """Parameter studies: every combination of a grid, or a Latin hypercube or Sobol sample,
resumable, here or on a Dask cluster.

  pneugantry sweep study.toml                     results in out/sweep/study/results.parquet
  pneugantry sweep study.toml --workers 8
  pneugantry sweep study.toml --scheduler tcp://host:8786

Each result is on disk as soon as it exists; the same command again goes on where it was. A case
that fails is a row with its reason.

  base = "scenario.toml"                          # as `pneugantry run` reads it; or a table [base]
  [grid]                                          # every combination
  "plant.contact.K_c" = [1e4, 2e4, 4e4]
  seed = [1, 2, 3]

  [sample]                                        # or in place of [grid]
  method = "sobol"                                # or "latin_hypercube"
  n = 256
  seed = 1
  [sample.bounds]
  f_nd = [20.0, 40.0]
  "plant.contact.K_c" = { low = 1e4, high = 4e4, scale = "log" }
  workpiece = { choices = ["straight", "curved"] }"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("spec", metavar="SPEC.toml", type=Path, help="the study")
    where = command.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes here (default: one a core)",
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="an existing Dask cluster, as in tcp://host:8786"
    )
    command.add_argument(
        "--out",
        type=out_folder,
        metavar="DIR",
        help="folder of the results (default: out/sweep/NAME)",
    )
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="another FMU with the gantry's interface"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.api.inputs import fmu_from
    from pneugantry.sweep.spec import read_spec
    from pneugantry.sweep.study import run_sweep

    if options.workers < 1:
        raise InputError(
            f"is {options.workers}, expected >= 1", field="--workers", hint="give at least one"
        )
    spec = read_spec(options.spec)
    for note in spec.notes:
        print(f"note: {note}")
    fmu = fmu_from(options.fmu)
    out = options.out or Path("out/sweep") / spec.name

    def watch(ends: Iterable[Ended], total: int) -> Iterator[Ended]:
        return bar(ends, total, spec.name)

    swept = run_sweep(
        spec, fmu, out, workers=options.workers, scheduler=options.scheduler, watch=watch
    )
    print_swept(swept)
    failures = [{"case": case, "reason": reason} for case, reason in swept.failures.items()]
    report = {
        "schema": "sweep/1",
        "results": str(swept.results),
        "sha256": swept.sha256,
        "cases": swept.cases,
        "resumed": swept.resumed,
        "failed": len(failures),
        "failures": failures,
        "seconds": swept.seconds,
        "notes": spec.notes,
    }
    return report, 1 if len(failures) == swept.cases else 0


def print_swept(swept: Swept) -> None:
    """The study in a few lines; reasons by how often they occur."""
    were = f", {swept.resumed} were on disk" if swept.resumed else ""
    print(
        f"{swept.cases} cases: {swept.cases - len(swept.failures)} done, "
        f"{len(swept.failures)} failed{were}  ({swept.seconds:.1f} s)"
    )
    for reason, count in Counter(swept.failures.values()).most_common(5):
        print(f"failed: {count} of {swept.cases}: {reason}")
    print(f"results: {swept.results}  sha256 {swept.sha256}")
