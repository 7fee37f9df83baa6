"""Expressions of the text → expressions of the flat model: names become what they mean."""

from __future__ import annotations

from itertools import product as every
from typing import Any

from modelica_fmu import ir
from modelica_fmu.modelica import syntax as ast
from modelica_fmu.modelica.evaluation import Evaluator, NotConstant
from modelica_fmu.modelica.functions import FunctionTable
from modelica_fmu.modelica.instances import Frame, Instance, Leaf, Node, package_of
from modelica_fmu.modelica.modifiers import Bound
from modelica_fmu.modelica.scope import Scope, refuse

OPERATORS = frozenset(
    [
        "der",
        "pre",
        "edge",
        "change",
        "initial",
        "terminal",
        "sample",
        "delay",
        "noEvent",
        "smooth",
        "homotopy",
        "semiLinear",
        "reinit",
        "abs",
        "sign",
        "sqrt",
        "mod",
        "rem",
        "div",
        "floor",
        "ceil",
        "integer",
        "min",
        "max",
        "sum",
        "product",
        "size",
        "ndims",
        "fill",
        "zeros",
        "ones",
        "identity",
        "diagonal",
        "linspace",
        "cat",
        "transpose",
        "vector",
        "matrix",
        "scalar",
        "cross",
        "skew",
        "symmetric",
        "outerProduct",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "atan2",
        "sinh",
        "cosh",
        "tanh",
        "exp",
        "log",
        "log10",
        "Integer",
    ]
)
REFUSED_OPERATORS = frozenset(
    [
        "spatialDistribution",
        "inStream",
        "actualStream",
        "cardinality",
        "getInstanceName",
        "Clock",
        "hold",
        "previous",
        "subSample",
        "superSample",
        "shiftSample",
        "backSample",
        "noClock",
        "firstTick",
        "interval",
        "String",
        "function",
        "Connections",
        "pure",
        "array",
    ]
)
ARGUMENTS = {  # of operators: least, most
    **dict.fromkeys(
        ["der", "pre", "edge", "change", "noEvent", "ndims", "transpose", "diagonal", "skew"],
        (1, 1),
    ),
    **dict.fromkeys(
        [
            "floor",
            "ceil",
            "integer",
            "abs",
            "sign",
            "sqrt",
            "sin",
            "cos",
            "tan",
            "asin",
            "acos",
            "atan",
        ],
        (1, 1),
    ),
    **dict.fromkeys(
        ["sinh", "cosh", "tanh", "exp", "log", "log10", "sum", "identity", "symmetric"], (1, 1)
    ),
    **dict.fromkeys(
        ["mod", "rem", "div", "atan2", "cross", "outerProduct", "smooth", "reinit"], (2, 2)
    ),
    **dict.fromkeys(["initial", "terminal"], (0, 0)),
    **dict.fromkeys(["vector", "matrix", "scalar", "Integer", "product"], (1, 1)),
    **dict.fromkeys(["min", "max", "sample", "homotopy", "size"], (1, 2)),
    "delay": (2, 3),
    "semiLinear": (3, 3),
    "linspace": (3, 3),
    "fill": (2, 99),
    "cat": (2, 99),
    "zeros": (1, 99),
    "ones": (1, 99),
}
REDUCTIONS = ("sum", "product", "min", "max", "array")


