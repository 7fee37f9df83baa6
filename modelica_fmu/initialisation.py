"""The initial system: what initial equations, fixed start values and free parameters determine
(section 8.6).

Its unknowns are states without a fixed start value, parameters with fixed = false and discrete
variables that an initial equation names; as many of them as there are initial equations. The other
states keep their start values.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_bipartite_matching

from modelica_fmu import ir
from modelica_fmu.hybrid import HybridSystem
from modelica_fmu.symbols import Scalar, literal


@dataclass
class Initial:
    unknowns: list[Scalar] = field(default_factory=list)
    residuals: list[ca.SX] = field(default_factory=list)


def initial_system(system: HybridSystem, solved: dict[str, ca.SX]) -> Initial:
    """The equations, in unknowns, loops' unknowns and what is known, and their unknowns.

    Raises InputError where there are more initial equations than they can determine.
    """
    _take_given(system)
    written, implied = _residuals(system, solved)
    if not written and not implied:
        return Initial()
    candidates = _candidates(system, [r for r, _ in written + implied])
    kept = list(range(len(written)))
    for at_start in (True, False):  # start values may hide a dependence: 0 of a parameter to find
        pattern = _pattern(system, [r for r, _ in written + implied], candidates, at_start)
        chosen = _matched(pattern, kept)
        if (chosen >= 0).all():
            break
    left = [i for i, at in enumerate(chosen) if at < 0]
    for i in range(len(written), len(written) + len(implied)):
        trial = _matched(pattern, [*kept, i])  # what follows from the others is left out
        if (trial >= 0).all():
            kept, chosen = [*kept, i], trial
    residuals = written + implied
    places = [node for _, node in residuals]
    if left:
        raise system.table.source.refuse(
            f"too many initial equations: {len(written)} of them, and this one determines nothing "
            "that is left open",
            places[left[0]],
            hint="leave out a fixed = true, or this equation",
        )
    return Initial([candidates[at] for at in chosen], [residuals[i][0] for i in kept])


def _take_given(system: HybridSystem) -> None:
    """Takes out what parameters alone give, one after the other: `pre(u) = value` of a variable
    that an equation determines is what pre() starts with, and a parameter with fixed = false that
    an initial equation gives is a calculated one.
    """
    found = {s.name: (s, system.pre[s.name]) for s in system.memories if s.kind == "algebraic"}
    found |= {s.name: (s, s.symbol) for s in system.table.scalars.values() if is_free_parameter(s)}
    progress = True
    while progress:
        progress, kept = False, []
        for residual, node in system.initial_residuals:
            names = [v.name().removeprefix("pre(").removesuffix(")") for v in ca.symvar(residual)]
            open_ = [n for n in names if n in found]
            value = _solved_for(system, residual, found[open_[0]][1]) if len(open_) == 1 else None
            if value is None:
                kept.append((residual, node))
                continue
            scalar, _ = found.pop(open_[0])
            scalar.value, progress = value, True
            if scalar.kind != "algebraic":
                scalar.kind, scalar.variable = "calculated", replace(scalar.variable, fixed=None)
        system.initial_residuals = kept


def _solved_for(system: HybridSystem, residual: ca.SX, symbol: ca.SX) -> ca.SX | None:
    """The symbol's value by a residual linear in it, where only parameters stand beside it."""
    factor = ca.jacobian(residual, symbol)
    rest = ca.substitute([residual], [symbol], [ca.SX(0)])[0]
    found = (system.table.scalars.get(v.name()) for v in ca.symvar(rest))
    known = all(s is not None and s.kind in ("parameter", "calculated", "constant") for s in found)
    return -rest / factor if known and factor.is_constant() and float(factor) else None


