"""What each part of the diagnosis earns: the same cases with one part taken out, and an oracle that
knows the effects.

`python -m benchmarks.ablations FOLDER [--cases N] [--seed S] [--workers N] [--json FILE]`: draws N
cases of the truth plant, one effect, two, one outside the catalogue and none in turn, diagnoses
each of them whole and without a part, and prints how often the answer is right: all causes lead, or
the verdict is "unknown", or none leads. Cases of one effect and of none are searched for single
effects only, and they alone without tolerance and without whitening: there all views ask for an
effect, and the search for pairs takes minutes. The oracle is the true effect alone: its shrink on
the held-out log is the best that the catalogue's forms reach.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

import pneugantry.diagnosis.evidence as evidence_module
import pneugantry.diagnosis.search as search_module
import pneugantry.diagnosis.tight_lead as tight_lead_module
from pneugantry.diagnosis.bench import Bench, Choice
from pneugantry.diagnosis.confirm import Augmented, replay_gap
from pneugantry.diagnosis.decide import Decision, decide
from pneugantry.diagnosis.diagnose import OF_VIEWS, split_campaign
from pneugantry.diagnosis.evidence import Search, Trial
from pneugantry.diagnosis.held_out import examine
from pneugantry.diagnosis.records import oddity
from pneugantry.diagnosis.search import search
from pneugantry.engine.catalogue import Effect, read_catalogue
from pneugantry.truth.campaign import write
from pneugantry.truth.case import draw_case
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import LoggedRun, read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.replay import Replayer

__all__ = ["VARIANTS", "judge", "table"]

KINDS = ("one", "two", "unknown", "none")  # in turn, by seed
NO_TOLERANCE = 1e-4  # share; the fit of tolerance needs a scale
VARIANTS = (
    "whole",
    "without held-out evidence",
    "without the cut of evidence",
    "without first fits at a high observer gain",
    "without tolerance",
    "without whitening",
)


def judge(folder: Path, seed: int) -> dict[str, Any]:
    """Whether the answer is right in each variant, its probability, and, of one effect, the shrink
    of the diagnosis and of the oracle.
    """
    kind = KINDS[seed % len(KINDS)]
    campaign, label = draw_case(seed, kind)
    write(folder / str(seed), campaign)
    logs = read_campaign(folder / str(seed))
    fitted, held = split_campaign(logs)
    truth = frozenset(
        f"{cause['effect']}/{cause['axis']}" if cause["axis"] else cause["effect"]
        for cause in label["causes"]
    )
    gantry, catalogue = FmuFile.read(build_fmu().path), read_catalogue()
    result: dict[str, Any] = {"seed": seed, "kind": kind, "truth": sorted(truth)}
    assert held is not None
    search_all = search if kind in ("two", "unknown") else _singles

    def decided(found: Search) -> Decision:
        return decide(found, seen=seen, odd=odd)

    def judged(decision: Decision) -> dict[str, Any]:
        return _judged(decision, kind, truth)

    with Bench(fitted, gantry) as bench:
        found = search_all(bench, catalogue)
        seen, odd = ("quantisation",) if bench.table.quanta else (), oddity(bench.table)
        result["without held-out evidence"] = judged(decided(found))
        examine(found, logs, held, gantry)
        decision = decided(found)
        result["whole"] = judged(decision)
        with patch.object(evidence_module, "borne_out", lambda differences: 1.0):
            result["without the cut of evidence"] = judged(decided(found))
        if kind == "one":
            result["shrink"] = _shrink(bench, found, decision.best, held, gantry)
            true = next((t for t in found.singles if set(t.choice.keys) == truth), None)
            result["oracle"] = (
                _shrink(bench, found, true, held, gantry) if true is not None else math.nan
            )  # the true effect was not fitted
    loose = patch.object(
        search_module, "first_fit", lambda bench, candidate: SimpleNamespace(values={})
    )
    with (
        Bench(fitted, gantry) as bench,
        patch.object(tight_lead_module, "LARGE", math.inf),
        loose,
    ):
        found = search_all(bench, catalogue)
    examine(found, logs, held, gantry)
    result["without first fits at a high observer gain"] = judged(decided(found))
    if search_all is _singles:
        for variant, options in (
            ("without tolerance", {"tolerance": NO_TOLERANCE}),
            ("without whitening", {"whitened": False}),
        ):
            with Bench(fitted, gantry, **options) as bench:
                found = search_all(bench, catalogue)
            examine(found, logs, held, gantry)
            result[variant] = judged(decided(found))
    return result


def _singles(bench: Bench, catalogue: Mapping[str, Effect]) -> Search:
    with patch.object(search_module, "_bases", lambda found: []):
        return search(bench, catalogue)


def _shrink(
    bench: Bench, found: Search, trial: Trial | None, held: LoggedRun, gantry: FmuFile
) -> float:
    """Share of the held-out gap that a hypothesis closes."""
    values = found.plain | (trial.outcome.values if trial is not None else {})
    values |= bench.polish(trial.choice if trial is not None else Choice(), values).values
    with Replayer(gantry) as plant:
        return float(
            replay_gap(
                plant,
                held,
                Augmented.of({k: float(v) for k, v in values.items() if k not in OF_VIEWS}),
            ).shrink
        )


def _judged(decision: Decision, kind: str, truth: frozenset[str]) -> dict[str, Any]:
    leader = decision.hypotheses[0]
    unknown = decision.verdict == "unknown"
    right = unknown if kind == "unknown" else set(leader.keys) == truth and not unknown
    return {
        "right": right,
        "probability": leader.probability,
        "keys": list(leader.keys),
        "verdict": decision.verdict,
    }


def table(results: list[dict[str, Any]]) -> str:
    """Cases right by variant and kind ("-": not run), and the shrink beside the oracle's."""
    lines = [f"{'right':<28}" + "".join(f"{kind:>12}" for kind in KINDS)]
    for variant in VARIANTS:
        cells = []
        for kind in KINDS:
            right = [r[variant]["right"] for r in results if r["kind"] == kind and variant in r]
            cells.append(f"{sum(right)} of {len(right)}" if right else "-")
        lines.append(f"{variant:<28}" + "".join(f"{cell:>12}" for cell in cells))
    for name in ("shrink", "oracle"):
        values = [r[name] for r in results if math.isfinite(r.get(name, math.nan))]
        if values:
            lines.append(
                f"{name + ', median / least':<28} {np.median(values):.3f} / {np.min(values):.3f}"
            )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--seed", type=int, default=82_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    build_fmu()
    seeds = range(options.seed, options.seed + options.cases)
    with ProcessPoolExecutor(max_workers=options.workers) as pool:
        job: Callable[[Path, int], dict[str, Any]] = judge
        results = []
        for result in pool.map(job, [options.folder] * len(seeds), seeds):
            results.append(result)
            print(json.dumps(result), flush=True)
            if options.json is not None:
                options.json.write_text(json.dumps(results), encoding="utf-8")
    print(table(results))


if __name__ == "__main__":
    main()
