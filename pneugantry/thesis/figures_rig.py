"""Figures of chapter 3, and of what chapter 4 and Appendix C measured on the rig: ours beside them
is the same run, or the same test of a part, on the FMU.
"""

from __future__ import annotations

import numpy as np

from pneugantry.analysis.plots_thesis import Drawing, Panel
from pneugantry.thesis.conditions import MOTION_START, Run
from pneugantry.thesis.figures_tracking import TIME, close_up, tracking_panels
from pneugantry.thesis.pictured import COMPENSATED, DRAWN, SPEEDS, rig_speed_run
from pneugantry.thesis.plant_tests import LagStep, lag_steps
from pneugantry.thesis.rig_tests import RAMPS, THRESHOLD, BreakAway, break_away, rest_signals
from pneugantry.thesis.runner import Results
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.sensors import NO_STEPS, SIGMA, converter_steps

__all__ = ["part_drawings", "speed_drawings", "tracked_drawings"]

CLOSE_UP = {  # s, of Figs. 4.27 and 4.29
    "straight": (MOTION_START + 0.4, MOTION_START + 3.0),
    "curved": (MOTION_START + 3.0, MOTION_START + 6.5),
}
TRACKED = {
    "fig_3_30_4_26_4_27_straight": "straight",
    "fig_3_31_incline_7": "incline_7",
    "fig_3_32_incline_16": "incline_16",
    "fig_3_33_4_28_4_29_curved": "curved",
}
SHOWN = 1.0  # s, of a lag test
REST = 300  # samples of a signal at rest that are drawn


def speed_drawings(results: Results) -> dict[str, Drawing]:
    """Figs. 3.26-3.29: Tables 3.9 and 3.10."""
    found = {}
    for name, (piece, speed) in SPEEDS.items():
        trace = results.trace(rig_speed_run(piece, speed))
        panels = tracking_panels({"PI FV": trace}, -speed)[:2]
        title = f"Fig. {_number(name)}: {piece} edge, {speed:g} m/s, gains of Table 3.7"
        found[name] = (panels, title, 1)
    return found


def _number(name: str) -> str:
    """Of "fig_3_26_curved_medium": 3.26."""
    return ".".join(name.split("_")[1:3])


def tracked_drawings(results: Results) -> dict[str, Drawing]:
    """Figs. 3.30-3.34 and 4.26-4.29: the measured edge, gains of Table 3.11."""
    found: dict[str, Drawing] = {}
    for name, piece in TRACKED.items():
        trace = results.trace(Run(piece))
        panels = tracking_panels({"PI FV": trace})
        if piece in CLOSE_UP:
            panels.append(close_up({"PI FV": trace}, *CLOSE_UP[piece]))
        title = f"Fig. {_number(name)}: {piece}, finish of the measured edge, gains of Table 3.11"
        found[name] = (panels, title, 1)
    pair = {
        "PI FV": results.trace(Run("straight")),
        "with VDFM compensator": results.trace(COMPENSATED),
    }
    title = "Fig. 3.34: VDFM compensator, straight edge"
    return found | {"fig_3_34_vdfm": (tracking_panels(pair)[:2], title, 1)}


def part_drawings(results: Results, fmu: FmuFile) -> dict[str, Drawing]:
    """Figs. 3.5, 4.3 to 4.7 and C.3 to C.13: noise, finish, lags and Coulomb friction, by the
    thesis' tests on the FMU.
    """
    return {
        "fig_3_5_4_6_noise": _noise(),
        "fig_4_5_4_7_finish": _finish(results),
        "fig_4_3_4_4_C_9_C_13_lag_steps": _lags(lag_steps(fmu)),
        "fig_C_3_C_8_saw_tooth": _saw_teeth(
            {axis: [break_away(fmu, axis, rate) for rate in RAMPS] for axis in "xz"}
        ),
    }


def _noise() -> Drawing:
    """A channel of each kind at rest, ideal and behind the converter."""
    shown = {"z [mm]": (1, 1e3), "v_z [mm/s]": (3, 1e3), "f_z [N]": (5, 1.0), "f_az [N]": (7, 1.0)}
    signals = {
        "ideal": rest_signals(NO_STEPS),
        "12-bit converter": rest_signals(converter_steps()),
    }
    time = 1e-3 * np.arange(REST)
    panels = []
    for label, (channel, scale) in shown.items():
        for kind, values in signals.items():
            course = scale * values[:, channel]
            rms = float(np.sqrt(np.mean(course**2)))
            note = f"{kind}: RMS {rms:.3g}, Table 3.3 {scale * SIGMA[channel]:g}"
            panels.append(Panel(TIME, label, {kind: (time, course[:REST])}, note=note))
    return panels, "Figs. 3.5, 4.6: signals at rest", 2


def _finish(results: Results) -> Drawing:
    moving = {}
    for name, run in (("random angle (§4.1.5), a draw", DRAWN), ("fitted waves", Run("straight"))):
        trace = results.trace(run)
        rows = trace.time >= MOTION_START
        moving[name] = (trace.time[rows], np.degrees(trace.theta[rows]))
    panels = [
        Panel(TIME, "theta [deg]", {name: curve}, y_range=(-3.5, 3.5), note=name)
        for name, curve in moving.items()
    ]
    return panels, "Figs. 4.5, 4.7: angle of the surface finish, straight edge", 1


def _lags(steps: dict[str, LagStep]) -> Drawing:
    by_place: dict[str, dict[str, LagStep]] = {}
    for name, step in steps.items():
        place, way = name.removeprefix("tau_").split(", ")
        by_place.setdefault(place, {})[way] = step
    panels = []
    for place, ways in by_place.items():
        rows = round(SHOWN / 1e-3) if place.startswith("z") else round(2.0 * SHOWN / 1e-3)
        curves = {
            f"{way}, 65 % after {step.lag:.3f} s": (
                1e-3 * np.arange(1, rows + 1),
                step.force[:rows],
            )
            for way, step in ways.items()
        }
        panels.append(Panel(TIME, f"f_a{place[0]} [N]", curves, note=place))
    return panels, "Figs. 4.3, 4.4, C.9-C.13: steps of the command, piston held", 2


def _saw_teeth(tests: dict[str, list[BreakAway]]) -> Drawing:
    panels = []
    for axis, found in tests.items():
        for rate, test in zip(RAMPS, found, strict=True):
            time, _, force, speed = test.course.T
            note = (
                f"{axis}, {rate:g} V/s: F_s {test.static:.1f} N, F_d {test.dynamic:.1f} N, read at "
                f"{THRESHOLD:g} m/s"
            )
            curves = {f"f_a{axis} [N]": (time, force), "speed [cm/s]": (time, 100.0 * speed)}
            panels.append(Panel(TIME, "N, cm/s", curves, note=note))
    return panels, "Figs. C.3-C.8: break-away and stop under a saw tooth", 2
