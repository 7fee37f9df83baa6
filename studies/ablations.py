"""What each part of the diagnosis earns: the same cases with one part taken out, and an oracle that knows the effects.

`python -m studies.ablations FOLDER [--cases N] [--seed S] [--workers N] [--json FILE]`: draws N cases of the truth plant, every fourth with
tolerance alone and the others with one effect, searches each of them whole and without a part, and prints how often the right cause, or
none, leads. Single effects only, in every variant: without tolerance all views ask for an effect, and the search for pairs takes minutes.
The oracle fits the true effect alone: its shrink on the held-out log is the best that the catalogue's forms reach.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import diagnosis.search as searching
from diagnosis.bench import Bench, Choice
from diagnosis.catalogue import Effect, read_catalogue
from diagnosis.confirm import Augmented, replay_gap
from diagnosis.decide import Decision, decide
from diagnosis.diagnose import OF_VIEWS, split_campaign
from diagnosis.held_out import examine
from diagnosis.search import Search, search
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.replay import Replayer
from studies.truth.campaign import write
from studies.truth.case import draw_case

__all__ = ["VARIANTS", "judge", "table"]

SOUND = 4  # every fourth case has no effect
NO_TOLERANCE = 1e-4  # share; the fit of tolerance needs a scale
VARIANTS = ("whole", "without held-out evidence", "without the cut of evidence", "without tolerance", "without whitening")


def judge(folder: Path, seed: int) -> dict[str, Any]:
    """Whether the right cause leads in each variant, its probability, and the shrink of the whole diagnosis and of the oracle."""
    campaign, label = draw_case(seed, "none" if seed % SOUND == SOUND - 1 else "one")
    write(folder / str(seed), campaign)
    logs = read_campaign(folder / str(seed))
    fitted, held = split_campaign(logs)
    truth = tuple(f"{cause['effect']}/{cause['axis']}" if cause["axis"] else cause["effect"] for cause in label["causes"])
    gantry, catalogue = FmuFile.read(build_fmu().path), read_catalogue()
    result: dict[str, Any] = {"seed": seed, "truth": list(truth)}
    assert held is not None
    with Bench(fitted, gantry) as bench:
        found = _singles(bench, catalogue)
        seen = ("quantisation",) if bench.table.quanta else ()
        result["without held-out evidence"] = _judged(decide(found, seen=seen), truth)
        examine(found, logs, held, gantry)
        decision = decide(found, seen=seen)
        result["whole"] = _judged(decision, truth)
        with patch.object(searching, "borne_out", lambda differences: 1.0):
            result["without the cut of evidence"] = _judged(decide(found, seen=seen), truth)
        plain = found.plain
        for name, trial in (("shrink", decision.best), ("oracle", next((t for t in found.singles if t.choice.keys == truth), None))):
            values = plain | (trial.outcome.values if trial is not None else {})
            values |= bench.polish(trial.choice if trial is not None else Choice(), values).values
            known = {k: float(v) for k, v in values.items() if k not in OF_VIEWS}
            with Replayer(gantry) as plant:
                result[name] = float(replay_gap(plant, held, Augmented.of(known)).shrink)
    for variant, options in (("without tolerance", {"tolerance": NO_TOLERANCE}), ("without whitening", {"whitened": False})):
        with Bench(fitted, gantry, **options) as bench:
            found = _singles(bench, catalogue)
        examine(found, logs, held, gantry)
        result[variant] = _judged(decide(found, seen=seen), truth)
    return result


def _singles(bench: Bench, catalogue: Mapping[str, Effect]) -> Search:
    with patch.object(searching, "_bases", lambda found: []):
        return search(bench, catalogue)


def _judged(decision: Decision, truth: tuple[str, ...]) -> dict[str, Any]:
    leader = decision.hypotheses[0]
    right = leader.keys == truth and decision.verdict != "unknown"
    return {"right": right, "probability": leader.probability, "keys": list(leader.keys), "verdict": decision.verdict}


def table(results: list[dict[str, Any]]) -> str:
    """Shares right by variant, and the shrink beside the oracle's."""
    lines = [f"{'variant':<28} right cause leads   none is called none   mean probability of the leader"]
    for variant in VARIANTS:
        one, none = ([r[variant]["right"] for r in results if bool(r["truth"]) is effect] for effect in (True, False))
        probability = float(np.mean([r[variant]["probability"] for r in results]))
        lines.append(f"{variant:<28} {sum(one):>3} of {len(one):<3}          {sum(none):>3} of {len(none):<3}            {probability:.2f}")
    for name in ("shrink", "oracle"):
        values = [r[name] for r in results if r["truth"]]
        lines.append(f"{name + ', median / least':<28} {np.median(values):.3f} / {np.min(values):.3f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--seed", type=int, default=80_000)
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
