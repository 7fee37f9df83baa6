"""`pneugantry thesis`."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pneugantry.commands.options import out_folder
from pneugantry.thesis.conclusions import Conclusion
from pneugantry.thesis.conditions import CHOICE
from pneugantry.thesis.leaderboard import NEW, Robustness, Row
from pneugantry.thesis.printed import WORKPIECES
from pneugantry.thesis.study import Study, run_study
from pneugantry.thesis.tables import Cell, met_share
from pyfmi_runner.build import build_fmu

HELP = """Run every table and conclusion of the thesis: ours beside the printed, which conclusion holds, and the leaderboard.

  pneugantry thesis                       tables and figures in out/thesis
  pneugantry thesis --json out/thesis.json
  pneugantry thesis --plants 0            without the table over drawn plants

What the thesis does not print was chosen once for all tables: docs/thesis.md."""


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
        "--workers", metavar="N", type=int, default=2, help="processes (default 2)"
    )
    command.add_argument("--no-figures", action="store_true", help="numbers only")


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    started = time.perf_counter()
    shown = tqdm(
        total=None,
        desc="thesis",
        delay=1.0,
        leave=False,
        disable=not sys.stderr.isatty(),
        unit="job",
    )

    def tell(done: int, total: int) -> None:
        shown.total = total
        shown.update(done - shown.n)

    study = run_study(
        build_fmu().path, workers=max(options.workers, 1), tell=tell, plants=max(options.plants, 0)
    )
    shown.close()
    print_study(study)
    if not options.no_figures:
        from pneugantry.thesis.figures import (
            draw_figures,
        )  # matplotlib loads only when something is drawn

        print(f"{len(draw_figures(study, options.out))} figures: {options.out}")
    held = sum(c.holds for c in study.conclusions)
    share = met_share(study.cells)
    print(
        f"{held} of {len(study.conclusions)} conclusions hold, {share:.0%} of the "
        f"printed simulation cells met within 25 %"
        f"  ({time.perf_counter() - started:.0f} s)"
    )
    return report(study), 0


def report(study: Study) -> dict[str, Any]:
    """The JSON."""
    return {
        "schema": "thesis/1",
        "conclusions": [
            {"id": c.id, "text": c.text, "holds": c.holds, "numbers": c.numbers, "reason": c.reason}
            for c in study.conclusions
        ],
        "cells": [{**asdict(cell), "met": cell.met} for cell in study.cells],
        "met_share": met_share(study.cells),
        "leaderboard": [_board_line(row) for row in study.board],
        "robustness": [_robustness_line(found, study.neural) for found in study.robustness],
        "anfis": {"rmse_anfis": study.anfis.rmse_anfis, "rmse_ddfm": study.anfis.rmse_ddfm},
        "chosen": asdict(CHOICE),
    }


def _conclusion_line(c: Conclusion) -> dict[str, Any]:
    return {"id": c.id, "text": c.text, "holds": c.holds, "numbers": c.numbers, "reason": c.reason}


def _board_line(row: Row) -> dict[str, Any]:
    scores = {edge: scores._asdict() for edge, scores in row.scores.items()}
    return {"controller": row.controller, "us_per_step": row.us_per_step, **scores}


def _robustness_line(found: Robustness, neural: str) -> dict[str, Any]:
    counts = {"plants": len(found.new), "ahead": found.ahead}
    return {
        "edge": found.edge,
        "new": NEW,
        "neural": neural,
        **counts,
        "rmse_fn_new": found.new,
        "rmse_fn_neural": found.neural,
    }


def print_study(study: Study) -> None:
    tables: dict[str, list[Cell]] = {}
    for cell in study.cells:
        tables.setdefault(cell.table, []).append(cell)
    for table, cells in tables.items():
        _print_table(table, cells)
    print("\nConclusions")
    for c in study.conclusions:
        numbers = ", ".join(f"{name} {value:.3g}" for name, value in c.numbers.items())
        print(f"  {c.id:2d} {'holds' if c.holds else 'DOES NOT HOLD'}: {c.text}\n     {numbers}")
        if c.reason:
            print(f"     why not: {c.reason}")
    _print_board(study)


def _print_table(table: str, cells: list[Cell]) -> None:
    print(
        f"\nTable {table} "
        f"({cells[0].kind}{'' if len({c.kind for c in cells}) == 1 else ' and others'}): "
        f"ours / printed, * within 25 %"
    )
    rows: dict[str, list[Cell]] = {}
    for cell in cells:
        rows.setdefault(cell.row, []).append(cell)
    for row, found in rows.items():
        texts = [f"{c.column} {c.ours:.3g} / {c.printed:.3g}{'*' if c.met else ' '}" for c in found]
        print(f"  {row:<28}" + "".join(f"{text:<30}" for text in texts))


def _print_board(study: Study) -> None:
    print("\nLeaderboard: RMSE f_n [N] (ME), RMSE v_t [m/s] (ME)")
    print(f"  {'controller':<18}{'us/step':>8}  " + "".join(f"{edge:<30}" for edge in WORKPIECES))
    for row in study.board:
        texts = [
            f"{s.rmse_fn:.2f} ({s.me_fn:.1f})  {s.rmse_vt:.3f} ({s.me_vt:.3f})"
            for s in row.scores.values()
        ]
        print(
            f"  {row.controller:<18}{row.us_per_step:>8.3f}  "
            + "".join(f"{text:<30}" for text in texts)
        )
    for r in study.robustness:
        if len(r.new) == 0:
            continue
        print(
            f"\n{len(r.new)} plants, every parameter within 20 %, {r.edge} edge, RMSE "
            f"f_n [N]: median (worst)"
        )
        print(
            f"  {NEW} {sorted(r.new)[len(r.new) // 2]:.2f} ({max(r.new):.2f}), "
            f"{study.neural} {sorted(r.neural)[len(r.neural) // 2]:.2f} "
            f"({max(r.neural):.2f}); {NEW} ahead on {r.ahead} of {len(r.new)}"
        )
