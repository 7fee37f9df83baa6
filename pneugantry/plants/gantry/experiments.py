"""What a campaign of the gantry is, and the further experiments that the rig could do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pneugantry.engine.planning.plan import Case, Experiment
from pneugantry.engine.plant import Plant, Record, Signal, thinned
from pneugantry.engine.rules import Rules
from pneugantry.plants.gantry.catalogue import catalogue_of
from pneugantry.plants.gantry.describe import commanded, plant_of, record_of
from pneugantry.plants.gantry.next_experiment import candidates, simulated
from pneugantry.plants.gantry.timing import ControllerView
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import Campaign, LoggedRun, LogSetup
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED, SIGMA, STROKE_X, STROKE_Z
from pyfmi_runner.scenario import Scenario, scenario_text
from pyfmi_runner.sensors import SensorParams

__all__ = ["case_of"]

ELSEWHERE = (0.25, 0.75)  # shares of the stroke at which clamped pistons are tried
STROKE = {"x": STROKE_X, "z": STROKE_Z}
FIRM = 50.0  # N, contact force from which on tracking an edge is tried
STRONGER = 1.4  # times the commands of an open-loop log


def case_of(
    campaign: Campaign, cache: Path, catalogue: Path | None = None, experiments: bool = True
) -> Case:
    """Plan of a campaign: its logs, the catalogue, what could be measured beside. Channels that no
    log has are taken as not measured. Raises InputError.
    """
    rules = Rules()
    columns = set.intersection(*(set(run.log.table.columns) for run in campaign))
    measured = [c for c in MEASURED if c in columns]
    if not measured:  # a campaign that is yet to be measured
        measured = list(MEASURED)
    plant = plant_of(measured, rules.thinning)
    records = tuple(
        thinned(record_of(name, run), rules.thinning) for name, run in campaign.logs.items()
    )
    return Case(
        plant,
        records,
        catalogue_of(catalogue),
        rules,
        cache,
        others=(ControllerView(commanded(campaign.logs)),),
        experiments=tuple(_experiments(campaign, plant, rules)) if experiments else (),
        sensors=_sensors(measured, rules.thinning),
        notes=tuple(campaign.notes),
    )


def _sensors(measured: list[str], thinning: int) -> tuple[Signal, ...]:
    missing = [c for c in MEASURED if c not in measured]
    return tuple(Signal(c, c, SIGMA[c] / np.sqrt(thinning)) for c in missing)


def _experiments(campaign: Campaign, plant: Plant, rules: Rules) -> Iterator[Experiment]:
    """Scenarios with the campaign's controller, and its open-loop logs at other positions and with
    stronger commands.
    """
    yield from _varied(campaign, rules)
    fmu = FmuFile.read(build_fmu().path)
    for candidate in candidates(campaign):
        scenario = candidate.scenario
        if candidate.tracks and (scenario.f_nd < FIRM or scenario.workpiece == "incline_16"):
            continue  # a firmer or steeper one tells more
        record = _run(candidate.what, scenario, fmu, plant, rules)
        if record is not None:
            text = scenario_text(replace(scenario, sensors=SensorParams()))
            yield Experiment(candidate.what, record, text)


def _run(what: str, scenario: Scenario, fmu: FmuFile, plant: Plant, rules: Rules) -> Record | None:
    """Nominal record of a scenario; None where the rig cannot do it."""
    record = simulated(what, scenario, fmu, rules.thinning)
    if record is None:
        return None
    kept = {s.name: record.signals[s.name] for s in plant.signals}
    return replace(record, signals=kept, judged=None)


def _varied(campaign: Campaign, rules: Rules) -> Iterator[Experiment]:
    """Experiments like the open-loop logs; a kind of log is varied once."""
    kinds: set[tuple[object, ...]] = set()
    for name, run in campaign.logs.items():
        setup = run.setup
        kind = (tuple(sorted(setup.clamped)), setup.workpiece)
        if setup.loop != "open" or kind in kinds:
            continue
        kinds.add(kind)
        if set(setup.clamped) == {"x", "z"}:
            for share in ELSEWHERE:
                at = {a: round(share * STROKE[a], 3) for a in "xz"}
                what = f"{name} with the pistons clamped at {at['x']:g} m and {at['z']:g} m"
                moved = replace(setup, start_x=at["x"], start_z=at["z"])
                yield Experiment(what, _commanded(what, run, moved, 1.0, rules))
        else:
            what = f"{name} with {STRONGER:g} times the commands"
            yield Experiment(what, _commanded(what, run, setup, STRONGER, rules))


def _commanded(what: str, run: LoggedRun, setup: LogSetup, factor: float, rules: Rules) -> Record:
    """A record of commands alone: its signals are yet to be simulated."""
    record = thinned(record_of(what, LoggedRun(setup, run.log)), rules.thinning)
    share = {"u_x": factor, "u_z": factor}
    inputs = {n: v * share.get(n, 1.0) for n, v in record.inputs.items()}
    within = {n: v * share.get(n, 1.0) for n, v in record.within.items()}
    return replace(record, inputs=inputs, within=within, signals={}, judged=None)
