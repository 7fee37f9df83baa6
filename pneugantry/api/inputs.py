"""What the functions take: a path, a table in memory, or an object of ours."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import Campaign, campaign_of_log, read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import REQUIRED, Log, check_table

__all__ = ["CampaignSource", "FmuSource", "campaign_from", "fmu_from"]

PathLike = str | os.PathLike[str]
CampaignSource = PathLike | Campaign | Log | pd.DataFrame
FmuSource = PathLike | FmuFile | None


def campaign_from(
    source: CampaignSource,
    setup: Mapping[str, Any] | None = None,
    *,
    strict: bool = True,
    needs: Sequence[str] = REQUIRED,
) -> Campaign:
    """The campaign of a folder or log file, of a `Log`, or of a pandas table with a log's columns.

    setup: how a single log was taken, with the keys of a table [log.NAME] in campaign.toml. Raises
    InputError naming file, column and hint.
    """
    if isinstance(source, Campaign):
        return source
    if isinstance(source, pd.DataFrame):
        source = Log(
            check_table(source, needs=needs), "table", dict(source.attrs.get("provenance", {}))
        )
    if isinstance(source, Log):
        return campaign_of_log(source, setup)
    return read_campaign(source, strict=strict, setup=setup, needs=needs)


def fmu_from(source: FmuSource = None) -> FmuFile:
    """An FMU file, read; the gantry's, built on the way, where none is given."""
    if isinstance(source, FmuFile):
        return source
    return FmuFile.read(Path(source) if source is not None else build_fmu().path)
