"""What a missing term may be a function of: the component's own variables, what its speeds have
travelled since the record began (what wears or warms with use follows it), measured states of other
components (a stiffness that grows along an axis), and time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.engine.plant import Array, Record
from pneugantry.learn.curves.curve import JUMP
from pneugantry.learn.equations.points import Opened, Point

__all__ = ["TIME", "Regressor", "products_of", "rates_of", "regressors_of"]

TIME = "time"
HARDLY = 0.1  # of a mean, the standard deviation up to which a variable is no factor of a product
SAME = 1 - 1e-9  # correlation from which on two variables are one


@dataclass(frozen=True)
class Regressor:
    """A variable of a component, or what it has travelled; where there is a speed, a term is turned
    round by its sign: it resists the motion. Where it is times another variable, that one's
    coefficient varies; times an equation's left-hand side, what is inert there (a mass).
    """

    component: str  # path; "" for the plant's own class, or for all of them (what is outside)
    name: str  # within the component's class
    speed: str = ""  # within the class, too
    width: float = 0.0  # of the speed, over which its smooth sign changes
    travelled: bool = False  # the integral of the variable's magnitude
    times: str = ""  # within the class, too
    fed: bool = False  # a measured state that the class around the component gives to it

    @property
    def rate(self) -> bool:
        """Whether it is an equation's left-hand side, which a term may be times but no function of:
        the equation decides it.
        """
        return "der(" in self.name

    @property
    def outside(self) -> bool:
        """Whether it is no variable of the component."""
        return self.fed or self.name == TIME

    @property
    def plain(self) -> Regressor:
        """The variable itself."""
        found = replace(self, speed="", width=0.0, times="")
        return replace(found, component="") if self.outside else found

    @property
    def alone(self) -> bool:
        """Whether it is a variable by itself."""
        return self.plain == self and not self.travelled

    def factors(self, series: Mapping[Regressor, Mapping[str, Array]]) -> dict[str, Array] | None:
        """What a term is multiplied by, by record: the smooth sign of the speed, or the other
        variable; None: nothing.
        """
        if self.times:
            return dict(series[Regressor(self.component, self.times)])
        if not self.speed:
            return None
        speeds = series[Regressor(self.component, self.speed)]
        return {r: np.tanh(v / self.width) for r, v in speeds.items()}

    def within(self, point: Point) -> bool:
        """Whether an equation can use it."""
        own = self.component == point.scope
        return point.reads(self.times) and own if self.times else self.outside or own

    @property
    def label(self) -> str:
        """In the whole plant."""
        alone = not self.component or self.outside
        found = self.name if alone else f"{self.component}.{self.name}"
        found = f"travel of {found}" if self.travelled else found
        if self.times:
            return f"{found} times {self.times}"
        return f"{found} against {self.speed}" if self.speed else found


def regressors_of(
    wanted: Mapping[Point, Sequence[str]],
    opened: Opened,
    records: Sequence[Record],
    values: Mapping[str, Mapping[str, float]],
) -> dict[Regressor, dict[str, Array]]:
    """Series by record of all variables of the points' components and of what their speeds have
    travelled, each against each speed of its component as well, of what the plant can give them,
    and of time. values: parameters by record.
    """
    fed = {n for point in wanted for n, _ in point.fed}
    names = sorted({n for own in wanted.values() for n in own} | fed)
    made = opened.series(names, records, values) if names else {}
    found: dict[Regressor, dict[str, Array]] = {}
    for point, own in wanted.items():
        for name in own:
            regressor = Regressor(point.scope, name.removeprefix(point.scope_prefix))
            found[regressor] = {r: made[r][:, names.index(name)] for r in made}
    found = _distinct(opened, found)
    speeds = _speeds(opened, found)
    found |= _travelled(speeds, records)
    found |= _against(speeds, found)
    for name in sorted(fed):
        found[Regressor("", name, fed=True)] = {r: made[r][:, names.index(name)] for r in made}
    found[Regressor("", TIME)] = {
        r.name: np.asarray(np.arange(r.rows) * r.period, dtype=np.float64) for r in records
    }
    return found


def products_of(series: Mapping[Regressor, dict[str, Array]]) -> dict[Regressor, dict[str, Array]]:
    """Each plain variable of a component, what it has travelled, and what is outside of it, times
    each other variable that varies, and each left-hand side: what hardly varies is a coefficient as
    it is.
    """
    plain = [r for r in series if not (r.speed or r.rate)]
    inside = [r for r in series if not (r.speed or r.outside or r.travelled)]
    others = [r for r in inside if _varies(series[r])]
    return {
        replace(r, component=other.component, times=other.name): series[r]
        for other in others
        for r in plain
        if r != other and (r.outside or r.component == other.component)
    }


def rates_of(
    points: Iterable[Point],
    opened: Opened,
    records: Sequence[Record],
    values: Mapping[str, Mapping[str, float]],
) -> dict[Regressor, dict[str, Array]]:
    """Left-hand sides of equations, as the rest of the plant has them."""
    own = {Regressor(p.scope, p.rate): p.rate_variable for p in points if p.rate}
    names = sorted(set(own.values()))
    made = opened.series(names, records, values) if names else {}
    return {
        side: {r: table[:, names.index(name)] for r, table in made.items()}
        for side, name in own.items()
    }


def _varies(values: Mapping[str, Array]) -> bool:
    """Whether a variable differs from its mean by more than a small share of it."""
    whole = np.concatenate(list(values.values()))
    return bool(np.std(whole) > HARDLY * abs(np.mean(whole)))


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


def _speeds(
    opened: Opened, known: Mapping[Regressor, dict[str, Array]]
) -> dict[Regressor, dict[str, Array]]:
    """Rates of states that are states themselves and go both ways: what turns round with a rate
    that it decides itself (an acceleration) has several solutions, or none.
    """
    found: dict[Regressor, dict[str, Array]] = {}
    for speed, values in known.items():
        low, high = _ends(values)
        if opened.is_speed(speed.label) and low < 0 < high:
            found[speed] = values
    return found


def _ends(values: Mapping[str, Array]) -> tuple[float, float]:
    low, high = np.quantile(np.concatenate(list(values.values())), (0.005, 0.995))
    return float(low), float(high)


def _travelled(
    speeds: Mapping[Regressor, Mapping[str, Array]], records: Sequence[Record]
) -> dict[Regressor, dict[str, Array]]:
    """How far each has come at each row, both ways counted."""
    periods = {r.name: r.period for r in records}
    return {
        replace(speed, travelled=True): {
            r: (np.cumsum(np.abs(v)) - np.abs(v)) * periods[r] for r, v in values.items()
        }
        for speed, values in speeds.items()
    }


def _against(
    speeds: Mapping[Regressor, Mapping[str, Array]], known: Mapping[Regressor, dict[str, Array]]
) -> dict[Regressor, dict[str, Array]]:
    """Each variable against each speed of its component."""
    found: dict[Regressor, dict[str, Array]] = {}
    for speed, values in speeds.items():
        low, high = _ends(values)
        width = float(10.0 ** np.floor(np.log10(JUMP * (high - low))))
        for other, own in known.items():
            if other.component == speed.component and other != speed:
                found[replace(other, speed=speed.name, width=width)] = dict(own)
    return found
