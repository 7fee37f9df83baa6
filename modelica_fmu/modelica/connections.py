"""Connections: equal potentials, flows that sum to zero (section 9.2)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from modelica_fmu import ir
from modelica_fmu.modelica import syntax as ast
from modelica_fmu.modelica.instances import Frame, Instance, Leaf, Node
from modelica_fmu.modelica.resolve import Resolver
from modelica_fmu.modelica.scope import Scope, refuse

End = tuple[str, bool]  # a scalar's name, and whether it is seen from outside its component


def is_connector(scope: Scope) -> bool:
    return scope.cls.kind == "connector" or any(is_connector(base) for _, base in scope.bases())


class Connections:
    def __init__(self, resolver: Resolver) -> None:
        self.resolver = resolver
        self._set_of: dict[End, list[End]] = {}
        self._places: dict[int, ir.Place] = {}
        self._leaves: dict[str, Leaf] = {}
        self._subscripts: dict[str, tuple[int, ...]] = {}

    def connect(self, action: ast.Connect, frame: Frame, node: Instance) -> None:
        found = [self._end(ref, frame, node) for ref in (action.first, action.second)]
        if any(end is None for end in found):
            return  # a component whose condition is false
        (first, outer_a), (second, outer_b) = found  # type: ignore[misc]
        self._pair(first, second, outer_a, outer_b, action)

    def _end(self, ref: ast.Ref, frame: Frame, node: Instance) -> tuple[Any, bool] | None:
        """The connector, with its subscripts applied, and whether it is the model's own."""
        slot = node.slots.get(ref.parts[0].name)
        if slot is None:
            raise refuse(f"unresolved component reference: '{ref}'", ref.place, hint="declare it")
        own = len(ref.parts) == 1 or self._own_connector(node.node(ref.parts[0].name))
        found: Any = node.node(ref.parts[0].name)
        for k, part in enumerate(ref.parts):
            if found is None:
                return None
            if k > 0:
                found = self._inner(found, part.name, ref)
                if found is None:
                    return None
            found = self._chosen(found, part.subscripts, frame, ref)
        return found, own

    def _own_connector(self, node: Node) -> bool:
        while isinstance(node, list) and node:
            node = node[0]
        return isinstance(node, Instance) and is_connector(node.scope)

    def _inner(self, node: Any, name: str, ref: ast.Ref) -> Any:
        if isinstance(node, list):
            return [self._inner(item, name, ref) for item in node]
        if not isinstance(node, Instance) or name not in node.slots:
            raise refuse(f"unresolved component reference: '{ref}'", ref.place, hint="correct it")
        return node.node(name)

    def _chosen(self, node: Any, subscripts: Any, frame: Frame, ref: ast.Ref) -> Any:
        if not subscripts:
            return self._scalars(node)
        node = self._scalars(node)
        for depth, subscript in enumerate(subscripts):
            node = self._select(node, subscript, frame, ref, depth)
        return node

    def _select(self, node: Any, subscript: Any, frame: Frame, ref: ast.Ref, depth: int) -> Any:
        if not isinstance(node, list):
            raise refuse(f"{ref} has too many subscripts", ref.place, hint="correct it")
        if isinstance(subscript, ast.Colon):
            return node
        expr = self.resolver.with_end(self.resolver.expression(subscript, frame), len(node))
        value = self.resolver.evaluator.value_or_refuse(expr, ref.place)
        chosen = value if isinstance(value, list) else [value]
        for i in chosen:
            if isinstance(i, bool | str | list) or not 1 <= i <= len(node) or i != int(i):
                raise refuse(f"subscript {i} of {ref} is out of bounds", ref.place)
        items = [node[int(i) - 1] for i in chosen]
        return items if isinstance(value, list) else items[0]

    def _scalars(self, node: Any) -> Any:
        """An array of numbers as a list of its scalars."""
        if not isinstance(node, Leaf):
            return node

        def of(at: tuple[int, ...], dims: tuple[int, ...]) -> Any:
            if not dims:
                return (node, at)
            return [of((*at, i), dims[1:]) for i in range(1, dims[0] + 1)]

        return of((), node.dims)

    def _pair(self, a: Any, b: Any, outer_a: bool, outer_b: bool, action: ast.Connect) -> None:
        a, b = self._scalars(a), self._scalars(b)
        if isinstance(a, list) and isinstance(b, list):
            if len(a) != len(b):
                raise refuse(
                    f"connected arrays differ in size: {len(a)} and {len(b)} (dimension mismatch)",
                    action.place,
                )
            for x, y in zip(a, b, strict=True):
                self._pair(x, y, outer_a, outer_b, action)
        elif isinstance(a, Instance) and isinstance(b, Instance):
            self._connectors(a, b, outer_a, outer_b, action)
        elif isinstance(a, tuple) and isinstance(b, tuple):
            self._join(a, b, outer_a, outer_b, action)
        else:
            raise refuse(
                f"{action.first} and {action.second} do not fit one another",
                action.place,
                hint="connect connectors of one kind",
            )

    def _connectors(
        self, a: Instance, b: Instance, outer_a: bool, outer_b: bool, action: ast.Connect
    ) -> None:
        for one in (a, b):
            if "expandable" in one.scope.cls.prefixes:
                raise refuse("not supported: expandable connectors", action.place)
        names = [n for n, node in a.nodes() if node is not None]
        others = [n for n, node in b.nodes() if node is not None]
        if set(names) != set(others):
            raise refuse(
                f"{action.first} and {action.second} have different variables", action.place
            )
        for name in names:
            self._pair(a.node(name), b.node(name), outer_a, outer_b, action)

    def _join(self, a: Any, b: Any, outer_a: bool, outer_b: bool, action: ast.Connect) -> None:
        (leaf_a, at_a), (leaf_b, at_b) = a, b
        if leaf_a.variability in ("constant", "parameter"):
            return
        if "stream" in (leaf_a.connection, leaf_b.connection):
            raise refuse("not supported: stream variables", action.place)
        if (leaf_a.connection == "flow") != (leaf_b.connection == "flow"):
            raise refuse(f"{leaf_a.name} and {leaf_b.name}: a flow and a potential", action.place)
        ends = []
        for leaf, at, outer in ((leaf_a, at_a, outer_a), (leaf_b, at_b, outer_b)):
            name = ir.scalar_name(leaf.name, at)
            self._leaves[name], self._subscripts[name] = leaf, at
            ends.append((name, outer if leaf.connection == "flow" else False))
        first = self._set_of.setdefault(ends[0], [ends[0]])
        second = self._set_of.setdefault(ends[1], [ends[1]])
        self._places.setdefault(id(first), action.place)
        if first is not second:
            first += second
            for end in second:
                self._set_of[end] = first

    def equations(self, model: Instance) -> Iterator[ir.Equation]:
        """Of all sets, then of flows that nothing is connected to."""
        done: set[int] = set()
        for found in self._set_of.values():
            if id(found) in done:
                continue
            done.add(id(found))
            place = self._places.get(id(found)) or self._leaves[found[0][0]].place
            if self._leaves[found[0][0]].connection == "flow":
                yield self._sum(found, place)
            else:
                yield from self._equal(found, place)
        for name, leaf, at in flows(model):
            if (name, False) not in self._set_of:
                self._leaves[name], self._subscripts[name] = leaf, at
                zero = ir.Literal(leaf.place, 0.0)
                yield ir.Equation(leaf.place, self._name(name, leaf.place), zero)

    def _name(self, name: str, place: ir.Place) -> ir.Name:
        leaf = self._leaves[name]
        self.resolver.evaluator.leaves[leaf.name] = leaf
        at = tuple(ir.Literal(place, i, "Integer") for i in self._subscripts[name])
        return ir.Name(place, leaf.name, at)

    def _sum(self, ends: list[End], place: ir.Place) -> ir.Equation:
        total: ir.Expr | None = None
        for name, outer in ends:
            term: ir.Expr = self._name(name, place)
            if total is None:
                total = ir.Unary(place, "-", term) if outer else term
            else:
                total = ir.Binary(place, "-" if outer else "+", total, term)
        assert total is not None
        return ir.Equation(place, total, ir.Literal(place, 0.0))

    def _equal(self, ends: list[End], place: ir.Place) -> Iterator[ir.Equation]:
        names = list(dict.fromkeys(name for name, _ in ends))
        for name in names[1:]:
            yield ir.Equation(place, self._name(names[0], place), self._name(name, place))


def flows(node: Node, within: bool = False) -> Iterator[tuple[str, Leaf, tuple[int, ...]]]:
    """Scalars of all flow variables of connectors."""
    if isinstance(node, list):
        for item in node:
            yield from flows(item, within)
    elif isinstance(node, Leaf):
        if within and node.connection == "flow":
            for at in ir.subscripts_of(node.dims):
                yield ir.scalar_name(node.name, at), node, at
    elif isinstance(node, Instance):
        inside = within or is_connector(node.scope)
        for name, inner in node.nodes():
            if "outer" in node.slots[name].component.scope and (
                "inner" not in node.slots[name].component.scope
            ):
                continue
            yield from flows(inner, inside)
