"""Levenberg-Marquardt over many views at once.

The views hang together by few coordinates. A view that a step makes worse gets its own coordinates
back and a shorter step next time, so that one rough view does not stop the others.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pneugantry.engine.fitting.noise import Noise
from pneugantry.engine.fitting.problem import Problem, Solution, inside, newton, predicted
from pneugantry.engine.fitting.weighing import FAILED, Weighing, flat_noise
from pneugantry.engine.plant import Array
from pneugantry.engine.views.simulation import Cell, Point, Residuals, Simulation

__all__ = ["descend"]

TRIES = 4  # damped steps from one point
BACKS = 3  # steps back to the valley that the first of them left
SHORTER = (0.5, 0.2, 0.08)  # shares of a step along a valley that is too bent for the whole of it
LEAST = 1e-9  # damping; more would keep combinations that the data leave open from their priors
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
        hoped = ahead.towards(np.full(len(names), LEAST), 1.0).predicted
        over = hoped < HOPED * converged
        step = None if over else _step(ahead, damping, converged)
        failed = problem.fine and not over and (step is None or step.short)
        if failed and not (old or kept) and state.point is not renewed:
            renewed, along = state.point, _along_valley(ahead)
            if along is not None:
                state, damping[:] = along, LEAST
                continue
        if problem.fine and (step is None or step.short or step.fall < converged):
            step = _past_event(ahead, hoped) or step
        if over and step is None:
            break
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


def _past_event(ahead: _Ahead, hoped: float) -> _Step | None:
    """A step as if nothing were known of the cell without which most is hoped for: what its columns
    tell may be an event's, which any small step of one parameter brings and this one does not. None
    where it lowers the cost no further than what is hoped with that cell.
    """
    state, least = ahead.state, hoped + ahead.problem.rules.entry
    trials = [ahead.without(cell) for cell in ahead.by_cell]
    trial = max(trials, key=lambda t: t.predicted)
    if trial.predicted < least:
        return None
    trial = ahead.run(trial, ahead.costs, least)
    if trial.fall < max(least, TAKEN * trial.predicted):
        return None
    end = Solution(trial.point, trial.residuals, state.columns, tangents=state.tangents)
    return _Step(end, trial.fall, frozenset(ahead.costs), True)


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
    told = predicted(at, cells, step)
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
        self.by_cell = {
            c: weighing.normal(state.point, {c: r}, state.columns)
            for c, r in state.residuals.items()
        }
        self.parts = {
            v: _summed([p for c, p in self.by_cell.items() if c[0] == v]) for v in self.costs
        }
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
        return self._trial(end, self.normal, self.gradient)

    def without(self, cell: Cell) -> _Trial:
        """The step of all but one cell, which is taken to change nothing there."""
        normal, gradient = self.by_cell[cell]
        normal, gradient = self.normal - normal, self.gradient - gradient
        return self._trial(newton(self.state.point, normal, gradient), normal, gradient)

    def _trial(self, end: Point, normal: Array, gradient: Array) -> _Trial:
        made = end.theta - self.state.point.theta
        by_view = {v: -float(made @ (2 * g + n @ made)) for v, (n, g) in self.parts.items()}
        return _Trial(end, -float(made @ (2 * gradient + normal @ made)), by_view)

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
        tried = trial.residuals | predicted(state, trial.left, theta - state.point.theta)
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


def _summed(parts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Normal matrix and gradient of some cells."""
    normals, gradients = zip(*parts, strict=True)
    return np.sum(normals, axis=0), np.sum(gradients, axis=0)
