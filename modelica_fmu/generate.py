"""Generates model.h and model.c: sizes, the variable table and the functions that core.c calls."""

from __future__ import annotations

from string import Template

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from modelica_fmu.compiled import Variable
from modelica_fmu.emit import Emitter, Hoist
from modelica_fmu.hybrid import HybridSystem
from modelica_fmu.iterated import initial_functions, loop_functions
from modelica_fmu.layout import Expressions, Layout, close, column, seeded
from modelica_fmu.symbols import TIME, Scalar
from modelica_fmu.tearing import Loop

KIND = {
    "time": "VK_TIME",
    "parameter": "VK_PARAMETER",
    "calculated": "VK_CALCULATED",
    "input": "VK_INPUT",
    "state": "VK_STATE",
    "derivative": "VK_DERIVATIVE",
    "algebraic": "VK_ALGEBRAIC",
    "discrete": "VK_DISCRETE",
}
TYPE = {
    "Real": "VT_REAL",
    "Integer": "VT_INTEGER",
    "Boolean": "VT_BOOLEAN",
    "Enumeration": "VT_ENUMERATION",
}


MINMAX = """\
static inline double model_min(double a, double b) { return a < b ? a : b; }
static inline double model_max(double a, double b) { return a > b ? a : b; }
"""
SOLVER = {"solver.max_step": "P_MAX_STEP", "solver.tolerance": "P_TOLERANCE"}  # places in q->p


# Of a part without states, and of any part, whose outputs are all that is exposed
APART = """\
void model_rates(const ModelData *q, double *dx, double *z) {
    double y[N_OUTPUTS];
    (void)dx;
    model_observed(q, z, y);
}
void model_outputs(const ModelData *q, double *y) {
    double z[N_RELATIONS ? N_RELATIONS : 1];
    model_observed(q, z, y);
}
"""
DIRECTIONAL = "const ModelData *q, const double *seed, double *dx, double *y"
LOCALS = "void model_locals(const ModelData *q, double *y) { model_outputs(q, y); }\n"


def groups(system: HybridSystem, layout: Layout) -> dict[str, ca.SX]:
    return {
        "q->time": TIME,
        "q->x": column([s.symbol for s in layout.states]),
        "q->u": column([s.symbol for s in layout.inputs]),
        "q->p": column([s.symbol for s in layout.parameters + layout.calculated]),
        "q->m": column([r.symbol for r in system.relations]),
        "q->d": column([s.symbol for s in layout.memories]),
        "q->pre": column([system.pre[s.name] for s in layout.memories]),
        "q->late": column([d.symbol for d in system.delays]),
        "q->tick": column([s.symbol for s in system.samples]),
        "q->fired": column([b.fired for b in system.branches]),
        "q->w": column([w for loop in system.loops for w in loop.symbols]),
        "q->r": column([r.symbol for r in system.roundings]),
        "q->initial": system.initial,
        "q->path": system.path,
    }


