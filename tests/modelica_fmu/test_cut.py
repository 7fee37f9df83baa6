"""Parts cut out of a model at measured variables."""

from __future__ import annotations

import gc
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import modelica_fmu.cut as cutting
from modelica_fmu.batch import Drive, Subsystem, build_part
from modelica_fmu.compiled import CompiledModel
from modelica_fmu.cut import cut, structure
from modelica_fmu.errors import InputError
from modelica_fmu.hybrid import HybridSystem
from pyfmi_runner.build import default_model
from pyfmi_runner.plant import DEFAULT_CLASS

MEASURED = ("x", "z", "v_x", "v_z", "f_x", "f_z", "f_ax", "f_az")
CART = """package Toy
  model Cart
    parameter Real tau = 0.1;
    parameter Real K = 2.0;
    parameter Real m = 1.0;
    parameter Real c = 0.5;
    parameter Real s_start = 0.3;
    input Real u;
    output Real f(start = 0.0, fixed = true);
    output Real v(start = 0.0, fixed = true);
    Real s(start = s_start, fixed = true);
    output Real heat(start = 0.0, fixed = true);
    output Real said;
  equation
    tau * der(f) = K * u - f;
    m * der(v) = f - c * v;
    der(s) = v;
    der(heat) = c * v * v;
    said = s;
  end Cart;
end Toy;
"""


def written(text: str, folder: Path) -> Path:
    path = folder / "Toy.mo"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(CART, tmp_path_factory.mktemp("toy"))


def names(part: CompiledModel, kind: str) -> set[str]:
    return {v.name for v in part.variables if v.kind == kind}


def gantry(outputs: tuple[str, ...], unknown: tuple[str, ...] = ()) -> CompiledModel:
    known = [c for c in MEASURED if c not in outputs and c not in unknown]
    return cut(default_model(), DEFAULT_CLASS, outputs, known)


def test_a_part_holds_what_its_output_needs_and_no_more(cart: Path) -> None:
    part = cut(cart, "Toy.Cart", ["v"], ["f"])
    assert names(part, "input") == {"f"}
    assert names(part, "state") == {"v"}
    assert {"m", "c"} <= names(part, "parameter")
    assert not {"tau", "K", "s_start"} & names(part, "parameter")


BEGUN = """package Toy
  block Follower
    parameter Real tau = 0.5;
    parameter Real share = 2;
    parameter Real level(fixed = false);
    input Real z;
    Real s;
  initial equation
    s = share*z + level;
    level = 3*tau;
  equation
    der(s) = (z - s)/tau;
  end Follower;
  model Two
    Follower one, two(tau = 0.1);
    input Real u(start = 0);
    output Real a, b;
  equation
    one.z = u + 1;
    two.z = 3*u;
    a = one.s;
    b = two.s;
  end Two;
end Toy;
"""


def test_a_part_begins_as_its_own_initial_equations_say(tmp_path: Path) -> None:
    model = written(BEGUN, tmp_path)
    part = cut(model, "Toy.Two", ["a"])
    assert names(part, "state") == {"one.s"}
    assert {"one.share", "one.tau"} <= names(part, "parameter")
    assert not {"two.share", "two.tau"} & names(part, "parameter")
    fixed = cut(model, "Toy.Two", ["a"], fixed={"one.share": 5.0, "one.tau": 1.0})
    for key, made, value in (("part", part, 2 + 3 * 0.5), ("fixed", fixed, 5 + 3 * 1.0)):
        run = Subsystem(build_part(made, tmp_path, key))
        drive = Drive({"u": np.zeros(3)})
        told = run.runs([], np.zeros((1, 0)), [drive], ["one.s"], 0.01, [0])
        assert told[0][0, 0] == pytest.approx(value)


def test_without_a_measured_variable_the_part_reaches_further_upstream(cart: Path) -> None:
    part = cut(cart, "Toy.Cart", ["v"])
    assert names(part, "input") == {"u"}
    assert names(part, "state") == {"f", "v"}
    assert {"tau", "K", "m", "c"} <= names(part, "parameter")


