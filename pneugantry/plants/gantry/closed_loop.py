"""A log's experiment run again with its controller on the gantry as the engine has fitted it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pneugantry.diagnosis.confirm import Augmented, closed_loop
from pneugantry.engine.sensors import PREFIX, neutral
from pyfmi_runner.campaign import LoggedRun
from pyfmi_runner.fmu import FmuFile

__all__ = ["augmented_of", "left_out", "rerun"]

FORCES = ("f_x", "f_z")


def rerun(fmu: FmuFile, run: LoggedRun, values: Mapping[str, float]) -> dict[str, float] | None:
    """Distances of f_n and v_t from the measured ones, in units of the noise: nominal, augmented,
    floor, shrink. `values`: as the engine names them. None where the log's controller is not known
    or it ends before contact. Raises ValueError for gains that the controller does not take.
    """
    return closed_loop(fmu, run, augmented_of(fmu, values))


def augmented_of(fmu: FmuFile, values: Mapping[str, float]) -> Augmented:
    """The engine's values as plant parameters, errors of the rig's sensors and delay of its loop.

    Force channels read their own force, each other's reading and an offset, r = G t + C r + b; the
    sensors of a run read the true forces, r = (I - C)^-1 (G t + b). A tachometer's delay adds to
    its lag.
    """
    known = {k: v for k, v in values.items() if k in fmu.variables}
    gain = np.diag([_of(values, f"{f}.scale") for f in FORCES])
    leak = np.array([[_of(values, f"{own}.from.{other}") for other in FORCES] for own in FORCES])
    offset = np.array([_of(values, f"{f}.bias") for f in FORCES])
    both = np.linalg.inv(np.eye(2) - leak)
    shares, biases = both @ gain, both @ offset
    sensors = {}
    for i, f in enumerate(FORCES):
        sensors[f"gain_{f}"] = shares[i, i]
        sensors[f"crosstalk_{f}"] = shares[i, 1 - i]
        sensors[f"bias_{f}"] = biases[i]
    for axis in "xz":
        sensors[f"gain_f_a{axis}"] = _of(values, f"f_a{axis}.scale")
        sensors[f"tau_v_{axis}"] = _of(values, f"v_{axis}.lag") + _of(values, f"v_{axis}.delay")
    named = {f"{PREFIX}{k}": float(v) for k, v in sensors.items()}
    return Augmented(known, named, values.get("timing.delay", 0.0))


def left_out(values: Mapping[str, float]) -> list[str]:
    """Sensors' errors that the sampled loop's sensors do not have, so that a re-run is without
    them.
    """
    taken = {f"{PREFIX}{f}.{what}" for f in FORCES for what in ("scale", "bias")}
    taken |= {f"{PREFIX}{a}.from.{b}" for a in FORCES for b in FORCES if a != b}
    taken |= {f"{PREFIX}v_{axis}.{what}" for axis in "xz" for what in ("lag", "delay")}
    taken |= {f"{PREFIX}f_a{axis}.scale" for axis in "xz"}
    return [
        name
        for name, value in sorted(values.items())
        if name.startswith(PREFIX) and name not in taken and value != neutral(name)
    ]


def _of(values: Mapping[str, float], what: str) -> float:
    return float(values.get(PREFIX + what, neutral(what)))
