"""The thesis' tests of friction and mass, one number each (Eq. 4-2, C-1 to C-3), and how far each
rule is off on a known plant.

A rule reads its force at an instant that the lag, the mass or a threshold shifts, so it is off by
more than its own scatter says. The bias is found by putting the same rule to noisy copies of the
fitted plant's own logs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pneugantry.analysis.identify.breakaway import breakaways, stops
from pneugantry.analysis.identify.edge import edge_test
from pneugantry.analysis.identify.hysteresis import hysteresis
from pneugantry.analysis.identify.interval import Estimate, quantile
from pneugantry.analysis.identify.motion import Motion, Sliding, slides, sliding
from pneugantry.analysis.identify.signals import Signals, free_signals
from pyfmi_runner.campaign import Campaign
from pyfmi_runner.log import MEASURED, PERIOD, SIGMA, Log
from pyfmi_runner.replay import SIGMAS

__all__ = ["KnownPlant", "Rule", "RuleResult", "judged", "noisy_campaign", "rules"]

Array = NDArray[np.float64]
STRETCH = 100  # samples over which a speed counts as even, or as evenly rising
EVEN = 0.05  # m/s2, least rise of a speed that is not even
REPLICATES = 6


@dataclass(frozen=True)
class Rule:
    """A test: what it gives, of which axis ("" for the contact), by which equation; `count`: how
    often it could be done.
    """

    symbol: str
    axis: str
    unit: str
    how: str
    value: float
    count: int

    @property
    def key(self) -> tuple[str, str, str]:
        return self.symbol, self.axis, self.how


@dataclass(frozen=True)
class RuleResult:
    """A test with the bias of its rule on the fitted plant, and the value freed of it."""

    rule: Rule
    bias: float
    estimate: Estimate


@dataclass(frozen=True, eq=False)
class KnownPlant:
    """Parameters by (symbol, axis); directions of the valves and cable forces F_w [N] by axis."""

    parameters: Mapping[tuple[str, str], float]
    directions: Mapping[str, float]
    cables: Mapping[str, float]


def rules(
    campaign: Campaign, directions: Mapping[str, float], cables: Mapping[str, float]
) -> list[Rule]:
    """Every test that the campaign permits. directions: of the valves; cables: F_w [N] where an
    axis does not slide both ways.
    """
    found: list[Rule] = []
    for axis in "xz":
        stretches = free_signals(campaign, axis)
        motion = sliding(stretches, cables[axis])
        if motion is not None:
            found += _of_axis(stretches, motion, directions[axis], cables[axis])
            if axis == "z":
                found += _of_hysteresis(campaign, motion, cables[axis])
    edge = edge_test(campaign)
    if edge is not None:
        found += [
            Rule("K_c", "", "N/m", "Eq. 4-3", edge.K_c.value, 1),
            Rule("C_c", "", "N s/m", "Eq. 4-3", edge.C_c.value, 1),
        ]
    return [rule for rule in found if math.isfinite(rule.value)]


def _of_axis(
    stretches: Sequence[Signals], motion: Motion, direction: float, nominal_cable: float
) -> Iterator[Rule]:
    axis = stretches[0].axis
    cable = motion.F_w.value if motion.F_w else nominal_cable
    m, C, F_d = motion.m.value, motion.C.value, motion.F_d.value
    how = "all slides at once"
    yield Rule("m", axis, "kg", how, m, motion.slides)
    yield Rule("C", axis, "N s/m", how, C, motion.slides)
    yield Rule("F_d", axis, "N", how, F_d, motion.slides)
    if motion.F_w:
        yield Rule("F_w", axis, "N", how, cable, motion.slides)
    masses, dampings = _stretched(slides(stretches), C, F_d, cable)
    if masses:
        yield Rule(
            "m", axis, "kg", "Eq. 4-2, evenly rising speed", float(np.median(masses)), len(masses)
        )
    if dampings:
        yield Rule(
            "C", axis, "N s/m", "Eq. C-3, even speed", float(np.median(dampings)), len(dampings)
        )
    starts = breakaways(stretches, m, C, cable)
    if starts:
        yield Rule(
            "F_s",
            axis,
            "N",
            "Eq. C-1, force at 0.01 m/s",
            float(np.mean([b.by_rule for b in starts])),
            len(starts),
        )
        pushed = [b.corrected for b in starts if b.way == direction] or [
            b.corrected for b in starts
        ]
        yield Rule(
            "F_s", axis, "N", "start of motion by fit", float(np.median(pushed)), len(pushed)
        )
    halts = stops(stretches, direction, cable)
    if halts:
        yield Rule(
            "F_d", axis, "N", "Eq. C-2, force at 0.01 m/s", float(np.mean(halts)), len(halts)
        )


def _stretched(
    found: Sequence[Sliding], C: float, F_d: float, cable: float
) -> tuple[list[float], list[float]]:
    """(masses by Eq. 4-2, dampings by Eq. C-3) of every stretch of 0.1 s whose speed is straight in
    time.
    """
    masses, dampings = [], []
    t = (np.arange(STRETCH) - 0.5 * (STRETCH - 1)) * PERIOD
    for s in found:
        for a in range(s.a, s.b - STRETCH, STRETCH):
            part = slice(a, a + STRETCH)
            v = s.signals.speed[part]
            rise, middle = np.polyfit(t, v, 1)
            if np.std(v - middle - rise * t) > 1.3 * SIGMA[f"v_{s.signals.axis}"]:
                continue
            net = float(np.mean(s.signals.drive[part])) - cable - s.way * F_d
            if abs(rise) < EVEN:
                dampings.append(net / middle)
            elif abs(rise) > 5 * EVEN:
                masses.append((net - C * middle) / rise)
    return masses, dampings


def _of_hysteresis(campaign: Campaign, motion: Motion, nominal_cable: float) -> Iterator[Rule]:
    cable = motion.F_w.value if motion.F_w else nominal_cable
    found = hysteresis(campaign, motion.m.value, motion.C.value, cable)
    if found is not None and found.presliding:
        yield Rule("beta", "z", "N", "hysteresis, Eq. 4-6, 4-8", found.beta, 1)
        yield Rule("sigma", "z", "N/m", "hysteresis, Eq. 4-6, 4-8", found.sigma, 1)


def noisy_campaign(campaign: Campaign, simulated: Mapping[str, Array], seed: int) -> Campaign:
    """The campaign that a plant with these outputs (samples, 8) by log would have given, with the
    sensors' noise.
    """
    rng = np.random.default_rng(seed)
    logs = {}
    for name, run in campaign.logs.items():
        noisy = simulated[name] + SIGMAS * rng.standard_normal(simulated[name].shape)
        table = pd.DataFrame(noisy, columns=list(MEASURED))
        for column in ("time", "u_x", "u_z"):
            table[column] = run.log[column]
        logs[name] = replace(run, log=Log(table, run.log.name, {}))
    return replace(campaign, logs=logs)


def judged(
    campaign: Campaign,
    simulated: Mapping[str, Array],
    plant: KnownPlant,
    side_by_side: Callable[[Callable[[int], list[Rule]], Sequence[int]], list[list[Rule]]],
) -> list[RuleResult]:
    """Every test with its bias and interval. simulated: outputs of the fitted plant by log;
    side_by_side: as `map`, on several threads.
    """

    def tested(seed: int) -> list[Rule]:
        """Rules of the measured campaign (-1), or of a noisy copy of the simulated one."""
        logs = campaign if seed < 0 else noisy_campaign(campaign, simulated, seed)
        return rules(logs, plant.directions, plant.cables)

    measured, *noisy = side_by_side(tested, range(-1, REPLICATES))
    copies = [{r.key: r.value for r in found} for found in noisy]
    results = []
    for rule in measured:
        seen = np.array([copy[rule.key] for copy in copies if rule.key in copy])
        known = plant.parameters.get((rule.symbol, rule.axis), math.nan)
        n = len(seen)
        if n < 3 or not math.isfinite(known):
            results.append(RuleResult(rule, math.nan, Estimate(rule.value, math.inf)))
            continue
        bias = float(seen.mean()) - known
        sigma = float(seen.std(ddof=1)) * math.sqrt(1 + 1 / n)
        results.append(RuleResult(rule, bias, Estimate(rule.value - bias, sigma, quantile(n - 1))))
    return results
