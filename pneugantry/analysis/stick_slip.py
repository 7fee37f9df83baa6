"""Stick-slip of the x axis under its PI velocity loop (Eq. 3-3) with the stick band of the VDFM
(Eq. 3-18, 3-19): predicted, checked.

Prediction: the FMU is linearised in each of its modes (stick, break-away, sliding either way);
between the modes' own switches the closed loop is affine, so that it is carried from switch to
switch by the matrix exponential. Starting at break-away, where speed and actuator force are known,
one number is free, the integral; its return map has a fixed point where there is a limit cycle.
Check: the same loop co-simulated. The controller is taken as continuous in the prediction (its
period is a thousandth of the cycle's).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

from controllers.gains import PidGains, gains_named
from controllers.valve import U_0X
from modelica_fmu.errors import RunError
from pneugantry.analysis.gantry_points import CENTRE
from pneugantry.analysis.operating_point import OperatingPoint, open_at
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.sensors import SensorParams

__all__ = ["LimitCycle", "StickSlip", "cosimulated_cycle", "predicted_cycle"]

Array = NDArray[np.float64]
Mode = tuple[str, bool]  # of the friction; valve open
STICK, BREAK, SLIDE, BACK = "stick", "break-away", "slide", "slide back"
GRID = 2e-3  # s between looks for a switch
LONGEST = 60.0  # s, of one cycle
ROUNDS = 40  # of the return map
STEADY = 1e-6  # s, change of the period from round to round


@dataclass(frozen=True)
class LimitCycle:
    """One steady stick-slip oscillation."""

    period: float  # s
    peak: float  # m/s, largest |v|
    stuck: float  # share of the period within the stick band
    time: Array  # s, from break-away
    speed: Array  # m/s, < 0 tracks towards -x


@dataclass(frozen=True)
class StickSlip:
    """x axis in free motion under its velocity loop; v_td [m/s] < 0."""

    file: FmuFile
    v_td: float
    gains: PidGains = gains_named("table_4_6").v_x
    parameters: tuple[tuple[str, float], ...] = ()

    @cached_property
    def command(self) -> Array:
        """Row that gives u [V] = u_0 - K_p (v_td - v) - I from (v, f_a, I, 1)."""
        return np.array([self.gains.k_p, 0.0, -1.0, U_0X - self.gains.k_p * self.v_td])

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Stick band [m/s], break-away force [N], cable force [N] and the voltage at which the
        valve opens.
        """
        names = ("axis_x.friction.v_th", "axis_x.friction.F_s", "axis_x.F_w", "valve_x.u_0")
        band, hold, f_w, u_0 = (self.value(name) for name in names)
        return band, hold, f_w, u_0

    @cached_property
    def modes(self) -> dict[Mode, Array]:
        """Rate matrix of (v, f_a, I, 1) in each mode, controller included: dz/dt = M z, from the
        FMU's derivatives there.
        """
        band, hold, _, u_0 = self.bounds
        at = {
            STICK: (-0.5 * band, 0.0),
            BREAK: (-0.5 * band, -2 * hold),
            SLIDE: (-4 * band, 0.0),
            BACK: (4 * band, 0.0),
        }
        return {
            (mode, valve): self._affine(v, f, u_0 + (0.2 if valve else -0.2))
            for mode, (v, f) in at.items()
            for valve in (True, False)
        }

    def value(self, name: str) -> float:
        return float(dict(self.parameters).get(name, self.file.variables[name].start or 0.0))

    def _affine(self, v: float, f_net: float, u: float) -> Array:
        """The mode that holds at speed v [m/s], net force f_net [N] and command u [V]."""
        f_a = f_net + self.bounds[2]
        states = {"axis_x.s": CENTRE["x"], "axis_x.v": v, "valve_x.f_a": f_a}
        point = OperatingPoint(
            states, {"u_x": u}, {**dict(self.parameters), "contact.present": 0.0}
        )
        rates, knowns = ["der(axis_x.v)", "der(valve_x.f_a)"], ["axis_x.v", "valve_x.f_a", "u_x"]
        with open_at(self.file, point) as session:
            jacobian, now = session.jacobian(rates, knowns), session.get(rates)
        matrix = np.zeros((4, 4))
        matrix[:2, :2], matrix[:2, 3] = jacobian[:, :2], now - jacobian @ np.array([v, f_a, u])
        matrix[:2] += np.outer(jacobian[:, 2], self.command)
        matrix[2] = [
            -self.gains.k_i,
            0.0,
            0.0,
            self.gains.k_i * self.v_td,
        ]  # dI/dt = K_i (v_td - v)
        return matrix

    def mode_at(self, z: Array) -> Mode:
        """Mode of a state, by the model's own relations."""
        band, hold, f_w, u_0 = self.bounds
        valve, f_net = bool(self.command @ z > u_0), z[1] - f_w
        if abs(z[0]) > band:
            return (SLIDE if z[0] < 0 else BACK), valve
        if f_net > hold:
            raise RunError(
                "the axis breaks away backwards: the prediction covers one direction only"
            )
        return (BREAK if f_net < -hold else STICK), valve

    def indicators(self, z: Array) -> Array:
        """What changes sign at a switch: the band's two edges, the break-away force, the valve's
        opening.
        """
        band, hold, f_w, u_0 = self.bounds
        return np.array([z[0] + band, z[0] - band, z[1] - f_w + hold, self.command @ z - u_0])


