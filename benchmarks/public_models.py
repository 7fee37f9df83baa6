"""Twenty models of public sources: compiled, run and held against their equations by hand.

    python -m benchmarks.public_models FOLDER --also LIBRARY [--only TEXT] [--json FILE]

FOLDER: a checkout of each repository of MODELS, in a folder named owner+name. LIBRARY: the Modelica
Standard Library. The equations were read from the models' text and written here for scipy's DOP853
(Radau where they are stiff), or their closed form. Chaotic ones run for as long as 1e-9 is not
amplified to more than is told.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.textbook import POINTS, Independent, Outcome, compared, simulated, without_folder
from modelica_fmu.compiler import compile_model
from modelica_fmu.errors import InputError
from modelica_fmu.package import package_fmu

TIGHT = 1e-8
Values = Mapping[str, Callable[[np.ndarray], np.ndarray]]


class Public(NamedTuple):
    repository: str  # on GitHub
    path: str  # of the file, or of the library's folder
    name: str  # of the class
    stop: float  # s
    solution: Callable[[float], Values]  # stop time, s -> values as functions of time


def integrated(
    rate: Callable[[float, np.ndarray], Sequence[float]],
    start: Mapping[str, float],
    stiff: bool = False,
) -> Callable[[float], Values]:
    """States by name, from their rates in the order of `start`."""

    def solution(stop: float) -> Values:
        made = solve_ivp(
            rate,
            (0.0, stop),
            list(start.values()),
            "Radau" if stiff else "DOP853",
            rtol=1e-9 if stiff else 1e-11,
            atol=1e-12,
            max_step=stop / 200,
            dense_output=True,
        )
        assert made.success, made.message

        def state(i: int, t: np.ndarray) -> np.ndarray:
            return np.asarray(made.sol(t)[i])

        return {name: partial(state, i) for i, name in enumerate(start)}

    return solution


def sines(stop: float = 0.0) -> Values:
    return {"sum1.y": lambda t: sum(np.sin(2 * np.pi * t / k) for k in (1, 10, 100))}


def _bateman(t: float, n: np.ndarray) -> list[float]:
    rate, made = (0.01, 0.05, 0.05, 0.01), (0.4, 0.3, 0.2, 0.1)
    return [made[i] - rate[i] * n[i] + (rate[i - 1] * n[i - 1] if i else 0.0) for i in range(4)]


def _lorenz(beta: float) -> Callable[[float, np.ndarray], list[float]]:
    return lambda t, s: [
        10 * (s[1] - s[0]),
        s[0] * (28 - s[2]) - s[1],
        s[0] * s[1] - beta * s[2],
    ]


def _grazing(feed: Callable[[float], float]) -> Callable[[float, np.ndarray], list[float]]:
    return lambda t, s: [
        0.1 * s[0] - 0.02 * s[0] * s[1] + feed(t),
        0.02 * s[0] * s[1] - 0.4 * s[1],
    ]


def _sum_of_sines(t: float) -> float:
    return float(sum(math.sin(2 * math.pi * t / k) for k in (1, 10, 100)))


def _hares(t: float, s: np.ndarray) -> list[float]:
    return [0.04 * s[0] - 0.0005 * s[0] * s[1], 0.1 * 0.0005 * s[0] * s[1] - 0.09 * s[1]]


def _species(t: float, s: np.ndarray) -> list[float]:
    return [0.04 * s[0] * (1 - 0.0125 * s[1]), -0.09 * s[1] * (1 - s[0] / 1800)]


def _chua(t: float, s: np.ndarray) -> list[float]:
    """Voltages of both capacitors and of the inductor's resistance; two negative converters."""
    v1, v2, drop = s
    current = 0.0
    for r, to_ground in ((220.0, 2200.0), (22000.0, 3300.0)):
        limit = 12 * to_ground / (to_ground + r)
        inner = max(-limit, min(limit, v1))
        current += -inner / to_ground + (v1 - inner) / r
    return [
        ((v2 - v1) / 1850 - current) / 10e-9,
        (-(v2 - v1) / 1850 - drop / 14) / 100e-9,
        (v2 - drop) * 14 / 18e-3,
    ]


def _oscillator(t: float, s: np.ndarray) -> list[float]:
    tau, ratio, heat = math.sqrt(100e-3 * 100e-9), math.sqrt(100e-3 / 100e-9), 2 * 26e-3
    b, c, e = ratio * (12 / 20e3) / heat, ratio * 1e-9 / heat, 0.15
    x, y, z = s
    return [
        y / tau,
        (0.85 * y - x - z) / tau,
        (b + y - c * (math.exp(z) - 1)) / (tau * e),
    ]


