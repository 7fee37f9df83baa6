"""Expression trees → CasADi SX.

A value is an SX scalar, or a list of values for an array. `Scope` says what a name means;
`Translator` walks the tree. What belongs to hybrid semantics (relations that make events, `pre`,
`sample`, `delay`, `der`) is handed to the scope, so the same translator serves equations, parameter
bindings and function bodies.
"""

from __future__ import annotations

from typing import Any, Protocol

import casadi as ca

from modelica_fmu.frontend import Source, Tree

Value = Any  # ca.SX | list["Value"]

UNARY = {
    "Sqrt": ca.sqrt,
    "Sin": ca.sin,
    "Cos": ca.cos,
    "Tan": ca.tan,
    "Asin": ca.asin,
    "Acos": ca.acos,
    "Atan": ca.atan,
    "Sinh": ca.sinh,
    "Cosh": ca.cosh,
    "Tanh": ca.tanh,
    "Exp": ca.exp,
    "Log": ca.log,
    "Abs": ca.fabs,
    "Sign": ca.sign,
    "Log10": lambda v: ca.log(v) / ca.log(10),
}
BINARY = {"Atan2": ca.atan2, "Min": ca.fmin, "Max": ca.fmax}
ROUNDING = {"Floor": ca.floor, "Ceil": ca.ceil, "Integer": ca.floor}
OPERATORS = {
    "Add": lambda a, b: a + b,
    "Sub": lambda a, b: a - b,
    "Div": lambda a, b: a / b,
    "AddElem": lambda a, b: a + b,
    "SubElem": lambda a, b: a - b,
    "MulElem": lambda a, b: a * b,
    "DivElem": lambda a, b: a / b,
    "And": ca.logic_and,
    "Or": ca.logic_or,
}
RELATIONS = {"Lt", "Le", "Gt", "Ge"}


class Scope(Protocol):
    """What names and hybrid operators mean where the expression stands."""

    def name(self, name: str, tree: Tree) -> Value: ...
    def relation(self, op: str, lhs: ca.SX, rhs: ca.SX, event: bool, tree: Tree) -> ca.SX: ...
    def operator(
        self, function: str, args: list[Tree], translate: Translator, tree: Tree
    ) -> Value | None: ...
    def call(self, function: str, args: list[Value], tree: Tree) -> Value: ...


def compare(op: str, lhs: ca.SX, rhs: ca.SX) -> ca.SX:
    """A relation as a plain 0/1 value."""
    return {"Lt": lhs < rhs, "Le": lhs <= rhs, "Gt": lhs > rhs, "Ge": lhs >= rhs}[op]


