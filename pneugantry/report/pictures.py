"""Pictures of the page as inline SVG: gaps by signal, signals over time, residuals over time; and
the signals' data for zooming.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pneugantry.report.svg import INK, LINE, QUIET, svg, text

__all__ = [
    "CURVES",
    "SAMPLES",
    "Curves",
    "Phase",
    "Shown",
    "gap_svg",
    "packed",
    "panel_svg",
    "strip_svg",
    "ticks",
]

Array = NDArray[np.float64]
Phase = tuple[str, float, float]  # name, start and end in s
CURVES = {
    "measured": ("var(--measured)", 2.4, ""),
    "nominal": ("var(--orange)", 1.3, "5 3"),
    "augmented": ("var(--blue)", 1.3, ""),
}  # colour, width, dashes
SAMPLES = 20_000  # per curve in the page; longer records are thinned
STATIC = 240  # bins of the static picture
MISSING = 65535
PANEL = {"width": 520, "height": 168, "left": 52, "right": 8, "top": 30, "bottom": 30}
DISPLAY = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}  # unit on the page, factor
BINS = 80  # of a record, over which a residual's RMS is taken
LEVELS = (1.5, 2.5, 5.0, 10.0, 25.0)  # RMS in units of the noise, from which on a cell is darker
STRIP = {"width": 760, "row": 22, "top": 22, "gap": 3}
LETTER = 6.8  # width of a letter of 12 px, roughly


@dataclass(frozen=True)
class Shown:
    """A signal as the page shows it."""

    name: str
    unit: str  # on the page
    factor: float  # from the unit of the record
    sigma: float  # in the unit of the page

    @classmethod
    def of(cls, name: str, unit: str, sigma: float) -> Shown:
        """From the unit of the record."""
        shown, factor = DISPLAY.get(unit, (unit, 1.0))
        return cls(name, shown, factor, sigma * factor)


@dataclass(frozen=True, eq=False)
class Curves:
    """One record's signals."""

    signals: tuple[Shown, ...]
    period: float  # s
    values: Mapping[str, Array]  # "measured", "nominal", ...: (rows, signals), the record's units

    def __post_init__(self) -> None:
        """Raises ValueError where the curves have not the same rows and signals."""
        shapes = {name: v.shape for name, v in self.values.items()}
        if len(set(shapes.values())) > 1:
            raise ValueError(f"curves of one record need one shape, got {shapes}")

    @property
    def rows(self) -> int:
        return len(next(iter(self.values.values())))

    @property
    def end(self) -> float:
        """Time of the last row, s."""
        return (self.rows - 1) * self.period


# ---------------------------------------------------------------- how far


def gap_svg(rows: Sequence[tuple[str, float, float]], floor: float, after: str) -> str:
    """Gap before (ring) and after (disc) per signal on a logarithmic axis, the floor as a line.
    rows: name, nominal, augmented.
    """
    values = [v for _, *pair in rows for v in pair if math.isfinite(v) and v > 0] + [floor]
    low, high = math.log10(min(values) / 1.25), math.log10(max(max(values) * 1.25, 3.0 * floor))
    longest = max((len(name) for name, _, _ in rows), default=0)
    left, width, row, top = max(58.0, 16 + LETTER * longest), 400, 23, 30
    bottom = top + row * len(rows)

    def at(value: float) -> float:
        return left + width * (math.log10(max(value, 10**low)) - low) / (high - low)

    body = [text((at(floor), top - 14), f"floor {floor:.3g}", size=11)]
    for tick in _decades(low, high):
        body.append(f'<path d="M{at(tick):.1f} {top}V{bottom}" stroke="{QUIET}"/>')
        body.append(text((at(tick), bottom + 15), f"{tick:g}", size=11))
    body.append(
        f'<path d="M{at(floor):.1f} {top - 8}V{bottom}" stroke="{INK}" '
        f'stroke-dasharray="2 3" stroke-width="1.5"/>'
    )
    for i, (name, nominal, augmented) in enumerate(rows):
        y = top + row * (i + 0.5)
        body.append(text((left - 8, y + 4), name, "end", weight="700" if name == "all" else "400"))
        if not (math.isfinite(nominal) and math.isfinite(augmented)):
            body.append(text((left + 6, y + 4), "not known", "start", size=11))
            continue
        body += _change((at(nominal), at(augmented)), y, augmented <= nominal)
    axis = "gap = RMS of (measured − simulated)/σ  [1], logarithmic"
    body.append(text((left + width / 2, bottom + 32), axis, size=11))
    label = f"Gap by signal: ring nominal, disc {after}, dotted line floor"
    return svg((left + width + 14, bottom + 40), body, label, "picture gap")


def _decades(low: float, high: float) -> list[float]:
    """1, 2, 5 times powers of ten within 10^low .. 10^high, thinned where there are many."""
    digits = (1, 2, 5) if high - low < 2 else (1, 3) if high - low < 4 else (1,)
    found = [d * 10.0**e for e in range(math.floor(low), math.ceil(high) + 1) for d in digits]
    return [t for t in found if low <= math.log10(t) <= high]


