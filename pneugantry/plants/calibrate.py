"""Probabilities for a plant of one's own: rigs are drawn from its model, diagnosed, and the weights
of the decision fitted to them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.calibration.draws import Source, drawn
from pneugantry.engine.calibration.weights import Calibration, Known, calibrated, known_case
from pneugantry.engine.chances import Chances
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import run
from pneugantry.engine.task import Task
from pneugantry.plants.described import described_task

__all__ = ["KEPT", "LEAST", "Rigs", "calibration_of"]

LEAST = 10  # rigs of a calibration
KEPT = ("verdict", "weighed", "stands_out", "stood_out", "doubtful", "seconds")


@dataclass(frozen=True)
class Rigs:
    """Reads a plant once in a worker, then draws and diagnoses rig by rig."""

    plant: Path
    catalogue: Path | None = None

    def __call__(self) -> Callable[[int], dict[str, Any]]:
        found, task = described_task(self.plant, self.catalogue)
        defaults = {k: v for view in task.views for k, v in view.defaults.items()}
        source = Source(task.plant, task.data, task.catalogue, defaults, task.cache)
        return partial(_rig, source, task, found.rules)


def _rig(source: Source, task: Task, rules: Rules, seed: int) -> dict[str, Any]:
    """Truth and diagnosis of the rig of a seed."""
    rig = drawn(source, seed)
    found = run(replace(task, data=rig.data, chances=Chances()), rules)
    said = to_json(found.diagnosis)
    causes = [{"effect": key, "axis": "", "known": True} for key in rig.effects]
    return {
        "seed": seed,
        "truth": {"kind": rig.kind, "causes": causes, "what": rig.what},
        "answer": {k: said[k] for k in KEPT},
    }


def calibration_of(rigs: Iterable[Mapping[str, Any]]) -> Calibration:
    """Weights from diagnosed rigs. Raises InputError for too few."""
    cases = [_known(r) for r in rigs]
    if len(cases) < LEAST:
        raise InputError(
            f"{len(cases)} rigs were diagnosed, expected >= {LEAST}",
            field="--cases",
            hint="draw more",
        )
    return calibrated(cases, Chances())


def _known(rig: Mapping[str, Any]) -> Known:
    return known_case(rig["truth"], rig["answer"])
