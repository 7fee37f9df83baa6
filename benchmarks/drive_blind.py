"""The second plant under blind check: `python -m benchmarks.drive_blind [--cases N] [--seed S]
[--rigs N] [--out DIR]`.

Cases of the drive (`examples/drive`) come from a simulator that shares nothing with its model. The
weights of the decision are fitted before to rigs that `pneugantry calibrate` draws from the model.
The labels' hash is printed before the first diagnosis; what is done already is taken from DIR.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.blind.drive import DESCRIPTION, write_drive_cases
from pneugantry.blind.score import TARGETS, Score, score
from pneugantry.blind.sets import TRUTH
from pneugantry.cli import main as command
from pneugantry.engine.calibration.weights import error, known_case, reliability
from pneugantry.engine.chances import Chances
from pneugantry.engine.run import run
from pneugantry.plants.calibration_file import chances_of
from pneugantry.plants.described import described_task
from pneugantry.plants.missing_term import to_json, with_missing_term

__all__ = ["as_json", "main", "weights"]

UNUSED = 92400  # first seed that nobody had looked at
Answers = Mapping[str, Mapping[str, Any]]


def weights(out: Path, rigs: int) -> Chances:
    """Calibrated on so many rigs of the drive's own model; the defaults for 0. Raises InputError
    for too few.
    """
    if rigs == 0:
        return Chances()
    plant = out / "plant" / DESCRIPTION.name
    shutil.copytree(DESCRIPTION.parent, plant.parent, dirs_exist_ok=True)
    code = command(["calibrate", str(plant), "--cases", str(rigs), "--workers", "1"])
    found, note = chances_of(plant)
    if code or note:
        raise InputError(note or "failed", field="--rigs", hint="draw at least 10")
    return found


def _diagnosed(folder: Path, chances: Chances) -> dict[str, Any]:
    """The answer to a case under these weights, from the disk where it is there."""
    kept = folder / "diagnosis.json"
    used = {k: v for k, v in vars(chances).items() if k != "usual"}
    if kept.is_file():
        known: dict[str, Any] = json.loads(kept.read_text(encoding="utf-8"))
        if known["weights"] == used:
            return known
    read, task = described_task(folder / "plant.toml")
    found = run(replace(task, chances=chances), read.rules)
    answer = to_json(*with_missing_term(found, read.rules))
    told: dict[str, Any] = json.loads(json.dumps({**answer, "weights": used}, default=float))
    kept.write_text(json.dumps(told), encoding="utf-8")
    return told


def as_json(truths: Answers, answers: Answers, chances: Chances) -> dict[str, Any]:
    """The table of `pneugantry blind`, each case, and what calibration is worth: the expected
    calibration error of all claims under these weights and under the defaults.
    """
    found: Score = score(truths, answers)
    cases = [known_case(truths[n], a) for n, a in answers.items()]
    errors = {
        name: error(reliability(cases, [w] * len(cases)))
        for name, w in (("calibrated", chances), ("defaults", Chances()))
    }
    return {
        "schema": "drive_blind/1",
        "table": {k: v if math.isfinite(v) else None for k, v in found.table.items()},
        "targets": TARGETS,
        "kinds": {k: sum(t["kind"] == k for t in truths.values()) for k in _kinds(truths)},
        "confusions": found.confusions,
        "reliability": found.reliability,
        "errors": errors,
    }


def _kinds(truths: Answers) -> list[str]:
    return sorted({str(t["kind"]) for t in truths.values()})


def _printed(found: Mapping[str, Any]) -> str:
    kinds = ", ".join(f"{n} {k}" for k, n in found["kinds"].items())
    lines = [f"cases: {kinds}", "", "| measure | target | got |", "|---|---|---|"]
    lines += [
        f"| {name} | {found['targets'][name]} | {got:.3g} |"
        for name, got in found["table"].items()
        if got is not None
    ]
    lines += ["", "calibration error of all claims: "]
    lines[-1] += ", ".join(f"{value:.3f} {name}" for name, value in found["errors"].items())
    return "\n".join([*lines, "", "wrong:", *(f"- {text}" for text in found["confusions"])])


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.drive_blind", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--cases", type=int, default=60, metavar="N", help="number of cases")
    parser.add_argument("--seed", type=int, default=UNUSED, metavar="S", help="first seed")
    parser.add_argument("--rigs", type=int, default=60, metavar="N", help="rigs to calibrate on")
    parser.add_argument("--out", type=Path, default=Path("out/drive-blind"), metavar="DIR")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result to this file")
    options = parser.parse_args(arguments)
    try:
        if options.cases < 1:
            raise InputError(f"is {options.cases}, expected >= 1", field="--cases", hint="draw one")
        chances = weights(options.out, options.rigs)
    except InputError as wrong:
        print(wrong, file=sys.stderr)
        return 2
    seeds = range(options.seed, options.seed + options.cases)
    folders = write_drive_cases(options.out / "cases", seeds)
    texts = {f.name: (f / TRUTH).read_text(encoding="utf-8") for f in folders}
    digest = hashlib.sha256("".join(texts.values()).encode()).hexdigest()
    print(f"{len(folders)} cases; labels: sha256 {digest}", flush=True)
    answers = {}
    for folder in folders:
        answers[folder.name] = _diagnosed(folder, chances)
        print(folder.name, file=sys.stderr, flush=True)
    found = as_json({n: json.loads(t) for n, t in texts.items()}, answers, chances)
    print(_printed(found))
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
