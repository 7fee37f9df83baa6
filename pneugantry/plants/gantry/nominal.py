"""The gantry that a campaign is compared with, where it is not the shipped one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from modelica_fmu.errors import InputError, RunError
from pyfmi_runner.campaign import LoggedRun
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.replay import SIGMAS, Replayer

__all__ = ["Nominal", "parameters_of"]

ALIKE = 0.5  # RMS in units of the sensors' noise by which two FMUs of the same equations may differ


@dataclass(frozen=True)
class Nominal:
    """fmu: the nominal gantry where its parameters are not the model's own; model: the gantry's
    Modelica file where a learnt term stands in it.
    """

    fmu: FmuFile | None = None
    model: Path | None = None


def parameters_of(fmu: FmuFile, own: FmuFile, run: LoggedRun) -> dict[str, float]:
    """Parameters of `fmu` that differ from those of `own`, the FMU of the model that views are cut
    from. The equations must be those of that model: `run` is replayed by both. Raises InputError
    where they are not.
    """
    if fmu.sha256 == own.sha256:
        return {}
    hint = "build it from the gantry's model: its parameters may differ, its equations may not"
    found = {}
    for name, variable in own.variables.items():
        if variable.causality != "parameter":
            continue
        if name not in fmu.variables:
            raise InputError(f"has no parameter {name}", file=fmu.path, field="--fmu", hint=hint)
        start = fmu.variables[name].start
        if start is not None and start != variable.start:
            found[name] = float(start)
    try:
        with Replayer(fmu) as other, Replayer(own) as ours:
            apart = (other.simulate(run) - ours.simulate(run, found)) / SIGMAS
    except RunError as error:
        raise InputError(str(error), file=fmu.path, field="--fmu", hint=hint) from None
    if not np.sqrt(np.mean(apart**2)) < ALIKE:
        text = f"does not replay {run.log.name} as the gantry's model with the same parameters does"
        raise InputError(text, file=fmu.path, field="--fmu", hint=hint)
    return found