class Translator:
    def __init__(self, source: Source, scope: Scope, events: bool = True) -> None:
        self.source, self.scope, self.events = source, scope, events

    def __call__(self, tree: Tree) -> Value:
        kind, node = next(iter(tree.items()))
        method = getattr(self, "_" + kind.lower(), None)
        if method is None:
            raise self.source.refuse(f"not supported: the Modelica construct {kind}", tree)
        return method(node, tree)

    def scalar(self, tree: Tree) -> ca.SX:
        value = self(tree)
        if isinstance(value, list):
            raise self.source.refuse("an array stands where a scalar is needed", tree)
        return value

    def without_events(self) -> Translator:
        return Translator(self.source, self.scope, events=False)

    def _literal(self, node: Tree, tree: Tree) -> Value:
        kind, value = next(iter(node["value"].items()))
        if kind == "String":
            raise self.source.refuse("not supported: a String in an equation", tree)
        return ca.SX(float(value))

    def _varref(self, node: Tree, tree: Tree) -> Value:
        return self._subscripted(
            self.scope.name(node["name"]["name"], tree), node["subscripts"], tree
        )

    def _index(self, node: Tree, tree: Tree) -> Value:
        return self._subscripted(self(node["base"]), node["subscripts"], tree)

    def _subscripted(self, value: Value, subscripts: list[Tree], tree: Tree) -> Value:
        for subscript in subscripts:
            index = self._subscript(subscript, tree)
            if not isinstance(value, list) or not 1 <= index <= len(value):
                raise self.source.refuse(
                    f"subscript {index} does not fit the array", tree, hint="correct the subscript"
                )
            value = value[index - 1]
        return value

    def _subscript(self, subscript: Tree, tree: Tree) -> int:
        kind, node = next(iter(subscript.items()))
        if kind == "Index":
            return int(node["value"])
        if kind == "Expr":
            index = self.scalar(node["expr"])
            if index.is_constant() and float(index).is_integer():
                return int(float(index))
        raise self.source.refuse(
            "not supported: a subscript that is not constant, or a slice", tree
        )

    def _array(self, node: Tree, tree: Tree) -> Value:
        return [self(element) for element in node["elements"]]

    def _unary(self, node: Tree, tree: Tree) -> Value:
        value = self(node["rhs"])
        op = node["op"]
        if op in ("Minus", "UMinus"):
            return elementwise(lambda v: -v, value)
        if op == "Not":
            return ca.logic_not(value)
        if op in ("Plus", "UPlus"):
            return value
        raise self.source.refuse(f"not supported: the operator {op}", tree)

    def _binary(self, node: Tree, tree: Tree) -> Value:
        op = node["op"]
        if op in RELATIONS:
            return self.scope.relation(
                op, self.scalar(node["lhs"]), self.scalar(node["rhs"]), self.events, tree
            )
        lhs, rhs = self(node["lhs"]), self(node["rhs"])
        if op in ("Eq", "Neq", "Ne"):
            return lhs == rhs if op == "Eq" else lhs != rhs
        if op == "Mul":
            return product(lhs, rhs)
        if op in ("Exp", "ExpElem"):
            return elementwise(power, lhs, rhs)
        if op in OPERATORS:
            return elementwise(OPERATORS[op], lhs, rhs)
        raise self.source.refuse(f"not supported: the operator {op}", tree)

    def _if(self, node: Tree, tree: Tree) -> Value:
        branches = [(self.scalar(condition), value) for condition, value in node["branches"]]
        result: Value = None
        pending: list[tuple[ca.SX, Value]] = []
        for condition, value in branches:  # constant conditions choose at compile time
            if condition.is_constant():
                if not float(condition):
                    continue
                result = self(value)
                break
            pending.append((condition, self(value)))
        else:
            result = self(node["else_branch"])
        for condition, value in reversed(pending):
            result = choose(condition, value, result)
        return result

    def _builtincall(self, node: Tree, tree: Tree) -> Value:
        function, args = node["function"], node["args"]
        if function == "NoEvent":
            return self.without_events()(args[0])
        if function == "Smooth":
            return self.without_events()(args[1])
        special = self.scope.operator(function, args, self, tree)
        if special is not None:
            return special
        if function in UNARY:
            return elementwise(UNARY[function], self(args[0]))
        if function in BINARY:
            return self._reduce(BINARY[function], args, tree)
        if function == "Sum":
            return sum(flatten(self(args[0])), start=ca.SX(0))
        if function == "Size":
            return self._size(args, tree)
        if function in ROUNDING or function in ("Mod", "Rem", "Div"):
            return self._rounding(function, args, tree)
        raise self.source.refuse(f"not supported: the operator {function.lower()}()", tree)

    def _reduce(self, function: Any, args: list[Tree], tree: Tree) -> ca.SX:
        values = [v for arg in args for v in flatten(self(arg))]
        result = values[0]
        for value in values[1:]:
            result = function(result, value)
        return result

    def _size(self, args: list[Tree], tree: Tree) -> ca.SX:
        value = self(args[0])
        for _ in range(int(float(self.scalar(args[1]))) - 1 if len(args) > 1 else 0):
            value = value[0] if isinstance(value, list) and value else None
        if not isinstance(value, list):
            raise self.source.refuse(
                "size() of what has no such dimension",
                tree,
                hint="name an array and one of its dimensions",
            )
        return ca.SX(len(value))

    def _rounding(self, function: str, args: list[Tree], tree: Tree) -> ca.SX:
        values = [self.scalar(arg) for arg in args]
        if self.events and not all(v.is_constant() for v in values):
            raise self.source.refuse(
                f"not supported: {function.lower()}() outside noEvent or when",
                tree,
                hint="put it into noEvent()",
            )
        if function in ROUNDING:
            return ROUNDING[function](values[0])
        quotient = values[0] / values[1]
        if function == "Mod":
            return values[0] - ca.floor(quotient) * values[1]
        toward_zero = ca.if_else(quotient >= 0, ca.floor(quotient), ca.ceil(quotient))
        return toward_zero if function == "Div" else values[0] - toward_zero * values[1]

    def _functioncall(self, node: Tree, tree: Tree) -> Value:
        return self.scope.call(node["name"]["name"], [self(arg) for arg in node["args"]], tree)


def flatten(value: Value) -> list[ca.SX]:
    return [v for item in value for v in flatten(item)] if isinstance(value, list) else [value]


def elementwise(function: Any, *values: Value) -> Value:
    """Applies `function` element by element; scalars are repeated."""
    lists = [v for v in values if isinstance(v, list)]
    if not lists:
        return function(*values)
    n = len(lists[0])
    return [
        elementwise(function, *(v[i] if isinstance(v, list) else v for v in values))
        for i in range(n)
    ]


def product(a: Value, b: Value) -> Value:
    """`*`: element by element with a scalar; else rows times columns, a vector being a row on the
    left and a column on the right.
    """
    if not (isinstance(a, list) and isinstance(b, list)):
        return elementwise(lambda x, y: x * y, a, b)
    if isinstance(a[0], list):
        return [product(row, b) for row in a]
    if isinstance(b[0], list):
        return [product(a, list(col)) for col in zip(*b, strict=True)]
    return sum((x * y for x, y in zip(a, b, strict=True)), start=ca.SX(0))


def choose(condition: ca.SX, yes: Value, no: Value) -> Value:
    return elementwise(lambda a, b: ca.if_else(condition, a, b), yes, no)


def power(base: ca.SX, exponent: ca.SX) -> ca.SX:
    if exponent.is_constant() and float(exponent) in (2.0, 3.0, 4.0):
        return base ** int(float(exponent))
    return base**exponent
