"""The thesis' tests of the rig's parts, done again on the FMU: break-away and stop of the cylinders
(App. C.1.1), viscous friction (Eq. C-3), noise at rest (Table 3.3).

The FMU's parameters are read off the same tables, so that these numbers show what each test's rule
gives where the truth is known; they are evidence for no conclusion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pneugantry.thesis.conditions import VDFM
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.log import PERIOD
from pyfmi_runner.sensors import Channels, SensorParams, initial_state, noise_rows, sense

__all__ = [
    "RAMPS",
    "BreakAway",
    "RestNoise",
    "break_away",
    "rest_noise",
    "rest_signals",
    "viscous",
]

THRESHOLD = 0.01  # m/s, C.1.1: speed that counts as motion
RAMPS = (0.1, 0.2, 0.3)  # V/s of the saw tooth; three, as in C.1.1, the rates not printed
THINNED = 10  # samples between two rows of a course
LONGEST = 60.0  # s, of a test
CABLE, OFFSET = 5.0, {"x": 0.635, "z": 0.735}  # N, F_w; V, u_0
GAIN = {"x": 186.0, "z": 100.0}  # N/V
WAY = {"x": -1.0, "z": 1.0}  # of the valves
PUSH = {"x": 15.0, "z": 2.0}  # N, beyond F_d + F_w, of the viscous test
SLIDE = {"x": 2.0, "z": 1.0}  # s: lag and mass are over, the stroke is not
SAMPLES, SEED = 5000, 33  # of the noise test
ZERO: Channels = (0.0,) * 8


class BreakAway(NamedTuple):
    """What Eq. C-1 and C-2 read off a saw tooth [N], and the saw tooth, every 10 ms."""

    static: float  # f_a - F_w as the piston starts
    dynamic: float  # f_a - F_w as it stops
    course: NDArray[np.float64]  # shape (samples, 4): time [s], command [V], f_a [N], speed [m/s]


class RestNoise(NamedTuple):
    """A channel at rest, Eq. 3-1."""

    rms: float  # in the channel's unit
    ratio: float  # dB, of the largest signal to it


def break_away(fmu: FmuFile, axis: str, rate: float) -> BreakAway:
    """Command ramped up at `rate` [V/s] until the piston moves, then down until it stops; no
    workpiece, the other axis clamped. Raises ValueError where it never moves or never stops.
    """
    command, way, static = OFFSET[axis], 1.0, math.nan
    rows: list[tuple[float, ...]] = []
    with _alone(fmu, axis) as session:
        for k in range(round(LONGEST / PERIOD)):
            command += way * rate * PERIOD
            session.set(f"u_{axis}", command)
            session.step(PERIOD)
            force, speed = session.get((f"f_a{axis}", f"v_{axis}"))
            moving = abs(speed) > THRESHOLD
            if k % THINNED == 0:
                rows.append((PERIOD * k, command, force, speed))
            if math.isnan(static) and moving:
                static, way = _net(force), -1.0
            elif not math.isnan(static) and not moving:
                return BreakAway(static, _net(force), np.array(rows))
    raise ValueError(f"axis {axis} did not start and stop within {LONGEST:g} s at {rate:g} V/s")


def viscous(fmu: FmuFile, axis: str, dynamic: float) -> float:
    """C [N s/m] by Eq. C-3: after the break-away the command is held at `PUSH` above F_d + F_w, and
    force and speed are read from the steady slide. dynamic: F_d [N], of `break_away`.

    Raises ValueError where the piston does not start.
    """
    command = OFFSET[axis]
    with _alone(fmu, axis) as session:
        for _ in range(round(LONGEST / PERIOD)):
            command += RAMPS[1] * PERIOD
            session.set(f"u_{axis}", command)
            session.step(PERIOD)
            if abs(session.get((f"v_{axis}",))[0]) > THRESHOLD:
                break
        else:
            raise ValueError(f"axis {axis} did not start within {LONGEST:g} s")
        session.set(
            f"u_{axis}", OFFSET[axis] + (dynamic + WAY[axis] * CABLE + PUSH[axis]) / GAIN[axis]
        )
        session.step(SLIDE[axis])
        force, speed = session.get((f"f_a{axis}", f"v_{axis}"))
    return (_net(force) - dynamic) / abs(float(speed))


def _net(force: float) -> float:
    """|f_a - F_w| [N]; the cable pulls towards smaller x and z, the x valve pushes there too."""
    return abs(float(force) - CABLE)


def _alone(fmu: FmuFile, axis: str) -> FmuSession:
    """No workpiece, the stick band's law, cables as `CABLE`."""
    parameters = {
        f"axis_{axis}.friction.law": VDFM,
        f"axis_{axis}.F_w": CABLE,
        "contact.present": 0.0,
    }
    return FmuSession(fmu, parameters=parameters)


def rest_noise(largest: Channels, quantum: Channels) -> list[RestNoise]:
    """RMS of every channel at rest and the ratio to its largest signal; quantum: the converter's
    steps.
    """
    values = rest_signals(quantum)
    rms = np.sqrt(np.mean(values**2, axis=0)).tolist()
    return [
        RestNoise(level, 20.0 * math.log10(signal / level))
        for level, signal in zip(rms, largest, strict=True)
    ]


def rest_signals(quantum: Channels) -> NDArray[np.float64]:
    """Every channel at rest, shape (samples, 8), a sample a millisecond."""
    params, state = SensorParams(quantum=quantum), initial_state()
    rows: NDArray[np.float64] = noise_rows(SAMPLES, SEED)
    return np.array([sense(params, state, ZERO, row)[1] for row in rows])
