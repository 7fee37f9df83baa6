"""A scenario: all that one closed-loop run needs to be run again bit for bit. Read from and written
to TOML.
"""

from __future__ import annotations

import difflib
import json
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from modelica_fmu.errors import InputError
from modelica_fmu.files import check_source
from pyfmi_runner.log import MEASURED, PHASES, STROKE_X, STROKE_Z
from pyfmi_runner.sensors import SensorParams, check_sensors, converter_steps
from pyfmi_runner.timing import LoopTiming
from pyfmi_runner.workpiece import check_workpiece, default_standoff

__all__ = [
    "Fields",
    "Phases",
    "Scenario",
    "clamp_windows",
    "parse_toml",
    "read_scenario",
    "scenario_from",
    "scenario_text",
    "short_phases",
    "thesis_phases",
    "to_toml",
    "toml_key",
]

T = TypeVar("T")
Phases = dict[
    str, tuple[float, float]
]  # name -> start and end [s], in the order in which they happen
MOST_SAMPLES = 5_000_000  # of a run, 1 GB
CONTOUR_LENGTH = {"incline_16": 4.5, "incline_30": 2.4}  # s, where the z stroke ends it; else 9 s


def short_phases(workpiece: str) -> Phases:
    """Phases of the campaigns' runs: approach 3 s, contact 4 s, contour 9 s or what the z stroke
    allows.
    """
    return {
        "approach": (0.0, 3.0),
        "contact": (3.0, 7.0),
        "contour": (7.0, 7.0 + CONTOUR_LENGTH.get(workpiece, 9.0)),
    }


def thesis_phases(workpiece: str) -> Phases:
    """Phases of the thesis' runs, 45 s: contour from 22 s for 10 s or what the z stroke allows,
    then retreat.

    The change from approach to contact is not printed; 10 s is ours.
    """
    end = 22.0 + CONTOUR_LENGTH.get(workpiece, 10.0)
    return {
        "approach": (0.0, 10.0),
        "contact": (10.0, 22.0),
        "contour": (22.0, end),
        "retreat": (end, 45.0),
    }


PRESETS = {"short": short_phases, "thesis": thesis_phases}


@dataclass(frozen=True)
class Scenario:
    """One run. Defaults: the curved edge, as in the campaigns. Raises InputError for a value out of
    range.
    """

    name: str = "run"
    workpiece: str = "curved"  # a name of workpiece.WORKPIECES or the path of a CSV of x, z_w
    standoff: float | None = None  # m, z_0; None: the workpiece's own
    surface_finish: bool = False
    start_x: float = 0.95  # m
    start_z: float = 0.0  # m
    f_nd: float = 30.0  # N, > 0 presses into the workpiece
    v_td: float = -0.06  # m/s, < 0 tracks towards -x
    controller: str = "pi_fv"
    gains: str | dict[str, float] | None = (
        None  # a gain table's name, or gains by name; None: the controller's own
    )
    phases: Phases = field(default_factory=dict)  # empty: short_phases(workpiece)
    approach_u_x: float = 0.0  # V, open loop until the contact phase starts
    approach_u_z: float = 1.05  # V
    retreat_f_az: float = (
        -40.0
    )  # N, actuator force aimed at in the retreat, < 0 pulls off the workpiece
    clamped: tuple[str, ...] = ("x until contour",)
    plant: dict[str, float] = field(
        default_factory=dict
    )  # parameters of the model that differ from its own values
    sensors: SensorParams = field(default_factory=SensorParams)  # its `noise` switches the noise
    timing: LoopTiming = field(default_factory=LoopTiming)
    seed: int = 0  # >= 0, of noise and jitter

    def __post_init__(self) -> None:
        if not self.phases:
            object.__setattr__(self, "phases", short_phases(self.workpiece))
        object.__setattr__(self, "sensors", self.sensors._replace(dt=self.timing.period))
        _arguments(Fields(_table(self), KEYS))

    @property
    def z_0(self) -> float:
        """Stand-off [m]: the scenario's, or else the workpiece's own (reads the file of a user's
        workpiece).
        """
        return default_standoff(self.workpiece) if self.standoff is None else self.standoff

    @property
    def noise(self) -> bool:
        return self.sensors.noise

    @property
    def duration(self) -> float:
        """End of the last phase [s]."""
        return max(end for _, end in self.phases.values())

    @property
    def samples(self) -> int:
        """Rows of the run's log."""
        return round(self.duration / self.timing.period)

    def windows(self, axis: str) -> list[tuple[float, float]]:
        """Stretches [t0, t1) in s over which an axis ("x" or "z") is clamped."""
        return clamp_windows(self.clamped, self.phases)[axis]


