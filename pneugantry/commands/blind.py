"""`pneugantry blind`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.blind.set_names import SETS
from pneugantry.options import out_folder
from pneugantry.progress import bar

HELP = """Draw sealed cases from an independent truth plant, diagnose them, unseal, score.

The labels' hash is printed before the first diagnosis starts. Seeds 1000..1999 are development
seeds; take others to judge. With --write the cases are only written, one folder per seed with
its truth.json."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--cases", type=int, default=20, metavar="N", help="number of cases (default: %(default)s)"
    )
    command.add_argument(
        "--seed",
        type=int,
        default=50_000,
        metavar="S",
        help="seed of the first case (default: %(default)s)",
    )
    command.add_argument(
        "--workers", type=int, default=2, metavar="N", help="processes (default: %(default)s)"
    )
    command.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="an existing Dask cluster, as in tcp://host:8786, that sees the same folders",
    )
    command.add_argument(
        "--no-learn",
        action="store_true",
        help="do not look for the term that the catalogue lacks",
    )
    command.add_argument(
        "--set",
        default="plain",
        metavar="NAME",
        help=f"which rigs: {', '.join(SETS)} (default: %(default)s)",
    )
    command.add_argument(
        "--write",
        type=Path,
        metavar="DIR",
        help="write campaigns and truths to DIR/SET/SEED and diagnose nothing",
    )
    command.add_argument(
        "--out",
        type=out_folder,
        metavar="DIR",
        default=Path("out/blind"),
        help="folder of the cases; a run resumes there (default: %(default)s)",
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.blind.check import diagnose_cases, draw_cases, unseal
    from pneugantry.blind.score import TARGETS, score
    from pneugantry.blind.sets import named_set

    if options.cases < 1:
        raise InputError(
            f"is {options.cases}, expected >= 1", field="--cases", hint="draw at least one case"
        )
    case_set = named_set(options.set)
    if options.write is not None:
        return _written(options), 0
    name = "" if options.set == "plain" else f"{options.set}_"
    folder = options.out / f"{name}seed_{options.seed}_cases_{options.cases}"
    seeds = range(options.seed, options.seed + options.cases)
    digest = draw_cases(folder, bar(seeds, options.cases, "draw"), case_set)
    print(f"{options.cases} cases in {folder}; sealed labels: sha256 {digest}")
    counter = bar(range(options.cases), options.cases, "diagnose")

    def advance(name: str) -> None:
        next(counter, None)

    learn = not options.no_learn
    results = diagnose_cases(folder, options.workers, advance, options.scheduler, learn)
    result = score(unseal(folder, digest), results)
    print(f"\n{'measure':<32} {'target':>9} {'got':>8}")
    for name, target in TARGETS.items():
        print(f"{name:<32} {target:>9} {result.table[name]:8.3f}")
    print("\nprobability  share right  claims")
    for probability, right, n in result.reliability:
        print(f"{probability:11.2f} {right:12.2f} {n:7d}")
    print("\nvisibility up to  share right  cases")
    for limit, right, n in result.by_severity:
        print(f"{limit:16.1f} {right:12.2f} {n:6d}")
    print("\nwrong:" if result.confusions else "")
    for text in result.confusions:
        print("  " + text)
    return {
        "schema": "blind/1",
        "sha256": digest,
        "table": result.table,
        "targets": TARGETS,
        "confusions": result.confusions,
        "reliability": result.reliability,
        "by_severity": result.by_severity,
    }, 0


def _written(options: argparse.Namespace) -> dict[str, Any]:
    """Campaigns and truths on disk."""
    from pneugantry.blind.sets import named_set, write_cases

    counter = bar(range(options.cases), options.cases, "write")
    folder = options.write / options.set
    seeds = range(options.seed, options.seed + options.cases)
    write_cases(
        folder, named_set(options.set), seeds, options.workers, lambda _: next(counter, None)
    )
    print(f"{options.cases} cases in {folder}")
    return {"schema": "blind_cases/1", "folder": str(folder), "seeds": list(seeds)}
