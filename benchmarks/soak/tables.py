"""Mangled TOML: every table that a command reads, with values of any type at any key, keys left
out, doubled, unknown or elsewhere.
"""

from __future__ import annotations

import copy
import math
import random
import tomllib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

from benchmarks.soak.fuzz import Kinds, Read, with_bytes_changed
from benchmarks.soak.logs import sound_csv
from pneugantry.engine.describe import described
from pneugantry.engine.hypotheses.catalogue import read_catalogue
from pneugantry.plants.described import is_plant_description
from pneugantry.sweep.check import check_spec
from pneugantry.sweep.spec import read_spec
from pyfmi_runner.build import build_fmu, cache_folder
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.plan import make_plan
from pyfmi_runner.run import make_scenario_controller
from pyfmi_runner.scenario import read_scenario

__all__ = ["TABLES"]

SCENARIO = """
name = "mine"
workpiece = "straight"
standoff = 0.09
surface_finish = false
start = { x = 0.95, z = 0.0 }
f_nd = 30.0
v_td = -0.06
controller = "pi_fv"
gains = "table_4_6"
phases = { approach = [0.0, 1.0], contact = [1.0, 2.0], contour = [2.0, 3.0], retreat = [3.0, 4.0] }
approach_command = { u_x = 0.0, u_z = 1.05 }
retreat_f_az = -40.0
clamped = ["x until contour"]
seed = 1
[plant]
"contact.K_c" = 2e4
[sensors]
bias_f_x = 0.1
tau_v_z = 0.005
noise = true
sigma = { z = 1e-4 }
quantum = { x = 1e-3 }
[timing]
period = 1e-3
delay = 0.0015
jitter = 0.0002
"""
CAMPAIGN = """
name = "rig"
[log.a]
file = "log.csv"
loop = "closed"
clamped = ["x until contour"]
start = { x = 0.5, z = 0.05 }
workpiece = "edge.csv"
standoff = 0.09
surface_finish = true
phases = { approach = [0.0, 3.0], contact = [3.0, 7.0], contour = [7.0, 16.0] }
approach_command = { u_x = 0.0, u_z = 1.05 }
f_nd = 30.0
v_td = -0.06
controller = "pi_fv"
gains = { Kp_vx = 1.0 }
"""
GRID = """
name = "study"
base = { workpiece = "straight", gains = "table_4_6" }
keep_logs = false
[grid]
"plant.contact.K_c" = [1e4, 2e4]
controller = ["pi_fv", "pid_fv"]
seed = [1, 2]
start.x = [0.9, 0.95]
"gains.Kp_vx" = [1.0, 2.0]
"""
SAMPLE = """
[sample]
method = "sobol"
n = 8
seed = 1
[sample.bounds]
f_nd = [20.0, 40.0]
"plant.contact.K_c" = { low = 1e4, high = 4e4, scale = "log" }
workpiece = { choices = ["straight", "curved"] }
seed = [1, 9]
"""
LONG = 100_000  # samples of a scenario that is no longer laid out
ODD_TEXTS = (
    "",
    " ",
    "x",
    "z",
    "straight",
    "none",
    "edge.csv",
    "\u0000.csv",
    "é" * 300 + ".csv",
    "../log.csv",
    "a.toml",
    "true",
    "1e4",
    "\n",
    "\u0000",
    "é" * 200,
    "{axis}",
    "{0}",
    "{",
    "%s",
)
ODD_NUMBERS = (
    0,
    -1,
    1,
    2,
    10**30,
    -(2**63),
    0.0,
    -0.0,
    1e-300,
    1e308,
    -1e308,
    math.nan,
    math.inf,
    -math.inf,
    0.5,
)
EFFECTS = """
[[effect]]
name = "mine"
block = "valve_{axis}"
axes = ["x", "z"]
summary = "what it is"
refines = ["valve_delay"]
[[effect.form]]
name = "plain"
settings = { "axis_{axis}.friction.law" = 3 }
[effect.form.parameters."valve_{axis}.delay_time"]
neutral = 0.001
scale = 0.01
low = 1e-4
high = 0.1
unit = "s"
relative = false
positive = true
starts = [0.005, 0.02]
"""
PLANT = """
[plant]
name = "mine"
fmu = "plant.fmu"
catalogue = "effects"
period = 1e-3
decimate = 2
skip = 0.005
[inputs]
u_x = "u_x"
u_z = 1.0
[outputs.z]
column = "z"
sigma = 1e-4
unit = "m"
[tolerance]
"axis_z.m" = 0.05
[parameters]
"contact.K_c" = 2e4
[log.a]
file = "log.csv"
[log.b]
file = "log.csv"
use = "held out"
inputs = { u_z = "u_z" }
parameters = { "axis_z.C" = 30.0 }
"""
ODD_KEYS = (
    "",
    "x",
    "name",
    "file",
    "phases",
    "log",
    "plant",
    "contact.K_c",
    "low",
    "é",
    " ",
    "a.b",
    "seed",
)


