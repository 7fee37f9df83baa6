"""Many campaigns diagnosed in worker processes, of the gantry or of described plants:
`diagnosis.json` beside each as soon as it exists, and a rerun takes it from there.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found, run
from pneugantry.jobs.job import Function, Job
from pneugantry.jobs.run import run_jobs
from pneugantry.plants.calibration_file import stamp_of
from pneugantry.plants.described import described_task
from pneugantry.plants.gantry.catalogue import FOLDER, catalogue_of, model_of
from pneugantry.plants.gantry.diagnosis import diagnose
from pneugantry.plants.gantry.nominal import Nominal
from pneugantry.plants.gantry.page import extras_of
from pneugantry.plants.missing_term import to_json, with_missing_term
from pneugantry.report.page import Extras, write_page
from pyfmi_runner.campaign import DRIVEN, Campaign, read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import write_atomically

__all__ = ["RESULT", "Diagnoser", "campaign_folders", "diagnose_campaigns"]

RESULT = "diagnosis.json"
CAMPAIGN, DESCRIPTION = "campaign.toml", "plant.toml"  # of the gantry, of a plant of one's own
FAILED: dict[str, Any] = {
    "verdict": "failed",
    "where": [],
    "causes": [],
    "answer_set": [],
    "gap": None,
    "seconds": float("nan"),
}


@dataclass(frozen=True)
class Diagnoser:
    """Reads FMU and catalogue once in a worker, then diagnoses folder by folder; a folder with a
    plant.toml by that. strict: as in `read_campaign`; pages: a report as HTML beside each result;
    learn: a missing term is looked for where one is likely.
    """

    fmu: Path
    catalogue: Path | None = None
    strict: bool = True
    pages: bool = False
    learn: bool = True

    def __call__(self) -> Function:
        return partial(self._diagnose, FmuFile.read(self.fmu), catalogue_of(self.catalogue))

    def _diagnose(self, fmu: FmuFile, catalogue: Any, folder: Path) -> str:
        if not (folder / CAMPAIGN).is_file():
            return self._diagnose_described(folder)
        campaign = read_campaign(folder, strict=self.strict, needs=DRIVEN)
        model = model_of(self.catalogue)
        found = diagnose(campaign, catalogue, nominal=Nominal(None if model else fmu, model))
        return self._told(found, Rules(), folder, campaign)

    def _diagnose_described(self, folder: Path) -> str:
        read, task = described_task(folder / DESCRIPTION, self.catalogue)
        found = run(task, read.rules)
        return self._told(found, read.rules, folder)

    def _told(
        self, found: Found, rules: Rules, folder: Path, campaign: Campaign | None = None
    ) -> str:
        """The JSON, with the missing term and the page where they are wanted."""
        learned = None
        if self.learn:
            found, learned = with_missing_term(found, rules, campaign)
        answer = to_json(found, learned)
        if self.pages:
            extras = Extras() if campaign is None else extras_of(campaign, found)
            extras = replace(extras, rules=rules, learned=answer.get("learned"))
            write_page(found, folder / "diagnosis.html", extras)
        return json.dumps(answer, default=float)

    def stamp(self, folder: Path) -> dict[str, str]:
        """What decides the answer to a folder, its logs aside: hashes by name."""
        learn = {} if self.learn else {"learn": "no"}
        if not (folder / CAMPAIGN).is_file():
            return {**learn, "description": stamp_of(folder / DESCRIPTION, self.catalogue)}
        return {
            **learn,
            "fmu": FmuFile.read(self.fmu).sha256,
            "catalogue": _catalogue_hash(self.catalogue),
        }


def campaign_folders(folder: Path) -> list[Path]:
    """The campaigns in a folder that is none itself: folders with a campaign.toml or a plant.toml;
    empty where it is one, or no folder.
    """
    if not folder.is_dir() or any((folder / name).is_file() for name in (CAMPAIGN, DESCRIPTION)):
        return []
    return sorted({p.parent for n in (CAMPAIGN, DESCRIPTION) for p in folder.glob(f"*/{n}")})


def diagnose_campaigns(
    folders: Sequence[Path],
    diagnoser: Diagnoser,
    *,
    workers: int = 2,
    scheduler: str | None = None,
    done: Callable[[str], object] | None = None,
) -> dict[Path, dict[str, Any]]:
    """JSON of each campaign's diagnosis; what is on disk already, by the same FMU and catalogue (or
    the same description with all that it names), is taken from there.

    A campaign whose diagnosis fails, or takes its worker with it three times, has the verdict
    "failed" and a reason; nothing of it goes to disk, so that the next call tries it again.
    scheduler: address of a Dask cluster whose workers see the same folders; done: told the name of
    each campaign as it ends.
    """
    by = {folder: diagnoser.stamp(folder) for folder in folders}
    results = {
        folder: found
        for folder in folders
        if (found := _on_disk(folder / RESULT, by[folder])) is not None
    }
    by_name = {str(folder): folder for folder in folders if folder not in results}
    jobs = [Job(name, folder) for name, folder in by_name.items()]
    for ended in run_jobs(diagnoser, jobs, workers=workers, scheduler=scheduler):
        folder = by_name[str(ended.key)]
        if ended.failure:
            results[folder] = FAILED | {"reason": ended.failure}
        else:
            results[folder] = json.loads(ended.value) | {"diagnosed_by": by[folder]}
            text = json.dumps(results[folder])
            write_atomically(folder / RESULT, partial(_write, text))
        if done is not None:
            done(folder.name)
    return {folder: results[folder] for folder in folders}


def _on_disk(path: Path, by: dict[str, str]) -> dict[str, Any] | None:
    """A finished diagnosis; None where there is none or another FMU or catalogue made it."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and found.get("diagnosed_by", by) == by else None


def _catalogue_hash(source: Path | None) -> str:
    files = [
        *sorted(FOLDER.glob("*.toml")),
        *(
            sorted(source.glob("*.toml"))
            if source and source.is_dir()
            else [source]
            if source
            else []
        ),
    ]
    own = model_of(source)
    files += [] if own is None else [own]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def _write(text: str, path: Path) -> None:
    path.write_text(text, encoding="utf-8")
