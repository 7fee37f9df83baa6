"""Sentences of the report: the verdict, the runner-up and why not, what the logs could not excite."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from pneugantry.diagnosis.bench import FLOOR
from pneugantry.diagnosis.decide import Decision, Hypothesis
from pneugantry.diagnosis.diagnose import Diagnosis
from pneugantry.diagnosis.evidence import Trial

__all__ = [
    "gain_of",
    "label",
    "number",
    "percent",
    "rivals",
    "runner_up",
    "shrink_words",
    "shrinkable",
    "verdict_sentence",
]

NO_EFFECT = "no effect (tolerance and noise alone)"


def number(value: float | None, digits: int = 3) -> str:
    """A number of so many significant digits; "–" where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    if 1 <= abs(value) < 1e6:
        return f"{float(text):.0f}"
    mantissa, exponent = text.split("e")
    return f"{mantissa}·10^{int(exponent)}"


def percent(share: float) -> str:
    """A probability or share; what is neither 0 nor 1 does not read as 0 or 100 %."""
    if not math.isfinite(share):
        return "–"
    if 0 < share < 0.01:
        return "< 1 %"
    return "> 99 %" if 0.99 < share < 1 else f"{100 * share:.0f} %"


def label(keys: tuple[str, ...] | list[str]) -> str:
    """A hypothesis in words."""
    return " + ".join(keys) or NO_EFFECT


def gain_of(hypothesis: Hypothesis) -> float:
    """Evidence over tolerance alone."""
    return hypothesis.trial.gain if hypothesis.trial is not None else 0.0


def shrinkable(gap: dict[str, Any] | None) -> bool:
    """Whether there is a gap above the floor to speak of."""
    return (
        gap is not None
        and all(isinstance(gap[k], int | float | np.floating) for k in ("nominal", "floor"))
        and gap["nominal"] > 1.05 * gap["floor"]
    )


def shrink_words(gap: dict[str, Any] | None) -> str:
    """The gap before and after, and its shrink, as the end of a sentence."""
    if gap is None:
        return "how far the gap shrinks is not known, the held-out log could not be replayed"
    if not shrinkable(gap):
        before, after = number(gap["nominal"]), number(gap["augmented"])
        return (
            f"the gap of {gap['log']} is {before} before and {after} after: at the floor, "
            f"nothing to shrink"
        )
    low, high = gap["ci95"]
    return (
        f"the gap of {gap['log']} goes from {number(gap['nominal'])} to "
        f"{number(gap['augmented'])} (floor {number(gap['floor'])}), "
        f"shrink {gap['shrink']:.3f} [{low:.3f}, {high:.3f}]"
    )


def _with_summaries(decision: Decision, keys: tuple[str, ...]) -> str:
    summaries = (
        {effect.key: effect.summary for effect, _ in decision.best.choice.effects}
        if decision.best is not None
        else {}
    )
    return " and ".join(f"{key} ({summaries[key]})" if summaries.get(key) else key for key in keys)


def verdict_sentence(d: Diagnosis, facts: dict[str, Any]) -> str:
    """One sentence."""
    decision, ranked = d.decision, d.decision.hypotheses
    far = shrink_words(facts["gap"])
    block = facts["where"][0]["block"] if facts["where"] else ""
    if decision.verdict == "none":
        return (
            f"Nothing beyond tolerance and noise was found in these logs; with the tolerance "
            f"fitted, {far}."
        )
    if decision.verdict == "unknown":
        left = percent(min(decision.unexplained, 1.0))
        nearest = (
            f"; the nearest, {label(ranked[0].keys)}, leaves {left} of the misfit of "
            f"{decision.unknown_view}"
            if ranked
            else ""
        )
        where = f" in {block}" if block else ""
        what = (
            f"A real effect{where} that no entry of the catalogue explains (probability "
            f"{percent(decision.unknown)})"
        )
        if decision.resembles is not None:
            nearest = (
                f"; it behaves like "
                f"{decision.resembles.summary}{nearest if decision.unknown_view else ''}"
            )
        return f"{what}{nearest}; with what could be fitted, {far}."
    if decision.verdict == "ambiguous":
        answers = [
            f"{label(h.keys)} ({percent(h.probability)})"
            for h in ranked[:3]
            if h.probability >= 0.005
        ] or ["–"]
        where = f" (first suspect block: {block})" if block else ""
        return (
            f"These logs do not settle which effect it is{where}: {', or '.join(answers)}; "
            f"with the first one, {far}."
        )
    keys = ranked[0].keys if ranked else ()
    probability = percent(ranked[0].probability) if ranked else "–"
    return f"{_with_summaries(decision, keys)} explains the gap (probability {probability}): {far}."


# ---------------------------------------------------------------- which


def rivals(decision: Decision) -> list[tuple[str, float, float | None]]:
    """(hypothesis, probability, gain) that are worth a line, "outside the catalogue" among them; by
    probability.
    """
    rows: list[tuple[str, float, float | None]] = [
        (label(h.keys), h.probability, gain_of(h)) for h in decision.hypotheses
    ]
    rows.append(("an effect outside the catalogue", decision.unknown, None))
    rows = sorted(rows, key=lambda row: -row[1])
    return [row for i, row in enumerate(rows) if row[1] >= 0.005 or i < 3 or row[2] is None][:10]


def runner_up(d: Diagnosis) -> str:
    """The second hypothesis, and why it is not the first."""
    ranked = d.decision.hypotheses
    if len(ranked) < 2:
        return (
            "No other hypothesis was in the running: no block showed more than tolerance "
            "and noise explain."
            if d.decision.verdict == "none"
            else ""
        )
    first, second = ranked[0], ranked[1]
    place = "Second within the catalogue" if d.decision.verdict == "unknown" else "Runner-up"
    behind = gain_of(first) - gain_of(second)
    text = (
        f"{place}: {label(second.keys)}, probability {percent(second.probability)}. "
        f"Its evidence over tolerance alone (fall of −2 log evidence) is "
        f"{number(gain_of(second), 4)} against {number(gain_of(first), 4)}"
    )
    text += (
        f", {number(behind)} less"
        if behind > 0
        else f", {number(-behind)} more, but a further effect must bring more than it does"
        if behind < 0
        else ""
    )
    left = "; ".join(_leaves(d, first.trial, second.trial))
    return f"{text}. {left[0].upper()}{left[1:]}." if left else f"{text}."


def _leaves(d: Diagnosis, first: Trial | None, second: Trial | None) -> Iterator[str]:
    """Where the two hypotheses leave different residuals."""
    for view in sorted(d.found.troubled):
        levels = []
        for trial in (second, first):
            outcome = (
                trial.outcome
                if trial is not None and view in trial.outcome.views
                else d.found.null.get(view)
            )
            if outcome is None or not outcome.counts.get(view):
                break
            levels.append(outcome.rms(view))
        if len(levels) == 2 and abs(levels[0] - levels[1]) > 0.01:
            yield (
                f"in {view} it leaves a residual of {levels[0]:.2f} RMS, the first "
                f"{levels[1]:.2f} (floor {FLOOR.get(view, 1.0):.2f})"
            )
