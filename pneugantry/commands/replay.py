"""`pneugantry replay`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pneugantry.progress import bar
from pyfmi_runner.blocks import BLOCKS, BlockReplayer, noisy_copy
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import Campaign, read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED
from pyfmi_runner.replay import Replayer, channel_gaps

HELP = """Measured log against the FMU: gap per log, channel and block; 1 is the noise floor.

A log's gap: the whole plant driven by the recorded commands, RMS of (measured - simulated)/sigma over the eight channels.
A block's gap: the block fed with measured signals; its floor is that of the nominal plant's own noisy log.

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
    campaign = read_campaign(options.campaign)
    logs = replay_campaign(campaign, FmuFile.read(options.fmu or build_fmu().path))
    for note in campaign.notes:
        print(f"note: {note}")
    print_replay(logs)
    return {"schema": "replay/1", "logs": logs} | (
        {"notes": campaign.notes} if campaign.notes else {}
    ), 0


def replay_campaign(campaign: Campaign, fmu: FmuFile) -> dict[str, dict[str, Any]]:
    """Gaps of every log: {"gap", "channels": {...}, "blocks": {...: {"gap", "floor"}}}."""
    result = {}
    with Replayer(fmu) as plant, BlockReplayer(fmu) as blocks:
        for name, run in bar(campaign.logs.items(), len(campaign.logs), "replay"):
            simulated = plant.simulate(run)
            gaps = channel_gaps(run.log.measured(), simulated)
            result[name] = {
                "gap": gaps.gap,
                "channels": gaps.channels,
                "blocks": blocks.gaps(run, noisy_copy(run, simulated)),
            }
    return result


def print_replay(logs: dict[str, dict[str, Any]]) -> None:
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
