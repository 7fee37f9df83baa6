"""The field's own forms of a term, as Modelica and as arrays, and which of them a curve may be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.plant import Array
from pneugantry.learn.curves.curve import Knots, Wave
from pneugantry.learn.curves.memory import MEMORIES, Memory, Remembered
from pneugantry.learn.screening.candidate import Candidate

__all__ = [
    "FORMS",
    "LINE",
    "PERIODIC",
    "REMEMBERING",
    "Distilled",
    "FormLaw",
    "FreeCurve",
    "distances",
    "distilled",
    "distinct",
    "doubted",
    "free_curve",
    "line_of",
    "memory_of",
    "wave_of",
    "with_harmonics",
]

Law = Callable[[Array, Sequence[float]], Array]


@dataclass(frozen=True)
class FormLaw:
    """y(z) with a size p1, neutral at 0, and further parameters."""

    name: str
    text: str  # Modelica, in z and p1, p2, ...
    law: Law  # of z and (p1, p2, ...)
    shapes: tuple[str, ...] = ()  # of p2, ...: "width" (> 0), "place", or "size" as p1
    tables: tuple[tuple[str, Array], ...] = ()  # further parameters by name, not fitted
    memory: Memory | None = None  # whose state the text reads

    @property
    def repeats(self) -> bool:
        """Whether it is periodic in z."""
        return self.name in ("sine", "periodic")


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
        "ramp",
        "p1*max(z - p2, 0)",
        lambda z, p: p[0] * np.maximum(z - p[1], 0),
        ("place",),
    ),
    FormLaw(
        "square beyond",
        "p1*max(z - p2, 0)^2",
        lambda z, p: p[0] * np.maximum(z - p[1], 0) ** 2,
        ("place",),
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
LINE = FormLaw(
    "line", "p1*(z - p2)", lambda z, p: p[0] * (z - p[1]), ("place",)
)  # linear, with a constant that the rest of the model does not have
HARMONICS = 5  # of a wave that is no sine
SAME = 1 - 1e-6  # correlation about 0 from which on two forms are one over the range covered


def _periodic(z: Array, p: Sequence[float]) -> Array:
    w = 2 * np.pi * (z - p[-1]) / p[1]
    found = p[0] * np.sin(w)
    for k in range(2, HARMONICS + 1):
        found = found + p[2 * k - 2] * np.sin(k * w) + p[2 * k - 1] * np.cos(k * w)
    return np.asarray(found)


PERIODIC = FormLaw(
    "periodic",
    " + ".join(
        [
            "p1*sin({w})",
            *(
                f"p{2 * k - 1}*sin({k}*{{w}}) + p{2 * k}*cos({k}*{{w}})"
                for k in range(2, HARMONICS + 1)
            ),
        ]
    ).format(w=f"2*3.141592653589793*(z - p{2 * HARMONICS + 1})/p2"),
    _periodic,
    ("width", *("size",) * (2 * HARMONICS - 2), "place"),
)  # what repeats in another shape than a sine's
SHAPES = 7  # of a free curve
STARTS = {
    "width": (0.01, 0.03, 0.1, 0.25, 0.5, 1.0),
    "place": tuple(np.linspace(0.05, 0.95, 19)),
}  # shares of the range
REFINED = 2  # starts of a form that are followed
SWEEP = 8.0  # times of a memory in which its variable goes over its range and back
PRICE = 2.2  # -2 log evidence of a parameter at a knot's share of the rows, about log 9


@dataclass(frozen=True, eq=False)
class Distilled:
    """A form with the values that fit a curve best."""

    law: FormLaw
    values: tuple[float, ...]  # p1, p2, ...
    cost: float  # squared distance from the curve in its standard deviations, and PRICE each
    beside: tuple[float, ...] = ()  # shares of what was fitted beside
    places: tuple[float, ...] = ()  # of a wave, in each record, where they are of their own


def distilled(knots: Knots, curve: Array, covariance: Array) -> list[Distilled]:
    """Forms by their distance from a curve, the closest first."""
    found = distances(knots, curve, covariance)
    costs = doubted(found, len(curve))
    made = [replace(d, cost=c) for d, c in zip(found, costs, strict=True)]
    return sorted(made, key=lambda d: d.cost)


def distinct(z: Array) -> list[FormLaw]:
    """Forms over a range of their variable: of those that differ by no more than their sign there
    (`z` and `abs(z)` on one side of 0) the first.
    """
    told: list[FormLaw] = []
    columns: list[Array] = []
    for form in FORMS:
        if not form.shapes:
            column = form.law(z, (1.0,))
            column = column / (np.linalg.norm(column) + 1e-300)
            if any(abs(float(column @ c)) > SAME for c in columns):
                continue
            columns.append(column)
        told.append(form)
    return told


def distances(
    knots: Knots, curve: Array, covariance: Array, beside: Array | None = None
) -> list[Distilled]:
    """Forms with their distances from a curve. A constant is left to the rest of the model: it is
    fitted beside, and so are further curves (coefficients, n).
    """
    root = _whitening(covariance)
    others = np.ones((len(curve), 1))
    others[len(knots.at) :] = 0.0  # a constant does not jump
    if beside is not None:
        others = np.column_stack([others, beside])
    found = []
    for form in distinct(knots.at):
        fit = _Fit(form, knots, root, root.T @ curve, others)
        starts = sorted(_starts(form, knots.at), key=fit.cost)[:REFINED]
        found.append(min((fit.refined(s) for s in starts), key=lambda d: d.cost))
    return found


def _whitening(covariance: Array) -> Array:
    """What makes coefficients of a curve independent, of deviation 1: transposed, before them."""
    level, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors / np.sqrt(np.maximum(level, 1e-9 * level.max())))


def doubted(found: Sequence[Distilled], rows: int) -> list[float]:
    """Costs as they are where no form is exact, for the curve itself is not: it is that of a
    linearised plant. The form that leaves least a parameter then leaves one standard deviation.
    """
    counts = [len(d.values) + len(d.beside) for d in found]
    left = [d.cost - PRICE * n for d, n in zip(found, counts, strict=True)]
    doubt = max(1.0, min(c / max(rows - n, 1) for c, n in zip(left, counts, strict=True)))
    return [c / doubt + PRICE * n for c, n in zip(left, counts, strict=True)]


def _starts(form: FormLaw, z: Array) -> list[tuple[float, ...]]:
    span = float(z[-1] - z[0])
    found: list[tuple[float, ...]] = [()]
    for shape in (s for s in form.shapes if s != "size"):
        offset = 0.0 if shape == "width" else float(z[0])
        found = [(*f, offset + share * span) for f in found for share in STARTS[shape]]
    return found


@dataclass(frozen=True, eq=False)
class _Fit:
    """A form beside a curve, whitened by `root`; sizes and a constant follow from the shapes, which
    move by shares of the range.
    """

    form: FormLaw
    knots: Knots
    root: Array
    curve: Array  # whitened
    others: Array  # (coefficients, 1 + n): a constant, and what is fitted beside

    @property
    def span(self) -> float:
        return float(self.knots.at[-1] - self.knots.at[0])

    def cost(self, start: tuple[float, ...]) -> float:
        left = self._sized(np.array(start) / self.span)[1]
        return float(left @ left)

    def refined(self, start: tuple[float, ...]) -> Distilled:
        """The best values from a start on."""
        from scipy.optimize import least_squares  # its import is dear, for who learns

        x = np.array(start) / self.span
        if len(x):
            x = least_squares(lambda v: self._sized(v)[1], x, max_nfev=40).x
        found, left = self._sized(x)
        shares = tuple(float(v) for v in found[len(found) - self.others.shape[1] :])
        sizes = (float(v) for v in found[: len(found) - len(shares)])
        values = (*sizes, *self._shapes(x))
        price = PRICE * (len(values) + len(shares) - 1)
        return Distilled(self.form, values, float(left @ left) + price, shares[1:])

    def _shapes(self, x: Array) -> list[float]:
        moved = [k for k in self.form.shapes if k != "size"]
        pairs = zip(x, moved, strict=True)
        return [self.span * (max(abs(v), 1e-3) if kind == "width" else v) for v, kind in pairs]

    def _sized(self, x: Array) -> tuple[Array, Array]:
        """Sizes and shares of the others, and what they leave of the curve."""
        form, knots, rest = self.form, self.knots, self._shapes(x)
        edges = np.array([-2 * knots.width, 2 * knots.width])
        sizes = [0, *(k for k, kind in enumerate(form.shapes, 1) if kind == "size")]
        columns = []
        for k in sizes:
            p = [0.0] * (len(form.shapes) + 1 - len(rest)) + rest
            p[k] = 1.0
            low, high = form.law(edges, p)
            columns.append(knots.seen(form.law(knots.at, p), (float(low), float(high))))
        both = self.root.T @ np.column_stack([*columns, self.others])
        found, *_ = np.linalg.lstsq(both, self.curve, rcond=None)
        return np.asarray(found), np.asarray(self.curve - both @ found)


def line_of(knots: Knots, curve: Array, covariance: Array) -> Distilled | None:
    """The line through a curve, its constant included; None where it has no slope."""
    root = _whitening(covariance)
    edge = 2 * knots.width
    rising = knots.seen(knots.at, (-edge, edge))
    columns = np.column_stack([rising, knots.seen(np.ones(len(knots.at)), (1.0, 1.0))])
    (slope, constant), *_ = np.linalg.lstsq(root.T @ columns, root.T @ curve, rcond=None)
    if slope == 0.0:
        return None
    return Distilled(LINE, (float(slope), float(-constant / slope)), 2 * PRICE)


def _remembering(memory: Memory) -> FormLaw:
    """A memory as a form. Its law is told of rows of z that last a few of its own times."""

    def law(z: Array, p: Sequence[float]) -> Array:
        period = SWEEP * p[1] / len(z)
        return p[0] * memory.walk(np.asarray(z, dtype=float), period, p[1:])

    shapes = ("width",) * memory.shapes
    return FormLaw(memory.name, memory.text, law, shapes, memory=memory)


REMEMBERING = tuple(map(_remembering, MEMORIES))


def memory_of(candidate: Candidate, basis: Remembered) -> Distilled:
    """The memory of a candidate as a form."""
    law = next(f for f in REMEMBERING if f.memory is basis.memory)
    values = (float(candidate.answer.coefficients[0]), *basis.values)
    return Distilled(law, values, PRICE * len(values))


def with_harmonics(values: Sequence[float]) -> tuple[float, ...]:
    """Values of `PERIODIC` that make it the sine of some values."""
    return (*values[:2], *(0.0,) * (2 * HARMONICS - 2), *values[2:])


def wave_of(candidate: Candidate, wave: Wave) -> Distilled:
    """The sine of a candidate. Its size is that of all records."""
    curve = candidate.answer.coefficients.reshape(-1, 2)
    size = float(np.sqrt((curve**2).sum(axis=1).mean()))
    places = -np.arctan2(curve[:, 1], curve[:, 0]) / (2 * np.pi) * wave.period
    law = next(f for f in FORMS if f.name == "sine")
    own = tuple(map(float, places)) if wave.phases > 1 else ()
    values = (size, wave.period, 0.0 if own else float(places[0]))
    return Distilled(law, values, 3 * PRICE, places=own)


@dataclass(frozen=True, eq=False)
class FreeCurve:
    """The curve of a candidate, as a sum of shapes: itself, and what the logs tell best beside it;
    the prior spread of each is 1.
    """

    knots: Knots
    shapes: Array  # (coefficients, COUNT)
    rest: Array  # covariance of what the shapes leave out
    start: Distilled

    def curve(self, values: Sequence[float], covariance: Array) -> tuple[Array, Array]:
        """Coefficients of the knots and their covariance, from those of the shapes' sizes."""
        spread = self.shapes @ covariance @ self.shapes.T + self.rest
        return self.shapes @ np.asarray(values), spread


