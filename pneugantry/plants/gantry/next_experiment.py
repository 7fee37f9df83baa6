"""The experiment that would tell the likeliest answer from the next: of a few that the rig can do,
the one in which their plants differ most, or which tells a curve best from what imitates it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from modelica_fmu.errors import InputError, RunError
from pneugantry.engine.answer.confirm import replays
from pneugantry.engine.answer.decide import UNKNOWN, Decision
from pneugantry.engine.answer.imitation import Imitation, expected, has_curves
from pneugantry.engine.plant import Record, thinned
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found
from pneugantry.engine.task import Task
from pneugantry.engine.threads import one_blas_thread
from pneugantry.plants.gantry.closed_loop import augmented_of
from pneugantry.plants.gantry.describe import record_of
from pyfmi_runner.campaign import Campaign, LoggedRun, LogSetup, scenario_setup
from pyfmi_runner.controller_file import is_known_controller
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import SIGMA, STROKE_Z
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario, scenario_text, short_phases
from pyfmi_runner.sensors import SensorParams

__all__ = [
    "FittedEffects",
    "Proposal",
    "candidates",
    "for_a_curve",
    "next_experiment",
    "proposed",
    "rivals",
    "simulated",
]

Proposed = dict[str, Any]  # what, scenario, separates, ...
# effects of a hypothesis, fitted values
FittedEffects = tuple[tuple[str, ...], Mapping[str, float]]

MOST_FORCE = 150.0  # N, contact force that the rig may see
OPEN = 8.0  # s
ELSEWHERE = 0.6  # m, x at the start of a run that passes the usual places after another way
# times the noise: beyond it a difference counts no more, or one missed break-away would choose
MOST = 10.0
THINNING = 2  # rows of an experiment that are averaged into one
UNLIKELY = 0.02  # probability of a hypothesis up to which no experiment is spent on it
TELLING = 1.2  # separation below which an experiment is not worth its time
DECISIVE = 30.0  # expected -2 log evidence from which on one tells a curve from what imitates it


@dataclass(frozen=True)
class Proposal:
    """An experiment that the rig can do."""

    what: str  # in words
    scenario: Scenario
    tracks: bool = False  # an edge


def proposed(found: Found, campaign: Campaign, fmu: FmuFile, rules: Rules) -> Proposed | None:
    """What tells the likeliest answer from the next: another one of the catalogue, or something
    unknown that imitates one of its curves.
    """
    pair, decision = rivals(found.decision), found.decision
    second = [a.probability for a in decision.answers if len(pair) > 1 and a.keys == pair[1][0]]

    def curve() -> Proposed | None:
        likely = decision.imitated > UNLIKELY
        return for_a_curve(found, campaign, fmu, rules) if likely else None

    def plants() -> Proposed | None:
        return next_experiment(found.task, campaign, fmu, pair)

    if decision.imitated > max(second, default=0.0):
        return curve() or plants()
    return plants() or curve()


def next_experiment(
    task: Task, campaign: Campaign, fmu: FmuFile, pair: Sequence[FittedEffects]
) -> Proposed | None:
    """The candidate in which the plants of two hypotheses differ most (docs/reference/gap.md); None
    where there are no two, or none of the candidates tells.

    The separation is the RMS over channels and time of the difference of what the sensors would say
    for the same commands, in units of their noise, no more than MOST of them at any instant.
    """
    if len(pair) < 2:
        return None
    values = [fitted for _, fitted in pair]
    best: tuple[float, Proposal] | None = None
    for candidate in candidates(campaign):
        separation = _separation(task, fmu, candidate.scenario, values)
        if separation is not None and (best is None or separation > best[0]):
            best = separation, candidate
    if best is None or best[0] < TELLING:
        return None
    separation, chosen = best
    names = " and ".join(" + ".join(keys) or "no effect" for keys, _ in pair)
    return {
        "what": f"{chosen.what}: {names} then differ by {separation:.2g} times the sensors' "
        "noise (RMS over all channels)",
        "scenario": scenario_text(replace(chosen.scenario, sensors=SensorParams())),
        "separates": [list(keys) for keys, _ in pair],
        "separation": separation,
    }


@one_blas_thread()
def for_a_curve(found: Found, campaign: Campaign, fmu: FmuFile, rules: Rules) -> Proposed | None:
    """The candidate that tells an effect's curve best from the same over another variable, of those
    that track an edge with the campaign's own force; None where none does.
    """
    own, fit = _base(campaign).f_nd, found.decision.best
    if not has_curves(fit):
        return None
    plant = dict(augmented_of(fmu, found.values).plant)
    best: tuple[int, float, Proposal, Imitation] | None = None
    for candidate in candidates(campaign):
        if not candidate.tracks or candidate.scenario.f_nd != own:
            continue
        noisy = replace(candidate.scenario, sensors=SensorParams(), plant=plant)
        record = simulated("next", noisy, fmu, rules.thinning)
        if record is None:
            continue
        try:
            told = expected(found.task, fit, record, rules, found.excess.level)
        except (InputError, RunError):
            continue
        least = min(told, key=lambda i: i.behind, default=None)
        if least and (best is None or (len(told), least.behind) > best[:2]):
            best = len(told), least.behind, candidate, least
    if best is None or best[1] < DECISIVE:
        return None
    _, evidence, chosen, least = best
    return {
        "what": f"{chosen.what}: {least.key} is then told from a curve over the "
        f"{least.variable} by {evidence:.0f} of -2 log evidence",
        "scenario": scenario_text(replace(chosen.scenario, sensors=SensorParams())),
        "separates": [[least.key], [UNKNOWN]],
        "separation": math.sqrt(evidence),
        "evidence": evidence,
    }


def rivals(decision: Decision) -> list[FittedEffects]:
    """The two likeliest hypotheses within the catalogue; one, where all else is unlikely."""
    likely = (a for a in decision.answers if a.probability > UNLIKELY)
    known = [a for a in likely if UNKNOWN not in a.keys and a.fit is not None]
    return [(a.keys, a.fit.values(None)) for a in known[:2] if a.fit is not None]


def candidates(campaign: Campaign) -> Iterator[Proposal]:
    """With the controller and gains of the campaign's own closed-loop logs."""
    base = replace(_base(campaign), name="next")
    for workpiece in ("straight", "incline_16", "incline_30", "curved"):
        edge = replace(base, workpiece=workpiece, standoff=None, phases=short_phases(workpiece))
        for force, speed in ((base.f_nd, base.v_td), (60.0, -0.06), (12.0, -0.03)):
            what = f"track the {workpiece} edge with {force:g} N at {abs(1e3 * speed):g} mm/s"
            yield Proposal(what, replace(edge, f_nd=force, v_td=speed), tracks=True)
        if workpiece == "straight":
            what = f"track the straight edge from x = {ELSEWHERE:g} m with {base.f_nd:g} N"
            yield Proposal(what, replace(edge, start_x=ELSEWHERE), tracks=True)
    yield from _open_loop(base)


