"""`pneugantry diagnose`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.errors import InputError
from pyfmi_runner.fmu import FmuFile

HELP = """Where the sim-to-real gap of a campaign lies, which effect causes it, and how far it shrinks with that effect added.

Logs that cannot be used are left out and named. One log gives what one log can; the report says what it cannot excite.

  pneugantry diagnose FOLDER --html report.html --json out.json
  pneugantry diagnose LOG.parquet               a campaign of one"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("campaign", metavar="CAMPAIGN_OR_LOG", help="folder with campaign.toml, or one log")
    command.add_argument(
        "--catalogue", metavar="FILE.toml", type=Path, help="effects of your own: a file with [[effect]] tables, or a folder"
    )
    command.add_argument("--fmu", metavar="FILE.fmu", type=Path, help="another FMU with the gantry's interface")
    command.add_argument("--html", metavar="FILE", type=Path, help="write the report, one self-contained page")


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from diagnosis.catalogue import read_catalogue
    from diagnosis.diagnose import diagnose, report_json
    from diagnosis.report import write_report

    if options.html is not None and options.html.is_dir():
        raise InputError("is a folder", file=options.html, mend="name the file of the page, as in --html report.html")
    catalogue = read_catalogue(options.catalogue)
    campaign = read_campaign(options.campaign, strict=False)
    gantry = FmuFile.read(options.fmu or build_fmu().path)
    result = diagnose(campaign, gantry, catalogue, _say)
    found = report_json(result)
    print_diagnosis(found)
    if options.html is not None:
        print(f"report: {write_report(result, options.html)}")
    return found, 0


def _say(stage: str) -> None:
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
        + (f" (outside the catalogue: probability {unknown:.2f})" if found["verdict"] == "unknown" and unknown else "")
    )
    for entry in found["where"]:
        logs = f"  {', '.join(entry['logs'])}" if entry["logs"] else ""
        print(f"where: {entry['block']:<11} {entry['share']:.2f}{logs}" + (f"; {entry['regime']}" if entry["regime"] else ""))
    for cause in found["causes"]:
        name = f"{cause['effect']}/{cause['axis']}" if cause["axis"] else cause["effect"]
        print(f"cause: {name:<22} probability {cause['probability']:.2f}")
        for parameter, entry in cause["parameters"].items():
            low, high = entry["ci95"]
            print(f"         {parameter} = {entry['value']:.4g} {entry['unit']}, 95 % from {low:.4g} to {high:.4g}")
    if found["answer_set"]:
        print("answer set (95 %): " + "; or ".join(" + ".join(keys) or "no effect" for keys in found["answer_set"]))
    for key, what in (("gap", "gap"), ("closed_loop", "closed loop")):
        entry = found[key]
        if entry:
            log = f" of {entry['log']}" if "log" in entry else ""
            ends = f" [{entry['ci95'][0]:.3f}, {entry['ci95'][1]:.3f}]" if "ci95" in entry else ""
            shrink = f"shrink {entry['shrink']:.3f}{ends}" if entry["nominal"] > 1.05 * entry["floor"] else "nothing to shrink"
            print(f"{what}{log}: nominal {entry['nominal']:.3g}, augmented {entry['augmented']:.3g}, floor {entry['floor']:.3g}; {shrink}")
    if found.get("next_experiment"):
        print(f"next experiment: {found['next_experiment']['what']}")
    print(f"seconds: {found['seconds']:.1f}")
