"""The blind check: sealed cases from the independent truth plant, diagnosed and unsealed.

Labels go into a file of their own whose hash is known before the first diagnosis starts; nothing
else of a case reaches the diagnosis but its folder of logs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.blind.sets import LabelledSet
from pneugantry.plants.campaigns import Diagnoser, diagnose_campaigns
from pneugantry.truth.campaign import write as write_truth
from pneugantry.truth.case import DEVELOPMENT
from pyfmi_runner.log import write_atomically

__all__ = ["diagnose_cases", "draw_cases", "unseal"]


def draw_cases(folder: Path, seeds: Iterable[int], case_set: LabelledSet = DEVELOPMENT) -> str:
    """Writes one campaign folder per seed and the sealed labels; returns the labels' SHA-256."""
    labels = {}
    for seed in seeds:
        campaign, label = case_set.draw(seed)
        write_truth(folder / f"case_{seed}", campaign)
        labels[str(seed)] = label
    text = json.dumps(labels, sort_keys=True, default=float)
    write_atomically(
        folder / "sealed_labels.json",
        lambda temporary: temporary.write_text(text, encoding="utf-8"),
    )
    return hashlib.sha256(text.encode()).hexdigest()


def diagnose_cases(
    folder: Path,
    workers: int = 2,
    done: Callable[[str], object] | None = None,
    scheduler: str | None = None,
    learn: bool = True,
) -> dict[str, dict[str, Any]]:
    """JSON of each case's diagnosis; results that are already on disk are taken from there. learn:
    as of `Diagnoser`.
    """
    cases = sorted(p for p in folder.glob("case_*") if (p / "campaign.toml").is_file())
    diagnoser = Diagnoser(learn=learn, strict=False)  # as `pneugantry diagnose`
    results = diagnose_campaigns(cases, diagnoser, workers=workers, scheduler=scheduler, done=done)
    return {path.name.removeprefix("case_"): result for path, result in results.items()}


def unseal(folder: Path, digest: str) -> dict[str, dict[str, Any]]:
    """The labels, if they are those that were sealed."""
    text = (folder / "sealed_labels.json").read_text(encoding="utf-8")
    if hashlib.sha256(text.encode()).hexdigest() != digest:
        raise InputError(
            "has changed since it was sealed",
            file=folder / "sealed_labels.json",
            hint="draw the cases again",
        )
    labels: dict[str, dict[str, Any]] = json.loads(text)
    return labels
