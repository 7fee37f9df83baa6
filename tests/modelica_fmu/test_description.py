"""modelDescription.xml: valid by the schemas, and it says what the compiled model says."""

import re
import zipfile
from dataclasses import replace
from pathlib import Path

import fmpy
import pytest
from fmpy.validation import validate_fmu
from lxml import etree
from stub_model import STUB

from modelica_fmu.compiled import Variable
from modelica_fmu.description import model_description
from modelica_fmu.units import base_unit

SCHEMAS = Path(fmpy.__file__).parent / "schema"


def description(fmi: str, compiled=STUB):
    return etree.fromstring(model_description(compiled, fmi, "{token}", ["model.c"]))


def variable(root, name: str):
    return next(e for e in root.find("ModelVariables") if e.get("name") == name)


def schema(name: str) -> etree.XMLSchema:
    return etree.XMLSchema(file=str(SCHEMAS / name))


def test_fmpy_finds_no_problem(fmu):
    assert validate_fmu(str(fmu)) == []


def test_it_is_valid_by_the_standards_schema(fmi):
    xsd = schema(f"fmi{fmi[0]}/fmi{fmi[0]}ModelDescription.xsd")
    assert xsd.validate(description(fmi)), xsd.error_log


def test_the_build_description_is_valid_by_the_standards_schema(fmu):
    with zipfile.ZipFile(fmu) as archive:
        if "sources/buildDescription.xml" not in archive.namelist():
            pytest.skip("FMI 2.0 lists its sources in modelDescription.xml")
        text = archive.read("sources/buildDescription.xml")
    xsd = schema("fmi3/fmi3BuildDescription.xsd")
    assert xsd.validate(etree.fromstring(text)), xsd.error_log


def test_attributes_of_every_kind_of_variable():
    root = description("2.0")
    for name, attributes, typed in (
        ("time", {"causality": "independent", "variability": "continuous"}, {"unit": "s"}),
        (
            "m",
            {"causality": "parameter", "initial": "exact"},
            {"min": "0.1", "max": "100.0", "start": "1.0", "unit": "kg"},
        ),
        (
            "medium",
            {"variability": "fixed"},
            {"declaredType": "Stub.Medium", "start": "2", "min": "1", "max": "2"},
        ),
        ("n", {"variability": "tunable"}, {"start": "1", "min": "1", "max": "3"}),
        ("weight", {"causality": "calculatedParameter", "initial": "calculated"}, {"unit": "N"}),
        (
            "f",
            {"causality": "input", "variability": "continuous"},
            {"start": "0.0", "min": "-50.0", "max": "50.0"},
        ),
        ("on", {"causality": "input", "variability": "discrete"}, {"start": "false"}),
        (
            "ball.h",
            {"causality": "local", "initial": "exact"},
            {"start": "1.0", "nominal": "0.5", "reinit": "true"},
        ),
        ("der(ball.h)", {"initial": "calculated"}, {"derivative": "11", "unit": "m/s"}),
        ("bounces", {"causality": "output", "variability": "discrete"}, {"min": "0"}),
    ):
        element = variable(root, name)
        assert attributes.items() <= dict(element.attrib).items(), name
        assert typed.items() <= dict(element[0].attrib).items(), name
    assert "initial" not in variable(root, "f").attrib
    assert "start" not in variable(root, "weight")[0].attrib
    assert "start" not in variable(root, "time")[0].attrib


def test_fmi3_has_the_types_and_event_indicators_of_fmi3():
    root = description("3.0")
    tags = {
        name: variable(root, name).tag
        for name in ("time", "medium", "n", "on", "bounces", "eventIndicator[1]")
    }
    assert tags == {
        "time": "Float64",
        "medium": "Enumeration",
        "n": "Int32",
        "on": "Boolean",
        "bounces": "Int32",
        "eventIndicator[1]": "Float64",
    }
    indicator = variable(root, "eventIndicator[1]").get("valueReference")
    assert [e.get("valueReference") for e in root.findall("ModelStructure/EventIndicator")] == [
        indicator
    ]
    assert variable(root, "der(ball.v)").get("derivative") == "11"


