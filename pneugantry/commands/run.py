"""`pneugantry run`."""

from __future__ import annotations

import argparse
import sys
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

from controllers.catalogue import controller_names
from modelica_fmu.errors import InputError
from pneugantry.analysis.metrics import tracking_metrics
from pneugantry.commands.options import log_target, picture_target
from pneugantry.progress import loop_progress
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.fmu_controller import FmuController
from pyfmi_runner.log import write_log
from pyfmi_runner.run import make_scenario_controller, run_scenario
from pyfmi_runner.scenario import Scenario, read_scenario, short_phases
from pyfmi_runner.workpiece import WORKPIECES, check_workpiece

HELP = """Track an edge in closed loop at 1 ms; print RMSE and maximum error of f_n and v_t over the contouring phase.

  pneugantry run                                   the curved edge, PI force/velocity controller
  pneugantry run --workpiece incline_16 --set contact.K_c=2e4 --plot out/run.png
  pneugantry run --workpiece my_edge.csv           columns x, z_w in metres
  pneugantry run scenario.toml --out out/run.parquet"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "scenario",
        nargs="?",
        metavar="SCENARIO.toml",
        help="scenario file (default: as the campaigns contour)",
    )
    command.add_argument(
        "--workpiece", metavar="NAME|FILE.csv", help=f"{', '.join(WORKPIECES)} or a CSV of x, z_w"
    )
    command.add_argument(
        "--controller",
        metavar="NAME|FILE.fmu",
        help=f"one of {', '.join(controller_names())}, or an FMU",
    )
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="PARAM=VALUE",
        help="plant parameter, may be repeated",
    )
    command.add_argument("--seed", type=int, help="of sensor noise and jitter")
    command.add_argument(
        "--out", metavar="LOG", type=log_target, help="write the log, .parquet or .csv"
    )
    command.add_argument(
        "--plot", metavar="FILE.png", type=picture_target, help="draw f_n, v_t, theta and z over x"
    )
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="another FMU with the gantry's interface"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    scenario = chosen_scenario(options)
    fmu = FmuFile.read(options.fmu or build_fmu().path)
    with own_controller(scenario) as controller:
        result = run_scenario(
            scenario, fmu, progress=loop_progress(scenario.name), controller=controller
        )
    if options.out:
        write_log(result.log, options.out)
        print(f"log: {options.out} ({len(result.log)} rows)")
    if options.plot:
        from pneugantry.analysis.plots import (
            save,
            tracking_figure,
        )  # matplotlib loads only when something is drawn

        save(
            tracking_figure(
                result.log, f"{scenario.name}: {scenario.workpiece}, {scenario.controller}"
            ),
            options.plot,
        )
        print(f"picture: {options.plot}")
    steps = len(result.log)
    simulated = steps * scenario.timing.period
    factor = simulated / result.seconds if result.seconds else 0.0
    report: dict[str, Any] = {
        "schema": "run/1",
        "metrics": None,
        "steps": steps,
        "seconds": result.seconds,
        "realtime_factor": factor,
    }
    if result.outcome != "done":
        print(f"pneugantry: the run {result.outcome}: {result.reason}", file=sys.stderr)
        return report | {"outcome": result.outcome, "reason": result.reason}, 1
    metrics = tracking_metrics(result.log)
    print(
        f"{scenario.workpiece}, {scenario.controller}: f_n RMSE {metrics.rmse_fn:.2f} N, "
        f"ME {metrics.me_fn:.1f} N;"
        f" v_t RMSE {metrics.rmse_vt:.3f} m/s, ME {metrics.me_vt:.3f} m/s  "
        f"({simulated:.0f} s in {result.seconds:.2f} s)"
    )
    return report | {"metrics": metrics._asdict()}, 0


def own_controller(scenario: Scenario) -> AbstractContextManager[FmuController | None]:
    """The controller of a scenario that names an FMU; None where it names one of ours."""
    return (
        FmuController(FmuFile.read(scenario.controller))
        if scenario.controller.endswith(".fmu")
        else nullcontext()
    )


def chosen_scenario(options: argparse.Namespace) -> Scenario:
    """The scenario of the file, with what the options change."""
    scenario = read_scenario(options.scenario) if options.scenario else Scenario()
    if options.scenario and not options.controller and not scenario.controller.endswith(".fmu"):
        make_scenario_controller(
            scenario, options.scenario
        )  # refused here, where its file is known
    changes: dict[str, Any] = {"plant": scenario.plant | parse_settings(options.set)}
    if options.workpiece:
        check_workpiece(options.workpiece)
        changes |= {"workpiece": options.workpiece, "standoff": None}
        if scenario.phases == short_phases(scenario.workpiece):
            changes["phases"] = short_phases(options.workpiece)
    if options.controller:
        changes["controller"] = options.controller
    if options.seed is not None:
        if options.seed < 0:
            raise InputError(
                f"is {options.seed}, expected >= 0",
                field="--seed",
                hint="choose a whole number from 0 on",
            )
        changes["seed"] = options.seed
    return replace(scenario, **changes)


def parse_settings(texts: list[str]) -> dict[str, float]:
    words = {"true": 1.0, "false": 0.0}
    settings = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        try:
            if not name:
                raise ValueError
            settings[name] = words[value.lower()] if value.lower() in words else float(value)
        except ValueError:
            raise InputError(
                f"{text!r} is no PARAM=VALUE",
                field="--set",
                hint="write for example --set contact.K_c=2e4",
            ) from None
    return settings
