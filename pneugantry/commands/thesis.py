"""`pneugantry thesis`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from modelica_fmu.errors import InputError
from pneugantry.options import out_folder
from pneugantry.progress import counter

if TYPE_CHECKING:
    from pneugantry.thesis.run_store import RunStore
    from pneugantry.thesis.runner import Tell
    from pyfmi_runner.fmu import FmuFile

HELP = """Run every table and conclusion of the thesis: ours beside the printed, which
conclusion holds, and the leaderboard.

  pneugantry thesis                       tables and figures in out/thesis
  pneugantry thesis --json out/thesis.json
  pneugantry thesis --plants 0            without the table over drawn plants
  pneugantry thesis --draws 2             fewer settings: faster, wider intervals
  pneugantry thesis --gap                 what explains the thesis' own measurement
  pneugantry thesis --board               every controller on every structure of plant
  pneugantry thesis --runs FILE           finished runs are kept there: a killed study goes on
  pneugantry thesis --variants            on which unprinted value a conclusion hangs
  pneugantry thesis --tuning              Figs. 3.14-3.17, 3.19-3.25, 4.8, 4.15 and App. E
  pneugantry thesis --list                every table and figure: ours, or why not

What the thesis does not print was chosen once for all tables: docs/results/thesis.md."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    mode = command.add_mutually_exclusive_group()
    mode.add_argument(
        "--gap",
        action="store_true",
        help="the thesis' own sim-to-real gap, ranked; picture in DIR/gap.png",
    )
    mode.add_argument(
        "--board",
        action="store_true",
        help="the leaderboard over structures, with margins; exit 1 where the limits are missed",
    )
    mode.add_argument(
        "--variants",
        action="store_true",
        help="the conclusions with other values of what the thesis does not print",
    )
    mode.add_argument(
        "--tuning",
        action="store_true",
        help="the tuning series and angles of chapters 3 and 4 and of Appendix E",
    )
    mode.add_argument(
        "--list",
        action="store_true",
        help="every table and figure of the thesis: where ours is, or why there is none",
    )
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
        "--runs",
        metavar="FILE",
        type=Path,
        help="finished runs are kept here and not run again (default DIR/runs.sqlite); delete it "
        "to run everything anew",
    )
    command.add_argument(
        "--controllers",
        metavar="NAME",
        nargs="+",
        default=[],
        help="of --board: these alone, as the board names them (default all)",
    )
    command.add_argument(
        "--no-margins",
        action="store_true",
        help="of --board: scores alone; margins take a loop compiled and some 17 runs a controller",
    )
    command.add_argument(
        "--workers", metavar="N", type=int, default=2, help="processes (default 2)"
    )
    command.add_argument("--no-figures", action="store_true", help="numbers only")


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    modes = {
        "gap": _gap,
        "board": _board,
        "tuning": _tuning,
        "variants": _variants,
        "list": _contents,
    }
    chosen = next((run for name, run in modes.items() if getattr(options, name)), _study)
    started = time.perf_counter()
    found, lines, code = chosen(options, counter("thesis"))
    print("\n".join(lines))
    print(f"({time.perf_counter() - started:.0f} s)")
    return found, code


def _gantry() -> FmuFile:
    from pneugantry.api.inputs import fmu_from

    return fmu_from()


@contextmanager
def _store(options: argparse.Namespace, fmu: FmuFile) -> Iterator[RunStore]:
    """Says afterwards how much of the answer was there before."""
    from pneugantry.thesis.run_store import RunStore

    store = RunStore(options.runs or options.out / "runs.sqlite", fmu.sha256)
    try:
        yield store
    finally:
        store.close()
    if store.taken:
        print(f"{store.taken} finished runs taken from {store.file}")


Answer = tuple[dict[str, Any], list[str], int]  # JSON, lines, exit code


def _study(options: argparse.Namespace, tell: Tell) -> Answer:
    from pneugantry.thesis.report import report, study_lines
    from pneugantry.thesis.study import run_study
    from pneugantry.thesis.tables import met_share

    fmu = _gantry()
    with _store(options, fmu) as store:
        study = run_study(
            fmu.path,
            workers=max(options.workers, 1),
            tell=tell,
            plants=max(options.plants, 0),
            draws=max(options.draws, 1),
            store=store,
        )
    lines = list(study_lines(study))
    if not options.no_figures:
        from pneugantry.thesis.figures import draw_figures

        drawn = draw_figures(study, fmu, options.out)
        lines.append(f"{len(drawn)} figures: {options.out}")
    held = sum(v.holds for v in study.verdicts)
    lines.append(
        f"{held} of {len(study.verdicts)} conclusions hold where nothing was fitted, "
        f"{met_share(study.cells):.0%} of the printed simulation numbers, each once, met within "
        "25 % at the fitted setting"
    )
    return report(study), lines, 0


def _gap(options: argparse.Namespace, tell: Tell) -> Answer:
    from pneugantry.thesis.gap import DRAWS, run_gap
    from pneugantry.thesis.gap_report import draw_gap, gap_lines, gap_report

    draws = min(max(options.draws, 2), DRAWS)
    fmu, workers = _gantry(), max(options.workers, 1)
    with _store(options, fmu) as store:
        gap = run_gap(fmu.path, workers=workers, tell=tell, draws=draws, store=store)
    lines = list(gap_lines(gap))
    if not options.no_figures:
        lines.append(f"picture: {draw_gap(gap, options.out)}")
    return gap_report(gap), lines, 0


def _board(options: argparse.Namespace, tell: Tell) -> Answer:
    """Exit code 1 where the robust controller misses what is asked of it."""
    from pneugantry.thesis.board_report import board_lines, board_report
    from pneugantry.thesis.entrants import JUDGED, entrants
    from pneugantry.thesis.structure_board import Wanted, run_board

    names = [*options.controllers]
    known = [entrant.name for entrant in entrants()]
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, n=1, cutoff=0.0)[0]
            message = f"no controller {name!r} on the board"
            raise InputError(message, field="--controllers", hint=f"nearest is {near!r}")
    wanted = Wanted(
        max(options.plants, 0),
        [*dict.fromkeys([*names, *JUDGED])] if names else (),
        not options.no_margins,
    )
    fmu = _gantry()
    with _store(options, fmu) as store:
        board = run_board(
            fmu.path,
            wanted,
            workers=max(options.workers, 1),
            tell=tell,
            store=store,
        )
    return board_report(board), list(board_lines(board)), 0 if board.met else 1


def _variants(options: argparse.Namespace, tell: Tell) -> Answer:
    from pneugantry.thesis.variants import run_variants, variant_lines, variant_report

    fmu = _gantry()
    workers, draws = max(options.workers, 1), max(options.draws, 1)
    with _store(options, fmu) as store:
        found = run_variants(fmu.path, workers=workers, tell=tell, draws=draws, store=store)
    return variant_report(found), list(variant_lines(found)), 0


def _tuning(options: argparse.Namespace, tell: Tell) -> Answer:
    from pneugantry.thesis.tuning import run_tuning
    from pneugantry.thesis.tuning_report import draw_tuning, tuning_lines, tuning_report

    tuning = run_tuning(_gantry())
    lines = list(tuning_lines(tuning))
    if not options.no_figures:
        lines.append(f"{len(draw_tuning(tuning, options.out))} figures: {options.out}")
    return tuning_report(tuning), lines, 0


def _contents(options: argparse.Namespace, tell: Tell) -> Answer:
    from pneugantry.thesis.contents import contents_lines, contents_report

    return contents_report(), list(contents_lines()), 0
