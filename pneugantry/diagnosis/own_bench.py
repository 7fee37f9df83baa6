"""The bench of a user's own plant: its FMU simulated over its logs, hypotheses fitted on whitened
residuals, and their evidence.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import firwin, upfirdn

from modelica_fmu.errors import InputError, RunError
from pneugantry.diagnosis.fit import (
    Coordinate,
    Fit,
    effect_coordinate,
    fit,
    predict,
    tolerance_coordinate,
)
from pneugantry.diagnosis.own_plant import OwnLog, OwnPlant
from pneugantry.engine.autoregression import LONGEST, Whitener, whitener_of
from pneugantry.engine.catalogue import Effect, Form
from pyfmi_runner.block_fmu import BlockFmu
from pyfmi_runner.log import PERIOD

__all__ = ["Hypothesis", "OwnBench", "Trial"]

Array = NDArray[np.float64]
Effects = tuple[tuple[Effect, Form], ...]
BLOCK = 24  # whitened rows that are drawn together in a bootstrap
ROUNDS = 4  # of fit and new whitening
LARGE = 1e6  # residual, in sigma, that stands for a simulation that failed


@dataclass(frozen=True)
class Hypothesis:
    """Effects, each in one of its forms. Empty: tolerance alone."""

    effects: Effects = ()

    @property
    def keys(self) -> tuple[str, ...]:
        return tuple(effect.key for effect, _ in self.effects)

    @property
    def settings(self) -> dict[str, float]:
        return {name: value for _, form in self.effects for name, value in form.settings.items()}

    def plus(self, effect: Effect, form: Form) -> Hypothesis:
        return Hypothesis((*self.effects, (effect, form)))

    def without(self, key: str) -> Hypothesis:
        return Hypothesis(tuple((e, f) for e, f in self.effects if e.key != key))


@dataclass(eq=False)
class Trial:
    """A hypothesis fitted, under noise of its own colour."""

    hypothesis: Hypothesis
    fit: Fit
    whiteners: tuple[Whitener, ...]  # by channel
    blocks: Array  # -2 log likelihood by block of whitened rows
    cost: float  # what prior, Occam factor, order of the noise and number of effects charge

    @property
    def keys(self) -> tuple[str, ...]:
        return self.hypothesis.keys

    @property
    def values(self) -> dict[str, float]:
        return {**self.hypothesis.settings, **self.fit.values}

    @property
    def evidence(self) -> float:
        """-2 log evidence: smaller is better."""
        return float(self.blocks.sum()) + self.cost


@dataclass(frozen=True)
class _Problem:
    """A hypothesis under given whiteners, as the fit sees it."""

    bench: OwnBench
    logs: tuple[OwnLog, ...]
    whiteners: tuple[Whitener, ...]
    settings: Mapping[str, float]

    @property
    def views(self) -> Sequence[str]:
        return [log.name for log in self.logs]

    def residual(self, view: str, values: Mapping[str, float]) -> Array:
        log = next(log for log in self.logs if log.name == view)
        raw = self.bench.residual(log, {**self.settings, **values})
        return np.concatenate([whiten(raw[:, c]) for c, whiten in enumerate(self.whiteners)])

    def depends(self, view: str, name: str) -> bool:
        return True


class OwnBench:
    """One plant, its FMU and its logs; used in a `with`. `effect_cost`: charged per effect, 2
    log(number of effects offered).
    """

    def __init__(self, plant: OwnPlant, effect_cost: float = 0.0) -> None:
        self.plant = plant
        self.effect_cost = effect_cost
        self.fitted = tuple(log for log in plant.logs if not log.held_out)
        starts = {
            name: v.start
            for name, v in plant.fmu.variables.items()
            if v.causality == "parameter" and v.start is not None
        }
        self.nominal = {name: float(value) for name, value in starts.items()} | dict(
            plant.parameters
        )
        self._fmu = BlockFmu(plant.fmu)
        self._kept: OrderedDict[tuple[Any, ...], Array] = OrderedDict()
        self._filter = (
            firwin(20 * plant.decimate + 1, 1.0 / plant.decimate)
            if plant.decimate > 1
            else np.ones(1)
        )
        self.simulations = 0
        for log in self.fitted:
            if len(self.measured(log)) < 4 * LONGEST + BLOCK:
                raise InputError(
                    f"{len(self.measured(log))} rows are left to judge",
                    field=f"log.{log.name}",
                    hint="decimate or skip less",
                )

    def __enter__(self) -> OwnBench:
        self._fmu.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._fmu.__exit__(*error)

    # -- simulation

    def simulate(self, log: OwnLog, values: Mapping[str, float]) -> Array:
        """Outputs (N, channels) at the log's rows. Raises RunError."""
        every = round(self.plant.period / PERIOD)
        inputs = np.repeat(log.inputs, every, axis=0)
        parameters = {**self.plant.parameters, **log.parameters, **values}
        names = [c.name for c in self.plant.channels]
        self.simulations += 1
        return self._fmu.run(parameters, self.plant.inputs, inputs, names)[::every]

    def thinned(self, signals: Array) -> Array:
        """Signals (N, channels) behind the low-pass, one row in `decimate`, without what is not
        judged.
        """
        step, half = self.plant.decimate, len(self._filter) // 2
        if step > 1:
            signals = np.column_stack(
                [
                    upfirdn(self._filter, column)[half : half + len(column)][::step]
                    for column in signals.T
                ]
            )
        edge = math.ceil(half / step)  # the filter looks past the log's ends there
        first = max(math.ceil(self.plant.skip / self.plant.period / step), edge)
        return np.asarray(signals[first : len(signals) - edge])

    def measured(self, log: OwnLog) -> Array:
        return self.thinned(log.measured)

    def residual(self, log: OwnLog, values: Mapping[str, float]) -> Array:
        """(rows, channels): measured - simulated, thinned, in units of the thinned sensor noise.
        The last ones are kept.
        """
        key = (log.name, *sorted((n, v) for n, v in values.items() if self.nominal.get(n) != v))
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        try:
            error = log.measured - self.simulate(log, values)
            error = np.where(np.isfinite(error), error, LARGE)
        except RunError:
            error = np.full_like(log.measured, LARGE)
        sigma = np.array([c.sigma for c in self.plant.channels]) * math.sqrt(
            float(np.sum(self._filter**2))
        )
        result = self._kept[key] = self.thinned(error) / sigma
        if len(self._kept) > 600:
            self._kept.popitem(last=False)
        return result

    def gap(self, log: OwnLog, values: Mapping[str, float]) -> float:
        """RMS over channels and time, in sensor noise: 1 is the floor."""
        return math.sqrt(float(np.mean(self.residual(log, values) ** 2)))

    def relative(self, log: OwnLog, values: Mapping[str, float]) -> dict[str, float]:
        """By channel: RMS of the error over RMS of the signal, both thinned."""
        error = self.thinned(log.measured - self.simulate(log, values))
        signal = self.measured(log)
        return {
            c.name: float(np.linalg.norm(error[:, i]) / np.linalg.norm(signal[:, i]))
            for i, c in enumerate(self.plant.channels)
        }

    # -- hypotheses

    def coordinates(
        self, hypothesis: Hypothesis, starts: Mapping[str, float] | None = None
    ) -> list[Coordinate]:
        """Tolerance, less what the effects free, and the effects' parameters."""
        found: dict[str, Coordinate] = {}
        for _, form in hypothesis.effects:
            for p in form.parameters:
                found.setdefault(
                    p.name,
                    effect_coordinate(p, self.nominal.get(p.name), (starts or {}).get(p.name)),
                )
        tolerance = [
            tolerance_coordinate(n, self.nominal[n], s)
            for n, s in self.plant.tolerance.items()
            if n not in found
        ]
        return [*tolerance, *found.values()]

    def whiteners(self, values: Mapping[str, float]) -> tuple[Whitener, ...]:
        raw = [self.residual(log, values) for log in self.fitted]
        return tuple(whitener_of([r[:, c] for r in raw]) for c in range(len(self.plant.channels)))

    def fit(
        self,
        hypothesis: Hypothesis,
        base: Trial | None = None,
        starts: Mapping[str, float] | None = None,
        whiteners: tuple[Whitener, ...] | None = None,
    ) -> Trial:
        """Fits a hypothesis in rounds: parameters under the noise's colour, then its colour anew.
        `base`: where to start from; `whiteners`: a given colour, which stays. The first round is
        without colour: that of a poor base would hide what is missing.
        """
        coordinates = self.coordinates(hypothesis, starts)
        known = base.values if base is not None else {}
        theta = np.array(
            [
                c.theta(known[c.name]) if c.name in known and known[c.name] > c.low else c.start
                for c in coordinates
            ]
        )
        at = {
            **hypothesis.settings,
            **{c.name: c.value(t) for c, t in zip(coordinates, theta, strict=True)},
        }
        if whiteners is not None:
            fitted = fit(
                _Problem(self, self.fitted, whiteners, hypothesis.settings),
                coordinates,
                theta,
                careful=False,
            )
            return self._trial(hypothesis, fitted, whiteners)
        colour = self.plain(base.values if base is not None else at)
        best: Trial | None = None
        for _ in range(ROUNDS):
            fitted = fit(
                _Problem(self, self.fitted, colour, hypothesis.settings),
                coordinates,
                theta,
                careful=False,
            )
            trial = self._trial(
                hypothesis, fitted, self.whiteners({**hypothesis.settings, **fitted.values})
            )
            if best is not None and trial.evidence > best.evidence - 0.5:
                break
            best, theta, colour = trial, fitted.theta, trial.whiteners
        assert best is not None
        return best

    def plain(self, values: Mapping[str, float]) -> tuple[Whitener, ...]:
        """No colour at all: the residual at these values scaled to 1."""
        raw = np.concatenate([self.residual(log, values) for log in self.fitted])
        return tuple(
            Whitener(np.zeros(0), max(float(s), 1e-9)) for s in np.sqrt(np.mean(raw**2, axis=0))
        )

    def excess(self, trial: Trial) -> float:
        """Mean square of the fitted logs' residual above the noise, in sensor noise."""
        raw = np.concatenate([self.residual(log, trial.values) for log in self.fitted])
        return max(0.0, float(np.mean(raw**2)) - 1.0)

    def promise(
        self,
        hypothesis: Hypothesis,
        base: Trial,
        whiteners: tuple[Whitener, ...],
        starts: Mapping[str, float] | None = None,
    ) -> float:
        """Fall of the whitened sum of squares that one step from `base` towards the hypothesis
        promises.
        """
        coordinates = self.coordinates(hypothesis, starts)
        theta = np.array(
            [
                c.theta(base.values[c.name])
                if c.name in base.values
                else (c.start if hypothesis.settings else 0.0)
                for c in coordinates
            ]
        )
        problem = _Problem(self, self.fitted, whiteners, hypothesis.settings)
        before = _Problem(self, self.fitted, whiteners, base.hypothesis.settings)
        squares = (
            sum(float(r @ r) for r in (before.residual(v, base.values) for v in before.views))
            + base.fit.penalty
        )
        return squares - predict(problem, coordinates, theta)

    def _trial(self, hypothesis: Hypothesis, fitted: Fit, whiteners: tuple[Whitener, ...]) -> Trial:
        values = {**hypothesis.settings, **fitted.values}
        blocks: list[float] = []
        count = 0
        for log in self.fitted:
            raw = self.residual(log, values)
            for c, whiten in enumerate(whiteners):
                terms = whiten(raw[:, c]) ** 2 + 2 * math.log(whiten.sigma)
                count += len(terms)
                blocks += [
                    float(part.sum()) for part in np.array_split(terms, max(1, len(terms) // BLOCK))
                ]
        spread = np.array([c.spread for c in fitted.coordinates])
        volume = (
            -float(np.linalg.slogdet(fitted.covariance / np.outer(spread, spread))[1])
            if len(spread)
            else 0.0
        )
        order = sum(len(w.coefficients) for w in whiteners) * math.log(max(count, 2))
        cost = fitted.penalty + volume + order + self.effect_cost * len(hypothesis.effects)
        return Trial(hypothesis, fitted, whiteners, np.array(blocks), cost)

    def jacobian(
        self, trial: Trial, hypothesis: Hypothesis | None = None, chord: float = 0.0
    ) -> tuple[list[Coordinate], list[Array]]:
        """Columns of the whitened residual by theta about a trial's point, in blocks of rows as
        `Trial.blocks`; and the coordinates. `hypothesis`: further effects, from their neutral;
        their steps are at least `chord`.
        """
        wanted = hypothesis or trial.hypothesis
        problem = _Problem(self, self.fitted, trial.whiteners, wanted.settings)
        coordinates = self.coordinates(wanted)
        point = {
            c.name: trial.values.get(c.name, c.value(c.start if wanted.settings else 0.0))
            for c in coordinates
        }
        base = np.concatenate([problem.residual(v, point) for v in problem.views])
        columns = []
        for c in coordinates:
            theta = c.theta(point[c.name])
            step = max(c.step, chord) if c.effect else c.step
            step = step if theta + step <= c.bounds[1] else -step
            moved = {**point, c.name: c.value(theta + step)}
            columns.append(
                (np.concatenate([problem.residual(v, moved) for v in problem.views]) - base) / step
            )
        return coordinates, [base, *columns]
