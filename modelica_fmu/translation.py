"""A flat model's equations, algorithms, when-clauses and assertions as a hybrid system."""

from __future__ import annotations

from typing import Any

import casadi as ca

from modelica_fmu import ir
from modelica_fmu.algorithms import run_algorithm, run_initial_algorithm
from modelica_fmu.arrays import shape
from modelica_fmu.expressions import Translator, Value, elementwise, flatten
from modelica_fmu.hybrid import (
    Assertion,
    Branch,
    HybridScope,
    HybridSystem,
)
from modelica_fmu.ir import FlatModel
from modelica_fmu.source import place_of
from modelica_fmu.symbols import build_table, scalars_under

__all__ = ["build_system"]


def build_system(model: FlatModel) -> HybridSystem:
    """Translates equations, algorithms, when-clauses and assertions of a flat model."""
    table, functions = build_table(model)
    system = HybridSystem(table)
    under_pre = scalars_under(model, ("pre", "edge", "change"))
    for scalar in table.scalars.values():
        if scalar.kind == "state":
            if scalar.discrete_valued:
                raise table.source.refuse(
                    f"der({scalar.name}) of a variable that is no Real", scalar.variable
                )
            system.derivatives[scalar.name] = ca.SX.sym(f"der({scalar.name})")
        remembered = (
            scalar.name in under_pre and scalar.kind == "algebraic" and scalar.discrete_valued
        )
        if scalar.kind == "discrete" or remembered:
            system.memories.append(scalar)
            system.pre[scalar.name] = ca.SX.sym(f"pre({scalar.name})")
    scope = HybridScope(system, functions)
    translate = Translator(table.source, scope)
    for equation in model.equations:
        for residual in residuals(translate, equation):
            system.residuals.append((residual, equation))
    _bindings(system, translate)
    for algorithm in model.algorithms:
        run_algorithm(system, scope, algorithm)
    for when in model.whens:
        number = len({branch.chain for branch in system.branches})
        for condition, actions in when.branches:
            system.branches += _branches(system, translate, number, condition, actions)
    for assertion in model.assertions:
        condition = translate.without_events().scalar(assertion.condition)
        system.assertions.append(Assertion(condition, assertion.message, assertion.warning))
    for equation in model.initial_equations:
        for residual in residuals(translate.without_events(), equation):
            system.initial_residuals.append((residual, equation))
    for algorithm in model.initial_algorithms:
        run_initial_algorithm(system, scope, algorithm)
    constants = table.of("constant")
    if constants:
        _put_constants(system, [s.symbol for s in constants], [s.value for s in constants])
    return system


def _bindings(system: HybridSystem, translate: Translator) -> None:
    """Equations that stand as values of variables."""
    known: dict[str, Value] = {}
    for scalar in system.table.scalars.values():
        variable = scalar.variable
        if scalar.kind not in ("algebraic", "state", "discrete") or variable.binding is None:
            continue
        if variable.name not in known:
            known[variable.name] = translate(variable.binding)
        value = _element(known[variable.name], scalar.subscripts)
        if not isinstance(value, ca.SX):
            raise translate.source.refuse(
                f"dimension mismatch: the value of {variable.name} does not fit it", variable
            )
        system.residuals.append((scalar.symbol - value, variable))


def residuals(translate: Translator, equation: ir.Equation | ir.IfEquation) -> list[ca.SX]:
    """Left minus right side, scalar by scalar."""
    if isinstance(equation, ir.IfEquation):
        return _if_residuals(translate, equation)
    left, right = _sides(translate, equation)
    try:
        return flatten(elementwise(lambda a, b: a - b, left, right))
    except (ValueError, TypeError, KeyError):
        raise translate.source.refuse(
            "dimension mismatch: the two sides differ in size", equation, hint="correct the sizes"
        ) from None


