"""Values that must be known while compiling: sizes, ranges, conditions of components."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import casadi as ca

from modelica_fmu import arrays, ir
from modelica_fmu.ir import Place
from modelica_fmu.modelica.scope import refuse
from modelica_fmu.modelica.syntax import Expr, Ref

if TYPE_CHECKING:
    from modelica_fmu.modelica.instances import Frame, Leaf
    from modelica_fmu.modelica.resolve import Resolver

Value = Any  # float, int, bool, str, or a list of these
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "atan2": math.atan2,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "exp": math.exp,
    "log": math.log,
    "log10": math.log10,
    "abs": abs,
    "sign": lambda v: (v > 0) - (v < 0),
    "floor": lambda v: float(math.floor(v)),
    "ceil": lambda v: float(math.ceil(v)),
    "integer": lambda v: math.floor(v),
    "Integer": int,
    "mod": lambda a, b: a - math.floor(a / b) * b,
    "rem": lambda a, b: a - math.trunc(a / b) * b,
    "div": lambda a, b: math.trunc(a / b),
    "noEvent": lambda v: v,
    "homotopy": lambda actual, simplified=None: actual,
}
ARRAYS = frozenset(["sum", "product", "min", "max", "size", "fill", "zeros", "ones"])


class NotConstant(Exception):
    """What is asked for depends on something that is known only while running."""

    def __init__(self, what: str, place: Place | None) -> None:
        super().__init__(what)
        self.what, self.place = what, place


class Evaluator:
    """Values of expressions of constants and parameters; one used so can change no more."""

    def __init__(self) -> None:
        self.leaves: dict[str, Leaf] = {}
        self.resolver: Resolver  # set by its maker: both need each other
        self._looking = 0  # > 0: values are looked at without fixing the parameters behind them

    # ---- for the instantiation

    def of(self, expr: Expr, frame: Frame) -> Value:
        """Its value. Raises InputError where it is not known."""
        return self.value_or_refuse(self.resolver.expression(expr, frame), expr.place)

    def value_or_refuse(self, expr: ir.Expr, place: Place) -> Value:
        try:
            return self.value(expr)
        except NotConstant as unknown:
            raise refuse(
                f"{unknown.what} must be known while compiling",
                unknown.place or place,
                hint="let it depend on constants and parameters only",
            ) from None
        except (ValueError, ZeroDivisionError, OverflowError, IndexError, TypeError) as error:
            raise refuse(
                f"a value cannot be computed ({error})", place, hint="correct the expression"
            ) from None

    def look(self, expr: ir.Expr) -> Value:
        """Its value if it is constant, without fixing any parameter; else None."""
        self._looking += 1
        try:
            return self.value(expr, constants_only=True)
        except (NotConstant, ValueError, ZeroDivisionError, OverflowError, IndexError, TypeError):
            return None
        finally:
            self._looking -= 1

    def size(self, expr: Expr, frame: Frame) -> int:
        if isinstance(expr, Ref):
            count = self.resolver.literals_of(expr, frame)
            if count is not None:
                return count
        value = self.of(expr, frame)
        if isinstance(value, bool) or not isinstance(value, int | float) or value != int(value):
            raise refuse(f"a size is {value}", expr.place, hint="give a whole number")
        if value < 0:
            raise refuse(f"a size is {value}", expr.place, hint="give at least 0")
        return int(value)

    def length(self, leaf: Leaf, dimension: int) -> int:
        """Size of an open dimension, from the leaf's binding."""
        assert leaf.binding is not None
        bound = self.resolver.bound(leaf.binding)
        shape = self.resolver.shape(bound)
        if shape is None:
            shape = _shape(self.value_or_refuse(bound, leaf.place))
        if dimension >= len(shape):
            raise refuse(f"{leaf.name} and its value differ in dimensions", leaf.place)
        return shape[dimension]

    # ---- values

    def value(self, expr: ir.Expr, constants_only: bool = False) -> Value:
        method = getattr(self, f"_{type(expr).__name__.lower()}", None)
        if method is None:
            raise NotConstant("an expression", getattr(expr, "place", None))
        return method(expr, constants_only)

    def _literal(self, expr: ir.Literal, only: bool) -> Value:
        if expr.type == "Boolean":
            return bool(expr.value)
        return expr.value if expr.type == "Real" else int(expr.value)

    def _text(self, expr: ir.Text, only: bool) -> Value:
        return expr.value

    def _name(self, expr: ir.Name, only: bool) -> Value:
        leaf = self.leaves.get(expr.name)
        if leaf is None or leaf.variability not in ("constant", "parameter"):
            raise NotConstant(expr.name, expr.place)
        if only and leaf.variability != "constant" and not (leaf.structural or leaf.final):
            raise NotConstant(expr.name, expr.place)
        value = self.leaf(leaf, only)
        for subscript in expr.subscripts:
            value = _item(value, self.value(subscript, only))
        return value

    def leaf(self, leaf: Leaf, only: bool = False) -> Value:
        if not self._looking:
            leaf.structural = True
        if leaf.value is None:
            if leaf.evaluating:
                raise refuse(f"cyclic: {leaf.name} depends on itself", leaf.place)
            leaf.evaluating = True
            try:
                value = self._leaf_value(leaf, only)
            finally:
                leaf.evaluating = False
            if self._looking:
                return value
            leaf.value = value
        return leaf.value

    def _leaf_value(self, leaf: Leaf, only: bool) -> Value:
        bound = leaf.binding
        if bound is None and "start" in leaf.mods:
            bound = leaf.mods["start"].value
        if bound is None:
            if leaf.variability == "constant":
                raise refuse(f"the constant {leaf.name} has no value", leaf.place, hint="bind it")
            raise NotConstant(f"{leaf.name}, which has no value,", leaf.place)
        value = self.value(self.resolver.bound(bound), only)
        for size in reversed(leaf.dims):
            if not isinstance(value, list):
                value = [value] * size
        if leaf.type == "Real" and isinstance(value, int) and not isinstance(value, bool):
            return float(value)
        return value

    def _unary(self, expr: ir.Unary, only: bool) -> Value:
        value = self.value(expr.operand, only)
        return (not value) if expr.op == "not" else _each(lambda v: -v, value)

    def _binary(self, expr: ir.Binary, only: bool) -> Value:
        left = self.value(expr.left, only)
        if expr.op == "and":
            return bool(left) and bool(self.value(expr.right, only))
        if expr.op == "or":
            return bool(left) or bool(self.value(expr.right, only))
        return binary(expr.op, left, self.value(expr.right, only))

    def _choice(self, expr: ir.Choice, only: bool) -> Value:
        for condition, value in expr.branches:
            if self.value(condition, only):
                return self.value(value, only)
        return self.value(expr.otherwise, only)

    def _array(self, expr: ir.Array, only: bool) -> Value:
        return [self.value(item, only) for item in expr.items]

    def _range(self, expr: ir.Range, only: bool) -> Value:
        start, stop = self.value(expr.start, only), self.value(expr.stop, only)
        step = self.value(expr.step, only) if expr.step is not None else 1
        return numbers(start, step, stop)

    def _index(self, expr: ir.Index, only: bool) -> Value:
        value = self.value(expr.base, only)
        for subscript in expr.subscripts:
            if expr.lenient and not isinstance(value, list):
                break
            value = _item(value, self.value(subscript, only))
        return value

    def _field(self, expr: ir.Field, only: bool) -> Value:
        if isinstance(expr.base, ir.Record):
            return self.value(dict(expr.base.fields)[expr.name], only)
        raise NotConstant(f"the field {expr.name}", expr.place)

    def _builtin(self, expr: ir.Builtin, only: bool) -> Value:
        name = expr.function
        if name in ARRAYS:
            return self._of_array(name, [self.value(a, only) for a in expr.args])
        if name in arrays.FUNCTIONS:
            return structural(name, [self.value(a, only) for a in expr.args])
        if name not in FUNCTIONS:
            raise NotConstant(f"{name}()", expr.place)
        return _each(FUNCTIONS[name], *(self.value(a, only) for a in expr.args))

    def _of_array(self, name: str, args: list[Value]) -> Value:
        if name == "size":
            shape = _shape(args[0])
            return shape[args[1] - 1] if len(args) > 1 else shape
        if name in ("fill", "zeros", "ones"):
            value, dims = (args[0], args[1:]) if name == "fill" else (float(name == "ones"), args)
            for size in reversed(dims):
                value = [value] * int(size)
            return value
        items = [v for arg in args for v in _flat(arg)]
        if name in ("sum", "product"):
            return sum(items) if name == "sum" else math.prod(items)
        return min(items) if name == "min" else max(items)

    def _call(self, expr: ir.Call, only: bool) -> Value:
        from modelica_fmu.functions import call_with_numbers  # the interpreter of function bodies

        args = [self.value(a, only) for a in expr.args]
        named = {name: self.value(a, only) for name, a in expr.named}
        found = call_with_numbers(self.resolver.functions, expr, args, named)
        if found is None:
            raise NotConstant(f"{expr.function}()", expr.place)
        return found


