"""What runs side by side do: functions without a branch, elementary functions of their own."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from modelica_fmu.batch import CSRC, PART_FLAGS, Drive, Subsystem, build_part
from modelica_fmu.cut import cut
from modelica_fmu.lanes import asserted_once, in_lanes
from modelica_fmu.toolchain import compile_library, find_compiler, host_platform

UNARY = ("exp", "log", "sin", "cos", "tan", "tanh")
ODD = [0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e300, -800.0, 800.0, 5e-324, 1e7, -3.5]


@pytest.fixture(scope="module")
def elementary(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    folder = tmp_path_factory.mktemp("elementary")
    (folder / "elementary.h").write_text((CSRC / "batch" / "elementary.h").read_text("utf-8"))
    text = ['#include "elementary.h"', "typedef const double *In;"]
    for kind in ("vector", "scalar"):
        text += [
            f"void {kind}s_{f}(In x, double *y, int n)"
            f" {{ for (int i = 0; i < n; i++) y[i] = {kind}_{f}(x[i]); }}"
            for f in UNARY
        ]
        text.append(
            f"void {kind}s_pow(In x, In e, double *y, int n)"
            f" {{ for (int i = 0; i < n; i++) y[i] = {kind}_pow(x[i], e[i]); }}"
        )
    source = "\n".join(text).replace("void ", '__attribute__((visibility("default"))) void ')
    (folder / "all.c").write_text(source)
    target = host_platform()
    name = f"all{target.extension}"
    compile_library(find_compiler(target), target, folder, ["all.c"], name, PART_FLAGS)
    return ctypes.CDLL(str(folder / name))


def called(library: ctypes.CDLL, name: str, *arguments: np.ndarray) -> np.ndarray:
    made = np.empty_like(arguments[0])
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in (*arguments, made)]
    getattr(library, name)(*pointers, len(made))
    return made


@pytest.mark.parametrize(
    ("name", "least", "most", "error"),
    [
        ("exp", -700, 700, 1),
        ("exp", -1, 1, 1),
        ("log", 1e-300, 1e-290, 2),
        ("log", 0.5, 2, 2),
        ("sin", -1e5, 1e5, 2),
        ("sin", -1e-3, 1e-3, 1),
        ("cos", -1e5, 1e5, 2),
        ("tan", -1e5, 1e5, 4),
        ("tan", -1e-3, 1e-3, 2),
        ("tanh", -20, 20, 3),
        ("tanh", -1e-5, 1e-5, 3),
    ],
)
def test_elementary_functions_are_right_to_some_units_in_the_last_place(
    elementary: ctypes.CDLL, name: str, least: float, most: float, error: float
) -> None:
    x = np.random.default_rng(0).uniform(least, most, 20_000)
    found, true = called(elementary, f"vectors_{name}", x), getattr(np, name)(x)
    assert (np.abs(found - true) / np.spacing(np.abs(true))).max() <= error
    np.testing.assert_array_equal(called(elementary, f"scalars_{name}", x), found)


def test_a_power_is_right_to_as_many_units_as_its_logarithm_is_large(
    elementary: ctypes.CDLL,
) -> None:
    rng = np.random.default_rng(0)
    x, e = rng.uniform(1e-12, 10, 20_000), rng.uniform(-3, 3, 20_000)
    found, true = called(elementary, "vectors_pow", x, e), x**e
    units = np.abs(found - true) / np.spacing(true)
    assert (units <= 4 + 2 * np.abs(e * np.log(x))).all()
    np.testing.assert_array_equal(called(elementary, "scalars_pow", x, e), found)


@pytest.mark.parametrize("name", UNARY)
def test_out_of_range_one_instance_asks_the_library(elementary: ctypes.CDLL, name: str) -> None:
    x = np.array(ODD)
    with np.errstate(all="ignore"):
        true = getattr(np, name)(x)
    found = called(elementary, f"scalars_{name}", x)
    np.testing.assert_allclose(found, true, rtol=1e-15)
    told = called(elementary, f"vectors_{name}", x)
    known = np.isfinite(told)
    np.testing.assert_array_equal(told[known], found[known])
    assert np.isnan(told[~known]).all()  # which a lane leaves to core.c


def test_powers_of_zero_and_of_what_is_negative(elementary: ctypes.CDLL) -> None:
    x = np.array([0, 0, 0, -2, -2, -2, 2, np.inf, -1.5, 0.5, 1])
    e = np.array([0, 2, -1, 2, 3, 0.5, 0, 2, -3, 1e4, np.nan])
    with np.errstate(all="ignore"):
        true = x**e
    np.testing.assert_allclose(called(elementary, "scalars_pow", x, e), true, rtol=1e-14)


MODEL = """package Toy
  model Mill "What parameters switch on, branches on states, a library's function"
    parameter Real m = 1.0;
    parameter Real wave = 0.0;
    parameter Real soft = 0.0;
    input Real u;
    output Real s(start = 0, fixed = true);
    output Real v(start = 0, fixed = true);
    Real bump;
    Real law;
    Real turned;
  equation
    bump = noEvent(if wave > 0 then wave*(sin(300*s) + cos(170*s)*exp(-s^2)) else 0);
    law = noEvent(if soft > 0 then soft*(abs(v)/0.1 + 1e-9)^0.7*tanh(v/0.01) else 0);
    turned = noEvent(if v > 0 then atan(5*s) else log(1 + v^2));
    der(s) = v;
    m*der(v) = u - bump - law - turned - 0.4*v;
  end Mill;
