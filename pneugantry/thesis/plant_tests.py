"""Conclusions 9 and 14, from tests on the plant alone: stationary z force and root locus; and the
lag identification of App. C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.force_loop import force_loop
from pneugantry.analysis.root_locus import root_locus
from pneugantry.thesis.conclusions import Conclusion
from pneugantry.thesis.conditions import Choice
from pyfmi_runner.fmu import FmuFile, FmuSession

__all__ = [
    "Hysteresis",
    "LagStep",
    "drawn_friction",
    "friction_conclusion",
    "hysteresis",
    "identified_lags",
    "lag_steps",
    "locus_conclusion",
]

Array = NDArray[np.float64]
STEP, HOLD = 0.1, 6.0  # V, s: the staircase of the constrained open-loop test, §4.2.2
FIRST, LAST = 0.8, 1.6  # V
READ_OFF_SPAN = 22.0  # N, F_z of the experiment from -12 to +10 (Fig. 4.14)
SPAN_TOLERANCE = 0.25  # of that span
DRAWN = {  # friction of the z axis that a rig may have instead: spans of draws
    "axis_z.friction.beta": (9.0, 15.0),  # N
    "axis_z.friction.sigma": (5e4, 2e5),  # N/m
    "axis_z.friction.F_s": (17.0, 23.0),  # N, Table C.2
    "axis_z.friction.F_d": (14.0, 16.0),  # N, Table C.2
}
LAG_BY_POSITION = {
    "valve_x.tau": 0.25,
    "valve_x.lag_low": 0.49 / 0.25,
    "valve_x.lag_high": 0.145 / 0.25,
}  # Tables 4.1-4.3
SHARE = 0.65  # of the steady force, §4.1.3
SETTLING, STEP_PERIOD = 6.0, 1e-3  # s, of a lag test


@dataclass(frozen=True)
class Hysteresis:
    """Constrained open-loop test on z, every 10 ms: command up and down in steps, piston against
    the straight edge.
    """

    time: Array  # s
    u_z: Array  # V
    z: Array  # m
    v_z: Array  # m/s
    f_z: Array  # N
    f_az: Array  # N
    friction: Array  # N, f_az - f_z - F_w as Eq. 4-6 finds it, > 0 against +z

    @property
    def span(self) -> float:
        """Largest less smallest friction in contact [N]."""
        return float(np.ptp(self.friction[self.f_z > 1.0]))

    @property
    def creep(self) -> float:
        """Share of the steps that move the piston by more than 1 um: a displacement dependent
        friction yields at each.
        """
        ends = self.z[self.f_z > 1.0][:: round(HOLD / 0.01)]
        return float(np.mean(np.abs(np.diff(ends)) > 1e-6)) if len(ends) > 1 else 0.0


def staircase() -> Array:
    """u_z [V] at each step of the test."""
    up = np.arange(FIRST, LAST + 0.5 * STEP, STEP)
    return np.concatenate([up, up[-2::-1]])


def hysteresis(fmu: FmuFile, law: float, choice: Choice, **parameters: float) -> Hysteresis:
    """The test with a friction law on z; x clamped."""
    plant = (
        choice.plant()
        | {"contact.z_0": 0.04, "axis_z.s_start": 0.04, "axis_z.friction.law": law}
        | parameters
    )
    levels, period = staircase(), 0.01
    names = ("z", "v_z", "f_z", "f_az")
    rows, commands = [], np.repeat(levels, round(HOLD / period))
    with FmuSession(fmu, parameters=plant) as session:
        session.set("clamp_x", True)
        for level in commands.tolist():
            rows.append(session.get(names))
            session.set("u_z", level)
            session.step(period)
    z, v_z, f_z, f_az = np.array(rows, dtype=np.float64).T
    time = period * np.arange(len(z), dtype=np.float64)
    return Hysteresis(time, commands, z, v_z, f_z, f_az, f_az - f_z - choice.cable_z)


def drawn_friction(draw: int) -> dict[str, float]:
    """Friction parameters of a draw; 0: the choice's own."""
    rng = np.random.default_rng((414, draw))
    drawn = {name: float(rng.uniform(*span)) for name, span in DRAWN.items()}
    return drawn if draw else {}


