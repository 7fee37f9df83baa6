"""Block-triangular sorting: from residuals to an explicit expression for every derivative and
algebraic variable.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_bipartite_matching

from modelica_fmu.errors import InputError
from modelica_fmu.hybrid import Assertion, HybridSystem
from modelica_fmu.symbols import literal
from modelica_fmu.tearing import Loop, tear

MOST_UNKNOWNS = 2000  # a minute of compilation
LARGEST_BLOCK = 6  # linear algebraic loops up to this size are solved symbolically
LARGEST_LOOP = 400  # unknowns that one loop iterates on


def solve(system: HybridSystem) -> dict[str, ca.SX]:
    """Explicit expressions for all unknowns: names of algebraic scalars, and "der(name)" for
    derivatives.

    They depend on time, states, inputs, parameters, frozen relations, memories, delayed values
    only. Nonlinear and large loops become `system.loops`, whose unknowns the expressions may
    hold. Raises InputError for a structurally singular system.
    """
    source = system.table.source
    unknowns = [(f"der({name})", symbol) for name, symbol in system.derivatives.items()]
    unknowns += [(s.name, s.symbol) for s in system.table.of("algebraic")]
    if len(unknowns) > MOST_UNKNOWNS:
        raise source.refuse(
            f"{len(unknowns)} unknowns, at most {MOST_UNKNOWNS} are solved for",
            system.table.model.place,
            hint="make its arrays smaller",
        )
    residuals = [residual for residual, _ in system.residuals]
    if len(residuals) != len(unknowns):
        raise source.refuse(
            f"{len(residuals)} equations, {len(unknowns)} unknowns",
            system.table.model.place,
            hint="write one equation per unknown",
        )
    if not unknowns:
        return {}
    symbols = ca.vertcat(*(symbol for _, symbol in unknowns))
    pattern = ca.jacobian_sparsity(ca.vertcat(*residuals), symbols)
    n_blocks, rows, columns, row_starts, column_starts, *_ = pattern.btf()
    if n_blocks < 0 or ca.sprank(ca.DM(pattern, 1)) < len(unknowns):
        raise _singular(system, pattern, [name for name, _ in unknowns])
    reads: list[list[int]] = [[] for _ in residuals]  # unknowns of each equation
    for i, j in zip(*pattern.get_triplet(), strict=True):
        reads[i].append(j)
    found: dict[int, ca.SX] = {}
    for block in range(n_blocks):  # CasADi's block form: each block depends on earlier ones only
        equations = rows[row_starts[block] : row_starts[block + 1]]
        members = columns[column_starts[block] : column_starts[block + 1]]
        present = [residuals[i] for i in equations]
        known = sorted({j for i in equations for j in reads[i]} & found.keys())
        if known:
            present = ca.substitute(
                present, [unknowns[j][1] for j in known], [found[j] for j in known]
            )
        trees = [system.residuals[i][1] for i in equations]
        block_unknowns = [unknowns[j] for j in members]
        own = ca.vertcat(*(symbol for _, symbol in block_unknowns))
        residual = ca.vertcat(*present)
        matrix = ca.jacobian(residual, own)
        if len(members) <= LARGEST_BLOCK and not ca.depends_on(matrix, own):
            values = _solve_block(residual, own, matrix)
            _watch_pivot(system, matrix, block_unknowns, trees)
        else:
            values = _iterate(system, present, block_unknowns, trees)
        found.update(zip(members, values, strict=True))
    return {unknowns[j][0]: value for j, value in found.items()}


def _singular(system: HybridSystem, pattern: ca.Sparsity, names: list[str]) -> InputError:
    """The equation that is too many and the unknown that lacks one."""
    rows, columns = pattern.get_triplet()
    graph = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=pattern.shape)
    unknown_of_equation = maximum_bipartite_matching(graph, perm_type="column")
    lacking = sorted(set(range(len(names))) - set(unknown_of_equation.tolist()))
    return system.table.source.refuse(
        f"the equations are structurally singular: none is left for "
        f"{', '.join(names[j] for j in lacking)}, this one is too many",
        system.residuals[int(np.argmax(unknown_of_equation < 0))][1],
        hint="write an equation for each unknown",
    )


def _watch_pivot(
    system: HybridSystem, pivot: ca.SX, unknowns: list[tuple[str, ca.SX]], trees: list
) -> None:
    """A run stops where the factor of a block's unknowns, which the block is divided by, is 0.

    Nothing is watched where that cannot be. Raises InputError where it is 0 always.
    """
    source = system.table.source
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


def _solve_block(residual: ca.SX, symbols: ca.SX, matrix: ca.SX) -> list[ca.SX]:
    """Values of a linear block's unknowns; matrix: its Jacobian."""
    right = -ca.substitute([residual], [symbols], [ca.SX.zeros(symbols.numel())])[0]
    if symbols.numel() == 1:
        return [right / matrix]
    return list(ca.vertsplit(ca.solve(matrix, right)))


def _iterate(
    system: HybridSystem, residuals: list[ca.SX], unknowns: list[tuple[str, ca.SX]], trees: list
) -> list[ca.SX]:
    """A loop for Newton's method; expressions of its unknowns in what is iterated on."""
    source = system.table.source
    names = [name for name, _ in unknowns]
    scalars = [system.table.scalars.get(name) for name in names]
    for scalar in scalars:
        if scalar is not None and scalar.discrete_valued:
            raise source.refuse(
                f"not supported: {scalar.name} of type {scalar.variable.type} in an algebraic "
                f"loop of {', '.join(names)}",
                trees[0],
                hint="put a pre() into the loop",
            )
    given = [i for i, s in enumerate(scalars) if s is not None and s.variable.start is not None]
    preferred = given + [i for i in range(len(names)) if i not in given]
    symbols = [symbol for _, symbol in unknowns]
    torn, explicit, left = tear(residuals, symbols, preferred)
    if len(torn) > LARGEST_LOOP:
        raise source.refuse(
            f"not supported: an algebraic loop of {len(torn)} variables after tearing",
            trees[0],
            hint="break it with a state",
        )
    new = [ca.SX.sym(f"loop_{len(system.loops)}_{k}") for k in range(len(torn))]
    old = [symbols[i] for i in torn]

    def put(items: list[ca.SX]) -> list[ca.SX]:
        return ca.substitute(items, old, new) if items and old else items

    chosen = [scalars[i] for i in torn]
    starts = [s.value if s is not None else None for s in chosen]
    residuals = put(left)
    matrix = ca.sparsify(ca.jacobian(ca.vertcat(*residuals), ca.vertcat(*new)))
    if ca.sprank(ca.DM(matrix.sparsity(), 1)) < len(new):
        raise source.refuse(
            f"the equations for {', '.join(names[i] for i in torn)} are singular: what is sought "
            "cancels out of them",
            trees[0],
            hint="correct the equations, or name the states by stateSelect",
        )
    system.loops.append(
        Loop(
            [names[i] for i in torn],
            new,
            residuals,
            [ca.SX(0) if s is None or not parametric(system, s) else s for s in starts],
            source.line(trees[0]),
            [s is None or s.variable.start is None for s in chosen],
        )
    )
    values = dict(zip(torn, new, strict=True)) | dict(
        zip(explicit, put(list(explicit.values())), strict=True)
    )
    return [values[i] for i in range(len(names))]


def parametric(system: HybridSystem, value: ca.SX) -> bool:
    """Whether an expression depends on parameters only."""
    scalars = (system.table.scalars.get(v.name()) for v in ca.symvar(value))
    return all(s is not None and s.kind in ("parameter", "calculated") for s in scalars)
