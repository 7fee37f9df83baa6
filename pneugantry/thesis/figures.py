"""The figures that carry the thesis' argument, from a finished study."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.plots import save
from pneugantry.analysis.plots_thesis import Drawing, Panel, panels_figure
from pneugantry.thesis.conclusions import ANGLE_ERRORS, angle_run
from pneugantry.thesis.conditions import MOTION_START, Run
from pneugantry.thesis.edge import valve_runs
from pneugantry.thesis.figures_rig import part_drawings, speed_drawings, tracked_drawings
from pneugantry.thesis.figures_tracking import TIME, tracking_panels
from pneugantry.thesis.gain_course import scheduled_course
from pneugantry.thesis.leaderboard import NEW
from pneugantry.thesis.printed import WORKPIECES
from pneugantry.thesis.scores import Trace
from pneugantry.thesis.study import Study
from pyfmi_runner.fmu import FmuFile

__all__ = ["draw_figures"]


def draw_figures(study: Study, fmu: FmuFile, out: Path) -> list[Path]:
    """Writes them all; returns their paths."""
    figures = {
        **speed_drawings(study.results),
        **tracked_drawings(study.results),
        **part_drawings(study.results, fmu),
        "fig_4_10_4_18_friction_models": _friction_models(study),
        "fig_4_14_4_17_hysteresis": _hysteresis(study),
        "fig_4_20_anfis": _anfis(study),
        **{
            f"fig_{number}_{piece}": (
                tracking_panels({"PI FV": study.results.trace(Run(piece, finish="modelled"))}),
                f"Fig. {number.replace('_', '.')}: simulation, {piece}",
                1,
            )
            for number, piece in zip(("4_22", "4_23", "4_24", "4_25"), WORKPIECES, strict=True)
        },
        "fig_4_30_valves": _valves(study),
        "fig_4_31_angle_error": _angle_errors(study),
        **{
            f"fig_{number}_reversals_{piece}": _reversals(study.results.trace(Run(piece)), piece)
            for number, piece in zip(("4_32_4_33", "4_34", "4_35", "4_36"), WORKPIECES, strict=True)
        },
        "fig_5_1_5_3_scheduler": _scheduler(study),
        "fig_5_5_perfect_compensator": _perfect(study),
        **_networks(study),
    }
    paths = []
    for name, (panels, title, columns) in figures.items():
        path = out / f"{name}.png"
        save(panels_figure(panels, title, columns), path)
        paths.append(path)
    return paths


def _friction_models(study: Study) -> Drawing:
    panels = []
    for law in ("VDFM", "DDFM"):
        curves = {
            name.split(", ")[1]: curve
            for name, curve in study.plant.stationary.items()
            if name.startswith(law)
        }
        panels.append(Panel(TIME, "f_z [N]", curves, note=f"{law}, stationary force control on z"))
    return panels, "Fig. 4.10, 4.18: friction model and stationary z force", 1


def _hysteresis(study: Study) -> Drawing:
    panels = []
    for name, test in study.plant.friction.items():
        rows = test.f_z > 0.5
        panels.append(
            Panel("z [mm]", "F_z [N]", {name: (1e3 * test.z[rows], test.friction[rows])}, note=name)
        )
        panels.append(Panel("f_az [N]", "F_z [N]", {name: (test.f_az[rows], test.friction[rows])}))
    return panels, "Fig. 4.14, 4.17: hysteresis of the constrained open-loop test", 2


def _anfis(study: Study) -> Drawing:
    fit = study.plant.anfis
    touching = np.flatnonzero(fit.rig.f_z[1:] > 0.5) + 1
    panels = []
    for label, rig, rule in (
        ("z [mm]", 1e3 * fit.rig.z, 1e3 * fit.ddfm.z),
        ("f_az [N]", fit.rig.f_az, fit.ddfm.f_az),
    ):
        curves = {
            "rig (LuGre)": (rig[touching], fit.rig.friction[touching]),
            "rule based DDFM": (rule[touching], fit.ddfm.friction[touching]),
            "ANFIS": (rig[touching], fit.anfis),
        }
        panels.append(Panel(label, "F_z [N]", curves))
    return (
        panels,
        f"Fig. 4.20: ANFIS {fit.rmse_anfis:.2f} N, rule based DDFM {fit.rmse_ddfm:.2f} N "
        f"RMSE off line",
        2,
    )


def _valves(study: Study) -> Drawing:
    one, both = (study.results.trace(run) for run in valve_runs())
    panels = tracking_panels({"one-directional": one, "bidirectional": both})
    return panels[:3], "Fig. 4.30: one-directional and bidirectional valves", 1


def _angle_errors(study: Study) -> Drawing:
    traces = {f"{e:g} deg": study.results.trace(angle_run(e)) for e in ANGLE_ERRORS}
    panels = tracking_panels(traces)
    return panels[:2], "Fig. 4.31: error in theta, straight edge", 1


def _reversals(trace: Trace, piece: str) -> Drawing:
    rows = trace.time >= MOTION_START
    time, f_n = trace.time[rows], trace.f_n[rows]
    z, theta = (
        _smooth(trace.z[rows]),
        _smooth(trace.theta[rows]),
    )  # the position's noise of 0.1 mm hides the finish
    turns = np.flatnonzero(np.diff(np.sign(theta))) + 1  # v_z = v_x tan(theta)
    panels = [
        Panel(TIME, "z [mm]", {"z": (time, 1e3 * z)}, (time[turns], 1e3 * z[turns])),
        Panel(TIME, "f_n [N]", {"f_n": (time, f_n)}, (time[turns], f_n[turns])),
        Panel(TIME, "theta [deg]", {"theta": (time, np.degrees(trace.theta[rows]))}),
        Panel(TIME, "command [V]", {"u_z": (time, trace.u_z[rows])}),
        Panel(TIME, "f_az [N]", {"f_az": (time, trace.f_az[rows])}),
    ]
    return panels, f"Fig. 4.32-4.36: f_n errs where z turns (circles), {piece}", 1


def _smooth(values: NDArray[np.float64], window: int = 15) -> NDArray[np.float64]:
    """Moving mean over `window` samples of 10 ms, the ends held."""
    padded = np.pad(values, window // 2, mode="edge")
    return np.convolve(padded, np.ones(window) / window, mode="valid")


def _scheduler(study: Study) -> Drawing:
    fixed, scheduled = (
        study.results.trace(Run("curved", name)) for name in ("pi_fv", "pi_fv_scheduled")
    )
    panels = tracking_panels({"fixed gains": fixed, "gain scheduler": scheduled})
    panels += [
        Panel(TIME, name, {name: (scheduled.time, values)})
        for name, values in scheduled_course(scheduled.theta).items()
    ]
    return panels, "Fig. 5.1-5.3: gain scheduler on the curved edge", 1


def _perfect(study: Study) -> Drawing:
    curves = {
        "PI FV, with lag": (
            study.results.trace(Run("straight")).time,
            study.results.trace(Run("straight")).f_n,
        )
    }
    for name, run in study.perfect.items():
        rows = run.time >= MOTION_START - 1.0
        curves[f"perfect compensator, {name}"] = (run.time[rows][::10], run.f_n[rows][::10])
    span = (MOTION_START - 1.0, float(run.time[-1]))
    return (
        [Panel(TIME, "f_n [N]", curves, x_range=span, y_range=(5.0, 50.0))],
        "Fig. 5.5: lag and perfect friction compensation",
        1,
    )


def _networks(study: Study) -> dict[str, Drawing]:
    pairs = {
        "fig_5_13_5_14_ebpa_zero": ("straight", "pi_fv_ebpa_zero"),
        "fig_5_15_5_16_ebpa": ("straight", "pi_fv_ebpa"),
        "fig_5_17_5_18_mbpm": ("straight", "pi_fv_mbpm"),
        "fig_5_19_5_20_mbpm_curved": ("curved", "pi_fv_mbpm"),
        "beyond_straight": ("straight", NEW),
        "beyond_curved": ("curved", NEW),
    }
    drawings = {}
    for figure, (piece, name) in pairs.items():
        traces = {
            "PI FV": study.results.trace(Run(piece)),
            name: study.results.trace(Run(piece, name)),
        }
        drawings[figure] = (tracking_panels(traces), f"{name} beside PI FV, {piece} edge", 1)
    return drawings
