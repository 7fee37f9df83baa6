"""`pneugantry thesis`."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from pneugantry.options import out_folder
from pneugantry.progress import counter
from pneugantry.thesis.report import report, study_lines
from pneugantry.thesis.study import run_study
from pneugantry.thesis.tables import met_share
from pyfmi_runner.build import build_fmu

HELP = """Run every table and conclusion of the thesis: ours beside the printed, which
conclusion holds, and the leaderboard.

  pneugantry thesis                       tables and figures in out/thesis
  pneugantry thesis --json out/thesis.json
  pneugantry thesis --plants 0            without the table over drawn plants
  pneugantry thesis --draws 2             fewer settings: faster, wider intervals

What the thesis does not print was chosen once for all tables: docs/results/thesis.md."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--out",
        metavar="DIR",
        type=out_folder,
        default=Path("out/thesis"),
        help="figures go here (default out/thesis)",
    )
    command.add_argument(
        "--plants",
        metavar="N",
        type=int,
        default=50,
        help="drawn plants, every parameter within 20 %% (default 50)",
    )
    command.add_argument(
        "--draws",
        metavar="N",
        type=int,
        default=8,
        help="settings of each group: slides of the waves, draws of the finish (default 8)",
    )
    command.add_argument(
        "--workers", metavar="N", type=int, default=2, help="processes (default 2)"
    )
    command.add_argument("--no-figures", action="store_true", help="numbers only")


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    started = time.perf_counter()
    study = run_study(
        build_fmu().path,
        workers=max(options.workers, 1),
        tell=counter("thesis"),
        plants=max(options.plants, 0),
        draws=max(options.draws, 1),
    )
    print("\n".join(study_lines(study)))
    if not options.no_figures:
        from pneugantry.thesis.figures import (
            draw_figures,
        )  # matplotlib loads only when something is drawn

        print(f"{len(draw_figures(study, options.out))} figures: {options.out}")
    held = sum(v.holds for v in study.verdicts)
    print(
        f"{held} of {len(study.verdicts)} conclusions hold where nothing was fitted, "
        f"{met_share(study.cells):.0%} of the printed simulation numbers, each once, met within "
        f"25 % at the fitted setting  ({time.perf_counter() - started:.0f} s)"
    )
    return report(study), 0