def _sides(translate: Translator, equation: ir.Equation) -> tuple[Value, Value]:
    left, right = equation.left, equation.right
    if isinstance(left, ir.Several):
        if not isinstance(right, ir.Call):
            raise translate.source.refuse("several names take a function's results", equation)
        results = translate.scope.call(right, translate, every=True)
        pairs = [
            (translate(item), result)
            for item, result in zip(left.items, results, strict=False)
            if item is not None
        ]
        return [a for a, _ in pairs], [b for _, b in pairs]
    one, other = translate(left), translate(right)
    for value in (one, other):
        if isinstance(value, str):
            raise translate.source.refuse("not supported: a String in an equation", equation)
    if isinstance(one, list) != isinstance(other, list):
        raise translate.source.refuse(
            "dimension mismatch: an array equals a scalar", equation, hint="correct the sizes"
        )
    return one, other


def _if_residuals(translate: Translator, equation: ir.IfEquation) -> list[ca.SX]:
    conditions = [translate.scalar(c) for c, _ in equation.branches]
    bodies = [
        [r for e in body for r in residuals(translate, e)]
        for body in (*(b for _, b in equation.branches), equation.otherwise)
    ]
    if len({len(body) for body in bodies}) != 1:
        raise translate.source.refuse(
            "the branches of an if-equation differ in their number of equations",
            equation,
            hint="write as many equations in each branch, an else among them",
        )
    targets = _common_targets(translate, equation)
    result = bodies[-1]
    if targets is not None:  # x = ... in every branch: x = if ... then ... else ...
        bodies = [[t - r for t, r in zip(targets, body, strict=True)] for body in bodies]
        result = bodies[-1]
    for condition, body in zip(reversed(conditions), reversed(bodies[:-1]), strict=True):
        result = [ca.if_else(condition, a, b) for a, b in zip(body, result, strict=True)]
    if targets is not None:
        result = [t - r for t, r in zip(targets, result, strict=True)]
    return result


def _common_targets(translate: Translator, equation: ir.IfEquation) -> list[ca.SX] | None:
    """What all branches determine in the same order, if they do."""
    found: list[list[ca.SX]] = []
    for body in (*(b for _, b in equation.branches), equation.otherwise):
        if not all(isinstance(e, ir.Equation) for e in body):
            return None
        sides = [v for e in body if isinstance(e, ir.Equation) for v in flatten(translate(e.left))]
        found.append(sides)
    same = all(
        len(sides) == len(found[0])
        and all(ca.is_equal(a, b) for a, b in zip(sides, found[0], strict=True))
        for sides in found
    )
    return found[0] if same and all(s.is_symbolic() for s in found[0]) else None


def _element(value: Value, subscripts: tuple[int, ...]) -> Any:
    for subscript in subscripts:
        if isinstance(value, list):
            if subscript > len(value):
                return None
            value = value[subscript - 1]
    return value


def _branches(
    system: HybridSystem,
    translate: Translator,
    chain: int,
    condition: Any,
    actions: tuple[ir.WhenAction, ...],
) -> list[Branch]:
    """One branch for each condition of `when {a, b} then`: it fires when any of them rises."""
    first = len(system.branches)
    conditions = flatten(translate(condition))
    branches = [
        Branch(chain, test, ca.SX.sym(f"fired_{first + i}")) for i, test in enumerate(conditions)
    ]
    if not branches:
        return []
    branch, inside = branches[0], translate.without_events()
    for action in actions:
        _act(system, inside, branch, action, ca.SX(1))
    for other in branches[1:]:
        other.assigns, other.reinits = branch.assigns, branch.reinits
        other.stops = branch.stops
    return branches


