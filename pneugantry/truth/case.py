"""Labelled cases, each from one integer: what is drawn for it is a frozen description, and a seed
gives the same campaign each time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pneugantry.truth.campaign import Campaign
from pneugantry.truth.case_run import LEAST_VISIBLE, Case, run_case
from pneugantry.truth.effects import (
    KNOWN_FORMS,
    OUTSIDE_FORMS,
    UNKNOWN_FORMS,
    draw_cause,
    names,
)
from pneugantry.truth.form import Cause
from pneugantry.truth.nuisance import NUISANCE, PLAIN, RigDraw, draw_rig, tolerated_size
from pneugantry.truth.parameters import CHANNELS

__all__ = [
    "DEVELOPMENT",
    "LEAST_VISIBLE",
    "MIXTURE",
    "Case",
    "CaseSet",
    "draw_case",
    "plan_case",
    "run_case",
]

MIXTURE = {"one": 0.45, "two": 0.20, "unknown": 0.15, "none": 0.20}
ORDINARY = {"none": 0.25, "one": 0.40, "two": 0.20, "unknown": 0.15}
COUNTS = {  # kind of case: effects of the catalogue, effects that no catalogue lists
    "none": (0, 0),
    "one": (1, 0),
    "two": (2, 0),
    "three": (3, 0),
    "unknown": (0, 1),
    "both": (1, 1),
}
LIVES_ON = {  # an effect of one channel alone cannot be drawn where that channel is missing
    ("pressure_gain", "x"): "f_ax",
    ("pressure_gain", "z"): "f_az",
}


@dataclass(frozen=True)
class CaseSet:
    """What is drawn for a seed.

    mixture: share of each kind of COUNTS; rig: spreads of a rig without effects; severity: factor
    on the drawn sizes; levels: places in the range of sizes (0 least, 1 largest, logarithmic),
    taken in turn by seed instead of a draw; unknown: kinds of unknown effect (effect names) to draw
    from, none: the usual ones; in_turn: `unknown` is gone through by seed; missing: channels that
    the rig does not measure; logs: those of the campaign, none: all seven; always: (effect, axis)
    that every rig has beside what is drawn.
    """

    name: str
    mixture: Mapping[str, float] = field(default_factory=lambda: dict(ORDINARY))
    rig: RigDraw = NUISANCE
    severity: float = 1.0
    levels: tuple[float, ...] = ()
    unknown: tuple[str, ...] = ()
    in_turn: bool = False
    missing: tuple[str, ...] = ()
    logs: tuple[str, ...] = ()
    always: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        kinds = {form.effect for form in OUTSIDE_FORMS}
        for given, known, what in (
            (self.mixture, COUNTS, "mixture"),
            (self.unknown, kinds, "unknown"),
            (self.missing, CHANNELS, "missing"),
        ):
            for name in given:
                if name not in known:
                    raise ValueError(f"{what} must be of {sorted(known)}, got {name!r}")
        if self.severity <= 0.0:
            raise ValueError(f"severity must be > 0, got {self.severity}")

    def plan(
        self, seed: int, kind: str = "", effects: tuple[tuple[str, str], ...] | None = None
    ) -> Case:
        """Kind, tolerance, nuisances and causes of a seed. `kind`, or `effects`, (effect, axis)
        pairs, fix what the mixture would draw.
        """
        rng = np.random.default_rng([seed, 1])
        if effects is None:
            drawn_kind = str(rng.choice(list(self.mixture), p=list(self.mixture.values())))
            kind = kind or drawn_kind
            drawn_pairs = self._pairs(kind, seed, rng)
            pairs = [*self.always, *(p for p in drawn_pairs if p not in self.always)]
            kind = _kind_of(pairs) if self.always else kind
        else:
            pairs = list(effects)
            kind = kind or _kind_of(pairs)
        drawn = draw_rig(rng, seed, self.rig)
        causes = tuple(self._sized(draw_cause(rng, *pair), seed) for pair in pairs)
        channels = tuple(name for name in CHANNELS if name not in self.missing)
        return Case(seed, kind, drawn.rig, drawn.off, causes, drawn.standoff, self.logs, channels)

    def draw(self, seed: int) -> tuple[Campaign, dict]:
        """(campaign, label) of a seed."""
        campaign, label = run_case(self.plan(seed))
        return campaign, {"set": self.name, **label}

    def _pairs(self, kind: str, seed: int, rng: np.random.Generator) -> list[tuple[str, str]]:
        """(effect, axis) of each cause."""
        out: list[tuple[str, str]] = []
        pools = names(KNOWN_FORMS), self._unknown(seed)
        for count, pool in zip(COUNTS[kind], pools, strict=True):
            if count:
                chosen = rng.choice(len(pool), size=count, replace=False)
                out += [self._shows(pool, int(j), out) for j in chosen]
        return out

    def _shows(
        self, pool: list[tuple[str, str]], j: int, taken: list[tuple[str, str]]
    ) -> tuple[str, str]:
        """Entry j of the pool, or where its only channel is missing the next that is not taken: the
        other rigs of a set are the same with and without the channel.
        """
        while LIVES_ON.get(pool[j]) in self.missing or pool[j] in taken:
            j = (j + 1) % len(pool)
        return pool[j]

    def _unknown(self, seed: int) -> list[tuple[str, str]]:
        if not self.unknown:
            return names(UNKNOWN_FORMS)
        turn = (self.unknown[seed % len(self.unknown)],) if self.in_turn else self.unknown
        return [pair for pair in names(OUTSIDE_FORMS) if pair[0] in turn]

    def _sized(self, cause: Cause, seed: int) -> Cause:
        """The cause with its size clear of the tolerance, at its level and severity."""
        form, tolerated = cause.form, tolerated_size(cause.form, self.rig)
        least, size = max(form.low, tolerated), cause.size
        if self.levels or least > form.low:
            place = np.log(size / form.low) / np.log(form.high / form.low)
            if self.levels:
                place = self.levels[seed // max(len(self.unknown), 1) % len(self.levels)]
            size = float(least * (max(form.high, least) / least) ** place)
        return replace(cause, size=max(self.severity * size, tolerated))


def _kind_of(pairs: list[tuple[str, str]]) -> str:
    """The kind of COUNTS that these effects are."""
    outside = sum(pair in names(OUTSIDE_FORMS) for pair in pairs)
    counts = (len(pairs) - outside, outside)
    return next((kind for kind, n in COUNTS.items() if n == counts), "many")


DEVELOPMENT = CaseSet("development", MIXTURE, PLAIN)


def plan_case(
    seed: int,
    kind: str | None = None,
    rms: float = 0.02,
    effects: tuple[tuple[str, str], ...] | None = None,
) -> Case:
    """A case on a rig without nuisances, parameters off by `rms`."""
    rigs = replace(DEVELOPMENT, rig=replace(PLAIN, parameters=rms))
    return rigs.plan(seed, kind or "", effects)


def draw_case(seed: int, kind: str | None = None, rms: float = 0.02) -> tuple[Campaign, dict]:
    """(campaign, label) of an integer seed, on a rig without nuisances: 45 % one effect, 20 % two,
    15 % out of catalogue, 20 % none; `kind` fixes which.
    """
    return run_case(plan_case(seed, kind, rms))
