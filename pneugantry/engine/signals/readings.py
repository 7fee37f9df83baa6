"""What a view reads of the other signals: their readings, less noise and less the errors that their
sensors may have.

Once its windows are chosen a filter is linear and leaves a constant as it is. So where a sensor's
errors are a scale and a bias, its readings are filtered once for all values of them; with an error
that changes in time they are filtered anew. Views of one plant read the same of a signal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from modelica_fmu.batch import Course
from pneugantry.engine.plant import Array, Record
from pneugantry.engine.recent import Recent
from pneugantry.engine.signals.sensors import affine, read_with, slowness, true_signal
from pneugantry.engine.signals.slow import stood_for
from pneugantry.engine.signals.smooth import Widest, savgol, widest, widest_slope
from pyfmi_runner.smoothing import jumps, smooth_axis, within_jumps

__all__ = ["Filtered", "Readings"]

SMOOTH = 3  # rows over which an input of a part with states is smoothed
JUMP = 2  # rows over which a sensor may spread a jump
KEPT = 256  # signals of records that are kept, each as filtered and less its errors
TRUE = 128  # and as what stands behind their readings
Errors = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Filtered:
    """What views of one plant have made of readings."""

    true: Recent[Array] = field(default_factory=lambda: Recent(TRUE))
    filtered: Recent[tuple[Array, ...] | Widest] = field(default_factory=lambda: Recent(KEPT))
    made: Recent[Course] = field(default_factory=lambda: Recent(KEPT))

    def forget(self) -> None:
        """Drops what is kept of records."""
        for kept in (self.true, self.filtered, self.made):
            kept.clear()


@dataclass(eq=False)
class Readings:
    """Of one view; threads may share it, and views of one plant with the same pairs what they make
    of readings.
    """

    sigmas: Mapping[str, float]  # quoted, by signal
    pairs: Mapping[str, str]  # position -> its speed
    corrected: frozenset[str]  # signals of states that an observer draws: it averages by itself
    averaging: bool  # the view has states, which average by themselves
    shared: Filtered = field(default_factory=Filtered)

    def value(self, signal: str, record: Record, errors: Errors) -> Course:
        return self._course("value", signal, record, errors)

    def rate(self, signal: str, record: Record, errors: Errors) -> Course:
        """Per s."""
        return self._course("rate", signal, record, errors)

    def _course(self, what: str, signal: str, record: Record, errors: Errors) -> Course:
        """Made once for all sets of errors that agree in the signal's own and those of the speed
        that it is smoothed with.
        """
        mine = _own((signal, self.pairs.get(signal)), errors)
        key = (*self._kind(signal), what, signal, record, tuple(mine.items()))
        return self.shared.made.of(key, lambda: self._over_periods(what, signal, record, mine))

    def _kind(self, signal: str) -> tuple[bool, bool]:
        """What decides how a signal is filtered."""
        return self.averaging, signal in self.corrected

    def _over_periods(self, what: str, signal: str, record: Record, errors: Errors) -> Course:
        """Over a period, where the view has states, halfway between its ends."""
        if what == "rate":
            true = self._true(signal, record, errors)
            values = widest_slope(_steady(true, self.sigmas[signal]), self.sigmas[signal])
            values = values / record.period
        else:
            values = self._value(signal, record, errors)
        if not self.averaging:
            return Course(values, values)
        over = np.empty_like(values)
        np.add(values[:-1], values[1:], out=over[:-1])
        over[:-1] *= 0.5
        over[-1] = values[-1]
        if what == "value" and (jumped := self._within_jumps(signal, record, errors)) is not None:
            over[:-1] += jumped
        return Course(values, over)

    def _within_jumps(self, speed: str, record: Record, errors: Errors) -> Array | None:
        """What its position tells of a speed that jumps between two rows."""
        position = next((p for p, v in self.pairs.items() if v == speed), None)
        if position is None or position not in record.signals:
            return None
        values, sigmas = self._true(speed, record, errors), self._sigmas(position, speed)
        return within_jumps(record.signals[position], values, *sigmas, record.period)

    def _sigmas(self, position: str, speed: str) -> tuple[float, float]:
        return self.sigmas[position], self.sigmas[speed]

    def _true(self, signal: str, record: Record, errors: Errors) -> Array:
        """What a reading stands for, noise apart."""
        slow = slowness(signal, errors)
        if slow is None:
            return true_signal(signal, record, errors)

        def made() -> Array:
            values = true_signal(signal, record, errors)
            return stood_for(values, slow, self.sigmas[signal], record.period)

        return self.shared.true.of((signal, record, tuple(_own((signal,), errors).items())), made)

    def _speed(self, signal: str, record: Record) -> str | None:
        speed = self.pairs.get(signal)
        return speed if speed is not None and speed in record.signals else None

    def _value(self, signal: str, record: Record, errors: Errors) -> Array:
        speed = self._speed(signal, record)
        own, other = affine(signal, errors), affine(speed or signal, errors)
        if own is None or other is None:
            values = self._true(signal, record, errors)
            if speed is not None:
                own_rate, sigmas = self._true(speed, record, errors), self._sigmas(signal, speed)
                return smooth_axis(values, own_rate, *sigmas, record.period).position
            return self._less(self._filter(signal, None, values, None, record.period), signal)
        rate = None if speed is None else record.signals[speed]
        filtered = self.shared.filtered.of(
            (*self._kind(signal), signal, record),
            lambda: self._filter(signal, speed, record.signals[signal], rate, record.period),
        )
        return self._less(filtered, signal, own, other)

    def _filter(
        self, signal: str, speed: str | None, values: Array, rate: Array | None, period: float
    ) -> tuple[Array, ...] | Widest:
        """A signal's part in its smoothed value; then, where a speed is smoothed with it, the
        speed's, and that of a speed of 1.
        """
        if speed is not None and rate is not None:
            sigmas, nought = self._sigmas(signal, speed), np.zeros(len(values))
            jump = jumps(rate, sigmas[1])
            return tuple(
                smooth_axis(s, v, *sigmas, period, jump).position
                for s, v in ((values, nought), (nought, rate), (nought, nought + 1))
            )
        if signal in self.corrected:
            return (values,)
        if self.averaging:  # a bias that a wider window makes would add up in it
            return (savgol(values, SMOOTH, 1),)
        return widest(values, self.sigmas[signal])

    def _less(
        self,
        filtered: tuple[Array, ...] | Widest,
        signal: str,
        own: tuple[float, float] = (1.0, 0.0),
        speed: tuple[float, float] = (1.0, 0.0),
    ) -> Array:
        """A filtered signal less scale and bias."""
        scale, bias = own
        if isinstance(filtered, Widest):  # what does not move stands still
            return filtered.less(scale, bias, 0.0 if signal in self.pairs.values() else None)
        result = (filtered[0] - bias) / scale
        if len(filtered) > 1:
            result = result + (filtered[1] - speed[1] * filtered[2]) / speed[0]
        return np.asarray(result)


def _own(signals: tuple[str | None, ...], errors: Errors) -> dict[str, float]:
    """Errors that move any of some signals, or what they stand for."""
    return {k: v for k, v in errors.items() if not set(signals).isdisjoint(read_with(k))}


def _steady(values: Array, sigma: float) -> Array:
    """Values (N,) without what they jump by: an end stop, which a model's rate of change leaves
    out.
    """
    change = np.diff(values)
    jumped = np.copysign(jumps(values, sigma, JUMP), change)
    return values - np.append(0.0, np.cumsum(jumped))
