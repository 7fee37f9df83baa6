"""Equations of all instances, loops unrolled and branches that parameters decide chosen
(section 8).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from modelica_fmu import ir
from modelica_fmu.modelica import syntax as ast
from modelica_fmu.modelica.connections import Connections
from modelica_fmu.modelica.evaluation import NotConstant
from modelica_fmu.modelica.functions import StatementMaker, action_of
from modelica_fmu.modelica.instances import Frame, Instance, Leaf, Node
from modelica_fmu.modelica.resolve import Resolver
from modelica_fmu.modelica.scope import refuse

MOST_ROUNDS = 100_000  # of all loops over equations


class Sections:
    """What the equation and algorithm sections of a model come to."""

    def __init__(self, resolver: Resolver) -> None:
        self.resolver = resolver
        self.connections = Connections(resolver)
        self.equations: list[ir.Equation | ir.IfEquation] = []
        self.initial: list[ir.Equation | ir.IfEquation] = []
        self.algorithms: list[ir.Algorithm] = []
        self.initial_algorithms: list[ir.Algorithm] = []
        self.whens: list[ir.When] = []
        self.assertions: list[ir.Assertion] = []
        self.rounds = 0

    def collect(self, node: Node) -> None:
        """Of an instance and all within it, the inner ones first."""
        if isinstance(node, list):
            for item in node:
                self.collect(item)
        if not isinstance(node, Instance):
            return
        for _, inner in node.nodes():
            if inner_instance(inner):
                self.collect(inner)
        for action, frame in node.actions("equations"):
            self._equation(action, frame, node, self.equations)
        for action, frame in node.actions("initial_equations"):
            self._equation(action, frame, node, self.initial)
        for which, into in (
            ("algorithms", self.algorithms),
            ("initial_algorithms", self.initial_algorithms),
        ):
            for body, frame in node.actions(which):
                self._algorithm(body, frame, into)  # type: ignore[arg-type]

    def _algorithm(
        self, body: tuple[ast.Action, ...], frame: Frame, into: list[ir.Algorithm]
    ) -> None:
        statements = tuple(StatementMaker(self.resolver, frame).all(body))
        plain = [s for s in statements if isinstance(s, ir.Assertion)]
        rest = tuple(s for s in statements if not isinstance(s, ir.Assertion))
        self.assertions += plain
        if rest:
            into.append(ir.Algorithm(rest[0].place, rest))

    def _equation(self, action: ast.Action, frame: Frame, node: Instance, into: list[Any]) -> None:
        for made in self.flat(action, frame, node):
            if isinstance(made, ir.When):
                self.whens.append(made)
            elif isinstance(made, ir.Assertion):
                self.assertions.append(made)
            elif isinstance(made, ir.Terminate | ir.Reinit):
                raise refuse("reinit() and terminate() stand in a when-clause", made.place)
            else:
                into.append(made)

    def flat(self, action: ast.Action, frame: Frame, node: Instance) -> Iterator[Any]:
        if isinstance(action, ast.Equation):
            yield ir.Equation(
                action.place,
                self.resolver.expression(action.left, frame),
                self.resolver.expression(action.right, frame),
            )
        elif isinstance(action, ast.Connect):
            self.connections.connect(action, frame, node)
        elif isinstance(action, ast.For):
            yield from self._for(action, frame, node)
        elif isinstance(action, ast.If):
            yield from self._if(action, frame, node)
        elif isinstance(action, ast.When):
            yield self._when(action, frame, node)
        elif isinstance(action, ast.CallEquation):
            made = action_of(action, self.resolver, frame)
            if made is not None:
                yield made
        else:
            raise refuse("a statement stands among equations", action.place)

    def _all(self, body: Iterable[ast.Action], frame: Frame, node: Instance) -> list[Any]:
        return [made for action in body for made in self.flat(action, frame, node)]

    def _for(self, action: ast.For, frame: Frame, node: Instance) -> Iterator[Any]:
        first, *rest = action.iterators
        for value in self.resolver.values(first, frame, list(action.body)):
            self.rounds += 1
            if self.rounds > MOST_ROUNDS:
                raise refuse(
                    f"more than {MOST_ROUNDS} rounds of loops over equations",
                    action.place,
                    hint="make the arrays smaller",
                )
            inner = frame.with_iterator(first.name, value)
            if rest:
                yield from self._for(ast.For(action.place, tuple(rest), action.body), inner, node)
            else:
                yield from self._all(action.body, inner, node)

    def _if(self, action: ast.If, frame: Frame, node: Instance) -> Iterator[Any]:
        tests = [self.resolver.expression(c, frame) for c, _ in action.branches]
        known = [self.resolver.evaluator.look(test) for test in tests]
        structural = any(has_connect(body) for _, body in action.branches) or has_connect(
            action.otherwise
        )
        if not structural and not any(k is not None for k in known):
            branches = [
                (test, tuple(self._all(body, frame, node)))
                for test, (_, body) in zip(tests, action.branches, strict=True)
            ]
            otherwise = tuple(self._all(action.otherwise, frame, node))
            bodies = [*(b for _, b in branches), otherwise]
            if _plain(bodies) and (_alike(bodies) or not self._decidable(tests)):
                if otherwise or any(b for _, b in branches):
                    yield from self._choice(action, tuple(branches), otherwise)
                return
        yield from self._decided(action, tests, frame, node)

    def _choice(self, action: ast.If, branches: Any, otherwise: Any) -> Iterator[Any]:
        """Assertions hold under their branch's condition; the rest is an equation per branch."""
        bodies = [*branches, (None, otherwise)]
        if not any(isinstance(e, ir.Assertion) for _, body in bodies for e in body):
            yield ir.IfEquation(action.place, branches, otherwise)
            return
        before: list[ir.Expr] = []
        for condition, body in bodies:
            for e in body:
                if isinstance(e, ir.Assertion):
                    yield _guarded(e, before, condition)
            if condition is not None:
                before.append(condition)
        kept = tuple(
            (c, tuple(e for e in b if not isinstance(e, ir.Assertion))) for c, b in branches
        )
        rest = tuple(e for e in otherwise if not isinstance(e, ir.Assertion))
        if rest:
            yield ir.IfEquation(action.place, kept, rest)

    def _decidable(self, tests: list[ir.Expr]) -> bool:
        """Whether the parameters' values choose a branch."""
        try:
            return self.resolver.evaluator.value(tests[0]) is not None
        except (NotConstant, ValueError, ZeroDivisionError, OverflowError, IndexError, TypeError):
            return False

    def _decided(
        self, action: ast.If, tests: list[ir.Expr], frame: Frame, node: Instance
    ) -> Iterator[Any]:
        """The branch that the parameters choose."""
        for test, (_, body) in zip(tests, action.branches, strict=True):
            if self.resolver.evaluator.value_or_refuse(test, action.place):
                yield from self._all(body, frame, node)
                return
        yield from self._all(action.otherwise, frame, node)

    def _when(self, action: ast.When, frame: Frame, node: Instance) -> ir.When:
        branches = []
        for condition, body in action.branches:
            made = self._all(body, frame, node)
            for inner in made:
                if isinstance(inner, ir.When):
                    raise refuse("a when stands in a when", inner.place, hint="take it out")
            branches.append((self.resolver.expression(condition, frame), tuple(made)))
        return ir.When(action.place, tuple(branches))


