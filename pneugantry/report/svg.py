"""The parts of an inline SVG: numbers, words and the frame, in the colours of the style sheet."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

__all__ = ["INK", "LINE", "QUIET", "number", "svg", "text"]

INK, LINE, QUIET = "var(--ink)", "var(--line)", "var(--quiet)"  # of the style sheet: light, dark


def number(value: float) -> str:
    """To a tenth, without idle zeros."""
    return f"{value:.1f}".rstrip("0").rstrip(".")


def text(
    at: tuple[float, float],
    words: str,
    anchor: str = "middle",
    size: float = 12,
    weight: str = "400",
    fill: str = INK,
) -> str:
    """Words at (x, y), escaped."""
    return (
        f'<text x="{number(at[0])}" y="{number(at[1])}" text-anchor="{anchor}" '
        f'font-size="{number(size)}" font-weight="{weight}" '
        f'fill="{fill}">{escape(words)}</text>'
    )


def svg(size: tuple[float, float], body: Iterable[str], label: str, kind: str) -> str:
    """A picture of a width and height; label: what it shows, for those who cannot see it; kind: its
    classes in the style sheet.
    """
    head = (
        f'<svg class="{kind}" viewBox="0 0 {number(size[0])} {number(size[1])}" '
        f'role="img" aria-label="{escape(label, quote=True)}">'
    )
    return head + "".join(body) + "</svg>"
