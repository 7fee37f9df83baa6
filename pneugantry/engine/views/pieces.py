"""A part of the model, and smaller ones in its place where runs leave most parameters as they are.

A parameter that no run moves is a number to the compiler. What it multiplies may be zero then, and
states, events and inputs that nothing feels are gone (decision 0118).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping

from modelica_fmu.batch import Part, Subsystem
from modelica_fmu.errors import InputError

__all__ = ["Piece", "Pieces"]

Values = Mapping[str, float]


class Piece:
    """A part with some parameters fixed."""

    def __init__(
        self,
        part: Part,
        fixed: Values | None = None,
        unusual: Values | None = None,
        subsystem: Subsystem | None = None,
    ) -> None:
        self.part = part
        self.fixed = fixed or {}  # values of parameters that it has no more
        self.unusual = unusual or {}  # those of them that are not the model's own
        self.parameters = frozenset(part.of("parameter"))
        self.inputs = frozenset(part.of("input"))
        self.states = frozenset(part.of("state"))
        self._subsystem = subsystem
        self._loading = threading.Lock()

    @property
    def subsystem(self) -> Subsystem:
        """Loaded, and compiled if need be, by whoever asks first."""
        with self._loading:
            if self._subsystem is None:
                self._subsystem = Subsystem(self.part)
            return self._subsystem

    def serves(self, model: Values) -> bool:
        """Whether it computes what the whole part does with these parameters."""
        return all(model.get(n) == v for n, v in self.unusual.items()) and all(
            self.fixed.get(n, v) == v for n, v in model.items()
        )


def _size(piece: Piece) -> tuple[int, list[str]]:
    """Of one order, in whichever the pieces were made."""
    return len(piece.parameters), sorted(piece.parameters)


class Pieces:
    """The whole part, and what has been made of it."""

    def __init__(
        self,
        whole: Piece,
        defaults: Values,
        again: Callable[[Values], Part] | None = None,
    ) -> None:
        """`defaults`: the model's own values; `again`: cuts the part with parameters fixed."""
        self.whole, self.defaults = whole, defaults
        self._again = again
        self._made: list[Piece] = []  # those with the fewest parameters first
        self._tried: set[frozenset[tuple[str, float]]] = set()
        self._lock = threading.Lock()

    def prepare(self, moving: Collection[str], settings: Values) -> None:
        """Makes the piece for runs in which `moving` may move, `settings` keep these values and the
        rest the model's own; loads the whole part where that is what serves.
        """
        if self._again is None:
            _ = self.whole.subsystem
            return
        fixed = {
            n: settings.get(n, v)
            for n, v in self.defaults.items()
            if n not in moving and not n.startswith("solver.")
        }
        key = frozenset(fixed.items())
        if not fixed:
            _ = self.whole.subsystem
            return
        with self._lock:
            if key in self._tried:
                return
            self._tried.add(key)
        unusual = {n: v for n, v in fixed.items() if v != self.defaults[n]}
        try:
            made = Piece(self._again(fixed), fixed, unusual)
        except InputError:  # equations that have no solution any more
            return
        _ = made.subsystem  # here, where other views' pieces are made beside it
        with self._lock:
            self._made = sorted((*self._made, made), key=_size)

    def smallest(self, model: Values) -> Piece:
        """The one that serves a model's parameters with the fewest of its own."""
        return next((p for p in self._made if p.serves(model)), self.whole)
