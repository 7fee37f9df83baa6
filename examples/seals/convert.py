"""Logs of a seal as the diagnosis reads them, and its friction levels by least squares.

Raw files: whitespace-separated, no header, some 10 ms apart: time [ms], laser [V], pressure [V],
force [V], position [mm], gauge pressure [bar], force of the tester on the rod [N]; the first 15
rows are unsettled. Source: github.com/EvaZillen/3D-printed-pneumatic-actuator (CC0-1.0).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from modelica_fmu.errors import InputError
from pneugantry.blind.description import relocated

PLANT = Path(__file__).parent / "plant.toml"
SEALS = ("O-ring", "NAPN", "NAP310", "KDN")
PRESSURES = (1, 3, 5, 7)  # bar, regulated
HELD = (3, 7)
PERIOD = 0.01  # s
UNSETTLED = 15  # rows
AREA = np.pi * 0.0125**2  # m^2
MOVES = 2e-3  # m/s, a stroke is under way
SPAN = 5  # samples to each side that a speed is taken from


@dataclass(frozen=True)
class Levels:
    """Friction of a seal at one pressure, N: half the step of the force between retracting and
    extending (medians over all strokes), half its whole range (1st to 99th percentile), and
    pressure force less mean force.
    """

    median: float
    half_range: float
    offset: float


def read_raw(folder: Path, seal: str, pressure: int) -> pd.DataFrame:
    """time [s], position [m], speed [m/s], pressure [Pa], force [N] on an even 10 ms grid. Raises
    InputError naming a missing or damaged file.
    """
    file = folder / f"friction__{seal}_{pressure}bar.csv"
    if not file.is_file():
        raise InputError("no such log", file=file, hint="give the folder of the recorded files")
    raw = np.loadtxt(file, ndmin=2)
    if raw.shape[1] != 7 or len(raw) <= 2 * UNSETTLED:
        raise InputError("is no table of seven columns", file=file, hint="take the raw file")
    raw = raw[UNSETTLED:]
    stamps = (raw[:, 0] - raw[0, 0]) * 1e-3
    if np.any(np.diff(stamps) <= 0.0):
        raise InputError("time does not increase", file=file, field="time", hint="cut the log")
    time = np.arange(0.0, stamps[-1], PERIOD)
    position, bar, force = (np.interp(time, stamps, raw[:, j]) for j in (4, 5, 6))
    return pd.DataFrame(
        {
            "time": time.round(6),
            "position": (position * 1e-3).round(7),
            "speed": _speed(position * 1e-3).round(7),
            "pressure": (bar * 1e5).round(1),
            "force": force.round(4),
        }
    )


def _speed(position: np.ndarray) -> np.ndarray:
    """Central difference over 2 * SPAN samples; 0 at both ends."""
    out = np.zeros_like(position)
    out[SPAN:-SPAN] = (position[2 * SPAN :] - position[: -2 * SPAN]) / (2 * SPAN * PERIOD)
    return out


def levels(log: pd.DataFrame) -> Levels:
    """Friction of a log."""
    rest = (log["force"] - log["pressure"] * AREA).to_numpy()
    v = log["speed"].to_numpy()
    up, down = np.median(rest[v > MOVES]), np.median(rest[v < -MOVES])
    low, high = np.percentile(rest, [1, 99])
    return Levels(float(up - down) / 2, float(high - low) / 2, float(up + down) / 2)


def pressure_fit(logs: dict[int, pd.DataFrame]) -> dict[str, float]:
    """Least squares of the force while the rod moves, over all pressures: constant Coulomb friction
    from 1 bar, and a level that grows with pressure; RMS of what is left [N], both with area and
    offset free.
    """
    whole = pd.concat(log[log["speed"].abs() > MOVES] for log in logs.values())
    sense, p = np.sign(whole["speed"].to_numpy()), whole["pressure"].to_numpy() / 1e5
    force, ones = whole["force"].to_numpy(), np.ones(len(whole))
    level = levels(logs[1]).median
    still = [ones, p]
    constant = _left(force - level * sense, np.column_stack(still))
    growing, x = _solved(force, np.column_stack([*still, sense, p * sense]))
    return {
        "level_1_bar": level,
        "constant": constant,
        "growing": growing,
        "F_c": float(x[2] + x[3]),
        "growth_per_bar": float(x[3] / (x[2] + x[3])),
    }


def _solved(y: np.ndarray, columns: np.ndarray) -> tuple[float, np.ndarray]:
    x = np.linalg.lstsq(columns, y, rcond=None)[0]
    return float(np.sqrt(np.mean((y - columns @ x) ** 2))), x


def _left(y: np.ndarray, columns: np.ndarray) -> float:
    return _solved(y, columns)[0]


def write_seal(raw: Path, out: Path, seal: str, friction: float | None = None) -> Path:
    """Writes the four logs of a seal and a plant.toml that reads them: 1 and 5 bar fitted, the
    others held out. friction: Coulomb friction of the nominal plant [N]; None: this seal's own at
    1 bar.
    """
    if seal not in SEALS:
        raise InputError(f"is {seal!r}, expected one of {', '.join(SEALS)}", field="--seal")
    out.mkdir(parents=True, exist_ok=True)
    logs = {bar: read_raw(raw, seal, bar) for bar in PRESSURES}
    level = levels(logs[1]).median if friction is None else friction
    lines = [relocated(PLANT, out), "[parameters]", f'"seal.F_c" = {level:.6g}']
    for bar, log in logs.items():
        log.to_csv(out / f"{bar}bar.csv", index=False)
        use = "held out" if bar in HELD else "fit"
        lines += ["", f'[log."{bar}bar"]', f'file = "{bar}bar.csv"', f'use = "{use}"']
    path = out / "plant.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