def friction_conclusion(ddfm: Hysteresis, vdfm: Hysteresis) -> Conclusion:
    """Conclusion 9, against what Fig. 4.14 shows of the experiment: span of F_z, and motion at
    every step.
    """
    off = {
        name: abs(test.span - READ_OFF_SPAN) / READ_OFF_SPAN
        for name, test in (("DDFM", ddfm), ("VDFM", vdfm))
    }
    numbers = {
        "span, experiment (Fig. 4.14)": READ_OFF_SPAN,
        "span, DDFM": ddfm.span,
        "span, VDFM": vdfm.span,
        "off, DDFM": off["DDFM"],
        "off, VDFM": off["VDFM"],
        "steps that move it, DDFM": ddfm.creep,
        "steps that move it, VDFM": vdfm.creep,
    }
    holds = off["DDFM"] < SPAN_TOLERANCE and off["DDFM"] < 0.5 * off["VDFM"] and ddfm.creep == 1.0
    return Conclusion(
        9, "the DDFM matches the stationary z-force test much better than the VDFM", holds, numbers
    )


def locus_conclusion(fmu: FmuFile, choice: Choice) -> Conclusion:
    """Conclusion 14 with a choice's contact."""
    contact = {name: choice.plant()[name] for name in ("contact.K_c", "contact.C_c")}
    without = root_locus(force_loop(fmu, "z", "none", parameters=contact))
    numbers: dict[str, float] = {"limits without lag": float(without.limit is not None)}
    limits = []
    for lag in ("z", "x"):
        limit = root_locus(force_loop(fmu, "z", lag, parameters=contact)).limit
        limits.append(limit)
        numbers[f"limit gain [V/N], lag of {lag}"] = float("inf") if limit is None else limit.gain
    holds = without.limit is None and all(limit is not None for limit in limits)
    return Conclusion(
        14,
        "z force loop: stable for every gain without lag, unstable above a finite gain with it",
        holds,
        numbers,
    )


@dataclass(frozen=True)
class LagStep:
    """A step of the command with the piston clamped, every millisecond from the step on."""

    force: Array  # N, actuator force
    before: float  # N
    command: tuple[float, float]  # V, before and after

    @property
    def lag(self) -> float:
        """Time [s] to 65 % of the step."""
        risen = (self.force - self.before) / (self.force[-1] - self.before)
        return float(np.argmax(risen >= SHARE) + 1) * STEP_PERIOD


def identified_lags(fmu: FmuFile) -> dict[str, float]:
    """The steps of Tables 4.1-4.5 run on the plant with the position dependent tau_x (off in the
    nominal): what the test finds where the truth is known. No evidence for conclusion 15: the
    tables went in.
    """
    return {name: step.lag for name, step in lag_steps(fmu).items()}


def lag_steps(fmu: FmuFile) -> dict[str, LagStep]:
    """The tests behind `identified_lags` (App. C.2), by "tau_AXIS at PLACE m, WAY"."""
    found = {}
    for axis, where, first, high in (
        ("x", 1.0, 0.65, 1.35),
        ("x", 0.5, 0.65, 1.35),
        ("x", 0.0, 0.65, 1.35),
        ("z", 0.1, 0.85, 1.6),
        ("z", 0.0, 0.85, 1.6),
    ):
        for way, (u_0, u_1) in (("filling", (first, high)), ("exhausting", (high, first))):
            found[f"tau_{axis} at {where:g} m, {way}"] = _lag_step(fmu, axis, where, (u_0, u_1))
    return found


def _lag_step(fmu: FmuFile, axis: str, where: float, command: tuple[float, float]) -> LagStep:
    with FmuSession(
        fmu, parameters=LAG_BY_POSITION | {f"axis_{axis}.s_start": where, "contact.present": 0.0}
    ) as session:
        session.set(f"clamp_{axis}", True)
        session.set(f"u_{axis}", command[0])
        session.step(SETTLING)
        before = session.get(f"f_a{axis}")
        session.set(f"u_{axis}", command[1])
        force = []
        for _ in range(round(SETTLING / STEP_PERIOD)):
            session.step(STEP_PERIOD)
            force.append(session.get(f"f_a{axis}"))
    return LagStep(np.array(force), float(before), command)