HEADER = Template("""\
/* Generated from a Modelica model: sizes and functions of the model. */
#ifndef MODEL_H
#define MODEL_H
#include "core.h"

$defines
#define AT_LEAST_1(n) ((n) > 0 ? (n) : 1)

typedef struct {
    double time;
    double x[AT_LEAST_1(N_STATES)];
    double u[AT_LEAST_1(N_INPUTS)];
    double p[AT_LEAST_1(N_PARAMETERS + N_CALCULATED)];
    double m[AT_LEAST_1(N_RELATIONS)];  /* frozen relations */
    double d[AT_LEAST_1(N_MEMORIES)];   /* discrete variables */
    double pre[AT_LEAST_1(N_MEMORIES)]; /* their values before the event */
    double late[AT_LEAST_1(N_DELAYS)];  /* delayed values */
    double tick[AT_LEAST_1(N_SAMPLES)];
    double fired[AT_LEAST_1(N_BRANCHES)];
    double initial;
    double w[AT_LEAST_1(N_LOOPED)];     /* unknowns of algebraic loops, found by iteration */
    double r[AT_LEAST_1(N_ROUNDINGS)];  /* frozen results of floor() */
    double h[AT_LEAST_1(N_HOISTED)];    /* whatever depends on parameters alone */
    double path;                        /* of homotopy(): 0 simplified, 1 actual */
} ModelData;

typedef struct {
    const char *message;
    int warning;
} ModelAssertion;

extern const double model_parameter_starts[], model_input_starts[], model_nominals[];
extern const unsigned char model_inclusive[];   /* relation i is true at 0 */
extern const int model_chain[];                 /* when chain of a branch */
extern const ModelAssertion model_assertions[];

void model_calculated(ModelData *q);            /* calculated parameters, in place */
void model_prepare(ModelData *q);               /* hoisted values */
void model_starts(const ModelData *q, double *x);
void model_memory_starts(const ModelData *q, double *d);
void model_rates(const ModelData *q, double *dx, double *z);
void model_outputs(const ModelData *q, double *y);
void model_observed(const ModelData *q, double *z, double *y); /* of models without states */
void model_locals(const ModelData *q, double *y);
void model_conditions(const ModelData *q, double *c);
void model_updates(const ModelData *q, double *d, double *x);
void model_delays(const ModelData *q, double *value, double *delay, double *maximum);
/* by the parameters alone: does anything read the delayed value? */
void model_delays_used(const ModelData *q, double *used);
void model_samples(const ModelData *q, double *start, double *interval);
void model_check(const ModelData *q, double *ok);
void model_directional(const ModelData *q, const double *seed, double *dx, double *y);
void model_loop_starts(const ModelData *q, double *w);
void model_loop(const ModelData *q, int loop, double *residual, double *jacobian); /* by columns */
void model_loop_product(const ModelData *q, int loop, const double *seed, double *product);
void model_roundings(const ModelData *q, double *r);
void model_constraints(const ModelData *q, double *residual, double *jacobian); /* by columns */
void model_initial(const ModelData *q, double *residual, double *jacobian);
void model_initial_guess(const ModelData *q, double *guess);
extern const int model_loop_size[], model_loop_line[];
extern const char *const model_loop_names[];
extern const char model_initial_kind[]; /* of each unknown: x, p, d */
extern const int model_initial_index[];
extern const char model_open[]; /* of each unknown, then of the loops': '1' has no start value */
#endif
""")


def header(system: HybridSystem, layout: Layout, e: Expressions, hoisted: int) -> str:
    loops = [len(loop.symbols) for loop in system.loops]
    sizes = {
        "N_STATES": len(layout.states),
        "N_INPUTS": len(layout.inputs),
        "N_PARAMETERS": len(layout.parameters),
        "N_CALCULATED": len(layout.calculated),
        "N_RELATIONS": len(system.relations),
        "N_MEMORIES": len(layout.memories),
        "N_ALGEBRAICS": len(layout.algebraics),
        "N_OUTPUTS": layout.n_outputs,
        "N_BRANCHES": len(system.branches),
        "N_SAMPLES": len(system.samples),
        "N_DELAYS": len(system.delays),
        "N_ASSERTIONS": len(system.assertions),
        "N_HOISTED": hoisted,
        "N_LOOPS": len(loops),
        "N_LOOPED": sum(loops),
        "N_INITIAL": len(e.initial_unknowns),
        "N_LARGEST": max([*loops, len(e.initial_unknowns) + sum(loops)]),
        "JUMPING": int(jumping(system)),
        "N_ROUNDINGS": len(system.roundings),
        "N_CONSTRAINTS": len(e.constraints),
        "CHAINED": int(e.chained),
        "HOMOTOPY": int(system.simplified),
        "CIRCULAR": int(_circular(system, e)),
        "N_SEEDS": sum(map(len, (layout.states, layout.inputs, layout.parameters)))
        + sum(loops)
        + 1,
    }
    position = {s.name: i for i, s in enumerate(layout.parameters)}
    sizes |= {define: position[name] for name, define in SOLVER.items()}
    defines = "\n".join(f"#define {name} {value}" for name, value in sizes.items())
    return HEADER.substitute(defines=defines)


