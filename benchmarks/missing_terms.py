"""Missing terms of a motor, learnt from logs that scipy integrates: `python -m
benchmarks.missing_terms [KIND ...] [--seeds N]`.

Each rig has one term that neither model nor catalogue holds, at a size and a place drawn from its
seed, beside tolerance in every parameter; "both" has a known effect as well, "sound" has nothing.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from pneugantry.api.diagnosis import diagnose

__all__ = ["KINDS", "Kind", "main", "rig"]

ROOT = Path(__file__).resolve().parents[1] / "examples" / "motor"
PERIOD, LENGTH, NOISE = 5e-3, 6.0, 0.02  # s, s, rad/s RMS
J, K_T, B = 0.02, 0.5, 0.02  # data sheet: kg m2, N m/A, N m s/rad
OFF = 0.02  # RMS by which a rig's parameters differ from it, relative
Term = Callable[[float, float, float, float], float]  # torque of time, angle, speed, current


@dataclass(frozen=True)
class Kind:
    """A missing term: its usual size, the variable and the form that name it, and its torque."""

    size: float
    regressor: str
    form: str
    torque: Callable[[float], Term]  # of the size


KINDS = {
    "drag": Kind(-2e-3, "w", "signed square", lambda c: lambda t, phi, w, i: c * w * abs(w)),
    "cubic_drag": Kind(-6e-5, "w", "cube", lambda c: lambda t, phi, w, i: c * w**3),
    "fading_friction": Kind(
        -0.2,
        "w",
        "fading sign",
        lambda c: lambda t, phi, w, i: c * np.tanh(w / 0.05) / (1 + abs(w) / 2.0),
    ),
    "saturation": Kind(-0.03, "i", "cube", lambda c: lambda t, phi, w, i: c * i**3),
    "tight_spot": Kind(
        0.08, "phi", "bump", lambda c: lambda t, phi, w, i: c * np.exp(-(((phi - 8) / 3) ** 2))
    ),
    "vibration": Kind(
        0.05, "time", "sine", lambda c: lambda t, phi, w, i: c * np.sin(27.0 * t + 0.7)
    ),
    "cogging": Kind(
        0.08, "phi", "sine", lambda c: lambda t, phi, w, i: c * np.sin(7.0 * phi + 0.4)
    ),
    "both": Kind(
        -2e-3,
        "w",
        "signed square",
        lambda c: lambda t, phi, w, i: c * w * abs(w) - 0.15 * np.tanh(w / 0.02),
    ),
    "sound": Kind(0.0, "", "", lambda c: lambda t, phi, w, i: 0.0),
}


def _current(log: str, t: float) -> float:
    """A."""
    if log == "steps":
        return (1.5, -1.2, 0.9, -1.6)[int(t / 1.5) % 4]
    if log == "slow":
        return 2.2 * float(np.sin(0.9 * t) + 0.4 * np.sin(3.1 * t + 0.5))
    return 1.4 * float(np.sin(2.0 * t) + 0.5 * np.sin(5.3 * t + 1.0))


def rig(folder: Path, kind: Kind, seed: int) -> tuple[Path, float]:
    """Writes a rig's logs and description; returns its path and the term's size."""
    rng = np.random.default_rng(seed)
    size = kind.size * 2.0 ** rng.uniform(-1.0, 1.0)
    inertia, gain, viscous = np.array([J, K_T, B]) * (1 + OFF * rng.standard_normal(3))
    torque = kind.torque(size)
    for log in ("sines", "slow", "steps"):
        time = np.arange(0.0, LENGTH, PERIOD)
        held = np.array([round(_current(log, t), 3) for t in time])
        state, speeds = np.zeros(2), []
        for t, i in zip(time, held, strict=True):
            speeds.append(state[1])

            def rates(t: float, y: Any, i: float = i) -> list[float]:
                return [y[1], (gain * i - viscous * y[1] + torque(t, y[0], y[1], i)) / inertia]

            end = solve_ivp(rates, (t, t + PERIOD), state, "LSODA", rtol=1e-8, atol=1e-10)
            state = end.y[:, -1]
        noisy = np.array(speeds) + NOISE * rng.standard_normal(len(time))
        table = pd.DataFrame({"time": time.round(6), "i": held, "w": noisy.round(4)})
        table.to_csv(folder / f"{log}.csv", index=False)
    shutil.copy(ROOT / "Motor.mo", folder)
    shutil.copytree(ROOT / "effects", folder / "effects", dirs_exist_ok=True)
    text = (ROOT / "plant.toml").read_text(encoding="utf-8").replace("data/", "")
    path = folder / "plant.toml"
    path.write_text(f'{text}\n[log.slow]\nfile = "slow.csv"\n', encoding="utf-8")
    return path, size


def _row(name: str, seed: int) -> dict[str, Any]:
    """One rig, diagnosed and judged."""
    kind = KINDS[name]
    with tempfile.TemporaryDirectory() as folder:
        path, size = rig(Path(folder), kind, seed)
        found = diagnose(path).json
    learned: dict[str, Any] = found.get("learned") or {}
    term: dict[str, Any] | None = learned["term"] if learned.get("accepted") else None
    row: dict[str, Any] = {"kind": name, "seed": seed, "verdict": found["verdict"]}
    if not term:
        return row | {"term": "located only" if learned else ""}
    first = next(iter(term["parameters"].values()))
    named = [t["regressor"] for t in learned["answer_set"]]
    gap = learned["gap"]
    return row | {
        "term": term["formula"],
        "regressor": term["regressor"] == kind.regressor,
        "in_set": kind.regressor in named,
        "form": term["form"] == kind.form,
        "within": term["form"] == kind.form
        and min(map(abs, first["ci95"])) <= abs(size) <= max(map(abs, first["ci95"])),
        "shrink": gap["shrink"] if gap else None,
        "size": size,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a row for each rig, and how many are right."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.missing_terms")
    parser.add_argument("kinds", nargs="*", choices=[*KINDS, []], default=[])
    parser.add_argument("--seeds", type=int, default=1)
    options = parser.parse_args(arguments)
    rows = []
    for name in options.kinds or KINDS:
        for seed in range(options.seeds):
            rows.append(_row(name, seed))
            print({k: v for k, v in rows[-1].items() if v not in (None, "")}, flush=True)
    faulty = [r for r in rows if r["kind"] != "sound"]
    for what in ("regressor", "in_set", "form", "within"):
        print(f"{what}: {sum(bool(r.get(what)) for r in faulty)} of {len(faulty)}")
    sound = [r for r in rows if r["kind"] == "sound"]
    print(f"sound rigs without a term: {sum(not r['term'] for r in sound)} of {len(sound)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
