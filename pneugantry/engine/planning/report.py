"""A plan as text, JSON (`plan/1`) and a page."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Sequence
from typing import Any

from pneugantry.engine.planning.information import SEEN, Sight
from pneugantry.engine.planning.plan import Addition, Plan
from pneugantry.engine.signals.units import with_unit

__all__ = ["as_html", "as_json", "as_text"]

SHOWN = 5  # experiments and sensors printed
HEADER = ("effect", "usual size", "seen from", "of usual", "sigma", "told", "nearest other")


def as_text(plan: Plan) -> Iterator[str]:
    """Lines for people."""
    case = plan.case
    yield (
        f"{case.plant.name}: {len(case.records)} logs, {len(case.plant.signals)} signals, "
        f"{len(plan.sights)} effects that some view shows, {plan.score:.1f} of them told at "
        "their usual size"
    )
    yield ""
    yield from _aligned([HEADER, *(_cells(plan, s) for s in _ordered(plan.sights))])
    yield ""
    yield f"seen from: smallest size at {SEEN:g} sigma; told: sigma left after the best imitation"
    for names, text in (
        (plan.unread, "nothing measured shows"),
        ([s.effect for s in plan.sights if s.sigma > 0 and not s.visible], "too small"),
        ([_shaped(plan, s) for s in plan.sights if s.sigma == 0], "without any trace by itself"),
    ):
        if names:
            yield f"{text}: {', '.join(names)}"
    for first, second in _pairs(plan):
        yield f"not told apart at the usual size: {first} and {second}"
    for title, found in _lists(plan):
        yield ""
        yield f"{title}:"
        yield from (f"  {_said(a)}" for a in found)
    yield from (f"note: {note}" for note in plan.notes)


def _shaped(plan: Plan, s: Sight) -> str:
    """An effect, and those without which it is nothing."""
    refined = plan.case.catalogue[s.effect].refines
    return f"{s.effect} (it shapes {' or '.join(refined)})" if refined else s.effect


def _ordered(found: Sequence[Sight]) -> list[Sight]:
    return sorted(found, key=lambda s: s.told)


def _cells(plan: Plan, s: Sight) -> tuple[str, ...]:
    size = plan.sizes[s.effect]
    smallest = f"{s.smallest * size.usual:.2g}"
    seen = with_unit(smallest, size.unit) if s.sigma > 0 else "never"
    share = f"{100 * s.smallest:.2g} %" if s.sigma > 0 else "-"
    rival = s.rival if s.rival is not None and s.own_share < 0.9 else ""
    usual = with_unit(f"{size.usual:.3g}", size.unit)
    return (s.effect, usual, seen, share, f"{s.sigma:.3g}", f"{s.told:.3g}", rival or "-")


def _aligned(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    widths = [max(len(r[i]) for r in rows) for i in range(len(rows[0]))]
    for row in rows:
        cells = [row[0].ljust(widths[0]), *map(str.rjust, row[1:-1], widths[1:-1]), row[-1]]
        yield "  ".join(cells).rstrip()


def _pairs(plan: Plan) -> list[tuple[str, str]]:
    """Effects that are seen, but not told apart: either can pass for the other."""
    pairs = {tuple(sorted((s.effect, other))) for s in plan.sights for other in s.rivals}
    return [(a, b) for a, b in sorted(pairs)]


def _lists(plan: Plan) -> list[tuple[str, tuple[Addition, ...]]]:
    titles = (
        ("what each log adds to the others", plan.logs),
        ("what a further experiment would add", plan.experiments[:SHOWN]),
        ("what a further sensor would add", plan.sensors[:SHOWN]),
    )
    return [(title, found) for title, found in titles if found]


def _said(a: Addition) -> str:
    more = f"{a.effects:+.2f} effects told, sizes {a.finer:.2f} times finer"
    if a.shows:
        more += f"; shows {', '.join(a.shows)}"
    if a.parts:
        more += f"; tells apart {', '.join(a.parts)}"
    sensor = f" (noise {a.sigma:.2g})" if a.sigma else ""
    return f"{a.what}{sensor}: {more}"


def as_json(plan: Plan) -> dict[str, Any]:
    """Schema plan/1."""
    return {
        "schema": "plan/1",
        "plant": plan.case.plant.name,
        "logs": [r.name for r in plan.case.records],
        "signals": [s.name for s in plan.case.plant.signals],
        "told": plan.score,
        "effects": [_effect(plan, s) for s in plan.sights],
        "unseen": list(plan.unread),
        "pairs": [list(pair) for pair in _pairs(plan)],
        "adds": {
            "logs": [_addition(a) for a in plan.logs],
            "experiments": [_addition(a) for a in plan.experiments],
            "sensors": [_addition(a) for a in plan.sensors],
        },
        "notes": list(plan.notes),
    }


def _effect(plan: Plan, s: Sight) -> dict[str, Any]:
    size = plan.sizes[s.effect]
    known = math.isfinite(s.smallest)
    return {
        "effect": s.effect,
        "block": plan.case.catalogue[s.effect].block,
        "parameter": size.parameter,
        "unit": size.unit,
        "usual": size.usual,
        "smallest": s.smallest * size.usual if known else None,
        "smallest_share": s.smallest if known else None,
        "sigma": s.sigma,
        "visible": s.visible,
        "told": s.told,
        "own_share": s.own_share,
        "rival": s.rival,
        "not_told_from": list(s.rivals),
        "seen_by": [{"view": v, "log": r, "share": share} for v, r, share in s.seen_by],
    }


def _addition(a: Addition) -> dict[str, Any]:
    told = {"what": a.what, "effects": a.effects, "finer": a.finer}
    told |= {"shows": list(a.shows), "tells_apart": list(a.parts)}
    if a.scenario:
        told["scenario"] = a.scenario
    if a.sigma:
        told["sigma"] = a.sigma
    return told


PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>body{{font:15px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em}}
table{{border-collapse:collapse}}td,th{{padding:.2em .8em;border-bottom:1px solid #ccc;
text-align:right}}td:first-child,th:first-child,td:last-child{{text-align:left}}</style></head>
<body><h1>{title}</h1><p>{intro}</p><table>{rows}</table>{rest}</body></html>
"""


def as_html(plan: Plan) -> str:
    """One page that needs no other file."""
    lines = list(as_text(plan))
    cells = [_cells(plan, s) for s in _ordered(plan.sights)]
    rows = [_row("th", HEADER), *(_row("td", c) for c in cells)]
    rest = lines[2 + len(rows) :]
    return PAGE.format(
        title=html.escape(f"What these logs can tell: {plan.case.plant.name}"),
        intro=html.escape(lines[0]),
        rows="".join(rows),
        rest="".join(f"<p>{html.escape(line)}</p>" for line in rest if line),
    )


def _row(tag: str, cells: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{html.escape(c)}</{tag}>' for c in cells)}</tr>"
