"""Named sets of labelled cases, and their writing to a folder: `SET/SEED/` holds one campaign, and
beside its logs `truth.json`, which no diagnosis reads.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol

from modelica_fmu.errors import InputError
from pneugantry.jobs.job import Function, Job
from pneugantry.jobs.run import run_jobs
from pneugantry.truth.campaign import Campaign
from pneugantry.truth.campaign import write as write_campaign
from pneugantry.truth.case import MIXTURE, CaseSet
from pneugantry.truth.effects import MISSING_FORMS, RANDOM_FORMS
from pneugantry.truth.form import Form
from pneugantry.truth.nuisance import NUISANCE, PLAIN
from pneugantry.truth.odd_rigs import OddRigs
from pyfmi_runner.log import write_atomically

__all__ = ["SETS", "TRUTH", "named_set", "write_case", "write_cases"]

TRUTH = "truth.json"
ACTUATOR_FORCES = ("f_ax", "f_az")
CONTOURS = ("contour_straight", "contour_curved")


def _effects(forms: Sequence[Form]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(form.effect for form in forms))


class LabelledSet(Protocol):
    """Anything that makes a campaign and its truth of a seed."""

    @property
    def name(self) -> str: ...

    def draw(self, seed: int) -> tuple[Campaign, dict]: ...


SETS: dict[str, LabelledSet] = {
    each.name: each
    for each in (
        CaseSet("plain", MIXTURE, PLAIN),
        CaseSet("nuisance"),
        CaseSet("three", {"three": 1.0}),
        CaseSet("nofa", missing=ACTUATOR_FORCES),
        CaseSet("contour", logs=CONTOURS),
        CaseSet("both", {"both": 1.0}),
        CaseSet("faint", {"none": 0.25, "one": 0.5, "two": 0.25}, severity=0.4),
        CaseSet("coarse", {"none": 0.5, "one": 0.5}, always=(("quantisation", ""),)),
        CaseSet("wide", {"none": 0.5, "one": 0.5}, replace(NUISANCE, parameters=0.05)),
        CaseSet(
            "unknown12",
            {"unknown": 1.0},
            levels=(1 / 6, 1 / 2, 5 / 6),
            unknown=_effects(MISSING_FORMS),
            in_turn=True,
        ),
        CaseSet("both12", {"both": 1.0}, unknown=_effects(MISSING_FORMS)),
        OddRigs(),
        CaseSet("random", {"unknown": 1.0}, unknown=_effects(RANDOM_FORMS), in_turn=True),
    )
}


def named_set(name: str) -> LabelledSet:
    """The set of this name. Raises InputError for one that does not exist."""
    if name not in SETS:
        raise InputError(
            f"is {name!r}, expected one of {', '.join(SETS)}", field="--set", hint="name a set"
        )
    return SETS[name]


def write_case(folder: Path, case_set: LabelledSet, seed: int) -> Path:
    """Writes campaign and truth of a seed to `folder/SEED`; returns that folder."""
    campaign, label = case_set.draw(seed)
    out = folder / str(seed)
    write_campaign(out, campaign)
    text = json.dumps({"schema": "truth/1", **label}, indent=1, default=float) + "\n"
    write_atomically(out / TRUTH, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return out


@dataclass(frozen=True)
class Writer:
    """Writes one seed in a worker."""

    folder: Path
    case_set: LabelledSet

    def __call__(self) -> Function:
        return partial(write_case, self.folder, self.case_set)


def write_cases(
    folder: Path,
    case_set: LabelledSet,
    seeds: Iterable[int],
    workers: int = 2,
    done: Callable[[int], object] | None = None,
) -> list[Path]:
    """One folder per seed, written by `workers` processes; what has its truth already is left as it
    is. Raises InputError naming the first seed that failed.
    """
    seeds = list(seeds)
    missing = [seed for seed in seeds if not (folder / str(seed) / TRUTH).is_file()]
    jobs = [Job(seed, seed) for seed in missing]
    for ended in run_jobs(Writer(folder, case_set), jobs, workers=workers):
        if ended.failure:
            raise InputError(f"seed {ended.key}: {ended.failure}", hint="take another seed")
        if done is not None:
            done(int(ended.key))
    return [folder / str(seed) for seed in seeds]
