"""Which effect came, of two campaigns of one rig: `python -m benchmarks.two_campaigns
[--plant motor|drive|gantry] [--rigs N] [--seed S] [--alone]`.

Each seed is an ordinary rig of the motor (`examples/motor`), the drive (`examples/drive`) or the
gantry: parameters off by their tolerance, noise of its own, simulated by a program that shares
nothing with the model, with effects of the catalogue at sizes that are drawn. What becomes of them
goes through the kinds in turn. A rig is right where exactly the effects that are there are told,
each with what became of it. --alone: what each campaign by itself gets, too.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd

from pneugantry.api.diagnosis import diagnose, diagnose_change
from pneugantry.blind.description import relocated
from pneugantry.blind.drive import DESCRIPTION as DRIVE
from pneugantry.truth.campaign import generate
from pneugantry.truth.campaign import write as write_campaign
from pneugantry.truth.drive.case import LOGS, ROWS, DriveCause, applied, commands, record
from pneugantry.truth.drive.effects import KNOWN_FORMS, Drive, DriveSpread, draw_drive
from pneugantry.truth.drive.plant import CHANNELS, PERIOD, ROUNDING, SIGMA
from pneugantry.truth.effects import draw_cause
from pneugantry.truth.form import Cause
from pneugantry.truth.nuisance import NUISANCE, draw_rig, tolerated_size
from pneugantry.truth.setups import campaign_setups

__all__ = [
    "KINDS",
    "TORQUES",
    "DriveRig",
    "MotorRig",
    "Pair",
    "main",
    "motor_log",
    "pair_of",
    "written",
]

MOTOR = DRIVE.parents[1] / "motor" / "plant.toml"
GROWN = 1.8  # times the size before, of an effect that has changed
VISIBLE = 2.0  # sigma, change that an effect makes, RMS of its best log and channel
REDRAWS = 40
KINDS: dict[str, tuple[str, ...]] = {  # what becomes of each drawn effect
    "sound": (),
    "came": ("came",),
    "went": ("went",),
    "stayed": ("stayed",),
    "changed": ("changed",),
    "came beside one that stayed": ("stayed", "came"),
    "one for another": ("went", "came"),
}
Sizes = Mapping[str, float]  # effect by the catalogue's key -> size
Frames = dict[str, pd.DataFrame]


class RigUnderTest(Protocol):
    """A rig without effects."""

    def draw(self, rng: np.random.Generator, taken: Sequence[str]) -> tuple[str, float]:
        """An effect that shows and is none of those taken, with its size."""
        ...

    def write(self, folder: Path, sizes: Sizes, luck: np.random.Generator) -> Path:
        """A campaign with these effects, as `pneugantry diagnose` takes it."""
        ...


def _described(folder: Path, frames: Frames, description: Path) -> Path:
    """Logs, and the description of an example for them."""
    for name, frame in frames.items():
        frame.to_csv(folder / f"{name}.csv", index=False)
    path = folder / "plant.toml"
    path.write_text(relocated(description, folder), encoding="utf-8")
    return path


# ---- the motor


def motor_log(log: str, rig: Mapping[str, float], noise: np.ndarray) -> pd.DataFrame:
    """time [s], i [A], w [rad/s] of a motor with smooth Coulomb friction, each 5 ms, as many rows
    as noise [rad/s] has. rig: J, k_t, b, tau_c, tau_o, tau_g as in `Motor.mo`.
    """
    period, parts, phi, w = 5e-3, 5, 0.0, 0.0
    at = np.arange(len(noise)) * period
    if log == "sines":
        held = 1.4 * (np.sin(2.0 * at) + 0.5 * np.sin(5.3 * at + 1.0))
    else:
        held = np.array([1.5, -1.2, 0.9, -1.6])[(at / 1.3).astype(int) % 4]
    h, speeds = period / parts, []

    def rate(phi: float, w: float, i: float) -> float:
        load = rig["b"] * w + rig["tau_c"] * math.tanh(w / 0.02) + rig["tau_g"] * math.sin(phi)
        return (rig["k_t"] * i - load + rig["tau_o"]) / rig["J"]

    for i in held.tolist():
        speeds.append(w)
        for _ in range(parts):
            a = rate(phi, w, i)
            b = rate(phi + h / 2 * w, w + h / 2 * a, i)
            c = rate(phi + h / 2 * (w + h / 2 * a), w + h / 2 * b, i)
            d = rate(phi + h * (w + h / 2 * b), w + h * c, i)
            phi += h * w + h * h / 6 * (a + b + c)
            w += h / 6 * (a + 2 * b + 2 * c + d)
    return pd.DataFrame({"time": at, "i": held, "w": np.array(speeds) + noise})


GANTRY_LOGS = ("valve_steps_500", "free_motion", "contact_steps", "contour_straight")
GANTRY_EFFECTS = (
    ("valve_delay", "z"),
    ("coulomb_level", "x"),
    ("presliding", "z"),
    ("payload_mass", "z"),
)
TORQUES = {  # effect of the motor: parameter, smallest and largest size [N m]
    "coulomb_friction": ("tau_c", 0.05, 0.3),
    "constant_torque": ("tau_o", 0.03, 0.2),
    "unbalance": ("tau_g", 0.05, 0.3),
}


class MotorRig:
    """The tutorial's motor; parameters off by shares of their tolerance."""

    def __init__(self, seed: int) -> None:
        off = np.random.default_rng([seed, 32]).standard_normal(3) * (0.03, 0.02, 0.10)
        self.off = dict(zip(("J", "k_t", "b"), (0.02, 0.5, 0.02) * (1 + off), strict=True))

    def draw(self, rng: np.random.Generator, taken: Sequence[str]) -> tuple[str, float]:
        name = str(rng.choice([e for e in TORQUES if e not in taken]))
        _, low, high = TORQUES[name]
        return name, float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def write(self, folder: Path, sizes: Sizes, luck: np.random.Generator) -> Path:
        rig = {**self.off, "tau_c": 0.0, "tau_o": 0.0, "tau_g": 0.0}
        rig |= {TORQUES[effect][0]: size for effect, size in sizes.items()}
        logs = ("sines", "steps")
        frames = {log: motor_log(log, rig, 0.02 * luck.standard_normal(1000)) for log in logs}
        return _described(folder, frames, MOTOR)


