"""Levenberg-Marquardt over many views at once.

The views hang together by few coordinates. A view that a step makes worse gets its own coordinates
back and a shorter step next time, so that one rough view does not stop the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement

import numpy as np

from pneugantry.engine.fitting import noise
from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.plant import Array
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.simulation import Cell, Columns, Point, Residuals, Simulation

__all__ = [
    "FAILED",
    "LARGE",
    "Parabola",
    "Problem",
    "Solution",
    "Tangent",
    "Weighing",
    "descend",
    "flat_noise",
    "foretold",
    "inside",
    "newton",
    "of_view",
    "prior",
    "probed",
    "standing",
]

TRIES = 4  # damped steps from one point
BACKS = 3  # steps back to the valley that the first of them left
SHORTER = (0.5, 0.2, 0.08)  # shares of a step along a valley that is too bent for the whole of it
FAILED = 1e12  # stands for a simulation that failed
LEAST = 1e-9  # damping; more would keep combinations that the data leave open from their priors
LARGE = 5.0  # standard deviations of what stands out
FARTHEST = 6.0  # prior spreads to which a point about an end may be moved
PROBES = (-30.0, -10.0, -3.0, 3.0, 10.0, 30.0)  # standard deviations
ALIKE = 0.8  # correlation from which on two coordinates are moved as one
FIRST = 0.3  # damping after a step that failed; less hardly changes a step
LONGER = 10.0  # by which it grows after each further one
KEPT = 0.7  # share of a view's predicted fall by which it may be missed and its columns serve again
TAKEN = 0.1  # share of a step's predicted fall from which on it is taken
SHARED = 0.2  # share of what a step falls short from which on a view is to blame
FLAT = 1e-2  # of the largest change per theta: directions along which columns are made anew
ALONG = 0.02  # of theta, the step along them
LONG = 4.0  # times as long is another step
SAME = 0.5  # of an error, by which those over both may differ
WORTH = 0.05  # of the fall that ends a descent: a step of which less is predicted is not tried
HOPED = 0.5  # of the same: a descent from which less is predicted, undamped, is over


class Weighing:
    """Residuals as costs and normal equations, under given noise."""

    def __init__(self, of_views: Noise, rules: Rules) -> None:
        self.noise, self.freedom = of_views, rules.tails
        self._white: dict[Cell, tuple[list[Array], Array]] = {}  # columns, and as innovations
        self._left: dict[Cell, tuple[Array, Array]] = {}  # a residual, and as innovations

    def of_residual(self, cell: Cell, residual: Array) -> Array:
        """Innovations (rows,) of a cell's residual; kept as long as it is the same array."""
        kept = self._left.get(cell)
        if kept is None or kept[0] is not residual:
            self._left[cell] = kept = (residual, self.innovations(cell, residual))
        return kept[1]

    def innovations(self, cell: Cell, values: Array) -> Array:
        """Whitened residual or columns (..., rows, signals) of a cell, its signals in turn."""
        white = [w(values[..., c]) for c, w in enumerate(self.noise[cell])]
        return white[0] if len(white) == 1 else np.concatenate(white, axis=-1)

    def whitened(self, columns: Columns, cell: Cell, names: Sequence[str]) -> Array:
        """Innovations (columns, rows) of columns of a cell; kept as long as these are the same."""
        own = [columns[cell, name] for name in names]
        kept, white = self._white.get(cell, ([], np.zeros((0, 0))))
        if len(kept) != len(own) or any(a is not b for a, b in zip(kept, own, strict=True)):
            white = self.innovations(cell, np.stack(own))
            if not np.isfinite(white).all():
                white = np.nan_to_num(white)
            self._white[cell] = own, white
        return white

    def costs(self, residuals: Residuals) -> dict[str, float]:
        """-2 log likelihood by view."""
        found: dict[str, float] = {}
        for cell, r in residuals.items():
            cost = FAILED
            if np.isfinite(r).all():
                cost = float(noise.loss(self.of_residual(cell, r), self.freedom).sum())
            found[cell[0]] = found.get(cell[0], 0.0) + cost
        return found

    def tails(self, residuals: Residuals) -> float:
        """-2 log likelihood of what stands out alone."""
        total = 0.0
        for cell, r in residuals.items():
            w = np.nan_to_num(self.innovations(cell, r))
            total += float(noise.loss(w[np.abs(w) > LARGE], self.freedom).sum())
        return total

    def normal(self, point: Point, residuals: Residuals, columns: Columns) -> tuple[Array, Array]:
        """J'WJ and J'Wr over all cells."""
        names = [c.name for c in point.coordinates]
        normal, gradient = np.zeros((len(names), len(names))), np.zeros(len(names))
        for cell, r in residuals.items():
            index = [i for i, name in enumerate(names) if (cell, name) in columns]
            if index and np.isfinite(r).all():
                w = self.of_residual(cell, r)
                root = np.sqrt(noise.weights(w, self.freedom))
                j = self.whitened(columns, cell, [names[i] for i in index]) * root
                normal[np.ix_(index, index)] += j @ j.T
                gradient[index] += j @ (w * root)
        return normal, gradient


