"""The thesis' conclusions from tracking runs (1-8, 10-13), each a yes or no with its numbers; 30 %
is significant (§3.5.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from pneugantry.thesis.conditions import NO_LAG, Run
from pneugantry.thesis.edge import UPHILL, valve_runs
from pneugantry.thesis.printed import SPEEDS, WORKPIECES
from pneugantry.thesis.runner import Results
from pneugantry.thesis.tables import ablation_run, speed_run

__all__ = ["SIGNIFICANT", "Conclusion", "tracking_conclusions", "tracking_runs"]

SIGNIFICANT = 0.30
ANGLE_ERRORS = (0.0, 10.0, 30.0, 50.0)  # degrees, §4.3.3
REASONS = {
    4: "without the lag K_p K_z = 2 of the f_z loop acts at once and divides a friction "
    "reversal by 3; with it, only below 1 / tau_z",
}
INCLINES = ("incline_7", "incline_16")


@dataclass(frozen=True)
class Conclusion:
    """A conclusion of the thesis, judged by our numbers."""

    id: int
    text: str
    holds: bool
    numbers: dict[str, float] = field(default_factory=dict)

    @property
    def reason(self) -> str:
        """Why it does not hold, where it does not and the reason was found (docs/thesis.md)."""
        return "" if self.holds else REASONS.get(self.id, "not found")


def improvement(before: float, after: float) -> float:
    """Share by which an error falls (Eq. 4-9); < 0 where it grows."""
    return 1.0 - after / before


def angle_run(degrees: float) -> Run:
    return Run("straight", finish="modelled", angle_error=math.radians(degrees))


def tracking_runs() -> list[Run]:
    """What the conclusions need beyond the tables' runs."""
    compensated = [
        Run(piece, name)
        for piece in ("straight", "curved")
        for name in ("pi_fv", "pi_fv_vdfm", "pi_fv_ddfm")
    ]
    return [
        *(angle_run(e) for e in ANGLE_ERRORS),
        *valve_runs(),
        *compensated,
        Run("straight", plant=NO_LAG),
    ]


def tracking_conclusions(results: Results) -> list[Conclusion]:
    judges: list[Callable[[Results], Conclusion]] = [
        _straight_worst,
        _finish,
        _friction,
        _lag,
        _noise,
        _speed,
        _angle,
        _valves,
        _vdfm,
        _scheduler,
        _networks,
    ]
    return [judge(results) for judge in judges]


def _cuts(results: Results, case: str) -> dict[str, float]:
    """Share by which RMSE f_n falls on each workpiece when a case removes its effect."""
    rmse = {
        p: (results[ablation_run(p, "all on")].rmse_fn, results[ablation_run(p, case)].rmse_fn)
        for p in WORKPIECES
    }
    return {piece: improvement(*pair) for piece, pair in rmse.items()}


def _straight_worst(results: Results) -> Conclusion:
    rmse = {piece: results[ablation_run(piece, "all on")].rmse_fn for piece in WORKPIECES}
    holds = all(rmse["straight"] > rmse[piece] for piece in WORKPIECES[1:])
    return Conclusion(
        1, "with finish and friction the straight edge has the largest RMSE f_n", holds, rmse
    )


def _finish(results: Results) -> Conclusion:
    cuts = _cuts(results, "no surface finish")
    holds = cuts["straight"] > 0.80 and all(abs(cuts[piece]) < 0.10 for piece in INCLINES)
    return Conclusion(
        2,
        "removing the finish cuts RMSE f_n by > 80 % on the straight edge, by < 10 % on "
        "the inclined ones",
        holds,
        cuts,
    )


def _friction(results: Results) -> Conclusion:
    cuts = _cuts(results, "no Coulomb friction")
    others = {
        case: _cuts(results, case) for case in ("no signal noise", "no lag", "no surface finish")
    }
    numbers = {
        **cuts,
        "mean": _mean(cuts),
        **{f"mean, {case}": _mean(other) for case, other in others.items()},
    }
    holds = min(cuts.values()) > SIGNIFICANT and all(
        _mean(cuts) > _mean(other) for other in others.values()
    )
    return Conclusion(
        3,
        "removing Coulomb friction cuts RMSE f_n by > 30 % everywhere, most of all effects",
        holds,
        numbers,
    )