def _colpitts(t: float, s: np.ndarray) -> list[float]:
    v1, v2, coil = s
    base = max(0.0, (v2 - 0.75) / 100)
    return [
        (coil - 200 * base) / 54e-9,
        ((5 - v2) / 5000 - coil - base) / 54e-9,
        (5 - v1 + v2 - 35 * coil) / 98.5e-6,
    ]


def _jerk(t: float, s: np.ndarray) -> list[float]:
    diode = 1e3 * 1e-12 * (math.exp(s[1] / 26e-3) - 1)
    return [1e3 * s[1], 1e3 * s[2], 1e3 * (-0.3 * s[2] - diode - s[0])]


def _diode(t: float, s: np.ndarray) -> list[float]:
    tau = 0.1e-3
    return [-s[1] / tau, -s[2] / tau, (-s[0] + (math.exp(s[1]) - 1) / 5200 - 1.5 * s[2]) / tau]


def _memristor(t: float, s: np.ndarray) -> list[float]:
    v1, v2, coil, flux = s
    through = (-0.667e-3 + 3 * 0.029e-3 * (flux / (8200 * 47e-9 / 10)) ** 2) * v1
    return [
        ((v2 - v1) / 1800 - through) / 6.8e-9,
        (-coil - (v2 - v1) / 1800) / 68e-9,
        v2 / 18e-3,
        v1,
    ]


def _rabbits(t: float, s: np.ndarray) -> list[float]:
    eaten = 0.0005 * s[0] * s[1]
    on = s[1] > 5 or (s[0] > 500 and s[1] < 20)
    return [0.04 * s[0] - eaten, 0.1 * eaten - 0.09 * s[1] if on else 0.0]


def _bouncing(stop: float) -> Values:
    """Closed form: parabolas, each bounce 0.9 of the speed before."""
    fall = math.sqrt(2 * 10 / 9.81)
    at, speed = [-fall], [9.81 * fall]  # as if thrown upward before
    while at[-1] + 2 * speed[-1] / 9.81 < stop:
        at.append(at[-1] + 2 * speed[-1] / 9.81)
        speed.append(0.9 * speed[-1])
    begin, first = np.array(at), np.array(speed)

    def height(t: np.ndarray) -> np.ndarray:
        k = np.searchsorted(begin, t, "right") - 1
        return np.asarray(first[k] * (t - begin[k]) - 4.905 * (t - begin[k]) ** 2)

    def velocity(t: np.ndarray) -> np.ndarray:
        k = np.searchsorted(begin, t, "right") - 1
        return np.asarray(first[k] - 9.81 * (t - begin[k]))

    return {"height": height, "velocity": velocity}


def _aircraft(stop: float) -> Values:
    return {
        "body.x": lambda t: t**2 / 2,
        "body.v_x": lambda t: t,
        "accel.ma_x": lambda t: np.ones_like(t),
    }


def _rod() -> Callable[[float], Values]:
    n, step = 100, 0.2 / 99
    rate = 237 / 910 / 2712 / step**2

    def warm(t: float, s: np.ndarray) -> list[float]:
        inner = rate * (s[2:] - 2 * s[1:-1] + s[:-2])
        return [rate * (s[1] - s[0]), *inner, 0.0]

    start = {f"T[{i}]": 273.15 if i < n else 330.0 for i in range(1, n + 1)}
    return integrated(warm, start)


TRAINING = "ORNL-Modelica/TRANSFORM-Training", "TRANSFORM_Training_2019"
FIRST = "TRANSFORM_Training_2019.Examples.Session_1_ModelicaIntroduction."
CHAOS = "AHaumer/ChaoticCircuits", "ChaoticCircuits"
PYMOCA, CAUSAL = "pymoca/pymoca", "CIFASIS/modelicacc"
ISOTOPES = {"Ns[1]": 500.0, "Ns[2]": 100.0, "Ns[3]": 300.0, "Ns[4]": 200.0}
TEN, ONE = {"x": 10.0, "y": 10.0}, {"x": 1.0, "y": 1.0, "z": 1.0}
LITTLE = {"x": 0.001, "y": 0.001, "z": 0.001}
NEAR_0 = {"v1": 0.0, "v2": 1e-3, "vRL": 0.0}
FED = {"lotkaVolterra.x": 10.0, "lotkaVolterra.y": 10.0}


def _equations(name: str) -> str:
    return f"ChaoticCircuits.{name}.AnalyticEquations"


