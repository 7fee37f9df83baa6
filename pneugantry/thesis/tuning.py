"""The tuning of §3.4 and §4.2.1, run again on the plant: every gain of Figs. 3.14, 4.8 and
E.2 to E.13 (step 1, one loop alone), Figs. 3.15 and 3.16 (step 2, pairs in the fixed frame),
Fig. 3.17 (step 3), the angles of Figs. 3.22 to 3.24, and the open-loop test of Fig. 4.15.

Gains and spans of time are the figures'. Their set points are not printed: those of step 1 lie
within the figures' axes and are halved and doubled too, so that a verdict does not hang on them.
A vertical edge is no z_w(x): Figs. 3.16 and 3.24 (90, 92 degrees) run at the model's steepest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.gains import TABLE_3_5, TABLE_3_6, PidGains
from controllers.interface import Command, Reference, Sense
from controllers.pi_fv import PiFv
from pneugantry.thesis.axis_loops import LOOPS, AxisLoop, Driven, drive, drive_loops
from pneugantry.thesis.conditions import CHOICE, DDFM
from pneugantry.thesis.plant_tests import Hysteresis, hysteresis
from pyfmi_runner.fmu import FmuFile

__all__ = ["SCALES", "SERIES", "TRACKS", "Response", "Series", "Track", "Tuning", "run_tuning"]

Array = NDArray[np.float64]
STEP = 0.5  # s, when the set point comes
SCALES = (1.0, 0.5, 2.0)  # of the set point; the first is drawn
FASTER, CALMER = 0.05, 0.05  # a rival must be better by this share, so that noise decides nothing
REACHED = 0.9  # of the set point
INCLINED, STEEPEST = 2.0, 1.5  # Types.EdgeShape; rad, the model's largest slope angle, 86 degrees
WALL_EDGE = {"workpiece.shape": INCLINED, "workpiece.incline": STEEPEST}
CURVED = {"workpiece.shape": 3.0, "contact.z_0": 0.09, "axis_z.s_start": 0.09}
# of the fitted finish's heights: what comes nearest to the RMSE that Table 3.8 prints
WOOD, ALUMINIUM, STEEL = 0.25, 0.5, 1.5
F_ND, V_TD = 30.0, 0.06  # N, m/s
HOLD = 5.0  # s of stationary contact before the motion; not printed

FREE = {"contact.present": 0.0}
TOUCHING = {"contact.z_0": 0.04, "axis_z.s_start": 0.04}
WALL = {**TOUCHING, **WALL_EDGE, "axis_x.s_start": 0.95}


class Series(NamedTuple):
    """Gains of one figure, the others off and the other axis clamped."""

    figure: str
    loop: str  # a key of LOOPS
    gains: tuple[PidGains, ...]  # the first is the one that the thesis kept
    set_point: float  # N or m/s, not printed
    seconds: float
    judged: bool = True  # the thesis kept the first


def _varied(
    loop: str, gain: str, values: tuple[float, ...], **fixed: float
) -> tuple[PidGains, ...]:
    kept = getattr(TABLE_3_5, loop)._replace(**fixed)
    return (kept, *(kept._replace(**{gain: value}) for value in values))


SERIES = (
    Series("3.14", "v_x", _varied("v_x", "k_i", (8.0, 2.0)), -0.1, 3.0),
    Series("E.2", "v_x", _varied("v_x", "k_p", (0.4, 0.1)), -0.1, 3.0),
    Series("E.4", "f_z", _varied("f_z", "k_p", (0.16, 0.04)), 10.0, 12.0),
    Series("E.5", "f_z", _varied("f_z", "k_i", (0.2, 0.05)), 10.0, 12.0),
    Series("E.7", "f_x", _varied("f_x", "k_p", (0.04, 0.01)), -20.0, 10.0),
    Series("E.8", "f_x", _varied("f_x", "k_i", (0.06, 0.01)), -20.0, 20.0),
    Series("E.9", "f_x", _varied("f_x", "k_d", (0.01, 0.005)), -20.0, 20.0),
    Series("E.11", "v_z", _varied("v_z", "k_p", (0.5, 0.125), k_d=0.0), 0.05, 1.9),
    Series("E.12", "v_z", _varied("v_z", "k_i", (12.0, 3.0), k_d=0.0), 0.05, 1.9),
    Series("E.13", "v_z", _varied("v_z", "k_d", (0.0, 0.1)), 0.05, 1.9),
    Series(
        "4.8, 4.9", "v_x", tuple(PidGains(0.5, k) for k in (8.0, 4.0, 2.0)), -0.1, 6.0, judged=False
    ),
)
TRACKS = ("3.15", "3.16", "3.17, 3.19", "3.20", "3.21", "3.22", "3.23", "3.24", "3.25")
PLANTS = {"v_x": FREE, "f_z": TOUCHING, "f_x": WALL, "v_z": {**FREE, "axis_z.s_start": 0.002}}


@dataclass(frozen=True)
class Response:
    """A step of one loop; everything relative to the set point."""

    series: Series
    gains: PidGains
    scale: float
    run: Driven

    @property
    def course(self) -> Array:
        return self.run.of(self.series.loop) / (self.scale * self.series.set_point)

    @property
    def rise(self) -> float:
        """Time [s] from the step to 90 % of the set point; infinite where it is never reached."""
        there = np.flatnonzero(self.course >= REACHED)
        return float(self.run.time[there[0]]) - STEP if len(there) else math.inf

    @property
    def overshoot(self) -> float:
        """Largest value beyond the set point; 0 where there is none."""
        return max(float(self.course.max()) - 1.0, 0.0)

    @property
    def unrest(self) -> float:
        """Standard deviation over the last third."""
        return float(np.std(self.course[-len(self.course) // 3 :]))

    def beats(self, other: Response) -> bool:
        """Faster and calmer, both clearly."""
        faster = self.rise < (1.0 - FASTER) * other.rise
        return faster and self.overshoot < other.overshoot - CALMER


@dataclass(frozen=True)
class Track:
    """Stationary contact, then contouring."""

    figure: str
    text: str
    force: str  # what is drawn and scored: "f_n", "f_z", "f_x"
    speed: str
    f_d: float  # N
    v_d: float  # m/s
    run: Driven

    def course(self, name: str) -> Array:
        """A force [N] or speed [m/s]; f_n from both forces, v_t from both speeds."""
        if name == "f_n":
            return np.hypot(self.run.of("f_x"), self.run.of("f_z"))
        if name == "v_t":
            return np.hypot(self.run.of("v_x"), self.run.of("v_z")) * math.copysign(1.0, self.v_d)
        return self.run.of(name)

    def rmse(self, *, moving: bool = True) -> float:
        """Of the force [N], in motion or in the second before."""
        time = self.run.time
        rows = time >= HOLD if moving else (time >= HOLD - 1.0) & (time < HOLD)
        return float(np.sqrt(np.mean((self.course(self.force)[rows] - self.f_d) ** 2)))


@dataclass(frozen=True)
class Tuning:
    responses: list[Response]
    tracks: list[Track]
    without_cable: Hysteresis  # Fig. 4.15: the constrained open-loop test with F_w = 0 on z

    def of(self, figure: str, scale: float = 1.0) -> list[Response]:
        return [r for r in self.responses if r.series.figure == figure and r.scale == scale]

    def kept(self, series: Series) -> dict[float, list[Response]]:
        """By scale of the set point, the responses that beat the gains that the thesis kept."""
        found = {}
        for scale in SCALES:
            first, *others = self.of(series.figure, scale)
            found[scale] = [r for r in others if r.beats(first)]
        return found


def run_tuning(fmu: FmuFile) -> Tuning:
    """All of it, in this process; about 100 runs. Raises RunError where the FMU fails."""
    responses = [
        Response(series, gains, scale, step_response(fmu, series, gains, scale))
        for series in SERIES
        for scale in (SCALES if series.judged else SCALES[:1])
        for gains in series.gains
    ]
    bare = replace(CHOICE, cable_z=0.0)
    return Tuning(responses, tracks(fmu), hysteresis(fmu, DDFM, bare))


def step_response(fmu: FmuFile, series: Series, gains: PidGains, scale: float) -> Driven:
    """From rest, the set point at `STEP`."""
    loop = AxisLoop(series.loop, gains, scale * series.set_point, STEP)
    other = "z" if LOOPS[series.loop] == "x" else "x"
    plant = CHOICE.plant() | PLANTS[series.loop]
    return drive_loops(fmu, plant, [loop], STEP + series.seconds, other)


def tracks(fmu: FmuFile, figures: Sequence[str] = TRACKS) -> list[Track]:
    """Step 2, step 3, materials and angles; a material is the fitted finish at another height."""
    wood = _finish(WOOD)
    tasks: dict[str, tuple[str, dict[str, float], float, float]] = {
        "3.17, 3.19": ("wood", wood, 6.5, -V_TD),
        "3.20": ("steel", _finish(STEEL), 6.5, -V_TD),
        "3.21": ("aluminium", _finish(ALUMINIUM), 6.5, -V_TD),
        "3.22": ("wood, 3 degrees", wood | _slope(3.0), 6.5, -V_TD),
        "3.23": ("wood, -10 degrees", _low(wood | _slope(-10.0)), 5.0, -V_TD),
        "3.24": ("wood, 86 degrees", _low(wood | WALL_EDGE), 1.5, V_TD),
        "3.25": ("steel, curved", _finish(STEEL) | CURVED, 6.5, -V_TD),
    }
    pairs = {
        "3.15": (("f_z", F_ND), ("v_x", -V_TD), TOUCHING | wood, 6.5),
        "3.16": (("f_x", -F_ND), ("v_z", V_TD), _low(WALL), 2.4),
    }
    return [
        _pair(fmu, figure, *pairs[figure])
        if figure in pairs
        else _task(fmu, figure, *tasks[figure])
        for figure in figures
    ]


def _finish(share: float) -> dict[str, float]:
    heights = enumerate(CHOICE.measured.amplitude, start=1)
    return {f"workpiece.A[{k}]": share * a for k, a in heights}


def _slope(angle: float) -> dict[str, float]:
    """angle: degrees."""
    return {"workpiece.shape": INCLINED, "workpiece.incline": math.radians(angle)}


def _low(plant: dict[str, float]) -> dict[str, float]:
    """Contact at the lower end of the z stroke: the motion goes up."""
    return plant | {"contact.z_0": 0.005, "axis_z.s_start": 0.005}


def _pair(
    fmu: FmuFile,
    figure: str,
    force: tuple[str, float],
    speed: tuple[str, float],
    plant: dict[str, float],
    seconds: float,
) -> Track:
    """Two loops of Table 3.6 in the fixed frame; seconds: of motion."""
    loops = [
        AxisLoop(name, getattr(TABLE_3_6, name), value, start)
        for (name, value), start in ((force, 0.0), (speed, HOLD))
    ]
    run = drive_loops(fmu, CHOICE.plant() | plant, loops, HOLD + seconds)
    text = f"{force[0]} and {speed[0]}, Table 3.6"
    return Track(figure, text, force[0], speed[0], force[1], speed[1], run)


def _task(
    fmu: FmuFile,
    figure: str,
    text: str,
    edge: dict[str, float],
    seconds: float,
    v_td: float,
) -> Track:
    """PI FV in the task frame with Table 3.7; seconds: of motion."""
    controller = PiFv(gains="table_3_7")

    def law(time: float, sample: Sense) -> Command:
        return controller.step(Reference(F_ND, v_td if time >= HOLD else 0.0), sample)

    run = drive(fmu, CHOICE.plant() | TOUCHING | edge, law, HOLD + seconds)
    return Track(figure, f"PI FV, Table 3.7, {text}", "f_n", "v_t", F_ND, v_td, run)
