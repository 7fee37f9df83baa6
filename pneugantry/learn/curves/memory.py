"""Terms that remember: a state follows the variable. Four of the field's own: play (hysteresis), a
lag (creep, heat), a resonance (something elastic that is shaken along) and a recoil (something
elastic that is pushed away).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pneugantry.engine.plant import Array

__all__ = ["MEMORIES", "Memory", "Remembered", "Walks"]

Walk = Callable[[Array, float, Sequence[float]], Array]
Slope = Callable[[Array, float, Sequence[float]], Array | float]
PACE = 2e-3  # s, in which the state of a play follows the end of its band that it is pushed by, and
# over which a slope is taken
SHARES = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)  # of a variable's range, half widths of a play
RATIO = 1.5  # of two lags that are tried
FINE = 1.1  # of two periods
DAMPINGS = (0.03, 0.1, 0.3)
NEAR = 5  # finer steps of a period
FEWEST = 3.0  # rows in a lag or a period, at least
PART = 3.0  # of a record that a lag or a period lasts, at most


@dataclass(frozen=True)
class Memory:
    """A state s that follows a variable z; `text` enters. p2, ...: its parameters, all > 0."""

    name: str
    states: str  # Modelica: declarations of further states
    rates: str  # equations of the states, in z, s and p2, ...
    shapes: int  # p2, ...
    walk: Walk  # `text` over p1, over evenly spaced rows of z, their period (s) and (p2, ...)
    slope: Slope  # of that at each row by z there, with what came before; of it, period, p
    tried: Callable[[float, float, float], list[tuple[float, ...]]]  # (p2, ...) to try, for a range
    # of z, the period of rows and the length of a record, s
    near: Callable[[tuple[float, ...]], list[tuple[float, ...]]] | None = None  # finer, about these
    text: str = "p1*(z - s)"
    pushes: bool = False  # by the rate of z, so that z is the speed of something inert

    @property
    def shown(self) -> str:
        """The term as a reader writes it."""
        values = ", ".join(f"p{k}" for k in range(2, 2 + self.shapes))
        made = f"{self.name}(z, {values})"
        return f"p1*{made}" if self.pushes else f"p1*(z - {made})"


@dataclass(frozen=True)
class Remembered:
    """What a memory makes of a variable, as a curve of one coefficient."""

    memory: Memory
    values: tuple[float, ...]  # p2, ...

    @property
    def bends(self) -> tuple[float, ...]:
        """See `curve.Basis`."""
        return (1.0,)

    def walked(self, values: Array, period: float) -> Array:
        """(rows, 1) over rows of a record."""
        return self.memory.walk(values, period, self.values)[:, None]

    def prior(self, size: float, bend: float) -> Array:
        """See `curve.Basis`."""
        return np.eye(1) / size**2


@dataclass(eq=False)
class Walks:
    """What memories make of variables over evenly spaced rows, told once for all equations."""

    _made: dict[Hashable, Array] = field(default_factory=dict)

    def of(
        self,
        variable: Hashable,
        memory: Memory,
        tried: Sequence[tuple[float, ...]],
        values: Array,
        period: float,
    ) -> Array:
        """Columns (rows, len(tried)) of a variable's values (rows,)."""
        key = variable, memory.name, tuple(tried), len(values), period
        if key not in self._made:
            made = [memory.walk(values, period, p) for p in tried]
            self._made[key] = np.column_stack(made)
        return self._made[key]


def _play(z: Array, period: float, p: Sequence[float]) -> Array:
    (half,), s = p, float(z[0])
    followed = []
    for value in z.tolist():
        if s < value - half:
            s = value - half
        elif s > value + half:
            s = value + half
        followed.append(s)
    return np.asarray(z - np.array(followed))


def _within(off: Array, period: float, p: Sequence[float]) -> Array:
    """The band follows z at its ends."""
    return np.asarray(np.abs(off) < p[0] * (1 - 1e-9), dtype=float)


def _halves(span: float, period: float, length: float) -> list[tuple[float, ...]]:
    return [(share * span,) for share in SHARES]


def _lag(z: Array, period: float, p: Sequence[float]) -> Array:
    """Exact where z is straight between rows."""
    from scipy.signal import lfilter  # its import is dear, for who learns

    fade = float(np.exp(-period / p[0]))
    left = lfilter([_behind(z, period, p)], [1.0, -fade], np.diff(z, prepend=z[0]))
    return np.asarray(left)