def test_another_name_of_a_state_is_told(cart: Path) -> None:
    shape = structure(cart, "Toy.Cart")
    assert shape.roots["said"] == "s"
    assert shape.states == {"f", "v", "s", "heat"}
    assert shape.rates["s"] == "v"
    assert "v" not in shape.rates  # its rate is no variable
    assert names(cut(cart, "Toy.Cart", ["said"], ["v"]), "parameter") >= {"s_start"}


def test_the_gantry_s_valve_is_cut_at_position_and_command() -> None:
    part = gantry(("f_ax",))
    assert names(part, "input") == {"u_x", "f_manual_x", "axis_x.s"}
    assert all(state.startswith("valve_x.") for state in names(part, "state"))
    assert {"valve_x.K", "valve_x.tau", "valve_x.u_0"} <= names(part, "parameter")
    assert not {"axis_x.m", "axis_x.friction.F_s", "contact.K_c"} & names(part, "parameter")


def test_the_gantry_s_contact_needs_no_state() -> None:
    part = gantry(("f_x", "f_z"))
    assert names(part, "state") == set()
    assert {"contact.K_c", "contact.z_0", "workpiece.shape"} <= names(part, "parameter")
    assert {"axis_x.s", "axis_z.s", "axis_x.v", "axis_z.v"} <= names(part, "input")


def test_without_the_actuator_force_the_carriage_s_part_holds_the_valve() -> None:
    part = gantry(("v_x",), unknown=("f_ax",))
    assert "u_x" in names(part, "input")
    assert {"axis_x.v", "valve_x.f_a"} <= names(part, "state")
    assert {"axis_x.m", "axis_x.friction.F_s", "valve_x.K"} <= names(part, "parameter")


@pytest.mark.parametrize("field", ["outputs", "known"])
def test_a_name_that_is_no_variable_is_one_clear_line(cart: Path, field: str) -> None:
    given = {"outputs": ["v"], "known": ["f"], field: ["speed"]}
    with pytest.raises(
        InputError, match=r"speed: Toy\.Cart has no variable of that name"
    ) as caught:
        cut(cart, "Toy.Cart", **given)
    assert "\n" not in str(caught.value)


# ---- parameters that become numbers

SWITCHED = """package Toy
  model Sled
    parameter Real m = 1.0;
    parameter Real c = 0.5;
    parameter Real spring = 0.0;
    parameter Real stop = 2.0;
    parameter Real hard = 0.0;
    parameter Integer law = 1;
    parameter Real twice = 2 * c;
    input Real u;
    output Real v(start = 0.0, fixed = true);
    Real s(start = 0.0, fixed = true);
    Real bristle(start = 0.0, fixed = true);
    Real brake;
  equation
    brake = if law == 2 then 5 * bristle else twice * v;
    m * der(v) = u - brake - spring * s - (if s > stop then hard * (s - stop) else 0);
    der(s) = v;
    der(bristle) = v - abs(v) * bristle;
  end Sled;
end Toy;
"""


@pytest.fixture(scope="module")
def sled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(SWITCHED, tmp_path_factory.mktemp("toy"))


def test_what_fixed_parameters_leave_without_effect_is_no_part(sled: Path) -> None:
    whole = cut(sled, "Toy.Sled", ["v"])
    assert names(whole, "state") == {"v", "s", "bristle"}
    part = cut(sled, "Toy.Sled", ["v"], fixed={"law": 1, "spring": 0, "hard": 0})
    assert names(part, "state") == {"v"}
    assert names(part, "parameter") - {"solver.max_step", "solver.tolerance"} == {"m", "c"}
    held = cut(sled, "Toy.Sled", ["v"], fixed={"law": 2, "c": 0.5})
    assert names(held, "state") == {"v", "s", "bristle"}
    assert not {"law", "c", "twice"} & (names(held, "parameter") | names(held, "calculated"))


