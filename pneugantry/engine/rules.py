"""Every threshold of the diagnosis, with unit, meaning and origin. An ablation is
`replace(rules, ...)`.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Rules"]


@dataclass(frozen=True)
class Rules:
    """Origin "field": usual practice; "design": follows from another number here."""

    band: float = 100.0  # Hz, residuals are averages over 1/band (field: ten times the bandwidth)
    thinning: int = 2  # rows of a record that are averaged into one before anything is simulated
    coarse: float = (
        3.0  # noise from known signals that a view may have, in its sensors' own (design)
    )
    observer: float = 0.016  # s, time constant of the observer in parts that switch
    tails: float = 4.0  # degrees of freedom of the noise's distribution (field: robust regression)
    quietest: float = 0.6  # smallest noise, in units of the quoted one, that a sensor may have
    slowest: float = 20.0  # noise at frequency 0, in units of the quoted one (decision 0107)
    effect_prior: float = 2.0  # spread of an effect's size, in usual sizes
    tolerance: float = 1.5  # a rig's deviations at first, in units of what its description gives
    tolerance_weight: float = 8.0  # parameters that the description's own spread is worth
    tolerated: float = 2.5  # worth of -2 log prior of a deviation in -2 log likelihood (0152)
    iterations: int = 14  # Gauss-Newton steps of a fit, at most
    turns: int = 4  # of probing about the end of a fit, at most
    renewals: int = 4  # of colour and columns at the end of a fit, at most
    finalists: int = 3  # effects that are fitted to the end at each step of the search
    survey: int = 192  # points of a view, from the best of which descents start, too (0119, 0120)
    followed: int = 4  # parts of these points, each with its best (0122)
    quiet: float = 1.05  # times its sensors' noise, up to which a view needs no survey (0120)
    unexplained: float = 1.22  # and from which on more is tried: as likely unknown as not (0145)
    bent: float = 5.0  # spreads of tolerance of which the same is true: `Chances.bent` (0182)
    damping: float = 1.0  # Levenberg-Marquardt's, at the start
    difference: float = 0.1  # step of a nuisance's difference quotient, in its spreads
    fine: float = 5e-5  # share of it near an end, an effect's too (measured: decisions 0104, 0120)
    stride: float = 0.3  # step of an effect's, in usual sizes
    converged: float = 2.0  # fall of -2 log posterior below which a fit has converged
    screened: int = 3  # effects that are fitted at each step, in each of two orders
    hopeful: float = 0.3  # share of the best gain from which on an effect is fitted (0176)
    hopeless: float = (
        500.0  # rise of -2 log likelihood that ends a fit and its surveys (0106, 0122)
    )
    outweighed: float = 60.0  # -2 log evidence behind the likeliest: e^-5 times as likely (0183)
    patience: float = 4.0  # falls like its last that a descent may be behind a bar (0120, 0176)
    reformed: int = 2  # effects that are then tried in their other forms
    entry: float = 10.0  # fall of -2 log evidence that is worth a step (field: very strong)
    effect: float = 22.0  # and that an effect must bring, beside what the catalogue's size costs
    doubt: float = 2.0  # standard errors over stretches by which a gain is lowered (field)
    material: float = 0.2  # change of a residual, in noise levels, below which it is none (design)
    negligible: float = 0.02  # usual sizes below which an effect is none (0131)
    effort: float = 2500.0  # of a view over all records, on an effect that nothing predicts (0167)
    rounds: int = 6  # steps of the search, at most
    block: float = 0.5  # s of a record that are drawn together in a bootstrap
    stretches: int = 8  # of a record, at least: fewer tell no scatter between them (0162)

    def stretch(self, period: float, rows: int) -> int:
        """Rows that are drawn together of a record of so many, `period` s apart."""
        return max(4, min(round(self.block / period), rows // self.stretches))