def _mean(values: dict[str, float]) -> float:
    return sum(values.values()) / len(values)


def _lag(results: Results) -> Conclusion:
    cuts = _cuts(results, "no lag")
    return Conclusion(
        4,
        "removing the lag improves RMSE f_n by < 30 % everywhere",
        max(cuts.values()) < SIGNIFICANT,
        cuts,
    )


def _noise(results: Results) -> Conclusion:
    cuts = _cuts(results, "no signal noise")
    return Conclusion(
        5,
        "removing signal noise changes RMSE f_n by < 10 %",
        max(map(abs, cuts.values())) < 0.10,
        cuts,
    )


def _speed(results: Results) -> Conclusion:
    numbers = {}
    for piece in ("curved", "straight"):
        slow, medium, fast = (results[speed_run(piece, speed)].rmse_fn for speed in SPEEDS)
        numbers[f"{piece}, 0.09 to 0.06"] = improvement(fast, medium)
        numbers[f"{piece}, 0.06 to 0.03"] = improvement(medium, slow)
    return Conclusion(
        6,
        "slowing down never improves RMSE f_n by 30 % a step",
        max(numbers.values()) < SIGNIFICANT,
        numbers,
    )


def _angle(results: Results) -> Conclusion:
    rmse = {f"{degrees:g} deg": results[angle_run(degrees)].rmse_fn for degrees in ANGLE_ERRORS}
    right, ten, thirty, fifty = rmse.values()
    holds = (
        -improvement(right, ten) < SIGNIFICANT
        and -improvement(right, thirty) > SIGNIFICANT
        and -improvement(right, fifty) > SIGNIFICANT
    )
    return Conclusion(
        7, "an error of 10 deg in theta does not matter, 30 and 50 deg degrade f_n", holds, rmse
    )


def _valves(results: Results) -> Conclusion:
    one, both = (UPHILL.errors(results.trace(run), run) for run in valve_runs())
    numbers = {
        "one-directional f_n": one[0],
        "bidirectional f_n": both[0],
        "one-directional v_t": one[1],
        "bidirectional v_t": both[1],
    }
    holds = (
        improvement(one[0], both[0]) > SIGNIFICANT and improvement(one[1], both[1]) > SIGNIFICANT
    )
    text = (
        "where theta < 0 one-directional valves lose f_n and v_t, bidirectional ones hold "
        "them (RMSE there)"
    )
    return Conclusion(8, text, holds, numbers)


def _vdfm(results: Results) -> Conclusion:
    cuts = {
        p: improvement(results[Run(p)].rmse_fn, results[Run(p, "pi_fv_vdfm")].rmse_fn)
        for p in ("straight", "curved")
    }
    return Conclusion(
        10,
        "the VDFM compensator brings no significant improvement of RMSE f_n",
        max(cuts.values()) < SIGNIFICANT,
        cuts,
    )


def _scheduler(results: Results) -> Conclusion:
    cut = improvement(
        results[Run("curved")].rmse_fn, results[Run("curved", "pi_fv_scheduled")].rmse_fn
    )
    return Conclusion(
        12,
        "gain scheduling on theta brings no improvement of RMSE f_n",
        cut < SIGNIFICANT,
        {"curved": cut},
    )


def _networks(results: Results) -> Conclusion:
    pairs = [("straight", name) for name in ("ebpa_zero", "ebpa", "mbpm", "mbpm_5")] + [
        ("curved", name) for name in ("mbpm", "mbpm_5")
    ]
    rmse = {(piece, name): results[Run(piece, f"pi_fv_{name}")].rmse_fn for piece, name in pairs}
    cuts = {
        f"{name}, {piece}": improvement(results[Run(piece)].rmse_fn, after)
        for (piece, name), after in rmse.items()
    }
    none, *significant = cuts.values()
    holds = none < SIGNIFICANT and min(significant) >= SIGNIFICANT
    return Conclusion(
        13,
        "EBPA: none from zero weights, significant from 0.1; MBPM: significant from zero weights",
        holds,
        cuts,
    )