@dataclass(frozen=True, eq=False)
class Parabola:
    """A cost near its least, theta' square theta - 2 pull' theta + a constant, of the coordinates
    named.
    """

    names: tuple[str, ...]
    square: Array
    pull: Array

    def among(self, names: Sequence[str]) -> Parabola:
        """The same over other coordinates, these among them."""
        square, pull = np.zeros((len(names), len(names))), np.zeros(len(names))
        index = [names.index(n) for n in self.names]
        square[np.ix_(index, index)] = self.square
        pull[index] = self.pull
        return Parabola(tuple(names), square, pull)

    def plus(self, other: Parabola) -> Parabola:
        added = other.among(self.names)
        return Parabola(self.names, self.square + added.square, self.pull + added.pull)

    def of(self, free: Collection[str], theta: Array) -> Parabola:
        """The same over some coordinates, the others kept at theta."""
        own = np.array([n in free for n in self.names])
        names = tuple(n for n in self.names if n in free)
        pull = self.pull[own] - self.square[np.ix_(own, ~own)] @ theta[~own]
        return Parabola(names, self.square[np.ix_(own, own)], pull)

    def cost(self, theta: Array) -> float:
        return float(theta @ self.square @ theta - 2 * self.pull @ theta)

    def least(self) -> Array:
        return np.asarray(np.linalg.solve(self.square, self.pull))


@dataclass(frozen=True, eq=False)
class Problem:
    """What is fitted, to which cells; `prior`: what else is known of the coordinates."""

    simulation: Simulation
    rules: Rules
    cells: tuple[Cell, ...]
    prior: Parabola
    fine: bool = True  # columns by small steps: exact between events; else they look over them


