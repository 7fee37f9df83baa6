"""A set-up file for a recorder's own log: guessed columns, units and start, to be
checked by hand.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pyfmi_runner.log import (
    COLUMNS,
    OPTIONAL,
    REQUIRED,
    STROKE_X,
    STROKE_Z,
    parsed_numbers,
)
from pyfmi_runner.log_import import ABSENT, UNITS
from pyfmi_runner.scenario import toml_key
from pyfmi_runner.suspicions import touches
from pyfmi_runner.workpiece import WORKPIECES

__all__ = ["Guess", "guessed_columns", "template"]

TIME = ("time", "t", "zeit", "timestamp", "stamp", "timesec", "times", "timems")
KINDS = {  # kind of channel: the words that recorders use for it; the longest that fits counts
    "f_a": ("fa", "actuator", "actuatorforce", "pneu", "cylinderforce", "driveforce", "act",
            "cyl", "fcyl", "cylinder", "forcecyl", "fact", "fpneu", "zylinder"),
    "f": ("f", "force", "loadcell", "contact", "contactforce", "kraft", "fc"),
    "v": ("v", "vel", "velocity", "speed", "dot", "rate", "tacho", "geschwindigkeit", "spd"),
    "u": ("u", "cmd", "command", "valve", "volt", "voltage", "ventil", "ao", "stell"),
    "": ("", "pos", "position", "piston", "weg", "s", "p", "encoder"),
}  # fmt: skip
OTHER = {"f_nd": ("fnd", "fdes", "forceref", "fref"), "v_td": ("vtd", "vdes", "vref"),
         "theta": ("theta", "angle"), "phase": ("phase",)}  # fmt: skip
LARGEST = {"x": STROKE_X, "z": STROKE_Z, "u_x": 5.0, "u_z": 5.0, "v_x": 3.0, "v_z": 2.0}
SPELT = {"sec": "s", "mm_s": "mm/s", "m_s": "m/s"}  # units where a name takes no slash
BUSY = 0.25  # share of rows at which a command turns back, from which on a controller gave it
SMALLER = {"m": "mm", "m/s": "mm/s", "V": "mV", "s": "ms", "N": "mN"}


class Guess(NamedTuple):
    """A recorder's column taken for one of a log's."""

    column: str
    unit: str


def guessed_columns(table: pd.DataFrame) -> dict[str, Guess]:
    """For each column of a log that seems to be there: which one it is, and its unit."""
    found: dict[str, Guess] = {}
    for column in map(str, table.columns):
        bare, unit = _split(column)
        name = column if column in COLUMNS else _name(bare)
        if name and name not in found:
            values = parsed_numbers(table[column])
            found[name] = Guess(column, unit if unit in _known(name) else _unit(name, values))
    return found


def _known(name: str) -> tuple[str, ...]:
    return tuple(UNITS[COLUMNS[name].unit])


def _split(column: str) -> tuple[str, str]:
    """A recorder's name without its unit, in small letters; and the unit."""
    match = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*", column)
    if match:
        return _bare(match[1]), match[2].strip()
    match = re.fullmatch(
        r"(.+?)[_ ](mm/s|mm_s|m/s|m_s|mm|cm|um|ms|us|mV|kN|mN|deg|rad|sec|s|m|N|V)", column
    )
    if match:
        return _bare(match[1]), SPELT.get(match[2], match[2])
    return _bare(column), ""


def _bare(text: str) -> str:
    text = text.split(".")[-1]  # a structure's field
    return re.sub(r"[^a-z]", "", text.lower())


def _name(bare: str) -> str | None:
    """The log's column that a bare name means, if it names one."""
    if bare in TIME:
        return "time"
    for name, words in OTHER.items():
        if bare in words:
            return name
    for axis in "xz":
        rest = {bare.removeprefix(axis), bare.removesuffix(axis)} - {bare}
        for kind, words in KINDS.items():
            if rest & set(words):
                return _channel(kind, axis)
    return None


def _channel(kind: str, axis: str) -> str:
    return axis if kind == "" else f"f_a{axis}" if kind == "f_a" else f"{kind}_{axis}"


def _unit(name: str, values: NDArray[np.float64]) -> str:
    """SI, or a thousandth of it where the values are too large for SI."""
    si = COLUMNS[name].unit
    finite = values[np.isfinite(values)]
    if name == "time":
        step = float(np.median(np.diff(finite))) if len(finite) > 1 else 0.0
        return "ms" if step > 0.3 else "s"
    if name in LARGEST and len(finite) and si in SMALLER:
        return SMALLER[si] if float(np.abs(finite).max()) > 3 * LARGEST[name] else si
    return si


