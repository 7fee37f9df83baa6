"""How far the gap shrinks: command replay of a log that no fit has seen, and the same experiment
with the controller in the loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pneugantry.diagnosis.signals import sensed_forces
from pneugantry.diagnosis.tachometer import sensed_speed
from pyfmi_runner.campaign import LoggedRun, LogSetup
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED, PERIOD, Log
from pyfmi_runner.own_controller import controller_of, is_known_controller
from pyfmi_runner.replay import SIGMAS, Replayer
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.sensors import SensorParams
from pyfmi_runner.timing import LoopTiming

__all__ = ["Augmented", "GapResult", "closed_loop", "replay_gap", "sensed_outputs"]

Array = NDArray[np.float64]
BLOCK = 500  # samples, of the bootstrap
BOOTSTRAPS = 400
NOTHING = 0.05  # mean square beyond the floor below which there is no gap


@dataclass(frozen=True)
class Augmented:
    """A model with its effects: plant parameters, sensor errors and loop delay that differ from the
    nominal ones.
    """

    plant: Mapping[str, float]
    sensors: Mapping[str, float]
    delay: float = 0.0  # s

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Augmented:
        """From values by name, `sensors.*` and `timing.*` among them."""
        plant = {k: v for k, v in values.items() if not k.startswith(("sensors.", "timing."))}
        sensors = {k: v for k, v in values.items() if k.startswith("sensors.")}
        return cls(
            plant, sensors, values.get("timing.delay", 0.0) + values.get("timing.sense_delay", 0.0)
        )


@dataclass(frozen=True)
class GapResult:
    nominal: float
    augmented: float
    floor: float
    shrink: float
    ci95: tuple[float, float]
    channels: dict[str, tuple[float, float]]  # nominal, augmented
    curves: dict[str, Array]  # "nominal", "augmented": simulated channels (N, 8)


def sensed_outputs(true: Array, sensors: Mapping[str, float]) -> Array:
    """What sensors with the assumed errors, but no noise, say of the plant's outputs (N, 8)."""
    result: Array = np.array(true, dtype=np.float64)
    for column, axis in ((2, "x"), (3, "z")):
        result[:, column] = sensed_speed(true[:, column], axis, sensors)
        result[:, column + 4] *= sensors.get(f"sensors.gain_f_a{axis}", 1.0)
    result[:, 4:6] = sensed_forces(
        result[:, 4:6], np.arange(len(true), dtype=np.float64) * PERIOD, sensors
    )
    return result


def replay_gap(
    plant: Replayer, run: LoggedRun, augmented: Augmented, floor: float = 1.0
) -> GapResult:
    """Gap of one log under the nominal and the augmented model; shrink with a 95 % interval from a
    block bootstrap over time.
    """
    measured = run.log.measured()
    curves = {
        "nominal": plant.simulate(run),
        "augmented": sensed_outputs(plant.simulate(run, augmented.plant), augmented.sensors),
    }
    squares = {name: ((measured - curve) / SIGMAS) ** 2 for name, curve in curves.items()}
    means = {name: s.mean(axis=0) for name, s in squares.items()}
    channels = {
        c: (float(np.sqrt(means["nominal"][i])), float(np.sqrt(means["augmented"][i])))
        for i, c in enumerate(MEASURED)
    }
    nominal, after = (float(squares[name].mean()) for name in ("nominal", "augmented"))
    low, high = _bootstrap(
        squares["nominal"].mean(axis=1), squares["augmented"].mean(axis=1), floor
    )
    return GapResult(
        np.sqrt(nominal),
        np.sqrt(after),
        floor,
        _shrink(nominal, after, floor),
        (low, high),
        channels,
        curves,
    )


def _shrink(nominal: float, augmented: float, floor: float) -> float:
    if nominal - floor**2 < NOTHING:
        return 0.0  # nothing to shrink
    return 1.0 - max(augmented - floor**2, 0.0) / (nominal - floor**2)


def _bootstrap(nominal: Array, augmented: Array, floor: float) -> tuple[float, float]:
    n = max(len(nominal) // BLOCK, 1)
    a, b = (
        values[: n * (len(values) // n)].reshape(n, -1).mean(axis=1)
        for values in (nominal, augmented)
    )
    picks = np.random.default_rng(0).integers(0, n, (BOOTSTRAPS, n))
    shrinks = [_shrink(a[p].mean(), b[p].mean(), floor) for p in picks]
    return float(np.quantile(shrinks, 0.025)), float(np.quantile(shrinks, 0.975))


def closed_loop(fmu: FmuFile, run: LoggedRun, augmented: Augmented) -> dict[str, float] | None:
    """The log's experiment run again with its controller: RMS distance of f_n and v_t from the
    measured ones, in units of the noise.

    The floor is the distance of two re-runs of the augmented model with different noise. None where
    the log has no controller that is known, or ends before contact. Raises ValueError for gains
    that its controller does not take.
    """
    setup = run.setup
    if setup.loop != "closed" or setup.controller is None or "contour" not in setup.phases:
        return None
    measured = _task(run.log, setup)
    if not is_known_controller(setup.controller) or len(measured) < BLOCK:
        return None
    try:
        controller_of(setup.controller, setup.gains)
    except InputError as error:
        raise ValueError(str(error)) from None
    nominal = _task(run_scenario(_scenario(setup, Augmented({}, {}), 1), fmu).log, setup)
    first, second = (
        _task(run_scenario(_scenario(setup, augmented, seed), fmu).log, setup) for seed in (2, 3)
    )
    distances = {
        "nominal": _distance(measured, nominal),
        "augmented": _distance(measured, first),
        "floor": _distance(first, second),
    }
    shrink = _shrink(distances["nominal"] ** 2, distances["augmented"] ** 2, distances["floor"])
    return distances | {"shrink": shrink}


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