@dataclass(frozen=True, eq=False)
class Tangent:
    """Where the columns of a cell were made, by small steps."""

    point: Point
    residual: Array


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a descent stands; residuals and columns of all cells, those that it leaves included."""

    point: Point
    residuals: Residuals
    columns: Columns
    settled: bool = False  # no step from this point led down, under columns that foretell it
    tangents: Mapping[Cell, Tangent] = field(default_factory=dict)  # none: not by small steps

    def with_columns(self, made: Columns, cells: Collection[Cell], fine: bool) -> Solution:
        """The same with columns of this point in some cells. fine: by small steps."""
        tangents = {c: t for c, t in self.tangents.items() if c not in cells}
        if fine:
            tangents |= {c: Tangent(self.point, self.residuals[c]) for c in cells}
        return Solution(self.point, self.residuals, {**self.columns, **made}, tangents=tangents)

    def elsewhere(self, cells: Collection[Cell]) -> set[str]:
        """Views with columns of other points."""
        theta, own = self.point.theta, {c: t for c, t in self.tangents.items() if c in cells}
        return {c[0] for c, t in own.items() if not np.array_equal(t.point.theta, theta)}


def descend(
    problem: Problem,
    start: Solution,
    of_views: Noise | None,
    converged: float,
    hopeless: Callable[[int, Solution], bool] = lambda steps, solution: False,
) -> Solution:
    """Least cost from a start on.

    of_views: the noise; None: white, as large as the residuals are at each step (the widest basin).
    converged: fall of the cost that ends it. hopeless: told how many steps led where; ends it, too.
    """
    sim, rules, state = problem.simulation, problem.rules, start
    names = set(problem.prior.names)
    first = LEAST if problem.fine else rules.damping
    damping = np.full(len(names), first)
    views = {c[0] for c in problem.cells}
    old: set[str] = set()  # views whose columns are those of an earlier point
    kept = start.elsewhere(problem.cells)  # whose columns have served elsewhere, so far
    known = None if of_views is None else Weighing(of_views, rules)
    renewed: Point | None = None  # where columns were made anew along a valley
    for steps in range(rules.iterations):
        if hopeless(steps, state):
            break
        weighing = known or Weighing(flat_noise(sim, state.residuals), rules)
        ahead = _Ahead(problem, state, weighing)
        if ahead.towards(np.full(len(names), LEAST), 1.0).predicted < HOPED * converged:
            break
        step = _step(ahead, damping, converged)
        failed = problem.fine and (step is None or step.short)
        if failed and not (old or kept) and state.point is not renewed:
            renewed, along = state.point, _along_valley(ahead)
            if along is not None:
                state, damping[:] = along, LEAST
                continue
        if step is None:
            if not (old or kept):
                break
            stale = set(old)
            if kept:  # these columns have failed
                stale, kept, damping[:] = kept, set(), first
        else:
            state, stale, old, kept = step.solution, set(step.stale), set(views), set()
            if step.fall < converged and not step.short:
                break
        if stale:
            cells = [c for c in problem.cells if c[0] in stale]
            made = sim.columns(state.point, state.residuals, cells, names, problem.fine)
            state = state.with_columns(made, cells, problem.fine)
            old -= stale
    return state


def _along_valley(ahead: _Ahead) -> Solution | None:
    """With columns that hold along a valley, where they all but cancel each other and the jumps
    that a solver makes over a small step are what is left. None where the step from here is not
    worth it, or no cell's columns miss it by as much.
    """
    problem, at, weighing = ahead.problem, ahead.state, ahead.weighing
    sim, point = problem.simulation, at.point
    step = -np.linalg.solve(ahead.normal, ahead.gradient)
    hoped = -float(ahead.gradient @ step)
    if hoped < problem.rules.entry:
        return None
    along = step * ALONG / np.linalg.norm(step)
    share = SHARED * hoped * float(along @ along / (step @ step))
    cells = [c for c, e in _missed(sim, at, problem.cells, along, weighing) if e > share]
    sizes, directions = np.linalg.eigh(ahead.curved)
    inner = (_inward(point, v) for v in directions.T[sizes < FLAT**2 * sizes[-1]])
    flat = np.array([v for v in inner if v is not None])
    if not cells or len(flat) == 0:
        return None
    points = [point.moved(point.theta + ALONG * v) for v in flat]
    found = sim.run({c: [p.values(c[1]) for p in points] for c in cells})
    columns = dict(at.columns)
    for cell in cells:
        if not all(np.isfinite(r).all() for r in found[cell]):
            continue
        index = [i for i, c in enumerate(point.coordinates) if (cell, c.name) in columns]
        names = [point.coordinates[i].name for i in index]
        made = (np.stack(found[cell]) - at.residuals[cell]) / ALONG
        own, within = np.stack([columns[cell, n] for n in names]), flat[:, index]
        missed = made - np.tensordot(within, own, 1)
        renewed = own + np.tensordot(np.linalg.pinv(within, rcond=FLAT), missed, 1)
        columns |= {(cell, n): c for n, c in zip(names, renewed, strict=True)}
    return replace(
        at, columns=columns, tangents={c: t for c, t in at.tangents.items() if c not in cells}
    )


def _inward(point: Point, direction: Array) -> Array | None:
    """A direction or its opposite, whichever passes no bound."""
    for own in (direction, -direction):
        theta = point.theta + ALONG * own
        if np.array_equal(inside(point.moved(theta)).theta, theta):
            return own
    return None


def _missed(
    sim: Simulation, at: Solution, cells: Sequence[Cell], step: Array, weighing: Weighing
) -> list[tuple[Cell, float]]:
    """By how much columns miss what a step changes in each cell, squared, where they miss as much
    of a longer one: else it is an event, or bends.
    """
    points = [at.point.moved(at.point.theta + k * step) for k in (1.0, LONG)]
    found = sim.run({c: [p.values(c[1]) for p in points] for c in cells})
    told = foretold(at, cells, step)
    off = []
    for cell in cells:
        if not all(np.isfinite(r).all() for r in found[cell]):
            continue
        near, far = found[cell]
        missed = weighing.innovations(cell, near - told[cell])
        own = (far - at.residuals[cell]) / LONG - (near - at.residuals[cell])
        if np.linalg.norm(weighing.innovations(cell, own)) < SAME * np.linalg.norm(missed):
            off.append((cell, float(missed @ missed)))
    return off


def probed(problem: Problem, start: Solution, of_views: Noise) -> Solution | None:
    """The best of some points about a solution: each coordinate moved by some of its standard
    deviations, the others following so that the parabola hardly rises; and optima that lie side by
    side, the others kept. Tried is what only large
    residuals tell: records where these cost a view much. None where no point is better.
    """
    sim, rules, point = problem.simulation, problem.rules, start.point
    weighing = Weighing(of_views, rules)
    normal, _ = weighing.normal(point, start.residuals, start.columns)
    covariance: Array = np.asarray(np.linalg.inv(normal + problem.prior.square))
    sigma = np.sqrt(np.diag(covariance))
    spreads = np.array([c.spread for c in point.coordinates])
    farthest = np.maximum(np.abs(point.theta), FARTHEST * spreads)
    best: tuple[float, Array] | None = None
    for view in dict.fromkeys(c[0] for c in problem.cells):
        own = {
            c: r
            for c, r in start.residuals.items()
            if c[0] == view and weighing.tails({c: r}) > rules.entry
        }
        if not own:
            continue
        columns = {k: c for k, c in start.columns.items() if k[0] in own}
        curved, slope = weighing.normal(point, own, columns)
        rest = normal + problem.prior.square - curved
        read = {name for _, name in columns}
        index = [i for i, c in enumerate(point.coordinates) if c.name in read]
        moves = [k * covariance[:, i] / sigma[i] for i in _apart(covariance, index) for k in PROBES]
        moves += _side_by_side(point, index)
        moves = [m for m in moves if np.all(np.abs(point.theta + m) <= farthest)]
        tried = [inside(point.moved(point.theta + m)) for m in moves]
        found = sim.run({c: [t.values(c[1]) for t in tried] for c in own})
        before = weighing.costs(own)[view]
        for i, move in enumerate(moves):
            after = weighing.costs({c: found[c][i] for c in own})[view]
            fall = before - after - float(move @ rest @ move - 2 * slope @ move)
            if best is None or fall > best[0]:
                best = fall, move
    if best is None or best[0] < rules.entry:
        return None
    moved = inside(point.moved(point.theta + best[1]))
    residuals = sim.residuals(moved, problem.cells)
    return Solution(moved, residuals, start.columns, tangents=start.tangents)


def _apart(covariance: Array, index: Sequence[int]) -> list[int]:
    """Coordinates of which no two move each other `ALIKE` much: one stands for the others."""
    sigma = np.sqrt(np.diag(covariance))
    kept: list[int] = []
    for i in index:
        if all(abs(covariance[i, j]) < ALIKE * sigma[i] * sigma[j] for j in kept):
            kept.append(i)
    return kept


def _side_by_side(point: Point, index: Sequence[int]) -> list[Array]:
    """Moves (coordinates,) to optima that lie side by side: by a step of one coordinate, or there
    and back by steps of two that make up for each other; within bounds.
    """
    steps = [(i, point.coordinates[i].step) for i in index if point.coordinates[i].step]
    moves = []
    for (i, own), (j, other) in combinations_with_replacement(steps, 2):
        for way in (-1.0, 1.0):
            move = np.zeros(len(point.theta))
            move[j] -= way * other * (i != j)
            move[i] += way * own
            moves.append(inside(point.moved(point.theta + move)).theta - point.theta)
    return [m for m in moves if np.any(m)]


def flat_noise(simulation: Simulation, residuals: Residuals) -> Noise:
    """White noise, in each view of its residuals' own size."""
    of_views = {
        name: tuple(
            noise.flat([r[:, c] for r in of_view(residuals, name)], sigma)
            for c, sigma in enumerate(simulation.views[name].sigmas)
        )
        for name in dict.fromkeys(c[0] for c in residuals)
    }
    return {cell: of_views[cell[0]] for cell in residuals}