class Fields:
    """A TOML table read key by key; every complaint is an InputError that names file, key and
    hint.
    """

    def __init__(
        self,
        table: object,
        keys: Iterable[str],
        file: str | os.PathLike[str] | None = None,
        prefix: str = "",
    ) -> None:
        self.file, self.prefix = file, prefix
        if not isinstance(table, Mapping):
            message = f"is {table!r}, expected a table"
            raise InputError(message, file=file, field=prefix[:-1], hint="write { key = value }")
        self.table: Mapping[str, Any] = table
        self.keys = list(keys)
        for key in table:
            if key not in self.keys:
                near = difflib.get_close_matches(str(key), self.keys, n=1)
                hint = f"did you mean {near[0]}?" if near else f"known keys: {', '.join(self.keys)}"
                self.refuse(str(key), "unknown key", hint)

    def __contains__(self, key: str) -> bool:
        return key in self.table

    def refuse(self, key: str, message: str, hint: str | None) -> NoReturn:
        raise InputError(message, file=self.file, field=self.prefix + key, hint=hint)

    def number(
        self, key: str, default: Any = None, low: float = -math.inf, high: float = math.inf
    ) -> Any:
        """A float within low..high; the default, which may be None, where the key is absent."""
        if key not in self.table:
            return default
        value = self.table[key]
        if not _is_number(value):
            self.refuse(key, f"is {value!r}, expected a number", "write a plain number")
        if not low <= value <= high:
            span = f"{low:g}..{high:g}" if math.isfinite(high) else f">= {low:g}"
            self.refuse(key, f"is {value!r}, expected {span}", "choose a value within it")
        return float(value)

    def of_type(self, key: str, kind: type, default: Any) -> Any:
        value = self.table.get(key, default)
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            what = {
                str: "text in quotes",
                bool: "true or false",
                int: "a whole number",
                list: "a list",
            }[kind]
            self.refuse(key, f"is {value!r}, expected {what}", f"write {what}")
        return value

    def sub(self, key: str, keys: Iterable[str]) -> Fields:
        return Fields(self.table.get(key, {}), keys, self.file, f"{self.prefix}{key}.")

    def numbers(self, key: str) -> dict[str, float]:
        """A table of numbers under names of the user's choice."""
        table = self.table.get(key, {})
        names = list(table) if isinstance(table, Mapping) else []
        fields = self.sub(key, names)
        return {name: fields.number(name) for name in names}

    def workpiece(self, default: str, none: bool = False) -> str:
        name: str = self.of_type("workpiece", str, default)
        try:
            check_workpiece(name, none=none)
        except InputError as error:
            self.refuse("workpiece", error.message, error.hint)
        if not name.lower().endswith(".csv") or self.file is None:
            return name
        path = Path(self.file).parent / name
        if not os.path.isfile(path):
            self.refuse(
                "workpiece",
                f"no such file {path}",
                "check the path; it is taken from the folder of this file",
            )
        return str(path)

    def controller(self, default: str) -> str:
        """A controller's name, or its file, taken from the folder of this file."""
        name: str = self.of_type("controller", str, default)
        if self.file is None or not name.lower().endswith((".py", ".fmu")):
            return name
        path = Path(os.path.abspath(Path(self.file).parent / name))  # a link keeps its name
        if name.lower().endswith(".py") and not path.is_file():
            self.refuse("controller", f"no such file {path}", "check the path")
        return str(path) if path.is_file() else name

    def clamped(self, default: Iterable[str], phases: Phases) -> tuple[str, ...]:
        given = tuple(self.of_type("clamped", list, list(default)))
        try:
            clamp_windows(given, phases)
        except ValueError as error:
            self.refuse("clamped", str(error), 'write "x", "z", or "x until PHASE"')
        return given

    def phases(self, workpiece: str) -> Phases:
        given = self.table.get("phases", {})
        if isinstance(given, str):
            if given not in PRESETS:
                self.refuse(
                    "phases", f"unknown preset {given!r}", f"use {' or '.join(PRESETS)}, or a table"
                )
            return PRESETS[given](workpiece)
        fields, phases, last = self.sub("phases", PHASES), {}, -math.inf
        for name in sorted(fields.table, key=PHASES.index):
            span = fields.table[name]
            if not (
                isinstance(span, list | tuple)
                and len(span) == 2
                and all(_is_number(t) for t in span)
            ):
                fields.refuse(
                    name,
                    f"is {span!r}, expected start and end in seconds",
                    f"write {name} = [0.0, 3.0]",
                )
            if not span[0] < span[1]:
                fields.refuse(
                    name,
                    f"ends at {span[1]:g} s, not after its start {span[0]:g} s",
                    "write [start, end]",
                )
            if span[0] < last - 1e-9:
                fields.refuse(
                    name,
                    f"starts at {span[0]:g} s, before the phase before it ends",
                    "let it start later",
                )
            phases[name], last = (float(span[0]), float(span[1])), span[1]
        return phases


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def clamp_windows(clamped: Iterable[str], phases: Phases) -> dict[str, list[tuple[float, float]]]:
    """Stretches [t0, t1) in s over which each axis is clamped; "x": throughout, "x until contour":
    before that phase.

    Raises ValueError for another wording or a phase that is not there.
    """
    windows: dict[str, list[tuple[float, float]]] = {"x": [], "z": []}
    for text in clamped:
        match = (
            re.fullmatch(r"\s*([xz])(?:\s+until\s+(\w+))?\s*", text)
            if isinstance(text, str)
            else None
        )
        if match is None:
            raise ValueError(f"has {text!r}, which names no axis")
        if match[2] and match[2] not in phases:
            raise ValueError(
                f"has {text!r}, no phase {match[2]!r} (phases: {', '.join(phases) or 'none'})"
            )
        windows[match[1]].append((-math.inf, phases[match[2]][0] if match[2] else math.inf))
    return windows


