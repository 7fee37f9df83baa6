"""What Coulomb and viscous friction lack, learnt from four logs of the servo without any catalogue,
beside the rungs of its authors refitted on the same four.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from examples.bam.convert import description, write_logs
from examples.bam.servo import RUNGS, error, published, refitted, setting
from pneugantry.engine.answer.confirm import replays, values_on
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.plant import Plant, Record
from pneugantry.engine.run import Found, run
from pneugantry.learn.answer.result import to_json
from pneugantry.learn.learn import learn
from pneugantry.plants.described import described_task

__all__ = ["figures", "printed", "sets_of"]

Say = Callable[[str], None]
KNOWN_TRAJECTORIES = ("sin_sin", "lift_and_drop")
KNOWN_GAINS = (100, 400)
JUDGE = "sin_time_square_kp200"  # says whether a term is accepted
NAMES = {  # parameter of the model: of the rungs
    "motor.k_t": "k_t",
    "motor.R": "R",
    "armature": "armature",
    "pendulum.q_offset": "q_offset",
    "gearbox.T_c": "T_c",
    "gearbox.d": "d",
}


def sets_of(names: list[str]) -> dict[str, list[str]]:
    """Logs by what of them was fitted."""
    found: dict[str, list[str]] = {"fitted": [], "other gains": [], "other trajectories": []}
    found["both other"] = []
    for name in names:
        trajectory = name.rpartition("_kp")[0] in KNOWN_TRAJECTORIES
        gain = setting(name) in KNOWN_GAINS
        which = "fitted" if gain else "other gains"
        if not trajectory:
            which = "other trajectories" if gain else "both other"
        found[which].append(name)
    return found


def figures(raw: Path, out: Path, say: Say = lambda stage: None) -> dict[str, Any]:
    """RMS position errors [rad] by set of logs, and what was learnt."""
    logs = write_logs(raw, out)
    sets = sets_of(list(logs))
    fitted = {n: logs[n] for n in sets["fitted"]}
    rungs = {r: refitted(published(raw, r), RUNGS[r], fitted) for r in RUNGS}
    table = {
        f"{r} refitted": _by_set(sets, {n: error(v, n, log) for n, log in logs.items()})
        for r, v in rungs.items()
    }
    known = {name: rungs["m1"][own] for name, own in NAMES.items()}
    everything = described_task(_written(out, logs, known, list(logs)))[1].data.fitted
    read, task = described_task(_written(out, logs, known, sets["fitted"]))
    before = run(task, read.rules, say)
    learned = learn(before, read.rules, say)
    table["Coulomb and viscous"] = _errors(before, before.search.null, everything, sets)
    if learned.after is not None:
        best = learned.after.decision.best
        table["with the learnt term"] = _errors(learned.after, best, everything, sets)
    return {
        "errors": table,
        "verdict": before.diagnosis.verdict,
        "learned": to_json(learned),
        "tried": [
            {"cost": t.cost, "formula": t.term.formula(), "equation": t.term.point.text}
            for t in learned.tried[:8]
        ],
    }


def _written(
    out: Path, logs: Mapping[str, pd.DataFrame], known: Mapping[str, float], fitted: list[str]
) -> Path:
    """A description whose catalogue is Coulomb and viscous friction; one log judges."""
    used = {n: logs[n] for n in (*fitted, *(() if JUDGE in fitted else (JUDGE,)))}
    text = description(out, used, known).replace('bam/effects"', 'bam/basic.toml"')
    for name in used:
        head, use = f'[log.{name}]\nfile = "{name}.csv"\nuse = ', "fit" if name in fitted else ""
        for given in ("fit", "held out"):
            text = text.replace(f'{head}"{given}"', f'{head}"{use or "held out"}"')
    path = out / ("all.toml" if len(fitted) == len(logs) else "learnt.toml")
    path.write_text(text, encoding="utf-8")
    return path


def _errors(
    found: Found, fit: Fit, records: tuple[Record, ...], sets: Mapping[str, list[str]]
) -> dict[str, float]:
    plant, cache = found.task.plant, found.task.cache
    return _by_set(sets, {r.name: _error(plant, r, fit, cache) for r in records})


def _error(plant: Plant, record: Record, fit: Fit, cache: Path) -> float:
    made = replays(plant, record, [values_on(fit, record)], cache)[0]
    if made is None:
        return float("nan")
    return float(np.sqrt(np.mean((made.measured[:, 0] - made.simulated[:, 0]) ** 2)))


def _by_set(sets: Mapping[str, list[str]], errors: Mapping[str, float]) -> dict[str, float]:
    return {
        which: float(np.sqrt(np.mean([errors[n] ** 2 for n in names])))
        for which, names in sets.items()
    }


def printed(table: Mapping[str, Any]) -> str:
    """As Markdown."""
    errors = table["errors"]
    heads = list(next(iter(errors.values())))
    lines = ["RMS position error, rad:", "", "| model | " + " | ".join(heads) + " |"]
    lines.append("|---" * (len(heads) + 1) + "|")
    for name, row in errors.items():
        lines.append(f"| {name} | " + " | ".join(f"{row[h]:.4f}" for h in heads) + " |")
    learned = table["learned"]
    lines += ["", f"verdict before: {table['verdict']}", learned["sentence"]]
    lines += [f"beside it: {c['effect']}" for c in learned["causes"]]
    lines += [f"- {t['cost']:.0f}: {t['formula']} in {t['equation']}" for t in table["tried"]]
    return "\n".join(lines)