def standing(problem: Problem, solution: Solution) -> float:
    """-2 log posterior under white noise of the residuals' own size."""
    residuals = {c: solution.residuals[c] for c in problem.cells if c in solution.residuals}
    if not all(np.isfinite(r).all() for r in residuals.values()):
        return FAILED
    flat = flat_noise(problem.simulation, residuals)
    cost = sum(Weighing(flat, problem.rules).costs(residuals).values())
    cost += sum(2 * len(r) * math.log(w.sigma) for cell, r in residuals.items() for w in flat[cell])
    return cost + problem.prior.cost(solution.point.theta)


def of_view(residuals: Residuals, view: str) -> list[Array]:
    """A view's residuals, record after record."""
    return [r for (v, _), r in residuals.items() if v == view]


def prior(coordinates: Sequence[Coordinate]) -> Parabola:
    """-2 log prior."""
    precision = np.array([c.spread for c in coordinates]) ** -2.0
    names = tuple(c.name for c in coordinates)
    return Parabola(names, np.diag(precision), np.zeros(len(names)))


def inside(point: Point) -> Point:
    """A point with what lies beyond its bounds brought back to them."""
    theta = point.theta.copy()
    for i, c in enumerate(point.coordinates):
        if not c.logarithmic or c.low > 0:
            value = c.value(theta[i])
            if value in (c.low, c.high):
                theta[i] = c.theta(value)
    return point.moved(theta)


