"""What a diagnosis asks of a view."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Protocol

from pneugantry.engine.plant import Array, Record

__all__ = ["Run", "Values", "View"]

Values = Mapping[str, float]
Run = tuple[Record, Values]  # over a record, with these parameters; the rest as usual


class View(Protocol):
    """Readings less what a part of the plant makes of the other readings."""

    name: str
    signals: tuple[str, ...]  # columns of the residual
    blocks: tuple[str, ...]  # of each of them
    sigmas: tuple[float, ...]  # quoted noise of a row of the residual
    decimation: int  # rows of the record that make one of the residual

    @property
    def defaults(self) -> Mapping[str, float]:
        """The model's own values of the parameters that it reads."""
        ...

    @property
    def remembers(self) -> bool:
        """Whether anything that happened keeps on: what has no memory has no event to miss."""
        ...

    def shows(self, record: Record) -> bool: ...

    def depends_on(self, parameter: str) -> bool: ...

    def prepare(self, moving: Collection[str], settings: Values) -> None:
        """Told before many runs in which `moving` may move, `settings` keep these values and other
        parameters the model's own.
        """

    def residuals(self, runs: Sequence[Run]) -> list[Array]:
        """(rows, signals) of each run in the signals' own units; NaN: it failed."""
        ...