@pytest.mark.parametrize(
    "fixed",
    [
        {"law": 1.0, "spring": 0.0, "hard": 0.0},
        {"law": 2.0, "spring": 3.0},
        {"hard": 80.0, "stop": 0.1, "c": 0.2},
        {"m": 2.5},
    ],
)
@pytest.mark.usefixtures("unoptimised")
def test_a_part_with_numbers_computes_what_the_whole_does(
    sled: Path, tmp_path: Path, fixed: dict[str, float]
) -> None:
    time = 1e-3 * np.arange(3000)
    u = {"u": np.sin(2 * time * (1 + time))}
    parts = [cut(sled, "Toy.Sled", ["v"]), cut(sled, "Toy.Sled", ["v"], fixed=fixed)]
    runs = [Subsystem(build_part(p, tmp_path, str(i))) for i, p in enumerate(parts)]
    whole = runs[0].run(list(fixed), np.array([list(fixed.values())]), Drive(u), ["v"], 1e-3)
    own = runs[1].run([], np.zeros((1, 0)), Drive(u), ["v"], 1e-3)
    assert np.ptp(whole) > 0.1
    assert np.abs(own - whole).max() < 1e-12


@pytest.mark.parametrize("name", ["mass", "v", "twice"])
def test_what_cannot_be_fixed_is_one_clear_line(sled: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"{name} is no parameter") as caught:
        cut(sled, "Toy.Sled", ["v"], fixed={name: 1.0})
    assert "\n" not in str(caught.value)


def test_threads_compile_one_at_a_time_and_collect_no_garbage_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CasADi's expressions belong to no two threads: it crashes otherwise, now and then."""
    model = written(CART, tmp_path)
    inside, most, compiling = 0, 0, cutting.compile_system

    def watched(system: HybridSystem, part: bool) -> CompiledModel:
        nonlocal inside, most
        inside += 1
        most = max(most, inside)
        time.sleep(0.02)
        assert not gc.isenabled()
        made = compiling(system, part=part)
        inside -= 1
        return made

    monkeypatch.setattr(cutting, "compile_system", watched)
    with ThreadPoolExecutor(4) as pool:
        jobs = [pool.submit(cut, model, "Toy.Cart", [v]) for v in ("f", "v", "s") * 2]
        made = [job.result() for job in jobs]
    assert most == 1
    assert gc.isenabled()
    assert all(m.sources for m in made)


TROLLEY = """package Toy
  model Trolley "A mass matrix: both equations hold both accelerations"
    parameter Real M = 5;
    parameter Real m = 1;
    parameter Real l = 0.6;
    input Real F;
    output Real x(start = 0, fixed = true);
    output Real q(start = 0.2, fixed = true);
    output Real v(start = 0, fixed = true);
    output Real w(start = 0, fixed = true);
  equation
    der(x) = v;
    der(q) = w;
    (M + m)*der(v) + m*l*cos(q)*der(w) = F - 4*v + m*l*w^2*sin(q);
    m*l*cos(q)*der(v) + m*l^2*der(w) = -m*9.81*l*sin(q);
  end Trolley;
end Toy;
"""


@pytest.mark.usefixtures("unoptimised")
def test_a_known_state_s_rate_that_equations_share_is_an_unknown(tmp_path: Path) -> None:
    """The part of the trolley where the load is measured moves as the whole does."""
    model, time = written(TROLLEY, tmp_path), 1e-3 * np.arange(3000)
    everything, force = ["x", "v", "q", "w"], {"F": 5 * np.sin(2 * time)}
    parts = [cut(model, "Toy.Trolley", everything), cut(model, "Toy.Trolley", ["x"], ["q", "w"])]
    assert names(parts[1], "state") == {"x", "v"}
    whole, own = (Subsystem(build_part(p, tmp_path, str(i))) for i, p in enumerate(parts))
    true = whole.run([], np.zeros((1, 0)), Drive(force), everything, 1e-3)[0]
    read = {n: true[:, everything.index(n)] for n in ("q", "w")}
    known = {n: (r, np.append((r[:-1] + r[1:]) / 2, r[-1])) for n, r in read.items()}
    found = own.run([], np.zeros((1, 0)), Drive({**force, **known}), ["x"], 1e-3)[0]
    assert np.ptp(true[:, 0]) > 0.1
    np.testing.assert_allclose(found[:, 0], true[:, 0], atol=1e-6)
