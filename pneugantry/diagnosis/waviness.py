"""An edge that is not straight: its height over x, read off the contact force that nothing else
explains, as a sum of sines.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pneugantry.diagnosis.bench import Bench
from pneugantry.engine.catalogue import Form, Parameter

__all__ = ["estimate_waviness", "sines"]

Array = NDArray[np.float64]
MOST = 8  # sines that the model's surface finish holds
SHORTEST, LONGEST = 6e-3, 0.25  # m, wavelengths that tracking can show
PRESSED = 5.0  # N
BIN = 1e-3  # m
WORTH = 0.03  # share of what is left that another sine must explain


def estimate_waviness(bench: Bench, known: dict[str, float]) -> Form | None:
    """The surface finish of the model that fits the contact view's residual; None where no
    contouring log shows enough of an edge.
    """
    x, height = _height(bench, known)
    if len(x) < 60:
        return None
    found = sines(x, height)
    if not found:
        return None
    parameters, settings = [], {}
    for i, (amplitude, wavelength, phase) in enumerate(found, start=1):
        parameters.append(
            Parameter(f"workpiece.A[{i}]", amplitude, 0.3 * amplitude, -0.05, 0.05, "m")
        )
        parameters.append(Parameter(f"workpiece.phi[{i}]", phase, 0.3, -9.9, 9.9, "rad"))
        settings[f"workpiece.lambda[{i}]"] = wavelength
    return Form("sines", tuple(parameters), settings)


def _height(bench: Bench, known: dict[str, float]) -> tuple[Array, Array]:
    """Bins of x [m] and the edge's height in them beyond the nominal one [m], its mean per log
    taken out.
    """
    view = bench.all["contact"]
    residual = view.residual(known)
    columns = bench.table.columns
    force = np.hypot(columns["f_x"], columns["f_z"])
    stiffness = known.get("contact.K_c", bench.nominal["contact.K_c"])
    xs, heights = [], []
    for i in view.logs:  # type: ignore[attr-defined]
        first, last = bench.table.spans[i]
        rows = np.arange(first, last)[
            (force[first:last] > PRESSED) & ~bench.table.clamped["x"][first:last]
        ]
        if len(rows) < 1000:
            continue
        sine, cosine = columns["f_x"][rows] / force[rows], columns["f_z"][rows] / force[rows]
        normal = (
            residual[rows, 0] * bench.table.sigma["f_x"] * sine
            + residual[rows, 1] * bench.table.sigma["f_z"] * cosine
        )
        height = -normal / (stiffness * np.maximum(cosine, 0.3))
        position = bench.store.signals({}).position["x"][rows]
        cell = np.floor(position / BIN).astype(int)
        for c in np.unique(cell):
            inside = cell == c
            if inside.sum() >= 4:
                xs.append(position[inside].mean())
                heights.append(height[inside].mean())
    return np.array(xs), np.array(heights)


def sines(x: Array, height: Array, most: int = MOST) -> list[tuple[float, float, float]]:
    """(amplitude [m], wavelength [m], phase [rad]) of sines A sin(2 pi x / lambda + phi), by
    orthogonal matching pursuit; a constant is fitted too.
    """
    wavelengths = np.geomspace(SHORTEST, min(LONGEST, np.ptp(x)), 500)
    chosen: list[float] = []
    left: Array = height - height.mean()
    solution: Array = np.zeros(0)
    for _ in range(most):
        power = [_explained(x, left, w) for w in wavelengths]
        best = float(wavelengths[int(np.argmax(power))])
        best = max(
            (best * f for f in np.linspace(0.985, 1.015, 31)), key=lambda w: _explained(x, left, w)
        )
        trial = [*chosen, best]
        basis = _basis(x, trial)
        weights = np.linalg.lstsq(basis, height, rcond=None)[0]
        after = height - basis @ weights
        if after @ after > (1 - WORTH) * (left @ left):
            break
        chosen, left, solution = (
            trial,
            np.asarray(after, dtype=np.float64),
            np.asarray(weights, dtype=np.float64),
        )
    pairs = [(solution[1 + 2 * i], solution[2 + 2 * i]) for i in range(len(chosen))]
    return [
        (float(np.hypot(s, c)), w, float(np.arctan2(c, s)))
        for (s, c), w in zip(pairs, chosen, strict=True)
    ]


def _basis(x: Array, wavelengths: list[float]) -> Array:
    columns = [np.ones_like(x)]
    for w in wavelengths:
        columns += [np.sin(2 * np.pi * x / w), np.cos(2 * np.pi * x / w)]
    return np.column_stack(columns)


def _explained(x: Array, left: Array, wavelength: float) -> float:
    basis = _basis(x, [wavelength])
    fitted = basis @ np.linalg.lstsq(basis, left, rcond=None)[0]
    return float(fitted @ fitted)
