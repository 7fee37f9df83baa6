"""The catalogue of effects: data, one small TOML file per effect. A user adds an effect by adding a
file.

    name = "motor_delay"
    block = "motor_{axis}"          where it sits
    axes = ["a", "b"]               one effect for each; without them "{axis}" stands nowhere
    refines = ["motor_lag"]         optional: effects without which it is nothing
    [[form]]                        one or several functional forms; the best one stands for it
    [form.settings]
    "drive_{axis}.law" = 3          switched on with the form
    [form.parameters."motor_{axis}.delay_time"]   what is fitted: a parameter of the model, or
                                    "sensors.SIGNAL.WHAT" (see `sensors`), or "inputs.INPUT.WHAT"
                                    (see `commands`); "table[1:11]" stands for eleven

A parameter has: neutral = 0.0 (value without the effect; relative = true: the nominal value, which
is not 0), scale (a usual size), low, high, unit, starts = [..] (further starting values), positive
= true (fitted as its logarithm: neutral or nominal value > 0; a usual size off is a factor of
exp(scale/neutral)), step = 0.001 (values so far apart are optima of their own, as of a delay that a
sampled controller sees in whole periods).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.engine.signals.commands import outside
from pyfmi_runner.scenario import Fields, parse_toml

__all__ = ["Effect", "Form", "Parameter", "catalogue_files", "check_nominal", "read_catalogue"]

EFFECT_KEYS = ("name", "block", "axes", "summary", "refines", "form")
FORM_KEYS = ("name", "parameters", "settings")
PARAMETER_KEYS = (
    "neutral",
    "scale",
    "low",
    "high",
    "unit",
    "relative",
    "positive",
    "starts",
    "step",
)


@dataclass(frozen=True)
class Parameter:
    """One fitted quantity of an effect. A relative one has the nominal value as its neutral, its
    scale and bounds as shares of it.
    """

    name: str
    neutral: float
    scale: float
    low: float
    high: float
    unit: str = "1"
    relative: bool = False
    positive: bool = False  # fitted as its logarithm
    starts: tuple[float, ...] = ()
    step: float = 0.0  # between optima that lie side by side; 0: there are none


@dataclass(frozen=True)
class Form:
    """One functional form of an effect."""

    name: str
    parameters: tuple[Parameter, ...]
    settings: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Effect:
    """An effect on one axis (or on none), with the forms that may serve it."""

    name: str
    axis: str  # or ""
    block: str  # where it sits
    summary: str
    forms: tuple[Form, ...]
    refines: tuple[str, ...] = ()  # names of the effects without which it is nothing
    epoch: str = ""  # the campaign that alone has it, where there are two
    general: bool = False  # it says what one of the catalogue may say closer, and gives way to it

    @property
    def key(self) -> str:
        """name/axis, or the name alone; "@" and the campaign where it is of one alone."""
        name = f"{self.name}/{self.axis}" if self.axis else self.name
        return f"{name}@{self.epoch}" if self.epoch else name

    @property
    def outside(self) -> bool:
        """Whether all of its parameters are of sensors and inputs, in every form."""
        return all(outside(p.name) for f in self.forms for p in f.parameters)


def catalogue_files(source: Path) -> list[Path]:
    """The files of a catalogue: itself, or those in its folder."""
    return sorted(source.glob("*.toml")) if source.is_dir() else [source]


def read_catalogue(source: Path) -> dict[str, Effect]:
    """Effects by key from a TOML file, of one effect or of [[effect]] tables, or from a folder of
    such files.

    Raises InputError naming file, field and hint.
    """
    effects: dict[str, Effect] = {}
    for path in catalogue_files(source):
        tables = parse_toml(path)
        effects.update(_effects(path, tables.get("effect", [tables])))
    if not effects:
        raise InputError("holds no effect", file=source, hint="add one TOML file per effect")
    return effects


def check_nominal(p: Parameter, nominal: float, where: str, file: Path | None = None) -> None:
    """Refuses a relative parameter whose nominal value has no shares, or no logarithm. where: the
    effect's name.
    """
    if not p.relative or nominal > 0.0 or (nominal < 0.0 and not p.positive):
        return
    wrong, instead = "relative", "give neutral, scale, low and high in the parameter's unit"
    if nominal < 0.0:
        wrong, instead = "relative and positive", "take positive out"
    message = f"is {wrong}, but {nominal:g} is what the plant has without the effect"
    raise InputError(message, file=file, field=f"{where}: {p.name}", hint=instead)


def _effects(path: Path, tables: object) -> dict[str, Effect]:
    if not isinstance(tables, list):
        raise InputError(
            f"is {tables!r}, expected tables", file=path, field="effect", hint="write [[effect]]"
        )
    found = {}
    for table in tables:
        fields = Fields(table, EFFECT_KEYS, path)
        name, block = _given(fields, "name", str), _given(fields, "block", str)
        forms, axes = _given(fields, "form", list), _texts(fields, "axes") or ("",)
        summary, refines = fields.of_type("summary", str, ""), _texts(fields, "refines")
        for axis in axes:
            at, made = block.replace("{axis}", axis), tuple(_form(path, f, axis) for f in forms)
            effect = Effect(name, axis, at, summary, made, refines)
            found[effect.key] = effect
    return found


def _given(fields: Fields, key: str, kind: type) -> Any:
    """What must be there and not be empty."""
    if key not in fields:
        fields.refuse(key, "is missing", f"write {key} = ...")
    return fields.of_type(key, kind, None) or fields.refuse(key, "is empty", f"write {key} = ...")


def _texts(fields: Fields, key: str) -> tuple[str, ...]:
    texts = fields.of_type(key, list, [])
    if not all(isinstance(text, str) for text in texts):
        fields.refuse(key, f"is {texts!r}, expected texts", 'write for example ["x", "z"]')
    return tuple(texts)


def _members(name: str) -> list[str]:
    """A parameter's name, or those that a range of indices stands for."""
    span = re.fullmatch(r"(.*)\[(\d{1,3}):(\d{1,3})\]", name)
    return [f"{span[1]}[{i}]" for i in range(int(span[2]), int(span[3]) + 1)] if span else [name]


