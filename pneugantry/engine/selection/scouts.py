"""What hypotheses gain in views by themselves, before they are worth a fit."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from pneugantry.engine.fitting.fit import Fit, known_beside
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.fitting.problem import Solution, standing
from pneugantry.engine.fitting.surveys import in_view
from pneugantry.engine.hypotheses.hypothesis import Hypothesis

__all__ = ["Scouts"]


class Scouts:
    """What hypotheses gain over a base in some views, each of them fitted by itself: more than in
    all together. It tells which are worth a fit.
    """

    def __init__(self, fitter: Fitter, base: Fit, views: Collection[str]) -> None:
        self.fitter, self._base, self._views = fitter, base, frozenset(views)

    def gains(
        self, tried: Sequence[tuple[Hypothesis, Sequence[Mapping[str, float]]]]
    ) -> list[float]:
        """Of each hypothesis the fall of -2 log posterior, from the base and from values."""
        fitter, together = self.fitter, self.fitter.simulation.side_by_side
        fitter.prepare([h for h, _ in tried])
        cells = [fitter.beside_base(h, self._base)[2] for h, _ in tried]
        touched = [frozenset(c[0] for c in own) for own in cells]
        levels = dict.fromkeys((v, t) for t in touched for v in sorted(t & self._views))
        found = dict(zip(levels, together(lambda k: self._level(*k), [*levels]), strict=True))
        return together(lambda each: self._gain(*each, found), tried)

    def _gain(
        self,
        hypothesis: Hypothesis,
        starts: Sequence[Mapping[str, float]],
        levels: Mapping[tuple[str, frozenset[str]], float],
    ) -> float:
        fitter, base = self.fitter, self._base
        _, known, cells = fitter.beside_base(hypothesis, base)
        touched = frozenset(c[0] for c in cells)
        own = [c for c in cells if c[0] in self._views]
        firsts, gain = fitter.firsts(hypothesis, base, starts, own), 0.0
        for view in dict.fromkeys(c[0] for c in own):
            problem = fitter.surveys.problem([c for c in own if c[0] == view], known, fine=False)
            least = levels[view, touched]
            for first in firsts:
                end = standing(problem, fitter.surveys.raced(problem, in_view(first, view), least))
                gain, least = gain + max(least - end, 0.0), min(least, end)
        return gain

    def _level(self, view: str, touched: frozenset[str]) -> float:
        """Where the base comes to in a view by itself, other views as parabolas but for those that
        are touched.
        """
        base, fitter = self._base, self.fitter
        known = known_beside(base.point.coordinates, base, touched)
        cells = [c for c in fitter.simulation.cells if c[0] == view]
        alone = fitter.surveys.problem(cells, known, fine=False)
        start = in_view(Solution(base.point, base.residuals, base.columns), view)
        return standing(alone, fitter.surveys.raced(alone, start, math.inf))
