"""Weights of the decision: what turns evidence into probabilities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["UNEXPLAINED", "Chances"]

# probability of something unknown from which on it is looked for, and the answer may not be all
UNEXPLAINED = 0.2


@dataclass(frozen=True)
class Chances:
    """Weights of the decision; the defaults are those of decision 0105 where no other is named."""

    temper: float = 6.0  # -2 log evidence that makes a hypothesis e^(1/2) times less likely
    entry: float = 40.0  # -2 log evidence that an effect must bring to be as likely as none
    unknown_at: float = 0.2  # excess (see `answer.decide`) at which unknown is as likely as not
    unknown_per: float = 0.03  # excess that makes it e times likelier
    # share of what stood out that an effect leaves at which that is as likely something unknown as
    # another form of the effect; in variance (0172)
    unknown_left: float = 0.18
    beside: float = 0.1  # that what is named beside something unknown in its view is there (0132)
    imitated: float = 0.02  # that what looks like a named effect is none the catalogue has (0175)
    # excess ratio of a sound rig, by view and signal
    usual: Mapping[tuple[str, str], float] | None = None
    replay: float = 0.2  # excess that a replay's gap e times the usual one counts as
    bent: float = 0.1  # excess that each spread counts as by which a deviation exceeds `bent_from`
    bent_from: float = 3.0  # spreads of the rig's tolerance that its largest deviation may have
    replayed: float = 1.6  # usual gap of the right answer's replay, in that of noise alone
