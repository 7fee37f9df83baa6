"""A user's plant as the engine reads it, from a TOML file.

[plant]      name; model = "Axis.mo" and class = "Axis", or fmu = "axis.fmu"; catalogue = "effects"
             (folder or file); time = "t" or { column = "t", recorded = "ms" }, or period = 1e-3 (s,
             between rows, and what all logs are brought to, else the first one's); without both
             each log has a column "time" (s); decimate = 25 (rows that are judged as one); skip =
             0.5 (s, not judged); step = 1e-3 (s, longest step of an FMU); effort = 0.2 (of what a
             search usually may spend)
[[fmu]]      instead of fmu =, one table each: file; block (its name in the answer); prefix (before
             the names of its parameters); step; inputs = { "its input" = "input or output below" };
             outputs = { "its output" = "output below" }. Inputs and outputs of the same name are
             found without being written.
[inputs]     "name in the model" = "column", a number, or { column, unit, recorded, scale, offset }
[outputs.u]  column = "vir", sigma = 0.005 (RMS of the sensor's noise in `unit`; estimated if it is
             not given), unit = "V" (of the model), recorded = "mV" (of the column), scale, offset,
             variable = "motor.u" (of the model; else the part's name), error = 0.02 (RMS of what
             even a right model leaves besides, in `unit`), lasting = 0.3 (s, in which its
             correlation falls to 1/e)
[blocks]     "motor" = "drive": component path of the model = name in the answer
[tolerance]  "M" = 0.05: share (RMS) by which a rig's parameter may be off; that is no cause
[parameters] "gtau" = 35.15: what is known and differs from the model's own value
[per_log]    "q_start" = 1e-3: RMS by which a parameter of each log is off; no cause either
[log.train]  file = "train.csv" (.parquet, .mat), use = "fit" or "held out"; [log.train.inputs],
             [log.train.parameters]: of this log only

Paths are relative to the file. Row k holds the readings at k * period and the inputs that act from
then on. A signal that no log has is left out; the others' views then reach further.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.engine.fitting.noise import LONGEST
from pneugantry.engine.hypotheses.catalogue import (
    Effect,
    Form,
    Parameter,
    check_nominal,
    read_catalogue,
)
from pneugantry.engine.planning.plan import Case
from pneugantry.engine.plant import Data, Nuisance, Plant, Record, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.commands import PREFIX as INPUTS
from pneugantry.engine.signals.commands import outside
from pneugantry.engine.signals.converter import converted
from pneugantry.engine.signals.records import Logs, free, per_log, signals_of, variables_of
from pneugantry.engine.signals.sensors import PREFIX, neutral
from pneugantry.engine.signals.units import with_unit
from pneugantry.engine.views.cuts import sharp_views
from pneugantry.engine.views.foreign import ForeignFmu, ForeignPlant, foreign_views
from pneugantry.engine.views.model_parts import known_variables
from pneugantry.engine.views.view import View
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile, FmuVariable
from pyfmi_runner.scenario import Fields, parse_toml

__all__ = ["Described", "case_of", "described", "sensor_effects", "views_of"]

SCALE = 0.003  # RMS error of any sensor's scale that is no cause (field: a calibrated sensor)
LEAST, MOST = 0.05, 20.0  # shares of the usual effort that a search may be given
MOST_SENSORS = 6  # sensors that are tried: each is a cut of its own
TABLES = (
    "plant",
    "fmu",
    "inputs",
    "outputs",
    "blocks",
    "tolerance",
    "parameters",
    "per_log",
    "log",
)
PLANT_KEYS = (
    *("name", "model", "class", "fmu", "catalogue"),
    *("time", "period", "decimate", "skip", "step", "effort"),
)


@dataclass(frozen=True, eq=False)
class Described:
    """All that a description and its logs say."""

    plant: Plant
    data: Data
    catalogue: Mapping[str, Effect]
    rules: Rules
    cache: Path  # of the parts
    notes: tuple[str, ...]
    outputs: tuple[str, ...]  # of the model, measured or not
    effects_from: Path | None  # folder or file of the catalogue

    @property
    def records(self) -> tuple[Record, ...]:
        held = self.data.held_out
        return self.data.fitted if held is None else (*self.data.fitted, held)


def described(
    path: Path, cache: Path, catalogue: Path | None = None, rules: Rules | None = None
) -> Described:
    """Reads a description and its logs. cache: folder of the parts; catalogue: read instead of the
    description's. `band`, `thinning` and `effort` of the rules follow from the description. Raises
    InputError naming file, field and hint.
    """
    top = Fields(parse_toml(path), TABLES, path)
    for name in ("plant", "inputs", "outputs", "log"):
        if not top.table.get(name):
            top.refuse(name, "is missing or empty", f"add a table [{name}]")
    own = top.sub("plant", PLANT_KEYS)
    source = _source_of(top, own)
    logs = Logs(top, own)
    records, held, notes = logs.read()
    signals, said = signals_of(logs, (*records, *held))
    _check_names(top, signals, source)
    signals, read = converted(signals, (*records, *held))
    records, held = read[: len(records)], read[len(records) :]
    said += [
        f"{s.name} is read on a grid of {with_unit(f'{s.step:.3g}', s.unit)}: its noise counts as "
        f"{with_unit(f'{s.sigma:.3g}', s.unit)}"
        for s in signals
        if s.step
    ]
    given = own.of_type("catalogue", str, "")
    effects_from = catalogue or (path.parent / given if given else None)
    effects = _catalogue(effects_from, _nominal(top, source))
    plant = _plant(top, own, source, signals)
    if len(held) > 1:
        notes.append(f"held out and not used: {', '.join(r.name for r in held[1:])}")
    every, period = (*records, *held), records[0].period
    decimate = _decimation(top, own, every)
    return Described(
        plant,
        Data(tuple(records), held[0] if held else None),
        sensor_effects(plant.signals, period) | input_effects(every) | effects,
        _rules(rules or Rules(), own, 1 / (period * decimate)),
        cache,
        (*notes, *said),
        source.outputs,
        effects_from,
    )


def _rules(usual: Rules, own: Fields, band: float) -> Rules:
    """With what a description says of them. band: Hz."""
    share = own.number("effort", 1.0, LEAST, MOST)
    return replace(usual, band=band, thinning=1, effort=share * usual.effort)


def _decimation(top: Fields, own: Fields, records: Sequence[Record]) -> int:
    """Rows that are judged as one. Raises InputError for a log that is too short then."""
    decimate: int = own.of_type("decimate", int, 1)
    if decimate < 1:
        own.refuse("decimate", f"is {decimate}, expected >= 1", "write 1 to judge every row")
    assert top.file is not None
    for record in (r for r in records if r.signals):
        judged = (record.rows - record.first) // decimate
        if judged <= LONGEST:
            raise InputError(
                f"has {max(judged, 0)} rows that are judged (of {record.rows}, decimate = "
                f"{decimate}, skip = {record.skip:g} s), expected > {LONGEST}",
                file=Path(top.file).parent / top.table["log"][record.name]["file"],
                hint="record a longer log, or write a smaller decimate or skip under [plant]",
            )
    return decimate


def views_of(found: Described) -> tuple[list[View], list[str]]:
    """Views of what is measured: cut from the model, or of the FMUs; and what could not be made."""
    measured = [s.name for s in found.plant.signals]
    period = found.data.fitted[0].period
    rules = found.rules
    if isinstance(found.plant, ForeignPlant):
        views, notes = foreign_views(found.plant, measured, period, rules.band)
        return list(views), notes
    fitted, held = found.data.fitted, [r.signals.keys() for r in found.records]
    return list(sharp_views(found.plant, measured, found.cache, fitted, rules, held)), []


def case_of(path: Path, cache: Path, catalogue: Path | None = None) -> Case:
    """What a plan is made of. Arguments and errors as of `described`; InputError for an FMU, whose
    missing signals nothing simulates.
    """
    table = parse_toml(path)
    plant = table.get("plant", {})
    if "fmu" in table or "fmu" in plant or "model" not in plant or "class" not in plant:
        raise InputError(
            "plan needs the Modelica source",
            file=path,
            field="plant",
            hint='write model = "Axis.mo" and class = "Axis"',
        )
    found = described(path, cache, catalogue)
    return Case(
        found.plant,
        found.records,
        found.catalogue,
        found.rules,
        cache,
        sensors=_missing(found),
        notes=found.notes,
        sharp=True,
    )


# ---- the model


@dataclass(frozen=True)
class _Model:
    """Modelica source, or FMUs."""

    what: str
    model: Path
    class_name: str
    variables: Mapping[str, FmuVariable]  # with the FMUs' prefixes
    outputs: tuple[str, ...]
    fmus: tuple[ForeignFmu, ...] = ()  # inputs and outputs as written, before the rest is found


def _source_of(top: Fields, own: Fields) -> _Model:
    assert top.file is not None
    folder = Path(top.file).parent
    model, class_name, fmu = (own.of_type(k, str, "") for k in ("model", "class", "fmu"))
    tables = top.of_type("fmu", list, [])
    if (bool(model) + bool(fmu) + bool(tables)) != 1 or bool(model) != bool(class_name):
        hint = 'write fmu = "axis.fmu", or model = "Axis.mo" and class = "Axis", or [[fmu]] tables'
        own.refuse("model", "names no plant, or more than one", hint)
    if model:
        file = FmuFile.read(build_fmu(class_name, folder / model).path)
        outputs = tuple(n for n, v in file.variables.items() if v.causality == "output")
        what = f"the class {class_name}"
        return _Model(what, folder / model, class_name, file.variables, outputs)
    if fmu:
        tables = [{"file": fmu, **({"step": own.table["step"]} if "step" in own else {})}]
    fmus = tuple(_fmu(table, top, folder) for table in tables)
    known = {f.prefix + n: v for f in fmus for n, v in f.file.variables.items()}
    outputs = tuple(f.prefix + n for f in fmus for n in f.file.description.outputs)
    first = fmus[0].file
    what = ", ".join(f.file.path.name for f in fmus)
    return _Model(what, first.path, first.description.model, known, outputs, fmus)


def _fmu(table: object, top: Fields, folder: Path) -> ForeignFmu:
    """One FMU, with the inputs and outputs that are written."""
    fields = Fields(
        table, ("file", "block", "prefix", "step", "inputs", "outputs"), top.file, "fmu."
    )
    name = fields.of_type("file", str, "")
    if not name:
        fields.refuse("file", "is missing", 'write file = "axis.fmu"')
    step = fields.number("step", None, 0.0)
    if step == 0.0:
        fields.refuse("step", "must be > 0", "give the longest step in s, or leave it out")
    file = FmuFile.read(folder / name)
    return ForeignFmu(
        file,
        fields.of_type("block", str, file.path.stem),
        _texts(fields, "inputs"),
        _texts(fields, "outputs"),
        fields.of_type("prefix", str, ""),
        step,
    )


def _texts(fields: Fields, key: str) -> dict[str, str]:
    given = free(fields, key)
    return {name: given.of_type(name, str, "") for name in given.table}


def _wired(fmu: ForeignFmu, inputs: Sequence[str], signals: Mapping[str, str]) -> ForeignFmu:
    """The FMU with the inputs and outputs of the same name that nobody wrote. signals: variable
    by signal.
    """
    variables = fmu.file.variables
    at = {n for n, v in variables.items() if v.causality == "input"}
    sources = {n: n for n in sorted(at) if n in inputs or n in signals} | dict(fmu.inputs)
    if fmu.outputs:
        return replace(fmu, inputs=sources)
    made = {}
    for signal, variable in signals.items():
        bare = variable.removeprefix(fmu.prefix)
        if variable.startswith(fmu.prefix) and bare in variables and bare not in at:
            made[bare] = signal
    return replace(fmu, inputs=sources, outputs=made)


def _check_names(top: Fields, signals: Sequence[Signal], source: _Model) -> None:
    """Refuses what the model lacks or does not let be set. Inputs and outputs of [[fmu]] tables may
    have other names than the plant's.
    """
    named = [
        (f"{k}.{n}", n) for k in ("tolerance", "parameters", "per_log") for n in free(top, k).table
    ]
    for field, name in named:
        known = source.variables.get(name)
        if known is not None and not known.settable_before_start:
            top.refuse(field, "cannot be set before the start", "name a parameter")
    if "fmu" not in top.table:
        named += [(f"inputs.{n}", n) for n in free(top, "inputs").table]
        named += [(f"outputs.{s.name}", s.variable) for s in signals]
        _check_fed(top, source)
    for field, name in named:
        if name not in source.variables and not name.startswith(PREFIX):
            near = difflib.get_close_matches(name, source.variables, n=1)
            hint = f"did you mean {near[0]}?" if near else f"name a variable of {source.what}"
            top.refuse(field, "no such variable in the model", hint)


def _check_fed(top: Fields, source: _Model) -> None:
    """Refuses an input of a Modelica model that nothing feeds; that of an FMU has its start."""
    given = free(top, "inputs").table
    for name, variable in source.variables.items():
        if variable.causality == "input" and name not in given and not source.fmus:
            hint = "name its column, or write a number"
            top.refuse(f"inputs.{name}", "is an input of the model that nothing feeds", hint)


def _plant(top: Fields, own: Fields, source: _Model, signals: Sequence[Signal]) -> Plant:
    assert top.file is not None
    nuisances = [
        Nuisance(p, s, relative=True, scales=True) for p, s in _shares(top, source).items()
    ]
    nuisances += [Nuisance(p, s, per_record=True, read=True) for p, s in per_log(top).items()]
    for s in signals:
        nuisances += [
            Nuisance(f"{PREFIX}{s.name}.scale", SCALE),
            Nuisance(f"{PREFIX}{s.name}.bias", s.sigma),
        ]
    plant = Plant(
        name=own.of_type("name", str, "") or Path(top.file).resolve().parent.name,
        model=source.model,
        class_name=source.class_name,
        inputs=tuple(free(top, "inputs").table),
        signals=tuple(signals),
        parameters=top.numbers("parameters"),
        nuisances=tuple(nuisances),
        blocks=_texts(top, "blocks"),
    )
    if not source.fmus:
        return plant
    return _of_fmus(top, source, plant)


def _shares(top: Fields, source: _Model) -> dict[str, float]:
    """Shares of values by which parameters may be off; 0 is none."""
    found = top.numbers("tolerance")
    nominal = _nominal(top, source)
    for name, share in found.items():
        if not 0 <= share <= 1:
            hint = "give a share of the value: 0.02 for 2 %"
            top.refuse(f"tolerance.{name}", f"is {share:g}, expected 0..1", hint)
        if share and nominal(name) == 0:
            hint = "write its value under [parameters] and its RMS under [per_log], or take it out"
            top.refuse(f"tolerance.{name}", "is a share of a value that is 0", hint)
    return {name: share for name, share in found.items() if share}


def _nominal(top: Fields, source: _Model) -> Callable[[str], float | None]:
    """Tells a parameter's value without an effect; None where the model does not say it."""
    values = {n: v.start for n, v in source.variables.items()} | top.numbers("parameters")
    return lambda name: neutral(name) if outside(name) else values.get(name)


