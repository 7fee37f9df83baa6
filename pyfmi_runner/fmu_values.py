"""Variables of an FMU instance by name: checked, converted, and read or written with one call for
all of a type.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from ctypes import Array, c_uint
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pyfmi_runner.fmu_calls import Fmi2, Fmi3, FmuCallError
from pyfmi_runner.fmu_file import FmuFile, FmuVariable

Value = float | int | bool | str  # str: a literal of an enumeration


class _Group(NamedTuple):
    """Variables of one type out of a list of names."""

    word: str
    references: Array[c_uint]
    values: Array[Any]
    positions: list[int]
    all_real: bool  # the group is the whole list and real: any numbers go through


class Values:
    """What the FMU refuses comes back as InputError if the value is to blame, else as the
    FmuCallError.
    """

    def __init__(self, file: FmuFile, fmu: Fmi2 | Fmi3) -> None:
        self.file, self.fmu = file, fmu
        self._groups: dict[tuple[str, ...], list[_Group]] = {}
        self._running: set[tuple[str, ...]] = set()

    def read_one(self, name: str) -> float:
        """float, or int or bool as the variable's type is."""
        (group,) = self.grouped((name,))
        self.fmu.get_values(group.word, group.references, 1, group.values)
        return bool(group.values[0]) if group.word == "Boolean" else group.values[0]

    def read(self, names: tuple[str, ...]) -> NDArray[np.float64]:
        result = np.empty(len(names))
        for group in self.grouped(names):
            self.fmu.get_values(group.word, group.references, len(group.positions), group.values)
            result[group.positions] = group.values
        return result

    def write(self, names: tuple[str, ...], values: Sequence[Value]) -> None:
        if len(values) != len(names):
            raise self._fault(f"{len(values)} values for {len(names)} variables", ", ".join(names))
        for group in self.grouped(names):
            self._fill(group, names, values)
            try:
                self.fmu.set_values(
                    group.word, group.references, len(group.positions), group.values
                )
            except FmuCallError as failure:
                fault = self._blame(names, values, failure)
                if fault is None:
                    raise
                raise fault from failure

    def check_start(self, names: Iterable[str]) -> None:
        for name in names:
            variable = self.variable(name)
            if not variable.settable_before_start:
                raise self._fault(
                    f"a variable of causality {variable.causality} cannot be set", name, "remove it"
                )

    def check_running(self, names: tuple[str, ...]) -> None:
        """Refuses what no phase after the start lets be set, before the FMU sees it and fails."""
        if names in self._running:
            return
        for name in names:
            variable = self.variable(name)
            tunable = variable.causality == "parameter" and variable.variability == "tunable"
            if (
                variable.causality != "input"
                and not tunable
                and name not in self.file.description.states
            ):
                at_start = f"give it to reset(parameters={{{name!r}: ...}})"
                hint = at_start if variable.settable_before_start else "remove it"
                raise self._fault("cannot be set while the FMU runs", name, hint)
        self._running.add(names)

    def variable(self, name: str) -> FmuVariable:
        variable = self.file.variables.get(name)
        if variable is not None:
            return variable
        lowered = {known.lower(): known for known in self.file.variables}
        near = [
            lowered[match]
            for match in difflib.get_close_matches(str(name).lower(), lowered, n=3, cutoff=0.5)
        ]
        hint = (
            f"did you mean {', '.join(near)}?"
            if near
            else "see the variables in modelDescription.xml"
        )
        raise self._fault("no such variable", str(name), hint)

    def _fault(self, message: str, name: str, hint: str | None = None) -> InputError:
        return InputError(message, file=self.file.path, field=name, hint=hint)

    def grouped(self, names: tuple[str, ...]) -> list[_Group]:
        """Names by type."""
        groups = self._groups.get(names)
        if groups is not None:
            return groups
        positions: dict[tuple[str, Any], list[int]] = {}
        variables = [self.variable(name) for name in names]
        for position, variable in enumerate(variables):
            accessor = self.fmu.getters.get(variable.type)
            if accessor is None:
                raise self._fault(
                    f"variables of type {variable.type} are not supported", variable.name
                )
            positions.setdefault(accessor, []).append(position)
        all_real = all(variable.is_real for variable in variables) and len(positions) == 1
        groups = [
            _Group(
                word,
                (c_uint * len(at))(*(variables[i].reference for i in at)),
                (ctype * len(at))(),
                at,
                all_real,
            )
            for (word, ctype), at in positions.items()
        ]
        self._groups[names] = groups
        return groups

    def _fill(self, group: _Group, names: tuple[str, ...], values: Sequence[Value]) -> None:
        if group.all_real:
            try:
                group.values[:] = values  # type: ignore[call-overload]  # any sequence of numbers does
                return
            except TypeError:
                pass  # the slow way names the variable
        for k, position in enumerate(group.positions):
            group.values[k] = self._converted(names[position], values[position])

    def _converted(self, name: str, value: Value) -> float | int | bool:
        variable = self.file.variables[name]
        try:
            if variable.is_real:
                return float(value)
            if isinstance(value, str):
                return variable.literals[value]
            if int(value) == value and (variable.type != "Boolean" or value in (0, 1)):
                return int(value)
        except (TypeError, ValueError, KeyError, OverflowError):
            pass
        hint = f"use one of {', '.join(variable.literals)}" if variable.literals else None
        raise self._fault(f"{value!r} is no value of type {variable.type}", name, hint)

    def _blame(
        self, names: tuple[str, ...], values: Sequence[Value], failure: FmuCallError
    ) -> InputError | None:
        for name, value in zip(names, values, strict=True):
            v, number = self.file.variables[name], self._converted(name, value)
            if not v.min <= number <= v.max or not math.isfinite(number):
                unit = f" {v.unit}" if v.unit else ""
                return self._fault(
                    failure.text, name, f"choose a finite value within {v.min:g}..{v.max:g}{unit}"
                )
        return self._fault(failure.text, ", ".join(names)) if failure.status == 2 else None
