"""Weights of the decision from rigs whose truth is known.

`python -m benchmarks.calibrate [--with NAME=VALUE] FOLDER...`: each FOLDER holds campaigns that
have been diagnosed (diagnosis.json beside truth.json, or below sealed_labels.json as `pneugantry
blind` leaves them). Prints how the present weights score on them, those that score best, and how
these score on every rig when it is left out. With other values given, how the present ones and
those score instead.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.engine.calibration.weights import (
    FITTED,
    PARTS,
    SHARES,
    Known,
    calibrated,
    error,
    known_case,
    log_score,
    reliability,
)
from pneugantry.engine.chances import Chances

__all__ = ["cases_in", "main"]


def cases_in(folders: Sequence[Path]) -> list[Known]:
    """All rigs below some folders. Raises InputError where there is none."""
    found = []
    for folder in folders:
        truths = {path.parent: _read(path) for path in folder.rglob("truth.json")}
        for path in folder.rglob("sealed_labels.json"):
            truths |= {path.parent / f"case_{seed}": t for seed, t in _read(path).items()}
        for case in sorted(truths):
            if (case / "diagnosis.json").is_file():
                found.append(known_case(truths[case], _read(case / "diagnosis.json")))
    if len(found) < PARTS:
        hint = "diagnose some first: pneugantry diagnose FOLDER"
        raise InputError(f"{len(found)} diagnosed rigs with a truth", file=folders[0], hint=hint)
    return found


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.calibrate", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument(
        "--with",
        dest="other",
        action="append",
        default=[],
        type=_weight,
        metavar="NAME=VALUE",
        help=f"another value of a weight, beside the present ones: {', '.join(FITTED)}",
    )
    given = parser.parse_args(arguments)
    cases, now = cases_in(given.folders), Chances()
    if given.other:
        _compared(cases, (now, replace(now, **dict(given.other))))
        return 0
    best = calibrated(cases, now)
    print(f"{len(cases)} rigs; mean log probability of the truth")
    print(f"{'present':<24} {best.before:7.3f}  {_words(now)}")
    print(f"{'fitted, on rigs left out':<24} {best.score:7.3f}  {_words(best.chances)}")
    for b in best.reliability:
        print(f"{b.what:<8} {b.claims:4d} claims  said {b.said:.2f}  right {b.right:.2f}")
    return 0


def _compared(cases: Sequence[Known], weights: Sequence[Chances]) -> None:
    """Prints how each of some weights scores."""
    print(f"{len(cases)} rigs; mean log probability of the truth; calibration error of claims")
    for chances in weights:
        table = reliability(cases, [chances] * len(cases))
        kinds = dict.fromkeys(b.what for b in table)
        errors = {k: error([b for b in table if b.what == k]) for k in kinds}
        told = "  ".join(f"{k} {e:.3f}" for k, e in errors.items())
        print(f"{log_score(cases, chances):7.3f}  {told}  {_words(chances)}")


def _weight(given: str) -> tuple[str, float]:
    """Of NAME=VALUE. Raises ArgumentTypeError where that is none, or beyond its bounds."""
    name, _, value = given.partition("=")
    try:
        if name in FITTED and 0 < float(value) < (1 if name in SHARES else math.inf):
            return name, float(value)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{given!r}: NAME=VALUE, of {', '.join(FITTED)}")


def _words(chances: Chances) -> str:
    return "  ".join(f"{n} {getattr(chances, n):.3g}" for n in FITTED)


if __name__ == "__main__":
    raise SystemExit(main())
