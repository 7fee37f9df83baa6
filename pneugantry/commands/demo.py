"""`pneugantry demo`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from analysis.metrics import tracking_metrics
from pneugantry.commands.replay import print_replay, replay_campaign
from pneugantry.page import Section, write_page
from pneugantry.progress import bar, loop_progress
from pyfmi_runner.build import ROOT, build_fmu
from pyfmi_runner.campaign import Campaign, LoggedRun, read_campaign, scenario_setup, write_campaign
from pyfmi_runner.errors import RunError
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import write_log
from pyfmi_runner.replay import Replayer
from pyfmi_runner.run import RunResult, run_scenario
from pyfmi_runner.scenario import Scenario

HELP = """The main job, from nothing: build the FMU, track the curved edge, replay a measured campaign, write a report.

  pneugantry demo                            replays a campaign that the demo measures itself on a rig of its own
  pneugantry demo --campaign FOLDER          replays yours"""

WORKPIECES = ("straight", "incline_7", "incline_16", "incline_30", "curved")
HEAD = ["edge", "f_n RMSE [N]", "f_n ME [N]", "v_t RMSE [m/s]", "v_t ME [m/s]"]
# The demo's own rig: its valve and contact are off by what nobody has told the model.
RIG = {"valve_z.tau": 0.165, "contact.K_c": 1.1e4, "axis_z.friction.F_d": 14.0}


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("--campaign", metavar="FOLDER", type=Path, help="measured campaign to replay")
    command.add_argument("--out", metavar="DIR", type=Path, default=Path("out/demo"), help="folder of the report (default: %(default)s)")


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from analysis.plots import figure_data_uri, overlay_figure, save, tracking_figure

    built = build_fmu()
    print(f"FMU: {built.path.relative_to(ROOT)} ({'built' if built.rebuilt else 'up to date'})")
    fmu = FmuFile.read(built.path)
    results = {name: _tracked(fmu, name) for name in bar(WORKPIECES, len(WORKPIECES), "track")}
    rows = []
    for name, result in results.items():
        metrics = tracking_metrics(result.log)
        rows.append([name, f"{metrics.rmse_fn:.2f}", f"{metrics.me_fn:.1f}", f"{metrics.rmse_vt:.3f}", f"{metrics.me_vt:.3f}"])
        print(f"tracked {name:<11} f_n RMSE {rows[-1][1]} N, ME {rows[-1][2]} N; v_t RMSE {rows[-1][3]} m/s, ME {rows[-1][4]} m/s")
    curved = tracking_figure(results["curved"].log, "curved edge, PI force/velocity controller")
    save(curved, options.out / "tracking.png")
    write_log(results["curved"].log, options.out / "curved.parquet")
    campaign = read_campaign(options.campaign) if options.campaign else _measure(fmu, options.out / "campaign")
    print(f"\nreplay of {campaign.name}:")
    logs = replay_campaign(campaign, fmu)
    print_replay(logs)
    shown = max(logs, key=lambda name: logs[name]["gap"])
    run = campaign.logs[shown]
    with Replayer(fmu) as plant:
        curves = {"nominal": plant.simulate(run)}
    overlay = overlay_figure(run.log.time, run.log.measured(), curves, f"{shown}: recorded commands replayed")
    blocks = sorted({b for entry in logs.values() for b in entry["blocks"]})
    sections = [
        Section("Tracking, simulated with sensors on", table=(HEAD, rows),
                figure=figure_data_uri(curved)),
        Section(f"Replay of {campaign.name}", "Gap: RMS of (measured - simulated)/sigma; 1 is the noise floor. Blocks: gap/floor.",
                table=(["log", "plant", *blocks], _gap_rows(logs, blocks)), figure=figure_data_uri(overlay)),
    ]  # fmt: skip
    page = write_page(options.out / "report.html", "PneuGantry demo", sections)
    print(f"\nreport: {page}")
    return {"schema": "demo/1", "report": str(page), "logs": logs}, 0


def _gap_rows(logs: dict[str, dict[str, Any]], blocks: list[str]) -> list[list[str]]:
    return [[name, f"{entry['gap']:.2f}", *(_cell(entry, block) for block in blocks)] for name, entry in logs.items()]


def _cell(entry: dict[str, Any], block: str) -> str:
    value = entry["blocks"].get(block)
    return "" if value is None else f"{value['gap']:.2f}/{value['floor']:.2f}"


def _tracked(fmu: FmuFile, workpiece: str) -> RunResult:
    result = run_scenario(Scenario(name=workpiece, workpiece=workpiece, seed=1), fmu, progress=loop_progress(workpiece))
    if result.outcome != "done":
        raise RunError(f"tracking {workpiece} {result.outcome}: {result.reason}")
    return result


def _measure(fmu: FmuFile, folder: Path) -> Campaign:
    """A campaign of the demo's own rig: the same experiments on a plant that differs from the model."""
    logs = {}
    for name in ("straight", "curved"):
        scenario = Scenario(name=f"contour_{name}", workpiece=name, plant=RIG, seed=2)
        logs[scenario.name] = LoggedRun(scenario_setup(replace(scenario, plant={})), run_scenario(scenario, fmu).log)
    campaign = Campaign("the demo's own rig", folder, logs)
    write_campaign(campaign, folder)
    return campaign
