"""A user's plant as the engine reads it, from the TOML file that `own_plant` documents."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.diagnosis.catalogue import Effect, Form, Parameter, read_catalogue
from pneugantry.diagnosis.own_plant import OwnPlant, read_own_plant
from pneugantry.engine.plan import Case
from pneugantry.engine.plant import Nuisance, Plant, Record, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.sensors import PREFIX
from pneugantry.engine.views import known_variables
from pyfmi_runner.scenario import parse_toml

__all__ = ["case_of", "sensor_effects"]

SCALE = 0.003  # RMS error of any sensor's scale that is no cause (field: a calibrated sensor)
MOST_SENSORS = 6  # sensors that are tried: each is a cut of its own


def case_of(path: Path, cache: Path, catalogue: Path | None = None) -> Case:
    """Plant, records and catalogue of a description. cache: folder of the parts; catalogue: read
    instead of the description's. Raises InputError naming file, field and hint.
    """
    table = parse_toml(path).get("plant", {})
    if "fmu" in table or "model" not in table or "class" not in table:
        raise InputError(
            "plan needs the Modelica source: views of an FMU do not exist yet",
            file=path,
            field="plant",
            hint='write model = "Axis.mo" and class = "Axis"',
        )
    own = read_own_plant(path)
    model, class_name = path.parent / str(table["model"]), str(table["class"])
    plant = _plant(own, model, class_name)
    records = tuple(_record(own, index) for index in range(len(own.logs)))
    effects = sensor_effects(plant.signals, own.period) | _catalogue(catalogue or own.catalogue)
    return Case(
        plant,
        records,
        effects,
        replace(Rules(), band=1 / (own.period * own.decimate), thinning=1),
        cache,
        sensors=_missing(own, plant, cache),
    )


def _plant(own: OwnPlant, model: Path, class_name: str) -> Plant:
    nuisances = [Nuisance(p, s, relative=True, scales=True) for p, s in own.tolerance.items()]
    for c in own.channels:
        nuisances += [
            Nuisance(f"{PREFIX}{c.name}.scale", SCALE),
            Nuisance(f"{PREFIX}{c.name}.bias", c.sigma),
        ]
    return Plant(
        name=own.name,
        model=model,
        class_name=class_name,
        inputs=own.inputs,
        signals=tuple(Signal(c.name, c.name, c.sigma, c.unit) for c in own.channels),
        parameters=own.parameters,
        nuisances=tuple(nuisances),
        blocks={},
    )


def _record(own: OwnPlant, index: int) -> Record:
    log = own.logs[index]
    return Record(
        log.name,
        own.period,
        {n: np.ascontiguousarray(log.inputs[:, i]) for i, n in enumerate(own.inputs)},
        {c.name: np.ascontiguousarray(log.measured[:, i]) for i, c in enumerate(own.channels)},
        log.parameters,
        skip=own.skip,
    )


def _catalogue(source: Path | None) -> dict[str, Effect]:
    """Effects of a folder, or of one file without those that come with the package."""
    if source is None:
        return {}
    if source.is_dir():
        return read_catalogue(source)
    known = read_catalogue()
    return {k: e for k, e in read_catalogue(source).items() if known.get(k) != e}


def sensor_effects(signals: tuple[Signal, ...], period: float) -> dict[str, Effect]:
    """Errors that every sensor may have: bias of ten times its noise, scale of 5 %, delay of five
    rows.
    """
    found = {}
    for s in signals:
        for what, parameter in (
            ("bias", Parameter("bias", 0.0, 10 * s.sigma, -1e300, 1e300, s.unit)),
            ("scale", Parameter("scale", 1.0, 0.05, 0.1, 10.0, "1")),
            ("delay", Parameter("delay", 0.0, 5 * period, 0.0, 500 * period, "s")),
        ):
            own = replace(parameter, name=f"{PREFIX}{s.name}.{what}")
            effect = Effect(
                f"sensor_{what}({s.name})",
                "",
                "sensors",
                f"{what} of {s.name}",
                (Form(what, (own,)),),
            )
            found[effect.key] = effect
    return found


def _missing(own: OwnPlant, plant: Plant, cache: Path) -> tuple[Signal, ...]:
    """Outputs and states of the model that are not measured."""
    roots, states = known_variables(plant, cache)
    measured = {roots.get(s.variable) for s in plant.signals}
    outputs = [n for n, v in own.fmu.variables.items() if v.causality == "output"]
    found: dict[str, str] = {}
    for name in (*outputs, *sorted(states)):
        if name in roots and roots[name] not in measured and roots[name] not in found:
            found[roots[name]] = name
    return tuple(Signal(name, name, 0.0) for name in list(found.values())[:MOST_SENSORS])