def _change(ends: tuple[float, float], y: float, better: bool) -> list[str]:
    """Ring, disc and the way between them."""
    colour = CURVES["augmented" if better else "nominal"][0]
    return [
        f'<path d="M{ends[0]:.1f} {y}H{ends[1]:.1f}" stroke="{colour}" '
        f'stroke-width="6" opacity=".35"/>',
        f'<circle cx="{ends[0]:.1f}" cy="{y}" r="5" fill="var(--paper)" '
        f'stroke="{CURVES["nominal"][0]}" stroke-width="2"/>',
        f'<circle cx="{ends[1]:.1f}" cy="{y}" r="4.5" fill="{CURVES["augmented"][0]}"/>',
    ]


# ---------------------------------------------------------------- signals


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Round values within [low, high], about `most` of them."""
    if not high > low:
        return [low]
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * f for f in (1, 2, 5, 10) if power * f >= raw * 0.999)
    return [
        step * k for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    ]


def _extremes(values: Array, bins: int) -> tuple[Array, Array]:
    """(index, value) of each bin's smallest and largest sample, in order of time; samples that are
    not finite are left out.
    """
    index: list[int] = []
    edges = np.linspace(0, len(values), min(bins, max(len(values), 1)) + 1).astype(int)
    for first, last in pairwise(edges):
        rows = first + np.flatnonzero(np.isfinite(values[first:last]))
        if len(rows):
            index += sorted(
                {int(rows[np.argmin(values[rows])]), int(rows[np.argmax(values[rows])])}
            )
    chosen = np.array(index, dtype=int)
    return chosen.astype(float), values[chosen]


def panel_svg(curves: Curves, i: int, phases: Sequence[Phase]) -> str:
    """One signal over time, thinned: the picture that stands where there is no JavaScript."""
    signal, p, end = curves.signals[i], PANEL, max(curves.end, 1e-9)
    own = {name: v[:, i] * signal.factor for name, v in curves.values.items()}
    low, high = _range(own)
    width, height = p["width"] - p["left"] - p["right"], p["height"] - p["top"] - p["bottom"]
    base = p["top"] + height

    def x(t: float) -> float:
        return p["left"] + width * t / end

    def y(value: float) -> float:
        return p["top"] + height * (high - value) / (high - low)

    body = []
    for name, start, _ in phases:
        if 0 <= start < end:
            body.append(
                f'<path d="M{x(start):.1f} {p["top"]}V{base}" stroke="{QUIET}" '
                f'stroke-dasharray="2 2"/>'
            )
            body.append(text((x(start), p["top"] - 4), name, "start", 9, fill=LINE))
    for tick in ticks(low, high, 4):
        body.append(
            f'<path d="M{p["left"]} {y(tick):.1f}H{p["left"] + width}" stroke="{QUIET}" '
            f'stroke-width=".6"/>'
        )
        body.append(text((p["left"] - 5, y(tick) + 4), f"{tick:.6g}", "end", 10.5))
    body += [text((x(t), base + 13), f"{t:.6g}", size=10.5) for t in ticks(0.0, end, 8)]
    body.append(text((p["left"] + width, base + 26), "time [s]", "end", 10.5))
    title = f"{signal.name} [{signal.unit}]"
    body.append(text((p["left"], p["top"] - 17), title, "start", 11.5, "600"))
    for name, values in own.items():
        colour, thick, dashes = CURVES[name]
        index, extremes = _extremes(values, STATIC)
        places = index * curves.period
        points = " ".join(f"{x(t):.0f},{y(v):.1f}" for t, v in zip(places, extremes, strict=True))
        dash = f' stroke-dasharray="{dashes}"' if dashes else ""
        body.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" '
            f'stroke-width="{thick}"{dash} stroke-linejoin="round"/>'
        )
    body.append(
        f'<rect x="{p["left"]}" y="{p["top"]}" width="{width}" height="{height}" '
        f'fill="none" stroke="{QUIET}"/>'
    )
    label = f"{signal.name} over time: {', '.join(own)}"
    return svg((p["width"], p["height"]), body, label, "picture panel")


def _range(curves: Mapping[str, Array]) -> tuple[float, float]:
    """Ends of the axis of some curves."""
    finite = np.concatenate([c[np.isfinite(c)] for c in curves.values()])
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    pad = 0.05 * (high - low) or 1.0
    return low - pad, high + pad


def packed(curves: Curves, phases: Sequence[Phase], samples: int = SAMPLES) -> dict[str, Any]:
    """The curves for the page's script: 16 bits a sample, every sample up to `samples` a curve,
    beyond that bins' extremes.
    """
    # samples a bin; a bin gives two points
    step = 1 if curves.rows <= samples else 2 * math.ceil(curves.rows / samples)
    channels = []
    for i, signal in enumerate(curves.signals):
        columns = {n: _thinned(v[:, i] * signal.factor, step) for n, v in curves.values.items()}
        low, scale = _coded(columns.values())
        channels.append(
            {
                "name": signal.name,
                "unit": signal.unit,
                "sigma": signal.sigma,
                "low": low,
                "scale": scale,
                "data": {name: _base64(column, low, scale) for name, column in columns.items()},
                "difference": {} if step == 1 else _differences(curves, i, step),
            }
        )
    styles = {
        name: {"colour": colour, "width": width, "dashes": [float(d) for d in dashes.split()]}
        for name, (colour, width, dashes) in CURVES.items()
    }
    return {
        "t0": 0.0,
        "dt": curves.period * (1 if step == 1 else step / 2),
        "full": step == 1,
        "channels": channels,
        "phases": [list(p) for p in phases],
        "panel": PANEL,
        "curves": {name: styles[name] for name in curves.values},
    }


def _coded(columns: Iterable[Array]) -> tuple[float, float]:
    """Smallest value of some columns, and the step of 16 bits that holds them all."""
    finite = np.concatenate([c[np.isfinite(c)] for c in columns])
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    return low, (high - low) / (MISSING - 1) or 1.0


def _differences(curves: Curves, i: int, step: int) -> dict[str, dict[str, Any]]:
    """(measured - model)/sigma of signal i by model, for a record whose rows are thinned: extremes
    of two curves cannot be subtracted.
    """
    found = {}
    signal, measured = curves.signals[i], curves.values["measured"]
    for name, values in curves.values.items():
        if name == "measured":
            continue
        off = (measured[:, i] - values[:, i]) * signal.factor / signal.sigma
        column = _thinned(off, step)
        low, scale = _coded([column])
        found[name] = {"low": low, "scale": scale, "data": _base64(column, low, scale)}
    return found


def _thinned(values: Array, step: int) -> Array:
    """Smallest and largest of each bin of `step` samples, in order of time; a last bin that is not
    full repeats its last sample.
    """
    if step == 1:
        return values
    bins = np.append(values, np.full(-len(values) % step, values[-1])).reshape(-1, step)
    first_low = np.argmin(np.where(np.isfinite(bins), bins, np.inf), axis=1) <= np.argmax(
        np.where(np.isfinite(bins), bins, -np.inf), axis=1
    )
    low, high = bins.min(axis=1), bins.max(axis=1)
    return np.column_stack([np.where(first_low, low, high), np.where(first_low, high, low)]).ravel()


def _base64(values: Array, low: float, scale: float) -> str:
    raw = np.where(
        np.isfinite(values),
        np.round((np.nan_to_num(values, nan=low, posinf=low, neginf=low) - low) / scale),
        MISSING,
    )
    return base64.b64encode(raw.astype("<u2").tobytes()).decode("ascii")


# ---------------------------------------------------------------- residuals over time


def strip_svg(
    rows: Mapping[str, tuple[Array, Array]], end: float, phases: Sequence[Phase], label: str
) -> str:
    """Residuals over time: upper half of a row the nominal plant, lower half the fitted one; the
    darker, the larger, in classes of the style sheet.

    rows: by name, two residuals (N,) in units of the noise, NaN where nothing counts; end: s.
    """
    s = STRIP
    left = max(60.0, 14 + LETTER * max((len(name) for name in rows), default=0))
    height = s["top"] + (s["row"] + s["gap"]) * len(rows) + 20
    body = [
        f'<text x="{left + s["width"] * t / end:.0f}" y="12" class="phase">{escape(name)}</text>'
        for name, t, _ in phases
        if 0 <= t < end
    ]
    for i, (name, pair) in enumerate(rows.items()):
        y = s["top"] + i * (s["row"] + s["gap"])
        body.append(f'<text x="{left - 6:.0f}" y="{y + 15}" class="name">{escape(name)}</text>')
        for k, residual in enumerate(pair):
            body += _cells(_binned(residual), (left, y + k * s["row"] // 2), s["row"] // 2)
    body += [
        f'<text x="{left + s["width"] * k / 4:.0f}" y="{height - 4}" class="tick">'
        f"{end * k / 4:.3g} s</text>"
        for k in range(5)
    ]
    return svg((left + s["width"] + 24, height), body, label, "strip")


def _binned(residual: Array) -> Array:
    """RMS over BINS stretches of time; NaN where nothing is judged."""
    edges = np.linspace(0, len(residual), BINS + 1).astype(int)
    result = np.full(BINS, np.nan)
    for i, (first, last) in enumerate(pairwise(edges)):
        part = residual[first:last]
        part = part[np.isfinite(part)]
        if part.size:
            result[i] = np.sqrt(np.mean(part**2))
    return result


def _cells(values: Array, at: tuple[float, float], height: int) -> list[str]:
    """One rectangle for each stretch of a class."""
    classes = [-1 if np.isnan(v) else int(np.searchsorted(LEVELS, v)) for v in values]
    edges = [0, *(i for i in range(1, BINS) if classes[i] != classes[i - 1]), BINS]
    each = STRIP["width"] / BINS
    return [
        f'<rect x="{at[0] + each * a:.1f}" y="{at[1]}" width="{each * (b - a):.1f}" '
        f'height="{height}" class="h{classes[a] if classes[a] >= 0 else "n"}"/>'
        for a, b in pairwise(edges)
    ]