MODELS = (
    Public(*TRAINING, FIRST + "BatemanEquations", 200, integrated(_bateman, ISOTOPES)),
    Public(*TRAINING, FIRST + "LorenzSystem", 5, integrated(_lorenz(8 / 3), ONE)),
    Public(*TRAINING, FIRST + "LotkaVolterra", 140, integrated(_grazing(lambda t: 0.0), TEN)),
    Public(*TRAINING, FIRST + "SimpleSines", 20, sines),
    Public(*TRAINING, FIRST + "SimpleSinesPlus", 20, integrated(_grazing(_sum_of_sines), FED)),
    Public(
        *CHAOS,
        "ChaoticCircuits.LotkaVolterra.PredatorPrey",
        300,
        integrated(_hares, {"hares": 700.0, "foxes": 10.0}),
    ),
    Public(
        *CHAOS,
        "ChaoticCircuits.LotkaVolterra.LotkaVolterra",
        300,
        integrated(_species, {"x[1]": 700.0, "x[2]": 10.0}),
    ),
    Public(*CHAOS, _equations("LorenzSystem"), 20, integrated(_lorenz(1 / 3), LITTLE)),
    Public(*CHAOS, _equations("ChuasCircuit"), 2e-3, integrated(_chua, NEAR_0)),
    Public(*CHAOS, "ChaoticCircuits.ChuasCircuit.IdealCircuit", 2e-3, integrated(_chua, NEAR_0)),
    Public(
        *CHAOS,
        _equations("ChaoticOscillator"),
        0.01,
        integrated(_oscillator, {"x": 0.0, "y": 0.0, "z": 0.0}),
    ),
    Public(
        *CHAOS,
        _equations("ColpittsCircuit"),
        1e-4,
        integrated(_colpitts, {"v1": 0.0, "v2": 0.0, "iL": 0.0}),
    ),
    Public(*CHAOS, _equations("JerkCircuit"), 0.02, integrated(_jerk, LITTLE)),
    Public(
        *CHAOS,
        _equations("ChaoticDiode"),
        0.003,
        integrated(_diode, {"x": 0.0, "y": 0.1, "z": 0.0}),
    ),
    Public(
        *CHAOS,
        _equations("ChuasMemristor"),
        2e-3,
        integrated(_memristor, {"v1": 0.0, "v2": 1e-3, "iL": 0.0, "phi": 0.0}),
    ),
    Public(PYMOCA, "test/models/BouncingBall.mo", "BouncingBall", 10, _bouncing),
    Public(
        PYMOCA,
        "test/models/SpringSystem.mo",
        "SpringSystem",
        20,
        integrated(lambda t, s: [s[1], -2 * s[0] - 0.2 * s[1]], {"x": 1.0, "v_x": 1.0}),
    ),
    Public(PYMOCA, "test/models/Aircraft.mo", "Aircraft", 3, _aircraft),
    Public(
        CAUSAL,
        "examples/causalize/lotka.mo",
        "lotkaVoltera",
        200,
        integrated(_rabbits, {"rabbits": 700.0, "foxes": 10.0}),
    ),
    Public(CAUSAL, "test/causalize/OneDHeatTransferTI_FD.mo", "OneDHeatTransferTI_FD", 1, _rod()),
)


def place_of(model: Public, folder: Path) -> Path:
    """Raises InputError where the checkout lacks the model's source."""
    place = folder / model.repository.replace("/", "+") / model.path
    if not place.exists():
        hint = "check out each repository of the list into a folder named owner+name"
        raise InputError("not there", file=place, hint=hint)
    return place


def tried(model: Public, place: Path, libraries: Sequence[Path], out: Path) -> Outcome:
    file = place if place.suffix == ".mo" else None
    try:
        compiled = compile_model(file, model.name, None, [place, *libraries][file is not None :])
        path = package_fmu(compiled, "2.0", out / "model.fmu")
    except InputError as error:
        return Outcome(model.name, "refused", "", None, str(error))
    wanted = model.solution(model.stop)
    known = [v.name for v in compiled.variables if v.name in wanted]
    settings = {"solver.tolerance": TIGHT, "solver.max_step": max(1e-6, model.stop / POINTS)}
    try:
        time, found = simulated(path, model.stop, known, settings)
    except Exception as error:
        return Outcome(model.name, "failed", "", None, " ".join(str(error).split())[:200])
    solution = Independent("by hand", dict(wanted), exact=True)
    return compared(model.name, time, found, solution)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--also", action="append", type=Path, default=[], metavar="LIBRARY")
    parser.add_argument("--only", metavar="TEXT", default="")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    rows, chosen = [], [model for model in MODELS if options.only in model.name]
    try:
        places = [place_of(model, options.folder) for model in chosen]
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    for model, place in zip(chosen, places, strict=True):
        with TemporaryDirectory(prefix="public-") as out:
            made = tried(model, place, options.also, Path(out))
        made = without_folder(made, options.folder)
        rows.append({"repository": model.repository, "path": model.path} | made._asdict())
        off = "" if made.error is None else f"{made.error:.1e}"
        print(f"{made.state:9} {off:8} {made.model}  {model.repository}  {made.said}", flush=True)
    counts = Counter(str(row["state"]) for row in rows)
    print(f"{len(rows)} models: " + ", ".join(f"{n} {s}" for s, n in counts.items()))
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