def jumping(system: HybridSystem) -> bool:
    """Whether a loop may have several solutions between events: it is not linear."""
    return any(map(_nonlinear, system.loops))


def _nonlinear(loop: Loop) -> bool:
    residual, unknowns = ca.vertcat(*loop.residuals), ca.vertcat(*loop.symbols)
    return bool(ca.depends_on(ca.densify(ca.jacobian(residual, unknowns)), unknowns))


def _circular(system: HybridSystem, e: Expressions) -> bool:
    """Whether a relation may depend on itself, through others or an algebraic loop."""
    n = len(system.relations)
    if system.loops or not n:
        return n > 0
    symbols = column([r.symbol for r in system.relations])
    rows, columns = ca.jacobian_sparsity(column(e.indicators), symbols).get_triplet()
    if any(i == j for i, j in zip(rows, columns, strict=True)):
        return True
    graph = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    return int(connected_components(graph, connection="strong")[0]) < n


def source(
    system: HybridSystem,
    layout: Layout,
    e: Expressions,
    variables: tuple[Variable, ...],
    identity: tuple[str, dict[str, list[int]]],
) -> tuple[str, str]:
    """(model.h, model.c); `identity`: model name, and value references of states and
    derivatives.
    """
    hoist = Hoist()
    inputs = groups(system, layout)
    emitter = Emitter(inputs, ("q->p",), hoist)
    q = "const ModelData *q"
    functions = [
        emitter.function("model_starts", {"x": column(e.starts)}, f"{q}, double *x"),
        emitter.function("model_memory_starts", {"d": column(e.memory_starts)}, f"{q}, double *d"),
        *_values(emitter, layout, e),
        emitter.function("model_conditions", {"c": column(e.conditions)}, f"{q}, double *c"),
        emitter.function(
            "model_updates",
            {"d": column(e.memory_updates), "x": column(e.state_updates)},
            f"{q}, double *d, double *x",
        ),
        emitter.function(
            "model_delays",
            {
                "value": column(e.delays),
                "delay": column(e.delay_times),
                "maximum": column(e.delay_maxima),
            },
            f"{q}, double *value, double *delay, double *maximum",
        ),
        emitter.function(
            "model_samples",
            {"start": column(e.sample_starts), "interval": column(e.sample_intervals)},
            f"{q}, double *start, double *interval",
        ),
        emitter.function("model_check", {"ok": column(e.assertions)}, f"{q}, double *ok"),
        emitter.function("model_roundings", {"r": column(e.roundings)}, f"{q}, double *r"),
        emitter.function("model_loop_starts", {"w": column(e.loop_starts)}, f"{q}, double *w"),
        _constraints(emitter, layout, e),
        _directional(inputs, layout, e, hoist),
        *loop_functions(system, layout, e, inputs, hoist),
        *initial_functions(system, layout, e, inputs),
    ]
    functions.append(_delays_used(system, hoist))
    prepare, functions_text, hoisted = hoist.stored("\n".join(functions))
    text = "\n".join(
        [
            _preamble(),
            _tables(system, layout, e, variables, identity),
            _calculated(layout, e),
            prepare,
            functions_text,
        ]
    )
    return header(system, layout, e, hoisted), _silence_unused(text)


def _values(emitter: Emitter, layout: Layout, e: Expressions) -> list[str]:
    """Rates and relations, outputs, and all that is exposed. Of a part without states relations and
    outputs are most of the same: they are computed together.
    """
    q = "const ModelData *q"
    outputs, indicators = column(e.algebraics[: layout.n_outputs]), column(e.indicators)
    if layout.part and not e.derivatives:
        observed = {"z": indicators, "y": outputs}
        found = [emitter.function("model_observed", observed, f"{q}, double *z, double *y"), APART]
    else:
        rates = {"dx": column(e.derivatives), "z": indicators}
        found = [
            emitter.function("model_rates", rates, f"{q}, double *dx, double *z"),
            emitter.function("model_outputs", {"y": outputs}, f"{q}, double *y"),
        ]
    if layout.part:
        return [*found, LOCALS]
    return [
        *found,
        emitter.function("model_locals", {"y": column(e.algebraics)}, f"{q}, double *y"),
    ]