def structural(name: str, args: list[Value]) -> Value:
    """An array function of section 10.3, computed as in equations; of whole numbers whole."""
    items = args[1:] if name == "cat" else args
    kinds = {type(v) for item in items for v in _flat(item)}
    kind = kinds.pop() if len(kinds) == 1 and name != "linspace" else float
    if not issubclass(kind, int | float):
        raise TypeError("texts")
    made = arrays.FUNCTIONS[name](*(_each(lambda v: ca.SX(float(v)), arg) for arg in args))
    return _each(lambda v: kind(float(v)), made)


def binary(op: str, a: Value, b: Value) -> Value:
    """One operation on numbers, or on arrays of them."""
    plain = op.removeprefix(".")
    if plain in ("==", "<>", "<", "<=", ">", ">="):
        return {
            "==": a == b,
            "<>": a != b,
            "<": plain == "<" and a < b,
            "<=": plain == "<=" and a <= b,
            ">": plain == ">" and a > b,
            ">=": plain == ">=" and a >= b,
        }[plain]
    if isinstance(a, str) or isinstance(b, str):
        return f"{a}{b}"
    if op == "*" and isinstance(a, list) and isinstance(b, list):
        return _product(a, b)
    operation: dict[str, Callable[[Any, Any], Any]] = {
        "+": lambda x, y: x + y,
        "-": lambda x, y: x - y,
        "*": lambda x, y: x * y,
        "/": lambda x, y: x / y,
        "^": lambda x, y: float(x) ** y,
    }
    return _each(operation[plain], a, b)


