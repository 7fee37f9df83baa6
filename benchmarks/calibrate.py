"""Weights of `diagnosis.decide` from development cases: what evidence has been worth on rigs whose
effects are known.

`python -m benchmarks.calibrate FOLDER [--cases N] [--seed S] [--workers N] [--fit]`: searches N
development cases once (kept in FOLDER, taken from there next time), prints how the present weights
score on them and, with --fit, the weights that score best.
"""

from __future__ import annotations

import argparse
import math
import pickle
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.blind.check import DEVELOPMENT_SEEDS
from pneugantry.diagnosis.bench import Bench
from pneugantry.diagnosis.decide import Decision, Weights, decide
from pneugantry.diagnosis.diagnose import split_campaign
from pneugantry.diagnosis.evidence import Search
from pneugantry.diagnosis.held_out import examine
from pneugantry.diagnosis.search import search
from pneugantry.engine.catalogue import read_catalogue
from pneugantry.truth.campaign import write
from pneugantry.truth.case import draw_case
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile

__all__ = ["Case", "collect", "fitted_weights", "log_score", "summary"]

LEAST = 0.01  # probability that a truth has at least: one case must not decide
GRID: dict[str, Sequence[float]] = {
    "temperature": (0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 1.0),
    "single_cost": (2.0, 5.0, 8.0, 12.0, 16.0, 24.0),
    "pair_cost": (8.0, 12.0, 16.0, 24.0, 32.0, 48.0),
    "unknown_share": (0.05, 0.1, 0.15, 0.2, 0.3, 0.4),
    "unknown_excess": (0.1, 0.3, 1.0, 3.0, 10.0),
    "unknown_slope": (1.0, 2.0, 3.0, 4.0),
    "unknown_least": (5.0, 10.0, 15.0, 20.0, 30.0),
}


@dataclass(frozen=True)
class Case:
    """One development case: what it has, and what the search made of it."""

    seed: int
    kind: str
    truth: frozenset[str]  # effects of the catalogue; {"unknown"} for one outside it
    found: Search
    seen: tuple[str, ...]  # effects that the readings show by themselves


def collect(folder: Path, seeds: Iterable[int], workers: int = 2) -> list[Case]:
    """Searches every seed that the folder does not hold yet. Raises InputError for a seed that is
    not for development.
    """
    seeds = list(seeds)
    if any(seed not in DEVELOPMENT_SEEDS for seed in seeds):
        raise InputError(
            f"weights may look at seeds {DEVELOPMENT_SEEDS[0]}..{DEVELOPMENT_SEEDS[-1]} only",
            field="--seed",
        )
    folder.mkdir(parents=True, exist_ok=True)
    build_fmu()
    waiting = [(folder, seed) for seed in seeds if not (folder / f"{seed}.pickle").is_file()]
    with ProcessPoolExecutor(max_workers=workers) as pool:
        for seed in pool.map(_search_one, waiting):
            print(f"searched {seed}", flush=True)
    return [pickle.loads((folder / f"{seed}.pickle").read_bytes()) for seed in seeds]


def _search_one(job: tuple[Path, int]) -> int:
    folder, seed = job
    campaign, label = draw_case(seed)
    write(folder / str(seed), campaign)
    logs = read_campaign(folder / str(seed))
    fitted, held = split_campaign(logs)
    gantry = FmuFile.read(build_fmu().path)
    with Bench(fitted, gantry) as bench:
        found = search(bench, read_catalogue())
        seen = ("quantisation",) if bench.table.quanta else ()
    if held is not None:
        examine(found, logs, held, gantry)
    for outcome in [*found.null.values(), *(t.outcome for t in found.singles + found.pairs)]:
        outcome.fit.columns.clear()
    (folder / f"{seed}.pickle").write_bytes(pickle.dumps(case_of(seed, label, found, seen)))
    return seed


def case_of(seed: int, label: dict[str, Any], found: Search, seen: tuple[str, ...]) -> Case:
    """A case with its truth by the keys of the catalogue."""
    names = {f"{c['effect']}/{c['axis']}" if c["axis"] else c["effect"] for c in label["causes"]}
    truth = frozenset({"unknown"} if label["kind"] == "unknown" else names)
    return Case(seed, label["kind"], truth, found, seen)


def log_score(cases: Sequence[Case], weights: Weights) -> float:
    """Mean log probability of what the rigs really have."""
    return sum(
        math.log(max(_probability(case, decide(case.found, weights, case.seen)), LEAST))
        for case in cases
    ) / len(cases)


def _probability(case: Case, decision: Decision) -> float:
    if case.truth == {"unknown"}:
        return decision.unknown
    return sum(h.probability for h in decision.hypotheses if frozenset(h.keys) == case.truth)


def fitted_weights(cases: Sequence[Case], start: Weights, rounds: int = 3) -> Weights:
    """Best weights on the grid, one after the other, a few times round."""
    best, score = start, log_score(cases, start)
    for _ in range(rounds):
        before = score
        for name, values in GRID.items():
            for value in values:
                trial = replace(best, **{name: value})
                if (s := log_score(cases, trial)) > score + 1e-9:
                    best, score = trial, s
        if score - before < 1e-6:
            break
    return best


def summary(cases: Sequence[Case], weights: Weights) -> str:
    """Share of each kind whose truth has the highest probability, and the log score."""
    right: dict[str, list[bool]] = {}
    for case in cases:
        decision = decide(case.found, weights, case.seen)
        ranked = [(h.probability, frozenset(h.keys)) for h in decision.hypotheses] + [
            (decision.unknown, frozenset({"unknown"}))
        ]
        right.setdefault(case.kind, []).append(max(ranked, key=lambda r: r[0])[1] == case.truth)
    shares = ", ".join(f"{kind} {sum(r)}/{len(r)}" for kind, r in sorted(right.items()))
    return f"{shares}; log score {log_score(cases, weights):.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=DEVELOPMENT_SEEDS[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fit", action="store_true")
    options = parser.parse_args()
    cases = collect(
        options.folder, range(options.seed, options.seed + options.cases), options.workers
    )
    print("present", summary(cases, Weights()))
    if options.fit:
        best = fitted_weights(cases, Weights())
        print("fitted ", summary(cases, best), best)


if __name__ == "__main__":
    main()