def _behind(off: Array, period: float, p: Sequence[float]) -> float:
    """Of a ramp of 1 a row, in one row."""
    (tau,) = p
    return tau / period * (1 - float(np.exp(-period / tau)))


def _lags(span: float, period: float, length: float) -> list[tuple[float, ...]]:
    return [(tau,) for tau in _spaced(FEWEST * period, length / PART, RATIO)]


def _resonance(z: Array, period: float, p: Sequence[float]) -> Array:
    """By the bilinear transform that keeps the natural frequency."""
    from scipy.signal import lfilter  # its import is dear, for who learns

    w, below = _turning(period, p)
    moved = lfilter([w**2, 2 * w**2, w**2], below, z - z[0])
    return np.asarray(z - z[0] - moved)


def _turning(period: float, p: Sequence[float]) -> tuple[float, list[float]]:
    """Natural frequency, rad/s, and denominator of the filter."""
    turn, zeta = p
    w, c = 2 * np.pi / turn, _pace(period, p)
    return w, [c**2 + 2 * zeta * w * c + w**2, 2 * (w**2 - c**2), c**2 - 2 * zeta * w * c + w**2]


def _pace(period: float, p: Sequence[float]) -> float:
    """c of d/dt = c (1 - q)/(1 + q)."""
    w = 2 * np.pi / p[0]
    return float(w / np.tan(w * period / 2))


def _unmoved(off: Array, period: float, p: Sequence[float]) -> float:
    w, below = _turning(period, p)
    return 1 - w**2 / below[0]


def _recoil(z: Array, period: float, p: Sequence[float]) -> Array:
    """The same transform of what a slope pushes."""
    from scipy.signal import lfilter  # its import is dear, for who learns

    c, below = _pace(period, p), _turning(period, p)[1]
    slope = np.diff(z, prepend=z[0]) / period
    return np.asarray(lfilter([c**2, -2 * c**2, c**2], below, slope))


def _kicked(off: Array, period: float, p: Sequence[float]) -> float:
    return _pace(period, p) ** 2 / _turning(period, p)[1][0] / period


def _turns(span: float, period: float, length: float) -> list[tuple[float, ...]]:
    turns = _spaced(FEWEST * period, length / PART, FINE)
    return [(turn, zeta) for turn in turns for zeta in DAMPINGS]


def _near(p: tuple[float, ...]) -> list[tuple[float, ...]]:
    """A sharp resonance answers to a few hundredths of its period."""
    turn, zeta = p
    turns = [turn * FINE ** (k / NEAR) for k in range(-NEAR, NEAR + 1)]
    return [(t, share * zeta) for t in turns for share in (0.6, 1.0, 1.7)]


def _spaced(low: float, high: float, ratio: float) -> list[float]:
    count = int(np.log(max(high / low, 1.0)) / np.log(ratio)) + 1
    return [low * ratio**k for k in range(count)]


TURN = "6.283185307179586/p2"  # natural frequency, rad/s
# acceleration of what stands on a spring and is pushed by the slope of z; b: its displacement
PUSHED = f"(z - s)/{PACE!r} - {TURN}*({TURN}*b + 2*p3*b_rate)"
MEMORIES = (
    Memory(
        "play",
        "",
        f"    der(s) = noEvent((z - s - min(max(z - s, -p2), p2))/{PACE!r});\n",
        1,
        _play,
        _within,
        _halves,
    ),
    Memory("lag", "", "    der(s) = (z - s)/p2;\n", 1, _lag, _behind, _lags),
    Memory(
        "resonance",
        "    Real s_rate(start = 0, fixed = true);\n",
        f"    der(s) = s_rate;\n    der(s_rate) = {TURN}*({TURN}*(z - s) - 2*p3*s_rate);\n",
        2,
        _resonance,
        _unmoved,
        _turns,
        _near,
    ),
    Memory(
        "recoil",
        "    Real b(start = 0, fixed = true);\n    Real b_rate(start = 0, fixed = true);\n",
        f"    der(s) = (z - s)/{PACE!r};\n    der(b) = b_rate;\n    der(b_rate) = {PUSHED};\n",
        2,
        _recoil,
        _kicked,
        _turns,
        _near,
        f"p1*({PUSHED})",
        True,
    ),
)
