"""The bench on which hypotheses are tried: the views of one campaign, fitted under tolerance and
any effects.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pneugantry.diagnosis.fit import (
    Coordinate,
    Fit,
    balanced,
    both,
    effect_coordinate,
    fit,
    predict,
    tolerance_coordinate,
)
from pneugantry.diagnosis.mechanics import MechanicsView, smoothed
from pneugantry.diagnosis.parallel import each
from pneugantry.diagnosis.signals import SENSOR_NEUTRAL, Table, table_of
from pneugantry.diagnosis.views import (
    ContactView,
    FrictionView,
    SensorView,
    SignalStore,
    TimingView,
    ValveView,
    View,
)
from pneugantry.diagnosis.whitening import correlation_length, innovations, robust_segments
from pneugantry.engine.catalogue import Effect, Form
from pyfmi_runner.block_fmu import BlockFmu
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import Campaign
from pyfmi_runner.fmu import FmuFile

__all__ = [
    "FLOOR",
    "FLOOR_LENGTH",
    "FLOOR_MOST",
    "TOLERANCE",
    "Bench",
    "Choice",
    "Outcome",
    "joined",
    "nominal_values",
]

Array = NDArray[np.float64]
TOLERANCE = 0.02  # RMS share by which a rig's parameters are off (docs/reference/gap.md)
# Set by the valves' electronics and by the friction model's own regularisation, not by the rig's
# mechanics: seen exact on both labelled example campaigns (within 0.01 % and 0.7 %), so hardly any
# tolerance. C_c: what the smoothed speed leaves of it is biased by a tenth.
TIGHT_TOLERANCE = {"u_0": 0.001, "v_th": 0.005, "C_c": 0.15}
JUDGED = ("valve_x", "valve_z", "friction_x", "friction_z", "contact", "sensors", "timing")
GOOD_MECHANICS = 1.2  # RMS of the freely run mechanics at which no other start is tried
# share of the time in which a carriage is led back, for another way to a fit that may have stuck
HALF = 0.5
LOOSE = 0.2  # s in which the mechanics are led back to the measured ones, at first
GOOD_VALVE = 1.03  # RMS of a valve view whose output is taken for the force itself
KEPT = 400  # residual vectors
# on the floor of timing, where a coarse reading's rounding in the log stays the same for long, and
# is integrated
COARSE_TIMING = 30.0
FOLD = 5  # samples averaged to one: what hypotheses differ in is slower
# folded samples, half a second of one channel: a stretch that counts as one piece of evidence
BLOCK = 100
CLASSES = {
    "valve": "PneuGantry.Valve",
    "friction": "PneuGantry.Cylinder",
    "contact": "PneuGantry.Edge",
}
# RMS of each view's white residual where its block is right: what rounding, window starts and the
# smoothed position's error leave. Read off the nominal campaign and a handful of tolerance-only
# development cases, rounded up.
FLOOR = {
    "valve_x": 1.003,
    "valve_z": 1.003,
    "friction_x": 1.02,
    "friction_z": 1.10,
    "contact": 0.98,
    "sensors": 1.004,
    "timing": 1.5,
}
# Folded samples that say the same, at least: what smoothing and leading leave is not noise, and a
# fit that follows it is no evidence.
LEAST_LENGTH = {"friction_x": 2.0, "friction_z": 4.0, "contact": 6.0}
# The same of the floor itself, where it is the same on every rig: a misfit is held against that
# scatter, not against its own.
FLOOR_LENGTH = {"valve_x": 1.0, "valve_z": 1.0, "sensors": 1.0} | {
    view: LEAST_LENGTH[view] for view in ("friction_x", "contact")
}
FLOOR_MOST = (
    "friction_x",
    "contact",
)  # views whose floor is the most that is left on any sound rig, scatter and all
SMOOTHING = (
    1.0,
    200.0,
    # contact view: error of the smoothed position, in units of the force noise, and its length in
    # samples
)


def joined(a: Outcome, b: Outcome) -> Outcome:
    """Two hypotheses whose views do not overlap as one."""
    return Outcome(
        Choice((*a.choice.effects, *b.choice.effects)),
        both(a.fit, b.fit),
        {**a.squares, **b.squares},
        {**a.counts, **b.counts},
        {**a.lengths, **b.lengths},
        (*a.views, *b.views),
        a.floor,
        {**a.blocks, **b.blocks},
    )


def nominal_values(gantry: FmuFile) -> dict[str, float]:
    """Parameters of the nominal FMU."""
    return {
        name: float(v.start)
        for name, v in gantry.variables.items()
        if v.causality == "parameter" and v.start is not None
    }


@dataclass(frozen=True)
class Choice:
    """A hypothesis: effects, each in one of its forms. Empty: tolerance alone."""

    effects: tuple[tuple[Effect, Form], ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        return tuple(effect.key for effect, _ in self.effects)

    def plus(self, effect: Effect, form: Form) -> Choice:
        return Choice((*self.effects, (effect, form)))

    @property
    def outside(self) -> tuple[Effect, ...]:
        """Its rough forms of what the catalogue lacks."""
        return tuple(effect for effect, _ in self.effects if effect.outside)

    @property
    def settings(self) -> dict[str, float]:
        return {name: value for _, form in self.effects for name, value in form.settings.items()}

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(p.name for _, form in self.effects for p in form.parameters)


@dataclass(eq=False)
class Outcome:
    """A hypothesis fitted on some views: values of all parameters and, by view, the misfit."""

    choice: Choice
    fit: Fit
    squares: dict[str, float]  # by view: sum of squares of its white residual
    counts: dict[str, int]
    lengths: dict[str, float]  # by view: correlation length of its residual
    views: tuple[str, ...] = field(default=())
    floor: Mapping[str, float] = field(default_factory=lambda: FLOOR)  # by view
    blocks: dict[str, Array] = field(
        default_factory=dict
    )  # by view: sum of squares of each stretch of BLOCK samples

    @property
    def values(self) -> dict[str, float]:
        return {**self.choice.settings, **self.fit.values}

    @property
    def objective(self) -> float:
        """Sum of squares plus prior."""
        return sum(self.squares.values()) + self.fit.penalty

    def rms(self, view: str) -> float:
        return math.sqrt(self.squares[view] / max(self.counts[view], 1))

    def evidence(self, lengths: Mapping[str, float]) -> float:
        """-2 log evidence over its views; `lengths` (correlation lengths) must be those of all
        hypotheses that are compared.

        The noise's variance is known to be at least 1; where no hypothesis reaches that it is
        estimated, so that a misfit counts by its logarithm and not as if the rest were noise of
        known size.
        """
        return (
            sum(float(self.surprise(view, lengths[view]).sum()) for view in self.views)
            + self.charge
        )

    def surprise(self, view: str, length: float) -> Array:
        """-2 log likelihood of a view, stretch by stretch."""
        n, blocks = self.counts[view], self.blocks[view]
        if n == 0:
            return np.zeros(0)
        scale = max(self.floor.get(view, 1.0) ** 2, self.squares[view] / n)
        share = np.minimum(BLOCK, n - BLOCK * np.arange(len(blocks)))
        if view in LEAST_LENGTH:  # below the floor of such a view a smaller misfit says nothing
            blocks = np.maximum(blocks, share * self.floor.get(view, 1.0) ** 2)
        return np.asarray((share * math.log(scale) + blocks / scale) / length)

    @property
    def charge(self) -> float:
        """What prior and Occam factor charge."""
        return self.fit.penalty + self.volume()

    def volume(self) -> float:
        """Occam factor of the fitted parameters: log of prior width over posterior
        width, squared.
        """
        spread = np.array([c.spread for c in self.fit.coordinates])
        if len(spread) == 0:
            return 0.0
        inverse = np.linalg.slogdet(self.fit.covariance / np.outer(spread, spread))[1]
        return float(-inverse)


@dataclass(frozen=True)
class _Problem:
    """A hypothesis' views as the fit sees them."""

    bench: Bench
    views: tuple[str, ...]
    settings: Mapping[str, float]

    def residual(self, view: str, values: Mapping[str, float]) -> Array:
        return self.bench.white(self.bench.all[view], {**self.settings, **values})

    def depends(self, view: str, name: str) -> bool:
        return self.bench.all[view].depends_on(name)


