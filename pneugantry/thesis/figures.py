"""The figures that carry the thesis' argument, from a finished study."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pneugantry.analysis.plots import save
from pneugantry.analysis.plots_thesis import Drawing, Panel, panels_figure
from pneugantry.thesis.conclusions import ANGLE_ERRORS, angle_run
from pneugantry.thesis.conditions import MOTION_START, Run
from pneugantry.thesis.edge import before_stroke_end, valve_runs
from pneugantry.thesis.figures_rig import part_drawings, speed_drawings, tracked_drawings
from pneugantry.thesis.figures_tracking import TIME, close_up, smooth, tracking_panels
from pneugantry.thesis.gain_course import scheduled_course
from pneugantry.thesis.leaderboard import NEW
from pneugantry.thesis.plant_tests import READ_OFF_SPAN
from pneugantry.thesis.printed import WORKPIECES
from pneugantry.thesis.scores import Trace
from pneugantry.thesis.study import Study
from pyfmi_runner.fmu import FmuFile

__all__ = ["draw_figures"]

CLOSE_UP = (23.6, 24.0)  # s, of Fig. 4.33
REVERSALS = {"4_32_4_33": "4.32, 4.33", "4_34": "4.34", "4_35": "4.35", "4_36": "4.36"}


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
            f"fig_{number}_reversals_{piece}": _reversals(
                study.results.trace(Run(piece)), piece, REVERSALS[number]
            )
            for number, piece in zip(REVERSALS, WORKPIECES, strict=True)
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
            Panel(
                "z [mm]",
                "F_z [N]",
                {name: (1e3 * test.z[rows], test.friction[rows])},
                note=f"{name}: F_z spans {test.span:.0f} N, Fig. 4.14 about {READ_OFF_SPAN:.0f} N",
            )
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
    names = ("one-directional", "bidirectional")
    traces = {
        name: before_stroke_end(study.results.trace(run))
        for name, run in zip(names, valve_runs(), strict=True)
    }
    panels = tracking_panels(traces)
    title = "Fig. 4.30: one-directional and bidirectional valves, up to the end of the z stroke"
    return panels[:3], title, 1


def _angle_errors(study: Study) -> Drawing:
    traces = {f"{e:g} deg": study.results.trace(angle_run(e)) for e in ANGLE_ERRORS}
    panels = tracking_panels(traces)
    return panels[:2], "Fig. 4.31: error in theta, straight edge", 1


def _reversals(trace: Trace, piece: str, number: str) -> Drawing:
    rows = trace.time >= MOTION_START
    time, f_n = trace.time[rows], trace.f_n[rows]
    z, theta = smooth(trace.z[rows]), smooth(trace.theta[rows])
    turns = np.flatnonzero(np.diff(np.sign(theta))) + 1  # v_z = v_x tan(theta)
    panels = [
        Panel(TIME, "z [mm]", {"z": (time, 1e3 * z)}, (time[turns], 1e3 * z[turns])),
        Panel(TIME, "f_n [N]", {"f_n": (time, f_n)}, (time[turns], f_n[turns])),
        Panel(TIME, "theta [deg]", {"theta": (time, np.degrees(trace.theta[rows]))}),
        Panel(TIME, "command [V]", {"u_z": (time, trace.u_z[rows])}),
        Panel(TIME, "f_az [N]", {"f_az": (time, trace.f_az[rows])}),
    ]
    if piece == "straight":  # Fig. 4.33
        panels.append(close_up({"PI FV": trace}, *CLOSE_UP))
    said = "f_n errs where z turns (circles)" if len(turns) else "z does not turn: f_n errs once"
    return panels, f"Fig. {number}: {said}, {piece}", 1


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
        [Panel(TIME, "f_n [N]", curves, x_range=span)],
        "Fig. 5.5: lag and perfect friction compensation",
        1,
    )


def _networks(study: Study) -> dict[str, Drawing]:
    pairs = {
        "fig_5_13_5_14_ebpa_zero": ("Figs. 5.13, 5.14", "straight", "pi_fv_ebpa_zero"),
        "fig_5_15_5_16_ebpa": ("Figs. 5.15, 5.16", "straight", "pi_fv_ebpa"),
        "fig_5_17_5_18_mbpm": ("Figs. 5.17, 5.18", "straight", "pi_fv_mbpm"),
        "fig_5_19_5_20_mbpm_curved": ("Figs. 5.19, 5.20", "curved", "pi_fv_mbpm"),
        "beyond_straight": ("Beyond the thesis", "straight", NEW),
        "beyond_curved": ("Beyond the thesis", "curved", NEW),
    }
    drawings = {}
    for figure, (number, piece, name) in pairs.items():
        traces = {
            "PI FV": study.results.trace(Run(piece)),
            name: study.results.trace(Run(piece, name)),
        }
        panels = [*tracking_panels(traces), close_up(traces, MOTION_START, MOTION_START + 3.0)]
        drawings[figure] = (panels, f"{number}: {name} beside PI FV, {piece} edge", 1)
    return drawings