def values(rng: random.Random, depth: int = 2) -> Any:
    """Any value that TOML knows; `Raw` of dates and times."""
    kind = rng.randrange(8 if depth else 5)
    if kind == 0:
        return rng.choice(ODD_TEXTS)
    if kind in (1, 2):
        return rng.choice(ODD_NUMBERS)
    if kind == 3:
        return rng.random() < 0.5
    if kind == 4:
        return Raw(rng.choice(["2026-01-01", "07:32:00", "1979-05-27T07:32:00Z", "0xff", "1_000"]))
    if kind == 5:
        return {rng.choice(ODD_KEYS): values(rng, depth - 1) for _ in range(rng.randint(0, 3))}
    return [values(rng, depth - 1) for _ in range(rng.randint(0, 3))]


class Raw(str):
    """Text that stands in TOML as it is."""


def text_of(value: Any) -> str:
    """A value as TOML; tables in one line."""
    if isinstance(value, Raw):
        return value
    if isinstance(value, str):
        return (
            '"'
            + "".join(
                c if c.isprintable() and c not in '"\\' else f"\\u{ord(c):04x}" for c in value
            )
            + '"'
        )
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return (
            "{ " + ", ".join(f"{text_of(str(k))} = {text_of(v)}" for k, v in value.items()) + " }"
        )
    if isinstance(value, list):
        return "[" + ", ".join(map(text_of, value)) + "]"
    return repr(value)


def mangled(rng: random.Random, text: str) -> bytes:
    """A document with some of its values, keys or bytes changed."""
    if rng.random() < 0.1:
        return with_bytes_changed(rng, text.encode())
    table = copy.deepcopy(tomllib.loads(text))
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        _change(rng, table)
    return "".join(
        f"{text_of(str(key))} = {text_of(value)}\n" for key, value in table.items()
    ).encode()


def _change(rng: random.Random, table: dict[str, Any]) -> None:
    """At a random place: a value of any type, a near number, a key left out, added, renamed, or its
    value put elsewhere.
    """
    places = _places(table)
    if not places:
        return
    holder, key = rng.choice(places)
    change = rng.randrange(7)
    value = holder[key]
    if change <= 2:
        holder[key] = values(rng)
    elif change == 3:
        holder[key] = (
            [value]
            if not isinstance(value, float)
            else value * rng.choice([-1.0, 0.0, 1e-3, 10.0, 1e6])
        )
    elif change == 4:
        del holder[key]
    else:
        other, place = rng.choice(places)
        if change == 5 and isinstance(other, dict):
            other[rng.choice(ODD_KEYS)] = values(rng)
        elif other is not holder:
            other[place] = copy.deepcopy(value)


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Every (table or list, key or index) in a document."""
    keys = (
        list(value)
        if isinstance(value, dict)
        else range(len(value))
        if isinstance(value, list)
        else ()
    )
    return [place for key in keys for place in [(value, key), *_places(value[key])]]


def _document(
    text: str, name: str, read: Callable[[Path], object]
) -> Callable[[random.Random, Path], Read]:
    def draw(rng: random.Random, folder: Path) -> Read:
        (folder / "log.csv").write_text(sound_csv(), encoding="utf-8")
        (folder / "edge.csv").write_text(
            "x,z_w\n" + "".join(f"{k / 20},0.0\n" for k in range(21)), encoding="utf-8"
        )
        path = folder / name
        path.write_bytes(mangled(rng, text))
        return partial(read, path)

    return draw


@cache
def gantry() -> FmuFile:
    return FmuFile.read(build_fmu().path)


def _scenario(path: Path) -> None:
    scenario = read_scenario(path)
    make_scenario_controller(scenario, path)
    if scenario.samples < LONG:
        make_plan(scenario)


def _campaign(path: Path) -> None:
    read_campaign(path.parent, strict=False)
    read_campaign(path.parent)


def _study(path: Path) -> None:
    check_spec(read_spec(path), gantry())


def _plant(path: Path) -> None:
    if is_plant_description(path):
        link, effects = path.parent / "plant.fmu", path.parent / "effects"
        if not link.exists():
            link.symlink_to(gantry().path)
            effects.mkdir()
            (effects / "mine.toml").write_text(EFFECTS, encoding="utf-8")
        described(path, cache_folder() / "parts")


TABLES: Kinds = {
    "scenario": _document(SCENARIO, "scenario.toml", _scenario),
    "campaign": _document(CAMPAIGN, "campaign.toml", _campaign),
    "set-up of one log": _document(
        CAMPAIGN.split("]", 1)[1].replace('file = "log.csv"', ""),
        "log.toml",
        lambda path: read_campaign(path.parent / "log.csv"),
    ),
    "grid": _document(GRID, "study.toml", _study),
    "sample": _document(SAMPLE, "study.toml", _study),
    "catalogue": _document(EFFECTS, "mine.toml", read_catalogue),
    "plant": _document(PLANT, "plant.toml", _plant),
}
