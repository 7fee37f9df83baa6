"""Missing terms of a motor, learnt from simulated logs: `python -m
benchmarks.missing_terms [KIND ...] [--seeds N]`.

Each rig has one term that neither model nor catalogue holds, at a size drawn from its seed, beside
tolerance in every parameter; "KNOWN+KIND" has an effect of the catalogue as well. "sound" has
nothing and is searched for a term all the same.
"""

from __future__ import annotations

import argparse
import math
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pneugantry.engine.run import run
from pneugantry.learn.answer.result import to_json
from pneugantry.learn.learn import learn
from pneugantry.learn.learned import Learned
from pneugantry.learn.wanted import wanted
from pneugantry.plants.described import described_task

__all__ = ["KINDS", "Kind", "main", "print_sums", "rig"]

ROOT = Path(__file__).resolve().parents[1] / "examples" / "motor"
PERIOD, LENGTH, NOISE = 5e-3, 6.0, 0.02  # s, s, rad/s RMS
J, K_T, B = 0.02, 0.5, 0.02  # data sheet: kg m2, N m/A, N m s/rad
OFF = 0.02  # RMS by which a rig's parameters differ from it, relative
PARTS = 10  # integration steps of a row
Array = NDArray[np.float64]
Rates = Callable[[float, float, float, float], tuple[float, float]]
Term = Callable[[float, float, float, float], float]  # torque of time, angle, speed, current


@dataclass(frozen=True)
class Kind:
    """A missing term: its usual size, the variable and the form that name it, and its torque of a
    size; and the effect of the catalogue that is at work beside it.
    """

    size: float
    regressor: str
    form: str
    torque: Callable[[float], Term]
    known: str = ""


def _drag(c: float) -> Term:
    return lambda t, phi, w, i: c * w * abs(w)


def _cubic(c: float) -> Term:
    return lambda t, phi, w, i: c * w**3


def _fading(c: float) -> Term:
    return lambda t, phi, w, i: c * math.tanh(w / 0.05) / (1 + abs(w) / 2.0)


def _saturation(c: float) -> Term:
    return lambda t, phi, w, i: c * i**3


def _tight(c: float) -> Term:
    return lambda t, phi, w, i: c * math.exp(-(((phi - 8) / 3) ** 2))


def _vibration(c: float) -> Term:
    return lambda t, phi, w, i: c * math.sin(27.0 * t + 0.7)


def _cogging(c: float) -> Term:
    return lambda t, phi, w, i: c * math.sin(7.0 * phi + 0.4)


MISSING = {
    "drag": Kind(-2e-3, "w", "signed square", _drag),
    "cubic_drag": Kind(-6e-5, "w", "cube", _cubic),
    "fading_friction": Kind(-0.2, "w", "fading sign", _fading),
    "saturation": Kind(-0.03, "i", "cube", _saturation),
    "tight_spot": Kind(0.08, "phi", "bump", _tight),
    "vibration": Kind(0.05, "time", "sine", _vibration),
    "cogging": Kind(0.08, "phi", "sine", _cogging),
}
KNOWN: dict[str, Term] = {
    "coulomb_friction": lambda t, phi, w, i: -0.15 * math.tanh(w / 0.02),
    "unbalance": lambda t, phi, w, i: -0.15 * math.sin(phi),
    "constant_torque": lambda t, phi, w, i: 0.1,
}
PAIRS = (
    ("coulomb_friction", "drag"),
    ("coulomb_friction", "cubic_drag"),
    ("coulomb_friction", "tight_spot"),
    ("coulomb_friction", "saturation"),
    ("coulomb_friction", "vibration"),
    ("unbalance", "drag"),
    ("unbalance", "saturation"),
    ("unbalance", "fading_friction"),
    ("constant_torque", "cubic_drag"),
    ("constant_torque", "cogging"),
)


def _beside(known: str, missing: Kind) -> Kind:
    """A missing term with an effect of the catalogue beside it."""
    more = KNOWN[known]

    def torque(size: float) -> Term:
        own = missing.torque(size)
        return lambda t, phi, w, i: own(t, phi, w, i) + more(t, phi, w, i)

    return Kind(missing.size, missing.regressor, missing.form, torque, known)


KINDS = {
    **MISSING,
    **{f"{known}+{name}": _beside(known, MISSING[name]) for known, name in PAIRS},
    "sound": Kind(0.0, "", "", lambda size: lambda t, phi, w, i: 0.0),
}


def _current(log: str, t: float) -> float:
    """A."""
    if log == "steps":
        return (1.5, -1.2, 0.9, -1.6)[int(t / 1.5) % 4]
    if log == "slow":
        return 2.2 * (math.sin(0.9 * t) + 0.4 * math.sin(3.1 * t + 0.5))
    return 1.4 * (math.sin(2.0 * t) + 0.5 * math.sin(5.3 * t + 1.0))


def rig(folder: Path, kind: Kind, seed: int) -> tuple[Path, float]:
    """Writes a rig's logs and description; returns its path and the term's size."""
    rng = np.random.default_rng(seed)
    size = kind.size * 2.0 ** rng.uniform(-1.0, 1.0)
    inertia, gain, viscous = np.array([J, K_T, B]) * (1 + OFF * rng.standard_normal(3))
    torque = kind.torque(size)

    def rates(t: float, phi: float, w: float, i: float) -> tuple[float, float]:
        return w, (gain * i - viscous * w + torque(t, phi, w, i)) / inertia

    for log in ("sines", "slow", "steps"):
        at = np.arange(0.0, LENGTH, PERIOD)
        held = [round(_current(log, t), 3) for t in at]
        speeds = _speeds(rates, at.tolist(), held)
        noisy = speeds + NOISE * rng.standard_normal(len(at))
        table = pd.DataFrame({"time": at.round(6), "i": held, "w": noisy.round(4)})
        table.to_csv(folder / f"{log}.csv", index=False)
    shutil.copy(ROOT / "Motor.mo", folder)
    shutil.copytree(ROOT / "effects", folder / "effects", dirs_exist_ok=True)
    text = (ROOT / "plant.toml").read_text(encoding="utf-8").replace("data/", "")
    path = folder / "plant.toml"
    path.write_text(f'{text}\n[log.slow]\nfile = "slow.csv"\n', encoding="utf-8")
    return path, size