def predicted_cycle(axis: StickSlip) -> LimitCycle | None:
    """The limit cycle as the fixed point of the return map from break-away to break-away; None
    where the axis comes to slide evenly.
    """
    _, hold, f_w, _ = axis.bounds
    z, last = np.array([0.0, f_w - hold, 0.0, 1.0]), 0.0
    z[2] = (f_w - hold) / axis.value(
        "valve_x.K"
    ) - axis.gains.k_p * axis.v_td  # a first integral: the command holds the force
    for _ in range(ROUNDS):
        found = _one_cycle(axis, z)
        if found is None:
            return None
        z, cycle = found
        if abs(cycle.period - last) < STEADY:
            return cycle
        last = cycle.period
    raise RunError(f"no steady cycle after {ROUNDS} rounds at v_td = {axis.v_td:g} m/s")


def _one_cycle(axis: StickSlip, z: Array) -> tuple[Array, LimitCycle] | None:
    """From one break-away to the next: the state there and the cycle; None if the axis does not
    stick again.
    """
    times, speeds, now, stuck = [0.0], [float(z[0])], 0.0, 0.0
    mode, has_slid = (BREAK, True), False
    steps = {name: expm(matrix * GRID) for name, matrix in axis.modes.items()}
    while now < LONGEST:
        after, used = steps[mode] @ z, GRID
        if axis.mode_at(after) != mode:
            after, used = _switch(axis, mode, z, after)
        stuck += used if mode[0] in (STICK, BREAK) else 0.0
        now, z = now + used, after
        times.append(now)
        speeds.append(float(z[0]))
        previous, mode = mode, axis.mode_at(z)
        has_slid = has_slid or mode[0] == SLIDE
        if has_slid and previous[0] == STICK and mode[0] == BREAK:
            speed = np.array(speeds)
            return z, LimitCycle(
                now, float(np.abs(speed).max()), stuck / now, np.array(times), speed
            )
    return None


def _switch(axis: StickSlip, mode: Mode, z: Array, after: Array) -> tuple[Array, float]:
    """State just behind the first switch on the way from z to `after`, and the time to it [s]."""
    matrix = axis.modes[mode]
    first = GRID
    for i in np.flatnonzero(np.sign(axis.indicators(z)) * np.sign(axis.indicators(after)) < 0):

        def indicator(t: float, i: int = int(i)) -> float:
            return float(axis.indicators(expm(matrix * t) @ z)[i])

        first = min(first, float(brentq(indicator, 0.0, GRID, xtol=1e-12)))
    behind = min(first + 1e-9, GRID)
    return expm(matrix * behind) @ z, behind


def cosimulated_cycle(axis: StickSlip, duration: float = 12.0) -> LimitCycle | None:
    """The same axis co-simulated from rest with its sampled controller, noise off; None where it
    comes to slide evenly.

    Mean over the cycles of the second half of `duration` s.
    """
    result = run_scenario(_scenario(axis, duration), axis.file)
    if result.outcome != "done":
        raise RunError(result.reason)
    time, speed = result.log.time, result.log["v_x"]
    late = time > time[-1] - 0.5 * duration
    time, speed = time[late], speed[late]
    band = axis.value("axis_x.friction.v_th")
    away = np.flatnonzero((np.abs(speed[:-1]) <= band) & (np.abs(speed[1:]) > band))
    if len(away) < 2:
        return None
    span = slice(away[0], away[-1])
    period = float(time[away[-1]] - time[away[0]]) / (len(away) - 1)
    within = float(np.mean(np.abs(speed[span]) <= band))
    return LimitCycle(
        period, float(np.abs(speed[span]).max()), within, time[span] - time[away[0]], speed[span]
    )


def _scenario(axis: StickSlip, duration: float) -> Scenario:
    gains = {f"K{kind}_{loop}": 0.0 for loop in ("vx", "fz", "fx", "vz") for kind in "pi"}
    gains |= {"Kp_vx": axis.gains.k_p, "Ki_vx": axis.gains.k_i}
    return Scenario(
        workpiece="straight",
        start_x=0.95,
        f_nd=0.0,
        v_td=axis.v_td,
        gains=gains,
        approach_u_z=0.0,
        clamped=("x until contour", "z"),
        phases={
            "approach": (0.0, 0.01),
            "contact": (0.01, 0.02),
            "contour": (0.02, 0.02 + duration),
        },
        plant={**dict(axis.parameters)},
        sensors=SensorParams(noise=False),
    )
