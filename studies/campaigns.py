"""Many campaigns diagnosed in worker processes: `diagnosis.json` beside each as soon as it exists, and a rerun takes it from there."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from diagnosis.catalogue import read_catalogue
from diagnosis.diagnose import diagnose, report_json
from diagnosis.report import write_report
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import write_atomically
from studies.jobs.job import Function, Job
from studies.jobs.run import run_jobs

__all__ = ["RESULT", "campaign_folders", "diagnose_campaigns"]

RESULT = "diagnosis.json"
FAILED: dict[str, Any] = {"verdict": "failed", "where": [], "causes": [], "answer_set": [], "gap": None, "seconds": float("nan")}


@dataclass(frozen=True)
class Diagnoser:
    """Reads FMU and catalogue once in a worker, then diagnoses folder by folder."""

    fmu: str
    catalogue: Path | None
    strict: bool
    pages: bool

    def __call__(self) -> Function:
        return partial(self._diagnose, FmuFile.read(self.fmu), read_catalogue(self.catalogue))

    def _diagnose(self, fmu: FmuFile, catalogue: Any, folder: Path) -> str:
        result = diagnose(read_campaign(folder, strict=self.strict), fmu, catalogue)
        if self.pages:
            write_report(result, folder / "diagnosis.html")
        return json.dumps(report_json(result), default=float)


def campaign_folders(folder: Path) -> list[Path]:
    """The campaigns in a folder that is none itself; empty where it is one, or no folder."""
    if not folder.is_dir() or (folder / "campaign.toml").is_file():
        return []
    return sorted(path.parent for path in folder.glob("*/campaign.toml"))


def diagnose_campaigns(
    folders: Sequence[Path],
    fmu: Path,
    *,
    workers: int = 2,
    catalogue: Path | None = None,
    strict: bool = True,
    pages: bool = False,
    done: Callable[[str], object] | None = None,
) -> dict[Path, dict[str, Any]]:
    """JSON of each campaign's diagnosis; what is on disk already is taken from there.

    A campaign whose diagnosis fails, or takes its worker with it three times, has the verdict "failed" and a reason; nothing of it goes
    to disk, so that the next call tries it again. strict: as in `read_campaign`; pages: a report as HTML beside each result; done: told
    the name of each campaign as it ends.
    """
    results = {folder: json.loads((folder / RESULT).read_text(encoding="utf-8")) for folder in folders if (folder / RESULT).is_file()}
    by_name = {str(folder): folder for folder in folders if folder not in results}
    jobs = [Job(name, folder) for name, folder in by_name.items()]
    for ended in run_jobs(Diagnoser(str(fmu), catalogue, strict, pages), jobs, workers=workers):
        folder = by_name[str(ended.key)]
        if ended.failure:
            results[folder] = FAILED | {"reason": ended.failure}
        else:
            _write(folder / RESULT, ended.value)
            results[folder] = json.loads(ended.value)
        if done is not None:
            done(folder.name)
    return {folder: results[folder] for folder in folders}


def _write(path: Path, text: str) -> None:
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