KEYS = (
    "name",
    "workpiece",
    "standoff",
    "surface_finish",
    "start",
    "f_nd",
    "v_td",
    "controller",
    "gains",
    "phases",
    "approach_command",
    "retreat_f_az",
    "clamped",
    "seed",
    "plant",
    "sensors",
    "timing",
)
_SENSOR_NUMBERS = tuple(
    name for name in SensorParams._fields if name not in ("sigma", "quantum", "noise", "dt")
)


def _arguments(fields: Fields) -> dict[str, Any]:
    """Scenario's arguments from its TOML table; raises InputError."""
    workpiece = fields.workpiece("curved")
    phases = fields.phases(workpiece) or short_phases(workpiece)
    _check_phases(fields, phases)
    start, command = fields.sub("start", ("x", "z")), fields.sub("approach_command", ("u_x", "u_z"))
    gains = fields.table.get("gains")
    seed = fields.of_type("seed", int, 0)
    if seed < 0:
        fields.refuse("seed", f"is {seed}, expected >= 0", "choose a whole number from 0 on")
    timing = _timing(fields, phases)
    return {
        "name": fields.of_type("name", str, "run"),
        "workpiece": workpiece,
        "standoff": fields.number("standoff", None, 0.0, STROKE_Z),
        "surface_finish": fields.of_type("surface_finish", bool, False),
        "start_x": start.number("x", 0.95, 0.0, STROKE_X),
        "start_z": start.number("z", 0.0, 0.0, STROKE_Z),
        "f_nd": fields.number("f_nd", 30.0, 0.0, 150.0),
        "v_td": fields.number("v_td", -0.06, -1.0, 1.0),
        "controller": fields.controller("pi_fv"),
        "gains": gains if gains is None or isinstance(gains, str) else fields.numbers("gains"),
        "phases": phases,
        "approach_u_x": command.number("u_x", 0.0, 0.0, 5.0),
        "approach_u_z": command.number("u_z", 1.05, 0.0, 5.0),
        "retreat_f_az": fields.number("retreat_f_az", -40.0, -150.0, 0.0),
        "clamped": fields.clamped(["x until contour"], phases),
        "plant": fields.numbers("plant"),
        "sensors": _sensors(fields),
        "timing": timing,
        "seed": seed,
    }


def _check_phases(fields: Fields, phases: Phases) -> None:
    for name in ("contact", "contour"):
        if name not in phases:
            fields.refuse("phases", f"{name} is missing", f"write {name} = [start, end] in seconds")
    end = 0.0
    for name, (start, stop) in phases.items():
        if abs(start - end) > 1e-9:
            fields.refuse(
                f"phases.{name}",
                f"starts at {start:g} s, expected {end:g} s",
                "leave no gap between phases",
            )
        end = stop
    if end > 600.0:
        fields.refuse(
            "phases", f"end at {end:g} s, expected 600 s or less", "give the phases in seconds"
        )


def _timing(fields: Fields, phases: Phases) -> LoopTiming:
    table = fields.sub("timing", ("period", "delay", "jitter"))
    timing = _valid(
        fields, "timing", lambda: LoopTiming(**{key: table.number(key) for key in table.table})
    )
    if (samples := max(end for _, end in phases.values()) / timing.period) > MOST_SAMPLES:
        table.refuse(
            "period",
            f"gives {samples:.3g} samples, expected {MOST_SAMPLES} or fewer",
            "choose a longer one, or shorter phases",
        )
    return timing


