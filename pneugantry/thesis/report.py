"""What `pneugantry thesis` writes: its JSON, its lines on the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from pneugantry.thesis.conditions import CHOICE, SOFT
from pneugantry.thesis.leaderboard import NEW, Robustness, Row
from pneugantry.thesis.printed import WORKPIECES
from pneugantry.thesis.study import Study
from pneugantry.thesis.tables import Cell, met_share, unique_cells
from pneugantry.thesis.verdicts import Range, Share, Verdict

__all__ = ["report", "study_lines"]


def report(study: Study) -> dict[str, Any]:
    """The JSON."""
    return {
        "schema": "thesis/1",
        "conclusions": [_verdict(v) for v in study.verdicts],
        "cells": [{**asdict(cell), "met": cell.met} for cell in study.cells],
        "unique_cells": len(unique_cells(study.cells)),
        "met_share": met_share(study.cells),
        "met_shares": {
            group: {name: asdict(value) for name, value in kinds.items()}
            for group, kinds in study.shares.items()
        },
        "findings": [asdict(finding) for finding in study.findings],
        "leaderboard": [_board_line(row) for row in study.board],
        "robustness": [_robustness(found, study.neural) for found in study.robustness],
        "anfis": {
            "rmse_anfis": study.plant.anfis.rmse_anfis,
            "rmse_ddfm": study.plant.anfis.rmse_ddfm,
        },
        "lags": study.plant.lags,
        "chosen": asdict(CHOICE),
        "contacts": {"K_c 5e4": asdict(CHOICE), "K_c 1e4": asdict(SOFT)},
    }


def _verdict(v: Verdict) -> dict[str, Any]:
    return {
        "id": v.id,
        "text": v.text,
        "check": v.check,
        "holds": v.holds,
        "fitted": v.fitted,
        "groups": {
            group: {"held": share.held, "of": share.of, "ci95": share.interval}
            for group, share in v.groups.items()
        },
        "numbers": {name: value.mean for name, value in v.numbers.items()},
        "ranges": {name: (value.low, value.high) for name, value in v.numbers.items()},
        "reason": v.reason,
    }


def _board_line(row: Row) -> dict[str, Any]:
    scores = {edge: scores._asdict() for edge, scores in row.scores.items()}
    return {"controller": row.controller, "us_per_step": row.us_per_step, **scores}


def _robustness(found: Robustness, neural: str) -> dict[str, Any]:
    return {
        "edge": found.edge,
        "new": NEW,
        "neural": neural,
        "plants": len(found.new),
        "ahead": found.ahead,
        "rmse_fn_new": found.new,
        "rmse_fn_neural": found.neural,
    }


def study_lines(study: Study) -> Iterator[str]:
    """What the terminal shows."""
    tables: dict[str, list[Cell]] = {}
    for cell in study.cells:
        tables.setdefault(cell.table, []).append(cell)
    for table, cells in tables.items():
        yield from _table_lines(table, cells)
    yield from _share_lines(study)
    yield from _verdict_lines(study.verdicts)
    yield "\nFindings"
    for finding in study.findings:
        yield f"  {finding.name}: {finding.text}"
        yield from (f"      {name}: {value:.3g}" for name, value in finding.numbers.items())
    yield from _board_lines(study)


def _table_lines(table: str, cells: list[Cell]) -> Iterator[str]:
    kinds = {c.kind for c in cells}
    kind = f"{cells[0].kind}{'' if len(kinds) == 1 else ' and others'}"
    yield f"\nTable {table} ({kind}): ours / printed, * within 25 %, (..) printed before"
    rows: dict[str, list[Cell]] = {}
    for cell in cells:
        rows.setdefault(cell.row, []).append(cell)
    for row, found in rows.items():
        texts = [_cell_text(cell) for cell in found]
        yield f"  {row:<28}" + "".join(f"{text:<32}" for text in texts)


def _cell_text(c: Cell) -> str:
    text = f"{c.column} {c.ours:.3g} / {c.printed:.3g}{'*' if c.met else ' '}"
    return f"({text})" if c.repeat_of else text


def _share_lines(study: Study) -> Iterator[str]:
    once = unique_cells(study.cells)
    met = sum(cell.met for cell in once)
    yield "\nShare of the printed simulation numbers, each once, that are met within 25 %"
    yield f"  fitted setting: {met} of {len(once)} = {met / len(once):.0%}"
    for group, kinds in study.shares.items():
        plain, rounded = kinds["met"], kinds["met in print"]
        yield f"  {group:<30} {_percent(plain)}; allowing for the print's rounding "
        yield f"  {'':<30} {_percent(rounded)}"


def _percent(value: Range) -> str:
    return f"mean {value.mean:.0%}, range {value.low:.0%} to {value.high:.0%}"


def _verdict_lines(verdicts: list[Verdict]) -> Iterator[str]:
    yield "\nConclusions: held in how many settings (95 % interval); numbers: mean (range)"
    for v in verdicts:
        yield f"  {v.id:2d} {'holds' if v.holds else 'DOES NOT HOLD'}: {v.text}"
        yield f"     check: {v.check}"
        fitted = "" if v.fitted is None else f"fitted {'yes' if v.fitted else 'no'}; "
        groups = "; ".join(share_text(group, share) for group, share in v.groups.items())
        yield f"     {fitted}{groups}"
        numbers = (
            f"{name} {n.mean:.3g} ({n.low:.3g}..{n.high:.3g})" for name, n in v.numbers.items()
        )
        yield "     " + ", ".join(numbers)
        if v.reason:
            yield f"     why not: {v.reason}"


def share_text(group: str, share: Share) -> str:
    """In words; one setting has no interval worth printing."""
    if share.of == 1:
        return f"{group}: {'yes' if share.held else 'no'}"
    low, high = share.interval
    return f"{group} {share.held} of {share.of} ({low:.0%}-{high:.0%})"


def _board_lines(study: Study) -> Iterator[str]:
    yield "\nLeaderboard: RMSE f_n [N] (ME), RMSE v_t [m/s] (ME)"
    head = "".join(f"{edge:<30}" for edge in WORKPIECES)
    yield f"  {'controller':<22}{'us/step':>8}  {head}"
    for row in study.board:
        texts = [
            f"{s.rmse_fn:.2f} ({s.me_fn:.1f})  {s.rmse_vt:.3f} ({s.me_vt:.3f})"
            for s in row.scores.values()
        ]
        line = "".join(f"{text:<30}" for text in texts)
        yield f"  {row.controller:<22}{row.us_per_step:>8.3f}  {line}"
    for r in study.robustness:
        if len(r.new):
            yield (
                f"\n{len(r.new)} plants, every parameter within 20 %, {r.edge} edge, RMSE f_n [N]: "
                f"median (worst)"
            )
            yield (
                f"  {NEW} {sorted(r.new)[len(r.new) // 2]:.2f} ({max(r.new):.2f}), "
                f"{study.neural} {sorted(r.neural)[len(r.neural) // 2]:.2f} "
                f"({max(r.neural):.2f}); {NEW} ahead on {r.ahead} of {len(r.new)}"
            )
