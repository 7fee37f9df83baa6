"""Scores of diagnoses against what the rigs really had: the table of docs/reference/gap.md.

Pure functions of two JSON objects, the truth of a case and the answer `gap/1` to it: any plant, any
engine. An answer names the causes whose probability is at least one half; it is right when these
are the truth, all of it and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["TARGETS", "Judged", "Score", "judged", "score"]

NAMED = 0.5  # probability from which an answer names a cause
BINS = 10  # of a table of reliability
TARGETS = {
    "block right": ">= 0.99",
    "cause right, one effect": ">= 0.95",
    "answer set holds the truth": ">= 0.95",
    "answer set, mean size": "<= 1.5",
    "false cause on none": "<= 0.01",
    "unknown called unknown": ">= 0.90",
    "unknown in the right block": ">= 0.95",
    "both causes, two effects": ">= 0.85",
    "three effects, all right": ">= 0.70",
    "three effects, none wrong": ">= 0.95",
    "known and unknown, both told": "",
    "shrink, median": ">= 0.90",
    "shrink, 10th percentile": ">= 0.70",
    "expected calibration error": "<= 0.05",
    "calibration error of P(none)": "<= 0.05",
    "calibration error of P(unknown)": "<= 0.05",
    "seconds, median": "<= 10",
    "seconds, longest": "<= 40",
}
COUNT = {"one": 1, "two": 2, "three": 3}
FAULTY = ("one", "two", "three", "unknown", "both")
Claim = tuple[float, bool]  # probability, whether it was so


@dataclass(frozen=True)
class Judged:
    """One answer beside its truth."""

    kind: str
    verdict: str
    right: bool  # verdict and named causes are the truth
    wrong_cause: bool  # names a cause that is not there
    block: bool  # the top of `where` is a block with a cause
    held: bool  # the answer set holds the truth
    size: int  # of the answer set
    shrink: float | None
    seconds: float
    visibility: float
    causes: tuple[Claim, ...]  # of every cause in the answer
    none: Claim | None
    unknown: Claim | None
    text: str


@dataclass(frozen=True)
class Score:
    table: dict[str, float]  # by the names of TARGETS; nan where no case tells
    confusions: list[str]
    reliability: list[tuple[float, float, int]]  # mean probability, share right, cases
    by_severity: list[tuple[float, float, int]]  # visibility up to, share right, cases


def key(cause: Mapping[str, Any]) -> str:
    """effect, or effect/axis."""
    return f"{cause['effect']}/{cause['axis']}" if cause.get("axis") else str(cause["effect"])


def judged(name: str, truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Judged:
    """One case. `truth`: kind and causes (effect, axis, block or blocks, known); `answer`: gap/1,
    with `probabilities` of "none" and "unknown" where the engine gives them.
    """
    kind, causes = str(truth["kind"]), truth["causes"]
    known = {key(c) for c in causes if c.get("known", kind != "unknown")}
    hypothesis = sorted(known) + ["unknown"] * (kind in ("unknown", "both"))
    blocks = {block for c in causes for block in c.get("blocks", [c["block"]])}
    given = [c for c in answer["causes"] if c["effect"] != "unknown"]
    named = {key(c) for c in given if c["probability"] >= NAMED}
    verdict = str(answer["verdict"])
    where = str(answer["where"][0]["block"]) if answer["where"] else ""
    sets = [sorted(each) for each in answer["answer_set"]]
    chances = answer.get("probabilities") or {}
    said = "none" if not hypothesis else "unknown" if "unknown" in hypothesis else ""
    return Judged(
        kind=kind,
        verdict=verdict,
        right=named == known and (verdict == said if said else verdict not in ("none", "unknown")),
        wrong_cause=bool(named - known),
        block=where in blocks,
        held=hypothesis in sets,
        size=max(len(sets), 1),
        shrink=answer["gap"]["shrink"] if answer.get("gap") else None,
        seconds=float(answer["seconds"]),
        visibility=float(truth.get("visibility", 0.0)),
        causes=tuple((float(c["probability"]), key(c) in known) for c in given),
        none=_claim(chances, "none", not hypothesis),
        unknown=_claim(chances, "unknown", "unknown" in hypothesis),
        text=f"{name}: {kind} {sorted(map(key, causes)) or 'nothing'} in {sorted(blocks)}, "
        f"found {verdict} {sorted(named)} in {where or '-'}{_reason(answer)}",
    )


def _reason(answer: Mapping[str, Any]) -> str:
    """Why a diagnosis failed, where it did."""
    return f": {answer['reason']}" if answer.get("reason") else ""


def _claim(chances: Mapping[str, float], name: str, so: bool) -> Claim | None:
    return (float(chances[name]), so) if name in chances else None


def score(
    truths: Mapping[str, Mapping[str, Any]], answers: Mapping[str, Mapping[str, Any]]
) -> Score:
    """The table over all answers; a row is nan where there is no case of its kind."""
    cases = [judged(name, truths[name], answer) for name, answer in answers.items()]
    claims = [claim for case in cases for claim in case.causes]
    return Score(
        {**_shares(cases), **_numbers(cases)},
        [case.text for case in cases if not case.right],
        reliability(claims),
        _by_severity(cases),
    )


def _shares(cases: Sequence[Judged]) -> dict[str, float]:
    """Rows that are shares of cases."""

    def share(of: Callable[[Judged], bool], *kinds: str) -> float:
        chosen = [of(case) for case in cases if case.kind in kinds]
        return float(np.mean(chosen)) if chosen else float("nan")

    return {
        "block right": share(lambda c: c.block, *FAULTY),
        "cause right, one effect": share(lambda c: c.right, "one"),
        "answer set holds the truth": share(lambda c: c.held, "none", *FAULTY),
        "false cause on none": 1.0 - share(lambda c: c.right, "none"),
        "unknown called unknown": share(lambda c: c.verdict == "unknown", "unknown"),
        "unknown in the right block": share(lambda c: c.block, "unknown"),
        "both causes, two effects": share(lambda c: c.right, "two"),
        "three effects, all right": share(lambda c: c.right, "three"),
        "three effects, none wrong": share(lambda c: not c.wrong_cause, "three"),
        "known and unknown, both told": share(lambda c: c.right, "both"),
    }


def _numbers(cases: Sequence[Judged]) -> dict[str, float]:
    """Rows that are sizes, shrinks, calibration errors and times."""
    shrinks = [c.shrink for c in cases if c.shrink is not None and c.kind in COUNT]
    seconds = [c.seconds for c in cases if np.isfinite(c.seconds)]
    return {
        "answer set, mean size": _statistic(np.mean, [c.size for c in cases]),
        "shrink, median": _statistic(np.median, shrinks),
        "shrink, 10th percentile": _statistic(lambda v: np.quantile(v, 0.1), shrinks),
        "expected calibration error": calibration_error(p for c in cases for p in c.causes),
        "calibration error of P(none)": calibration_error(c.none for c in cases if c.none),
        "calibration error of P(unknown)": calibration_error(c.unknown for c in cases if c.unknown),
        "seconds, median": _statistic(np.median, seconds),
        "seconds, longest": _statistic(np.max, seconds),
    }


def _statistic(of: Callable[[Any], Any], values: Sequence[float]) -> float:
    return float(of(values)) if values else float("nan")


def calibration_error(claims: Iterable[Claim]) -> float:
    """Expected calibration error over ten even bins; nan without claims."""
    claims = list(claims)
    if not claims:
        return float("nan")
    return sum(n * abs(p - right) for p, right, n in reliability(claims)) / len(claims)


def reliability(claims: Iterable[Claim]) -> list[tuple[float, float, int]]:
    """Mean probability, share that was so and number of claims of each bin that has any."""
    bins: dict[int, list[Claim]] = {}
    for probability, so in claims:
        bins.setdefault(min(int(probability * BINS), BINS - 1), []).append((probability, so))
    return [
        (float(np.mean([p for p, _ in b])), float(np.mean([so for _, so in b])), len(b))
        for _, b in sorted(bins.items())
    ]


def _by_severity(cases: Sequence[Judged]) -> list[tuple[float, float, int]]:
    """Share right by quarters of visibility, of the cases with effects of the catalogue."""
    chosen = sorted((case.visibility, case.right) for case in cases if case.kind in COUNT)
    parts = [p for p in np.array_split(np.array(chosen, dtype=float).reshape(-1, 2), 4) if len(p)]
    return [(float(p[-1, 0]), float(p[:, 1].mean()), len(p)) for p in parts]
