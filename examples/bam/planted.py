"""Errors planted into the description of the servo, and which of them a diagnosis of the real logs
names.

What is counted was fixed before the first diagnosis. Mass and length act through m*l (gravity) and
m*l^2 (inertia); gain and supply are the same wherever the duty does not saturate. Where logs do not
part such a pair, the right answer is a set that holds the planted one.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from examples.bam.convert import (
    FULL,
    PLANT,
    Left,
    Planted,
    aligned,
    planted_errors,
    read_raw,
    write_planted,
)
from examples.bam.servo import FIELDS, FITTED_GAINS, PERIOD, duties, log_names, positions
from pneugantry.blind.score import NAMED, Judged, judged, key
from pneugantry.plants.campaigns import Diagnoser, diagnose_campaigns

__all__ = ["COLUMNS", "OF_MODEL", "accuracy", "counted", "figures", "printed", "tally"]

Say = Callable[[str], None]
SOUND = 10  # descriptions that are right within tolerance
LONGEST = 200  # rows over which the correlation of an error is followed
ALIKE = (frozenset({"mass", "arm_length"}), frozenset({"firmware_gain", "supply_level"}))
OF_MODEL = {  # name of a parameter in `servo`: in the model
    "k_t": "motor.k_t",
    "R": "motor.R",
    "armature": "armature",
    "q_offset": "pendulum.q_offset",
    "m": "pendulum.m",
    "l": "pendulum.l",
    "V": "motor.V",
    "gain": "firmware.gain",
    "T_c": "gearbox.T_c",
    "d": "gearbox.d",
    "T_s": "gearbox.T_s",
    "w_s": "gearbox.w_s",
    "alpha": "gearbox.alpha",
    "load_motor": "gearbox.load_motor",
    "load_external": "gearbox.load_external",
    "load_external_rest": "gearbox.load_external_rest",
    "load_motor_square": "gearbox.load_motor_square",
    "load_external_square": "gearbox.load_external_square",
}
COLUMNS = {  # of the tally
    "right": "all planted named, nothing else, not called unknown",
    "named": "all planted named and nothing else, whatever the verdict",
    "first": "the likeliest cause is planted",
    "alike": "as `named`, an alike one counting for the planted one",
    "held": "the answer set holds the planted ones",
    "ambiguous": "verdict ambiguous",
    "unknown": "verdict unknown",
    "none": "verdict none",
    "wrong": "verdict identified, and something is named that is not planted",
}


def accuracy(raw: Path, right: Mapping[str, float]) -> dict[str, Left]:
    """What the right plant leaves of each signal on the logs it was fitted to."""
    values = {field: float(right.get(OF_MODEL.get(field, ""), 0.0)) for field in FIELDS}
    logs = {name: aligned(read_raw(raw, name)) for name in log_names(FITTED_GAINS)}
    return {
        "q": _lasting([log["position"] - positions(values, n, log) for n, log in logs.items()]),
        "load": _lasting([log["load"] - FULL * duties(values, n, log) for n, log in logs.items()]),
        "volts": _lasting([log["input_volts"] - values["V"] for log in logs.values()]),
    }


def _lasting(found: Sequence[pd.Series]) -> Left:
    """RMS of errors, and the time in which their correlation falls to 1/e, to two digits."""
    left = [e.to_numpy() for e in found]
    square = float(np.mean([np.mean(e**2) for e in left]))
    rows = 1
    while rows < LONGEST and _correlation(left, rows) > square / math.e:
        rows += 1
    return Left(float(f"{math.sqrt(square):.2g}"), float(f"{rows * PERIOD:.2g}"))


def _correlation(left: Sequence[np.ndarray], rows: int) -> float:
    """Mean product of errors so many rows apart."""
    return float(np.mean([np.mean(e[rows:] * e[:-rows]) for e in left]))


def figures(
    raw: Path,
    out: Path,
    right: Mapping[str, float],
    *,
    cases: int | None = None,
    encoder: bool = False,
    say: Say = lambda name: None,
) -> dict[str, Any]:
    """Diagnoses the right description, those with planted errors and `SOUND` that are right within
    tolerance, one after the other; what is on disk in `out` is taken from there. cases: so many of
    the errors, spread over the list (None: all); encoder: judge by the encoder's noise, not by what
    the right plant is known to leave. No missing term is looked for: each error is in the
    catalogue.
    """
    chosen = [Planted({}), *_spread(planted_errors(), cases)]
    left = None if encoder else accuracy(raw, right)
    folders = write_planted(raw, out, right, left, chosen)
    for k in range(SOUND):
        folders += write_planted(raw, out / f"within_{k}", within(right, k), left, [Planted({})])
    found = diagnose_campaigns(folders, Diagnoser(learn=False), workers=1, done=say)
    rows = [counted(str(f.relative_to(out)), _truth(f), answer) for f, answer in found.items()]
    told = None if left is None else {name: asdict(own) for name, own in left.items()}
    sound = [r for r in rows if not r["planted"]]
    return {
        "left": told,
        "rows": rows,
        "tally": tally([r for r in rows if r["planted"]]),
        "sound": {"cases": len(sound), "none": sum(r["counts"]["none"] for r in sound)},
    }


def within(right: Mapping[str, float], seed: int) -> dict[str, float]:
    """The right parameters, off by draws of the tolerance that the description gives them."""
    tolerance = tomllib.loads(PLANT.read_text(encoding="utf-8"))["tolerance"]
    draw = np.random.default_rng(seed)
    off = {n: right[n] * math.exp(share * draw.standard_normal()) for n, share in tolerance.items()}
    return {**right, **off}


def _spread(errors: Sequence[Planted], count: int | None) -> list[Planted]:
    """`count` of them, evenly over the list."""
    least = len(errors) if count is None else min(count, len(errors))
    return [errors[i * len(errors) // least] for i in range(least)]


def _truth(folder: Path) -> dict[str, Any]:
    truth: dict[str, Any] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    return truth


def counted(name: str, truth: Mapping[str, Any], answer: Mapping[str, Any]) -> dict[str, Any]:
    """What was planted, what was found, and how that counts."""
    case = judged(name, truth, answer)
    planted = {key(c): float(c["factor"]) for c in truth["causes"]}
    causes = [c for c in answer["causes"] if c["effect"] != "unknown"]
    told = {key(c): float(c["probability"]) for c in causes}
    gap = answer.get("gap") or {}
    return {
        "case": name,
        "planted": planted,
        "verdict": case.verdict,
        "causes": told,
        "gap": {k: gap[k] for k in ("nominal", "augmented") if k in gap},
        "seconds": case.seconds,
        "counts": _counts(case, set(planted), told),
    }


def _counts(case: Judged, planted: set[str], told: Mapping[str, float]) -> dict[str, bool]:
    named = {k for k, probability in told.items() if probability >= NAMED}
    likeliest = max(told, key=lambda k: told[k], default="")
    return {
        "right": case.right,
        "named": named == planted,
        "first": likeliest in planted,
        "alike": len(named) == len(planted) and _kinds(named) == _kinds(planted),
        "held": case.held,
        "ambiguous": case.verdict == "ambiguous",
        "unknown": case.verdict == "unknown",
        "none": case.verdict == "none",
        "wrong": case.verdict == "identified" and case.wrong_cause,
    }


def _kinds(effects: set[str]) -> list[str]:
    """Effects with alike ones under one name, sorted."""
    return sorted(next((min(a) for a in ALIKE if e in a), e) for e in effects)


def tally(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, int]]:
    """Cases by column of `COLUMNS`: with one error, with two, all."""
    groups = {
        "one": [r for r in rows if len(r["planted"]) == 1],
        "two": [r for r in rows if len(r["planted"]) == 2],
        "all": list(rows),
    }
    return {
        name: {"cases": len(of), **{c: sum(r["counts"][c] for r in of) for c in COLUMNS}}
        for name, of in groups.items()
    }


def printed(found: Mapping[str, Any]) -> str:
    """The counts and each case, in Markdown."""
    left = found["left"]
    judged_by = "the encoder's noise"
    if left:
        told = (f"{v['rms']:g} of {n} that last {v['lasting']:g} s" for n, v in left.items())
        judged_by = "what the right plant leaves, " + ", ".join(told)
    lines = [f"Judged by {judged_by}.", "", "| errors | cases | " + " | ".join(COLUMNS) + " |"]
    lines += ["|---" * (len(COLUMNS) + 2) + "|"]
    for name, row in found["tally"].items():
        lines.append(f"| {name} | " + " | ".join(str(n) for n in row.values()) + " |")
    told = found["sound"]
    lines += ["", f"Right within tolerance: {told['none']} of {told['cases']} are none."]
    lines += ["", *(f"- {name}: {words}" for name, words in COLUMNS.items()), ""]
    lines += ["| case | planted (rig / description) | verdict | causes | gap | s |"]
    lines += ["|---|---|---|---|---|---|"]
    for r in found["rows"]:
        planted = ", ".join(f"{k} {v:.2f}" for k, v in r["planted"].items())
        causes = ", ".join(f"{k} {v:.2f}" for k, v in r["causes"].items())
        gap = " to ".join(f"{v:.2f}" for v in r["gap"].values())
        lines.append(
            f"| {r['case']} | {planted} | {r['verdict']} | {causes} | {gap} | {r['seconds']:.0f} |"
        )
    return "\n".join(lines)