@dataclass(frozen=True, eq=False)
class _Step:
    """A step taken."""

    solution: Solution
    fall: float  # of the cost
    stale: frozenset[str]  # views that did not do what their columns predicted
    short: bool  # whether it is a share of what was predicted to be worth a step


@dataclass(frozen=True, eq=False)
class _Trial:
    """A point to try, and once it was run what is left there."""

    point: Point
    predicted: float  # fall of the cost
    by_view: Mapping[str, float]  # predicted
    fall: float = 0.0
    falls: Mapping[str, float] = field(default_factory=dict)  # by view; predicted where not run
    residuals: Residuals = field(default_factory=dict)
    left: tuple[Cell, ...] = ()  # that were not run: the others had told enough

    def missed(self, view: str) -> float:
        """By how much a view's cost fell less than predicted."""
        return self.by_view[view] - self.falls[view]


class _Ahead:
    """What columns tell of steps from a point."""

    def __init__(self, problem: Problem, state: Solution, weighing: Weighing) -> None:
        self.problem, self.state, self.weighing = problem, state, weighing
        known, theta = problem.prior, state.point.theta
        self.costs = weighing.costs(state.residuals)
        self.parts = {v: weighing.normal(state.point, *_of(state, v)) for v in self.costs}
        self.curved = sum((n for n, _ in self.parts.values()), np.zeros_like(known.square))
        self.normal = known.square + self.curved
        self.gradient = known.square @ theta - known.pull + sum(g for _, g in self.parts.values())

    def damped(self, damping: Array) -> Array:
        return np.asarray(self.normal + np.diag(damping * np.diag(self.normal)))

    def towards(self, damping: Array, share: float) -> _Trial:
        """The share of a damped step."""
        point = self.state.point
        end = newton(point, self.damped(damping), self.gradient)
        if share < 1:
            end = inside(point.moved(point.theta + share * (end.theta - point.theta)))
        made = end.theta - point.theta
        by_view = {v: -float(made @ (2 * g + n @ made)) for v, (n, g) in self.parts.items()}
        return _Trial(end, -float(made @ (2 * self.gradient + self.normal @ made)), by_view)

    def run(self, trial: _Trial, first: Collection[str], least: float) -> _Trial:
        """A trial with what it leaves. first: views that are run first; where the cost falls by no
        more than `least` whatever the others do as predicted, these are not.
        """
        known, theta = self.problem.prior, self.state.point.theta
        falls, tried = dict(trial.by_view), dict(self.state.residuals)
        left = [c for c in self.problem.cells if c[0] in self.costs]
        fall = 0.0
        for views in (set(first), set(self.costs) - set(first)):
            cells = [c for c in left if c[0] in views]
            left = [c for c in left if c[0] not in views]
            found = self.problem.simulation.residuals(trial.point, cells) if cells else {}
            tried |= found
            falls |= {v: self.costs[v] - after for v, after in self.weighing.costs(found).items()}
            fall = sum(falls.values()) + known.cost(theta) - known.cost(trial.point.theta)
            if fall <= least:
                break
        return replace(trial, fall=fall, falls=falls, residuals=tried, left=tuple(left))

    def stale(self, trial: _Trial, converged: float) -> frozenset[str]:
        """Views that did not do what their columns predicted."""
        least = {v: max(converged, KEPT * abs(p)) for v, p in trial.by_view.items()}
        return frozenset(v for v in self.costs if abs(trial.missed(v)) > least[v])

    def spoiling(self, trial: _Trial) -> set[str]:
        """Views to which most of what a trial falls short is due."""
        short = trial.predicted - trial.fall
        return {v for v in self.costs if trial.missed(v) > SHARED * short}

    def moving(self, views: Collection[str]) -> Array:
        """Coordinates (of theta,) that move any of some views."""
        moved = (self.parts[v][0] for v in views or self.costs)
        return np.asarray(np.diag(sum(moved, np.zeros_like(self.normal))) > 0)

    def back(self, trial: _Trial, damping: Array, share: float) -> Point | None:
        """From where a step failed back to the valley that it left, by the same columns: a valley
        is bent where some of what may grow together is fitted as its logarithm. share: of the step
        that it was, which was to leave the rest of the slope. None where a simulation failed.
        """
        state, known = self.state, self.problem.prior
        theta = trial.point.theta
        tried = trial.residuals | foretold(state, trial.left, theta - state.point.theta)
        if not all(np.isfinite(r).all() for r in tried.values()):
            return None
        _, slope = self.weighing.normal(trial.point, tried, state.columns)
        slope = slope + known.square @ theta - known.pull - (1 - share) * self.gradient
        return newton(trial.point, self.damped(damping), slope)


