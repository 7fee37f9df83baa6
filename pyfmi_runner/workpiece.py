"""Workpiece edges z_w(x): contact begins at z = z_0 + z_w(x), z_0 the stand-off
(docs/explanation/plant.md, "Workpieces").
"""

from __future__ import annotations

import difflib
import math
import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from modelica_fmu.errors import InputError
from modelica_fmu.files import check_source
from pyfmi_runner.log import parsed_numbers
from pyfmi_runner.plant import FINISH

__all__ = [
    "STANDOFF",
    "WORKPIECES",
    "Profile",
    "check_workpiece",
    "default_standoff",
    "local_profile",
    "read_profile",
    "workpiece",
]

X_DATUM = 0.95  # m, where z_w = 0; a multiple of CELL, as are all edges of the curved profile
CELL = 0.001  # m, grid of the named profiles
GRID = (-0.01, 1.03)  # m, x range that the named profiles cover; the stroke is 0..1
# Stand-off z_0 of the named workpieces, m
STANDOFF = {
    "straight": 0.040,
    "incline_7": 0.090,
    "incline_16": 0.092,
    "incline_30": 0.092,
    "curved": 0.090,
}
WORKPIECES = tuple(STANDOFF)
HIGHEST = 0.090  # m, where the highest point of a user's profile stands by default
BUMPS = (
    (50.0, 0.78, 0.16),
    (-10.0, 0.52, 0.10),
)  # curved: peak angle deg, start m, length m, towards -x

Array = NDArray[np.float64]


@register_jitable
def local_profile(
    coefficients: Array, x0: float, dx: float, x: float
) -> tuple[float, float, float]:
    """Height z_w [m], slope dz_w/dx and curvature d2z_w/dx2 [1/m] at x; straight on beyond both
    ends of the grid.

    coefficients: shape (cells, 6), powers 0..5 of (x - cell's left edge) / dx. Same bits in Python
    and compiled.
    """
    cells = coefficients.shape[0]
    place = (x - x0) / dx
    inside = (
        min(place, float(cells)) if place > 0.0 else 0.0
    )  # NaN falls to cell 0, and through to the height
    cell = min(int(inside), cells - 1)
    s = inside - cell
    height = 0.0
    slope = 0.0
    curvature = 0.0
    for k in range(5, -1, -1):
        curvature = curvature * s + 2.0 * slope
        slope = slope * s + height
        height = height * s + coefficients[cell, k]
    if place != inside:
        return height + slope * (place - inside), slope / dx, 0.0
    return height, slope / dx, curvature / (dx * dx)


@dataclass(frozen=True, eq=False)
class Profile:
    """An edge as quintic pieces on a uniform grid: twice continuously differentiable. x0 [m] is the
    grid's left end.
    """

    name: str
    x0: float
    dx: float
    coefficients: Array  # (cells, 6), m

    def height(self, x: ArrayLike) -> Array:
        """z_w [m], relative to the stand-off; shape of x."""
        return self._evaluate(x)[0]

    def slope(self, x: ArrayLike) -> Array:
        """dz_w/dx = tan(theta); shape of x."""
        return self._evaluate(x)[1]

    def curvature(self, x: ArrayLike) -> Array:
        """d2z_w/dx2 [1/m]; shape of x."""
        return self._evaluate(x)[2]

    def _evaluate(self, x: ArrayLike) -> tuple[Array, Array, Array]:
        place = (np.asarray(x, dtype=np.float64) - self.x0) / self.dx
        cells = len(self.coefficients)
        inside = np.clip(place, 0.0, cells)
        cell = np.minimum(inside.astype(np.int64), cells - 1)
        s = inside - cell
        height, slope, curvature = np.zeros_like(s), np.zeros_like(s), np.zeros_like(s)
        for k in range(5, -1, -1):
            curvature = curvature * s + 2.0 * slope
            slope = slope * s + height
            height = height * s + self.coefficients[cell, k]
        beyond = place - inside
        return (
            height + slope * beyond,
            slope / self.dx,
            np.where(beyond == 0, curvature / self.dx**2, 0.0),
        )