def _open_loop(base: Scenario) -> Iterator[Proposal]:
    """Steps of the commands, with the pistons clamped and without a workpiece."""
    phases = {
        "approach": (0.0, OPEN),
        "contact": (OPEN, OPEN + 0.01),
        "contour": (OPEN + 0.01, OPEN + 0.02),
    }
    for u_x, u_z in ((0.9, 1.1), (1.2, 1.4), (2.0, 2.0)):
        step = replace(
            base, workpiece="straight", phases=phases, approach_u_x=u_x, approach_u_z=u_z
        )
        held = replace(step, clamped=("x", "z"), start_x=0.5, start_z=0.05, standoff=0.09)
        yield Proposal(
            f"with both pistons clamped, step the commands from 0 to {u_x:g} V (x) and "
            f"{u_z:g} V (z) for {OPEN:g} s",
            held,
        )
        yield Proposal(
            f"without a workpiece, let both axes run free at {u_x:g} V (x) and {u_z:g} V (z) "
            f"for {OPEN:g} s",
            replace(step, clamped=(), standoff=STROKE_Z),
        )


def _base(campaign: Campaign) -> Scenario:
    """With the controller and gains of the campaign's own last closed-loop log."""
    base = Scenario(sensors=SensorParams(noise=False))
    closed = [
        run.setup
        for run in campaign
        if run.setup.loop == "closed"
        and run.setup.controller is not None
        and is_known_controller(run.setup.controller)
    ]
    return _with_controller(base, closed[-1]) if closed else base


def _with_controller(base: Scenario, setup: LogSetup) -> Scenario:
    gains = setup.gains if setup.gains is not None else base.gains
    force, speed = setup.f_nd or base.f_nd, setup.v_td or base.v_td
    return replace(
        base,
        controller=setup.controller or base.controller,
        gains=gains,
        f_nd=float(force),
        v_td=float(speed),
    )


def _separation(
    task: Task, fmu: FmuFile, scenario: Scenario, values: Sequence[Mapping[str, float]]
) -> float | None:
    """RMS difference of the two plants for the commands that the first one sees; None where the
    experiment cannot be done.
    """
    first = dict(augmented_of(fmu, values[0]).plant)
    record = simulated("next", replace(scenario, plant=first), fmu, THINNING)
    if record is None:
        return None
    try:
        one, other = replays(task.plant, record, values, task.cache)
    except (InputError, RunError):
        return None
    if one is None or other is None:
        return None
    apart = np.abs(one.simulated - other.simulated) / np.array([SIGMA[c] for c in one.signals])
    return float(np.sqrt(np.mean(np.minimum(apart, MOST) ** 2)))


def simulated(name: str, scenario: Scenario, fmu: FmuFile, thinning: int) -> Record | None:
    """What a rig with the scenario's plant and sensors would log, averages of `thinning` rows; None
    where the experiment cannot be done.
    """
    try:
        run = run_scenario(scenario, fmu)
    except (InputError, RunError):
        return None
    if run.outcome != "done" or np.hypot(run.log["f_x"], run.log["f_z"]).max() > MOST_FORCE:
        return None
    return thinned(record_of(name, LoggedRun(scenario_setup(scenario), run.log)), thinning)
