"""Algebraic loops: a few unknowns are iterated on, the others follow from them (tearing)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass
class Loop:
    """Unknowns that Newton's method finds while running: residuals(symbols) = 0.

    The residuals may depend on the unknowns of earlier loops.
    """

    names: list[str]
    symbols: list[ca.SX]
    residuals: list[ca.SX]
    starts: list[ca.SX]
    line: int | None
    open: list[bool]  # which have no start value in the model


def tear(
    residuals: list[ca.SX], unknowns: list[ca.SX], preferred: list[int]
) -> tuple[list[int], dict[int, ca.SX], list[ca.SX]]:
    """(unknowns to iterate on, the others' expressions in them, the residuals left).

    An equation gives an unknown where it is the only open one in it and its factor is a number
    other than 0. `preferred`: indices, those first that are the best to iterate on.
    """
    equations, open_ = dict(enumerate(residuals)), set(range(len(unknowns)))
    inside = [_inside(r, unknowns) for r in residuals]
    torn: list[int] = []
    order: list[tuple[int, ca.SX]] = []
    while open_:
        found = _explicit(equations, inside, open_, unknowns)
        if found is None:
            at = _next_torn(equations, inside, open_, preferred)
            torn.append(at)
            open_.discard(at)
            continue
        equation, at, value = found
        order.append((at, value))
        open_.discard(at)
        del equations[equation]
    explicit: dict[int, ca.SX] = {}
    for at, value in order:
        explicit[at] = _put([value], unknowns, explicit)[0]
    return torn, explicit, _put(list(equations.values()), unknowns, explicit)


def _inside(residual: ca.SX, unknowns: list[ca.SX]) -> set[int]:
    pattern = ca.jacobian_sparsity(residual, ca.vertcat(*unknowns))
    return set(pattern.get_triplet()[1])


def _put(items: list[ca.SX], unknowns: list[ca.SX], values: dict[int, ca.SX]) -> list[ca.SX]:
    if not values or not items:
        return items
    old = [unknowns[i] for i in values]
    return ca.substitute(items, old, list(values.values()))


def _explicit(
    equations: dict[int, ca.SX], inside: list[set[int]], open_: set[int], unknowns: list[ca.SX]
) -> tuple[int, int, ca.SX] | None:
    for number, residual in equations.items():
        left = inside[number] & open_
        if len(left) != 1:
            continue
        at = next(iter(left))
        factor = ca.jacobian(residual, unknowns[at])
        if factor.is_constant() and float(factor) != 0:
            rest = ca.substitute([residual], [unknowns[at]], [ca.SX(0)])[0]
            return number, at, -rest / factor
    return None


def _next_torn(
    equations: dict[int, ca.SX], inside: list[set[int]], open_: set[int], preferred: list[int]
) -> int:
    def weight(at: int) -> tuple[int, int]:
        return sum(at in inside[number] for number in equations), -preferred.index(at)

    return max(open_, key=weight)
