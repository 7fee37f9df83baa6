"""Weights of the decision from rigs whose truth is known.

`python -m benchmarks.calibrate FOLDER...`: each FOLDER holds campaigns that have been diagnosed
(diagnosis.json beside truth.json, or below sealed_labels.json as `pneugantry blind` leaves them).
Prints how the present weights score on them, those that score best, and how these score on every
rig when it is left out.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.engine.calibration.weights import FITTED, PARTS, Known, calibrated, known_case
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
    cases = cases_in(parser.parse_args(arguments).folders)
    now = Chances()
    best = calibrated(cases, now)
    print(f"{len(cases)} rigs; mean log probability of the truth")
    print(f"{'present':<24} {best.before:7.3f}  {_words(now)}")
    print(f"{'fitted, on rigs left out':<24} {best.score:7.3f}  {_words(best.chances)}")
    for b in best.reliability:
        print(f"{b.what:<8} {b.claims:4d} claims  said {b.said:.2f}  right {b.right:.2f}")
    return 0


def _words(chances: Chances) -> str:
    return "  ".join(f"{n} {getattr(chances, n):.3g}" for n in FITTED)


if __name__ == "__main__":
    raise SystemExit(main())
