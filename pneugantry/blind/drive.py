"""Labelled cases of the drive on disk: `python -m pneugantry.blind.drive --write DIR`.

Each seed is a folder of three logs, a plant.toml that reads them with the model and the catalogue
of `examples/drive`, and a truth.json that no diagnosis reads. `--data DIR` writes the logs and the
truth of one seed alone: the data of the tutorial.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from pneugantry.blind.description import relocated
from pneugantry.blind.sets import TRUTH
from pneugantry.truth.drive.case import DriveSet, draw_drive_case

__all__ = ["DESCRIPTION", "main", "write_drive_case", "write_drive_cases"]

DESCRIPTION = Path(__file__).resolve().parents[2] / "examples" / "drive" / "plant.toml"


def write_drive_case(folder: Path, seed: int, case_set: DriveSet | None = None) -> Path:
    """Writes the logs, the description and the truth of a seed to `folder/SEED`; returns it."""
    out = folder / str(seed)
    _write_logs(out, seed, case_set)
    (out / "plant.toml").write_text(relocated(DESCRIPTION, out), encoding="utf-8")
    return out


def write_drive_cases(
    folder: Path, seeds: Iterable[int], case_set: DriveSet | None = None
) -> list[Path]:
    """One folder per seed."""
    return [write_drive_case(folder, seed, case_set) for seed in seeds]


def _write_logs(out: Path, seed: int, case_set: DriveSet | None) -> None:
    logs, label = draw_drive_case(seed, case_set)
    out.mkdir(parents=True, exist_ok=True)
    for name, frame in logs.items():
        frame.to_csv(out / f"{name}.csv", index=False)
    text = json.dumps({"schema": "truth/1", **label}, indent=1, default=float) + "\n"
    (out / TRUTH).write_text(text, encoding="utf-8")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m pneugantry.blind.drive", description=__doc__.splitlines()[0]
    )
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--write", type=Path, metavar="DIR", help="folder of the cases")
    where.add_argument("--data", type=Path, metavar="DIR", help="folder of one case's logs")
    parser.add_argument("--seed", type=int, default=78600, metavar="S", help="first seed")
    parser.add_argument("--cases", type=int, default=20, metavar="N", help="number of cases")
    parser.add_argument("--kind", default="", metavar="KIND", help="only this kind of case")
    options = parser.parse_args(arguments)
    case_set = DriveSet()
    if options.kind:
        case_set = replace(case_set, mixture={options.kind: 1.0})
    if options.data is not None:
        _write_logs(options.data, options.seed, case_set)
        return 0
    seeds = range(options.seed, options.seed + options.cases)
    for path in write_drive_cases(options.write, seeds, case_set):
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
