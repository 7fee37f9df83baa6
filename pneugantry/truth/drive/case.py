"""Labelled cases of the drive, each from one integer: three logs and what is wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from pneugantry.truth.drive.effects import (
    KNOWN_FORMS,
    OUTSIDE_FORMS,
    Drive,
    DriveForm,
    DriveSpread,
    draw_drive,
)
from pneugantry.truth.drive.plant import CHANNELS, PERIOD, ROUNDING, SIGMA, read, simulate

ROWS = 2000  # of a log, 4 s
COMMAND_ROUNDING = 1e-3  # V
LOGS = ("steps", "tones", "swings")
COUNTS = {  # kind of case: effects of the catalogue, effects that no catalogue lists
    "none": (0, 0),
    "one": (1, 0),
    "two": (2, 0),
    "three": (3, 0),
    "unknown": (0, 1),
    "both": (1, 1),
}
MIXTURE = {"none": 0.25, "one": 0.35, "two": 0.2, "unknown": 0.2}
LEAST_VISIBLE = 1.0  # sigma, on the best log and channel
REDRAWS = 6


@dataclass(frozen=True)
class DriveSet:
    """What is drawn for a seed: kinds by share, spreads of a drive without effects, factor on the
    sizes.
    """

    name: str = "drive"
    mixture: Mapping[str, float] = field(default_factory=lambda: dict(MIXTURE))
    spread: DriveSpread = field(default_factory=DriveSpread)
    severity: float = 1.0


@dataclass(frozen=True)
class DriveCause:
    """An effect as drawn."""

    form: DriveForm
    size: float
    seed: int

    def key(self) -> str:
        """effect, or effect/channel of a sensor's."""
        return f"{self.form.effect}/{self.form.channel}" if self.form.channel else self.form.effect


def commands(name: str) -> np.ndarray:
    """Voltage of each row of a log [V]; the same for every drive."""
    time = np.arange(ROWS) * PERIOD
    if name == "steps":
        levels = np.array([0.0, 6.0, -5.0, 3.0, 8.0, 0.0, -7.0, -3.0, 5.0, 0.0])
        return levels[(time / 0.4).astype(int)]
    rng = np.random.default_rng({"tones": 1, "swings": 2}[name])
    tones = np.geomspace(0.8, 28.0, 14) if name == "tones" else np.geomspace(0.5, 20.0, 9)
    phases = rng.uniform(0.0, 2 * np.pi, len(tones))
    waves = np.sin(2 * np.pi * np.outer(time, tones) + phases).sum(axis=1)
    slow = 3.0 * np.sign(np.sin(2 * np.pi * 0.6 * time)) if name == "swings" else 2.0
    u = 4.0 * waves / np.sqrt(len(tones)) + slow
    u[: round(0.1 / PERIOD)] = 0.0
    return np.round(np.clip(u, -12.0, 12.0) / COMMAND_ROUNDING) * COMMAND_ROUNDING


def record(drive: Drive, name: str, noise: np.ndarray) -> np.ndarray:
    """Readings of a log, shape (ROWS, 3); noise: standard normal of that shape."""
    true, rotor = simulate(drive.plant[0], commands(name))
    return read(drive.sensor, true, rotor, noise)


def applied(drive: Drive, causes: list[DriveCause]) -> Drive:
    """The drive with all causes."""
    for cause in causes:
        drive, _ = cause.form.apply(drive, cause.size, cause.seed)
    return drive


def draw_drive_case(
    seed: int, case_set: DriveSet | None = None, kind: str = ""
) -> tuple[dict[str, pd.DataFrame], dict]:
    """(logs by name, label) of a seed; `kind` fixes which. A cause that hardly shows is redrawn
    larger; the label has the size that ran.
    """
    chosen = DriveSet() if case_set is None else case_set
    rng = np.random.default_rng([seed, 11])
    drawn_kind = str(rng.choice(list(chosen.mixture), p=list(chosen.mixture.values())))
    kind = kind or drawn_kind
    drive, off = draw_drive(np.random.default_rng([seed, 12]), chosen.spread)
    causes = _draw_causes(rng, kind, chosen.severity)
    noise = {
        name: np.random.default_rng([seed, 13, j]).standard_normal((ROWS, 3))
        for j, name in enumerate(LOGS)
    }
    seen: list[float] = []
    for _ in range(REDRAWS):
        readings = {name: record(applied(drive, causes), name, noise[name]) for name in LOGS}
        seen = [_visible(drive, causes, j, readings, noise) for j in range(len(causes))]
        if min(seen, default=np.inf) >= LEAST_VISIBLE:
            break
        for j, shows in enumerate(seen):
            if shows < LEAST_VISIBLE:
                form, size = causes[j].form, causes[j].size
                causes[j] = DriveCause(form, _size(rng, size, max(form.high, size)), causes[j].seed)
    return {name: _frame(name, values) for name, values in readings.items()}, {
        "set": chosen.name,
        "plant": "drive",
        "seed": seed,
        "kind": kind,
        "causes": [_entry(drive, c, s) for c, s in zip(causes, seen, strict=True)],
        "tolerance": off,
        "visibility": min(seen, default=0.0),
    }


def _draw_causes(rng: np.random.Generator, kind: str, severity: float) -> list[DriveCause]:
    causes = []
    for count, pool in zip(COUNTS[kind], (KNOWN_FORMS, OUTSIDE_FORMS), strict=True):
        for j in rng.choice(len(pool), size=count, replace=False):
            form = pool[int(j)]
            size = severity * _size(rng, form.low, form.high)
            causes.append(DriveCause(form, size, int(rng.integers(2**31))))
    return causes


def _size(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _visible(
    drive: Drive,
    causes: list[DriveCause],
    j: int,
    readings: Mapping[str, np.ndarray],
    noise: Mapping[str, np.ndarray],
) -> float:
    """Change that cause j makes, in sigma, RMS of the best log and channel."""
    without = applied(drive, causes[:j] + causes[j + 1 :])
    changes = [(readings[name] - record(without, name, noise[name])) / SIGMA for name in LOGS]
    return float(max(np.sqrt(np.mean(change**2, axis=0)).max() for change in changes))


def _frame(name: str, readings: np.ndarray) -> pd.DataFrame:
    """The log as the rig's computer stores it."""
    columns = {"time": np.round(np.arange(ROWS) * PERIOD, 6), "u": commands(name)}
    for channel, values, grid in zip(CHANNELS, readings.T, ROUNDING, strict=True):
        columns[channel] = np.round(np.round(values / grid) * grid, 6)
    return pd.DataFrame(columns)


def _entry(drive: Drive, cause: DriveCause, visibility: float) -> dict:
    """The cause as a label lists it; what a sensor is known to do is named as a diagnosis does."""
    form = cause.form
    of_sensor = bool(form.known and form.channel)
    return {
        "effect": f"sensor_{form.effect}({form.channel})" if of_sensor else form.effect,
        "axis": "" if of_sensor else form.channel,
        "known": form.known,
        "block": form.block,
        "blocks": [form.block],
        "form": form.way,
        "size": cause.size,
        "unit": form.unit,
        "parameters": form.apply(drive, cause.size, cause.seed)[1],
        "regressors": list(form.regressors),
        "formula": form.formula,
        "visibility": visibility,
    }