def _sensors(fields: Fields) -> SensorParams:
    keys = (*_SENSOR_NUMBERS, "sigma", "quantum", "converter_bits", "noise")
    sub = fields.sub("sensors", keys)
    values: dict[str, Any] = {key: sub.number(key) for key in _SENSOR_NUMBERS if key in sub}
    values["noise"] = sub.of_type("noise", bool, True)
    defaults = {"sigma": SensorParams().sigma, "quantum": SensorParams().quantum}
    if "converter_bits" in sub:  # the rig's converter over +-10 V; a quantum given stays
        bits = sub.of_type("converter_bits", int, 12)
        defaults["quantum"] = _valid(sub, "converter_bits", lambda: converter_steps(bits))
    for key, default in defaults.items():
        channels = sub.sub(key, MEASURED)
        values[key] = tuple(
            channels.number(c, d, 0.0) for c, d in zip(MEASURED, default, strict=True)
        )
    params = SensorParams(**values)
    _valid(fields, "sensors", lambda: check_sensors(params))
    return params


def _valid(fields: Fields, key: str, make: Callable[[], T]) -> T:
    try:
        return make()
    except ValueError as error:
        fields.refuse(key, str(error), "choose a value within it")


def _table(scenario: Scenario) -> dict[str, Any]:
    """A scenario as the TOML table that reads back as it."""
    table = {key: getattr(scenario, key) for key in KEYS if hasattr(scenario, key)}
    sensors = {key: getattr(scenario.sensors, key) for key in _SENSOR_NUMBERS}
    for key in ("sigma", "quantum"):
        sensors[key] = dict(zip(MEASURED, getattr(scenario.sensors, key), strict=True))
    table |= {
        "start": {"x": scenario.start_x, "z": scenario.start_z},
        "approach_command": {"u_x": scenario.approach_u_x, "u_z": scenario.approach_u_z},
        "clamped": list(scenario.clamped),
        "sensors": sensors | {"noise": scenario.sensors.noise},
        "timing": {key: getattr(scenario.timing, key) for key in ("period", "delay", "jitter")},
    }
    return {key: table[key] for key in KEYS if table[key] is not None}


def scenario_from(table: Mapping[str, Any], file: str | os.PathLike[str] | None = None) -> Scenario:
    """A scenario from its TOML table; missing keys take the defaults. Raises InputError naming
    file, key and hint.
    """
    return Scenario(**_arguments(Fields(table, KEYS, file)))


def read_scenario(path: str | os.PathLike[str]) -> Scenario:
    """A scenario from a TOML file; its name is the file's where it gives none.

    Raises InputError.
    """
    return scenario_from({"name": Path(path).stem} | parse_toml(path), path)


def scenario_text(scenario: Scenario) -> str:
    """A scenario as TOML, from which `read_scenario` gives it back equal."""
    return to_toml(_table(scenario), sections=("plant", "sensors", "timing"))


# ---------------------------------------------------------------- TOML


def parse_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The table of a TOML file. Raises InputError where it is absent, a folder, or no TOML (naming
    line and column).
    """
    path = Path(path)
    check_source(path, pipes=True)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError("no such file", file=path, hint="check the path") from None
    except OSError as error:
        raise InputError(
            f"cannot be read ({error.strerror})", file=path, hint="give a readable TOML file"
        ) from None
    except UnicodeDecodeError:
        raise InputError("not a text file in UTF-8", file=path, hint="give a TOML file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not valid TOML: {error}", file=path, hint="correct that line") from None
    except ValueError as error:  # a path that holds a NUL
        raise InputError(f"cannot be read ({error})", file=path, hint="correct the path") from None


def to_toml(table: Mapping[str, Any], sections: Iterable[str] = ()) -> str:
    """TOML text of a table of text, numbers, truth values, lists and tables; None and empty tables
    are left out.

    Tables not among `sections` go in one line each.
    """
    tables = {key: table[key] for key in sections if table.get(key)}
    lines = [
        f"{toml_key(k)} = {_value(v)}"
        for k, v in table.items()
        if k not in tables and v not in (None, {})
    ]
    for key, section in tables.items():
        lines += [
            "",
            f"[{toml_key(key)}]",
            *(f"{toml_key(k)} = {_value(v)}" for k, v in section.items()),
        ]
    return "\n".join(lines) + "\n"


def toml_key(key: str) -> str:
    """A key as TOML writes it, in quotes where need be."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _text(key)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
    if isinstance(value, str | os.PathLike):
        return _text(os.fspath(value))
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return (
            "{ " + ", ".join(f"{toml_key(k)} = {_value(v)}" for k, v in value.items()) + " }"
            if value
            else "{}"
        )
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return str(value) if isinstance(value, int) else repr(float(value))
