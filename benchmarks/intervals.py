"""Do the 95 % intervals of `pneugantry diagnose` hold the truth? `python -m benchmarks.intervals
[--first SEED] [--count N]`.

Rigs of the set `nuisance` without any effect, and those with one whose parameter is one of the
model's, drawn from the independent truth plant. Of each, all that is fitted and that the truth
plant has as well, as far as the logs tell it: where the interval of the evidence as it stands holds
the truth, and where that of evidence by its share does (`Fit.tempered`), as answers have it.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.identify_coverage import truth_values
from pneugantry.api.diagnosis import Diagnosis, diagnose
from pneugantry.blind.score import key
from pneugantry.blind.sets import SETS
from pneugantry.engine.answer.result import NORMAL
from pneugantry.engine.fitting.fit import Fit
from pneugantry.truth.campaign import write
from pneugantry.truth.case import CaseSet, run_case
from pneugantry.truth.parameters import CHANNELS, Rig

__all__ = ["Held", "held", "main", "truth_of"]

FIRST = 90100  # a development seed
TOLD = 0.5  # share of its prior's spread below which logs tell a parameter
SCALED = {  # effect -> parameter that its factor is of
    "pressure_gain": "sensors.f_a{}.scale",
    "force_gain": "sensors.f_{}.scale",
    "contact_stiffness": "contact.K_c",
    "valve_gain": "valve_{}.K",
    "viscous_level": "axis_{}.C",
}
Held = tuple[str, bool, bool, bool]  # parameter, of an effect, held by all evidence, by its share


def truth_of(rig: Rig, cause: Mapping[str, object] | None = None) -> dict[str, float]:
    """The FMU's parameters of a truth rig with a cause, as a label has it."""
    sensors = rig.sensor.ravel()
    values = truth_values(rig)
    for k, name in enumerate(CHANNELS):
        values[f"sensors.{name}.scale"] = float(sensors["gain"][k])
        values[f"sensors.{name}.bias"] = float(sensors["bias"][k])
    if cause is not None:
        size = cause["parameters"]
        assert isinstance(size, dict)
        values[SCALED[str(cause["effect"])].format(cause["axis"])] *= size["factor"]
    return values


def held(fit: Fit, temper: float, truth: Mapping[str, float]) -> Iterator[Held]:
    """Of each parameter that the logs tell."""
    by_share = fit.tempered(temper)
    for c, theta in zip(fit.point.coordinates, fit.point.theta, strict=True):
        if c.record is None and c.parameter in truth and fit.sigma(c.name) < TOLD * c.spread:
            off = abs(c.theta(truth[c.parameter]) - float(theta)) / NORMAL
            yield c.parameter, bool(c.effect), off < fit.sigma(c.name), off < by_share.sigma(c.name)


def _of_rig(seed: int) -> list[Held]:
    """None of a rig with another effect, or that is answered otherwise."""
    case_set = SETS["nuisance"]
    assert isinstance(case_set, CaseSet)
    case = case_set.plan(seed, "")
    if len(case.causes) > 1 or any(c.form.effect not in SCALED for c in case.causes):
        return []
    campaign, label = run_case(case)
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), campaign)
        found = diagnose(folder)
    causes = label["causes"]
    if not _right(found, causes):
        return []
    truth = truth_of(case.rig, causes[0] if causes else None)
    return list(held(found.found.decision.best, found.found.task.chances.temper, truth))


def _right(found: Diagnosis, causes: Sequence[Mapping[str, str]]) -> bool:
    return set(found.found.decision.best.keys) == {key(c) for c in causes}


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints how many hold the truth, of each parameter and of all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.intervals")
    parser.add_argument("--first", type=int, default=FIRST, metavar="SEED", help="first seed")
    parser.add_argument("--count", type=int, default=40, metavar="N", help="number of rigs")
    options = parser.parse_args(arguments)
    rows: list[Held] = []
    rigs = 0
    for seed in range(options.first, options.first + options.count):
        own = _of_rig(seed)
        rows, rigs = rows + own, rigs + bool(own)
        for name, _, plain, share in (r for r in own if r[1]):
            print(f"{seed} effect {name}: {plain} {share}", flush=True)
    for name in sorted({r[0] for r in rows}):
        _print(name, [r for r in rows if r[0] == name])
    _print(f"all of {rigs} rigs", rows)
    return 0


def _print(name: str, rows: Sequence[Held]) -> None:
    plain, share = (np.mean([r[k] for r in rows]) if rows else np.nan for k in (2, 3))
    print(f"{name}: {len(rows)} intervals, {plain:.3f} hold the truth, by their share {share:.3f}")


if __name__ == "__main__":
    raise SystemExit(main())
