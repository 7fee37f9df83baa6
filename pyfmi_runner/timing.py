"""When each command acts: sampling period, delay from sample to action, jitter of that delay."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LoopTiming", "action_instants"]

MICROSECOND = 1e-6  # s; instants are integers of it, so that no rounding builds up over a run
LONGEST = 600.0  # s, as a run is


@dataclass(frozen=True)
class LoopTiming:
    """Timing of the sampled loop.

    Sample k is taken at k * period; its command acts from k * period + delay + e_k until the next
    one acts, e_k uniform within +-sqrt(3) * jitter. Raises ValueError for a period that is no whole
    number of microseconds, a delay beyond LONGEST, and jitter that would let a command act before
    its sample or overtake the one before.
    """

    period: float = 0.001  # s, > 0
    delay: float = 0.0  # s, >= 0, fractions of a period and more than one allowed; rounded to 1 us
    jitter: float = 0.0  # s RMS, >= 0

    def __post_init__(self) -> None:
        for name in ("period", "delay", "jitter"):
            value = getattr(self, name)
            if not 0.0 <= value <= LONGEST:
                raise ValueError(f"{name} must be 0..{LONGEST:g} s, got {value!r}")
        cycles = self.period / MICROSECOND
        if round(cycles) < 1 or abs(cycles - round(cycles)) > 1e-6:
            raise ValueError(
                f"period must be a whole number of microseconds, got {self.period!r} s"
            )
        if self.reach > self.delay + 1e-12:
            raise ValueError(
                f"jitter of {self.jitter!r} s RMS reaches {self.reach:.3g} s to either side: "
                f"delay must be at least that, got {self.delay!r} s"
            )
        if 2 * self.reach >= self.period:
            limit = self.period / (2 * math.sqrt(3))
            raise ValueError(
                f"jitter must be < {limit:.3g} s RMS to keep the commands in order, got "
                f"{self.jitter!r} s"
            )

    @property
    def reach(self) -> float:
        """Largest jitter to either side [s]."""
        return math.sqrt(3) * self.jitter


def action_instants(timing: LoopTiming, samples: int, seed: int = 0) -> NDArray[np.int64]:
    """Instants [us, from the first sample] at which the commands of samples 0..samples-1 act; shape
    (samples,), rising.

    Command k never acts before sample k. The same seed gives the same instants; without jitter the
    seed plays no part.
    """
    instants = np.arange(samples, dtype=np.int64) * round(timing.period / MICROSECOND)
    if timing.jitter == 0.0:
        return instants + round(timing.delay / MICROSECOND)
    draws = np.random.default_rng(seed).uniform(-timing.reach, timing.reach, samples)
    latency = np.rint((timing.delay + draws) / MICROSECOND).astype(np.int64)
    return np.asarray(np.maximum.accumulate(instants + latency))