def _of_fmus(top: Fields, source: _Model, plant: Plant) -> ForeignPlant:
    """The plant with its FMUs wired."""
    variables = variables_of(top)
    fmus = tuple(_wired(f, plant.inputs, variables) for f in source.fmus)
    made = {s: f.prefix + o for f in fmus for o, s in f.outputs.items()}
    read = {source for f in fmus for source in f.inputs.values()}
    for name in plant.inputs:
        if name not in read:
            hint = f"see modelDescription.xml of {source.what}, or name it in [[fmu]] inputs"
            top.refuse(f"inputs.{name}", "is read by no FMU", hint)
    for s in plant.signals:
        if s.name not in made and s.name not in read:
            hint = f"see modelDescription.xml of {source.what}, or name it in [[fmu]] outputs"
            top.refuse(f"outputs.{s.name}", "is neither made nor read by any FMU", hint)
    kept = tuple(replace(s, variable=made.get(s.name, s.variable)) for s in plant.signals)
    return ForeignPlant(**{**vars(plant), "signals": kept}, fmus=fmus)


# ---- effects, sensors


def _catalogue(source: Path | None, nominal: Callable[[str], float | None]) -> dict[str, Effect]:
    """Effects of a folder or a file. Raises InputError for what is a share of 0."""
    found = {} if source is None else read_catalogue(source)
    for effect in found.values():
        for p in (p for form in effect.forms for p in form.parameters):
            value = nominal(p.name)
            if value is not None:
                check_nominal(p, value, effect.name, source)
    return found


