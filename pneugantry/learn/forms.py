"""The field's own forms of a term, as Modelica and as arrays, and which of them a curve may be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from pneugantry.engine.plant import Array
from pneugantry.learn.curve import Knots, Wave
from pneugantry.learn.screen import Candidate

__all__ = ["FORMS", "Distilled", "FormLaw", "FreeCurve", "distilled", "free_curve", "wave_of"]

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
SHAPES = 7  # of a free curve
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


def distilled(knots: Knots, curve: Array, covariance: Array) -> list[Distilled]:
    """Forms by their distance from a curve, the closest first. A constant is left to the rest of
    the model: it is fitted beside.
    """
    level, vectors = np.linalg.eigh(covariance)
    root = vectors / np.sqrt(np.maximum(level, 1e-9 * level.max()))
    found = []
    for form in FORMS:
        best: Distilled | None = None
        for start in _starts(form, knots.at):
            one = _fitted(form, start, knots, curve, root)
            if best is None or one.cost < best.cost:
                best = one
        assert best is not None
        found.append(best)
    return _doubted(found, len(curve))


def _doubted(found: Sequence[Distilled], rows: int) -> list[Distilled]:
    """Costs as they are where no form is exact, for the curve itself is not: it is that of a
    linearised plant. The form that leaves least a parameter then leaves one standard deviation.
    """
    doubt = min((d.cost - PRICE * len(d.values)) / max(rows - len(d.values), 1) for d in found)
    doubt = max(doubt, 1.0)
    costs = [(d.cost - PRICE * len(d.values)) / doubt + PRICE * len(d.values) for d in found]
    made = [replace(d, cost=c) for d, c in zip(found, costs, strict=True)]
    return sorted(made, key=lambda d: d.cost)


def _starts(form: FormLaw, z: Array) -> list[tuple[float, ...]]:
    span = float(z[-1] - z[0])
    found: list[tuple[float, ...]] = [()]
    for shape in (s for s in form.shapes if s != "size"):
        offset = 0.0 if shape == "width" else float(z[0])
        found = [(*f, offset + share * span) for f in found for share in STARTS[shape]]
    return found


def _fitted(
    form: FormLaw, start: tuple[float, ...], knots: Knots, curve: Array, root: Array
) -> Distilled:
    """The best values from a start on; sizes and a constant follow from the shapes, which move by
    shares of the range.
    """
    z, span = knots.at, float(knots.at[-1] - knots.at[0])
    edges = np.array([-2 * knots.width, 2 * knots.width])
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
            low, high = form.law(edges, p)
            columns.append(root.T @ knots.seen(form.law(z, p), (float(low), float(high))))
        constant = knots.seen(np.ones(len(z)), (1.0, 1.0))
        both = np.column_stack([*columns, root.T @ constant])
        found, *_ = np.linalg.lstsq(both, root.T @ curve, rcond=None)
        return np.asarray(found), np.asarray(root.T @ curve - both @ found)

    x = np.array(start) / span
    if len(x):
        x = least_squares(lambda v: sized(v)[1], x, max_nfev=60).x
    found, left = sized(x)
    values = (*(float(v) for v in found[:-1]), *shapes_of(x))
    return Distilled(form, values, float(left @ left) + PRICE * len(values))


def wave_of(candidate: Candidate, wave: Wave) -> Distilled:
    """The sine of a candidate."""
    curve = candidate.answer.coefficients
    size, phase = float(np.hypot(*curve)), float(np.arctan2(curve[1], curve[0]))
    place = -phase / (2 * np.pi) * wave.period
    law = next(f for f in FORMS if f.name == "sine")
    return Distilled(law, (size, wave.period, place), 3 * PRICE)


@dataclass(frozen=True, eq=False)
class FreeCurve:
    """The curve of a candidate, as a sum of the shapes that its prior finds likeliest; the prior
    spread of each is 1.
    """

    knots: Knots
    shapes: Array  # (coefficients, COUNT)
    rest: Array  # covariance of what the shapes leave out
    start: Distilled

    def curve(self, values: Sequence[float], covariance: Array) -> tuple[Array, Array]:
        """Coefficients of the knots and their covariance, from those of the shapes' sizes."""
        spread = self.shapes @ covariance @ self.shapes.T + self.rest
        return self.shapes @ np.asarray(values), spread


def free_curve(candidate: Candidate, knots: Knots, count: int = SHAPES) -> FreeCurve:
    """See `FreeCurve`; it starts from the candidate's coefficients."""
    at = knots.at
    whole = np.linalg.inv(knots.prior(candidate.size, candidate.bend))
    level, vectors = np.linalg.eigh(whole)
    order = np.argsort(-level)[:count]
    shapes = vectors[:, order] * np.sqrt(level[order])
    values = np.linalg.lstsq(shapes, candidate.answer.coefficients, rcond=None)[0]
    tables = "".join(
        f"    parameter Real table_{k}[{len(at)}] = {{{', '.join(f'{v:.9g}' for v in shape)}}};\n"
        for k, shape in enumerate(shapes.T[:, : len(at)], 1)
    )
    step = float(at[1] - at[0])
    share = f"min(max((z - ({at[0]:.9g}))/{step:.9g}, 0), {len(at) - 1})"
    sums = " + ".join(f"p{k}*table_{k}[i]" for k in range(1, count + 1))
    text = f"sum(({sums})*max(1 - abs({share} - (i - 1)), 0) for i in 1:{len(at)})"
    if knots.jumps:
        jump = " + ".join(f"({shape[-1]:.9g})*p{k}" for k, shape in enumerate(shapes.T, 1))
        text += f" + ({jump})*tanh(z/{knots.width:.9g})"

    def law(z: Array, p: Sequence[float]) -> Array:
        return np.asarray(knots.shapes(np.atleast_1d(z)) @ (shapes @ np.asarray(p)))

    made = FormLaw("curve", text, law, ("size",) * (count - 1), tables)
    start = Distilled(made, tuple(float(v) for v in values), PRICE * count)
    return FreeCurve(knots, shapes, whole - shapes @ shapes.T, start)