def free_curve(candidate: Candidate, knots: Knots) -> FreeCurve:
    """See `FreeCurve`; it starts from the candidate's coefficients."""
    shapes, rest = _telling(candidate, knots, SHAPES)
    values = np.linalg.lstsq(shapes, candidate.answer.coefficients, rcond=None)[0]
    made = FormLaw(
        "curve",
        _text(knots, SHAPES),
        _law(knots, shapes),
        ("size",) * (SHAPES - 1),
        _tables(knots, shapes),
    )
    return FreeCurve(
        knots, shapes, rest, Distilled(made, tuple(map(float, values)), PRICE * SHAPES)
    )


def _telling(candidate: Candidate, knots: Knots, count: int) -> tuple[Array, Array]:
    """Shapes (coefficients, count), and the covariance of what they leave out. In units of the
    prior: first the curve itself, then the directions of which the logs tell most.
    """
    answer, precision = candidate.answer, knots.prior(candidate.size, candidate.bend)
    root = np.linalg.cholesky(np.linalg.inv(precision))
    own = np.linalg.solve(root, answer.coefficients)
    first = own / (np.linalg.norm(own) + 1e-300)
    apart = np.eye(len(own)) - np.outer(first, first)
    told = root.T @ (np.linalg.inv(answer.covariance) - precision) @ root
    _, vectors = np.linalg.eigh(apart @ told @ apart)
    basis = np.column_stack([first, vectors[:, ::-1][:, : count - 1]])
    left = np.eye(len(own)) - basis @ basis.T
    spread = np.linalg.solve(root, np.linalg.solve(root, answer.covariance).T)
    return root @ basis, root @ left @ spread @ left.T @ root.T


