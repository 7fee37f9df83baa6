"""`pneugantry diagnose`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.commands.options import out_file, out_folder
from pneugantry.progress import bar
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

HELP = """Where the sim-to-real gap of a campaign lies, which effect causes it, and how far it shrinks with that effect added.

Logs that cannot be used are left out and named. One log gives what one log can; the report says what it cannot excite.

  pneugantry diagnose FOLDER --html report.html --json out.json
  pneugantry diagnose FOLDER --augmented out/   the plant with the effect added, as Modelica and as FMU
  pneugantry diagnose LOG.parquet               a campaign of one
  pneugantry diagnose plant.toml                a plant of your own: FMU, logs and catalogue as that file says (README)
  pneugantry diagnose FOLDER_OF_CAMPAIGNS       each one: diagnosis.json and diagnosis.html beside it; the same command goes on"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "campaign",
        metavar="CAMPAIGN_OR_LOG",
        help="folder with campaign.toml, one log, a plant.toml, or a folder of campaigns",
    )
    command.add_argument(
        "--catalogue",
        metavar="FILE.toml",
        type=Path,
        help="effects of your own: a file with [[effect]] tables, or a folder",
    )
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="another FMU with the same interface"
    )
    command.add_argument(
        "--augmented",
        metavar="FOLDER",
        type=out_folder,
        help="write the plant with the effect added: AugmentedGantry.mo and its FMU",
    )
    command.add_argument(
        "--html", metavar="FILE", type=out_file, help="write the report, one self-contained page"
    )
    command.add_argument(
        "--workers", type=int, default=2, metavar="N", help="processes (default: %(default)s)"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.api import diagnosis
    from pneugantry.blind.campaigns import campaign_folders
    from pneugantry.diagnosis.own_plant import is_own_plant

    source = Path(options.campaign)
    if folders := campaign_folders(source):
        return _execute_many(folders, options)
    if options.html is not None and is_own_plant(source):
        raise InputError(
            "the page shows the gantry", field="--html", hint="use --json for a plant of your own"
        )
    found = diagnosis.diagnose(
        options.campaign,
        catalogue=options.catalogue,
        fmu=options.fmu,
        workers=options.workers,
        say=say_stage,
    )
    print_path(found.json)
    print_diagnosis(found.json)
    if options.augmented is not None:
        model, fmu = found.write_augmented(options.augmented)
        print(f"augmented plant: {model}, {fmu}")
    if options.html is not None:
        print(f"report: {found.write_html(options.html)}")
    return found.json, 0


def _execute_many(folders: list[Path], options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    """A folder of campaigns, in worker processes."""
    from pneugantry.blind.campaigns import diagnose_campaigns
    from pneugantry.diagnosis.catalogue import read_catalogue

    for option, target in (("--html", options.html), ("--augmented", options.augmented)):
        if target is not None:
            raise InputError(
                "is for one campaign",
                field=option,
                hint="leave it out; each campaign gets a diagnosis.html beside it",
            )
    read_catalogue(options.catalogue)  # refused here, not by every worker
    gantry = FmuFile.read(options.fmu or build_fmu().path)
    counter = bar(range(len(folders)), len(folders), "diagnose")
    results = diagnose_campaigns(
        folders,
        gantry.path,
        workers=options.workers,
        catalogue=options.catalogue,
        strict=False,
        pages=True,
        done=lambda _: next(counter, None),
    )
    for folder, found in results.items():
        causes = " + ".join(
            f"{c['effect']}/{c['axis']}" if c["axis"] else c["effect"] for c in found["causes"]
        )
        shrink = f", shrink {found['gap']['shrink']:.3f}" if found["gap"] and causes else ""
        reason = f": {found['reason']}" if "reason" in found else ""
        print(f"{folder.name}: {found['verdict']}{' ' if causes else ''}{causes}{shrink}{reason}")
    failed = sum(found["verdict"] == "failed" for found in results.values())
    return {
        "schema": "gaps/1",
        "campaigns": {folder.name: found for folder, found in results.items()},
    }, int(failed == len(results))


def print_path(found: dict[str, Any]) -> None:
    """How an own plant's effects were found, with the error over the signal after each step."""
    for step in found.get("path", []):
        errors = "  ".join(
            f"{log}: " + ", ".join(f"{c} {100 * e:.2f} %" for c, e in by.items())
            for log, by in step["errors"].items()
        )
        print(
            f"{step['effect']:<20} {step['step']:<24} log evidence "
            f"{step['evidence']:8.1f}   {errors}"
        )


def say_stage(stage: str) -> None:
    """Names a stage on a terminal."""
    if sys.stderr.isatty():
        print(f"diagnose: {stage} ...", file=sys.stderr, flush=True)


def print_diagnosis(found: dict[str, Any]) -> None:
    """The diagnosis in a few lines."""
    for note in found.get("notes", []):
        print(f"note: {note}")
    unknown = found.get("unknown_probability")
    print(
        f"verdict: {found['verdict']}"
        + (
            f" (outside the catalogue: probability {unknown:.2f})"
            if found["verdict"] == "unknown" and unknown
            else ""
        )
    )
    for entry in found["where"]:
        logs = f"  {', '.join(entry['logs'])}" if entry["logs"] else ""
        print(
            f"where: {entry['block']:<11} {entry['share']:.2f}{logs}"
            + (f"; {entry['regime']}" if entry["regime"] else "")
        )
    for cause in found["causes"]:
        name = f"{cause['effect']}/{cause['axis']}" if cause["axis"] else cause["effect"]
        print(f"cause: {name:<22} probability {cause['probability']:.2f}")
        for parameter, entry in cause["parameters"].items():
            low, high = entry["ci95"]
            print(
                f"         {parameter} = {entry['value']:.4g} {entry['unit']}, 95 % from "
                f"{low:.4g} to {high:.4g}"
            )
    if found["answer_set"]:
        print(
            "answer set (95 %): "
            + "; or ".join(" + ".join(keys) or "no effect" for keys in found["answer_set"])
        )
    for key, what in (("gap", "gap"), ("closed_loop", "closed loop")):
        entry = found[key]
        if entry:
            log = f" of {entry['log']}" if "log" in entry else ""
            ends = f" [{entry['ci95'][0]:.3f}, {entry['ci95'][1]:.3f}]" if "ci95" in entry else ""
            shrink = (
                f"shrink {entry['shrink']:.3f}{ends}"
                if entry["nominal"] > 1.05 * entry["floor"]
                else "nothing to shrink"
            )
            print(
                f"{what}{log}: nominal {entry['nominal']:.3g}, augmented "
                f"{entry['augmented']:.3g}, floor {entry['floor']:.3g}; {shrink}"
            )
    if found.get("next_experiment"):
        print(f"next experiment: {found['next_experiment']['what']}")
    print(f"seconds: {found['seconds']:.1f}")
