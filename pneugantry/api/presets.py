"""Conditions of runs by name: those of the campaigns, and those of the thesis' tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from modelica_fmu.errors import InputError
from pneugantry.analysis.metrics import Metrics, tracking_metrics
from pneugantry.api.preset_names import PRESETS
from pneugantry.thesis.conditions import CHOICE, Run, scenario_of
from pneugantry.thesis.scores import score_log
from pneugantry.thesis.settings import CONVERTER
from pyfmi_runner.log import Log
from pyfmi_runner.scenario import Scenario

__all__ = ["Conditions", "conditions"]


class Conditions(NamedTuple):
    """A scenario, and how its run is scored."""

    scenario: Scenario
    score: Callable[[Log], Metrics]


def conditions(preset: str, workpiece: str | None, controller: str | None) -> Conditions:
    """The conditions of a preset. Raises InputError for an unknown one."""
    if preset not in PRESETS:
        raise InputError(
            f"unknown preset {preset!r}", field="--preset", hint=f"use {' or '.join(PRESETS)}"
        )
    named = controller or "pi_fv"
    edge = workpiece or "curved"
    if preset == "campaign":
        return Conditions(Scenario(workpiece=edge, controller=named), tracking_metrics)
    sensors = CONVERTER.sensors if preset == "thesis_converter" else ()
    scenario = scenario_of(Run(workpiece=edge, controller=named, sensors=sensors))
    return Conditions(replace(scenario, controller=named, name=preset), _thesis_score)


def _thesis_score(log: Log) -> Metrics:
    """Over the window that begins before the speed is asked for, against the printed set points."""
    f_nd, v_td = float(log["f_nd"][-1]), float(log["v_td"][-1])
    scores = score_log(log, quiet=CHOICE.quiet, v_td=v_td, f_nd=f_nd)
    return Metrics(scores.rmse_fn, scores.me_fn, scores.rmse_vt, scores.me_vt)