def _step(ahead: _Ahead, damping: Array, converged: float) -> _Step | None:
    """A step that lowers the cost; None where none is predicted or found. A view that falls short
    of what is predicted gets shorter steps. Renews `damping` in place.
    """
    problem, best = ahead.problem, None
    worst: set[str] = set()  # views that spoilt a try: the next one runs them first
    share, shorter = 1.0, list(SHORTER) if problem.fine else []
    tries = 0
    while tries < TRIES:
        trial = ahead.towards(damping, share)
        if trial.predicted < WORTH * converged:
            break
        backs: list[float] = []  # falls of the tries that led back to the valley
        while True:
            lowest = best.fall if best else 0.0
            trial = ahead.run(trial, worst, max(backs, default=lowest))
            if trial.fall > lowest:
                at = ahead.state
                end = Solution(trial.point, trial.residuals, at.columns, tangents=at.tangents)
                best = _Step(end, trial.fall, ahead.stale(trial, converged), share < 1)
            if trial.fall > TAKEN * trial.predicted:
                damping[:] = np.maximum(0.1 * damping, LEAST)
                return best
            worst = ahead.spoiling(trial)
            onward = problem.fine and tries == 0 and len(backs) < BACKS
            if not onward or trial.fall <= max(backs, default=-FAILED):
                break
            bent = ahead.back(trial, damping, share)
            if bent is None:
                break
            backs.append(trial.fall)
            trial = replace(trial, point=bent)
        if tries == 0 and shorter and trial.predicted > problem.rules.entry:
            share = shorter.pop(0)
            continue
        share, tries = 1.0, tries + 1
        short = ahead.moving(worst)
        damping[short] = np.maximum(LONGER * damping[short], FIRST)
    return best


def foretold(state: Solution, cells: Sequence[Cell], made: Array) -> Residuals:
    """Residuals of some cells after a step, as their columns tell."""
    found = {c: state.residuals[c].copy() for c in cells}
    for c, step in zip(state.point.coordinates, made, strict=True):
        for cell in cells:
            if (cell, c.name) in state.columns:
                found[cell] += step * state.columns[cell, c.name]
    return found


def newton(point: Point, square: Array, slope: Array) -> Point:
    """Where a slope ends; what would pass a bound stops at it, and the rest goes on as it tells."""
    step, free = np.zeros(len(slope)), np.full(len(slope), True)
    while True:
        pull = slope[free] + square[np.ix_(free, ~free)] @ step[~free]
        step[free] = -np.linalg.solve(square[np.ix_(free, free)], pull)
        wanted = point.theta + step
        reached = inside(point.moved(wanted))
        stopped = free & (reached.theta != wanted)
        if not stopped.any():
            return reached
        step[stopped] = (reached.theta - point.theta)[stopped]
        free &= ~stopped


def _of(state: Solution, view: str) -> tuple[Residuals, Columns]:
    """Residuals and columns of one view."""
    return (
        {c: r for c, r in state.residuals.items() if c[0] == view},
        {k: c for k, c in state.columns.items() if k[0][0] == view},
    )
