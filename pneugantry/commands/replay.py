"""`pneugantry replay`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

HELP = """Measured log against the FMU: gap per log, channel and block; 1 is the noise floor.

A log's gap: the whole plant driven by the recorded commands, RMS of (measured - simulated)/sigma
over the eight channels. A block's gap: the block fed with measured signals; its floor is that of
the nominal plant's own noisy log.

  pneugantry replay FOLDER          a campaign (a folder with campaign.toml)
  pneugantry replay LOG.parquet     one log"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "campaign", metavar="CAMPAIGN_OR_LOG", help="folder with campaign.toml, or one log"
    )
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="another FMU with the gantry's interface"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.api import runs

    replayed = runs.replay(options.campaign, fmu=options.fmu)
    for note in replayed.campaign.notes:
        print(f"note: {note}")
    print_replay(replayed.logs)
    return replayed.as_json(), 0


def print_replay(logs: dict[str, dict[str, Any]]) -> None:
    from pyfmi_runner.blocks import BLOCKS
    from pyfmi_runner.log import MEASURED

    width = max(len(name) for name in logs)
    print(f"{'log':<{width}}  {'gap':>7} " + " ".join(f"{c:>7}" for c in MEASURED))
    for name, entry in logs.items():
        print(
            f"{name:<{width}}  {entry['gap']:7.3f} "
            + " ".join(f"{entry['channels'][c]:7.3f}" for c in MEASURED)
        )
    print(f"\n{'block: gap/floor':<{width}} " + " ".join(f"{b:>14}" for b in BLOCKS))
    for name, entry in logs.items():
        cells = [
            f"{entry['blocks'][b]['gap']:.2f}/{entry['blocks'][b]['floor']:.2f}"
            if b in entry["blocks"]
            else "-"
            for b in BLOCKS
        ]
        print(f"{name:<{width}} " + " ".join(f"{c:>14}" for c in cells))
