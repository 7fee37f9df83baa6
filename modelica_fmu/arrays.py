"""Array functions of the language (section 10.3) on nested lists of CasADi scalars."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any

import casadi as ca

Value = Any


def flat(value: Value) -> list[ca.SX]:
    return [v for item in value for v in flat(item)] if isinstance(value, list) else [value]


def shape(value: Value) -> list[int]:
    found = []
    while isinstance(value, list):
        found.append(len(value))
        value = value[0] if value else None
    return found


def whole(value: Value) -> int:
    if not value.is_constant() or not float(value).is_integer():
        raise ValueError("a size that is not constant")
    return int(float(value))


def size(value: Value, dimension: Value | None = None) -> Value:
    sizes = shape(value)
    if dimension is None:
        return [ca.SX(n) for n in sizes]
    which = whole(dimension)
    if not 1 <= which <= len(sizes):
        raise IndexError(f"dimension {which}")
    return ca.SX(sizes[which - 1])


def fill(value: Value, *dims: Value) -> Value:
    sizes = [whole(d) for d in dims]
    if not sizes:
        return value
    count = 1
    for n in sizes:
        count *= n
    if count > 20_000:
        raise ValueError("too large")

    def of(rest: list[int]) -> Value:
        return value if not rest else [of(rest[1:]) for _ in range(rest[0])]

    return of(sizes)


def identity(n: int) -> Value:
    return [[ca.SX(float(i == j)) for j in range(n)] for i in range(n)]


def diagonal(v: Value) -> Value:
    n = len(v)
    return [[v[i] if i == j else ca.SX(0) for j in range(n)] for i in range(n)]


def linspace(a: ca.SX, b: ca.SX, count: Value) -> Value:
    n = whole(count)
    return [a + (b - a) * i / (n - 1) for i in range(n)]


def cat(dimension: Value, *parts: Value) -> Value:
    return _cat(whole(dimension), [p for p in parts if shape(p) and 0 not in shape(p)[:1]])


def _cat(k: int, parts: list[Value]) -> Value:
    if k == 1:
        return [item for part in parts for item in part]
    if len({len(part) for part in parts}) != 1:
        raise ValueError("sizes differ")
    return [_cat(k - 1, [part[i] for part in parts]) for i in range(len(parts[0]))]


def matrix(value: Value) -> Value:
    dims = len(shape(value))
    if dims == 0:
        return [[value]]
    if dims == 1:
        return [[item] for item in value]
    return value


def vector(value: Value) -> Value:
    return flat(value)


def scalar(value: Value) -> Value:
    items = flat(value)
    if len(items) != 1:
        raise ValueError("more than one element")
    return items[0]


def transpose(m: Value) -> Value:
    return [list(column) for column in zip(*m, strict=True)]


def cross(a: Value, b: Value) -> Value:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def skew(x: Value) -> Value:
    zero = ca.SX(0)
    return [[zero, -x[2], x[1]], [x[2], zero, -x[0]], [-x[1], x[0], zero]]


def symmetric(m: Value) -> Value:
    n = len(m)
    return [[m[i][j] if i <= j else m[j][i] for j in range(n)] for i in range(n)]


def reduction(function: Callable[[Any, Any], Any], start: float) -> Callable[..., Value]:
    def reduced(*values: Value) -> Value:
        items = [v for value in values for v in flat(value)]
        return reduce(function, items) if items else ca.SX(start)

    return reduced


FUNCTIONS: dict[str, Callable[..., Value]] = {
    "sum": lambda v: sum(flat(v), start=ca.SX(0)),
    "product": reduction(lambda a, b: a * b, 1.0),
    "min": reduction(ca.fmin, float("inf")),
    "max": reduction(ca.fmax, float("-inf")),
    "size": size,
    "ndims": lambda v: ca.SX(len(shape(v))),
    "fill": fill,
    "zeros": lambda *dims: fill(ca.SX(0), *dims),
    "ones": lambda *dims: fill(ca.SX(1), *dims),
    "identity": lambda n: identity(whole(n)),
    "diagonal": diagonal,
    "linspace": linspace,
    "cat": cat,
    "matrix": matrix,
    "vector": vector,
    "scalar": scalar,
    "transpose": transpose,
    "cross": cross,
    "skew": skew,
    "symmetric": symmetric,
    "outerProduct": lambda a, b: [[x * y for y in b] for x in a],
}
