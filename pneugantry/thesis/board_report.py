"""The leaderboard over structures as JSON and lines."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from statistics import median
from typing import Any

from pneugantry.analysis.command_loop import FACTORS
from pneugantry.thesis.entrants import ROBUST
from pneugantry.thesis.loop_limits import HIGHEST_GAIN, LONGEST
from pneugantry.thesis.structure_board import (
    LIMIT,
    NOMINAL_LIMIT,
    PI_LIMIT,
    BoardRow,
    StructureBoard,
)
from pneugantry.thesis.structures import NOMINAL

__all__ = ["board_lines", "board_report"]

FAMILIES = ("friction", "valve", "contact", "sensors", "catalogue", "beyond")


def board_report(board: StructureBoard) -> dict[str, Any]:
    """The JSON, `thesis_board/1`; infinite margins are null: none was found up to `searched_to`
    (delay None: at any).
    """
    asked = board.asked()
    return {
        "schema": "thesis_board/1",
        "limits": {"structure": LIMIT, "nominal": NOMINAL_LIMIT, "where_pi_below": PI_LIMIT},
        "met": board.met,
        "missed": {n: r for n, (_, r) in asked.items() if r > LIMIT},
        "searched_to": {
            "linear": {"gain": float(FACTORS[-1]), "delay": None},
            "cosimulated": {"gain": HIGHEST_GAIN, "delay": LONGEST},
        },
        "structures": {s.name: s.family for s in board.structures},
        "rows": [_row(row) for row in board.rows],
    }


def _row(row: BoardRow) -> dict[str, Any]:
    linear = None if row.linear is None else _finite(asdict(row.linear))
    return {
        "controller": row.name,
        "median": row.median,
        "worst": row.worst[1],
        "worst_on": row.worst[0],
        "nominal": row.outcomes[NOMINAL.name].rmse_fn,
        "command_noise": row.noise,
        "share_at_limits": row.limits,
        "drawn_plants": {"median": median(row.drawn), "worst": max(row.drawn)}
        if row.drawn
        else None,
        "margins_linear": linear,
        "margins_cosimulated": None if row.found is None else _finite(asdict(row.found)),
        "outcomes": {name: asdict(outcome) for name, outcome in row.outcomes.items()},
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {n: None if isinstance(v, float) and math.isinf(v) else v for n, v in values.items()}


def board_lines(board: StructureBoard) -> Iterator[str]:
    """Rows best median first."""
    count = len(board.structures)
    yield (
        f"Leaderboard over {count} structures: RMSE f_n [N], the worse of straight and curved; "
        "command noise [V]; largest share of the time at a valve's limit"
    )
    yield (
        f"  {'controller':<24}{'nominal':>8}{'median':>8}{'worst':>8} {'on':<34}{'noise':>7}"
        f"{'limits':>8}{'drawn':>14}"
    )
    for row in board.rows:
        drawn = f"{median(row.drawn):.2f} ({max(row.drawn):.2f})" if row.drawn else ""
        yield (
            f"  {row.name:<24}{row.outcomes[NOMINAL.name].rmse_fn:>8.2f}{row.median:>8.2f}"
            f"{row.worst[1]:>8.2f} {row.worst[0]:<34}{row.noise:>7.3f}{row.limits:>8.0%}{drawn:>14}"
        )
    yield from _family_lines(board)
    if any(row.found is not None for row in board.rows):
        yield from _margin_lines(board)
    yield from _asked_lines(board)


def _family_lines(board: StructureBoard) -> Iterator[str]:
    yield "\nWorst in each family of structures, RMSE f_n [N]"
    yield f"  {'controller':<24}" + "".join(f"{family:>11}" for family in FAMILIES)
    for row in board.rows:
        worst = [
            max(row.of([s for s in board.structures if s.family == family]), default=float("nan"))
            for family in FAMILIES
        ]
        yield f"  {row.name:<24}" + "".join(f"{value:>11.2f}" for value in worst)


def _margin_lines(board: StructureBoard) -> Iterator[str]:
    yield (
        "\nMargins of the z loop on the thesis' plant: gain, delay [ms], smallest |1 + L| from "
        "python-control; gain, delay from co-simulation, searched up to "
        f"{HIGHEST_GAIN:g} and {1e3 * LONGEST:g} ms"
    )
    for row in board.rows:
        if row.found is None:
            continue
        linear = "   arrays: no linear model   "
        if row.linear is not None:
            m = row.linear
            linear = f"{m.gain:>9.2f}{1e3 * m.delay:>10.1f}{m.modulus:>9.2f} "
        yield f"  {row.name:<24}{linear}   {row.found.gain:>9.2f}{1e3 * row.found.delay:>10.1f}"


def _asked_lines(board: StructureBoard) -> Iterator[str]:
    asked = board.asked()
    yield f"\nAsked of {ROBUST}: {LIMIT:g} N wherever the thesis' PI stays below {PI_LIMIT:g} N"
    worst = sorted(asked.items(), key=lambda item: -item[1][1])[:8]
    for name, (pi, robust) in worst:
        missed = " MISSED" if robust > LIMIT else ""
        yield f"  {name:<34} PI {pi:.2f}, {ROBUST} {robust:.2f}{missed}"
    lost = sum(r > LIMIT for _, r in asked.values())
    nominal = board.row(ROBUST).outcomes[NOMINAL.name].rmse_fn
    yield (
        f"  {len(asked) - lost} of {len(asked)} structures within {LIMIT:g} N; nominal "
        f"{nominal:.2f} N of {NOMINAL_LIMIT:g} N: {'met' if board.met else 'NOT MET'}"
    )
