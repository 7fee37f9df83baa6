"""The missing term that was learnt, as the page shows it: the curve with its 95 % band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pneugantry.report.pictures import CURVES, ticks
from pneugantry.report.svg import INK, QUIET, svg, text

__all__ = ["term_svg"]

WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 460, 220, 62, 24, 40
FAINT = 0.18  # opacity of the band


def term_svg(term: Mapping[str, Any]) -> str:
    """A term over its variable, as `learned.term` of gap/1 has it: the curve, and between which
    values 95 % of it lie.
    """
    curve = term["curve"]
    at, low, high = curve["at"], curve["low"], curve["high"]
    span = (at[0], at[-1] if at[-1] > at[0] else at[0] + 1.0)
    bottom, top = min(low), max(high)
    pad = 0.06 * (top - bottom) or 1.0
    bottom, top = bottom - pad, top + pad

    def x(value: float) -> float:
        return LEFT + (WIDTH - LEFT - 10) * (value - span[0]) / (span[1] - span[0])

    def y(value: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (top - value) / (top - bottom)

    def points(values: Sequence[float], order: Sequence[float]) -> str:
        return " ".join(f"{x(a):.1f},{y(v):.1f}" for a, v in zip(order, values, strict=True))

    body = []
    for tick in ticks(bottom, top, 5):
        body.append(f'<path d="M{LEFT} {y(tick):.1f}H{WIDTH - 10}" stroke="{QUIET}"/>')
        body.append(text((LEFT - 6, y(tick) + 4), f"{tick:.4g}", "end", 10.5))
    body += [
        text((x(tick), HEIGHT - BOTTOM + 15), f"{tick:.4g}", size=10.5) for tick in ticks(*span)
    ]
    colour = CURVES["augmented"][0]
    band = f"{points(low, at)} {points(high[::-1], at[::-1])}"
    body.append(f'<polygon points="{band}" fill="{colour}" opacity="{FAINT}"/>')
    line = points(curve["value"], at)
    body.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
    units = term["units"]
    body.append(
        text(((LEFT + WIDTH) / 2, HEIGHT - 8), _of(term["regressor"], units["regressor"]), fill=INK)
    )
    body.append(text((LEFT, TOP - 4), _of("added", units["term"]), "start", 10.5))
    label = f"The term {term['formula']} over {term['regressor']}, with its 95 % band"
    return svg((WIDTH, HEIGHT), body, label, "picture gap")


def _of(name: str, unit: str) -> str:
    """As an axis is labelled; a unit that is not declared is left out."""
    return f"{name} [{unit}]" if unit else name