class Resolver:
    def __init__(self, evaluator: Evaluator) -> None:
        self.evaluator = evaluator
        evaluator.resolver = self
        self.functions = FunctionTable(self)
        self.enumerations: dict[str, tuple[tuple[str, str], ...]] = {}

    def expression(self, expr: ast.Expr, frame: Frame) -> ir.Expr:
        return getattr(self, f"_{type(expr).__name__.lower()}")(expr, frame)

    def bound(self, bound: Bound) -> ir.Expr:
        """A modifier's value, or its share for one element or field."""
        value = self.expression(bound.expr, bound.frame)
        for step in bound.steps:
            value = self._step(value, step)
        return value

    def _step(self, value: ir.Expr, step: int | str) -> ir.Expr:
        if isinstance(step, str):
            return field_of(value, step)
        if isinstance(value, ir.Array):
            if step > len(value.items):
                raise refuse(f"the array has no element {step}", value.place)
            return value.items[step - 1]
        shape = self.shape(value)
        if shape == []:
            return value
        at = ir.Literal(value.place, step, "Integer")
        if isinstance(value, ir.Name) and shape:
            return ir.Name(value.place, value.name, (*value.subscripts, at))
        return ir.Index(value.place, value, (at,), lenient=True)

    def shape(self, expr: ir.Expr) -> list[int] | None:
        """Dimensions, where the form of an expression tells them."""
        if isinstance(expr, ir.Literal | ir.Text):
            return []
        if isinstance(expr, ir.Array):
            inner = self.shape(expr.items[0]) if expr.items else []
            return None if inner is None else [len(expr.items), *inner]
        if isinstance(expr, ir.Name) and expr.name in self.evaluator.leaves:
            dims = list(self.evaluator.leaves[expr.name].dims)
            if any(isinstance(s, ir.Slice | ir.Range | ir.Array) for s in expr.subscripts):
                return None
            return dims[len(expr.subscripts) :]
        return None

    # ---- plain expressions

    def _number(self, e: ast.Number, frame: Frame) -> ir.Expr:
        return ir.Literal(e.place, e.value, "Integer" if e.integer else "Real")

    def _truth(self, e: ast.Truth, frame: Frame) -> ir.Expr:
        return ir.Literal(e.place, float(e.value), "Boolean")

    def _text(self, e: ast.Text, frame: Frame) -> ir.Expr:
        return ir.Text(e.place, e.value)

    def _unary(self, e: ast.Unary, frame: Frame) -> ir.Expr:
        return ir.Unary(e.place, e.op, self.expression(e.operand, frame))

    def _binary(self, e: ast.Binary, frame: Frame) -> ir.Expr:
        chain: list[ast.Binary] = [e]  # long sums lean to the left: no recursion along them
        while isinstance(chain[-1].left, ast.Binary):
            chain.append(chain[-1].left)
        made = self.expression(chain[-1].left, frame)
        for node in reversed(chain):
            made = ir.Binary(node.place, node.op, made, self.expression(node.right, frame))
        return made

    def _ifexpr(self, e: ast.IfExpr, frame: Frame) -> ir.Expr:
        """Branches that constants rule out are not looked at: they may not fit."""
        branches: list[tuple[ir.Expr, ir.Expr]] = []
        for condition, value in e.branches:
            test = self.expression(condition, frame)
            known = self.evaluator.look(test)
            if known is not None and not known:
                continue
            if known is not None:
                last = self.expression(value, frame)
                return ir.Choice(e.place, tuple(branches), last) if branches else last
            branches.append((test, self.expression(value, frame)))
        otherwise = self.expression(e.otherwise, frame)
        return ir.Choice(e.place, tuple(branches), otherwise) if branches else otherwise

    def _braces(self, e: ast.Braces, frame: Frame) -> ir.Expr:
        if e.iterators:
            return self._comprehension(e.place, e.items[0], e.iterators, frame)
        return ir.Array(e.place, tuple(self.expression(item, frame) for item in e.items))

    def _brackets(self, e: ast.Brackets, frame: Frame) -> ir.Expr:
        rows = [tuple(self.expression(item, frame) for item in row) for row in e.rows]
        if all(self.shape(item) == [] for row in rows for item in row):
            return ir.Array(e.place, tuple(ir.Array(e.place, row) for row in rows))
        two = ir.Literal(e.place, 2, "Integer")
        made = tuple(
            ir.Builtin(e.place, "cat", (two, *(matrix_of(item) for item in row))) for row in rows
        )
        if len(made) == 1:
            return made[0]
        return ir.Builtin(e.place, "cat", (ir.Literal(e.place, 1, "Integer"), *made))

    def _range(self, e: ast.Range, frame: Frame) -> ir.Expr:
        step = self.expression(e.step, frame) if e.step is not None else None
        start, stop = self.expression(e.start, frame), self.expression(e.stop, frame)
        made = ir.Range(e.place, start, step, stop)
        if frame.locals or _has_end(e):
            return made
        return literal(self.evaluator.value_or_refuse(made, e.place), e.place)

    def _tuple(self, e: ast.Tuple, frame: Frame) -> ir.Expr:
        return ir.Several(
            e.place, tuple(None if i is None else self.expression(i, frame) for i in e.items)
        )

    def _colon(self, e: ast.Colon, frame: Frame) -> ir.Expr:
        return ir.Slice(e.place)

    def _end(self, e: ast.End, frame: Frame) -> ir.Expr:
        return ir.Last(e.place)

    def _comprehension(
        self, place: ir.Place, body: ast.Expr, iterators: tuple[ast.Iterator, ...], frame: Frame
    ) -> ir.Expr:
        if frame.locals:  # of a function: its ranges are known when it is called
            for iterator in iterators:
                frame = Frame(
                    frame.instance, frame.scope, frame.iterators, frame.locals | {iterator.name}
                )
            ranges = tuple((i.name, self._range_of(i, frame, place)) for i in iterators)
            return ir.Comprehension(place, self.expression(body, frame), ranges)
        *outer, last = iterators
        if outer:  # the first iterator runs fastest: {{... for first} for last}
            items = []
            for value in self.values(last, frame, body):
                inner = frame.with_iterator(last.name, value)
                items.append(self._comprehension(place, body, tuple(outer), inner))
            return ir.Array(place, tuple(items))
        return ir.Array(
            place,
            tuple(
                self.expression(body, frame.with_iterator(last.name, value))
                for value in self.values(last, frame, body)
            ),
        )

    def _range_of(self, iterator: ast.Iterator, frame: Frame, place: ir.Place) -> ir.Expr:
        if iterator.range is None:
            raise refuse(f"not supported: the range of {iterator.name} is left open", place)
        return self.expression(iterator.range, frame)

    def values(self, iterator: ast.Iterator, frame: Frame, body: Any = None) -> list[ir.Literal]:
        """All values of an iterator, as literals."""
        found = iterator.range
        if found is None:
            size = self._open_range(iterator.name, body, frame)
            if size is None:
                raise refuse(f"unresolved range of {iterator.name}", getattr(body, "place", None))
            place = body.place
            return [ir.Literal(place, i, "Integer") for i in range(1, size + 1)]
        if isinstance(found, ast.Ref):
            literals = self._enumeration(found, frame)
            if literals is not None:
                scope, names = literals
                return [ir.Literal(found.place, i, scope) for i in range(1, len(names) + 1)]
        value = self.evaluator.of(found, frame)
        items = value if isinstance(value, list) else [value]
        return [literal(item, found.place) for item in items]

    def _open_range(self, name: str, node: Any, frame: Frame) -> int | None:
        """Size of the dimension in whose subscript the iterator stands."""
        if isinstance(node, ast.Ref):
            for k, part in enumerate(node.parts):
                for j, subscript in enumerate(part.subscripts):
                    if isinstance(subscript, ast.Ref) and str(subscript) == name:
                        bare = (*node.parts[:k], ast.Part(part.name, ()))
                        shape = self.shape(self.expression(ast.Ref(node.place, bare), frame))
                        if shape is not None and j < len(shape):
                            return shape[j]
        if isinstance(node, tuple | list):
            children: list[Any] = list(node)
        else:
            slots = getattr(type(node), "__slots__", ())
            children = [getattr(node, s) for s in slots if s != "place"]
        for child in children:
            if isinstance(child, tuple | list) or hasattr(child, "place"):
                found = self._open_range(name, child, frame)
                if found is not None:
                    return found
            elif isinstance(child, ast.Part):
                found = self._open_range(name, child.subscripts, frame)
                if found is not None:
                    return found
        return None

    # ---- names

    def _ref(self, e: ast.Ref, frame: Frame) -> ir.Expr:
        first = e.parts[0]
        if not e.absolute:
            if first.name in frame.iterators and len(e.parts) == 1:
                return frame.iterators[first.name]
            if first.name in frame.locals:
                return self._local(e, frame)
            found = self._component(first.name, frame)
            if found is not None:
                return self._walk(found, e, 0, frame)
            if first.name == "time" and len(e.parts) == 1:
                return ir.Name(e.place, "time")
        made = self._member_of_class(e, frame)
        if made is None:
            raise refuse(f"unresolved component reference: '{e}'", e.place, hint="declare it")
        return made

    def _local(self, e: ast.Ref, frame: Frame) -> ir.Expr:
        made: ir.Expr | None = None
        for part in e.parts:
            subscripts = tuple(self.expression(s, frame) for s in part.subscripts)
            if made is None:
                made = ir.Name(e.place, part.name, subscripts)
                continue
            made = ir.Field(e.place, made, part.name)
            if subscripts:
                made = ir.Index(e.place, made, subscripts)
        assert made is not None
        return made

    def _component(self, name: str, frame: Frame) -> Node:
        """The component that a simple name means, looked for from the frame outwards."""
        if frame.instance is not None and name in frame.instance.slots:
            return self._present(frame.instance, name)
        scope: Scope | None = frame.scope
        while scope is not None and scope.parent is not None:
            if (scope is not frame.scope or frame.instance is None) and scope.own_component(name):
                return self._present(package_of(scope, self.evaluator), name)
            if scope.own_class(name) is not None:
                return None
            imported = scope.imported(name)
            if isinstance(imported, tuple):
                return self._present(package_of(imported[0], self.evaluator), imported[1])
            if imported is not None or "encapsulated" in scope.cls.prefixes:
                return None
            scope = scope.parent
        return None

    def _present(self, owner: Instance, name: str) -> Node:
        node = owner.node(name)
        if node is None:
            raise refuse(
                f"{name} is absent: its condition is false", owner.slots[name].component.place
            )
        return node

    def _member_of_class(self, e: ast.Ref, frame: Frame) -> ir.Expr | None:
        scope: Scope | None
        if e.absolute:
            scope = frame.scope.top_class(e.parts[0].name)
        else:
            scope = frame.scope.first_class(e.parts[0].name)
        for k, part in enumerate(e.parts[1:], 1):
            if scope is None:
                return None
            if scope.cls.literals is not None or scope.cls.alias is not None:
                made = self._literal_of(scope, part.name, e.place)
                if made is not None and k == len(e.parts) - 1:
                    return made
            inner = scope.own_class(part.name)
            if inner is None:
                if not scope.own_component(part.name):
                    return None
                node = self._present(package_of(scope, self.evaluator), part.name)
                return self._walk(node, e, k, frame)
            scope = inner
        return None

    def _literal_of(self, scope: Scope, name: str, place: ir.Place) -> ir.Expr | None:
        found = enumeration_behind(scope)
        if found is None or found.cls.literals is None:
            return None
        names = [item for item, _ in found.cls.literals]
        if name not in names:
            return None
        self.enumerations[found.path] = found.cls.literals
        return ir.Literal(place, names.index(name) + 1, found.path)

    def _enumeration(self, e: ast.Ref, frame: Frame) -> tuple[str, list[str]] | None:
        """Full name and literals where a reference names an enumeration (or Boolean)."""
        if any(p.subscripts for p in e.parts) or self._component_exists(e, frame):
            return None
        scope = frame.scope.first_class(e.parts[0].name)
        for part in e.parts[1:]:
            scope = scope.own_class(part.name) if scope is not None else None
        if scope is None:
            return None
        if scope.builtin == "Boolean":
            return "Boolean", ["false", "true"]
        found = enumeration_behind(scope)
        if found is None or found.cls.literals is None:
            return None
        self.enumerations[found.path] = found.cls.literals
        return found.path, [name for name, _ in found.cls.literals]

    def _component_exists(self, e: ast.Ref, frame: Frame) -> bool:
        first = e.parts[0].name
        if first in frame.iterators or first in frame.locals:
            return True
        return self._component(first, frame) is not None

    def literals_of(self, e: ast.Ref, frame: Frame) -> int | None:
        found = self._enumeration(e, frame)
        return None if found is None else len(found[1])

    # ---- components

    def _walk(self, node: Node, e: ast.Ref, at: int, frame: Frame) -> ir.Expr:
        """What part `at` of a reference, a component, and the parts behind it mean."""
        part = e.parts[at]
        if isinstance(node, Leaf):
            if at < len(e.parts) - 1:
                raise refuse(f"unresolved component reference: '{e}'", e.place, hint="correct it")
            return self._leaf(node, part, e.place, frame)
        if isinstance(node, list):
            return self._elements(node, list(part.subscripts), e, at, frame)
        if part.subscripts:
            raise refuse(f"{part.name} is no array", e.place, hint="leave out the subscript")
        assert isinstance(node, Instance)
        return self._inside(node, e, at, frame)

    def _inside(self, node: Instance, e: ast.Ref, at: int, frame: Frame) -> ir.Expr:
        if at == len(e.parts) - 1:
            return self.record(node, e.place)
        name = e.parts[at + 1].name
        if name not in node.slots:
            constant = node.scope.own_class(name)
            if constant is not None and at + 2 < len(e.parts):
                inner = ast.Ref(e.place, e.parts[at + 1 :])
                made = self._member_of_class(inner, Frame(node, node.scope))
                if made is not None:
                    return made
            raise refuse(
                f"unresolved component reference: '{e}': {node.name} has no {name}",
                e.place,
                hint="correct the name",
            )
        return self._walk(self._present(node, name), e, at + 1, frame)

    def _elements(
        self, nodes: list[Any], subscripts: list[ast.Expr], e: ast.Ref, at: int, frame: Frame
    ) -> ir.Expr:
        """Through an array of components."""
        if not subscripts or isinstance(subscripts[0], ast.Colon):
            chosen: Any = list(range(1, len(nodes) + 1))
        else:
            index = self.with_end(self.expression(subscripts[0], frame), len(nodes))
            chosen = self.evaluator.value_or_refuse(index, e.place)
        rest = subscripts[1:]

        def one(i: int) -> ir.Expr:
            if isinstance(i, bool | str | list) or not 1 <= i <= len(nodes) or i != int(i):
                raise refuse(f"subscript {i} does not fit: out of bounds of {e}", e.place)
            inner = nodes[int(i) - 1]
            if isinstance(inner, list):
                return self._elements(inner, rest, e, at, frame)
            return self._inside(inner, e, at, frame)

        if isinstance(chosen, list):
            return ir.Array(e.place, tuple(one(i) for i in chosen))
        return one(chosen)

    def record(self, node: Instance, place: ir.Place) -> ir.Expr:
        def value(inner: Node) -> ir.Expr:
            if isinstance(inner, Leaf):
                return self._leaf(inner, ast.Part("", ()), place, Frame(node, node.scope))
            if isinstance(inner, list):
                return ir.Array(place, tuple(value(item) for item in inner))
            assert isinstance(inner, Instance)
            return self.record(inner, place)

        return ir.Record(
            place,
            node.scope.path,
            tuple((name, value(inner)) for name, inner in node.nodes() if inner is not None),
        )

    def _leaf(self, leaf: Leaf, part: ast.Part, place: ir.Place, frame: Frame) -> ir.Expr:
        self.evaluator.leaves[leaf.name] = leaf
        if leaf.literals is not None:
            self.enumerations[leaf.type] = leaf.literals
        subscripts = tuple(
            self.with_end(self.expression(s, frame), leaf.dims[k] if k < len(leaf.dims) else 0)
            for k, s in enumerate(part.subscripts)
        )
        self._check_bounds(leaf, subscripts, place)
        made = ir.Name(place, leaf.name, subscripts)
        if leaf.variability == "constant" and not any(isinstance(s, ir.Slice) for s in subscripts):
            try:
                return literal(self.evaluator.value(made), place, leaf.type)
            except (NotConstant, ValueError, IndexError, TypeError, ZeroDivisionError):
                pass
            whole = literal(self.evaluator.leaf(leaf), place, leaf.type)
            return ir.Index(place, whole, subscripts) if subscripts else whole
        return made

    def _check_bounds(self, leaf: Leaf, subscripts: tuple[ir.Expr, ...], place: ir.Place) -> None:
        if len(subscripts) > len(leaf.dims):
            raise refuse(
                f"{leaf.name} has {len(leaf.dims)} dimensions, not {len(subscripts)}",
                place,
                hint="correct the subscripts",
            )
        for k, subscript in enumerate(subscripts):
            if isinstance(subscript, ir.Literal) and not 1 <= subscript.value <= leaf.dims[k]:
                if leaf.dims[k] and subscript.type == "Boolean":
                    continue
                raise refuse(
                    f"subscript {subscript.value:g} of {leaf.name} is out of bounds: "
                    f"it has {leaf.dims[k]}",
                    place,
                    hint="correct the subscript",
                )

    def with_end(self, expr: ir.Expr, size: int) -> ir.Expr:
        """A subscript with `end` and parameters replaced by their values."""
        if isinstance(expr, ir.Last):
            return ir.Literal(expr.place, size, "Integer")
        if isinstance(expr, ir.Binary):
            expr = ir.Binary(
                expr.place, expr.op, self.with_end(expr.left, size), self.with_end(expr.right, size)
            )
        elif isinstance(expr, ir.Range):
            step = self.with_end(expr.step, size) if expr.step is not None else None
            expr = ir.Range(
                expr.place, self.with_end(expr.start, size), step, self.with_end(expr.stop, size)
            )
        if isinstance(expr, ir.Slice | ir.Literal):
            return expr
        try:
            return literal(self.evaluator.value(expr), expr.place)
        except (NotConstant, ValueError, TypeError, ZeroDivisionError):
            return expr  # known only while running

    # ---- calls

    def _call(self, e: ast.Call, frame: Frame) -> ir.Expr:
        name = str(e.function)
        if len(e.function.parts) == 1 and name in frame.locals:  # a function given to this one
            args = tuple(self.expression(a, frame) for a in e.args)
            named = tuple((n, self.expression(a, frame)) for n, a in e.named)
            return ir.Call(e.place, name, args, named)
        predefined = name in OPERATORS or name in REFUSED_OPERATORS
        predefined = predefined and len(e.function.parts) == 1
        if predefined and (e.function.absolute or not self._is_function(name, frame)):
            return self._operator(name, e, frame)
        found = None
        try:
            found = frame.scope.find_class(e.function)
        except Exception as error:
            found = self._of_component(e, frame)
            if found is None:
                raise refuse(
                    f"unresolved function call: '{name}'", e.place, hint="declare the function"
                ) from error
        return self._called(found, e, frame)

    def _is_function(self, name: str, frame: Frame) -> bool:
        found = frame.scope.first_class(name)
        return found is not None and found.cls.kind == "function"

    def _of_component(self, e: ast.Call, frame: Frame) -> Scope | None:
        """A function that is called through a component: world.gravity(...)."""
        first = e.function.parts[0].name
        if len(e.function.parts) < 2 or first in frame.locals or first in frame.iterators:
            return None
        node = self._component(first, frame)
        for part in e.function.parts[1:-1]:
            if not isinstance(node, Instance) or part.name not in node.slots:
                return None
            node = node.node(part.name)
        return (
            node.scope.own_class(e.function.parts[-1].name) if isinstance(node, Instance) else None
        )

    def _called(self, found: Scope, e: ast.Call, frame: Frame) -> ir.Expr:
        args = tuple(self.expression(a, frame) for a in e.args)
        named = tuple((n, self.expression(a, frame)) for n, a in e.named)
        if found.cls.kind == "record":
            return self._constructed(found, args, dict(named), e.place, frame)
        builtin = self.functions.builtin(found)
        if builtin:
            return ir.Builtin(e.place, builtin, args + tuple(a for _, a in named))
        if found.cls.kind != "function" and not self.functions.is_function(found):
            if enumeration_behind(found) is not None and len(args) == 1:
                return args[0]  # a conversion from Integer
            raise refuse(f"unresolved function call: '{e.function}' is no function", e.place)
        return ir.Call(e.place, self.functions.add(found, e.place), args, named)

    def _constructed(
        self,
        found: Scope,
        args: tuple[ir.Expr, ...],
        named: dict[str, ir.Expr],
        place: ir.Place,
        frame: Frame,
    ) -> ir.Expr:
        made = Instance("", found, {}, None, self.evaluator)
        fields: list[tuple[str, ir.Expr]] = []
        for i, name in enumerate(made.slots):
            if i < len(args):
                value = args[i]
            elif name in named:
                value = named[name]
            else:
                node = made.node(name)
                bound = node.binding if isinstance(node, Leaf) else None
                if bound is None:
                    raise refuse(f"the record {found.path} lacks its field {name}", place)
                value = self.bound(bound)
            fields.append((name, value))
        return ir.Record(place, found.path, tuple(fields))

    def _operator(self, name: str, e: ast.Call, frame: Frame) -> ir.Expr:
        if name in REFUSED_OPERATORS and name not in REDUCTIONS:
            return self._unsupported(name, e, frame)
        if e.iterators:
            body = self._comprehension(e.place, e.args[0], e.iterators, frame)
            if name == "array":
                return body
            return ir.Builtin(e.place, name, (body,))
        args = tuple(self.expression(a, frame) for a in e.args)
        args += tuple(self.expression(a, frame) for _, a in e.named)
        least, most = ARGUMENTS.get(name, (0, 99))
        if not least <= len(args) <= most:
            raise refuse(
                f"{name}() takes {least if least == most else f'{least} to {most}'} arguments, "
                f"not {len(args)}",
                e.place,
                hint="correct the call",
            )
        if frame.locals:  # of a function: sizes are known when it is called
            return ir.Builtin(e.place, name, args)
        if name == "size":
            return self._size(args, e)
        return ir.Builtin(e.place, name, self._with_sizes(name, args))

    def _with_sizes(self, name: str, args: tuple[ir.Expr, ...]) -> tuple[ir.Expr, ...]:
        """Arguments that are sizes, as numbers."""
        first = {"fill": 1, "zeros": 0, "ones": 0, "identity": 0, "linspace": 2}.get(name)
        if first is None:
            return args
        sizes = (self.evaluator.value_or_refuse(a, a.place) for a in args[first:])
        return (*args[:first], *(literal(int(s), args[0].place) for s in sizes))

    def _unsupported(self, name: str, e: ast.Call, frame: Frame) -> ir.Expr:
        if name == "String":
            return ir.Text(e.place, "...")
        if name == "pure":
            return self.expression(e.args[0], frame)
        if name == "function" and e.args and isinstance(e.args[0], ast.Call):
            return self._partial(e.args[0], frame)
        raise refuse(f"not supported: {name}()", e.place)

    def _partial(self, e: ast.Call, frame: Frame) -> ir.Expr:
        """`function f(a = 1)` as an argument."""
        found = frame.scope.find_class(e.function)
        if not self.functions.is_function(found) or e.args:
            raise refuse(f"not supported: function {e.function}()", e.place)
        named = tuple((n, self.expression(a, frame)) for n, a in e.named)
        return ir.Partial(e.place, self.functions.add(found, e.place), named)

    def _size(self, args: tuple[ir.Expr, ...], e: ast.Call) -> ir.Expr:
        shape = self.shape(args[0])
        if shape is None or len(args) > 2:
            return ir.Builtin(e.place, "size", args)
        if len(args) == 1:
            return literal(shape, e.place)
        which = self.evaluator.look(args[1])
        if not isinstance(which, int) or not 1 <= which <= len(shape):
            raise refuse(
                "size() of what has no such dimension",
                e.place,
                hint="name an array and one of its dimensions",
            )
        return ir.Literal(e.place, shape[which - 1], "Integer")


