"""Missing terms of the gantry, learnt from campaigns of the independent truth plant: `python -m
benchmarks.missing_terms_gantry [--first SEED] [--count N] [--both | --sound]`.

Seeds of the set `unknown12` (see `pneugantry blind`): each rig has tolerance, nuisances and one of
twelve kinds of effect that no catalogue names, the kind by the seed's remainder of 12, the severity
by that of its twelfth of 3. `--both`: of the set `both12`, with an effect that the catalogue has
beside it. `--sound`: rigs of the set `nuisance` without any effect, searched for a term all the
same.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.missing_terms import print_sums
from modelica_fmu.cut import structure
from pneugantry.api.diagnosis import Diagnosis, diagnose
from pneugantry.blind.sets import SETS
from pneugantry.engine.plant import Array, Record
from pneugantry.learn.learned import Learned
from pneugantry.truth.campaign import write
from pneugantry.truth.case import CaseSet, run_case

__all__ = ["form_is", "judged", "main", "same_variable"]

FIRST = 91236  # twelve kinds at the middle severity; 1000 to 1999 are for development
SEVERITIES = ("small", "middle", "large")
ROOTS = {  # what the truth calls it -> variable of the model
    "depth_rate": "contact.delta_dot",
    "a_x": "axis_x.a",
    "a_z": "axis_z.a",
}
AS_WELL = {  # a command acts by what it exceeds u_0
    f"u_{axis}": tuple(f"valve_{axis}.{name}" for name in ("u", "f_target", "f_drive"))
    for axis in "xz"
} | {  # the truth's base is pushed by the forces on its carriage, which may be held
    f"a_{axis}": (f"axis_{axis}.a_free",) for axis in "xz"
}
SAME = 0.999  # correlation from which on two variables of the model are one in these logs
FORMS = {  # formula of the truth -> forms that are it
    "r": {"linear", "line"},
    "r^2": {"square", "square beyond"},
    "r|r|": {"signed square"},
    "|r|": {"magnitude"},
    "sin": {"sine"},
    "periodic": {"sine", "periodic"},
    "1-exp(-r)": {"exponential"},
    "play": {"play"},
    "resonance": {"resonance", "recoil"},
}
# where the variable keeps its sign
ONE_SIGNED = {"r|r|": {"square"}, "r^2": {"signed square"}, "|r|": {"linear"}}
SIZES = {  # coefficients that stand in the model's own balance as they do in the truth
    "quadratic_drag": "m*a_free",
    "vibration": "m*a_free",
    "rate_damping": "raw",
}


def form_is(formula: str, form: str, ends: Sequence[float]) -> bool:
    """Whether a learnt form is the truth's formula, over the range that the logs cover."""
    allowed = FORMS.get(formula, set())
    if ends[0] >= 0 or ends[1] <= 0:
        allowed = allowed | ONE_SIGNED.get(formula, set())
    return form in allowed


def same_variable(learned: Learned, regressor: str, truth: str) -> bool:
    """Whether a learnt regressor is the truth's: the same variable of the model, or one that these
    logs do not tell from it. What turns round with a speed may turn round in the truth as well.
    """
    plain = regressor.split(" against ")[0].split(" times ")[0]
    if truth == "time" or plain == "time":
        return truth == plain
    task = learned.before.task
    wanted = ROOTS.get(truth) or next(
        (s.variable for s in task.plant.signals if s.name == truth), truth
    )
    series = {r.label: values for r, values in learned.screen.series.items()}
    if plain not in series:
        return False
    if plain == wanted or plain in AS_WELL.get(truth, ()):
        return True
    own = np.concatenate([series[plain][r.name] for r in task.data.fitted])
    if truth.startswith("work_"):
        force = series.get(f"axis_{truth[-1]}.friction.F")
        if force is None:
            return False
        worked = [_work(force[r.name], r, truth[-1]) for r in task.data.fitted]
        return _alike(own, worked)
    for label, values in series.items():
        named = label == wanted or label.endswith(f".{wanted.rsplit('.', 1)[-1]}")
        if named and _alike(own, [values[r.name] for r in task.data.fitted]):
            return True
    known = [{**r.signals, **r.inputs} for r in task.data.fitted]
    return all(truth in k for k in known) and _alike(own, [k[truth] for k in known])


def _alike(whole: Array, other: Sequence[Array]) -> bool:
    """Whether a variable over all records is another one of them, but for scale and offset."""
    return abs(float(np.corrcoef(whole, np.concatenate(other))[0, 1])) > SAME


def _work(force: Array, record: Record, axis: str) -> Array:
    """Work of an axis' Coulomb friction since the record began, from row to row."""
    power = np.abs(force * record.signals[f"v_{axis}"])
    return np.asarray(np.cumsum(power) * record.period)


