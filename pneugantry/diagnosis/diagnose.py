"""The diagnosis of a campaign: where the gap lies, which effect causes it, how far it shrinks, and
what could not be told.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from modelica_fmu.errors import InputError, RunError
from pneugantry.diagnosis.bench import Bench, Choice, Outcome
from pneugantry.diagnosis.confirm import Augmented, GapResult, closed_loop, replay_gap
from pneugantry.diagnosis.converter import converter_step
from pneugantry.diagnosis.decide import Decision, Hypothesis, contributions, decide
from pneugantry.diagnosis.evidence import Search
from pneugantry.diagnosis.excitation import not_excited
from pneugantry.diagnosis.held_out import examine
from pneugantry.diagnosis.next_experiment import next_experiment
from pneugantry.diagnosis.records import oddity
from pneugantry.diagnosis.regimes import regime_of
from pneugantry.diagnosis.search import search
from pneugantry.engine.catalogue import Effect
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import COLUMNS, SIGMA, log_warnings
from pyfmi_runner.replay import Replayer

__all__ = ["OF_VIEWS", "Diagnosis", "diagnose", "report_json", "sound_logs", "split_campaign"]

HELD_OUT = (
    "contour_straight"  # the log that no fit sees, where the campaign has it; else its last log
)
OF_VIEWS = ("waviness", "loss")  # parameters that views alone know
CLAIMS = ("identified", "ambiguous")
# gap that the augmented plant leaves from which on a claim is in doubt, whatever its evidence
UNREPLAYED = 5.0
DOUBT = (
    "of 14 answers of which that much was left (blind cases of seeds 76000 to 78199) six were wrong"
)
FAULTS = (
    "swapped",
    "reversed",
    "clipped",
    "throughout",
)  # words of `log_warnings` that tell of a fault of the record
VIEW_BLOCKS = {
    "friction_x": ("friction_x",),
    "friction_z": ("friction_z",),
    "contact": ("contact",),
    "valve_x": ("valve_x",),
    "valve_z": ("valve_z",),
    "sensors": ("sensors",),
    "timing": ("timing",),
}


@dataclass(eq=False)
class Diagnosis:
    """Everything the report and the JSON are made of."""

    campaign: Campaign
    decision: Decision
    found: Search
    values: dict[str, float]  # fitted parameters of the augmented model
    where: list[dict[str, Any]]
    causes: list[dict[str, Any]]
    gap: GapResult | None
    held_out: str
    closed: dict[str, float] | None
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0
    stages: dict[str, float] = field(default_factory=dict)
    limits: list[str] = field(default_factory=list)  # what the fitted logs cannot show
    experiment: dict[str, Any] | None = None  # the next one, where the answer is ambiguous


def diagnose(
    campaign: Campaign,
    gantry: FmuFile,
    catalogue: Mapping[str, Effect],
    say: Callable[[str], None] | None = None,
    workers: int = 1,
) -> Diagnosis:
    """Diagnoses a campaign against the nominal FMU. `say`: told the name of each stage as it
    begins; `workers`: processes to use.
    """
    say = say or (lambda text: None)
    started = time.perf_counter()
    notes = list(campaign.notes) + [
        f"{name}: {text}" for name, run in campaign.logs.items() for text in log_warnings(run.log)
    ]
    campaign, left_out = sound_logs(campaign)
    notes += left_out
    fitted, held = split_campaign(campaign)
    if held is None:
        notes.append(
            "one log only: nothing is held out, so the gap before and after is on the "
            "fitted log itself"
        )
    stages: dict[str, float] = {}
    say("hypotheses")
    with Bench(fitted, gantry, workers=workers) as bench:
        found = search(bench, catalogue)
        stages["search"] = time.perf_counter() - started
        if held is not None:
            examine(found, campaign, held, gantry)
        seen = ("quantisation",) if bench.table.quanta and "quantisation" in catalogue else ()
        decision = decide(found, seen=seen, odd=oddity(bench.table))
        quanta = dict(bench.table.quanta)
        values = _values(bench, found, decision)
        where = _where(bench, found, decision, catalogue)
    causes = _causes(decision, catalogue, quanta) if decision.verdict != "none" else []
    say("confirmation")
    run = held or next(iter(campaign.logs.values()))
    gap, closed = _confirm(gantry, run, values, notes)
    stages["confirmation"] = time.perf_counter() - started - stages["search"]
    experiment = (
        _next(campaign, gantry, found, decision) if decision.verdict == "ambiguous" else None
    )
    if (
        gap is not None
        and held is not None
        and not seen
        and decision.verdict in CLAIMS
        and gap.augmented > UNREPLAYED
    ):
        notes.append(
            f"{held.log.name}: the augmented plant leaves a gap of {gap.augmented:.1f}; {DOUBT}"
        )
    seconds = time.perf_counter() - started
    limits = not_excited(fitted)
    return Diagnosis(
        campaign,
        decision,
        found,
        values,
        where,
        causes,
        gap,
        run.log.name,
        closed,
        notes,
        seconds,
        stages,
        limits,
        experiment,
    )


def _next(
    campaign: Campaign, gantry: FmuFile, found: Search, decision: Decision
) -> dict[str, Any] | None:
    """The experiment that tells the two likeliest hypotheses apart."""
    plain = {name: value for name, value in found.plain.items() if name not in OF_VIEWS}
    pair = decision.hypotheses[:2]
    if len(pair) < 2:
        return None
    first, second = (
        {**plain, **(h.trial.outcome.values if h.trial is not None else {})} for h in pair
    )
    return next_experiment(campaign, gantry, first, second, [h.keys for h in pair])


def sound_logs(campaign: Campaign) -> tuple[Campaign, list[str]]:
    """The campaign without logs whose channels are stuck, clipped, swapped or reversed, and what
    was left out and why.

    Such a log would be explained by some effect, and wrongly. Raises InputError where no log is
    left.
    """
    kept: dict[str, LoggedRun] = {}
    notes = []
    for name, run in campaign.logs.items():
        faults = [text for text in log_warnings(run.log) if _is_fault(run, text)]
        if faults:
            notes.append(f"{name} left out of the diagnosis: {faults[0]}")
        else:
            kept[name] = run
    if not kept:
        raise InputError(
            f"no log can be diagnosed ({notes[0]})",
            file=campaign.path,
            hint="hint its channels or columns",
        )
    return replace(campaign, logs=kept), notes


def _is_fault(run: LoggedRun, text: str) -> bool:
    """Whether a warning tells of a fault of the record, not of what an effect may do to
    a sensor.
    """
    channel = text.split()[0]
    if "coarse converter" in text:
        return converter_step(run.log[channel], SIGMA[channel]) == 0.0
    if "f_x and f_z swapped" in text:
        return run.setup.workpiece != "none"  # without a workpiece it is an offset
    return any(word in text for word in FAULTS)


def split_campaign(campaign: Campaign) -> tuple[Campaign, LoggedRun | None]:
    """The campaign without its held-out log, and that log."""
    if len(campaign.logs) < 2:
        return campaign, None
    name = HELD_OUT if HELD_OUT in campaign.logs else list(campaign.logs)[-1]
    rest = {key: run for key, run in campaign.logs.items() if key != name}
    return Campaign(campaign.name, campaign.path, rest, campaign.notes), campaign.logs[name]


def _values(bench: Bench, found: Search, decision: Decision) -> dict[str, float]:
    """Tolerance of all views, and the best hypothesis' own values where it has them; friction and
    contact from the mechanics run freely.
    """
    values = found.plain
    choice = Choice()
    if decision.best is not None:
        choice = decision.best.choice
        values |= decision.best.outcome.values
    values |= bench.polish(choice, values).values
    return {name: float(value) for name, value in values.items() if name not in OF_VIEWS}


def _confirm(
    gantry: FmuFile, run: LoggedRun, values: Mapping[str, float], notes: list[str]
) -> tuple[GapResult | None, dict[str, float] | None]:
    augmented = Augmented.of(values)
    try:
        with Replayer(gantry) as plant:
            gap = replay_gap(plant, run, augmented)
    except RunError as error:
        notes.append(f"the held-out log could not be replayed: {error}")
        return None, None
    try:
        return gap, closed_loop(gantry, run, augmented)
    except (RunError, ValueError) as error:
        notes.append(f"the closed loop could not be run again: {error}")
        return gap, None


def _where(
    bench: Bench, found: Search, decision: Decision, catalogue: Mapping[str, Effect]
) -> list[dict[str, Any]]:
    """Blocks by their share of what tolerance does not explain."""
    blocks = {key: effect.block for key, effect in catalogue.items()}
    shares = contributions(found, decision, blocks)
    if decision.verdict == "unknown" and (decision.unknown_view or decision.resembles is not None):
        block = (
            decision.resembles.block
            if decision.resembles is not None
            else _unknown_block(found, decision, blocks)
        )
        shares = {k: 0.5 * v for k, v in shares.items()}
        shares[block] = max([shares.get(block, 0.0), *shares.values()]) + 1.0
    if bench.table.quanta:
        shares["sensors"] = shares.get("sensors", 0.0) + max([1.0, *shares.values()]) * (
            2.0 if decision.best is None else 0.5
        )
    total = sum(shares.values())
    result = []
    for block, share in sorted(shares.items(), key=lambda item: -item[1]):
        logs, regime = regime_of(bench, found, block)
        result.append(
            {
                "block": block,
                "share": share / total if total else 0.0,
                "logs": logs,
                "regime": regime,
            }
        )
    return result


def _unknown_block(found: Search, decision: Decision, blocks: Mapping[str, str]) -> str:
    """Block of an effect outside the catalogue: that of the effect which, wrongly but best,
    explains the worst view; the sensors where both the contact and a carriage are left, for what
    these share is the force that was read.
    """
    view = decision.unknown_view
    if "contact" in decision.left and any(name.startswith("friction") for name in decision.left):
        return "sensors"
    candidates = VIEW_BLOCKS[view]
    if len(candidates) == 1:
        return candidates[0]
    for trial in found.singles:
        block = blocks[trial.choice.keys[0]]
        if view in trial.outcome.views and trial.gain > 0:
            return block
    return candidates[0]


def _causes(
    decision: Decision, catalogue: Mapping[str, Effect], quanta: Mapping[str, float]
) -> list[dict[str, Any]]:
    """Every effect that some hypothesis names, with its total probability; those of the best
    hypothesis first.
    """
    total: dict[str, float] = {}
    carrier: dict[str, Hypothesis] = {}
    for hypothesis in decision.hypotheses:
        for key in hypothesis.keys:
            total[key] = total.get(key, 0.0) + hypothesis.probability
            carrier.setdefault(key, hypothesis)
    named = decision.best.choice.effects if decision.best is not None else ()
    chosen = (
        *(effect.key for effect, _ in named if not effect.outside),
        *(("quantisation",) if quanta else ()),
    )
    result = []
    for key in sorted(total, key=lambda k: (k not in chosen, -total[k])):
        if total[key] < 0.005 and key not in chosen:
            continue
        effect = catalogue[key]
        parameters = _parameters(effect, carrier[key])
        if key == "quantisation":
            parameters = {
                f"step_{c}": {"value": q, "ci95": [q, q], "unit": COLUMNS[c].unit}
                for c, q in quanta.items()
            }
        result.append(
            {
                "effect": effect.name,
                "axis": effect.axis,
                "probability": min(total[key], 1.0),
                "parameters": parameters,
            }
        )
    return result


def _parameters(effect: Effect, hypothesis: Hypothesis) -> dict[str, Any]:
    if hypothesis.trial is None:
        return {}
    outcome: Outcome = hypothesis.trial.outcome
    choice: Choice = hypothesis.trial.choice
    form = next((f for e, f in choice.effects if e.key == effect.key), None)
    if form is None:
        return {}
    coordinates = {
        c.name: (c, theta)
        for c, theta in zip(outcome.fit.coordinates, outcome.fit.theta, strict=True)
    }
    result = {}
    for p in form.parameters:
        coordinate, theta = coordinates[p.name]
        inflation = max(1.0, max(outcome.rms(v) for v in outcome.views)) * np.sqrt(
            max(outcome.lengths[v] for v in outcome.views)
        )
        low, high = coordinate.interval(theta, outcome.fit.sigma(p.name) * inflation)
        result[p.name] = {
            "value": coordinate.value(theta),
            "ci95": [low, high],
            "unit": p.unit,
            "form": form.name,
        }
    return result


def report_json(d: Diagnosis) -> dict[str, Any]:
    """The JSON of docs/reference/gap.md, "gap/1"."""
    gap = None
    if d.gap is not None:
        gap = {
            "nominal": d.gap.nominal,
            "augmented": d.gap.augmented,
            "floor": d.gap.floor,
            "shrink": d.gap.shrink,
            "ci95": list(d.gap.ci95),
            "log": d.held_out,
        }
    return {
        "schema": "gap/1",
        "verdict": d.decision.verdict,
        "where": d.where,
        "causes": d.causes,
        "answer_set": d.decision.answer_set,
        "gap": gap,
        "closed_loop": d.closed,
        "next_experiment": d.experiment,
        "notes": [*d.notes, *d.limits],
        "unknown_probability": d.decision.unknown,
        "resembles": d.decision.resembles.summary if d.decision.resembles else None,
        "stages": d.stages,
        "seconds": d.seconds,
    }