# ---- the drive


class DriveRig:
    """The tutorial's drive with an elastic joint, as the blind check draws it."""

    def __init__(self, seed: int) -> None:
        self.drive, _ = draw_drive(np.random.default_rng([seed, 32]), DriveSpread())
        self._causes: dict[str, DriveCause] = {}

    def draw(self, rng: np.random.Generator, taken: Sequence[str]) -> tuple[str, float]:
        for _ in range(REDRAWS):
            form = KNOWN_FORMS[int(rng.integers(len(KNOWN_FORMS)))]
            size = float(np.exp(rng.uniform(np.log(form.low), np.log(form.high))))
            cause = DriveCause(form, size, int(rng.integers(2**31)))
            if cause.key() not in taken and _shows(self.drive, cause):
                self._causes[cause.key()] = cause
                return cause.key(), size
        raise RuntimeError("no effect of the catalogue shows on this drive")

    def write(self, folder: Path, sizes: Sizes, luck: np.random.Generator) -> Path:
        drive = applied(self.drive, [replace(self._causes[k], size=s) for k, s in sizes.items()])
        found = {}
        for name in LOGS:
            readings = record(drive, name, luck.standard_normal((ROWS, len(CHANNELS))))
            columns = {"time": np.round(np.arange(ROWS) * PERIOD, 6), "u": commands(name)}
            for channel, values, grid in zip(CHANNELS, readings.T, ROUNDING, strict=True):
                columns[channel] = np.round(np.round(values / grid) * grid, 6)
            found[name] = pd.DataFrame(columns)
        return _described(folder, found, DRIVE)


def _shows(drive: Drive, cause: DriveCause) -> bool:
    still = np.zeros((ROWS, len(CHANNELS)))
    changes = [
        (record(applied(drive, [cause]), n, still) - record(drive, n, still)) / SIGMA for n in LOGS
    ]
    return max(float(np.sqrt(np.mean(c**2, axis=0)).max()) for c in changes) >= VISIBLE


# ---- the gantry


class GantryRig:
    """An ordinary gantry of the truth plant, with four of the campaign's logs."""

    def __init__(self, seed: int) -> None:
        self.drawn = draw_rig(np.random.default_rng([seed, 32]), seed, NUISANCE)
        self.setups = {n: s for n, s in campaign_setups().items() if n in GANTRY_LOGS}
        self._causes: dict[str, Cause] = {}

    def draw(self, rng: np.random.Generator, taken: Sequence[str]) -> tuple[str, float]:
        left = [n for n in GANTRY_EFFECTS if "/".join(n) not in taken]
        effect, axis = left[int(rng.integers(len(left)))]
        cause = draw_cause(rng, effect, axis)
        key, size = f"{effect}/{axis}", max(cause.size, tolerated_size(cause.form, NUISANCE))
        self._causes[key] = replace(cause, size=size)
        return key, size

    def write(self, folder: Path, sizes: Sizes, luck: np.random.Generator) -> Path:
        rig, off = self.drawn.rig, self.drawn.standoff
        for key, size in sizes.items():
            rig, _ = replace(self._causes[key], size=size).apply(rig)
        true = {n: replace(s, standoff=s.standoff + off) for n, s in self.setups.items()}
        write_campaign(folder, generate(rig, int(luck.integers(2**31)), true), self.setups)
        return folder


