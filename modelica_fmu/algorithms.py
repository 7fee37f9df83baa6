"""Algorithm sections of a model: run symbolically, so that each variable they assign gets one value
(section 11.1.2).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from modelica_fmu import ir
from modelica_fmu.expressions import Translator, Value, choose, flatten
from modelica_fmu.functions import Interpreter
from modelica_fmu.hybrid import Assertion, Branch, HybridNames, HybridScope, HybridSystem
from modelica_fmu.symbols import targets


class AlgorithmScope(HybridNames):
    """Names mean what has been assigned so far."""

    def __init__(self, scope: HybridScope) -> None:
        super().__init__(scope)
        self.values: dict[str, Value] = {}

    def name(self, name: str, node: Any) -> Value:
        return self.values[name] if name in self.values else self.table.value(name, node)


class AlgorithmRun(Interpreter):
    def __init__(self, system: HybridSystem, scope: AlgorithmScope, events: bool) -> None:
        super().__init__(system.table.source, scope, Translator(system.table.source, scope, events))
        self.system, self.branch = system, Branch(-1, ca.SX(1), ca.SX(1))

    def _whenstatement(self, node: ir.WhenStatement) -> None:
        number = len({branch.chain for branch in self.system.branches})
        before = dict(self.scope.values)
        outcomes: list[tuple[ca.SX, dict[str, Value]]] = []
        for condition, body in node.branches:
            self.scope.values = dict(before)
            first = len(self.system.branches)
            tests = flatten(self.translate(condition))
            made = [Branch(number, t, ca.SX.sym(f"fired_{first + i}")) for i, t in enumerate(tests)]
            self.system.branches += made
            fired = made[0].fired
            for other in made[1:]:
                fired = ca.logic_or(fired, other.fired)
            outer, self.branch = self.branch, made[0]
            translate, self.translate = self.translate, self.translate.without_events()
            self.statements(body)
            self.branch, self.translate = outer, translate
            for other in made[1:]:
                other.reinits, other.stops = made[0].reinits, made[0].stops
            outcomes.append((fired, self.scope.values))
        self.scope.values = before
        for fired, values in reversed(outcomes):
            for name, value in values.items():
                other_value = self.scope.values.get(name, value)
                if value is not other_value:
                    self.scope.values[name] = choose(fired, value, other_value)

    def _reinit(self, node: ir.Reinit) -> None:
        target = self.translate.scalar(node.state)
        if target.name() not in self.system.derivatives:
            raise self.source.refuse(f"{target.name()} is not a state", node)
        self.branch.reinits[target.name()] = self.translate.scalar(node.value)

    def _assertion(self, node: ir.Assertion) -> None:
        condition = self.translate.without_events().scalar(node.condition)
        if self.branch.chain >= 0:
            condition = ca.logic_or(ca.logic_not(self.branch.fired), condition)
        self.system.assertions.append(Assertion(condition, node.message, node.warning))

    def _terminate(self, node: ir.Terminate) -> None:
        self.branch.stops = node.message


def run_algorithm(system: HybridSystem, hybrid: HybridScope, algorithm: ir.Algorithm) -> None:
    """Adds a residual for each variable assigned, an update for each that changes at events."""
    scope = AlgorithmScope(hybrid)
    names = list(dict.fromkeys(target.name for target in targets(algorithm.body)))
    for name in names:
        scope.values[name] = _before(system, name)
    old = {name: flatten(scope.values[name]) for name in names}
    run = AlgorithmRun(system, scope, events=True)
    run.statements(algorithm.body)
    for name in names:
        symbols = flatten(system.table.value(name, algorithm))
        for symbol, before, value in zip(
            symbols, old[name], flatten(run.scope.values[name]), strict=True
        ):
            scalar = system.table.scalars[symbol.name()]
            if scalar.kind == "discrete":
                system.updates[scalar.name] = value
            elif value is not before:
                system.residuals.append((symbol - value, algorithm))


def _before(system: HybridSystem, name: str) -> Value:
    """What a variable is before its first assignment: at events its old value, else its start."""
    table = system.table

    def of(value: Value) -> Value:
        if isinstance(value, list):
            return [of(item) for item in value]
        scalar = table.scalars[value.name()]
        if scalar.kind == "algebraic" and not scalar.discrete_valued:
            return scalar.value if scalar.value is not None else ca.SX(0)
        return (
            system.pre.get(scalar.name, scalar.symbol)
            if scalar.kind == "discrete"
            else scalar.symbol
        )

    return of(table.value(name, None))


def run_initial_algorithm(
    system: HybridSystem, hybrid: HybridScope, algorithm: ir.Algorithm
) -> None:
    """Adds an initial equation for each variable assigned."""
    scope = AlgorithmScope(hybrid)
    names = list(dict.fromkeys(target.name for target in targets(algorithm.body)))
    run = AlgorithmRun(system, scope, events=False)
    run.statements(algorithm.body)
    for name in names:
        symbols = flatten(system.table.value(name, algorithm))
        values = flatten(run.scope.values[name])
        for symbol, value in zip(symbols, values, strict=True):
            if value is not symbol:
                system.initial_residuals.append((symbol - value, algorithm))
