"""Weights of the decision from rigs whose truth is known.

`python -m benchmarks.calibrate FOLDER...`: each FOLDER holds campaigns that have been diagnosed
(diagnosis.json beside truth.json, as `pneugantry blind` leaves them). Prints how the present
weights score on them, those that score best, and how these score on every rig when it is left out.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from modelica_fmu.errors import InputError
from pneugantry.engine.calibration import FITTED, Known, fitted, known_case, log_score
from pneugantry.engine.decide import Chances

__all__ = ["cases_in", "left_out", "main"]

PARTS = 5  # of the rigs, each left out in turn


def cases_in(folders: Sequence[Path]) -> list[Known]:
    """All rigs below some folders. Raises InputError where there is none."""
    found = []
    for folder in folders:
        for path in sorted(folder.rglob("truth.json")):
            answer = path.with_name("diagnosis.json")
            if answer.is_file():
                truth, said = (json.loads(p.read_text(encoding="utf-8")) for p in (path, answer))
                found.append(known_case(truth, said))
    if len(found) < PARTS:
        hint = "diagnose some first: pneugantry diagnose FOLDER"
        raise InputError(f"{len(found)} diagnosed rigs with a truth", file=folders[0], hint=hint)
    return found


def left_out(cases: Sequence[Known], start: Chances) -> float:
    """Mean log probability of rigs that the weights have not seen."""
    scores = []
    for k in range(PARTS):
        chances = fitted([c for i, c in enumerate(cases) if i % PARTS != k], start)
        scores += [log_score([c], chances) for i, c in enumerate(cases) if i % PARTS == k]
    return sum(scores) / len(scores)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.calibrate", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    cases = cases_in(parser.parse_args(arguments).folders)
    now = Chances()
    best = fitted(cases, now)
    print(f"{len(cases)} rigs; mean log probability of the truth")
    for what, chances, score in (
        ("present", now, log_score(cases, now)),
        ("best", best, log_score(cases, best)),
        ("best, on rigs left out", None, left_out(cases, now)),
    ):
        values = "" if chances is None else _words(chances)
        print(f"{what:<24} {score:7.3f}  {values}")
    return 0


def _words(chances: Chances) -> str:
    return "  ".join(f"{n} {getattr(chances, n):.3g}" for n in FITTED)


if __name__ == "__main__":
    raise SystemExit(main())
