"""A labelled development case from one integer: tolerance, causes, campaign, and how visible the
causes are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pneugantry.truth.campaign import Campaign, log_frame
from pneugantry.truth.effects import KNOWN_FORMS, UNKNOWN_FORMS, draw_cause, names
from pneugantry.truth.form import Cause
from pneugantry.truth.loop import Luck
from pneugantry.truth.parameters import Rig, nominal
from pneugantry.truth.run import Outcome, draws, run
from pneugantry.truth.setups import campaign_setups
from pneugantry.truth.tolerance import with_tolerance
from pneugantry.truth.visibility import visibility

MIXTURE = {"one": 0.45, "two": 0.20, "unknown": 0.15, "none": 0.20}
LEAST_VISIBLE = 0.3  # sigma, on the best log and channel
REDRAWS = 6


@dataclass(frozen=True)
class Case:
    """What a seed stands for, before it is run."""

    seed: int
    kind: str
    rig: Rig  # with its tolerance, without effects
    tolerance: dict[str, float]
    causes: tuple[Cause, ...]


def plan_case(
    seed: int,
    kind: str | None = None,
    rms: float = 0.02,
    effects: tuple[tuple[str, str], ...] | None = None,
) -> Case:
    """Draw kind, tolerance and causes. `kind` or `effects`, (effect, axis) pairs, fix what the
    mixture would draw.
    """
    rng = np.random.default_rng([seed, 1])
    if effects is None:
        drawn_kind = str(rng.choice(list(MIXTURE), p=list(MIXTURE.values())))
        kind = drawn_kind if kind is None else kind
        pool = names(UNKNOWN_FORMS if kind == "unknown" else KNOWN_FORMS)
        count = {"none": 0, "one": 1, "two": 2, "unknown": 1}[kind]
        effects = tuple(pool[j] for j in rng.choice(len(pool), size=count, replace=False))
    elif kind is None:
        unknown = any(pair in names(UNKNOWN_FORMS) for pair in effects)
        kind = "unknown" if unknown else ("none", "one", "two")[len(effects)]
    rig, tolerance = with_tolerance(nominal(), rng, rms)
    return Case(seed, kind, rig, tolerance, tuple(draw_cause(rng, *pair) for pair in effects))


def _apply(rig: Rig, causes: tuple[Cause, ...]) -> Rig:
    for cause in causes:
        rig, _ = cause.apply(rig)
    return rig


def _run_all(rig: Rig, drawn: dict[str, Luck]) -> dict[str, Outcome]:
    return {name: run(rig, setup, draw=drawn[name]) for name, setup in campaign_setups().items()}


def run_case(case: Case) -> tuple[Campaign, dict]:
    """(campaign, label). A cause that hardly shows is redrawn larger; its size in the label is the
    one that ran.
    """
    setups = campaign_setups()
    seeds = np.random.SeedSequence([case.seed, 2]).spawn(len(setups))
    drawn = {name: draws(setups[name].rows, seed) for name, seed in zip(setups, seeds, strict=True)}
    rng, causes = np.random.default_rng([case.seed, 3]), list(case.causes)
    outcomes: dict[str, Outcome] = {}
    seen: list[dict[str, float]] = []
    for _ in range(REDRAWS):
        outcomes = _run_all(_apply(case.rig, tuple(causes)), drawn)
        seen = []
        for j, cause in enumerate(causes):
            without = _apply(case.rig, tuple(causes[:j] + causes[j + 1 :]))
            seen.append(visibility(outcomes, without, setups, drawn, cause.form.part == "timing"))
        faint = [j for j, logs in enumerate(seen) if max(logs.values()) < LEAST_VISIBLE]
        if not faint:
            break
        for j in faint:
            causes[j] = replace(causes[j], size=causes[j].form.draw_size(rng, causes[j].size))
    return {name: log_frame(outcome) for name, outcome in outcomes.items()}, _label(
        case, causes, seen
    )


def _label(case: Case, causes: list[Cause], seen: list[dict[str, float]]) -> dict:
    entries = []
    for j, (cause, logs) in enumerate(zip(causes, seen, strict=True)):
        before = _apply(case.rig, tuple(causes[:j]))
        best = max(logs.values())
        shows = {"visibility": best, "visibility_rms": _rms(logs), "visibility_logs": logs}
        entries.append({**cause.entry(before), **shows})
    return {
        "seed": case.seed,
        "kind": case.kind,
        "causes": entries,
        "tolerance": case.tolerance,
        "visibility": min((entry["visibility"] for entry in entries), default=0.0),
    }


def _rms(logs: dict[str, float]) -> float:
    return float(np.sqrt(np.mean(np.square(list(logs.values())))))


def draw_case(seed: int, kind: str | None = None, rms: float = 0.02) -> tuple[Campaign, dict]:
    """(campaign, label) of an integer seed: 45 % one effect, 20 % two, 15 % out of catalogue, 20 %
    none.
    """
    return run_case(plan_case(seed, kind, rms))
