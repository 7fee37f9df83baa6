"""What a missing term may be a function of: the component's own variables, time, and what the
component remembers of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.plant import Array, Record
from pneugantry.learn.points import Opened, Point

__all__ = ["TIME", "Regressor", "regressors_of"]

TIME = "time"


@dataclass(frozen=True)
class Regressor:
    """A variable of a component."""

    component: str  # path; "" for the plant's own class, or for all of them (time)
    name: str  # within the component's class

    def within(self, point: Point) -> bool:
        """Whether an equation can use it."""
        return self.name == TIME or self.component == point.component

    @property
    def label(self) -> str:
        """In the whole plant."""
        return f"{self.component}.{self.name}" if self.component else self.name


def regressors_of(
    opened: Opened,
    wanted: Mapping[Point, Sequence[str]],
    records: Sequence[Record],
    values: Mapping[str, Mapping[str, float]],
) -> dict[Regressor, dict[str, Array]]:
    """Series by record of all variables of the points' components, and of time. values: parameters
    by record.
    """
    names = sorted({n for own in wanted.values() for n in own})
    made = opened.series(names, records, values) if names else {}
    found: dict[Regressor, dict[str, Array]] = {}
    for point, own in wanted.items():
        prefix = f"{point.component}." if point.component else ""
        for name in own:
            regressor = Regressor(point.component, name.removeprefix(prefix))
            found[regressor] = {r: made[r][:, names.index(name)] for r in made}
    found[Regressor("", TIME)] = {
        r.name: np.asarray(np.arange(r.rows) * r.period, dtype=np.float64) for r in records
    }
    return found