PLANTS: dict[str, type[MotorRig] | type[DriveRig] | type[GantryRig]] = {
    "motor": MotorRig,
    "drive": DriveRig,
    "gantry": GantryRig,
}


# ---- pairs of campaigns


@dataclass(frozen=True, eq=False)
class Pair:
    """Two campaigns of a rig: effects before and after, and what became of each."""

    seed: int
    kind: str
    rig: RigUnderTest
    before: Sizes
    after: Sizes
    became: Mapping[str, str]


def pair_of(plant: str, seed: int, kind: str) -> Pair:
    """The pair of a seed."""
    rng, rig = np.random.default_rng([seed, 31]), PLANTS[plant](seed)
    before: dict[str, float] = {}
    after: dict[str, float] = {}
    became: dict[str, str] = {}
    for what in KINDS[kind]:
        effect, size = rig.draw(rng, list(became))
        became[effect] = what
        if what != "came":
            before[effect] = size
        if what != "went":
            after[effect] = size * (GROWN if what == "changed" else 1.0)
    return Pair(seed, kind, rig, before, after, became)


def written(folder: Path, pair: Pair) -> tuple[Path, Path]:
    """Both campaigns, each in a folder of its own."""
    paths = []
    for turn, sizes in enumerate((pair.before, pair.after)):
        out = folder / ("before", "after")[turn]
        out.mkdir(parents=True)
        paths.append(pair.rig.write(out, sizes, np.random.default_rng([pair.seed, 33 + turn])))
    return paths[0], paths[1]


def told(found: Mapping[str, Any]) -> dict[str, str]:
    """What became of each effect that is likelier there than not."""
    return {
        _key(e): e["what"]
        for e in found["changes"]["effects"]
        if e["probabilities"]["absent"] < 0.5
    }


def _key(entry: Mapping[str, Any]) -> str:
    return f"{entry['effect']}/{entry['axis']}" if entry["axis"] else entry["effect"]


def judged(pair: Pair, alone: bool) -> dict[str, Any]:
    """One pair, diagnosed; alone: each of its campaigns, too."""
    with tempfile.TemporaryDirectory() as folder:
        paths = written(Path(folder), pair)
        began = time.process_time()
        found = diagnose_change(*paths).json
        row = {
            "seed": pair.seed,
            "kind": pair.kind,
            "truth": dict(pair.became),
            "told": told(found),
            "verdict": found["verdict"],
            "cpu_s": time.process_time() - began,
        }
        row["effects"] = set(row["told"]) == set(pair.became)
        row["right"] = row["told"] == pair.became and found["verdict"] != "unknown"
        for sizes, path in zip((pair.before, pair.after), paths if alone else (), strict=alone):
            by_itself = diagnose(path).json
            likely = {_key(c) for c in by_itself["causes"] if c["probability"] > 0.5}
            right = likely == set(sizes) and by_itself["verdict"] != "unknown"
            row[f"{path.relative_to(folder).parts[0]}_alone"] = right
    return row


def _table(rows: Sequence[Mapping[str, Any]]) -> None:
    alone = [n for n in ("before_alone", "after_alone") if n in rows[0]]
    columns = ("effects", "right", *alone)
    print("\n| kind | rigs | effects right | all right |", *(f" {n} |" for n in alone), sep="")
    print("|---" * (2 + len(columns)) + "|")
    for kind in [*dict.fromkeys(r["kind"] for r in rows), ""]:
        own = [r for r in rows if kind in ("", r["kind"])]
        counts = " | ".join(str(sum(r[c] for r in own)) for c in columns)
        print(f"| {kind or 'all'} | {len(own)} | {counts} |")
    print(f"median CPU s of a pair: {np.median([r['cpu_s'] for r in rows]):.1f}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints one line a rig and a table by kind."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.two_campaigns", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--plant", choices=list(PLANTS), default="motor")
    parser.add_argument("--rigs", type=int, default=14, metavar="N", help="pairs of campaigns")
    parser.add_argument("--seed", type=int, default=91000, metavar="S", help="first seed")
    parser.add_argument("--alone", action="store_true", help="each campaign by itself, too")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the lines to this file")
    options = parser.parse_args(arguments)
    rows, kinds = [], list(KINDS)
    for k in range(options.rigs):
        pair = pair_of(options.plant, options.seed + k, kinds[k % len(kinds)])
        rows.append(judged(pair, options.alone))
        row = rows[-1]
        said = f"{'right' if row['right'] else 'WRONG'}, {row['verdict']}"
        print(f"{row['seed']} {row['kind']}: {said}; truth {row['truth']}, told {row['told']}")
    _table(rows)
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