def workpiece(name: str | os.PathLike[str], *, surface_finish: bool = False) -> Profile:
    """The profile of a named workpiece, or of a CSV file of columns x, z_w. Raises InputError for
    an unknown name.
    """
    check_workpiece(name)
    return (
        _named(str(name), surface_finish)
        if name in STANDOFF
        else read_profile(name, surface_finish=surface_finish)
    )


def default_standoff(name: str | os.PathLike[str]) -> float:
    """Stand-off z_0 [m] of a named workpiece; that of a file puts its highest point at z = 0.090
    m.
    """
    check_workpiece(name)
    if name in STANDOFF:
        return STANDOFF[str(name)]
    table = _profile_table(Path(name))
    return HIGHEST - float(table[1].max())


def check_workpiece(name: str | os.PathLike[str], *, none: bool = False) -> None:
    """Raise InputError unless name is a known workpiece or a .csv path (or, where `none` is
    allowed, "none").
    """
    known = [*WORKPIECES, "none"] if none else [*WORKPIECES]
    text = os.fspath(name)
    if text in known or text.lower().endswith(".csv"):
        return
    near = difflib.get_close_matches(text, known, n=1)
    hint = (
        f"did you mean {near[0]}?" if near else f"use {', '.join(known)} or a .csv file of x, z_w"
    )
    raise InputError(f"unknown workpiece {text!r}", field="workpiece", hint=hint)


def read_profile(path: str | os.PathLike[str], *, surface_finish: bool = False) -> Profile:
    """A user's edge: CSV of columns x, z_w [m], read as a cubic spline (natural ends), straight on
    beyond its ends.

    Raises InputError naming file, column or row, and the hint.
    """
    path = Path(path)
    x, z_w = _profile_table(path)
    from scipy.interpolate import CubicSpline  # costs half a second, for who has such an edge

    spline = CubicSpline(x, z_w, bc_type="natural")
    cells = math.ceil((x[-1] - x[0]) / min(CELL, float(np.diff(x).min())) - 1e-9)
    if cells > 20_000:
        raise InputError(
            "points lie too close", file=path, field="x", hint="space them by 0.05 mm or more"
        )
    nodes = np.linspace(x[0], x[-1], cells + 1)
    steep = int(np.argmax(np.abs(spline(nodes, 1))))
    if abs(angle := math.degrees(math.atan(float(spline(nodes[steep], 1))))) > 80:
        message = (
            f"the edge rises by {angle:.0f} deg at x = {nodes[steep]:.4g} m, expected within 80 deg"
        )
        raise InputError(message, file=path, field="z_w", hint="smooth the profile")
    return _quintic(
        path.stem, nodes, spline(nodes), spline(nodes, 1), spline(nodes, 2), surface_finish
    )


def _profile_table(path: Path) -> tuple[Array, Array]:
    check_source(path)
    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True, encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(
            "no such file", file=path, field="workpiece", hint="check the path"
        ) from None
    except (OSError, ValueError) as error:  # pandas' and the codec's errors are ValueErrors
        raise InputError(
            f"not a readable table ({error})", file=path, hint="write CSV with the header x,z_w"
        ) from None
    table.columns = [str(name).strip() for name in table.columns]
    for name in ("x", "z_w"):
        if list(table.columns).count(name) > 1:
            raise InputError(
                "column is there twice", file=path, field=name, hint="keep one of them"
            )
        if name not in table.columns:
            raise InputError(
                "column is missing", file=path, field=name, hint="write the header x,z_w (metres)"
            )
        values = parsed_numbers(table[name])
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            message = f"row {row} is {table[name].iloc[row]}, not a number"
            raise InputError(message, file=path, field=name, hint="use plain numbers in metres")
        if len(values) and np.ptp(values) > (2.0 if name == "x" else 1.2):
            message = f"spans {np.ptp(values):.4g} m, looks like millimetres"
            raise InputError(message, file=path, field=name, hint=f"divide column {name} by 1000")
    if len(table) < 4:
        raise InputError(f"{len(table)} points, expected at least 4", file=path, hint="add points")
    x, z_w = (table[name].to_numpy(dtype=np.float64) for name in ("x", "z_w"))
    if x[0] > x[-1]:
        x, z_w = x[::-1], z_w[::-1]
    if (np.diff(x) <= 0).any():
        row = int(np.argmax(np.diff(x) <= 0)) + 1
        message = f"x does not run one way: x = {x[row]:.6g} m follows {x[row - 1]:.6g} m"
        raise InputError(
            message, file=path, field="x", hint="sort the rows by x and drop repeated ones"
        )
    return x, z_w