def _pattern(
    system: HybridSystem, residuals: list[ca.SX], candidates: list[Scalar], at_start: bool
) -> Any:
    """Which residual depends on which candidate; `at_start`: at the start values, as far as that
    tells.
    """
    symbols = ca.vertcat(*(s.symbol for s in candidates), ca.SX.sym("nothing"))
    matrix = ca.jacobian(ca.vertcat(*_without_loops(system, residuals)), symbols)
    rows, columns = matrix.sparsity().get_triplet()
    pattern = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=matrix.shape).toarray()
    if not at_start:
        return pattern
    for row, numbers in enumerate(np.atleast_2d(_at_start(system, matrix))):
        there = (pattern[row] > 0) & np.isfinite(numbers) & (np.abs(numbers) > 1e-12)
        if there.any():
            pattern[row] = there
    return pattern


def _at_start(system: HybridSystem, matrix: ca.SX) -> Any:
    """A matrix at the start values; NaN where they do not tell."""
    for _ in range(50):
        scalars = [system.table.scalars.get(v.name()) for v in ca.symvar(matrix)]
        old = list(ca.symvar(matrix))
        if not old:
            break
        new = [s.value if s is not None and s.value is not None else ca.SX(0) for s in scalars]
        path = system.path.__hash__()
        new = [ca.SX(1) if v.__hash__() == path else n for v, n in zip(old, new, strict=True)]
        matrix = ca.substitute([matrix], old, new)[0]
    if ca.symvar(matrix):
        return np.full(matrix.shape, np.nan)
    return np.array(ca.DM(ca.densify(matrix)))


def _matched(pattern: Any, rows: list[int]) -> Any:
    if not rows:
        return np.zeros(0, int)
    return maximum_bipartite_matching(csr_matrix(pattern[rows]), perm_type="column")


def _residuals(
    system: HybridSystem, solved: dict[str, ca.SX]
) -> tuple[list[tuple[ca.SX, Any]], list[tuple[ca.SX, Any]]]:
    """Initial equations; and what must hold besides, as far as it does not follow from them."""
    algebraic = system.table.of("algebraic")
    old = [s.symbol for s in algebraic] + list(system.derivatives.values())
    old += [system.pre[s.name] for s in system.memories]
    new = [solved[s.name] for s in algebraic]
    new += [solved[f"der({name})"] for name in system.derivatives]
    new += [solved[s.name] if s.kind == "algebraic" else s.symbol for s in system.memories]
    implied: list[tuple[ca.SX, Any]] = [(g, None) for g in system.constraints]
    implied += [
        (s.symbol - s.value, s.variable)
        for s in algebraic
        if is_fixed(s) and s.value is not None and not s.discrete_valued
    ]

    def put(found: list[tuple[ca.SX, Any]]) -> list[tuple[ca.SX, Any]]:
        return [(ca.substitute([r], old, new)[0] if old else r, node) for r, node in found]

    return put(system.initial_residuals), put(implied)


def _without_loops(system: HybridSystem, residuals: list[ca.SX]) -> list[ca.SX]:
    """The same dependences, with each loop's unknowns replaced by what they depend on."""
    for loop in reversed(system.loops):
        total = ca.sum1(ca.vertcat(*loop.residuals))
        own = ca.vertcat(*loop.symbols)
        bare = ca.substitute([total], [own], [ca.SX.zeros(own.shape)])[0]
        residuals = ca.substitute(residuals, loop.symbols, [bare] * len(loop.symbols))
    return residuals


def _candidates(system: HybridSystem, residuals: list[ca.SX]) -> list[Scalar]:
    named = {v.name() for r in residuals for v in ca.symvar(r)}
    table = system.table
    free = [s for s in table.of("state") if not is_fixed(s)]
    free += [s for s in table.of("parameter", "calculated") if literal(s.variable.fixed) == 0]
    return free + [s for s in table.of("discrete") if s.name in named and not is_fixed(s)]


def is_fixed(scalar: Scalar) -> bool:
    node = scalar.variable.fixed
    while isinstance(node, ir.Array) and node.items:  # one value for each element
        at = scalar.subscripts[0] - 1 if scalar.subscripts else 0
        node = node.items[min(at, len(node.items) - 1)]
    return literal(node) == 1


def is_free_parameter(scalar: Scalar) -> bool:
    """Whether it is found at the start rather than given."""
    return scalar.variable.variability == "Parameter" and literal(scalar.variable.fixed) == 0