def sensor_effects(signals: Sequence[Signal], period: float) -> dict[str, Effect]:
    """Errors that every sensor may have: bias of ten times its noise, scale of 5 %, and how it may
    be late: by a delay or a lag of five rows, or as a mean over ten.
    """
    found = {}
    late = {"delay": 5 * period, "lag": 5 * period, "window": 10 * period}
    for s in signals:
        for what, parameters in (
            ("bias", [Parameter("bias", 0.0, 10 * s.sigma, -1e300, 1e300, s.unit)]),
            ("scale", [Parameter("scale", 1.0, 0.05, 0.1, 10.0, "1")]),
            ("delay", [Parameter(n, 0.0, at, 0.0, 100 * at, "s") for n, at in late.items()]),
        ):
            forms = tuple(
                Form(p.name, (replace(p, name=f"{PREFIX}{s.name}.{p.name}"),)) for p in parameters
            )
            key = f"sensor_{what}({s.name})"
            found[key] = Effect(key, "", "sensors", f"{what} of {s.name}", forms)
    return found


def input_effects(records: Sequence[Record]) -> dict[str, Effect]:
    """How every input that moves may be late: by a delay, or a lag, of five rows. Its scale and its
    offset are numbers of the model, which a catalogue names. So may a delay be: that is told where
    it does the same.
    """
    found = {}
    period = records[0].period
    for name in records[0].inputs:
        if all(np.ptp(r.inputs[name]) == 0 for r in records):
            continue
        sizes = (0.0, 5 * period, 0.0, 500 * period, "s")
        forms = tuple(
            Form(what, (Parameter(f"{INPUTS}{name}.{what}", *sizes),)) for what in ("delay", "lag")
        )
        key, said = f"input_delay({name})", f"{name} acts late"
        effect = Effect(key, "", "inputs", said, forms, general=True)
        found[effect.key] = effect
    return found


def _missing(found: Described) -> tuple[Signal, ...]:
    """Outputs and states of the model that are not measured."""
    roots, states = known_variables(found.plant, found.cache)
    measured = {roots.get(s.variable) for s in found.plant.signals}
    made: dict[str, str] = {}
    for name in (*found.outputs, *sorted(states)):
        if name in roots and roots[name] not in measured and roots[name] not in made:
            made[roots[name]] = name
    return tuple(Signal(name, name, 0.0) for name in list(made.values())[:MOST_SENSORS])
