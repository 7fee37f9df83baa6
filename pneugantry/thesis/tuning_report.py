"""The tuning series as JSON, lines and pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from controllers.gains import PidGains
from pneugantry.analysis.plots import save
from pneugantry.analysis.plots_thesis import Panel, panels_figure
from pneugantry.thesis.axis_loops import LOOPS
from pneugantry.thesis.tuning import (
    HOLD,
    SERIES,
    STEP,
    TRACKS,
    Response,
    Series,
    Track,
    Tuning,
)

__all__ = ["draw_tuning", "picture_paths", "tuning_lines", "tuning_report"]

EVERY = 5  # samples of a picture
UNITS = {"v": "m/s", "f": "N"}


def tuning_report(tuning: Tuning) -> dict[str, Any]:
    """The JSON, `thesis_tuning/1`; an infinite rise time is null."""
    return {
        "schema": "thesis_tuning/1",
        "responses": [
            {
                "figure": r.series.figure,
                "loop": r.series.loop,
                "gains": r.gains._asdict(),
                "set_point": r.scale * r.series.set_point,
                "kept": r.series.judged and r.gains == r.series.gains[0],
                "rise": None if math.isinf(r.rise) else r.rise,
                "overshoot": r.overshoot,
                "unrest": r.unrest,
            }
            for r in tuning.responses
        ],
        "beaten": {
            s.figure: sum(bool(found) for found in tuning.kept(s).values())
            for s in SERIES
            if s.judged
        },
        "tracks": [
            {
                "figure": t.figure,
                "text": t.text,
                "rmse_still": t.rmse(moving=False),
                "rmse_moving": t.rmse(),
            }
            for t in tuning.tracks
        ],
        "without_cable": {"span": tuning.without_cable.span},
    }


def _gains(gains: PidGains) -> str:
    tail = f", K_d {gains.k_d:g}" if gains.k_d else ""
    return f"K_p {gains.k_p:g}, K_i {gains.k_i:g}{tail}"


def tuning_lines(tuning: Tuning) -> Iterator[str]:
    yield "Step 1 (Figs. 3.14, 4.8, E.2-E.13): one loop alone; the thesis kept the gains marked >"
    yield f"  {'figure, loop, gains':<48}{'to 90 %':>10}{'overshoot':>11}{'unrest':>9}"
    for series in SERIES:
        for response in tuning.of(series.figure):
            yield _response_line(response)
        if series.judged:
            yield f"      {_verdict(tuning, series)}"
    yield "\nSteps 2 and 3, materials, angles (Figs. 3.15-3.25): RMSE of the force [N]"
    for t in tuning.tracks:
        still, moving = t.rmse(moving=False), t.rmse()
        yield f"  {t.figure:<12}{t.text:<42}at rest {still:.2f}, in motion {moving:.2f}"
    span = tuning.without_cable.span
    yield f"\nFig. 4.15, no cable: f_az - f_z (Eq. 4-7) spans {span:.1f} N as f_az goes up and down"


def _response_line(r: Response) -> str:
    mark = ">" if r.series.judged and r.gains == r.series.gains[0] else " "
    what = f"{r.series.figure}, {r.series.loop}, {_gains(r.gains)}"
    rise = "never" if math.isinf(r.rise) else f"{r.rise:.2f} s"
    return f"{mark} {what:<48}{rise:>10}{r.overshoot:>11.0%}{r.unrest:>9.2f}"


def _verdict(tuning: Tuning, series: Series) -> str:
    """Whether another gain of the figure is both faster and calmer, at each set point."""
    beaten = {
        scale * series.set_point: [_gains(r.gains) for r in found]
        for scale, found in tuning.kept(series).items()
    }
    unit = UNITS[series.loop[0]]
    words = [
        f"{point:g} {unit}: {' and '.join(rivals) if rivals else 'none'}"
        for point, rivals in beaten.items()
    ]
    return "faster and calmer than the kept: " + "; ".join(words)


def draw_tuning(tuning: Tuning, out: Path) -> list[Path]:
    """A picture a figure."""
    drawings = [
        *(
            (_step_panels(tuning.of(s.figure)), f"{s.figure}: {s.loop} loop alone, thesis' gains")
            for s in SERIES
        ),
        *((_track_panels(t), f"{t.figure}: {t.text}") for t in tuning.tracks),
        (_cable_panels(tuning), "4.15: open-loop test without the cable"),
    ]
    paths = picture_paths(out)
    for (panels, title), path in zip(drawings, paths, strict=True):
        save(panels_figure(panels, f"Fig. {title}"), path)
    return paths


def picture_paths(out: Path) -> list[Path]:
    """Where `draw_tuning` writes."""
    names = [f"{_file(s.figure)}_{s.loop}_tuning" for s in SERIES]
    names += [f"{_file(figure)}_tuning" for figure in TRACKS]
    return [out / f"fig_{name}.png" for name in [*names, "4_15_without_cable"]]


def _file(figure: str) -> str:
    return figure.replace(".", "_").replace(", ", "_")


def _cable_panels(tuning: Tuning) -> list[Panel]:
    test = tuning.without_cable
    forces = {"f_az": (test.time, test.f_az), "f_z": (test.time, test.f_z)}
    return [
        Panel("time [s]", "u_z [V]", {"u_z": (test.time, test.u_z)}),
        Panel("time [s]", "force [N]", forces),
        Panel("time [s]", "f_az - f_z [N]", {"F_z": (test.time, test.friction)}),
    ]


def _step_panels(responses: list[Response]) -> list[Panel]:
    series = responses[0].series
    command = f"u_{LOOPS[series.loop]}"
    shown = slice(round(0.8 * STEP * 1000), None, EVERY)
    courses = {
        _gains(r.gains): (r.run.time[shown], r.run.of(series.loop)[shown]) for r in responses
    }
    commands = {_gains(r.gains): (r.run.time[shown], r.run.of(command)[shown]) for r in responses}
    time = responses[0].run.time[shown]
    courses["wanted"] = (time, np.where(time >= STEP, series.set_point, 0.0))
    return [
        Panel("time [s]", f"{series.loop} [{UNITS[series.loop[0]]}]", courses),
        Panel("time [s]", f"{command} [V]", commands),
    ]


def _track_panels(track: Track) -> list[Panel]:
    time = track.run.time[::EVERY]
    wanted = {
        track.force: np.full(len(time), track.f_d),
        track.speed: np.where(time >= HOLD, track.v_d, 0.0),
    }
    return [
        Panel(
            "time [s]",
            f"{name} [{UNITS[name[0]]}]",
            {name: (time, track.course(name)[::EVERY]), "wanted": (time, line)},
        )
        for name, line in wanted.items()
    ]