end Toy;
"""


@pytest.fixture(scope="module")
def mill(tmp_path_factory: pytest.TempPathFactory) -> Subsystem:
    folder = tmp_path_factory.mktemp("mill")
    (folder / "Toy.mo").write_text(MODEL, encoding="utf-8")
    compiled = cut(folder / "Toy.mo", "Toy.Mill", ["s", "v"])
    assert asserted_once(compiled.sources["model.c"])  # else no run had a lane
    return Subsystem(build_part(compiled, folder, "mill"))


def test_lanes_that_need_different_parts_give_the_bits_of_single_runs(mill: Subsystem) -> None:
    drive = Drive({"u": np.sin(np.arange(2000) / 90)})
    values = np.array([[1.0, w, f] for w in (0.0, 0.3) for f in (0.0, 0.5)] * 2)
    values[:, 0] = np.linspace(0.5, 2.0, 8)
    names = ["m", "wave", "soft"]
    found = mill.run(names, values, drive, ["s", "v"], 1e-3)
    alone = [mill.run(names, row[None], drive, ["s", "v"], 1e-3)[0] for row in values]
    np.testing.assert_array_equal(found, np.stack(alone))
    assert np.isfinite(found).all()
    assert np.ptp(found[0] - found[2]) > 0.01


SOURCE = """const unsigned char model_inclusive[] = {0, 1};
void model_rates(const ModelData *q, double *dx) {
    (void)q; (void)dx;
    double w1 = 0.0;
    if (q->h[3]) {
        const double w2 = q->x[0] * 2.0;
        w1 = w2;
    }
    const int w3 = q->m[0] || q->m[1];
    double w4 = 0.0;
    if (w3) {
        w4 = erf(w1);
    }
    dx[0] = w4;
}
"""


def test_an_assertion_of_parameters_alone_holds_from_the_start_on() -> None:
    """What reads a state or an input may fail later."""
    text = (
        "void model_check(const ModelData *q, double *ok) {{\n    (void)q;\n    ok[0] = {};\n}}\n"
    )
    assert asserted_once(text.format("q->p[0] != 0.0 && q->h[12] > 1.0"))
    for read in ("q->x[0]", "q->u[3]", "q->time", "q->d[0]"):
        assert not asserted_once(text.format(f"q->p[0] != {read}"))


def test_nothing_in_a_loop_branches_and_a_library_s_function_stands_alone() -> None:
    made = in_lanes(SOURCE, ["rates"])
    body = made[made.index("void lanes_rates") :]
    assert "asked += (q->h[3][l] != 0);" in body
    assert "memset(w1, 0, sizeof w1);" in body
    assert "w3[l] = (q->m[0][l] != 0) | (q->m[1][l] != 0);" in body
    assert "w4[l] = ((w3[l] != 0)) ? (erf(w1[l])) : 0;" in body
    assert body.count("for (int l") == 5  # asked, gated, the condition, the call, results


WITHIN = """const unsigned char model_inclusive[] = {};
void model_rates(const ModelData *q, double *dx) {
    (void)q; (void)dx;
    double w3 = 0.0;
    if (q->h[3]) {
        const double w1 = q->x[0] * 2.0;
        const double w2 = erf(w1);
        w3 = w1 + w2;
    }
    dx[0] = w3;
}
"""


def test_only_what_is_read_beyond_a_parameter_s_branch_is_put_to_0_where_none_asks() -> None:
    """Rates of a whole plant spent a third of their time on values that nobody read."""
    made = in_lanes(WITHIN, ["rates"])
    body = made[made.index("void lanes_rates") :]
    assert body.count("memset(") == 1
    assert "memset(w3, 0, sizeof w3);" in body
    assert {f"Lane {name};" for name in ("w1", "w2", "w3")} <= set(body.splitlines())
