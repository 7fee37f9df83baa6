"""Whether a term stands: the record that no fit saw is replayed better with it, or the views that
stood out do so no longer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from pneugantry.engine.answer.confirm import Gap
from pneugantry.engine.answer.decide import SURE
from pneugantry.engine.fitting import noise
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.run import Found
from pneugantry.learn.fitting.joint import TermFits
from pneugantry.learn.learned import Tried

__all__ = ["Judge"]

LEFT = 0.5  # share of the gap's square that a term may leave


@dataclass(frozen=True, eq=False)
class Judge:
    """Says whether terms of one diagnosed plant stand."""

    before: Found
    fits: TermFits
    among: int = 1  # curves of variables that were tried

    @property
    def _plain(self) -> Fit:
        """The likelier of the nominal plant and that with the effects found."""
        return min(self.before.search.null, self.before.decision.best, key=self._cost)

    def _cost(self, fit: Fit) -> float:
        return fit.evidence + 2 * self.fits.rules.entry * len(fit.keys)

    def likely(self, tried: Tried) -> float:
        """Probability of a term by the fitted logs: as likely as none is what brings them as much
        as a known effect has to, and what says which of those it is that were tried.
        """
        chances = self.before.task.chances
        bar = chances.entry + 2 * math.log(self.among)
        behind = (tried.cost - self._cost(self._plain) + bar) / (2 * chances.temper)
        return 1 / (1 + math.exp(min(behind, 700.0)))

    def helps(self, tried: Tried) -> bool:
        """Whether a term is rather there than not, by the fitted logs."""
        return self.likely(tried) >= SURE

    def judged(self, best: Tried, after: Found) -> tuple[bool, str]:
        """Whether the term stands, and why."""
        if not self.helps(best):
            return False, "the term brings the fitted logs nothing: located, not explained"
        before, old, new = self.before, self.before.gap, after.gap
        if old is None or new is None or before.augmented is None or after.augmented is None:
            return False, "no log could be replayed: located, not explained"
        verb = "falls" if new.augmented < old.augmented else "goes"
        fall = f"the gap of {new.record} {verb} from {old.augmented:.3g} without it "
        fall += f"to {new.augmented:.3g}"
        falls = self.fits.loss(before.augmented) - self.fits.loss(after.augmented)
        better = noise.doubted(falls, self.fits.rules.doubt) > self.fits.rules.entry
        hangs = _hangs(old) or _hangs(new)
        if not better and (hangs or new.augmented < old.augmented):
            better = self._predicts_better(best, self._plain)
        if not better and new.augmented < LEFT * old.augmented:
            return False, f"{fall}, in too few stretches to tell: located, not explained"
        if not better:
            return False, (
                f"{new.record} is replayed no better with the term ({old.augmented:.3g} before, "
                f"{new.augmented:.3g} with it): located, not explained"
            )
        floor = min(new.floor, new.augmented) ** 2
        left, gap = new.augmented**2 - floor, old.augmented**2 - floor
        by_replay = not hangs and left <= LEFT * gap
        if hangs:
            fall += ", by a replay that hangs on an event, met or missed"
        if not by_replay and _standing(after) > LEFT * _standing(before):  # then the views tell
            return False, f"{fall}, and more is left than explained: located, not explained"
        if not (by_replay or hangs):
            fall += ", an error that a replay carries on"
        return True, fall

    def _predicts_better(self, best: Tried, plain: Fit) -> bool:
        """Whether the views predict the record that no fit saw better with a term: a whole replay
        hangs on single events (a carriage that breaks away).
        """
        record = self.before.task.data.held_out
        if record is None:
            return False
        with self.fits.predictor(best.term, record) as predictor:
            (gain,) = predictor.gains([best.fit], plain)
        return gain > self.fits.rules.effect


def _hangs(gap: Gap) -> bool:
    """Whether a replay says little of the plant: it hangs on an event that was met or missed."""
    return gap.bifurcates or gap.parted is not None


def _standing(found: Found) -> float:
    """How far the view that stands out most does so."""
    return max((found.excess.ratio(c) - 1 for c in found.excess.whole), default=0.0)
