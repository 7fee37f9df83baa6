"""A controller's kernel, plain Python, run on symbols: the same operations in the same order as an
expression graph.

What a kernel may hold: arithmetic, comparisons, `math.*`, min, max, abs, conditionals, `for` over a
fixed range, tuples, NamedTuples and calls of functions like itself. A conditional on symbols runs
both sides and merges what they leave. Nothing is rearranged, so the C that is printed gives
Python's bits, but for the sign of a zero.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import operator
import textwrap
from collections.abc import Callable
from functools import lru_cache
from types import FunctionType
from typing import Any

import casadi as ca

from modelica_fmu.errors import InputError

__all__ = ["is_symbolic", "merge", "run_kernel"]

Value = Any  # a number, a casadi.SX, or a tuple of these
Names = dict[str, Value]
NOTHING = object()  # a block that ends without return
MATH: dict[Any, Callable[..., Any]] = {
    math.sin: ca.sin,
    math.cos: ca.cos,
    math.tan: ca.tan,
    math.asin: ca.asin,
    math.acos: ca.acos,
    math.atan: ca.atan,
    math.atan2: ca.atan2,
    math.sinh: ca.sinh,
    math.cosh: ca.cosh,
    math.tanh: ca.tanh,
    math.exp: ca.exp,
    math.expm1: ca.expm1,
    math.log: ca.log,
    math.log1p: ca.log1p,
    math.sqrt: ca.sqrt,
    math.fabs: ca.fabs,
    math.floor: ca.floor,
    math.ceil: ca.ceil,
    math.hypot: ca.hypot,
    math.fmod: ca.fmod,
    math.copysign: ca.copysign,
    math.pow: operator.pow,
    abs: ca.fabs,
    min: ca.fmin,
    max: ca.fmax,
    float: lambda v: v,
}
BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
CONCRETE: dict[type, Callable[[Any, Any], Any]] = {
    ast.Mod: operator.mod,
    ast.FloorDiv: operator.floordiv,
}  # of numbers that are known
COMPARE: dict[type, Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
HINT = (
    "write it with arithmetic, math.*, conditionals and fixed loops, or keep the controller native"
)


def run_kernel(kernel: Callable[..., Any], *arguments: Value) -> Value:
    """What `kernel` returns for arguments that hold symbols. Raises InputError, with file and line,
    for what cannot be followed.
    """
    return _Run(kernel).result(arguments, {})


def is_symbolic(value: Value) -> bool:
    return isinstance(value, ca.SX)


def merge(condition: ca.SX, yes: Value, no: Value) -> Value:
    """`yes if condition else no`, tuples part by part.

    Raises TypeError for two of different form.
    """
    if isinstance(yes, tuple) and isinstance(no, tuple) and len(yes) == len(no):
        parts = [merge(condition, a, b) for a, b in zip(yes, no, strict=True)]
        return type(yes)(*parts) if hasattr(yes, "_fields") else tuple(parts)
    for value in (yes, no):
        if not isinstance(value, ca.SX | int | float):
            raise TypeError(f"one side gives {type(yes).__name__}, the other {type(no).__name__}")
    if yes is no or (not is_symbolic(yes) and not is_symbolic(no) and yes == no):
        return yes
    return ca.if_else(condition, ca.SX(yes), ca.SX(no))


@lru_cache(maxsize=256)
def _definition(function: FunctionType) -> tuple[ast.FunctionDef, int]:
    """The function's syntax tree and the line before its first one."""
    lines, start = inspect.getsourcelines(function)
    tree = ast.parse(textwrap.dedent("".join(lines))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    return tree, start - 1


class _Run:
    """One call of one function."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.file = inspect.getsourcefile(function)
        self.above = 0
        try:
            self.tree, self.above = _definition(function)  # type: ignore[arg-type]
        except (OSError, TypeError, SyntaxError, AssertionError):
            raise self.refusal(
                None,
                f"{getattr(function, '__name__', function)!r} has no source text as a function",
            ) from None
        variables = inspect.getclosurevars(function)
        self.outer: Names = {**vars(builtins), **variables.globals, **variables.nonlocals}

    def refusal(self, node: ast.AST | None, message: str) -> InputError:
        line = getattr(node, "lineno", 0) + self.above
        return InputError(
            f"{message}: not possible in an exported kernel", file=f"{self.file}:{line}", hint=HINT
        )

    def result(self, args: tuple[Value, ...], keywords: Names) -> Value:
        bound = inspect.signature(self.function).bind(*args, **keywords)
        bound.apply_defaults()
        value = self.block(self.tree.body, dict(bound.arguments))
        return None if value is NOTHING else value

    # ---- statements

    def block(self, statements: list[ast.stmt], names: Names) -> Value:
        """Runs statements up to a return; a loop is unrolled into what follows it, so that a
        conditional return in it is one too.
        """
        for at, statement in enumerate(statements):
            rest = statements[at + 1 :]
            if isinstance(statement, ast.For):
                return self.block(self.unrolled(statement, names) + rest, names)
            if isinstance(statement, ast.If):
                value = self.conditional(statement, rest, names)
            else:
                value = self.statement(statement, names)
            if value is not NOTHING:
                return value
        return NOTHING

    def statement(self, node: ast.stmt, names: Names) -> Value:
        match node:
            case ast.Return():
                return None if node.value is None else self.value(node.value, names)
            case ast.Assign(targets=targets):
                value = self.value(node.value, names)
                for target in targets:
                    self.assign(target, value, names)
            case ast.AnnAssign(value=ast.expr() as expression):
                self.assign(node.target, self.value(expression, names), names)
            case ast.AugAssign(target=ast.Name(id=name)):
                names[name] = self.binary(
                    node,
                    type(node.op),
                    self.lookup(node, name, names),
                    self.value(node.value, names),
                )
            case ast.Pass() | ast.Expr(value=ast.Constant()):
                pass
            case _:
                raise self.refusal(node, type(node).__name__)
        return NOTHING

    def assign(self, target: ast.expr, value: Value, names: Names) -> None:
        if isinstance(target, ast.Name):
            names[target.id] = value
        elif (
            isinstance(target, ast.Tuple)
            and isinstance(value, tuple)
            and len(target.elts) == len(value)
        ):
            for part, item in zip(target.elts, value, strict=True):
                self.assign(part, item, names)
        else:
            raise self.refusal(target, "an assignment to an element or attribute")

    def unrolled(self, node: ast.For, names: Names) -> list[ast.stmt]:
        items = self.value(node.iter, names)
        if not isinstance(items, tuple | range) or node.orelse:
            raise self.refusal(node, "a loop whose length is not fixed, or with an else")
        statements: list[ast.stmt] = []
        for item in items:
            given = ast.copy_location(
                ast.Constant(item), node
            )  # any value: `value` hands it on as it is
            statements += [ast.copy_location(ast.Assign([node.target], given), node), *node.body]
        return statements

    def conditional(self, node: ast.If, rest: list[ast.stmt], names: Names) -> Value:
        condition = self.value(node.test, names)
        if not is_symbolic(condition):
            return self.block(node.body if condition else node.orelse, names)
        yes, no = dict(names), dict(names)
        if any(
            isinstance(inner, ast.Return) for inner in ast.walk(node)
        ):  # each side goes on to the function's end
            return self.merged(
                node,
                condition,
                self.block([*node.body, *rest], yes),
                self.block([*node.orelse, *rest], no),
            )
        self.block(node.body, yes)
        self.block(node.orelse, no)
        names.update(
            {
                name: self.merged(node, condition, yes[name], no[name])
                for name in yes
                if name in no and yes[name] is not no[name]
            }
        )
        return NOTHING

    def merged(self, node: ast.AST, condition: ca.SX, yes: Value, no: Value) -> Value:
        try:
            return merge(condition, yes, no)
        except TypeError as error:
            raise self.refusal(node, f"a conditional of which {error}") from None

    # ---- expressions

    def value(self, node: ast.expr, names: Names) -> Value:
        match node:
            case ast.Constant():
                return node.value
            case ast.Name(id=name):
                return self.lookup(node, name, names)
            case ast.Attribute():
                return self.attribute(node, names)
            case ast.Tuple():
                return tuple(self.value(item, names) for item in node.elts)
            case ast.BinOp():
                return self.binary(
                    node, type(node.op), self.value(node.left, names), self.value(node.right, names)
                )
            case ast.UnaryOp(op=ast.USub()):
                return -self.value(node.operand, names)
            case ast.UnaryOp(op=ast.Not()):
                operand = self.value(node.operand, names)
                return ca.logic_not(operand) if is_symbolic(operand) else not operand
            case ast.BoolOp():
                return self.boolean(node, names)
            case ast.Compare():
                return self.comparison(node, names)
            case ast.IfExp():
                condition = self.value(node.test, names)
                if not is_symbolic(condition):
                    return self.value(node.body if condition else node.orelse, names)
                return self.merged(
                    node, condition, self.value(node.body, names), self.value(node.orelse, names)
                )
            case ast.Subscript():
                return self.subscript(node, names)
            case ast.Call():
                return self.call(node, names)
            case _:
                raise self.refusal(node, type(node).__name__)

    def lookup(self, node: ast.AST, name: str, names: Names) -> Value:
        for known in (names, self.outer):
            if name in known:
                return known[name]
        raise self.refusal(node, f"{name}, which only one side of a conditional sets")

    def attribute(self, node: ast.Attribute, names: Names) -> Value:
        owner = self.value(node.value, names)
        if (
            not isinstance(owner, tuple)
            and not inspect.ismodule(owner)
            and not inspect.isclass(owner)
        ):
            raise self.refusal(node, f"attribute {node.attr} of a {type(owner).__name__}")
        return getattr(owner, node.attr)

    def binary(self, node: ast.AST, kind: type, left: Value, right: Value) -> Value:
        if kind in BINARY:
            return BINARY[kind](left, right)
        if kind in CONCRETE and not is_symbolic(left) and not is_symbolic(right):
            return CONCRETE[kind](left, right)
        raise self.refusal(node, f"operator {kind.__name__}")

    def boolean(self, node: ast.BoolOp, names: Names) -> Value:
        """`and`, `or` as truth values: what is known decides first, as Python's short circuit
        does.
        """
        both = isinstance(node.op, ast.And)
        result: Value = both
        for part in node.values:
            value = self.value(part, names)
            if is_symbolic(value):
                combine = ca.logic_and if both else ca.logic_or
                result = combine(result, value) if is_symbolic(result) else value
            elif bool(value) != both:
                return not both
        return result

    def comparison(self, node: ast.Compare, names: Names) -> Value:
        left, result = self.value(node.left, names), True
        for op, right_node in zip(node.ops, node.comparators, strict=True):
            right = self.value(right_node, names)
            if type(op) not in COMPARE:
                raise self.refusal(node, f"comparison {type(op).__name__}")
            one = COMPARE[type(op)](left, right)
            if is_symbolic(one):
                result = ca.logic_and(result, one) if is_symbolic(result) else one
            elif not one:
                return False
            left = right
        return result

    def subscript(self, node: ast.Subscript, names: Names) -> Value:
        owner, index = self.value(node.value, names), self.value(node.slice, names)
        if not isinstance(owner, tuple):
            raise self.refusal(node, f"an element of a {type(owner).__name__}")
        if not is_symbolic(index):
            return owner[index]
        chosen = owner[-1]
        for k in range(len(owner) - 2, -1, -1):
            chosen = self.merged(node, index == k, owner[k], chosen)
        return chosen

    def call(self, node: ast.Call, names: Names) -> Value:
        function = self.value(node.func, names)
        args = tuple(self.value(a, names) for a in node.args)
        keywords = {k.arg: self.value(k.value, names) for k in node.keywords if k.arg is not None}
        symbolic = any(is_symbolic(a) for a in args)
        if inspect.isclass(function) and issubclass(function, tuple):
            return function(*args, **keywords) if hasattr(function, "_fields") else function(*args)
        if isinstance(function, FunctionType):
            return _Run(function).result(args, keywords)
        if inspect.ismethod(function) and isinstance(
            function.__self__, tuple
        ):  # _replace of a NamedTuple
            return function(*args, **keywords)
        if symbolic and function in (min, max) and len(args) == 2:
            return MATH[function](ca.SX(args[0]), ca.SX(args[1]))
        if symbolic and function in MATH and function not in (min, max):
            return MATH[function](*args)
        if not symbolic and (function in MATH or function in (range, len, int, bool)):
            return function(*args)
        raise self.refusal(node, f"a call of {getattr(function, '__name__', function)}")
