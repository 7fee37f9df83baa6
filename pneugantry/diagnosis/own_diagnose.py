"""The diagnosis of a user's own plant with a user's own catalogue: which effects, how far the gap
shrinks, what could not be told.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from modelica_fmu.errors import InputError
from pneugantry.diagnosis.own_bench import OwnBench
from pneugantry.diagnosis.own_limits import at_bounds, intervals, shrink, shrink_interval, untold
from pneugantry.diagnosis.own_plant import OwnLog, OwnPlant
from pneugantry.diagnosis.own_search import OwnSearch, Step, search
from pneugantry.engine.catalogue import Effect

__all__ = ["OwnDiagnosis", "diagnose_own", "own_json"]

QUIET = 1.1  # gap of the fitted logs up to which nothing is taken to be left
UNKNOWN = (
    0.30,
    3.0,
)  # share of the gap's square left at which "unknown" is as likely as not, and how steep
CAP = 0.99  # no answer is surer
SURE = 0.6  # probability from which the best hypothesis is called identified


@dataclass(eq=False)
class OwnDiagnosis:
    """What was found."""

    plant: OwnPlant
    catalogue: Mapping[str, Effect]
    found: OwnSearch
    verdict: str
    unknown: float
    intervals: dict[str, tuple[float, float]]  # 95 %, by parameter
    gaps: dict[str, dict[str, float]]  # by log: nominal, tolerance, augmented
    errors: dict[
        str, dict[str, dict[str, float]]
    ]  # by log: nominal, augmented: by channel, RMS error over RMS signal
    path: list[dict[str, Any]]
    shrink_ci: tuple[float, float]
    notes: list[str]
    seconds: float

    @property
    def judged(self) -> OwnLog:
        """The log on which the gap is quoted: the first that is held out, if any is."""
        return next((log for log in self.plant.logs if log.held_out), self.plant.logs[0])


def diagnose_own(
    plant: OwnPlant, catalogue: Mapping[str, Effect], say: Callable[[str], None] | None = None
) -> OwnDiagnosis:
    """Tolerance, search, intervals, gaps. `say`: told the name of each stage as it begins."""
    say = say or (lambda text: None)
    started = time.perf_counter()
    _check(plant, catalogue)
    notes = list(plant.notes)
    with OwnBench(plant, 2 * math.log(max(len(catalogue), 1))) as bench:
        say("search")
        found = search(bench, catalogue)
        say("intervals and gaps")
        best = found.best
        gaps = {
            log.name: {
                "nominal": bench.gap(log, {}),
                "tolerance": bench.gap(log, found.null.values),
                "augmented": bench.gap(log, best.values),
            }
            for log in plant.logs
        }
        errors = {
            log.name: {
                "nominal": bench.relative(log, {}),
                "augmented": bench.relative(log, best.values),
            }
            for log in plant.logs
        }
        path = [_step(bench, step) for step in found.steps]
        ends = intervals(bench, best)
        notes += untold(bench, found.best, catalogue)
        judged = next((log for log in plant.logs if log.held_out), None)
        if judged is None:
            notes.append("no log is held out: the gap before and after is that of a fitted log")
        shrink_ends = shrink_interval(bench, judged or plant.logs[0], best)
        verdict, unknown = _verdict(bench, found)
    left = math.sqrt(
        np.mean([gaps[log.name]["augmented"] ** 2 for log in plant.logs if not log.held_out])
    )
    if left > QUIET:
        notes.append(
            f"what is left is {left:.3g} times the sensors' noise: the catalogue does "
            f"not hold all that the plant does"
        )
    notes += [
        f"{s.effect} was added and is needless beside the later ones"
        for s in found.steps
        if not s.taken
    ]
    notes += [
        f"{name} reaches its bound in the catalogue: its size is not determined"
        for name in at_bounds(best, ends)
    ]
    return OwnDiagnosis(
        plant,
        catalogue,
        found,
        verdict,
        unknown,
        ends,
        gaps,
        errors,
        path,
        shrink_ends,
        notes,
        time.perf_counter() - started,
    )


def _step(bench: OwnBench, step: Step) -> dict[str, Any]:
    what = (
        f"in place of {step.instead_of}"
        if step.instead_of
        else "added"
        if step.taken
        else "dropped"
    )
    errors = {log.name: bench.relative(log, step.trial.values) for log in bench.plant.logs}
    return {
        "effect": step.effect,
        "step": what,
        "evidence": 0.5 * step.gain,
        "parameters": step.trial.fit.values,
        "errors": errors,
    }


def _check(plant: OwnPlant, catalogue: Mapping[str, Effect]) -> None:
    """Refuses a catalogue that speaks of other plants."""
    for effect in catalogue.values():
        for form in effect.forms:
            for name in (*form.settings, *(p.name for p in form.parameters)):
                if name not in plant.fmu.variables:
                    hint = "correct the name, or give the plant's own catalogue with --catalogue"
                    raise InputError(
                        f"{plant.fmu.path.name} has no such parameter",
                        field=f"{effect.name}: {name}",
                        hint=hint,
                    )
        unknown = set(effect.refines) - {e.name for e in catalogue.values()}
        if unknown:
            raise InputError(
                f"refines {unknown.pop()!r}, which the catalogue lacks",
                field=effect.name,
                hint="correct the name",
            )


def _verdict(bench: OwnBench, found: OwnSearch) -> tuple[str, float]:
    """Verdict, and the probability that something outside the catalogue is at work."""
    quiet = QUIET**2 - 1
    before, after = bench.excess(found.null), bench.excess(found.best)
    share = after / before if after > quiet else 0.0
    unknown = CAP / (1 + (UNKNOWN[0] / share) ** UNKNOWN[1]) if share > 0 else 0.0
    if unknown > 0.5:
        return "unknown", unknown
    if not found.best.keys:
        return "none", unknown
    top, probability = found.probabilities[0]
    sure = probability * (1 - unknown) > SURE and set(top.keys) == set(found.best.keys)
    return ("identified" if sure else "ambiguous"), unknown


def own_json(d: OwnDiagnosis) -> dict[str, Any]:
    """The JSON of docs/reference/gap.md, "gap/1"; further keys: path, errors, gaps."""
    gap = d.gaps[d.judged.name]
    return {
        "schema": "gap/1",
        "plant": d.plant.name,
        "verdict": d.verdict,
        "where": _where(d),
        "causes": _causes(d),
        "answer_set": _answers(d),
        "gap": {
            "nominal": gap["nominal"],
            "augmented": gap["augmented"],
            "floor": 1.0,
            "shrink": shrink(gap["nominal"] ** 2, gap["augmented"] ** 2),
            "ci95": list(d.shrink_ci),
            "log": d.judged.name,
        },
        "closed_loop": None,
        "next_experiment": None,
        "notes": d.notes,
        "unknown_probability": d.unknown,
        "path": d.path,
        "errors": d.errors,
        "gaps": d.gaps,
        "seconds": d.seconds,
    }


def _where(d: OwnDiagnosis) -> list[dict[str, Any]]:
    """Blocks by what their effects explain when they are added one by one; an unknown effect sits
    where the nearest one does.
    """
    shares: dict[str, float] = {}
    for step in d.found.steps:
        if step.taken and step.effect in d.found.best.keys:
            block = d.catalogue[step.effect].block
            shares[block] = shares.get(block, 0.0) + max(step.gain, 0.0)
    if d.verdict == "unknown":
        nearest = min(d.found.losers, key=lambda t: t.evidence, default=None)
        block = d.catalogue[nearest.keys[-1]].block if nearest is not None else "unknown"
        shares[block] = shares.get(block, 0.0) + max([1.0, *shares.values()])
    total = sum(shares.values())
    logs = [log.name for log in d.plant.logs if not log.held_out]
    ranked = sorted(shares.items(), key=lambda item: -item[1])
    return [
        {"block": block, "share": share / total, "logs": logs, "regime": ""}
        for block, share in ranked
        if total > 0
    ]


def _causes(d: OwnDiagnosis) -> list[dict[str, Any]]:
    """Effects of the best hypothesis first, in the order in which they were found."""
    total: dict[str, float] = {}
    for trial, probability in d.found.probabilities:
        for key in trial.keys:
            total[key] = total.get(key, 0.0) + probability * (1 - d.unknown)
    best = d.found.best
    forms = {effect.key: form for effect, form in best.hypothesis.effects}
    result = []
    for key in sorted(
        total, key=lambda k: (k not in forms, best.keys.index(k) if k in forms else 0, -total[k])
    ):
        if key not in forms and total[key] < 0.01:
            continue
        effect = d.catalogue[key]
        parameters = {
            p.name: {
                "value": best.values[p.name],
                "ci95": list(d.intervals[p.name]),
                "unit": p.unit,
                "form": forms[key].name,
            }
            for p in (forms[key].parameters if key in forms else ())
        }
        result.append(
            {
                "effect": effect.name,
                "axis": effect.axis,
                "probability": min(total[key], CAP),
                "parameters": parameters,
            }
        )
    return result


def _answers(d: OwnDiagnosis) -> list[list[str]]:
    """The smallest set of hypotheses that holds 95 %."""
    ranked = [([*trial.keys], p * (1 - d.unknown)) for trial, p in d.found.probabilities]
    if d.unknown > 0:
        ranked = sorted([*ranked, (["unknown"], d.unknown)], key=lambda item: -item[1])
    answers, held = [], 0.0
    for keys, probability in ranked:
        if held >= 0.95 or probability < 0.005:
            break
        answers.append(keys)
        held += probability
    return answers
