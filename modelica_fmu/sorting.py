"""Block-triangular sorting: from residuals to an explicit expression for every derivative and
algebraic variable.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_bipartite_matching

from modelica_fmu.errors import InputError
from modelica_fmu.frontend import Source, Tree
from modelica_fmu.hybrid import Assertion, HybridSystem
from modelica_fmu.symbols import literal

MOST_UNKNOWNS = 2000  # a minute of compilation
LARGEST_BLOCK = 6  # linear algebraic loops up to this size are solved symbolically


def solve(system: HybridSystem) -> dict[str, ca.SX]:
    """Explicit expressions for all unknowns: names of algebraic scalars, and "der(name)" for
    derivatives.

    They depend on time, states, inputs, parameters, frozen relations, memories, delayed values
    only. Raises InputError for a structurally singular system and for an algebraic loop that is not
    linear.
    """
    source = system.table.model.source
    unknowns = [(f"der({name})", symbol) for name, symbol in system.derivatives.items()]
    unknowns += [(s.name, s.symbol) for s in system.table.of("algebraic")]
    if len(unknowns) > MOST_UNKNOWNS:
        raise source.refuse(
            f"{len(unknowns)} unknowns, at most {MOST_UNKNOWNS} are solved for",
            hint="make its arrays smaller",
        )
    residuals = [residual for residual, _ in system.residuals]
    if len(residuals) != len(unknowns):
        raise source.refuse(
            f"{len(residuals)} equations for {len(unknowns)} unknowns",
            hint="write one equation per unknown",
        )
    if not unknowns:
        return {}
    symbols = ca.vertcat(*(symbol for _, symbol in unknowns))
    pattern = ca.jacobian_sparsity(ca.vertcat(*residuals), symbols)
    n_blocks, rows, columns, row_starts, column_starts, *_ = pattern.btf()
    if n_blocks < 0 or ca.sprank(ca.DM(pattern, 1)) < len(unknowns):
        raise _singular(system, pattern, [name for name, _ in unknowns])
    solved: dict[str, ca.SX] = {}
    old: list[ca.SX] = []
    new: list[ca.SX] = []
    for block in range(n_blocks):  # CasADi's block form: each block depends on earlier ones only
        equations = rows[row_starts[block] : row_starts[block + 1]]
        members = columns[column_starts[block] : column_starts[block + 1]]
        present = [residuals[i] for i in equations]
        present = ca.substitute(present, old, new) if old else present
        trees = [system.residuals[i][1] for i in equations]
        block_unknowns = [unknowns[j] for j in members]
        values = _solve_block(source, present, block_unknowns, trees)
        _watch_pivot(system, present, block_unknowns, trees)
        for j, value in zip(members, values, strict=True):
            name, symbol = unknowns[j]
            solved[name] = value
            old.append(symbol)
            new.append(value)
    return solved


def _singular(system: HybridSystem, pattern: ca.Sparsity, names: list[str]) -> InputError:
    """The equation that is too many and the unknown that lacks one."""
    rows, columns = pattern.get_triplet()
    graph = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=pattern.shape)
    unknown_of_equation = maximum_bipartite_matching(graph, perm_type="column")
    lacking = sorted(set(range(len(names))) - set(unknown_of_equation.tolist()))
    return system.table.model.source.refuse(
        f"the equations are structurally singular: none is left for "
        f"{', '.join(names[j] for j in lacking)}, this one is too many",
        system.residuals[int(np.argmax(unknown_of_equation < 0))][1],
        hint="write an equation for each unknown",
    )


def _watch_pivot(
    system: HybridSystem, residuals: list[ca.SX], unknowns: list[tuple[str, ca.SX]], trees: list
) -> None:
    """A run stops where the factor of a block's unknowns, which the block is divided by, is 0.

    Nothing is watched where that cannot be. Raises InputError where it is 0 always.
    """
    source = system.table.model.source
    pivot = ca.jacobian(ca.vertcat(*residuals), ca.vertcat(*(symbol for _, symbol in unknowns)))
    factor = pivot if len(unknowns) == 1 else ca.det(pivot)
    names = ", ".join(name for name, _ in unknowns)
    if factor.is_constant():
        if float(factor) == 0:
            raise source.refuse(
                f"the equations for {names} are singular", trees[0], hint="correct the equations"
            )
        return
    if not _keeps_its_sign(system, factor):
        line = source.line(trees[0])
        message = f"the equation of line {line} cannot be solved for {names}: its factor is 0"
        system.assertions.append(Assertion(factor != 0, message, warning=False))


def _keeps_its_sign(system: HybridSystem, factor: ca.SX) -> bool:
    """Whether a factor is a parameter, or minus one, that is bounded away from 0."""
    symbol = factor if factor.is_symbolic() else -factor
    scalar = system.table.scalars.get(symbol.name()) if symbol.is_symbolic() else None
    if scalar is None or scalar.kind != "parameter":
        return False
    low, high = (literal(bound) for bound in (scalar.variable.min, scalar.variable.max))
    return (low is not None and low > 0) or (high is not None and high < 0)


def _solve_block(
    source: Source, residuals: list[ca.SX], unknowns: list[tuple[str, ca.SX]], trees: list[Tree]
) -> list[ca.SX]:
    symbols = ca.vertcat(*(symbol for _, symbol in unknowns))
    residual = ca.vertcat(*residuals)
    matrix = ca.jacobian(residual, symbols)
    names = ", ".join(name for name, _ in unknowns)
    if ca.depends_on(matrix, symbols):
        raise source.refuse(
            f"not supported: a nonlinear algebraic loop in {names}",
            trees[0],
            hint="solve it by hand, or add a state",
        )
    right = -ca.substitute([residual], [symbols], [ca.SX.zeros(len(unknowns))])[0]
    if len(unknowns) == 1:
        return [right / matrix]
    if len(unknowns) > LARGEST_BLOCK:
        message = f"not supported: an algebraic loop of {len(unknowns)} variables ({names})"
        raise source.refuse(message, trees[0], hint="break it with a state")
    return list(ca.vertsplit(ca.solve(matrix, right)))
