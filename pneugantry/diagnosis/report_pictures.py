"""Pictures of the report as inline SVG: the plant's blocks by share, gaps by channel, signals; and
the signals' data for zooming.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.log import COLUMNS, MEASURED, SIGMA

__all__ = ["BLOCKS", "gap_svg", "packed", "panel_svg", "plant_svg", "ticks", "unit_of"]

Array = NDArray[np.float64]
INK, LINE, QUIET = "var(--ink)", "var(--line)", "var(--quiet)"  # of the style sheet: light, dark
DARK = "#1c2430"  # on a block's own light fill
CURVES = {
    "measured": ("var(--measured)", 2.4, ""),
    "nominal": ("var(--orange)", 1.3, "5 3"),
    "augmented": ("var(--blue)", 1.3, ""),
}  # colour, width, dashes
BLOCKS = {  # x, y, width, height, caption
    "timing": (196, 272, 128, 54, ("timing", "delay of the loop")),
    "valve_x": (196, 34, 128, 54, ("valve_x", "u → f_a")),
    "valve_z": (196, 142, 128, 54, ("valve_z", "u → f_a")),
    "friction_x": (430, 34, 150, 54, ("friction_x", "friction, mass, cable")),
    "friction_z": (430, 142, 150, 54, ("friction_z", "friction, mass, cable")),
    "contact": (724, 34, 130, 162, ("contact", "and workpiece")),
    "sensors": (360, 272, 494, 54, ("sensors", "noise, scale, offset, lag")),
}
SAMPLES = 20_000  # per curve in the page; longer logs are decimated
STATIC = 240  # bins of the static picture
MISSING = 65535
PANEL = {"width": 520, "height": 168, "left": 52, "right": 8, "top": 30, "bottom": 30}
DISPLAY = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}  # unit on the page, factor


def unit_of(channel: str) -> tuple[str, float]:
    """Unit in which the page shows a channel, and the factor from SI."""
    unit = COLUMNS[channel].unit
    return DISPLAY.get(unit, (unit, 1.0))


def _number(value: float) -> str:
    return f"{value:.1f}".rstrip("0").rstrip(".")


def _text(
    x: float,
    y: float,
    text: str,
    anchor: str = "middle",
    size: float = 12,
    weight: str = "400",
    fill: str = INK,
) -> str:
    return (
        f'<text x="{_number(x)}" y="{_number(y)}" text-anchor="{anchor}" '
        f'font-size="{_number(size)}" font-weight="{weight}" '
        f'fill="{fill}">{escape(text)}</text>'
    )


def _svg(width: float, height: float, body: Iterable[str], label: str, kind: str) -> str:
    head = (
        f'<svg class="picture {kind}" viewBox="0 0 {_number(width)} {_number(height)}" '
        f'role="img" aria-label="{escape(label, quote=True)}">'
    )
    return head + "".join(body) + "</svg>"


# ---------------------------------------------------------------- where


def plant_svg(shares: Mapping[str, float]) -> str:
    """The plant's signal flow; each block filled, framed and lettered by its share. Blocks that the
    gantry does not have stand below.
    """
    others = [block for block in shares if block not in BLOCKS]
    body = [
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto">'
        f'<path d="M0 0L8 4L0 8z" fill="{LINE}"/></marker></defs>'
    ]
    body += _wires()
    body.append(
        f'<rect x="20" y="34" width="104" height="162" rx="6" fill="var(--soft)" '
        f'stroke="{LINE}" stroke-dasharray="4 3"/>'
    )
    body += [_text(72, 112, "controller"), _text(72, 128, "(not judged)", size=10.5, fill=LINE)]
    places = {
        **BLOCKS,
        **{name: (20 + 190 * i, 352, 170, 54, (name, "")) for i, name in enumerate(others)},
    }
    for name, (x, y, width, height, captions) in places.items():
        body += _block(x, y, width, height, captions, shares.get(name, 0.0), name in shares)
    label = (
        ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items() if share >= 0.005)
        or "no block carries a share"
    )
    return _svg(
        max(880, 20 + 190 * len(others)),
        420 if others else 340,
        body,
        f"Blocks of the plant by share of the gap: {label}",
        "plant",
    )


def _block(
    x: float,
    y: float,
    width: float,
    height: float,
    captions: tuple[str, str],
    share: float,
    named: bool,
) -> list[str]:
    share = min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0
    middle, centre = x + width / 2, y + height / 2
    shade = tuple(round(255 + share * (full - 255)) for full in (240, 140, 40))
    value = f"{100 * share:.0f} %" if named else "–"
    frame = f'fill="rgb{shade}" stroke="{LINE}" stroke-width="{1 + 3 * share:.1f}"'
    return [
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" {frame}/>',
        _text(middle, centre - 9, captions[0], weight="600", fill=DARK),
        _text(middle, centre + 4, captions[1], size=10.5, fill=DARK),
        _text(
            middle,
            centre + 20,
            value,
            weight="700" if share >= 0.1 else "400",
            size=13 if share >= 0.1 else 11,
            fill=DARK,
        ),
    ]


def _wires() -> list[str]:
    def wire(
        points: str, label: str = "", at: tuple[float, float] = (0, 0), tip: bool = True
    ) -> str:
        mark = ' marker-end="url(#tip)"' if tip else ""
        line = f'<polyline points="{points}" fill="none" stroke="{LINE}" stroke-width="1.5"{mark}/>'
        return line + (_text(*at, label, size=11) if label else "")

    def dot(x: float, y: float) -> str:
        return f'<circle cx="{x}" cy="{y}" r="3" fill="{LINE}"/>'

    result = []
    for axis, y in (("x", 61), ("z", 169)):
        position = "x" if axis == "x" else "z"
        result += [
            wire(f"124,{y} 194,{y}", f"u_{axis}", (159, y - 6)),
            wire(f"324,{y} 428,{y}", f"f_a{axis}", (354, y - 6)),
            dot(382, y),
        ]
        result += [
            wire(f"580,{y - 10} 722,{y - 10}", f"{position}, v_{axis}", (620, y - 16)),
            dot(664, y - 10),
        ]
        result.append(wire(f"724,{y + 14} 582,{y + 14}", f"f_{axis}", (694, y + 28)))
    result += [
        wire("382,61 382,270", "f_a", (397, 256)),
        wire("664,51 664,270", "s, v", (683, 256)),
        wire("789,196 789,270", "f", (799, 256)),
    ]
    result += [
        wire("360,299 326,299"),
        wire("196,299 72,299 72,198", "measured signals", (134, 316)),
    ]
    return result


# ---------------------------------------------------------------- how far


def gap_svg(rows: Sequence[tuple[str, float, float]], floor: float, after: str) -> str:
    """Gap before (ring) and after (disc) per channel on a logarithmic axis, the floor as a line.
    rows: name, nominal, augmented.
    """
    values = [v for _, *pair in rows for v in pair if math.isfinite(v) and v > 0] + [floor]
    low, high = math.log10(min(values) / 1.25), math.log10(max(max(values) * 1.25, 3.0 * floor))
    left, width, row, top = 58, 400, 23, 30
    height = top + row * len(rows) + 40

    def at(value: float) -> float:
        return left + width * (math.log10(max(value, 10**low)) - low) / (high - low)

    bottom = top + row * len(rows)
    body = [_text(at(floor), top - 14, f"floor {floor:.3g}", size=11)]
    for exponent in range(math.floor(low), math.ceil(high) + 1):
        for digit in (1, 2, 5):
            tick = digit * 10.0**exponent
            if low <= math.log10(tick) <= high:
                body.append(f'<path d="M{at(tick):.1f} {top}V{bottom}" stroke="{QUIET}"/>')
                body.append(_text(at(tick), bottom + 15, f"{tick:g}", size=11))
    body.append(
        f'<path d="M{at(floor):.1f} {top - 8}V{bottom}" stroke="{INK}" '
        f'stroke-dasharray="2 3" stroke-width="1.5"/>'
    )
    for i, (name, nominal, augmented) in enumerate(rows):
        y = top + row * (i + 0.5)
        body.append(_text(left - 8, y + 4, name, "end", weight="700" if name == "all" else "400"))
        if not (math.isfinite(nominal) and math.isfinite(augmented)):
            body.append(_text(left + 6, y + 4, "not known", "start", size=11))
            continue
        colour = CURVES["augmented" if augmented <= nominal else "nominal"][0]
        body.append(
            f'<path d="M{at(nominal):.1f} {y}H{at(augmented):.1f}" stroke="{colour}" '
            f'stroke-width="6" opacity=".35"/>'
        )
        body.append(
            f'<circle cx="{at(nominal):.1f}" cy="{y}" r="5" fill="var(--paper)" '
            f'stroke="{CURVES["nominal"][0]}" stroke-width="2"/>'
        )
        body.append(
            f'<circle cx="{at(augmented):.1f}" cy="{y}" r="4.5" fill="{CURVES["augmented"][0]}"/>'
        )
    body.append(
        _text(
            left + width / 2,
            bottom + 32,
            "gap = RMS of (measured − simulated)/σ  [1], logarithmic",
            size=11,
        )
    )
    return _svg(
        left + width + 14,
        height,
        body,
        f"Gap by channel: ring nominal, disc {after}, dotted line floor",
        "gap",
    )


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


def panel_svg(
    channel: str,
    time: Array,
    curves: Mapping[str, Array],
    phases: Sequence[tuple[str, float, float]],
) -> str:
    """One channel's curves (N,) in SI over time [s], decimated: the picture that stands where there
    is no JavaScript.
    """
    unit, factor = unit_of(channel)
    p, (t0, t1) = PANEL, (float(time[0]), float(time[-1]))
    finite = np.concatenate([c[np.isfinite(c)] for c in curves.values()]) * factor
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    pad = 0.05 * (high - low) or 1.0
    low, high = low - pad, high + pad
    width, height = p["width"] - p["left"] - p["right"], p["height"] - p["top"] - p["bottom"]

    def x(t: float) -> float:
        return p["left"] + width * (t - t0) / max(t1 - t0, 1e-9)

    def y(value: float) -> float:
        return p["top"] + height * (high - value) / (high - low)

    base = p["top"] + height
    body = []
    for name, start, _ in phases:
        if t0 <= start < t1:
            body.append(
                f'<path d="M{x(start):.1f} {p["top"]}V{base}" stroke="{QUIET}" '
                f'stroke-dasharray="2 2"/>'
            )
            body.append(_text(x(start), p["top"] - 4, name, "start", 9, fill=LINE))
    for tick in ticks(low, high, 4):
        body.append(
            f'<path d="M{p["left"]} {y(tick):.1f}H{p["left"] + width}" stroke="{QUIET}" '
            f'stroke-width=".6"/>'
        )
        body.append(_text(p["left"] - 5, y(tick) + 4, f"{tick:.6g}", "end", 10.5))
    body += [_text(x(tick), base + 13, f"{tick:.6g}", size=10.5) for tick in ticks(t0, t1, 8)]
    body.append(_text(p["left"] + width, base + 26, "time [s]", "end", 10.5))
    body.append(_text(p["left"], p["top"] - 17, f"{channel} [{unit}]", "start", 11.5, "600"))
    for name, values in curves.items():
        colour, thick, dashes = CURVES[name]
        index, extremes = _extremes(values, STATIC)
        if not len(index):
            continue
        places = time[index.astype(int)]
        points = " ".join(
            f"{x(t):.0f},{y(v * factor):.1f}" for t, v in zip(places, extremes, strict=True)
        )
        dash = f' stroke-dasharray="{dashes}"' if dashes else ""
        body.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" '
            f'stroke-width="{thick}"{dash} stroke-linejoin="round"/>'
        )
    body.append(
        f'<rect x="{p["left"]}" y="{p["top"]}" width="{width}" height="{height}" '
        f'fill="none" stroke="{QUIET}"/>'
    )
    return _svg(p["width"], p["height"], body, f"{channel} over time: {', '.join(curves)}", "panel")


def packed(
    time: Array,
    curves: Mapping[str, Array],
    phases: Sequence[tuple[str, float, float]],
    samples: int = SAMPLES,
) -> dict[str, Any]:
    """The curves (N, 8) for the page's script: 16 bits a sample, every sample up to `samples` a
    curve, beyond that bins' extremes.
    """
    # samples a bin; a bin gives two points
    step = 1 if len(time) <= samples else 2 * math.ceil(len(time) / samples)
    channels = []
    for i, channel in enumerate(MEASURED):
        unit, factor = unit_of(channel)
        columns = {name: _decimated(values[:, i] * factor, step) for name, values in curves.items()}
        finite = np.concatenate([c[np.isfinite(c)] for c in columns.values()])
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
        scale = (high - low) / (MISSING - 1) or 1.0
        data = {name: _base64(column, low, scale) for name, column in columns.items()}
        channels.append(
            {
                "name": channel,
                "unit": unit,
                "sigma": SIGMA[channel] * factor,
                "low": low,
                "scale": scale,
                "data": data,
                "difference": {} if step == 1 else _differences(curves, i, step),
            }
        )
    spacing = (
        (float(time[-1]) - float(time[0])) / max(len(time) - 1, 1) * (1 if step == 1 else step / 2)
    )
    styles = {
        name: {"colour": colour, "width": width, "dashes": [float(d) for d in dashes.split()]}
        for name, (colour, width, dashes) in CURVES.items()
    }
    return {
        "t0": float(time[0]),
        "dt": spacing,
        "full": step == 1,
        "channels": channels,
        "phases": [list(p) for p in phases],
        "panel": PANEL,
        "curves": {name: styles[name] for name in curves},
    }


def _differences(curves: Mapping[str, Array], i: int, step: int) -> dict[str, dict[str, Any]]:
    """(measured - model)/sigma of channel i by model, for a log whose samples are thinned: extremes
    of two curves cannot be subtracted.
    """
    found = {}
    for name, values in curves.items():
        if name == "measured":
            continue
        off = (curves["measured"][:, i] - values[:, i]) / SIGMA[MEASURED[i]]
        column = _decimated(off, step)
        finite = column[np.isfinite(column)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
        scale = (high - low) / (MISSING - 1) or 1.0
        found[name] = {"low": low, "scale": scale, "data": _base64(column, low, scale)}
    return found


def _decimated(values: Array, step: int) -> Array:
    """Smallest and largest of each bin of `step` samples, in order of time; a last bin that is not
    full repeats its last sample.
    """
    if step == 1:
        return values
    bins = np.append(values, np.full(-len(values) % step, values[-1])).reshape(-1, step)
    first_low = np.nanargmin(np.where(np.isfinite(bins), bins, np.inf), axis=1) <= np.nanargmax(
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
