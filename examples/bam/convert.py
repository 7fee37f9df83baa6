"""Logs of the servo as the diagnosis reads them, with errors planted on purpose.

The recorded `load` is a 16-bit number that wraps below 0, averaged across the wrap where the log
was resampled; it is read back as -885..885.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

from examples.bam.servo import HELD_GAINS, log_names, setting
from modelica_fmu.errors import InputError
from pneugantry.blind.description import relocated

Change = Callable[[pd.DataFrame], pd.DataFrame]
PLANT = Path(__file__).parent / "plant.toml"
READINGS = Path(__file__).parent / "readings.toml"  # further signals, beside the position
FULL = 885  # reading of `load` at full duty
EARLIER = 2.5e-3  # s, by which the position of a row is read before `load`: the law leaves least so
PARAMETER = {  # effect: parameter of the model that a wrong value is put into
    "mass": "pendulum.m",
    "arm_length": "pendulum.l",
    "firmware_gain": "firmware.gain",
    "supply_level": "motor.V",
    "friction_level": "gearbox.factor",
}
LARGE = {
    "mass": (0.7, 1.4),
    "arm_length": (0.8, 1.25),
    "firmware_gain": (0.5, 2.0),
    "supply_level": (0.8, 1.25),
    "friction_level": (0.4, 2.5),
}
SMALLER = {"mass": 1.2, "firmware_gain": 1.4, "supply_level": 0.88, "friction_level": 1.7}


@dataclass(frozen=True)
class Left:
    """What a right model leaves of a signal."""

    rms: float  # in the signal's unit
    lasting: float  # s, in which its correlation falls to 1/e


@dataclass(frozen=True)
class Planted:
    """Errors of a nominal plant: by which factor each parameter is wrong. The rig is right, so an
    effect that a diagnosis finds has the inverse factor.
    """

    factors: Mapping[str, float]

    @property
    def name(self) -> str:
        """Folder of the case."""
        told = "+".join(f"{effect}_{factor:g}" for effect, factor in self.factors.items())
        return told or "sound"


def planted_errors() -> list[Planted]:
    """The 24 cases: ten large and four smaller single errors, and every pair of effects once."""
    singles = [Planted({effect: f}) for effect, both in LARGE.items() for f in both]
    singles += [Planted({effect: factor}) for effect, factor in SMALLER.items()]
    pairs = combinations(LARGE, 2)
    return singles + [
        Planted({a: LARGE[a][k % 2], b: LARGE[b][(k // 2) % 2]}) for k, (a, b) in enumerate(pairs)
    ]


def read_raw(folder: Path, name: str) -> pd.DataFrame:
    """A recorded log with `load` unwrapped. Raises InputError naming a missing file or column."""
    file = folder / f"{name}.csv"
    if not file.is_file():
        raise InputError("no such log", file=file, hint="give the folder of the recorded CSV files")
    log = pd.read_csv(file)
    for column in ("time", "position", "goal_position", "torque_enable", "load"):
        if column not in log:
            raise InputError("column is missing", file=file, field=column, hint="take the raw file")
    load = log["load"].where(log["load"] < 2**15, log["load"] - 2**16)
    log["load"] = load.where(load.abs() <= FULL).interpolate(method="nearest").ffill().bfill()
    return log


def aligned(log: pd.DataFrame) -> pd.DataFrame:
    """The log with its position at the instant of the duty, which follows by `EARLIER`."""
    time, position = (log[c].to_numpy(float) for c in ("time", "position"))
    return log.assign(position=np.interp(time + EARLIER, time, position))


def write_logs(raw: Path, out: Path, change: Change = lambda log: log) -> dict[str, pd.DataFrame]:
    """Writes the 16 logs, changed, to `out` and returns them."""
    out.mkdir(parents=True, exist_ok=True)
    logs = {name: change(read_raw(raw, name)) for name in log_names()}
    for name, log in logs.items():
        log.to_csv(out / f"{name}.csv", index=False)
    return logs


def description(
    out: Path, logs: Mapping[str, pd.DataFrame], parameters: Mapping[str, float], folder: str = ""
) -> str:
    """plant.toml for `out`: what is known of the plant, and each log with its gain and start. Logs
    at the gains 200 and 800 are held out.
    """
    lines = [relocated(PLANT, out), "[parameters]"]
    lines += [f'"{name}" = {value!r}' for name, value in parameters.items()]
    for name, log in logs.items():
        use = "held out" if setting(name) in HELD_GAINS else "fit"
        start = float(log["position"].iloc[0])
        lines += [
            "",
            f"[log.{name}]",
            f'file = "{folder}{name}.csv"',
            f'use = "{use}"',
            f'parameters = {{ "firmware.kp" = {setting(name):g}, q_start = {start!r} }}',
        ]
    return "\n".join(lines) + "\n"


def write_planted(
    raw: Path,
    out: Path,
    right: Mapping[str, float],
    left: Mapping[str, Left] | None = None,
    cases: Sequence[Planted] | None = None,
) -> list[Path]:
    """Writes one folder per planted error, beside the logs that all share: plant.toml with the
    wrong values and truth.json, which no diagnosis reads. All that the servo measures is told.
    `right`: parameters of the model that fits; left: what it is known to leave of each signal.
    """
    logs = write_logs(raw, out / "logs", aligned)
    folders = []
    for case in planted_errors() if cases is None else cases:
        folder = out / case.name
        folder.mkdir(parents=True, exist_ok=True)
        wrong = dict(right)
        for effect, factor in case.factors.items():
            wrong[PARAMETER[effect]] = right[PARAMETER[effect]] * factor
        text = (
            description(folder, logs, wrong, "../logs/")
            + "\n"
            + READINGS.read_text(encoding="utf-8")
        )
        for signal, own in (left or {}).items():
            table = f"[outputs.{signal}]\n"
            said = f"error = {own.rms!r}  # the right plant leaves it\nlasting = {own.lasting!r}\n"
            text = text.replace(table, table + said)
        (folder / "plant.toml").write_text(text, encoding="utf-8")
        causes = [
            {
                "effect": effect,
                "axis": "",
                "block": PARAMETER[effect].partition(".")[0],
                "parameter": PARAMETER[effect],
                "factor": 1.0 / factor,
            }
            for effect, factor in case.factors.items()
        ]
        kind = {0: "none", 1: "one", 2: "two"}[len(causes)]
        truth = {"schema": "truth/1", "plant": "servo", "kind": kind, "causes": causes}
        (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
        folders.append(folder)
    return folders
