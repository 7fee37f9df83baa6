"""modelDescription.xml of FMI 2.0 and 3.0 as plain data. No entity is expanded, nothing outside the
text is loaded.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from lxml import etree

from modelica_fmu.errors import InputError

_FIELD = "modelDescription.xml"
_HINT = "build the FMU again"
_RUNNING = ("Output", "ContinuousStateDerivative")  # of FMI 3.0's model structure
_REAL = frozenset({"Real", "Float64", "Float32"})


@dataclass(frozen=True)
class FmuVariable:
    """One variable; `type` as in the description (Real, Integer, ... or Float64, Int32, ...).
    Bounds are included.
    """

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    initial: str | None
    start: float | None = None
    unit: str | None = None
    min: float = -math.inf
    max: float = math.inf
    nominal: float | None = None
    description: str = ""
    literals: Mapping[str, int] = field(default_factory=dict)  # of an enumeration: name -> value

    @property
    def is_real(self) -> bool:
        return self.type in _REAL

    @property
    def settable_before_start(self) -> bool:
        if self.variability == "constant" or self.causality == "independent":
            return False
        return self.causality in ("parameter", "input") or self.initial in ("exact", "approx")


@dataclass(frozen=True)
class Description:
    """states, derivatives, outputs: variable names in the order of the FMU's vectors; identifiers:
    by "cs" and "me".
    """

    fmi: Literal["2.0", "3.0"]
    model: str
    token: str
    identifiers: Mapping[str, str]
    capabilities: Mapping[
        str, frozenset[str]
    ]  # by "cs" and "me": the flags that are true, FMI 2.0 names
    log_categories: tuple[str, ...]
    variables: dict[str, FmuVariable]
    states: tuple[str, ...]
    derivatives: tuple[str, ...]
    outputs: tuple[str, ...]
    n_indicators: int
    default_step: float | None
    default_stop: float | None
    # variables (unknown -> known) while it runs and as it is initialised; None: it does not say
    depends: Mapping[str, tuple[str, ...] | None] = field(default_factory=dict)
    depends_first: Mapping[str, tuple[str, ...] | None] = field(default_factory=dict)


def parse_description(text: bytes, file: Path) -> Description:
    """InputError names `file`, the element and what to do."""
    return _Reader(_root(text, file), file).description()


def _root(text: bytes, file: Path) -> Any:
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True
    )
    try:
        root = etree.fromstring(text, parser)
    except etree.XMLSyntaxError as error:
        raise InputError(
            f"not well-formed XML ({error})", file=file, field=_FIELD, hint=_HINT
        ) from None
    if getattr(root.getroottree().docinfo, "doctype", ""):
        what = "a document type declaration is refused"
        raise InputError(what, file=file, field=_FIELD, hint="remove the DOCTYPE")
    return root


@dataclass(frozen=True)
class _Reader:
    root: Any
    file: Path

    def fail(self, message: str, field_name: str = _FIELD) -> InputError:
        return InputError(message, file=self.file, field=field_name, hint=_HINT)

    def required(self, element: Any, name: str) -> str:
        value = element.get(name)
        if value is None:
            raise self.fail(
                f"line {element.sourceline}: <{element.tag}> lacks the attribute {name}"
            )
        return str(value)

    def number(self, element: Any, name: str) -> float | None:
        text = element.get(name)
        if text is None:
            return None
        if text in ("true", "false"):
            return float(text == "true")
        try:
            return float(text)
        except ValueError:
            raise self.fail(
                f"line {element.sourceline}: {name}={text!r} is no number", _owner(element)
            ) from None

    def integer(self, element: Any, name: str) -> int:
        text = self.required(element, name)
        if not text.strip().isascii() or not text.strip().isdigit():
            raise self.fail(
                f"line {element.sourceline}: {name}={text!r} is no reference", _owner(element)
            )
        return int(text)

    def description(self) -> Description:
        version = self.root.get("fmiVersion") or ""
        if self.root.tag != "fmiModelDescription":
            raise self.fail(f"the root element is <{self.root.tag}>, not <fmiModelDescription>")
        if version != "2.0" and not version.startswith("3."):
            raise self.fail(
                f"FMI version {version!r} is not supported; use an FMU of FMI 2.0 or 3.0",
                "fmiVersion",
            )
        fmi: Literal["2.0", "3.0"] = "2.0" if version == "2.0" else "3.0"
        listed = self.variables_2() if fmi == "2.0" else self.variables_3()
        derivatives = self.structure(fmi, "Derivatives", "ContinuousStateDerivative", listed)
        interfaces = {"cs": self.root.find("CoSimulation"), "me": self.root.find("ModelExchange")}
        experiment = self.root.find("DefaultExperiment")
        return Description(
            fmi=fmi,
            model=self.required(self.root, "modelName"),
            token=self.required(self.root, "guid" if fmi == "2.0" else "instantiationToken"),
            identifiers={k: self.identifier(e) for k, e in interfaces.items() if e is not None},
            capabilities={k: _capabilities(e) for k, e in interfaces.items() if e is not None},
            log_categories=tuple(
                self.required(e, "name") for e in self.root.findall("LogCategories/Category")
            ),
            variables=self.by_name(listed),
            states=tuple(self.state_of(fmi, d, listed) for d in derivatives),
            derivatives=tuple(listed[d][0].name for d in derivatives),
            outputs=tuple(
                listed[o][0].name for o in self.structure(fmi, "Outputs", "Output", listed)
            ),
            n_indicators=self.indicators(fmi),
            default_step=None if experiment is None else self.number(experiment, "stepSize"),
            default_stop=None if experiment is None else self.number(experiment, "stopTime"),
            depends=self.depends(fmi, ("Outputs", "Derivatives"), _RUNNING, listed),
            depends_first=self.depends(fmi, ("InitialUnknowns",), ("InitialUnknown",), listed),
        )

    def depends(
        self,
        fmi: str,
        two: tuple[str, ...],
        three: tuple[str, ...],
        listed: Mapping[int, tuple[FmuVariable, Any]],
    ) -> dict[str, tuple[str, ...] | None]:
        """Variables that the unknowns of some parts of the model structure depend on."""
        old = fmi == "2.0"
        paths = [f"{p}/Unknown" for p in two] if old else list(three)
        found: dict[str, tuple[str, ...] | None] = {}
        for element in (e for p in paths for e in self.root.findall(f"ModelStructure/{p}")):
            unknown = listed.get(self.integer(element, "index" if old else "valueReference"))
            known = element.get("dependencies")
            if unknown is None:
                continue
            numbers = [int(k) for k in (known or "").split() if k.isascii() and k.isdigit()]
            told = known is not None and all(k in listed for k in numbers)
            found[unknown[0].name] = tuple(listed[k][0].name for k in numbers) if told else None
        return found

    def identifier(self, element: Any) -> str:
        """Used as a file name: no path may hide in it."""
        name = self.required(element, "modelIdentifier")
        if not name.isidentifier():
            raise self.fail(f"{name!r} is no C identifier", "modelIdentifier")
        return name

    def indicators(self, fmi: str) -> int:
        if fmi == "3.0":
            return len(self.root.findall("ModelStructure/EventIndicator"))
        return (
            self.integer(self.root, "numberOfEventIndicators")
            if self.root.get("numberOfEventIndicators")
            else 0
        )

    # `listed`: what the model structure refers to (position from 1, or value reference) ->
    # variable, its typed element

    def variables_2(self) -> dict[int, tuple[FmuVariable, Any]]:
        types = {
            e.get("name"): e[0] for e in self.root.findall("TypeDefinitions/SimpleType") if len(e)
        }
        listed = {}
        for index, scalar in enumerate(self.root.findall("ModelVariables/ScalarVariable"), start=1):
            typed = next(
                (
                    e
                    for e in scalar
                    if e.tag in ("Real", "Integer", "Boolean", "String", "Enumeration")
                ),
                None,
            )
            if typed is None:
                raise self.fail(
                    f"line {scalar.sourceline}: a variable without a type", str(scalar.get("name"))
                )
            listed[index] = (self.variable(scalar, typed, types), typed)
        return listed

    def variables_3(self) -> dict[int, tuple[FmuVariable, Any]]:
        types = {e.get("name"): e for e in self.root.findall("TypeDefinitions/*")}
        elements = [e for e in self.root.findall("ModelVariables/*") if e.find("Dimension") is None]
        return {
            self.integer(e, "valueReference"): (self.variable(e, e, types), e) for e in elements
        }

    def variable(self, element: Any, typed: Any, types: Mapping[str, Any]) -> FmuVariable:
        declared = types.get(typed.get("declaredType"))
        both = [typed] if declared is None else [typed, declared]
        low, high = (
            next((v for e in both if (v := self.number(e, key)) is not None), None)
            for key in ("min", "max")
        )
        causality = element.get("causality", "local")
        default = (
            "fixed"
            if causality in ("parameter", "calculatedParameter", "structuralParameter")
            else None
        )
        items = [] if declared is None else declared.findall("Item")
        return FmuVariable(
            name=self.required(element, "name"),
            reference=self.integer(element, "valueReference"),
            type=typed.tag,
            causality=causality,
            variability=element.get("variability")
            or default
            or ("continuous" if typed.tag in _REAL else "discrete"),
            initial=element.get("initial")
            or ("exact" if causality in ("parameter", "input") else None),
            start=None if typed.tag in ("String", "Binary") else self.number(typed, "start"),
            unit=next((e.get("unit") for e in both if e.get("unit")), None),
            min=-math.inf if low is None else low,
            max=math.inf if high is None else high,
            nominal=self.number(typed, "nominal"),
            description=element.get("description", ""),
            literals={self.required(i, "name"): int(self.number(i, "value") or 0) for i in items},
        )

    def by_name(self, listed: Mapping[int, tuple[FmuVariable, Any]]) -> dict[str, FmuVariable]:
        variables = {variable.name: variable for variable, _ in listed.values()}
        if len(variables) != len(listed):
            raise self.fail("two variables have the same name", "ModelVariables")
        return variables

    def structure(self, fmi: str, two: str, three: str, listed: Mapping[int, Any]) -> list[int]:
        path = f"ModelStructure/{two}/Unknown" if fmi == "2.0" else f"ModelStructure/{three}"
        found = [
            self.integer(e, "index" if fmi == "2.0" else "valueReference")
            for e in self.root.findall(path)
        ]
        for reference in found:
            if reference not in listed:
                raise self.fail(
                    f"{two} refer to variable {reference}, which does not exist", "ModelStructure"
                )
        return found

    def state_of(
        self, fmi: str, derivative: int, listed: Mapping[int, tuple[FmuVariable, Any]]
    ) -> str:
        variable, typed = listed[derivative]
        state = self.integer(typed, "derivative")
        if state not in listed:
            raise self.fail(f"the state of {variable.name} does not exist", variable.name)
        return listed[state][0].name


def _owner(element: Any) -> str:
    """The name of the nearest element that has one."""
    named = next((e for e in (element, *element.iterancestors()) if e.get("name")), None)
    return _FIELD if named is None else str(named.get("name"))


def _capabilities(element: Any) -> frozenset[str]:
    renamed = {
        "canGetAndSetFMUState": "canGetAndSetFMUstate",
        "canSerializeFMUState": "canSerializeFMUstate",
        "providesDirectionalDerivatives": "providesDirectionalDerivative",
    }
    return frozenset(
        renamed.get(name, name) for name, value in element.attrib.items() if value in ("true", "1")
    )
