"""`pneugantry identify`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pneugantry.options import out_folder
from pneugantry.progress import Stages

if TYPE_CHECKING:
    from pneugantry.analysis.identify.identification import Identification

HELP = """Plant parameters with 95 % intervals, by the thesis' tests (App. C, section 4.1) and
by one fit to all logs.

  pneugantry identify FOLDER          a campaign (a folder with campaign.toml)
  pneugantry identify LOG.parquet     one log: says what it cannot tell

The fit replays the whole plant by the recorded commands. Its intervals count the sensors' noise,
the rounding of the recorded commands, and what is left where the plant does not fit. F_w of an
axis that is only pushed one way is taken as on the plant sheet, +-2 % RMS."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "campaign", metavar="CAMPAIGN_OR_LOG", help="folder with campaign.toml, or one log"
    )
    command.add_argument(
        "--plot",
        metavar="FOLDER",
        type=out_folder,
        help="draw lags, friction loop and intervals into this folder",
    )
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="another FMU with the gantry's interface"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.analysis.identify.report import as_text
    from pneugantry.api import runs

    with Stages("identify") as say:
        identified = runs.identify(options.campaign, fmu=options.fmu, say=say)
    for line in as_text(identified.found):
        print(line)
    if options.plot:
        _draw(identified.found, options.plot)
    print(f"{identified.seconds:.1f} s")
    return identified.as_json(), 0


def _draw(found: Identification, folder: Path) -> None:
    from pneugantry.analysis.plots import save
    from pneugantry.analysis.plots_identify import hysteresis_figure, interval_figure, lag_figure

    figures = {"lags": lag_figure(found.steps)}
    if "logs" in found.joint.sources.values():
        figures["intervals"] = interval_figure(found.joint)
    else:
        print("no picture of intervals: the plant does not replay these logs")
    if found.hysteresis is not None:
        figures["hysteresis"] = hysteresis_figure(found.hysteresis)
    for name, figure in figures.items():
        path = folder / f"{name}.png"
        save(figure, path)
        print(f"picture: {path}")