def _of_acceleration(learned: Learned, answer: Mapping[str, Any]) -> str:
    """What an answer is a function of: z less its resonance is the resonance of its acceleration,
    but for the square of the natural frequency; a speed recoils by its acceleration.
    """
    label, form = str(answer["regressor"]), answer["form"]
    if form not in ("resonance", "recoil"):
        return label
    task = learned.before.task
    shape = structure(task.plant.model, task.plant.class_name)
    rate = shape.rates.get(shape.roots.get(label, ""), "")
    acceleration = rate if form == "recoil" else shape.rates.get(rate, "")
    same = (r.label for r in learned.screen.series if shape.roots.get(r.label) == acceleration)
    return next(same, label)


def _turns_round(answer: Mapping[str, Any]) -> bool:
    """Whether a term lies in a level of friction, which acts against any motion."""
    component, left = str(answer["component"]), str(answer["equation"]).split(" = ")[0]
    return component.endswith(".friction") and left != "F"


def judged(cause: Mapping[str, Any], learned: Learned, told: Mapping[str, Any]) -> dict[str, Any]:
    """Which parts of what was learnt are right. cause: as a case's label lists it."""
    term, gap = told["term"], told["gap"]
    formula, truths = cause["formula"], cause["regressors"]
    answers = told["answer_set"]
    told_of = [_of_acceleration(learned, a) for a in answers]
    right = [any(same_variable(learned, r, t) for t in truths) for r in told_of]
    shown = term["form"]
    if shown == "square" and _turns_round(answers[0]):
        shown = "signed square"
    form = right[0] and form_is(formula, shown, term["range"])
    found: dict[str, Any] = {
        "term": f"{term['formula']} in {term['block']}: {term['equation'][:40]}",
        "accepted": told["accepted"],
        "block": any(a["block"] in cause["blocks"] for a in answers[:1]),
        "regressor": right[0],
        "in_set": any(right),
        "form": form,
        "beside": [c["effect"] for c in told["causes"]],
        "shrink": round(gap["shrink"], 4) if gap else None,
        "size": float(f"{cause['parameters']['coefficient']:.4g}"),
        "why": told["why"],
    }
    if form and term["equation"].startswith(SIZES.get(cause["effect"], "\0")):
        ends = sorted(map(abs, next(iter(term["parameters"].values()))["ci95"]))
        found["within"] = ends[0] <= abs(cause["parameters"]["coefficient"]) <= ends[1]
    return found


def _diagnosed(folder: Path, forced: bool) -> Diagnosis:
    """forced: a term is looked for whatever the answer."""
    found = diagnose(folder)
    if forced:
        likely = replace(found.found.decision, unknown=1.0)
        found = replace(found, found=replace(found.found, decision=likely))
    return found.with_missing_term()


def row(seed: int, sound: bool, both: bool = False) -> dict[str, Any]:
    """One rig, diagnosed and judged. both: with a known effect beside the term."""
    case_set = SETS["nuisance" if sound else "both12" if both else "unknown12"]
    assert isinstance(case_set, CaseSet)
    campaign, label = run_case(case_set.plan(seed, "none" if sound else ""))
    began = _cpu()
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), campaign)
        found = _diagnosed(Path(folder), sound)
    cause = None if sound else next(c for c in label["causes"] if not c["known"])
    kind = "sound" if cause is None else f"{cause['effect']}/{cause['axis']}".rstrip("/")
    made: dict[str, Any] = {"kind": kind, "seed": seed, "verdict": found.verdict, "term": ""}
    if cause is not None:
        made["severity"] = SEVERITIES[seed // 12 % 3]
    told = found.json.get("learned")
    if told is not None and told["term"] is not None and found.learned is not None:
        if cause is not None:
            made |= judged(cause, found.learned, told)
            known = [f"{c['effect']}/{c['axis']}" for c in label["causes"] if c["known"]]
            beside = [f"{c['effect']}/{c['axis']}" for c in told["causes"]]
            made["known"] = sorted(beside) == sorted(known)
        else:
            made |= {"term": told["term"]["formula"], "accepted": told["accepted"]}
    elif told is not None:
        made["why"] = told["why"]
    seconds = {"cpu_s": round(_cpu() - began, 1)}
    if found.learned is not None:
        seconds["learn_s"] = round(found.learned.seconds, 1)
    return made | seconds


def _cpu() -> float:
    """CPU seconds of this process and of the compilers that it has run."""
    t = os.times()
    return t.user + t.system + t.children_user + t.children_system


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a row for each rig, and how many are right."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.missing_terms_gantry")
    parser.add_argument("--first", type=int, default=FIRST, metavar="SEED", help="first seed")
    parser.add_argument("--count", type=int, default=12, metavar="N", help="number of rigs")
    parser.add_argument("--step", type=int, default=1, metavar="N", help="between two seeds")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--both", action="store_true", help="with a known effect beside it")
    which.add_argument("--sound", action="store_true", help="rigs without any effect")
    options = parser.parse_args(arguments)
    rows = []
    for seed in range(options.first, options.first + options.count * options.step, options.step):
        rows.append(row(seed, options.sound, options.both))
        print({k: v for k, v in rows[-1].items() if v not in (None, "", [])}, flush=True)
    print_sums(rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
