"""A log's experiment run again with its controller on the gantry as the engine has fitted it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pneugantry.engine.answer.confirm import shrink_of
from pneugantry.engine.signals.sensors import PREFIX, neutral
from pneugantry.plants.gantry.timing import DELAYS
from pyfmi_runner.campaign import LoggedRun, LogSetup
from pyfmi_runner.controller_file import controller_of, is_known_controller
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import PERIOD, Log
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.sensors import SensorParams
from pyfmi_runner.timing import LoopTiming

__all__ = ["Augmented", "augmented_of", "left_out", "rerun"]

Array = NDArray[np.float64]
FORCES = ("f_x", "f_z")
NEEDED = (*FORCES, "v_x", "v_z")  # channels that the task is judged by
SHORTEST = 500  # rows of the task, from which on it is judged


@dataclass(frozen=True)
class Augmented:
    """A model with its effects: plant parameters, sensor errors and loop delay that differ from the
    nominal ones.
    """

    plant: Mapping[str, float]
    sensors: Mapping[str, float]  # "sensors.NAME" of `SensorParams`
    delay: float = 0.0  # s


def rerun(fmu: FmuFile, run: LoggedRun, values: Mapping[str, float]) -> dict[str, float] | None:
    """The log's experiment run again with its controller, nominal and on the gantry with `values`
    (as the engine names them): RMS distance of f_n and v_t from the measured ones, in units of the
    noise: nominal, augmented, floor, shrink.

    The floor is the distance of two re-runs of the augmented model with different noise. None where
    the log has no controller that is known, lacks a channel, or ends before contact. Raises
    ValueError for gains that its controller does not take.
    """
    setup = run.setup
    if setup.loop != "closed" or setup.controller is None or "contour" not in setup.phases:
        return None
    if not is_known_controller(setup.controller) or any(c not in run.log for c in NEEDED):
        return None
    measured = _task(run.log, setup)
    if len(measured) < SHORTEST:
        return None
    try:
        controller_of(setup.controller, setup.gains)
    except InputError as error:
        raise ValueError(str(error)) from None
    augmented = augmented_of(fmu, values)
    nominal = _task(run_scenario(_scenario(setup, Augmented({}, {}), 1), fmu).log, setup)
    first, second = (
        _task(run_scenario(_scenario(setup, augmented, seed), fmu).log, setup) for seed in (2, 3)
    )
    before, after = _distance(measured, nominal), _distance(measured, first)
    floor = _distance(first, second)
    shrink = shrink_of(before, after, floor)
    return {"nominal": before, "augmented": after, "floor": floor, "shrink": shrink}


def augmented_of(fmu: FmuFile, values: Mapping[str, float]) -> Augmented:
    """The engine's values as plant parameters, errors of the rig's sensors and delay of its loop.

    A force channel hears what the other makes of its force, r = (I + C) (G t + b); the sensors of
    a run read the true forces. A tachometer's delay adds to its lag.
    """
    known = {k: v for k, v in values.items() if k in fmu.variables}
    gain = np.diag([_of(values, f"{f}.scale") for f in FORCES])
    leak = np.array([[_of(values, f"{own}.from.{other}") for other in FORCES] for own in FORCES])
    offset = np.array([_of(values, f"{f}.bias") for f in FORCES])
    both = np.eye(2) + leak
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
    return Augmented(known, named, sum(values.get(name, 0.0) for name in DELAYS))


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


def _scenario(setup: LogSetup, augmented: Augmented, seed: int) -> Scenario:
    known: dict[str, Any] = {k.removeprefix("sensors."): v for k, v in augmented.sensors.items()}
    sensors = SensorParams()._replace(
        **{k: v for k, v in known.items() if k in SensorParams._fields}
    )
    options: dict[str, Any] = {"gains": setup.gains} if setup.gains is not None else {}
    if setup.approach_command is not None:
        options |= {
            "approach_u_x": setup.approach_command[0],
            "approach_u_z": setup.approach_command[1],
        }
    return Scenario(
        name="closed loop",
        workpiece=setup.workpiece,
        standoff=setup.z_0,
        surface_finish=setup.surface_finish,
        start_x=setup.start_x,
        start_z=setup.start_z,
        f_nd=float(setup.f_nd or 0.0),
        v_td=float(setup.v_td or 0.0),
        controller=setup.controller or "pi_fv",
        phases=setup.phases,
        clamped=setup.clamped,
        plant=dict(augmented.plant),
        sensors=sensors,
        seed=seed,
        timing=LoopTiming(delay=augmented.delay),
        **options,
    )


def _task(log: Log, setup: LogSetup) -> Array:
    """f_n, v_t (n, 2) over the contact and contouring phases, from measured signals."""
    first = round((setup.phases["contact"][0]) / PERIOD) if "contact" in setup.phases else 0
    last = min(round(setup.phases["contour"][1] / PERIOD), len(log))
    f_x, f_z = log["f_x"][first:last], log["f_z"][first:last]
    theta = np.where(np.hypot(f_x, f_z) < 2.0, 0.0, np.arctan2(-f_x, f_z))
    return np.column_stack(
        [
            np.hypot(f_x, f_z),
            log["v_x"][first:last] * np.cos(theta) + log["v_z"][first:last] * np.sin(theta),
        ]
    )


def _distance(a: Array, b: Array) -> float:
    n = min(len(a), len(b))
    return float(np.sqrt(np.mean(((a[:n] - b[:n]) / np.array([0.05, 1e-3])) ** 2)))