def _has_end(node: Any) -> bool:
    if isinstance(node, ast.End):
        return True
    slots = getattr(type(node), "__slots__", ()) if hasattr(node, "place") else ()
    children = list(node) if isinstance(node, tuple) else [getattr(node, s) for s in slots]
    return any(_has_end(c) for c in children if isinstance(c, tuple) or hasattr(c, "place"))


def enumeration_behind(scope: Scope) -> Scope | None:
    """The enumeration that a type stands for."""
    for _ in range(100):
        if scope.cls.literals is not None:
            return scope
        if scope.cls.alias is None:
            return None
        scope = scope.bases()[0][1]
    return None


def literal(value: Any, place: ir.Place, type_: str = "") -> Any:
    """A value as an expression."""
    if isinstance(value, list):
        return ir.Array(place, tuple(literal(item, place, type_) for item in value))
    if isinstance(value, str):
        return ir.Text(place, value)
    if isinstance(value, bool):
        return ir.Literal(place, float(value), "Boolean")
    return ir.Literal(place, value, type_ or ("Integer" if isinstance(value, int) else "Real"))


def field_of(value: ir.Expr, name: str) -> ir.Expr:
    if isinstance(value, ir.Record):
        for field, inner in value.fields:
            if field == name:
                return inner
    return ir.Field(value.place, value, name)


def matrix_of(expr: ir.Expr) -> ir.Expr:
    return ir.Builtin(expr.place, "matrix", (expr,))


__all__ = ["Resolver", "every", "literal"]