def _product(a: Value, b: Value) -> Value:
    if isinstance(a[0], list):
        return [_product(row, b) for row in a]
    if isinstance(b[0], list):
        return [_product(a, list(column)) for column in zip(*b, strict=True)]
    return sum(x * y for x, y in zip(a, b, strict=True))


def _each(function: Callable[..., Any], *values: Value) -> Value:
    lists = [v for v in values if isinstance(v, list)]
    if not lists:
        return function(*values)
    if any(len(v) != len(lists[0]) for v in lists):
        raise ValueError("arrays of different sizes")
    return [
        _each(function, *(v[i] if isinstance(v, list) else v for v in values))
        for i in range(len(lists[0]))
    ]


def _item(value: Value, subscript: Value) -> Value:
    if isinstance(subscript, list):
        return [_item(value, s) for s in subscript]
    if not isinstance(value, list) or not 1 <= int(subscript) <= len(value):
        raise ValueError(f"subscript {subscript} does not fit the array")
    return value[int(subscript) - 1]


def _flat(value: Value) -> list[Any]:
    return [v for item in value for v in _flat(item)] if isinstance(value, list) else [value]


def _shape(value: Value) -> list[int]:
    shape = []
    while isinstance(value, list):
        shape.append(len(value))
        value = value[0] if value else None
    return shape


def numbers(start: Any, step: Any, stop: Any) -> list[Any]:
    """The values of start:step:stop."""
    if step == 0:
        raise ValueError("a range needs a step that is not 0")
    count = math.floor((stop - start) / step + 1e-9) + 1
    if count > 200_000:
        raise ValueError(f"a range of {count} values")
    return [start + k * step for k in range(max(count, 0))]
