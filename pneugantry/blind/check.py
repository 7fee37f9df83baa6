"""The blind check: sealed cases from the independent truth plant, diagnosed, unsealed, scored.

Labels go into a file of their own whose hash is known before the first diagnosis starts; nothing
else of a case reaches the diagnosis but its folder of logs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.blind.campaigns import diagnose_campaigns
from pneugantry.truth.campaign import write as write_truth
from pneugantry.truth.case import DEVELOPMENT, CaseSet
from pyfmi_runner.build import build_fmu
from pyfmi_runner.log import write_atomically

__all__ = ["DEVELOPMENT_SEEDS", "Score", "diagnose_cases", "draw_cases", "score", "unseal"]

DEVELOPMENT_SEEDS = range(1000, 2000)  # thresholds and weights may look at these, and at no others
TARGETS = {
    "block right": ">= 0.99",
    "cause right, one effect": ">= 0.95",
    "answer set holds the truth": ">= 0.95",
    "answer set, mean size": "<= 1.5",
    "false cause on none": "<= 0.01",
    "unknown called unknown": ">= 0.90",
    "unknown in the right block": ">= 0.95",
    "both causes, two effects": ">= 0.85",
    "shrink, median": ">= 0.90",
    "shrink, 10th percentile": ">= 0.70",
    "expected calibration error": "<= 0.05",
    "seconds, one campaign": "<= 60",
}


def draw_cases(folder: Path, seeds: Iterable[int], case_set: CaseSet = DEVELOPMENT) -> str:
    """Writes one campaign folder per seed and the sealed labels; returns the labels' SHA-256."""
    labels = {}
    for seed in seeds:
        campaign, label = case_set.draw(seed)
        write_truth(folder / f"case_{seed}", campaign)
        labels[str(seed)] = label
    text = json.dumps(labels, sort_keys=True, default=float)
    write_atomically(
        folder / "sealed_labels.json",
        lambda temporary: temporary.write_text(text, encoding="utf-8"),
    )
    return hashlib.sha256(text.encode()).hexdigest()


def diagnose_cases(
    folder: Path, workers: int = 2, done: Callable[[str], object] | None = None
) -> dict[str, dict[str, Any]]:
    """JSON of each case's diagnosis; results that are already on disk are taken from there."""
    cases = sorted(p for p in folder.glob("case_*") if (p / "campaign.toml").is_file())
    results = diagnose_campaigns(cases, build_fmu().path, workers=workers, done=done)
    return {path.name.removeprefix("case_"): result for path, result in results.items()}


def unseal(folder: Path, digest: str) -> dict[str, dict[str, Any]]:
    """The labels, if they are those that were sealed."""
    text = (folder / "sealed_labels.json").read_text(encoding="utf-8")
    if hashlib.sha256(text.encode()).hexdigest() != digest:
        raise InputError(
            "has changed since it was sealed",
            file=folder / "sealed_labels.json",
            hint="draw the cases again",
        )
    labels: dict[str, dict[str, Any]] = json.loads(text)
    return labels


@dataclass(frozen=True)
class Score:
    table: dict[str, float]  # by the names of TARGETS
    confusions: list[str]
    reliability: list[tuple[float, float, int]]  # mean probability, share right, cases
    by_severity: list[tuple[float, float, int]]  # visibility up to, share right, cases