def _act(
    system: HybridSystem, inside: Translator, branch: Branch, action: Any, where: ca.SX
) -> None:
    """What one equation of a when-clause does; `where`: the condition of the if it stands in."""
    source = system.table.source
    if isinstance(action, ir.Equation):
        left, right = _sides(inside, action)
        for target, value in _paired(system, left, right, action):
            name = target.name() if target.is_symbolic() else ""
            scalar = system.table.scalars.get(name)
            if scalar is None or scalar.kind != "discrete":
                raise source.refuse("an equation in a when-clause gives a variable a value", action)
            _twice(system, branch, name, action)
            before = branch.assigns.get(name, scalar.symbol)
            branch.assigns[name] = ca.if_else(where, value, before) if _open(where) else value
    elif isinstance(action, ir.Reinit):
        for target, value in _paired(system, inside(action.state), inside(action.value), action):
            if not target.is_symbolic():
                raise source.refuse("reinit() takes a state", action, hint="name a state")
            if target.name() not in system.derivatives:
                raise source.refuse(
                    f"reinit() takes a state, {target.name()} is none: "
                    f"{target.name()} is not a state",
                    action,
                )
            before = branch.reinits.get(target.name(), target)
            value = ca.if_else(where, value, before) if _open(where) else value
            branch.reinits[target.name()] = value
    elif isinstance(action, ir.IfEquation):
        rest = where
        for condition, body in action.branches:
            test = inside.scalar(condition)
            for inner in body:
                _act(system, inside, branch, inner, ca.logic_and(rest, test))
            rest = ca.logic_and(rest, ca.logic_not(test))
        for inner in action.otherwise:
            _act(system, inside, branch, inner, rest)
    elif isinstance(action, ir.Assertion):
        held = ca.logic_or(ca.logic_not(branch.fired), inside.scalar(action.condition))
        system.assertions.append(Assertion(held, action.message, action.warning))
    elif isinstance(action, ir.Terminate):
        branch.stops = action.message
    else:
        kind = type(action).__name__
        raise source.refuse(f"not supported: {kind} in a when-clause", action)


def _paired(
    system: HybridSystem, left: Value, right: Value, node: Any
) -> list[tuple[ca.SX, ca.SX]]:
    """Targets and values, scalar by scalar; InputError where their sizes differ."""
    if isinstance(left, str) or isinstance(right, str):
        raise system.table.source.refuse("not supported: a String in a when-clause", node)
    try:
        if shape(left) != shape(right):
            raise ValueError("an array and a scalar")
        values = flatten(elementwise(lambda _, value: value, left, right))
        return list(zip(flatten(left), values, strict=True))
    except (ValueError, TypeError, KeyError):
        raise system.table.source.refuse(
            "dimension mismatch: the two sides differ in size", node, hint="correct the sizes"
        ) from None


def _open(where: ca.SX) -> bool:
    return not (where.is_constant() and float(where) != 0)


def _twice(system: HybridSystem, branch: Branch, name: str, node: Any) -> None:
    """A variable is given its values by one when-clause."""
    for other in system.branches:
        if other.chain != branch.chain and name in other.assigns:
            place = place_of(node)
            raise system.table.source.refuse(
                f"{name} is assigned in two when-clauses", place, hint="join them with elsewhen"
            )


def _put_constants(system: HybridSystem, old: list[ca.SX], new: list[Any]) -> None:
    def put(expression: ca.SX) -> ca.SX:
        return ca.substitute([expression], old, new)[0]

    system.residuals = [(put(residual), node) for residual, node in system.residuals]
    system.initial_residuals = [(put(r), node) for r, node in system.initial_residuals]
    system.updates = {name: put(value) for name, value in system.updates.items()}
    for relation in system.relations:
        relation.indicator = put(relation.indicator)
    for rounding in system.roundings:
        rounding.argument = put(rounding.argument)
    for sample in system.samples:
        sample.start, sample.interval = put(sample.start), put(sample.interval)
    for delay in system.delays:
        delay.expression, delay.time, delay.maximum = (
            put(delay.expression),
            put(delay.time),
            put(delay.maximum),
        )
    for branch in system.branches:
        branch.condition = put(branch.condition)
        branch.assigns = {k: put(v) for k, v in branch.assigns.items()}
        branch.reinits = {k: put(v) for k, v in branch.reinits.items()}
    for assertion in system.assertions:
        assertion.condition = put(assertion.condition)
