"""The C that emit.py prints computes what CasADi computes, on random expressions with nested,
shared and parameter-only parts.
"""

from __future__ import annotations

import ctypes
import re
import subprocess

import casadi as ca
import numpy as np
import pytest

from modelica_fmu.emit import Emitter, Hoist
from modelica_fmu.generate import _silence_unused

FUNCTIONS, OUTPUTS, NODES, POINTS = 80, 5, 60, 25
N_X, N_P, N_M = 5, 6, 3
MAX_SLOTS = 20_000


def bounded(v: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(v, -9), 9)


# No operand leaves its function's domain: what min() and max() make of NaN is not C's business.
UNARY = [
    ca.sin,
    ca.cos,
    ca.atan,
    ca.tanh,
    ca.fabs,
    ca.sign,
    ca.floor,
    ca.ceil,
    lambda v: -v,
    lambda v: 2 * v,
    lambda v: bounded(v) ** 2,
    lambda v: bounded(v) ** 3,
    lambda v: ca.sqrt(ca.fabs(v)),
    lambda v: ca.exp(-ca.fabs(v)),
    lambda v: ca.log(1 + ca.fabs(v)),
    lambda v: 1 / (1 + v**2),
    lambda v: ca.asin(ca.tanh(v)),
    lambda v: ca.acos(ca.sin(v)),
    lambda v: ca.sinh(bounded(v)),
    lambda v: ca.cosh(bounded(v)),
    lambda v: ca.tan(ca.tanh(v)),
]
BINARY = [
    lambda a, b: a + b,
    lambda a, b: a - b,
    lambda a, b: bounded(a) * bounded(b),
    lambda a, b: a / (1 + ca.fabs(b)),
    ca.fmin,
    ca.fmax,
    ca.atan2,
    lambda a, b: (1 + ca.fabs(a)) ** ca.tanh(b),
    lambda a, b: ca.fmod(a, 1 + ca.fabs(b)),
    ca.hypot,
    lambda a, b: ca.if_else(b > 0, bounded(a) / b, a),
]
LOGIC = [lambda a, b: a < b, lambda a, b: a <= b, lambda a, b: a == b, lambda a, b: a != b]


def random_outputs(rng: np.random.Generator, leaves: list[ca.SX]) -> list[ca.SX]:
    """A random graph whose nodes are used again and again, on either side of conditionals and as
    their conditions.
    """
    values, truths = list(leaves), [leaves[-1] > 0]

    def pick(items: list[ca.SX]) -> ca.SX:
        recent = rng.random() < 0.6
        return items[rng.integers(max(0, len(items) - 8) if recent else 0, len(items))]

    for _ in range(NODES):
        kind = rng.random()
        if kind < 0.25:
            value = UNARY[rng.integers(len(UNARY))](pick(values))
        elif kind < 0.55:
            value = BINARY[rng.integers(len(BINARY))](pick(values), pick(values))
        elif kind < 0.7:
            truths.append(LOGIC[rng.integers(len(LOGIC))](pick(values), pick(values)))
            continue
        elif kind < 0.78:
            combine = (
                ca.logic_and,
                ca.logic_or,
                lambda a, _: ca.logic_not(a),
                lambda a, b: a + b * 2 > 1,
            )[rng.integers(4)]
            truths.append(combine(pick(truths), pick(truths)))
            continue
        elif kind < 0.8:
            value = pick(truths) / (1 + pick(truths))  # truth values in arithmetic
        else:
            value = ca.if_else(pick(truths), pick(values), pick(values))
        values.append(value)
    return [pick(values) for _ in range(OUTPUTS)]