def test_the_structure_lists_dependencies_for_every_unknown():
    two, three = (
        description("2.0").find("ModelStructure"),
        description("3.0").find("ModelStructure"),
    )
    derivatives = [(e.get("index"), e.get("dependencies")) for e in two.find("Derivatives")]
    assert derivatives == [("13", "12"), ("14", "9 10 12")]
    assert [
        (e.get("valueReference"), e.get("dependencies"))
        for e in three.findall("ContinuousStateDerivative")
    ] == [
        ("12", "11"),
        ("13", "8 9 11"),
    ]
    assert [e.get("index") for e in two.find("InitialUnknowns")] == [
        "8",
        "13",
        "14",
        "15",
        "16",
        "17",
    ]
    assert all(e.get("dependencies") is not None for e in (*two.iter("Unknown"), *three))


def test_capability_flags_are_those_of_the_wrapper():
    two, three = description("2.0"), description("3.0")
    for root, state in ((two, "FMUstate"), (three, "FMUState")):
        for tag in ("CoSimulation", "ModelExchange"):
            assert (
                root.find(tag).get(f"canGetAndSet{state}")
                == root.find(tag).get(f"canSerialize{state}")
                == "true"
            )
        assert root.find("CoSimulation").get("canHandleVariableCommunicationStepSize") == "true"
    assert three.find("CoSimulation").get("hasEventMode") == "false"
    assert three.find("CoSimulation").get("providesAdjointDerivatives") == "true"
    assert three.find("ScheduledExecution") is None


def test_declared_log_categories_are_the_wrappers():
    declared = [e.get("name") for e in description("2.0").iter("Category")]
    text = (Path(__file__).parents[2] / "modelica_fmu/csrc/wrapper.c").read_text()
    names = re.findall(r'"(log\w+)"', text.split("log_categories[] = {")[1].split("};")[0])
    assert declared == [*names, "logAll"]


def test_text_from_the_model_is_escaped():
    assert description("3.0").get("description") == STUB.description
    assert "<every>" in STUB.description


def test_a_name_outside_the_structured_convention_makes_the_convention_flat():
    odd = Variable("a b", "algebraic", "Real", "local", "continuous", "calculated", 2)
    assert description("2.0").get("variableNamingConvention") == "structured"
    assert (
        description("2.0", replace(STUB, variables=(*STUB.variables, odd))).get(
            "variableNamingConvention"
        )
        == "flat"
    )


def test_a_model_without_time_is_refused(fmi):
    with pytest.raises(ValueError, match="exactly one independent variable"):
        model_description(replace(STUB, variables=STUB.variables[1:]), fmi, "t")


@pytest.mark.parametrize(
    ("text", "exponents", "factor"),
    [
        ("N.s/m", {"kg": 1, "s": -1}, 1.0),
        ("m/s", {"m": 1, "s": -1}, 1.0),
        ("m/s2", {"m": 1, "s": -2}, 1.0),
        ("N/V", {"m": -1, "s": 1, "A": 1}, 1.0),
        ("rad", {"rad": 1}, 1.0),
        ("kg", {"kg": 1}, 1.0),
        ("1", {}, 1.0),
        ("Pa", {"kg": 1, "m": -1, "s": -2}, 1.0),
        ("m-1", {"m": -1}, 1.0),
        ("1/m", {"m": -1}, 1.0),
        ("s/m", {"m": -1, "s": 1}, 1.0),
        ("%", {}, 0.01),
        ("mm", {"m": 1}, 1e-3),
        ("N/(m.s)", {"kg": 1, "s": -3}, 1.0),
        ("kN/mm2", {"kg": 1, "m": -1, "s": -2}, 1e9),
        ("min", {"s": 1}, 60.0),
    ],
)
def test_units_become_exponents_of_the_si_base(text, exponents, factor):
    unit = base_unit(text)
    names = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
    assert unit is not None
    assert {n: e for n, e in zip(names, unit.exponents, strict=True) if e} == exponents
    assert unit.factor == pytest.approx(factor)


@pytest.mark.parametrize("text", ["furlong", "m//s", "m^2", "", "kkg"])
def test_a_unit_that_is_not_understood_has_no_meaning(text):
    assert base_unit(text) is None
