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

from modelica_fmu.errors import InputError
from pneugantry.engine.hypotheses.catalogue import catalogue_files
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found
from pneugantry.jobs.job import Function, Job
from pneugantry.jobs.run import run_jobs
from pneugantry.plants.calibration_file import files_named, stamp_of
from pneugantry.plants.described import diagnose_described
from pneugantry.plants.gantry.catalogue import FOLDER, catalogue_of, model_of
from pneugantry.plants.gantry.diagnosis import diagnose
from pneugantry.plants.gantry.nominal import Nominal
from pneugantry.plants.gantry.page import extras_of
from pneugantry.plants.missing_term import to_json, with_missing_term
from pneugantry.report.page import Extras, write_page
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import DRIVEN, SUFFIXES, Campaign, read_campaign, with_controller
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import write_atomically
from pyfmi_runner.scenario import parse_toml

__all__ = ["RESULT", "Diagnoser", "campaign_folders", "diagnose_campaigns", "is_described"]

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
    plant.toml by that. fmu: the nominal gantry where its parameters are not the model's own;
    strict: as in `read_campaign`; pages: a report as HTML beside each result; learn: a missing term
    is looked for where one is likely; controller: the gantry's own, a Python file.
    """

    fmu: Path | None = None
    catalogue: Path | None = None
    strict: bool = True
    pages: bool = False
    learn: bool = True
    controller: Path | None = None

    def __call__(self) -> Function:
        fmu = None if self.fmu is None else FmuFile.read(self.fmu)
        return partial(self._diagnose, fmu, catalogue_of(self.catalogue))

    def _diagnose(self, fmu: FmuFile | None, catalogue: Any, folder: Path) -> str:
        if is_described(folder):
            found, rules = diagnose_described(folder / DESCRIPTION, self.catalogue)
            return self._told(found, rules, folder)
        campaign = read_campaign(folder, strict=self.strict, needs=DRIVEN)
        if self.controller is not None:
            campaign = with_controller(campaign, self.controller)
        nominal = Nominal(fmu, model_of(self.catalogue))
        found = diagnose(campaign, catalogue, nominal=nominal)
        return self._told(found, Rules(), folder, campaign)

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
        """What decides the answer to a folder: hashes by name. Raises InputError for a file that is
        no TOML.
        """
        learn = {} if self.learn else {"learn": "no"}
        if is_described(folder):
            return {**learn, "description": stamp_of(folder / DESCRIPTION, self.catalogue)}
        fmu = self.fmu or build_fmu(model=model_of(self.catalogue)).path
        own = {} if self.controller is None else {"controller": _hash_of([self.controller])}
        return {
            **learn,
            **own,
            "fmu": FmuFile.read(fmu).sha256,
            "catalogue": _catalogue_hash(self.catalogue),
            "campaign": _campaign_hash(folder),
        }


def is_described(folder: Path) -> bool:
    """Whether a campaign is one of a plant of one's own."""
    return not (folder / CAMPAIGN).is_file()


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
    """JSON of each campaign's diagnosis; what is on disk already, of the same logs and setup by the
    same FMU and catalogue (or of the same description with all that it names), is taken from there.

    A campaign whose diagnosis fails, or takes its worker with it three times, has the verdict
    "failed" and a reason; nothing of it goes to disk, so that the next call tries it again.
    scheduler: address of a Dask cluster whose workers see the same folders; done: told the name of
    each campaign as it ends.
    """
    by = {folder: _stamp_of(diagnoser, folder) for folder in folders}
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


def _stamp_of(diagnoser: Diagnoser, folder: Path) -> dict[str, str]:
    """Empty where a folder cannot be read: its diagnosis says why."""
    try:
        return diagnoser.stamp(folder)
    except (InputError, OSError):
        return {}


def _on_disk(path: Path, by: dict[str, str]) -> dict[str, Any] | None:
    """A finished diagnosis; None where there is none, or it was made of or by something else."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    known = isinstance(found, dict) and "verdict" in found and bool(by)
    return found if known and found.get("diagnosed_by") == by else None


def _campaign_hash(folder: Path) -> str:
    """Of campaign.toml and the logs, by their names: what lies in the folder or is named there."""
    index = folder / CAMPAIGN
    logs = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file()]
    files = sorted({index, *logs, *files_named(parse_toml(index), folder)})
    return _hash_of(files, [file.name for file in files])


def _catalogue_hash(source: Path | None) -> str:
    files = [*catalogue_files(FOLDER), *([] if source is None else catalogue_files(source))]
    own = model_of(source)
    return _hash_of([*files, *([] if own is None else [own])])


def _hash_of(files: Sequence[Path], names: Sequence[str] = ()) -> str:
    """Of some files' contents, and of names."""
    contents = [hashlib.sha256(path.read_bytes()).hexdigest() for path in files]
    return hashlib.sha256("\n".join([*names, *contents]).encode()).hexdigest()


def _write(text: str, path: Path) -> None:
    path.write_text(text, encoding="utf-8")