@lru_cache(maxsize=32)
def _named(name: str, surface_finish: bool) -> Profile:
    nodes: Array = GRID[0] + CELL * np.arange(
        round((GRID[1] - GRID[0]) / CELL) + 1, dtype=np.float64
    )
    if name == "curved":
        points, weights = np.polynomial.legendre.leggauss(12)
        inner: Array = nodes[:-1, None] + 0.5 * CELL * (1.0 + points)
        rise = 0.5 * CELL * (np.tan(_curved_theta(inner)[0]) @ weights)
        height = np.r_[0.0, np.cumsum(rise)]
        height -= height[round((X_DATUM - GRID[0]) / CELL)]
        theta, bend = _curved_theta(nodes)
        return _quintic(
            name, nodes, height, np.tan(theta), bend / np.cos(theta) ** 2, surface_finish
        )
    angle = 0.0 if name == "straight" else math.radians(float(name.removeprefix("incline_")))
    slope = np.full(nodes.shape, math.tan(angle))
    return _quintic(
        name, nodes, slope * (nodes - X_DATUM), slope, np.zeros_like(nodes), surface_finish
    )


def _curved_theta(x: Array) -> tuple[Array, Array]:
    """Slope angle [rad] of the curved workpiece and its derivative [rad/m]."""
    theta, bend = np.zeros_like(x), np.zeros_like(x)
    for peak, start, length in BUMPS:
        s = np.clip((start - x) / length, 0.0, 1.0)
        theta += math.radians(peak) * np.sin(np.pi * s) ** 2
        bend -= math.radians(peak) * np.pi / length * np.sin(2 * np.pi * s)
    return theta, bend


def _finish(x: Array, order: int) -> Array:
    """Surface finish [m] at x, or its derivative of that order."""
    waves = [
        amplitude
        * (2 * np.pi / length) ** order
        * np.sin(2 * np.pi * x / length + phase + order * np.pi / 2)
        for amplitude, length, phase in FINISH
    ]
    return np.asarray(np.sum(waves, axis=0))


def _quintic(
    name: str, x: Array, height: Array, slope: Array, curvature: Array, surface_finish: bool
) -> Profile:
    """Pieces through the heights, slopes and curvatures at the nodes of a uniform grid."""
    if surface_finish:
        height, slope, curvature = (
            height + _finish(x, 0),
            slope + _finish(x, 1),
            curvature + _finish(x, 2),
        )
    dx = float(x[-1] - x[0]) / (len(x) - 1)
    h, m, c = height, slope * dx, curvature * dx**2
    rise = h[1:] - h[:-1] - m[:-1] - 0.5 * c[:-1]
    steepen = m[1:] - m[:-1] - c[:-1]
    bend = c[1:] - c[:-1]
    pieces = (
        h[:-1],
        m[:-1],
        0.5 * c[:-1],
        10 * rise - 4 * steepen + 0.5 * bend,
        -15 * rise + 7 * steepen - bend,
        6 * rise - 3 * steepen + 0.5 * bend,
    )
    coefficients = np.ascontiguousarray(np.column_stack(pieces))
    coefficients.setflags(write=False)
    return Profile(name, float(x[0]), dx, coefficients)