def _alike(bodies: list[Any]) -> bool:
    """Branches with as many equations each; an array's may stand beside its elements' even so."""
    return len({sum(not isinstance(e, ir.Assertion) for e in body) for body in bodies}) == 1


def _plain(bodies: list[Any]) -> bool:
    kinds = ir.Equation | ir.IfEquation | ir.Assertion
    return all(isinstance(e, kinds) for body in bodies for e in body)


def _guarded(e: ir.Assertion, before: list[ir.Expr], condition: ir.Expr | None) -> ir.Assertion:
    held = e.condition
    if condition is not None:
        held = ir.Binary(e.place, "or", held, ir.Unary(e.place, "not", condition))
    for other in before:
        held = ir.Binary(e.place, "or", held, other)
    return ir.Assertion(e.place, held, e.message, e.warning)


def inner_instance(node: Node) -> bool:
    if isinstance(node, list):
        return bool(node) and inner_instance(node[0])
    return isinstance(node, Instance)


def has_connect(body: Iterable[ast.Action]) -> bool:
    for action in body:
        if isinstance(action, ast.Connect):
            return True
        if isinstance(action, ast.For) and has_connect(action.body):
            return True
        if isinstance(action, ast.If) and (
            any(has_connect(b) for _, b in action.branches) or has_connect(action.otherwise)
        ):
            return True
    return False


__all__ = ["Leaf", "Sections", "inner_instance"]
