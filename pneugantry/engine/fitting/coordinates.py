"""Which coordinates a hypothesis has: what is fitted, of what every rig has somewhat off and of its
effects; and which views read them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from pneugantry.engine.fitting.fit import Fit, theta_in
from pneugantry.engine.hypotheses.catalogue import Form, Parameter
from pneugantry.engine.hypotheses.hypothesis import (
    Coordinate,
    Hypothesis,
    effect_coordinate,
    nuisance_coordinate,
)
from pneugantry.engine.plant import Plant
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.commands import outside
from pneugantry.engine.signals.sensors import neutral
from pneugantry.engine.views.simulation import Cell, Point, Simulation

__all__ = ["Coordinates"]


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Those of one plant, its views and its records."""

    plant: Plant
    simulation: Simulation
    rules: Rules

    @cached_property
    def _nominal(self) -> dict[str, float]:
        """Values of the model's parameters."""
        known: dict[str, float] = {}
        for view in self.simulation.views.values():
            known.update(view.defaults)
        return {**known, **self.plant.parameters}

    def neutral(self, name: str) -> float:
        """Value of a parameter without any effect."""
        return neutral(name) if outside(name) else self._nominal.get(name, 0.0)

    def of_effect(self, p: Parameter) -> Coordinate:
        """The coordinate of an effect's parameter."""
        described = p.name in self.plant.parameters
        return effect_coordinate(p, self.neutral(p.name), self.rules.effect_prior, described)

    def readable(self, form: Form) -> bool:
        """Whether some view reads a parameter of a form."""
        return any(self.simulation.reads(p.name) for p in form.parameters)

    def touched(self, hypothesis: Hypothesis) -> list[Cell]:
        """Cells whose view reads anything of a hypothesis' effects."""
        read = {view for _, form in hypothesis.effects for view in self.readers(form)}
        return [c for c in self.simulation.cells if c[0] in read]

    def readers(self, form: Form) -> set[str]:
        """Views that read anything of a form."""
        names = {p.name for p in form.parameters} | set(form.settings)
        views = self.simulation.views
        return {c[0] for c in self.simulation.cells if any(map(views[c[0]].depends_on, names))}

    def of(self, hypothesis: Hypothesis, scale: float) -> tuple[Coordinate, ...]:
        """Nuisances, then effects; an effect's parameter is no nuisance besides, and one that two
        effects share is one.
        """
        own = {p.name: p for p in reversed(hypothesis.parameters)}
        effects = [self.of_effect(p) for p in own.values()]
        taken = {c.parameter for c in effects}
        rest = [c for c in self.nuisances() if c.parameter not in taken]
        return (*(replace(c, spread=scale) if c.scales else c for c in rest), *effects)

    def nuisances(self) -> list[Coordinate]:
        """Coordinates of what every rig has somewhat off."""
        made = []
        for n in self.plant.nuisances:
            if not n.per_record:
                if self.simulation.reads(n.parameter):
                    made.append(nuisance_coordinate(n, self.neutral(n.parameter), None))
                continue
            for name, record in self.simulation.records.items():
                if n.parameter in record.parameters and self.simulation.reads(n.parameter, name):
                    made.append(nuisance_coordinate(n, record.parameters[n.parameter], name))
        return made

    def unseen(self, fit: Fit) -> list[Coordinate]:
        """Of what every rig has off and no record shows: it keeps its prior."""
        known = {c.parameter for c in fit.point.coordinates}
        left = [n for n in self.plant.nuisances if not n.per_record and n.parameter not in known]
        made = [nuisance_coordinate(n, self.neutral(n.parameter), None) for n in left]
        return [replace(c, spread=fit.scale) if c.scales else c for c in made]

    def moving(self, parameters: Iterable[Parameter]) -> set[str]:
        """Of effects, and what every rig has somewhat off."""
        return {*(p.name for p in parameters), *(n.parameter for n in self.plant.nuisances)}

    def first(self, hypothesis: Hypothesis, base: Fit, starts: Mapping[str, float]) -> Point:
        """Where a hypothesis starts from a base, and from values of parameters besides."""
        coordinates = self.of(hypothesis, base.scale)
        at = base.dropped({c.name for c in coordinates})
        theta = theta_in(base.point.moved(at), coordinates)
        for i, c in enumerate(coordinates):
            if c.parameter in starts:
                theta[i] = c.theta(starts[c.parameter])
        return Point(coordinates, theta, hypothesis.settings)