def _folded(residual: Array) -> Array:
    """Means of FOLD samples each, scaled so that white noise stays 1."""
    n = len(residual) // FOLD * FOLD
    return np.asarray(residual[:n].reshape(-1, FOLD).sum(axis=1) / math.sqrt(FOLD))


class Bench:
    """Views of one campaign on the block FMUs; used in a `with`."""

    def __init__(
        self,
        campaign: Campaign,
        gantry: FmuFile,
        model: Path | None = None,
        out: Path | None = None,
        tolerance: float = TOLERANCE,
        whitened: bool = True,
        workers: int = 1,
    ) -> None:
        """`tolerance`: RMS share by which a rig's parameters are off. `whitened`: False takes
        residuals as they come. `workers`: processes for fits that do not depend on each other.
        """
        self.workers = workers
        self.campaign, self._tolerance, self._whitened = campaign, tolerance, whitened
        self.nominal = nominal_values(gantry)
        self.gantry = gantry
        self._files = {
            name: FmuFile.read(build_fmu(cls, model, out=out).path) for name, cls in CLASSES.items()
        }
        self._stack = ExitStack()
        self.table: Table = table_of(campaign)
        self.store = SignalStore(self.table)
        self.views: dict[str, View] = {}
        self.friction: dict[str, FrictionView] = {}
        self.evaluations = 0
        self.floor = dict(FLOOR)
        if self.table.quanta:
            self.floor["timing"] *= COARSE_TIMING
        self.columns: dict[
            tuple[str, str], Array
        ] = {}  # Jacobian of tolerance about the nominal fit
        self.told: dict[
            tuple[str, str], dict[str, float]
        ] = {}  # by effect and form: its parameters as the sensors alone tell them
        self._led_columns: dict[
            float, dict[tuple[str, str], Array]
        ] = {}  # the same under tighter leads
        self._kept: OrderedDict[tuple[Any, ...], Array] = OrderedDict()

    def __enter__(self) -> Bench:
        blocks = {
            name: self._stack.enter_context(BlockFmu(file)) for name, file in self._files.items()
        }
        views: list[View] = []
        for axis in "xz":
            views.append(ValveView(axis, blocks["valve"], self.nominal, self.store))
            self.friction[axis] = FrictionView(axis, blocks["friction"], self.nominal, self.store)
            views.append(self.friction[axis])
        self.mechanics = MechanicsView(
            self._stack.enter_context(BlockFmu(self.gantry)),
            self.store,
            {a: self.nominal[f"axis_{a}.m"] for a in "xz"},
        )
        views += [
            ContactView(blocks["contact"], self.nominal, self.store),
            SensorView(self.store),
            TimingView(self.campaign, self.store),
        ]
        self.all = {view.name: view for view in [*views, self.mechanics]}
        self.views = {name: self.all[name] for name in JUDGED}
        return self

    @contextmanager
    def led_tighter(self, views: Iterable[str], share: float) -> Iterator[None]:
        """Inside, the carriages of `views` are led back in `share` of the usual time."""
        led = {view.name: view for view in self.friction.values() if view.name in views}
        loose, columns = {name: view.guided for name, view in led.items()}, self.columns
        known = self._led_columns.setdefault(share, {})
        self.columns = {key: column for key, column in columns.items() if key[0] not in led} | {
            key: column for key, column in known.items() if key[0] in led
        }
        try:
            for name, view in led.items():
                view.guided *= share
                self._drop(name)
            yield
        finally:
            known.update((key, column) for key, column in self.columns.items() if key[0] in led)
            for name, view in led.items():
                view.guided = loose[name]
                self._drop(name)
            self.columns = columns

    def fit_by_tighter_lead(
        self,
        choice: Choice,
        views: Sequence[str],
        start_values: Mapping[str, float],
        base: Outcome | None,
    ) -> Outcome:
        """A careful fit by way of a lead under which fewer break-aways are missed."""
        with self.led_tighter(views, HALF):
            tight = self.fit(choice, views, start_values=start_values, careful=True)
        return self.fit(choice, views, start_values=tight.values, base=base, careful=True)

    def settle(self, views: Iterable[str]) -> dict[str, Outcome]:
        """Tolerance alone on each view."""
        names = list(views)
        for name in names:  # compiled here once, not in every copy of this process
            self.white(self.all[name], {})
        outcomes = dict(zip(names, each(self._settled, names, self.workers), strict=True))
        for outcome in outcomes.values():
            self.columns.update(outcome.fit.columns)
        self._led_columns.clear()  # what one worker or several keep must be the same
        return outcomes

    def _settled(self, view: str) -> Outcome:
        """Friction also by way of a tighter lead, under which fewer break-aways are missed."""
        outcome = self.fit(Choice(), (view,))
        friction = self.all[view]
        if isinstance(friction, FrictionView) and friction.logs:
            again = self.fit_by_tighter_lead(Choice(), (view,), outcome.values, None)
            outcome = min(outcome, again, key=lambda o: o.objective)
        return outcome

    def drive(self, values: Mapping[str, float]) -> None:
        """Takes fitted valves' outputs for the actuator forces; what they leave is added, smoothed,
        where they are not right.
        """
        for axis in "xz":
            valve = self.all[f"valve_{axis}"]
            measured = self.table.columns[f"f_a{axis}"]
            left = valve.residual(values)[:, 0] * self.table.sigma[f"f_a{axis}"]
            force = measured - left
            if np.sqrt(np.mean(self.white(valve, values) ** 2)) > GOOD_VALVE:
                force = force + smoothed(left, self.table.spans)
            self.mechanics.actuator[axis] = self.friction[axis].actuator = force
            self._forget(f"friction_{axis}")
        self._forget("mechanics")

    def judged(self, values: Mapping[str, float]) -> Outcome:
        """What given values leave in every view, nothing fitted: for a log that was held out of
        their fit.
        """
        self.drive(values)
        fixed = Fit((), np.zeros(0), np.zeros((0, 0)), 0.0, {})
        return self.outcome(Choice(), fixed, tuple(self.views), values)

    def polish(self, choice: Choice, start: Mapping[str, float]) -> Outcome:
        """A hypothesis on the mechanics run freely, from the values of a fit on the views: what a
        replay of the whole plant needs.

        A free run misses break-aways where a led one does not: where it sticks, the fit begins with
        a run that is led a little, then lets go; where that sticks too, the open-loop logs alone
        come first.
        """
        mechanics = ("mechanics",)
        choice = Choice(
            tuple(
                (e, f)
                for e, f in choice.effects
                if any(self.mechanics.depends_on(p.name) for p in f.parameters)
            )
        )
        free = {
            name: value
            for name, value in start.items()
            if name in choice.parameter_names or not name.startswith("axis_")
        }
        best = self.fit(choice, mechanics, start_values=start, careful=True)
        ways = [
            way
            for way in (
                (start, self.mechanics.every),
                (free, self.mechanics.every),
                (start, self.mechanics.opened),
            )
            if way[1]
        ]
        while ways and best.rms("mechanics") >= GOOD_MECHANICS:
            count = 1 if self.workers < 2 else len(ways)  # all at once, where that costs no time
            now, ways = ways[:count], ways[count:]
            for outcome in each(lambda way: self._let_go(choice, *way), now, self.workers):
                if best.rms("mechanics") >= GOOD_MECHANICS and outcome.objective < best.objective:
                    best = outcome
        return best

    def _let_go(self, choice: Choice, start: Mapping[str, float], logs: list[int]) -> Outcome:
        """A fit of some logs' mechanics led a little, then of all of them run freely."""
        self._let(LOOSE, logs)
        led = self.fit(choice, ("mechanics",), start_values=start, careful=True)
        self._let(0.0, self.mechanics.every)
        return self.fit(choice, ("mechanics",), start_values=led.values, careful=True)

    def _let(self, guided: float, logs: list[int]) -> None:
        self.mechanics.guided, self.mechanics.logs = guided, logs
        self._forget("mechanics")

    def _drop(self, view: str) -> None:
        """Forgets the residuals of a view that has changed."""
        for key in [key for key in self._kept if key[0] == view]:
            del self._kept[key]

    def _forget(self, view: str) -> None:
        self._drop(view)
        self.columns = {key: column for key, column in self.columns.items() if key[0] != view}
        self._led_columns.clear()

    def __exit__(self, *error: Any) -> None:
        self._stack.close()

    def white(self, view: View, values: Mapping[str, float]) -> Array:
        """A view's residual as a vector of white noise 1, if the block is right. The last few are
        kept.
        """
        differing = (
            (name, value)
            for name, value in values.items()
            if view.depends_on(name) and self.neutral(name) != value
        )
        own = dict(sorted(differing))
        key = (view.name, *own.items())
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        result = self._kept[key] = _folded(self._white(view, own))
        if len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return result

    def _white(self, view: View, values: Mapping[str, float]) -> Array:
        self.evaluations += 1
        raw = view.residual(values)
        if isinstance(view, FrictionView):
            logs = [raw[slice(*self.table.spans[i])] for i in view.logs]
            return (
                np.concatenate(
                    [robust_segments(log[np.isfinite(log[:, 0])]).ravel() for log in logs]
                )
                if logs
                else np.zeros(0)
            )
        if isinstance(view, MechanicsView):
            logs = [raw[slice(*self.table.spans[i])] for i in view.logs]
            return (
                np.concatenate([robust_segments(log).T.ravel() for log in logs])
                if logs
                else np.zeros(0)
            )
        if isinstance(view, ContactView):
            parts = [
                self._innovations(np.ascontiguousarray(raw[slice(*self.table.spans[i]), column]))
                for i in view.logs
                for column in range(2)
            ]
            return np.concatenate(parts) if parts else np.zeros(0)
        if isinstance(view, TimingView):
            return np.asarray(
                np.nan_to_num(raw[view.judged]) / 0.7
            )  # the log's own rounding makes 0.7 of its unit
        return np.asarray(
            raw.T[np.isfinite(raw.T)]
        )  # channel by channel: samples of two must not be folded into one

    def _innovations(self, residual: Array) -> Array:
        return innovations(residual, *SMOOTHING) if self._whitened else residual

    def neutral(self, name: str) -> float | None:
        """Value of a parameter in the nominal model."""
        return self.nominal.get(name, SENSOR_NEUTRAL.get(name, 0.0))

    def touched(self, parameters: Sequence[str]) -> tuple[str, ...]:
        """Views that depend on any of the parameters."""
        return tuple(
            name for name, view in self.views.items() if any(view.depends_on(p) for p in parameters)
        )

    def touched_by(self, form: Form) -> tuple[str, ...]:
        """Views that depend on a form."""
        return self.touched([*(p.name for p in form.parameters), *form.settings])

    def _spread(self, name: str) -> float:
        return TIGHT_TOLERANCE.get(name.rsplit(".", 1)[-1], TOLERANCE) * self._tolerance / TOLERANCE

    def coordinates(
        self, choice: Choice, views: Sequence[str], starts: Mapping[str, float] | None = None
    ) -> list[Coordinate]:
        """Tolerance of the views' blocks, less what the effects free, and the effects'
        parameters.
        """
        free = choice.parameter_names
        names = dict.fromkeys(
            name for view in views for name in self.all[view].tolerance if name not in free
        )
        result = [
            tolerance_coordinate(name, self.nominal[name], self._spread(name)) for name in names
        ]
        for _, form in choice.effects:
            result += [
                effect_coordinate(p, self.nominal.get(p.name), (starts or {}).get(p.name))
                for p in form.parameters
            ]
        return result

    def fit(
        self,
        choice: Choice,
        views: Sequence[str],
        starts: Mapping[str, float] | None = None,
        start_values: Mapping[str, float] | None = None,
        base: Outcome | None = None,
        careful: bool = False,
    ) -> Outcome:
        """Fits a hypothesis on some views. `starts`: of the effects' parameters; `start_values`: of
        everything, from an earlier fit; `base`: the outcome that the hypothesis adds an effect to.
        """
        views = tuple(views)
        coordinates = self.coordinates(choice, views, starts)
        problem = _Problem(self, views, choice.settings)
        theta = None
        if start_values:
            theta = np.array(
                [
                    c.theta(start_values[c.name]) if c.name in start_values else c.start
                    for c in coordinates
                ]
            )
            theta = balanced(coordinates, theta)
        fitted = fit(
            problem,
            coordinates,
            theta,
            self._stale(choice, views, base),
            careful=careful or not choice.effects,
        )
        if not choice.effects:
            self.columns.update(fitted.columns)
        return self.outcome(choice, fitted, views)

    def predict(
        self,
        choice: Choice,
        views: Sequence[str],
        starts: Mapping[str, float],
        start_values: Mapping[str, float],
        base: Outcome | None = None,
    ) -> float:
        """Objective that one step from `start_values` towards the hypothesis promises."""
        coordinates = self.coordinates(choice, views, starts)
        theta = np.array(
            [
                c.theta(start_values[c.name])
                if c.name in start_values
                else (c.start if choice.settings else 0.0)
                for c in coordinates
            ]
        )
        theta = balanced(coordinates, theta)
        columns = {
            **self.columns,
            **(base.fit.columns if base else {}),
        }  # good enough for a promise even where the friction law changes
        return predict(
            _Problem(self, tuple(views), choice.settings),
            coordinates,
            theta,
            {k: v for k, v in columns.items() if k[0] in views},
        )

    def _stale(
        self, choice: Choice, views: Sequence[str], base: Outcome | None
    ) -> dict[tuple[str, str], Array] | None:
        """Tolerance columns of the nominal fit, for the views whose law the hypothesis leaves as it
        is.
        """
        before = base.choice.settings if base else {}
        new = tuple(name for name in choice.settings if name not in before)
        changed = set(self.touched(new)) if new else set()
        columns = {**self.columns, **(base.fit.columns if base else {})}
        return {
            key: column
            for key, column in columns.items()
            if key[0] in views and key[0] not in changed
        } or None

    def outcome(
        self,
        choice: Choice,
        fitted: Fit,
        views: tuple[str, ...],
        values: Mapping[str, float] | None = None,
    ) -> Outcome:
        squares, counts, lengths, blocks = {}, {}, {}, {}
        values = {**choice.settings, **fitted.values} if values is None else values
        for view in views:
            r = self.white(self.all[view], values)
            squares[view], counts[view] = float(r @ r), len(r)
            length = max(correlation_length(r) if len(r) > 10 else 1.0, LEAST_LENGTH.get(view, 1.0))
            lengths[view] = length if self._whitened else 1.0
            blocks[view] = (
                np.add.reduceat(r**2, np.arange(0, len(r), BLOCK)) if len(r) else np.zeros(0)
            )
        return Outcome(choice, fitted, squares, counts, lengths, views, dict(self.floor), blocks)