@pytest.fixture(scope="module")
def functions(tmp_path_factory):
    """(CasADi functions of time, x, p, m; C functions of the same and the hoisted array h; C
    function that fills h).
    """
    rng = np.random.default_rng(20080612)
    time, x, p, m = ca.SX.sym("time"), ca.SX.sym("x", N_X), ca.SX.sym("p", N_P), ca.SX.sym("m", N_M)
    groups = {"q->time": time, "q->x": x, "q->p": p, "q->m": m}
    leaves = [time, *ca.vertsplit(x), *ca.vertsplit(p), *ca.vertsplit(m), ca.SX(0.5), ca.SX(-3)]
    hoist = Hoist()
    emitter = Emitter(groups, ("q->p",), hoist)
    reference, texts = [], []
    for i in range(FUNCTIONS):
        only_parameters = leaves[1 + N_X : 1 + N_X + N_P]
        outputs = random_outputs(rng, only_parameters + leaves if i % 2 else leaves)
        reference.append(ca.Function(f"f{i}", [time, x, p, m], [ca.vertcat(*outputs)]))
        texts.append(
            emitter.function(f"f{i}", {"y": ca.vertcat(*outputs)}, "const ModelData *q, double *y")
        )
    assert 50 < len(hoist.slots) < MAX_SLOTS
    folder = tmp_path_factory.mktemp("emit")
    head = f"""#include <math.h>
typedef struct {{ double time, x[{N_X}], p[{N_P}], m[{N_M}], h[{MAX_SLOTS}]; }} ModelData;
static inline double model_min(double a, double b) {{ return a < b ? a : b; }}
static inline double model_max(double a, double b) {{ return a > b ? a : b; }}
"""
    prepare, moved, stored = hoist.stored("\n".join(texts))
    assert 50 < stored < len(hoist.slots)
    assert prepare.count("static void prepare_") > 2  # parts that read what others have stored
    (folder / "f.c").write_text(head + prepare + _silence_unused(moved))
    flags = [
        "-std=c11",
        "-O1",
        "-ffp-contract=off",
        "-shared",
        "-fPIC",
        "-Wall",
        "-Werror",
        "-Wno-unused",
    ]
    done = subprocess.run(
        ["cc", *flags, "-o", "f.so", "f.c", "-lm"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    library = ctypes.CDLL(str(folder / "f.so"))
    return reference, texts, library


class Data(ctypes.Structure):
    _fields_ = [
        ("time", ctypes.c_double),
        ("x", ctypes.c_double * N_X),
        ("p", ctypes.c_double * N_P),
        ("m", ctypes.c_double * N_M),
        ("h", ctypes.c_double * MAX_SLOTS),
    ]


def test_c_equals_casadi_on_random_expressions(functions):
    reference, _, library = functions
    rng = np.random.default_rng(7)
    data, y = Data(), (ctypes.c_double * OUTPUTS)()
    for _ in range(POINTS):
        time, x, p, m = (
            rng.normal(),
            rng.normal(0, 3, N_X),
            rng.normal(0, 3, N_P),
            rng.integers(0, 2, N_M).astype(float),
        )
        x[rng.integers(N_X)] = p[rng.integers(N_P)]  # equality happens, too
        data.time, data.x[:], data.p[:], data.m[:] = time, x, p, m
        library.model_prepare(ctypes.byref(data))
        for i, f in enumerate(reference):
            getattr(library, f"f{i}")(ctypes.byref(data), y)
            np.testing.assert_allclose(
                np.array(y),
                np.array(f(time, x, p, m)).ravel(),
                rtol=1e-12,
                atol=1e-12,
                err_msg=f"f{i}",
            )


def test_what_one_branch_needs_is_computed_inside_it(functions):
    _, texts, _ = functions
    assert sum(text.count("if (") for text in texts) > 50
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 2)
    emitter = Emitter({"q->x": x, "q->p": p}, ("q->p",), Hoist())
    shared = ca.exp(x[0])
    y = ca.if_else(x[1] > 0, ca.sin(shared) * p[0], ca.if_else(x[0] > 1, ca.cos(shared), 0))
    lines = emitter.function("f", {"y": y}, "const ModelData *q, double *y").splitlines()
    depth = {
        name: next(line for line in lines if f"{name}(" in line and "=" in line)
        for name in ("exp", "sin", "cos")
    }
    indent = {name: len(line) - len(line.lstrip()) for name, line in depth.items()}
    assert indent == {"exp": 4, "sin": 8, "cos": 12}


def test_parameter_only_values_are_hoisted_once():
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 2)
    hoist = Hoist()
    emitter = Emitter({"q->x": x, "q->p": p}, ("q->p",), hoist)
    parts = ca.exp(p[0]) * ca.sqrt(p[1])
    one = emitter.function("f", {"y": x[0] * parts}, "const ModelData *q, double *y")
    two = emitter.function("g", {"y": x[1] + ca.sin(parts)}, "const ModelData *q, double *y")
    assert len(hoist.slots) == 4  # exp, sqrt, their product, its sine
    assert sum("exp(" in s for s in hoist.slots) == 1
    assert "exp(" not in one + two
    assert "sin(" not in two


def test_only_what_a_function_reads_is_stored():
    x, p = ca.SX.sym("x"), ca.SX.sym("p", 2)
    hoist = Hoist()
    emitter = Emitter({"q->x": x, "q->p": p}, ("q->p",), hoist)
    text = emitter.function(
        "f", {"y": x * ca.sin(ca.exp(p[0])) + p[1] ** 2}, "const ModelData *q, double *y"
    )
    prepare, moved, stored = hoist.stored(text)
    assert (len(hoist.slots), stored) == (3, 2)
    assert prepare.count("const double h") == 3
    assert {"q->h[0]", "q->h[1]"} == set(re.findall(r"q->h\[\d+\]", moved))


def test_without_parameter_only_values_nothing_is_prepared():
    prepare, moved, stored = Hoist().stored("void f(void) {}")
    assert (moved, stored) == ("void f(void) {}", 0)
    assert prepare.strip() == "void model_prepare(ModelData *q) { (void)q; }"