def template(path: Path, table: pd.DataFrame) -> str:
    """The set-up file's text. Raises InputError where the table holds no column that
    could be one.
    """
    found = guessed_columns(table)
    if not set(found) - {"time"}:
        names = ", ".join(repr(str(c)) for c in list(table.columns)[:12])
        raise InputError(
            f"no column looks like a log's (it has {names})",
            file=path,
            hint="write the [import] table by hand: docs/how-to/import-a-log.md",
        )
    return "\n".join([*_head(path, table, found), "", *_columns(table, found), ""])


def _head(path: Path, table: pd.DataFrame, found: dict[str, Guess]) -> list[str]:
    start = {axis: _first(table, found, axis) for axis in "xz"}
    loop = '"closed"' if _controlled(table, found) else '"open"'
    workpiece = f'"{ABSENT}"' if _touched(table, found) else '"none"'
    return [
        f"# How {path.name} was taken. Written from the log; check every line, put something",
        f'# in place of every "{ABSENT}", then run',
        f"#     pneugantry log check {path.name}",
        f'loop = {loop:<21} # "closed" where a controller worked on the force or speed',
        'clamped = []                 # ["x"], ["x", "z"], ["x until contour"]: held carriages',
        f"start = {{ x = {start['x']}, z = {start['z']} }}   # m, the first rows",
        f"workpiece = {workpiece:<16} # none, {', '.join(WORKPIECES)}, or a CSV of x, z_w",
        "# standoff = 0.04            # m, from the z piston's start to the workpiece",
        "# of a closed loop:",
        "# phases = { approach = [0.0, 3.0], contact = [3.0, 7.0], contour = [7.0, 16.0] }   # s",
        "# approach_command = { u_x = 0.0, u_z = 1.05 }   # V",
        "# f_nd = 30.0                # N, > 0 presses into the workpiece",
        "# v_td = -0.06               # m/s, < 0 towards -x",
        '# controller = "pi_fv"       # `pneugantry list controllers`, or a name of yours',
    ]


def _first(table: pd.DataFrame, found: dict[str, Guess], axis: str) -> str:
    if axis not in found:
        return "0.0"
    guess = found[axis]
    factor = UNITS["m"][guess.unit]
    value = factor * float(np.nanmean(parsed_numbers(table[guess.column])[:10]))
    value = min(max(value, 0.0), LARGEST[axis])
    return f"{value:.4f}" if np.isfinite(value) else "0.0"


def _touched(table: pd.DataFrame, found: dict[str, Guess]) -> bool:
    """Did the log feel a workpiece?"""
    for name in {"f_x", "f_z"} & set(found):
        guess = found[name]
        force = UNITS["N"][guess.unit] * parsed_numbers(table[guess.column])
        if touches(force):
            return True
    return False


def _controlled(table: pd.DataFrame, found: dict[str, Guess]) -> bool:
    """Do the commands turn back at every few rows, as those of a controller on noisy sensors do?"""
    for name in {"u_x", "u_z"} & set(found):
        steps = np.sign(np.diff(parsed_numbers(table[found[name].column])))
        if len(steps) > 1 and float(np.mean(steps[1:] * steps[:-1] < 0)) > BUSY:
            return True
    return False


def _columns(table: pd.DataFrame, found: dict[str, Guess]) -> list[str]:
    """The [import] table: every column that a log must have, and the optional ones that
    are there.
    """
    lines = ["[import]                     # SI = scale * raw + offset, from the unit named"]
    used = {guess.column for guess in found.values()}
    spare = [str(c) for c in table.columns if str(c) not in used]
    for name in (*REQUIRED, *OPTIONAL):
        if name in found:
            guess = found[name]
            lines.append(_line(name, guess.column, guess.unit))
        elif name in REQUIRED:
            lines.append(_line(name, ABSENT, COLUMNS[name].unit) + f"  NOT FOUND: {_about(name)}")
    if "time" not in found:
        lines.append("# rate = 1000                # Hz, in place of time")
    if spare:
        lines.append(f"# not used: {', '.join(spare[:20])}")
    return lines


def _line(name: str, column: str, unit: str) -> str:
    text = f"{toml_key(name)} = {{ column = {_quoted(column)}, unit = {_quoted(unit)} }}"
    about = "any rate: it is resampled to 1 kHz" if name == "time" else COLUMNS[name].sign
    return f"{text:<50} # {about}"


def _about(name: str) -> str:
    return "name the column" if name != "time" else "name it, or delete this line and give rate"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
