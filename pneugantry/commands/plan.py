"""`pneugantry plan`."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pneugantry.options import out_file
from pneugantry.progress import Stages

if TYPE_CHECKING:
    from pneugantry.engine.planning.plan import Case

HELP = """Which effects these sensors and logs can see and tell apart, and which experiment or
sensor would add most: before anything is fitted or measured.

  pneugantry plan CAMPAIGN_FOLDER   the gantry: a folder with campaign.toml
  pneugantry plan PLANT.toml        a plant of your own, from its Modelica source

Of each effect: the smallest size that shows at 3 sigma beside the sensors' noise, the plant's
tolerance and what differs from log to log; how far its usual size stands out; and how far it still
does after the best imitation by one other effect. Nothing is fitted: the logs give inputs and
working points, and signals that they lack are simulated with the nominal model."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "source", metavar="PLANT.toml|CAMPAIGN", type=Path, help="a plant's description or a folder"
    )
    command.add_argument(
        "--catalogue", metavar="PATH", type=Path, help="a folder of effects instead of its own"
    )
    command.add_argument(
        "--logs-only",
        action="store_true",
        help="no further experiments and sensors: a third of the time",
    )
    command.add_argument(
        "--without",
        metavar="SIGNALS",
        default="",
        help="as if these were not measured, for example f_ax,f_az",
    )
    command.add_argument("--html", metavar="FILE", type=out_file, help="write the result as a page")


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from modelica_fmu.files import write_atomically
    from pneugantry.engine.planning.plan import make_plan, without
    from pneugantry.engine.planning.report import as_html, as_json, as_text

    began = time.perf_counter()
    with Stages("plan", "logs" if options.logs_only else "") as say:
        say("logs")
        case = _case(options)
        if options.without:
            case = without(case, options.without.split(","))
        plan = make_plan(replace(case, sensors=()) if options.logs_only else case, say)
    for line in as_text(plan):
        print(line)
    if options.html:
        page = as_html(plan)
        write_atomically(options.html, lambda path: path.write_text(page, encoding="utf-8"))
        print(f"page: {options.html}")
    seconds = time.perf_counter() - began
    print(f"{seconds:.1f} s")
    return as_json(plan) | {"seconds": seconds}, 0


def _case(options: argparse.Namespace) -> Case:
    from pneugantry.plants.described import is_plant_description
    from pyfmi_runner.build import cache_folder

    cache = cache_folder() / "parts"
    if is_plant_description(options.source):
        from pneugantry.engine.describe import case_of

        return case_of(options.source, cache, options.catalogue)
    from pneugantry.plants.gantry.experiments import case_of as campaign_case
    from pyfmi_runner.campaign import DRIVEN, read_campaign

    campaign = read_campaign(options.source, needs=DRIVEN)
    return campaign_case(campaign, cache, options.catalogue, not options.logs_only)