def score(labels: dict[str, dict[str, Any]], results: dict[str, dict[str, Any]]) -> Score:
    """The score table of docs/reference/gap.md."""
    rows = [_judged(seed, labels[seed], results[seed]) for seed in results]

    def share(key: str, *kinds: str) -> float:
        chosen = [r[key] for r in rows if r["kind"] in kinds]
        return float(np.mean(chosen)) if chosen else float("nan")

    shrinks = [r["shrink"] for r in rows if r["shrink"] is not None and r["kind"] in ("one", "two")]
    claims = [claim for r in rows for claim in r["claims"]]
    table = {
        "block right": share("block", "one", "two", "unknown"),
        "cause right, one effect": share("cause", "one"),
        "answer set holds the truth": share("held", "one", "two", "none", "unknown"),
        "answer set, mean size": share("size", "one", "two", "none", "unknown"),
        "false cause on none": 1.0 - share("cause", "none"),
        "unknown called unknown": share("cause", "unknown"),
        "unknown in the right block": share("block", "unknown"),
        "both causes, two effects": share("cause", "two"),
        "shrink, median": float(np.median(shrinks)) if shrinks else float("nan"),
        "shrink, 10th percentile": float(np.quantile(shrinks, 0.1)) if shrinks else float("nan"),
        "expected calibration error": _calibration_error(claims),
        "seconds, one campaign": float(np.nanmedian([r["seconds"] for r in rows])),
    }
    confusions = [r["text"] for r in rows if not r["cause"]]
    return Score(table, confusions, _reliability(claims), _by_severity(rows))


def _judged(seed: str, label: dict[str, Any], result: dict[str, Any]) -> dict[str, Any]:
    truth = [_key(c["effect"], c["axis"]) for c in label["causes"]]
    found = [_key(c["effect"], c["axis"]) for c in result["causes"]]
    blocks = [block for c in label["causes"] for block in c.get("blocks", [c["block"]])]
    kind = label["kind"]
    named = found[: len(truth)]
    if kind == "none":
        right = result["verdict"] == "none"
        held = [] in [sorted(a) for a in result["answer_set"]]
    elif kind == "unknown":
        right = result["verdict"] == "unknown"
        held = ["unknown"] in result["answer_set"]
    else:
        right = (
            sorted(named) == sorted(truth) and result["verdict"] != "unknown"
            if kind == "two"
            else bool(found) and found[0] == truth[0]
        )
        held = sorted(truth) in [sorted(a) for a in result["answer_set"]]
    top = result["causes"][0]["probability"] if result["causes"] else None
    claims = (
        [(float(top), found[0] in truth)]
        if top is not None and result["verdict"] in ("identified", "ambiguous")
        else []
    )
    where = result["where"][0]["block"] if result["where"] else ""
    return {
        "kind": kind,
        "cause": right,
        "held": held,
        "size": max(len(result["answer_set"]), 1),
        "block": where in blocks,
        "claims": claims,
        "shrink": result["gap"]["shrink"] if result["gap"] else None,
        "seconds": result["seconds"],
        "visibility": label.get("visibility", 0.0),
        "text": f"{seed}: {kind} {truth or 'nothing'} in {blocks}, found {result['verdict']} "
        f"{found[:2]} in {where or '-'}",
    }


def _key(effect: str, axis: str) -> str:
    return f"{effect}/{axis}" if axis else effect


def _calibration_error(claims: list[tuple[float, bool]]) -> float:
    if not claims:
        return float("nan")
    return float(sum(n * abs(p - right) for p, right, n in _reliability(claims)) / len(claims))


def _reliability(claims: list[tuple[float, bool]]) -> list[tuple[float, float, int]]:
    bins: dict[int, list[tuple[float, bool]]] = {}
    for probability, right in claims:
        bins.setdefault(min(int(probability * 10), 9), []).append((probability, right))
    return [
        (float(np.mean([p for p, _ in b])), float(np.mean([r for _, r in b])), len(b))
        for _, b in sorted(bins.items())
    ]


def _by_severity(rows: list[dict[str, Any]]) -> list[tuple[float, float, int]]:
    chosen = sorted((r["visibility"], r["cause"]) for r in rows if r["kind"] in ("one", "two"))
    parts = [p for p in np.array_split(np.array(chosen, dtype=float).reshape(-1, 2), 4) if len(p)]
    return [(float(p[-1, 0]), float(p[:, 1].mean()), len(p)) for p in parts]