def _form(path: Path, table: object, axis: str) -> Form:
    fields = Fields(table, FORM_KEYS, path, "form.")
    parameters = [
        replace(parameter, name=member)
        for parameter in (
            _parameter(fields, name)
            for name in fields.sub("parameters", fields.table.get("parameters", {})).table
        )
        for member in _members(parameter.name.replace("{axis}", axis))
    ]
    if not parameters:
        raise InputError(
            "has no parameters", file=path, field="form", hint="name at least one parameter to fit"
        )
    settings = {
        name.replace("{axis}", axis): value for name, value in fields.numbers("settings").items()
    }
    return Form(fields.of_type("name", str, "form"), tuple(parameters), settings)


def _parameter(form: Fields, name: str) -> Parameter:
    fields = Fields(form.table["parameters"][name], PARAMETER_KEYS, form.file, f"{name}.")
    scale, low, high = (fields.number(key) for key in ("scale", "low", "high"))
    for key, value in (("scale", scale), ("low", low), ("high", high)):
        if value is None:
            fields.refuse(key, "must be a number", f"write {key} = 0.1")
    relative, positive = (fields.of_type(key, bool, False) for key in ("relative", "positive"))
    if not low < high or scale <= 0.0 or (positive and low <= 0.0):
        fields.refuse(
            "low",
            f"is {low:g}, high {high:g}, scale {scale:g}",
            "let low < high and scale > 0; positive needs low > 0",
        )
    starts = fields.of_type("starts", list, [])
    for start in starts:
        Fields({"starts": start}, ("starts",), form.file, f"{name}.").number("starts")
    neutral, unit = fields.number("neutral", 0.0), fields.of_type("unit", str, "1")
    if positive and not relative and neutral <= 0.0:
        hint = "write neutral > 0 (the value without the effect), or take positive out"
        fields.refuse("neutral", f"is {neutral:g}, and the parameter positive", hint)
    none = 1.0 if relative else neutral
    if not low <= none <= high:
        hint = f"let low <= {none:g} <= high, so that there may be no effect"
        fields.refuse("low", f"is {low:g}, high {high:g}, and {none:g} is no effect", hint)
    return Parameter(
        name,
        neutral,
        scale,
        low,
        high,
        unit,
        relative,
        positive,
        tuple(map(float, starts)),
        _step(fields, positive or relative),
    )


def _step(fields: Fields, logarithmic: bool) -> float:
    step = float(fields.number("step", 0.0) or 0.0)
    if step < 0.0 or (step and logarithmic):
        fields.refuse(
            "step",
            f"is {step:g}",
            "write step > 0; a parameter that is positive or relative has none",
        )
    return step
