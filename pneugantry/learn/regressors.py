"""What a missing term may be a function of: the component's own variables, time, and what the
component remembers of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pneugantry.engine.plant import Array, Record
from pneugantry.learn.curve import JUMP
from pneugantry.learn.points import Opened, Point

__all__ = ["TIME", "Regressor", "regressors_of"]

TIME = "time"
SAME = 1 - 1e-9  # correlation from which on two variables are one


@dataclass(frozen=True)
class Regressor:
    """A variable of a component; or, where it has a speed, that times the speed's sign: what
    resists a motion turns round with it.
    """

    component: str  # path; "" for the plant's own class, or for all of them (time)
    name: str  # within the component's class
    speed: str = ""  # within the class, too
    width: float = 0.0  # of the speed, over which its smooth sign changes

    @property
    def plain(self) -> Regressor:
        """The variable itself."""
        return Regressor(self.component, self.name)

    def signs(self, series: Mapping[Regressor, Mapping[str, Array]]) -> dict[str, Array] | None:
        """The smooth sign of the speed by record; None: there is no speed."""
        if not self.speed:
            return None
        speeds = series[Regressor(self.component, self.speed)]
        return {r: np.tanh(v / self.width) for r, v in speeds.items()}

    def within(self, point: Point) -> bool:
        """Whether an equation can use it."""
        return self.name == TIME or self.component == point.component

    @property
    def label(self) -> str:
        """In the whole plant."""
        found = f"{self.component}.{self.name}" if self.component else self.name
        return f"{found} against {self.speed}" if self.speed else found


def regressors_of(
    opened: Opened,
    wanted: Mapping[Point, Sequence[str]],
    records: Sequence[Record],
    values: Mapping[str, Mapping[str, float]],
) -> dict[Regressor, dict[str, Array]]:
    """Series by record of all variables of the points' components, each against each speed of its
    component as well, and of time. values: parameters by record.
    """
    names = sorted({n for own in wanted.values() for n in own})
    made = opened.series(names, records, values) if names else {}
    found: dict[Regressor, dict[str, Array]] = {}
    for point, own in wanted.items():
        prefix = f"{point.component}." if point.component else ""
        for name in own:
            regressor = Regressor(point.component, name.removeprefix(prefix))
            found[regressor] = {r: made[r][:, names.index(name)] for r in made}
    found = _distinct(opened, found)
    found |= _against(opened, found)
    found[Regressor("", TIME)] = {
        r.name: np.asarray(np.arange(r.rows) * r.period, dtype=np.float64) for r in records
    }
    return found


def _distinct(
    opened: Opened, known: Mapping[Regressor, dict[str, Array]]
) -> dict[Regressor, dict[str, Array]]:
    """Without what is another one of the component on another scale: states and what is measured
    stay first, for a reader knows them.
    """
    shape, plant = opened.shape, opened.plant
    measured = {shape.roots.get(v) for v in (*plant.inputs, *(s.variable for s in plant.signals))}

    def rank(regressor: Regressor) -> tuple[bool, bool, str]:
        root = shape.roots.get(regressor.label)
        return root not in shape.states, root not in measured, regressor.name

    found: dict[Regressor, dict[str, Array]] = {}
    kept: dict[str, list[Array]] = {}  # by component, of mean 0 and length 1
    for regressor in sorted(known, key=rank):
        whole = np.concatenate(list(known[regressor].values()))
        whole = whole - whole.mean()
        size = float(np.linalg.norm(whole))
        if not 0.0 < size < np.inf:
            continue  # it does not vary
        others = kept.setdefault(regressor.component, [])
        if all(abs(float(whole @ o)) < SAME * size for o in others):
            others.append(whole / size)
            found[regressor] = known[regressor]
    return found


def _against(
    opened: Opened, known: Mapping[Regressor, Mapping[str, Array]]
) -> dict[Regressor, dict[str, Array]]:
    """Each variable against each speed of its component: the rate of a state."""
    found: dict[Regressor, dict[str, Array]] = {}
    roots, rates = opened.shape.roots, set(opened.shape.rates.values())
    for speed, values in known.items():
        low, high = np.quantile(np.concatenate(list(values.values())), (0.005, 0.995))
        if roots.get(speed.label) not in rates or not low < 0 < high:
            continue
        width = 10.0 ** np.floor(np.log10(JUMP * (high - low)))
        for other, own in known.items():
            if other.component == speed.component and other != speed:
                against = Regressor(other.component, other.name, speed.name, float(width))
                found[against] = dict(own)
    return found
