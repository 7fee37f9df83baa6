"""Parts cut out of a model at measured variables."""

from __future__ import annotations

from pathlib import Path

import pytest

from modelica_fmu.compiled import CompiledModel
from modelica_fmu.cut import cut, structure
from modelica_fmu.errors import InputError
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


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("toy") / "Toy.mo"
    path.write_text(CART, encoding="utf-8")
    return path


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
