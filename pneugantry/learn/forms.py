"""The field's own forms of a term, as Modelica and as arrays, and which of them a curve may be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pneugantry.engine.plant import Array
from pneugantry.learn.screen import Candidate

__all__ = ["FORMS", "Distilled", "FormLaw", "distilled", "free_curve"]

Law = Callable[[Array, Sequence[float]], Array]


@dataclass(frozen=True)
class FormLaw:
    """y(z) with a size p1, neutral at 0, and further parameters."""

    name: str
    text: str  # Modelica, in z and p1, p2, ...
    law: Law  # of z and (p1, p2, ...)
    shapes: tuple[str, ...] = ()  # of p2, ...: "width" (> 0), "place", or "size" as p1
    tables: str = ""  # further declarations


def _sine(z: Array, p: Sequence[float]) -> Array:
    return np.asarray(p[0] * np.sin(2 * np.pi * (z - p[2]) / p[1]))


def _fading(z: Array, p: Sequence[float]) -> Array:
    return np.asarray(p[0] * np.tanh(50 * z / p[1]) / (1 + np.abs(z) / p[1]))


FORMS = (
    FormLaw("linear", "p1*z", lambda z, p: p[0] * z),
    FormLaw("square", "p1*z^2", lambda z, p: p[0] * z**2),
    FormLaw("signed square", "p1*z*abs(z)", lambda z, p: p[0] * z * np.abs(z)),
    FormLaw("cube", "p1*z^3", lambda z, p: p[0] * z**3),
    FormLaw("magnitude", "p1*abs(z)", lambda z, p: p[0] * np.abs(z)),
    FormLaw("sign", "p1*tanh(z/p2)", lambda z, p: p[0] * np.tanh(z / p[1]), ("width",)),
    FormLaw("fading sign", "p1*tanh(50*z/p2)/(1 + abs(z)/p2)", _fading, ("width",)),
    FormLaw(
        "exponential",
        "p1*(1 - exp(-abs(z)/p2))",
        lambda z, p: p[0] * (1 - np.exp(-np.abs(z) / p[1])),
        ("width",),
    ),
    FormLaw(
        "dead zone",
        "p1*(z - min(max(z, -p2), p2))",
        lambda z, p: p[0] * (z - np.clip(z, -p[1], p[1])),
        ("width",),
    ),
    FormLaw(
        "bump",
        "p1*exp(-((z - p3)/p2)^2)",
        lambda z, p: p[0] * np.exp(-(((z - p[2]) / p[1]) ** 2)),
        ("width", "place"),
    ),
    FormLaw("sine", "p1*sin(2*3.141592653589793*(z - p3)/p2)", _sine, ("width", "place")),
    FormLaw(
        "polynomial",
        "z*(p1 + z*(p2 + z*p3))",
        lambda z, p: z * (p[0] + z * (p[1] + z * p[2])),
        ("size", "size"),
    ),
)
STARTS = {
    "width": (0.05, 0.15, 0.4, 1.0),
    "place": (0.1, 0.3, 0.5, 0.7, 0.9),
}  # shares of the range
PRICE = 2.2  # -2 log evidence of a parameter at a knot's share of the rows, about log 9


@dataclass(frozen=True, eq=False)
class Distilled:
    """A form with the values that fit a curve best."""

    law: FormLaw
    values: tuple[float, ...]  # p1, p2, ...
    cost: float  # squared distance from the curve in its standard deviations, and PRICE each


def distilled(candidate: Candidate) -> list[Distilled]:
    """Forms by their distance from a candidate's curve, the closest first. A constant is left to
    the rest of the model: it is fitted beside.
    """
    z, curve = candidate.knots.at, candidate.answer.coefficients
    covariance = candidate.answer.covariance
    level, vectors = np.linalg.eigh(covariance)
    root = vectors / np.sqrt(np.maximum(level, 1e-9 * level.max()))
    found = []
    for form in FORMS:
        best: Distilled | None = None
        for start in _starts(form, z):
            one = _fitted(form, start, z, curve, root)
            if best is None or one.cost < best.cost:
                best = one
        assert best is not None
        found.append(best)
    return sorted(found, key=lambda d: d.cost)


def _starts(form: FormLaw, z: Array) -> list[tuple[float, ...]]:
    span = float(z[-1] - z[0])
    found: list[tuple[float, ...]] = [()]
    for shape in (s for s in form.shapes if s != "size"):
        offset = 0.0 if shape == "width" else float(z[0])
        found = [(*f, offset + share * span) for f in found for share in STARTS[shape]]
    return found


def _fitted(
    form: FormLaw, start: tuple[float, ...], z: Array, curve: Array, root: Array
) -> Distilled:
    """The best values from a start on; sizes and a constant follow from the shapes, which move by
    shares of the range.
    """
    span = float(z[-1] - z[0])
    moved = [k for k in form.shapes if k != "size"]
    sizes = [0, *(k for k, kind in enumerate(form.shapes, 1) if kind == "size")]

    def shapes_of(x: Array) -> list[float]:
        pairs = zip(x, moved, strict=True)
        return [span * (max(abs(v), 1e-3) if kind == "width" else v) for v, kind in pairs]

    def sized(x: Array) -> tuple[Array, Array]:
        rest = shapes_of(x)
        columns = []
        for k in sizes:
            p = [0.0] * (len(form.shapes) + 1 - len(rest)) + rest
            p[k] = 1.0
            columns.append(root.T @ form.law(z, p))
        both = np.column_stack([*columns, root.T @ np.ones(len(z))])
        found, *_ = np.linalg.lstsq(both, root.T @ curve, rcond=None)
        return np.asarray(found), np.asarray(root.T @ curve - both @ found)

    x = np.array(start) / span
    if len(x):
        x = least_squares(lambda v: sized(v)[1], x, max_nfev=60).x
    found, left = sized(x)
    values = (*(float(v) for v in found[:-1]), *shapes_of(x))
    return Distilled(form, values, float(left @ left) + PRICE * len(values))


def free_curve(candidate: Candidate, count: int = 5) -> Distilled:
    """The curve itself, as a sum of the `count` shapes that its prior finds likeliest; the prior
    spread of each is 1.
    """
    knots = candidate.knots
    at = knots.at
    covariance = np.linalg.inv(knots.prior(candidate.size, candidate.bend))
    level, vectors = np.linalg.eigh(covariance)
    order = np.argsort(-level)[:count]
    shapes = vectors[:, order] * np.sqrt(level[order])
    values = np.linalg.lstsq(shapes, candidate.answer.coefficients, rcond=None)[0]
    rows = [f"{{{', '.join(f'{v:.9g}' for v in shape)}}}" for shape in shapes.T]
    tables = "".join(
        f"    parameter Real table_{k}[{len(at)}] = {row};\n" for k, row in enumerate(rows, 1)
    )
    step = float(at[1] - at[0])
    share = f"min(max((z - ({at[0]:.9g}))/{step:.9g}, 0), {len(at) - 1})"
    sums = " + ".join(f"p{k}*table_{k}[i]" for k in range(1, count + 1))
    text = f"sum(({sums})*max(1 - abs({share} - (i - 1)), 0) for i in 1:{len(at)})"

    def law(z: Array, p: Sequence[float]) -> Array:
        return np.asarray(knots.hats(np.atleast_1d(z)) @ (shapes @ np.asarray(p)))

    made = FormLaw("curve", text, law, ("size",) * (count - 1), tables)
    return Distilled(made, tuple(float(v) for v in values), PRICE * count)
