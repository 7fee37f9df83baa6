"""What the compiler hands to the FMU packager: variables, structure and C sources of one model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

Kind = Literal[
    "time", "parameter", "calculated", "input", "state", "derivative", "algebraic", "discrete"
]
BaseType = Literal["Real", "Integer", "Boolean", "Enumeration"]


@dataclass(frozen=True)
class Variable:
    """One FMI variable; its value reference is its position in `CompiledModel.variables`."""

    name: str
    kind: Kind
    type: BaseType
    causality: Literal[
        "parameter", "calculatedParameter", "input", "output", "local", "independent"
    ]
    variability: Literal["constant", "fixed", "tunable", "discrete", "continuous"]
    initial: Literal["exact", "approx", "calculated"] | None  # None where FMI forbids the attribute
    index: int  # into the array of its kind
    start: float | None = None  # as FMI wants it: None where `initial` is "calculated"
    unit: str | None = None
    description: str | None = None
    min: float | None = None
    max: float | None = None
    nominal: float | None = None
    enumeration: str | None = None  # key of CompiledModel.enumerations
    derivative_of: int | None = None  # value reference of the state, for kind "derivative"


TIME = Variable(
    "time",
    "time",
    "Real",
    "independent",
    "continuous",
    None,
    0,
    unit="s",
    description="Simulation time",
)


@dataclass(frozen=True)
class CompiledModel:
    """A model ready for packaging.

    All references are value references (positions in `variables`).
    """

    name: str  # Modelica class, "Drive.Motor"
    identifier: str  # C and file name, "Drive_Motor"
    description: str
    variables: tuple[Variable, ...]
    states: tuple[int, ...]
    derivatives: tuple[int, ...]  # same order as `states`
    outputs: tuple[int, ...]
    dependencies: dict[
        int, tuple[int, ...]
    ]  # unknown (derivative, output) -> knowns it depends on (states, inputs)
    initial_unknowns: dict[int, tuple[int, ...]]  # unknown -> knowns at initialisation
    n_indicators: int
    enumerations: dict[
        str, tuple[tuple[str, str], ...]
    ]  # type -> ((literal, description), ...), values 1, 2, ...
    sources: dict[str, str]  # generated C: file name -> text ("model.h", "model.c")
    default_step: float = 1e-3  # s
    default_stop: float = 1.0  # s
    tool: str = "modelica_fmu"  # that made it
    notes: tuple[str, ...] = field(default=())
    switching: tuple[str, ...] = ()  # states whose rate changes its form at events
    about: dict[str, str] = field(default_factory=dict)  # version, author, license, copyright, date
    files: tuple[Path, ...] = ()  # Modelica files that were read


@dataclass(frozen=True)
class Structure:
    """How variables hang together.

    roots: variable -> the variable that it is another name of (itself if of none).
    states: roots that are states. rates: state -> root that its derivative is, if it is just one.
    numbers: variables of type Real. units: of those that declare one.
    """

    roots: Mapping[str, str]
    states: frozenset[str]
    rates: Mapping[str, str]
    numbers: frozenset[str]
    units: Mapping[str, str]
