"""A case as planned, and as run: campaign and label, and how visible its causes are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from pneugantry.truth.campaign import Campaign, log_frame
from pneugantry.truth.form import Cause
from pneugantry.truth.parameters import CHANNELS, Rig
from pneugantry.truth.run import Outcome, draws, run
from pneugantry.truth.sensors import Luck
from pneugantry.truth.setups import Setup, campaign_setups
from pneugantry.truth.visibility import visibility

LEAST_VISIBLE = 0.3  # sigma, on the best log and channel
REDRAWS = 6


@dataclass(frozen=True)
class Case:
    """What a seed stands for, before it is run."""

    seed: int
    kind: str
    rig: Rig  # with tolerance and nuisances, without effects
    tolerance: dict[str, float]
    causes: tuple[Cause, ...]
    standoff: float = 0.0  # m, true stand-off less the one that the campaign says
    logs: tuple[str, ...] = ()  # the campaign's logs; none: all seven
    channels: tuple[str, ...] = CHANNELS  # that the rig measures
    least_visible: float = LEAST_VISIBLE  # sigma; a fainter cause is drawn again

    def setups(self) -> dict[str, Setup]:
        """The logs as the campaign describes them."""
        return {
            name: setup
            for name, setup in campaign_setups().items()
            if not self.logs or name in self.logs
        }

    def true_setups(self) -> dict[str, Setup]:
        """The logs as they really are."""
        return {
            name: replace(setup, standoff=setup.standoff + self.standoff)
            for name, setup in self.setups().items()
        }


def _apply(rig: Rig, causes: tuple[Cause, ...]) -> Rig:
    return reduce(lambda changed, cause: cause.apply(changed)[0], causes, rig)


def run_case(case: Case) -> tuple[Campaign, dict]:
    """(campaign, label). A cause that hardly shows is redrawn larger; its size in the label is the
    one that ran.
    """
    setups = case.true_setups()
    drawn = _luck(case, setups)
    rng, causes = np.random.default_rng([case.seed, 3]), list(case.causes)
    outcomes: dict[str, Outcome] = {}
    seen: list[dict[str, float]] = []
    for _ in range(REDRAWS):
        rig = _apply(case.rig, tuple(causes))
        outcomes = {name: run(rig, setup, draw=drawn[name]) for name, setup in setups.items()}
        seen = [_seen(case, causes, j, outcomes, drawn) for j in range(len(causes))]
        faint = [j for j, logs in enumerate(seen) if max(logs.values()) < case.least_visible]
        if not faint:
            break
        for j in faint:
            causes[j] = replace(causes[j], size=causes[j].form.draw_size(rng, causes[j].size))
    campaign = {name: log_frame(outcome) for name, outcome in outcomes.items()}
    missing = [name for name in CHANNELS if name not in case.channels]
    return {name: frame.drop(columns=missing) for name, frame in campaign.items()}, _label(
        case, causes, seen
    )


def _luck(case: Case, setups: dict[str, Setup]) -> dict[str, Luck]:
    """Noise and chance of each log; a log's do not depend on which others are there."""
    names = list(campaign_setups())
    seeds = dict(zip(names, np.random.SeedSequence([case.seed, 2]).spawn(len(names)), strict=True))
    return {name: draws(setup.rows, seeds[name]) for name, setup in setups.items()}


def _seen(
    case: Case, causes: list[Cause], j: int, outcomes: dict[str, Outcome], drawn: dict[str, Luck]
) -> dict[str, float]:
    """Visibility of cause j per log, in sigma, on the channels that are measured."""
    without = _apply(case.rig, tuple(causes[:j] + causes[j + 1 :]))
    kept = [CHANNELS.index(name) for name in case.channels]
    timing = causes[j].form.part == "timing"
    return visibility(outcomes, without, case.true_setups(), drawn, timing, kept)


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