def _delays_used(system: HybridSystem, hoist: Hoist) -> str:
    """Where every reader of a delayed value stands inside an `if` on parameters, the delay is used
    only while one of these holds.
    """
    lines = []
    for i in range(len(system.delays)):
        readers = hoist.readers.get(f"q->late[{i}]", set())
        weakest = [
            r for r in readers if not any(other < r for other in readers)
        ]  # a && b || a is a
        used = (
            " || ".join(
                sorted(f"({' && '.join(sorted(conditions)) or '1'})" for conditions in weakest)
            )
            or "0"
        )
        lines.append(f"    used[{i}] = {used};")
    return (
        "void model_delays_used(const ModelData *q, double *used) {\n" + "\n".join(lines) + "\n}\n"
    )


def _directional(inputs: dict[str, ca.SX], layout: Layout, e: Expressions, hoist: Hoist) -> str:
    """Forward mode; the order of the seeds is that of `seeded`. Of a part: of the rates, by what
    the solver moves.
    """
    calculated = [s.symbol for s in layout.calculated]
    known = seeded(inputs, layout)
    seed = ca.SX.sym("seed", known.numel())
    if layout.part:
        loops, own = inputs["q->w"].numel(), inputs["q->x"].numel()
        moved = ca.vertcat(inputs["q->x"], inputs["q->w"], inputs["q->time"])
        seeds = ca.vertcat(seed[:own], seed[known.numel() - loops - 1 :])
        rates = ca.jtimes(column(e.derivatives), moved, seeds)
        emitter = Emitter({**inputs, "seed": seed}, ("q->p",), hoist)
        return emitter.function("model_directional", {"dx": rates}, DIRECTIONAL)
    unknown = column(e.derivatives + e.algebraics)
    if calculated:
        closed = close(layout, e)
        unknown_closed = ca.substitute([unknown], [column(calculated)], [column(closed)])[0]
    else:
        unknown_closed = unknown
    product = ca.jtimes(unknown_closed, known, seed)
    n = len(e.derivatives)
    emitter = Emitter({**inputs, "seed": seed}, ("q->p",), hoist)
    return emitter.function(
        "model_directional",
        {"dx": product[:n], "y": product[n:]},
        DIRECTIONAL,
    )


def _constraints(emitter: Emitter, layout: Layout, e: Expressions) -> str:
    residual = column(e.constraints)
    states = column([s.symbol for s in layout.states])
    matrix = ca.densify(ca.jacobian(residual, states)) if e.constraints else ca.SX.zeros(0, 1)
    outputs = {"residual": residual, "jacobian": ca.vec(matrix)}
    arguments = "const ModelData *q, double *residual, double *jacobian"
    return emitter.function("model_constraints", outputs, arguments)


def _calculated(layout: Layout, e: Expressions) -> str:
    lines = []
    p = column([s.symbol for s in layout.parameters + layout.calculated])
    for i, expression in enumerate(e.calculated):
        emitter = Emitter({"q->p": p}, (), Hoist())
        target = len(layout.parameters) + i
        text = (
            emitter.function("inner", {"out": expression}, "")
            .split("{\n", 1)[1]
            .rsplit("\n}", 1)[0]
        )
        lines.append("    {\n" + text.replace("out[0]", f"q->p[{target}]") + "\n    }")
    return "void model_calculated(ModelData *q) {\n    (void)q;\n" + "\n".join(lines) + "\n}\n"


def _preamble() -> str:
    return f"""/* Generated from a Modelica model. */
#include "model.h"
#include <math.h>

{MINMAX}"""


