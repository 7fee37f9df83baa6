"""modelDescription.xml of a compiled model, for FMI 2.0 and FMI 3.0.

The attributes say what csrc/fmi2.c and csrc/fmi3.c do. In FMI 2.0 a variable is referred to by its
position (from 1), in FMI 3.0 by its value reference (its position from 0). FMI 3.0 wants event
indicators as variables: they come last.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from typing import Literal

from modelica_fmu.compiled import CompiledModel, Variable
from modelica_fmu.units import BASE, base_unit

FmiVersion = Literal["2.0", "3.0"]
Element = ElementTree.Element

LOG_CATEGORIES = {
    "logEvents": "events: mode changes and state events",
    "logStatusWarning": "messages of calls that return a warning",
    "logStatusDiscard": "messages of calls that are discarded, such as a value out of its bounds",
    "logStatusError": "messages of calls that return an error",
    "logStatusFatal": "messages of calls that return a fatal error",
    "logAll": "all of these",
}
_STRUCTURED_NAME = re.compile(
    r"(der\()?[A-Za-z_]\w*(\[\d+(,\d+)*\])?(\.[A-Za-z_]\w*(\[\d+(,\d+)*\])?)*(?(1)\))\Z", re.ASCII
)
_FMI3_TYPES = {
    "Real": "Float64",
    "Integer": "Int32",
    "Boolean": "Boolean",
    "Enumeration": "Enumeration",
}


def model_description(
    compiled: CompiledModel, fmi: FmiVersion, token: str, source_files: Iterable[str] = ()
) -> bytes:
    """The XML text; `source_files` are the C files to compile (listed in the description by FMI 2.0
    only).
    """
    _check(compiled)
    three = fmi == "3.0"
    root = Element("fmiModelDescription", {"fmiVersion": fmi, "modelName": compiled.name})
    root.set("instantiationToken" if three else "guid", token)
    root.set("description", compiled.description)
    root.set("generationTool", compiled.tool)
    for name, value in compiled.about.items():
        root.set(name, value)
    root.set("variableNamingConvention", _naming(compiled))
    if not three:
        root.set("numberOfEventIndicators", str(compiled.n_indicators))
    _interfaces(root, compiled, three, tuple(source_files))
    _units(root, compiled)
    _types(root, compiled, three)
    categories = ElementTree.SubElement(root, "LogCategories")
    for name, text in LOG_CATEGORIES.items():
        ElementTree.SubElement(categories, "Category", name=name, description=text)
    times = {"startTime": 0.0, "stopTime": compiled.default_stop, "stepSize": compiled.default_step}
    ElementTree.SubElement(
        root, "DefaultExperiment", {name: _number(time) for name, time in times.items()}
    )
    variables = ElementTree.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(compiled.variables):
        (_variable_3 if three else _variable_2)(variables, compiled, reference, variable)
    if three:
        _indicator_variables(variables, compiled)
    (_structure_3 if three else _structure_2)(root, compiled)
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def indicator_reference(compiled: CompiledModel, index: int) -> int:
    """FMI 3.0 value reference of an event indicator (csrc/fmi3.c counts on it)."""
    return len(compiled.variables) + index


def _check(compiled: CompiledModel) -> None:
    independent = [v.name for v in compiled.variables if v.causality == "independent"]
    if len(independent) != 1:
        raise ValueError(
            f"{compiled.name} needs exactly one independent variable (time), got {independent}"
        )
    for state, derivative in zip(compiled.states, compiled.derivatives, strict=True):
        if compiled.variables[derivative].derivative_of != state:
            name = compiled.variables[derivative].name
            raise ValueError(f"{name} must be the derivative of {compiled.variables[state].name}")


def _naming(compiled: CompiledModel) -> str:
    return (
        "structured" if all(_STRUCTURED_NAME.match(v.name) for v in compiled.variables) else "flat"
    )


def _number(value: float) -> str:
    return repr(float(value))


def _literal(variable: Variable, value: float) -> str:
    if variable.type == "Real":
        return _number(value)
    return ("true" if value else "false") if variable.type == "Boolean" else str(int(value))


# ---- interfaces, units, types ----


def _interfaces(
    root: Element, compiled: CompiledModel, three: bool, source_files: tuple[str, ...]
) -> None:
    state = "FMUState" if three else "FMUstate"
    common = {
        "modelIdentifier": compiled.identifier,
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
    }
    if three:
        common |= {"providesDirectionalDerivatives": "true", "providesAdjointDerivatives": "true"}
    else:
        common |= {
            "canNotUseMemoryManagementFunctions": "true",
            "providesDirectionalDerivative": "true",
        }
    step = {"canHandleVariableCommunicationStepSize": "true"}
    if three:
        step |= {"canReturnEarlyAfterIntermediateUpdate": "false", "hasEventMode": "false"}
        step |= {"providesIntermediateUpdate": "false", "maxOutputDerivativeOrder": "0"}
        exchange = {
            "needsCompletedIntegratorStep": "true",
            "providesEvaluateDiscreteStates": "false",
        }
    else:
        step |= {
            "canInterpolateInputs": "false",
            "maxOutputDerivativeOrder": "0",
            "canRunAsynchronuously": "false",
        }
        exchange = {"completedIntegratorStepNotNeeded": "false"}
    for tag, extra in (("ModelExchange", exchange), ("CoSimulation", step)):
        element = ElementTree.SubElement(root, tag, common | extra)
        if not three and source_files:
            files = ElementTree.SubElement(element, "SourceFiles")
            for name in source_files:
                ElementTree.SubElement(files, "File", name=name)


def _units(root: Element, compiled: CompiledModel) -> None:
    names = sorted({v.unit for v in compiled.variables if v.unit and v.type == "Real"})
    if not names:
        return
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for name in names:
        element = ElementTree.SubElement(definitions, "Unit", name=name)
        unit = base_unit(name)
        if unit is None:
            continue
        base = ElementTree.SubElement(element, "BaseUnit")
        for symbol, exponent in zip(BASE, unit.exponents, strict=True):
            if exponent:
                base.set(symbol, str(exponent))
        if unit.factor != 1.0:
            base.set("factor", _number(unit.factor))
        if unit.offset != 0.0:
            base.set("offset", _number(unit.offset))


def _types(root: Element, compiled: CompiledModel, three: bool) -> None:
    if not compiled.enumerations:
        return
    definitions = ElementTree.SubElement(root, "TypeDefinitions")
    for name, literals in sorted(compiled.enumerations.items()):
        if three:
            element = ElementTree.SubElement(definitions, "EnumerationType", name=name)
        else:
            simple = ElementTree.SubElement(definitions, "SimpleType", name=name)
            element = ElementTree.SubElement(simple, "Enumeration")
        for value, (literal, text) in enumerate(literals, start=1):
            item = ElementTree.SubElement(element, "Item", name=literal, value=str(value))
            if text:
                item.set("description", text)


# ---- variables ----


def _common(variable: Variable) -> dict[str, str]:
    attributes: dict[str, str] = {
        "causality": variable.causality,
        "variability": variable.variability,
    }
    if variable.initial and variable.causality not in ("input", "independent"):
        attributes["initial"] = variable.initial
    if variable.description:
        attributes["description"] = variable.description
    return attributes


def _typed(compiled: CompiledModel, variable: Variable) -> dict[str, str]:
    attributes: dict[str, str] = {}
    if variable.type == "Enumeration":
        if variable.enumeration is None:
            raise ValueError(f"{variable.name} is an enumeration without a type")
        attributes["declaredType"] = variable.enumeration
    if variable.type == "Real" and variable.unit:
        attributes["unit"] = variable.unit
    if variable.type != "Boolean":
        for key, value in (("min", variable.min), ("max", variable.max)):
            if value is not None and math.isfinite(value):
                attributes[key] = _literal(variable, value)
    if variable.type == "Real" and variable.nominal is not None:
        attributes["nominal"] = _number(variable.nominal)
    if (
        variable.start is not None
        and variable.initial != "calculated"
        and variable.causality != "independent"
    ):
        attributes["start"] = _literal(variable, variable.start)
    if variable.kind == "state" and compiled.n_indicators:
        attributes["reinit"] = "true"  # an event may set it; which state it sets is not known here
    return attributes


def _variable_2(
    parent: Element, compiled: CompiledModel, reference: int, variable: Variable
) -> None:
    scalar = ElementTree.SubElement(
        parent, "ScalarVariable", name=variable.name, valueReference=str(reference)
    )
    scalar.attrib.update(_common(variable))
    typed = ElementTree.SubElement(scalar, variable.type, _typed(compiled, variable))
    if variable.derivative_of is not None:
        typed.set("derivative", str(variable.derivative_of + 1))


def _variable_3(
    parent: Element, compiled: CompiledModel, reference: int, variable: Variable
) -> None:
    element = ElementTree.SubElement(
        parent, _FMI3_TYPES[variable.type], name=variable.name, valueReference=str(reference)
    )
    element.attrib.update(_common(variable) | _typed(compiled, variable))
    if variable.derivative_of is not None:
        element.set("derivative", str(variable.derivative_of))


def _indicator_variables(parent: Element, compiled: CompiledModel) -> None:
    taken = {v.name for v in compiled.variables}
    stem = "eventIndicator"
    while any(name.startswith(f"{stem}[") for name in taken):
        stem += "_"
    for index in range(compiled.n_indicators):
        element = ElementTree.SubElement(parent, "Float64", name=f"{stem}[{index + 1}]")
        element.set("valueReference", str(indicator_reference(compiled, index)))
        element.attrib.update(
            {"causality": "local", "variability": "continuous", "initial": "calculated"}
        )


# ---- model structure ----


def _initial_unknowns(compiled: CompiledModel) -> list[int]:
    """Outputs, calculated parameters, states and derivatives that initialisation computes, in
    ascending order.
    """
    dynamic = {*compiled.states, *compiled.derivatives}
    return [
        reference
        for reference, v in enumerate(compiled.variables)
        if v.causality == "calculatedParameter"
        or (
            (v.causality == "output" or reference in dynamic)
            and v.initial in ("approx", "calculated")
        )
    ]


def _dependencies(known: tuple[int, ...], shift: int) -> dict[str, str]:
    return {"dependencies": " ".join(str(reference + shift) for reference in sorted(known))}


def _unknowns(compiled: CompiledModel) -> dict[str, list[tuple[int, tuple[int, ...]]]]:
    """(unknown, knowns it depends on) by kind; all knowns where the compiler does not say: some
    importers want a list.
    """
    variables = compiled.variables
    inputs = {reference for reference, v in enumerate(variables) if v.causality == "input"}
    running = tuple(sorted(inputs | set(compiled.states)))
    exact = {
        reference
        for reference, v in enumerate(variables)
        if v.initial == "exact" and v.variability != "constant"
    }
    initial = tuple(sorted(inputs | exact))
    return {
        "outputs": [(u, compiled.dependencies.get(u, running)) for u in compiled.outputs],
        "derivatives": [(u, compiled.dependencies.get(u, running)) for u in compiled.derivatives],
        "initial": [
            (u, compiled.initial_unknowns.get(u, initial)) for u in _initial_unknowns(compiled)
        ],
        "indicators": [
            (indicator_reference(compiled, i), running) for i in range(compiled.n_indicators)
        ],
    }


def _structure_2(root: Element, compiled: CompiledModel) -> None:
    structure = ElementTree.SubElement(root, "ModelStructure")
    tags = {"outputs": "Outputs", "derivatives": "Derivatives", "initial": "InitialUnknowns"}
    unknowns = _unknowns(compiled)
    for kind, tag in tags.items():
        if unknowns[kind]:
            group = ElementTree.SubElement(structure, tag)
            for unknown, known in unknowns[kind]:
                ElementTree.SubElement(
                    group, "Unknown", {"index": str(unknown + 1)} | _dependencies(known, 1)
                )


def _structure_3(root: Element, compiled: CompiledModel) -> None:
    structure = ElementTree.SubElement(root, "ModelStructure")
    tags = {
        "outputs": "Output",
        "derivatives": "ContinuousStateDerivative",
        "initial": "InitialUnknown",
        "indicators": "EventIndicator",
    }
    unknowns = _unknowns(compiled)
    for kind, tag in tags.items():
        for unknown, known in unknowns[kind]:
            ElementTree.SubElement(
                structure, tag, {"valueReference": str(unknown)} | _dependencies(known, 0)
            )