def _law(knots: Knots, shapes: Array) -> Law:
    def law(z: Array, p: Sequence[float]) -> Array:
        return np.asarray(knots.shapes(np.atleast_1d(z)) @ (shapes @ np.asarray(p)))

    return law


def _tables(knots: Knots, shapes: Array) -> tuple[tuple[str, Array], ...]:
    """Parameters of a curve: the first knot, the step, shapes at the knots and their jumps."""
    at = knots.at
    made = [("z0", at[0]), ("dz", at[1] - at[0]), ("z_t", knots.width)]
    made += [(f"table_{k}", shape[: len(at)]) for k, shape in enumerate(shapes.T, 1)]
    if knots.jumps:
        made += [(f"jump_{k}", shape[-1]) for k, shape in enumerate(shapes.T, 1)]
    return tuple((name, np.atleast_1d(np.asarray(v, dtype=float))) for name, v in made)


def _text(knots: Knots, count: int) -> str:
    size = len(knots.at)
    share = f"min(max((z - z0)/dz, 0), {size - 1})"
    sums = " + ".join(f"p{k}*table_{k}[i]" for k in range(1, count + 1))
    text = f"sum(({sums})*max(1 - abs({share} - (i - 1)), 0) for i in 1:{size})"
    if knots.jumps:
        text += f" + ({' + '.join(f'jump_{k}*p{k}' for k in range(1, count + 1))})*tanh(z/z_t)"
    return text
