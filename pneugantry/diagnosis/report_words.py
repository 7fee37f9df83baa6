"""Sentences of the report that need more than the result's JSON: the rivals, the runner-up and why
not.
"""

from __future__ import annotations

from collections.abc import Iterator

from pneugantry.diagnosis.bench import FLOOR
from pneugantry.diagnosis.decide import Decision, Hypothesis
from pneugantry.diagnosis.diagnose import Diagnosis
from pneugantry.diagnosis.evidence import Trial
from pneugantry.report.headline import number, percent

__all__ = ["gain_of", "label", "rivals", "runner_up", "summaries"]

NO_EFFECT = "no effect (tolerance and noise alone)"


def label(keys: tuple[str, ...] | list[str]) -> str:
    """A hypothesis in words."""
    return " + ".join(keys) or NO_EFFECT


def gain_of(hypothesis: Hypothesis) -> float:
    """Evidence over tolerance alone."""
    return hypothesis.trial.gain if hypothesis.trial is not None else 0.0


def summaries(d: Diagnosis) -> dict[str, str]:
    """What the effects of the answer are, in words, by their keys."""
    best = d.decision.best
    return {} if best is None else {effect.key: effect.summary for effect, _ in best.choice.effects}


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
