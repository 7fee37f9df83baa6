"""A measuring campaign of the gantry as a plant description and records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.engine.plant import Data, Nuisance, Plant, Record, Signal, thinned
from pneugantry.engine.rules import Rules
from pneugantry.engine.signals.sensors import signal_of
from pneugantry.engine.views.build import Measured, build_views
from pneugantry.engine.views.view import View
from pneugantry.plants.gantry.timing import ControllerView
from pyfmi_runner.blocks import recomputed_commands
from pyfmi_runner.build import default_model
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.log import COLUMNS, MEASURED, PERIOD, SIGMA
from pyfmi_runner.plant import DEFAULT_CLASS, own_profile, plant_parameters

__all__ = ["commanded", "data_of", "measured_of", "plant_of", "record_of", "views_of"]

HELD_OUT = "contour_straight"
BLOCKS = {
    "valve_x": "valve_x",
    "valve_z": "valve_z",
    "axis_x": "friction_x",
    "axis_z": "friction_z",
    "axis_x.s": "sensors",
    "axis_z.s": "sensors",
    "contact": "contact",
    "workpiece": "contact",
}
INPUTS = ("u_x", "u_z", "clamp_x", "clamp_z", "f_manual_x", "f_manual_z")
EDGE = ("profile_at", "profile_height", "profile_slope", "profile_curvature")


def measured_of(campaign: Campaign) -> tuple[str, ...]:
    """Channels that some log of a campaign has, in the order of MEASURED."""
    return tuple(c for c in MEASURED if any(c in run.log for run in campaign))


def plant_of(measured: Sequence[str] = MEASURED, thinning: int = 2) -> Plant:
    """Description of the gantry with these channels."""
    nuisances = []
    for axis in "xz":
        nuisances += [
            *(_share(f"valve_{axis}.{p}") for p in ("K", "tau")),
            _share(f"valve_{axis}.u_0", 1 / 3),
            *(
                _share(f"axis_{axis}.{p}")
                for p in ("m", "C", "F_w", "friction.F_s", "friction.F_d")
            ),
            _share(f"axis_{axis}.friction.v_th", 5 / 3),
            Nuisance(f"axis_{axis}.s_start", 5e-4, per_record=True),
            Nuisance(f"sensors.f_{axis}.bias", 0.1),
            *(Nuisance(f"sensors.{c}_{axis}.scale", 0.003, relative=True) for c in ("v", "f")),
            Nuisance(f"sensors.{axis}.scale", 0.003, relative=True),
            Nuisance(f"sensors.f_a{axis}.scale", 0.003, relative=True),
            Nuisance(f"sensors.f_a{axis}.bias", 0.3),
        ]
    nuisances += [
        _share("contact.K_c"),
        _share("contact.C_c"),
        Nuisance("contact.z_0", 4e-4, per_record=True),
    ]
    nuisances = [
        n
        for n in nuisances
        if not n.parameter.startswith("sensors.") or signal_of(n.parameter) in measured
    ]
    return Plant(
        name="gantry",
        model=default_model(),
        class_name=DEFAULT_CLASS,
        inputs=(*INPUTS, *EDGE),
        signals=tuple(
            Signal(c, c, SIGMA[c] / np.sqrt(thinning), COLUMNS[c].unit)
            for c in MEASURED
            if c in measured
        ),
        parameters={},
        nuisances=tuple(nuisances),
        blocks=BLOCKS,
        settings={"solver.tolerance": 0.1, "solver.max_step": PERIOD * thinning},
    )


def _share(name: str, times: float = 1.0) -> Nuisance:
    """times: of what parameters are off. Measured rigs: 3 %, u_0 1 %, v_th 5 %."""
    return Nuisance(name, 0.02 * times, relative=True, scales=True)


def data_of(campaign: Campaign, rules: Rules) -> Data:
    """Records of a campaign: the held-out log apart."""
    records = {
        name: thinned(record_of(name, run), rules.thinning) for name, run in campaign.logs.items()
    }
    if len(records) < 2:
        return Data(tuple(records.values()), None)
    held = HELD_OUT if HELD_OUT in records else list(records)[-1]
    return Data(tuple(r for n, r in records.items() if n != held), records[held])


def record_of(name: str, run: LoggedRun) -> Record:
    """A log at its own rate; an edge of one's own is taken where the tool was measured."""
    log, setup = run.log, run.setup
    zero = np.zeros(len(log))
    inputs = {"u_x": log["u_x"], "u_z": log["u_z"], "f_manual_x": zero, "f_manual_z": zero}
    inputs |= {f"clamp_{a}": setup.clamp_signal(a, log.time).astype(float) for a in "xz"}
    inputs |= dict.fromkeys(EDGE, zero)
    profile = own_profile(setup)
    if profile is not None:
        if "x" not in log:
            hint = "use one of the named workpieces, or measure x"
            raise InputError(f"{name} has an edge of its own, but no x", field="x", hint=hint)
        x = log["x"]
        shape = (x, profile.height(x), profile.slope(x), profile.curvature(x))
        inputs |= dict(zip(EDGE, shape, strict=True))
    signals = {c: log[c] for c in MEASURED if c in log.table.columns}
    return Record(name, PERIOD, inputs, signals, plant_parameters(setup))


def views_of(
    plant: Plant,
    campaign: Campaign,
    cache: Path,
    rules: Rules,
    undecided: Mapping[str, float] | None = None,
) -> list[View]:
    """Views cut from the model, and that of the controller where it is known. campaign: as it was
    read, by the controller too; undecided: as of `ControllerView`.
    """
    measured = [s.name for s in plant.signals]
    period, held = PERIOD * rules.thinning, [r.log.table.columns for r in campaign.logs.values()]
    views = build_views(plant, measured, cache, period, rules, Measured(held=held))
    return [*views, ControllerView(commanded(campaign.logs), undecided)]


def commanded(runs: Mapping[str, LoggedRun]) -> dict[str, LoggedRun]:
    """Runs whose controller reads no channel that they lack; such channels are NaN."""
    found = {}
    for name, run in runs.items():
        missing = [c for c in MEASURED if c not in run.log]
        if missing:
            table = run.log.table.assign(**dict.fromkeys(missing, np.nan))
            run = replace(run, log=replace(run.log, table=table))
            commands = recomputed_commands(run, run.log.measured())
            if commands is None or not np.isfinite(commands).any():
                continue
        found[name] = run
    return found