def _tables(
    system: HybridSystem,
    layout: Layout,
    e: Expressions,
    variables: tuple[Variable, ...],
    identity: tuple[str, dict[str, list[int]]],
) -> str:
    name, references = identity
    rows = ",\n".join(_row(v) for v in variables)
    starts = [constant_start(s) for s in layout.parameters]
    nominals = [abs(variables[i].nominal or 1.0) for i in references["states"]]
    initial = [(KIND_OF[s.kind], _place(s, layout)) for s in e.initial_unknowns]
    messages = [f"{{{_quoted(a.message)}, {int(a.warning)}}}" for a in system.assertions]
    return f"""const char model_name[] = {_quoted(name)};
const size_t model_n_variables = {len(variables)}, model_n_states = N_STATES,
    model_n_indicators = N_RELATIONS + JUMPING;
const ModelVariable model_variables[] = {{
{rows}
}};
const unsigned model_state_references[] = {_list(references["states"])};
const unsigned model_derivative_references[] = {_list(references["derivatives"])};
const double model_parameter_starts[] = {_list(starts)};
const double model_input_starts[] = {_list([constant_start(s) for s in layout.inputs])};
const double model_nominals[] = {_list(nominals)};
const unsigned char model_inclusive[] = {_list([int(r.inclusive) for r in system.relations])};
const int model_chain[] = {_list([b.chain for b in system.branches])};
const ModelAssertion model_assertions[] = {{{", ".join(messages) or "{0, 0}"}}};
const int model_loop_size[] = {_list([len(loop.symbols) for loop in system.loops])};
const int model_loop_line[] = {_list([loop.line or 0 for loop in system.loops])};
const char *const model_loop_names[] = {_list_of_names(system)};
const char model_initial_kind[] = "{"".join(kind for kind, _ in initial)}";
const int model_initial_index[] = {_list([place for _, place in initial])};
const char model_open[] = "{"".join(str(int(value)) for value in _open(system, e))}";
"""


def _open(system: HybridSystem, e: Expressions) -> list[bool]:
    """Which unknowns at the start have no start value in the model."""
    sought = [s.variable.start is None and s.variable.binding is None for s in e.initial_unknowns]
    return sought + [value for loop in system.loops for value in loop.open]


KIND_OF = {"state": "x", "parameter": "p", "calculated": "p", "discrete": "d"}


def _place(scalar: Scalar, layout: Layout) -> int:
    """Where an unknown of the initial system stands in its array of ModelData."""
    if scalar.kind == "state":
        return layout.states.index(scalar)
    if scalar.kind == "discrete":
        return layout.memories.index(scalar)
    return (layout.parameters + layout.calculated).index(scalar)


def _list_of_names(system: HybridSystem) -> str:
    names = [_quoted(", ".join(loop.names[:8])) for loop in system.loops]
    return "{" + (", ".join(names) or "0") + "}"


def _row(v: Variable) -> str:
    settable = "SET_NEVER"
    if v.kind == "input" or (v.kind == "parameter" and v.variability == "tunable"):
        settable = "SET_ALWAYS"
    elif v.kind == "parameter" or (v.kind == "state" and v.initial in ("exact", "approx")):
        settable = "SET_BEFORE_START"
    low = "-HUGE_VAL" if v.min is None else repr(v.min)
    high = "HUGE_VAL" if v.max is None else repr(v.max)
    return (
        f"    {{{_quoted(v.name)}, {KIND[v.kind]}, {TYPE[v.type]}, {settable}, {v.index}, "
        f"{low}, {high}}}"
    )


def constant_start(scalar: Scalar) -> float:
    return float(scalar.value) if scalar.value is not None and scalar.value.is_constant() else 0.0


def _list(values: list) -> str:
    return "{" + (", ".join(repr(v) for v in values) or "0") + "}"


def _quoted(text: str) -> str:
    """A C string; what Modelica breaks into lines is one."""
    text = " ".join(text.split("\n"))
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _silence_unused(text: str) -> str:
    """Functions of an empty group leave arguments unused; say so to the compiler."""
    lines = []
    for line in text.split("\n"):
        lines.append(line)
        if line.startswith("void ") and line.endswith("{"):
            names = [
                a.strip().split()[-1].lstrip("*")
                for a in line[line.index("(") + 1 : line.rindex(")")].split(",")
            ]
            if names != ["q"]:
                lines.append("    " + " ".join(f"(void){n};" for n in names))
    return "\n".join(lines)
