"""`pneugantry demo`."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from modelica_fmu.errors import RunError
from pneugantry.commands.diagnose import print_diagnosis
from pneugantry.options import out_folder
from pneugantry.progress import Stages, bar, loop_progress

if TYPE_CHECKING:
    from pyfmi_runner.fmu import FmuFile
    from pyfmi_runner.run import RunResult

HELP = """The main job, from nothing: build the FMU, track the edges, diagnose a rig that does
not match the model, write a report.

  pneugantry demo  a rig drawn on the truth plant, with an effect that the diagnosis is not told
  pneugantry demo --seed 4                   another one
  pneugantry demo --campaign FOLDER          yours"""

WORKPIECES = ("straight", "incline_7", "incline_16", "incline_30", "curved")
SEED = 1  # of the rig


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--campaign", metavar="FOLDER", type=Path, help="measured campaign to diagnose instead"
    )
    command.add_argument(
        "--seed", metavar="N", type=int, default=SEED, help="draws the rig (default: %(default)s)"
    )
    command.add_argument(
        "--out",
        metavar="DIR",
        type=out_folder,
        default=Path("out/demo"),
        help="folder of the report (default: %(default)s)",
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.analysis.metrics import tracking_metrics
    from pneugantry.analysis.plots import save, tracking_figure
    from pneugantry.api.diagnosis import diagnose
    from pyfmi_runner.build import build_fmu
    from pyfmi_runner.campaign import DRIVEN, read_campaign
    from pyfmi_runner.fmu import FmuFile
    from pyfmi_runner.log import write_log

    built = build_fmu()
    print(f"FMU: {built.path} ({'built' if built.rebuilt else 'up to date'})")
    fmu = FmuFile.read(built.path)
    results = {name: _tracked(fmu, name) for name in bar(WORKPIECES, len(WORKPIECES), "track")}
    for name, result in results.items():
        m = tracking_metrics(result.log)
        said = (
            f"f_n RMSE {m.rmse_fn:.2f} N, ME {m.me_fn:.1f} N; v_t RMSE {m.rmse_vt:.3f} m/s, "
            f"ME {m.me_vt:.3f} m/s"
        )
        print(f"tracked {name:<11} {said}")
    save(
        tracking_figure(results["curved"].log, "curved edge, PI force/velocity controller"),
        options.out / "tracking.png",
    )
    write_log(results["curved"].log, options.out / "curved.parquet")
    truth = None if options.campaign else _drawn(options.seed, options.out / "campaign")
    folder = options.campaign or options.out / "campaign"
    campaign = read_campaign(folder, strict=False, needs=DRIVEN)
    print(f"\ndiagnosis of {campaign.name}:")
    with Stages("diagnose", "campaign") as say:
        diagnosed = diagnose(campaign, fmu=fmu, say=say)
    print_diagnosis(diagnosed.json)
    if truth is not None:
        print(
            "the rig had: "
            + " and ".join(
                f"{c['effect']}{'/' if c['axis'] else ''}{c['axis']} in {c['block']}" for c in truth
            )
        )
    page = diagnosed.write_html(options.out / "report.html")
    print(f"\nreport: {page}")
    return {"schema": "demo/1", "report": str(page), "truth": truth, "diagnosis": diagnosed.json}, 0


def _drawn(seed: int, folder: Path) -> list[dict[str, Any]]:
    """Writes the campaign of a rig of the truth plant with one effect; returns what it has, which
    the diagnosis does not see.
    """
    from pneugantry.truth.campaign import write
    from pneugantry.truth.case import draw_case

    campaign, label = draw_case(seed, "one")
    shutil.rmtree(folder, ignore_errors=True)
    write(folder, campaign)
    return [{key: cause[key] for key in ("effect", "axis", "block")} for cause in label["causes"]]


def _tracked(fmu: FmuFile, workpiece: str) -> RunResult:
    from pyfmi_runner.run import run_scenario
    from pyfmi_runner.scenario import Scenario

    result = run_scenario(
        Scenario(name=workpiece, workpiece=workpiece, seed=1),
        fmu,
        progress=loop_progress(workpiece),
    )
    if result.outcome != "done":
        raise RunError(f"tracking {workpiece} {result.outcome}: {result.reason}")
    return result
