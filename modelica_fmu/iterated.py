"""C of what Newton's method solves: algebraic loops and the initial system."""

from __future__ import annotations

import casadi as ca

from modelica_fmu.emit import Emitter, Hoist
from modelica_fmu.hybrid import HybridSystem
from modelica_fmu.layout import Expressions, Layout, close, column, seeded

LOOP = "const ModelData *q, double *residual, double *jacobian"
PRODUCT = "const ModelData *q, const double *seed, double *product"


def loop_functions(
    system: HybridSystem,
    layout: Layout,
    e: Expressions,
    inputs: dict[str, ca.SX],
    hoist: Hoist,
) -> list[str]:
    """Residuals, their Jacobian by columns and its products, of each loop."""
    found: list[str] = []
    emitter = Emitter(inputs, ("q->p",), hoist)
    known = seeded(inputs, layout)
    seed = ca.SX.sym("seed", known.numel())
    with_seed = Emitter({**inputs, "seed": seed}, ("q->p",), hoist)
    calculated = [s.symbol for s in layout.calculated]
    closed = close(layout, e)
    for k, loop in enumerate(system.loops):
        residual = ca.densify(ca.vertcat(*loop.residuals))
        matrix = ca.densify(ca.jacobian(residual, ca.vertcat(*loop.symbols)))
        outputs = {"residual": residual, "jacobian": ca.vec(matrix)}
        found.append("static " + emitter.function(f"loop_{k}", outputs, LOOP))
        if calculated:
            residual = ca.substitute([residual], calculated, closed)[0]
        product = ca.densify(ca.jtimes(residual, known, seed))
        found.append("static " + with_seed.function(f"product_{k}", {"product": product}, PRODUCT))
    found.append(_switch("model_loop", "loop", "double *residual, double *jacobian", system))
    found.append(
        _switch("model_loop_product", "product", "const double *seed, double *product", system)
    )
    return found


def _switch(name: str, stem: str, arguments: str, system: HybridSystem) -> str:
    names = ", ".join(a.split("*")[-1] for a in arguments.split(", "))
    cases = "".join(
        f"    case {k}: {stem}_{k}(q, {names}); break;\n" for k in range(len(system.loops))
    )
    return (
        f"void {name}(const ModelData *q, int loop, {arguments}) {{\n    (void)q;\n"
        f"    switch (loop) {{\n{cases}    default: break;\n    }}\n}}\n"
    )


def initial_functions(
    system: HybridSystem, layout: Layout, e: Expressions, inputs: dict[str, ca.SX]
) -> list[str]:
    """The initial system together with all loops: its unknowns come first, then theirs."""
    loops = [r for loop in system.loops for r in loop.residuals]
    unknowns = [s.symbol for s in e.initial_unknowns]
    residual = column(e.initial_residuals + loops if unknowns else [])
    calculated = [s.symbol for s in layout.calculated]
    if calculated and unknowns:  # parameters that follow from ones that are sought
        residual = ca.substitute([residual], calculated, close(layout, e))[0]
    symbols = column([*unknowns, *(w for loop in system.loops for w in loop.symbols)])
    matrix = ca.densify(ca.jacobian(residual, symbols)) if unknowns else ca.SX.zeros(0, 1)
    emitter = Emitter(inputs, (), Hoist())
    outputs = {"residual": ca.densify(residual), "jacobian": ca.vec(matrix)}
    guess = column(e.initial_guesses)
    return [
        emitter.function("model_initial", outputs, LOOP),
        emitter.function(
            "model_initial_guess", {"guess": guess}, "const ModelData *q, double *guess"
        ),
    ]