def _speeds(rates: Rates, times: Sequence[float], held: Sequence[float]) -> Array:
    """Speed at each row, by the classical Runge-Kutta method."""
    h, phi, w, found = PERIOD / PARTS, 0.0, 0.0, []
    for row, i in zip(times, held, strict=True):
        found.append(w)
        for k in range(PARTS):
            t = row + k * h
            a, b = rates(t, phi, w, i)
            c, d = rates(t + h / 2, phi + h / 2 * a, w + h / 2 * b, i)
            e, f = rates(t + h / 2, phi + h / 2 * c, w + h / 2 * d, i)
            g, j = rates(t + h, phi + h * e, w + h * f, i)
            phi += h / 6 * (a + 2 * c + 2 * e + g)
            w += h / 6 * (b + 2 * d + 2 * f + j)
    return np.array(found)


def _learnt(path: Path, forced: bool) -> tuple[str, Learned | None]:
    """The verdict, and what was learnt; forced: whatever the verdict."""
    read, task = described_task(path)
    found = run(task, read.rules)
    learned = learn(found, read.rules) if forced or wanted(found) else None
    return found.diagnosis.verdict, learned


def _row(name: str, seed: int) -> dict[str, Any]:
    """One rig, diagnosed and judged; a sound one is screened all the same."""
    kind, began = KINDS[name], time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        path, size = rig(Path(folder), kind, seed)
        verdict, learned = _learnt(path, forced=not kind.regressor)
    row: dict[str, Any] = {"kind": name, "seed": seed, "verdict": verdict, "term": ""}
    told = to_json(learned) if learned is not None else None
    if told and told["accepted"]:
        row |= _judged(kind, size, told)
    elif told and told["term"]:
        row["term"] = f"located only: {told['term']['formula']}"
    return row | {"cpu_s": round(time.process_time() - began, 1)}


def _judged(kind: Kind, size: float, told: dict[str, Any]) -> dict[str, Any]:
    """Which parts of an accepted term are right."""
    term, gap = told["term"], told["gap"]
    form = (term["regressor"], term["form"]) == (kind.regressor, kind.form)
    ends = sorted(map(abs, next(iter(term["parameters"].values()))["ci95"]))
    causes = [c["effect"] for c in told["causes"]]
    return {
        "term": term["formula"],
        "accepted": True,
        "regressor": term["regressor"] == kind.regressor,
        "in_set": kind.regressor in [t["regressor"] for t in told["answer_set"]],
        "form": form,
        **({"within": ends[0] <= abs(size) <= ends[1]} if form else {}),
        "beside": causes,
        "known": causes == ([kind.known] if kind.known else []),
        "shrink": round(gap["shrink"], 4) if gap else None,
        "size": float(f"{size:.4g}"),
        "next": told["next_experiment"],
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a row for each rig, and how many are right."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.missing_terms")
    parser.add_argument("kinds", nargs="*", help=f"of {', '.join(KINDS)}; missing, pairs: all such")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    options = parser.parse_args(arguments)
    groups = {"missing": list(MISSING), "pairs": [n for n in KINDS if "+" in n]}
    names = [n for given in options.kinds or KINDS for n in groups.get(given, [given])]
    if unknown := [n for n in names if n not in KINDS]:
        parser.error(f"unknown kind {unknown[0]}")
    rows = []
    for name in names:
        for seed in range(options.first, options.first + options.seeds):
            rows.append(_row(name, seed))
            print({k: v for k, v in rows[-1].items() if v not in (None, "", [])}, flush=True)
    print_sums(rows)
    return 0


def print_sums(rows: Sequence[dict[str, Any]]) -> None:
    """How many are right, of what was judged."""
    faulty = [r for r in rows if r["kind"] != "sound"]
    for what in ("accepted", "block", "regressor", "in_set", "form") if faulty else ():
        if any(what in r for r in faulty):
            print(f"{what}: {sum(bool(r.get(what)) for r in faulty)} of {len(faulty)}")
    if sizes := [r["within"] for r in faulty if "within" in r]:
        print(f"within: {sum(sizes)} of {len(sizes)} coefficients")
    if pairs := [r for r in faulty if "+" in r["kind"]]:
        both = [r for r in pairs if r.get("known") and r.get("regressor")]
        named = [r for r in both if r.get("form")]
        print(f"known and unknown told: {len(both)} of {len(pairs)}, with its form {len(named)}")
    if shrinks := [r["shrink"] for r in faulty if r.get("shrink") is not None]:
        print(f"shrink: median {float(np.median(shrinks)):.4f}, least {min(shrinks):.4f}")
    sound = [r for r in rows if r["kind"] == "sound"]
    if sound:
        print(
            f"sound rigs without a term: {sum(not r.get('accepted') for r in sound)}"
            f" of {len(sound)}; nothing worth a fit: {sum(not r['term'] for r in sound)}"
        )


if __name__ == "__main__":
    raise SystemExit(main())
