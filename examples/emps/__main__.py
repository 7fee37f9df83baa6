"""The measured axis' rungs, its diagnosis and what its catalogue lacks: `python -m examples.emps
[--json FILE] [--rungs-only | --learn]`; some minutes.

Published: A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019. The data
are not part of this repository.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from examples.emps import closed_loop, idim
from pneugantry.engine.answer.confirm import values_on
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.run import Found, run
from pneugantry.engine.task import Task
from pneugantry.learn.answer.result import to_json as learned_json
from pneugantry.learn.learn import learn
from pneugantry.learn.learned import Learned
from pneugantry.learn.wanted import wanted
from pneugantry.plants.described import described_task

PLANT = Path(__file__).parent / "plant.toml"
DATA = Path(__file__).resolve().parents[3] / "shared" / "real" / "emps"
# force errors in percent, train / pulses
PUBLISHED = {"offset": (4.083, 5.982), "asymmetric": (3.112, None)}
REFITTED = {
    "inertia": (69.8, 66.4),
    "viscous": (18.0, 17.3),
    "coulomb": (7.4, 7.7),
    "offset": (4.5, 5.4),
    "asymmetric": (3.6, 4.7),
}
PUBLISHED_MODEL = {
    "M": 95.1089,
    "friction.F_v": 203.5034,
    "friction.F_c": 20.3935,
    "offset": -3.1648,
}
PUBLISHED_SIMULATION = {
    "position": (0.0138, 0.0080),
    "velocity": (0.229, 0.479),
    "acceleration": (8.60, 19.8),
    "force": (5.85, 8.94),
}
PUBLISHED_PARAMETERS = {
    "offset": (95.1089, 203.5034, 20.3935, -3.1648),
    "asymmetric": (None, 166.71, 240.42, 20.14, 20.63),
}


def figures(diagnosed: bool = True, learnt: bool = False) -> dict[str, Any]:
    """All numbers, as JSON values. learnt: with the term that the catalogue lacks."""
    described, task = described_task(PLANT)
    axes = {
        "train": idim.read_axis(DATA / "DATA_EMPS.mat"),
        "pulses": idim.read_axis(DATA / "DATA_EMPS_PULSES.mat"),
    }
    inverse = idim.ladder(axes["train"], axes["pulses"])
    loop = closed_loop.ladder(task)
    table: dict[str, Any] = {
        "inverse": {
            n: {"parameters": r.parameters.tolist(), "train": r.train, "pulses": r.pulses}
            for n, r in inverse.items()
        },
        "closed_loop": {n: {"values": r.values, **r.errors} for n, r in loop.items()},
        "simulation": {
            r.name: closed_loop.simulation_errors(task.plant, r, axes[r.name], PUBLISHED_MODEL)
            for r in described.records
        },
    }
    if diagnosed:
        found = run(task, described.rules)
        table["diagnosis"] = diagnosis(task, found)
        if learnt and wanted(found):
            table["learnt"] = missing(learn(found, described.rules))
    return table


def missing(learned: Learned) -> dict[str, Any]:
    """What was learnt as JSON, with the force errors of the axis that has it."""
    told: dict[str, Any] = {"learned": learned_json(learned), "seconds": learned.seconds}
    if learned.after is not None:
        told["errors"] = _errors(learned.after.task, learned.after.decision.best)
    return told


def _errors(task: Task, fit: Fit) -> dict[str, float]:
    """Relative force errors by log."""
    (view,) = task.views
    held = task.data.held_out
    records = [*task.data.fitted, *([] if held is None else [held])]
    return {r.name: closed_loop.relative(view, r, values_on(fit, r)) for r in records}


def diagnosis(task: Task, found: Found) -> dict[str, Any]:
    """The answer as JSON, with the force errors after each step of the search."""
    told = to_json(found.diagnosis)
    for entry, step in zip(told["steps"], found.search.steps, strict=True):
        entry["errors"] = _errors(task, step.fit)
    left = {f"{v}, {s}": found.excess.ratio((v, s)) for v, s in found.excess.whole}
    return {**told, "left": left}


def printed(table: dict[str, Any]) -> str:
    """The tables in Markdown."""
    lines = [
        "Force error, train / pulses, %; each rung adds to the one before and is fitted on train.",
        "",
        "| rung | inverse model (IDIM-LS), below 50 Hz | published | in its loop, below "
        "20 Hz | the same, by others |",
        "|---|---|---|---|---|",
    ]
    for rung in idim.RUNGS:
        ours, loop = (
            (100 * table[kind][rung]["train"], 100 * table[kind][rung]["pulses"])
            for kind in ("inverse", "closed_loop")
        )
        lines.append(
            f"| {rung} | {_pair(ours)} | {_pair(PUBLISHED.get(rung))} | {_pair(loop, 1)} "
            f"| {_pair(REFITTED[rung], 1)} |"
        )
    lines += [
        "",
        "Parameters of the inverse model (M; F_v; F_c; offset. Asymmetric: M; F_v+, "
        "F_v-; F_c+, F_c-), ours and published:",
        "",
    ]
    for rung, known in PUBLISHED_PARAMETERS.items():
        found = ", ".join(f"{p:.2f}" for p in table["inverse"][rung]["parameters"])
        lines.append(
            f"- {rung}: {found}; published "
            + ", ".join("-" if p is None else f"{p:.2f}" for p in known)
        )
    lines += [
        "",
        "The published model simulated in its loop, every sample, error in %, train / pulses:",
        "",
        "| signal | ours | published |",
    ]
    lines.append("|---|---|---|")
    for name, (train, pulses) in PUBLISHED_SIMULATION.items():
        ours = tuple(100 * table["simulation"][log][name] for log in ("train", "pulses"))
        lines.append(f"| {name} | {ours[0]:.3g} / {ours[1]:.3g} | {train:.3g} / {pulses:.3g} |")
    if "diagnosis" in table:
        lines += ["", *_found(table["diagnosis"])]
    if "learnt" in table:
        lines += ["", *_learnt(table["learnt"])]
    return "\n".join(lines)


def _pair(values: tuple[float | None, ...] | None, digits: int = 2) -> str:
    return " / ".join("-" if v is None else f"{v:.{digits}f}" for v in values) if values else ""


def _found(found: dict[str, Any]) -> list[str]:
    """What the diagnosis did by itself."""
    lines = [
        "The diagnosis by itself, fitted on train:",
        "",
        "| step | effect | evidence (fall of -2 log) | force error, train / pulses, % |",
        "|---|---|---|---|",
    ]
    for step in found["steps"]:
        errors = tuple(100 * step["errors"][log] for log in ("train", "pulses"))
        what = "dropped" if step["dropped"] else "added"
        lines.append(f"| {what} | {step['effect']} | {step['gain']:.1f} | {_pair(errors)} |")
    lines += ["", f"verdict: {found['verdict']}"]
    for cause in found["causes"]:
        values = "; ".join(
            f"{name} = {p['value']:.4g} [{p['ci95'][0]:.4g}, {p['ci95'][1]:.4g}] {p['unit']}"
            for name, p in cause["parameters"].items()
        )
        lines.append(
            f"- {cause['effect']}, probability {cause['probability']:.2f}"
            + (f": {values}" if values else "")
        )
    gap = found["gap"]
    lines.append(
        f"gap of {gap['log']}: {gap['nominal']:.4g} -> {gap['augmented']:.3g}, shrink "
        f"{gap['shrink']:.4f}"
    )
    lines += [
        f"left in {name}: {ratio:.3g} times the noise" for name, ratio in found["left"].items()
    ]
    lines += [f"note: {note}" for note in found["notes"]]
    return [*lines, f"{found['seconds']:.0f} s"]


def _learnt(found: dict[str, Any]) -> list[str]:
    """What the catalogue lacks."""
    learned = found["learned"]
    lines = [learned["sentence"]]
    lines += [f"beside it: {c['effect']}" for c in learned["causes"]]
    lines += [f"as good on these logs: {t['formula']}" for t in learned["answer_set"][1:]]
    if "errors" in found:
        errors = tuple(100 * found["errors"][log] for log in ("train", "pulses"))
        lines.append(f"force error with it, train / pulses, %: {_pair(errors)}")
    return [*lines, f"{found['seconds']:.0f} s"]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m examples.emps", description="Rungs and diagnosis of the measured axis."
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there, too")
    parser.add_argument("--rungs-only", action="store_true", help="leave the diagnosis out")
    parser.add_argument("--learn", action="store_true", help="the term that the catalogue lacks")
    options = parser.parse_args(arguments)
    table = figures(not options.rungs_only, options.learn)
    print(printed(table))
    if options.json:
        options.json.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
