"""Functions of the standard library's `Modelica.Math`, run in FMU code beside numpy and scipy.

    python -m benchmarks.math_functions LIBRARIES [--only TEXT] [--json FILE]

LIBRARIES: the folder that holds `Modelica`. Each call stands in a model of its own, its arguments
follow the time, so nothing is computed while compiling; its result is compared at TIMES. Right:
within TOLERANCE of 1 + |value|. What calls LAPACK or another library in C is refused.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import scipy.integrate
import scipy.special as special
import scipy.stats as stats

from benchmarks.differential import runner
from modelica_fmu.errors import InputError

TIMES = np.array([0.11, 0.37, 0.73, 0.93])  # s; the arguments are functions of it
TOLERANCE = 1e-9

Meant = Callable[[float], float]


def inverse(t: float) -> np.ndarray:
    """Of a matrix whose first pivot is 0."""
    return np.linalg.inv(np.array([[0, t, 2], [3, 4, 1], [t, 1, 0]]))


SCALAR: dict[str, tuple[str, Meant]] = {  # function: its arguments at time t, its value
    **{
        name: ("time", getattr(np, name if name[0] != "a" else f"arc{name[1:]}"))
        for name in (
            *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh"),
            *("exp", "log", "log10"),
        )
    },
    "acosh": ("1 + time", lambda t: np.arccosh(1 + t)),
    "atan2": ("time - 0.5, -time", lambda t: np.arctan2(t - 0.5, -t)),
    "atan3": ("time, -1, 6", lambda t: np.arctan2(t, -1) + 2 * np.pi * (np.arctan2(t, -1) < 2.858)),
    "wrapAngle": ("7*time, true", lambda t: (7 * t) % (2 * np.pi)),
    "Special.erf": ("2*time - 1", lambda t: special.erf(2 * t - 1)),
    "Special.erfc": ("4*time - 1", lambda t: special.erfc(4 * t - 1)),
    "Special.erfInv": ("1.9*time - 0.95", lambda t: special.erfinv(1.9 * t - 0.95)),
    "Special.erfcInv": ("1.9*time", lambda t: special.erfcinv(1.9 * t)),
    "Special.sinc": ("9*time - 1", lambda t: np.sinc((9 * t - 1) / np.pi)),
    "Vectors.norm": ("{time, -2, 1}, 3", lambda t: (t**3 + 9) ** (1 / 3)),
    "Vectors.length": ("{time, -2, 1}", lambda t: np.sqrt(t**2 + 5)),
    "Vectors.interpolate": (
        "{0, 0.5, 1}, {1, 3, 2}, time",
        lambda t: np.interp(t, [0, 0.5, 1], [1, 3, 2]),
    ),
    "Matrices.trace": ("[time, 2; 3, 4*time]", lambda t: 5 * t),
    "Matrices.norm": ("[time, -2; 3, 4], 1", lambda t: 6.0),
    "Matrices.frobeniusNorm": ("[time, 2; 3, 4]", lambda t: np.sqrt(t**2 + 29)),
    "Matrices.det": (
        "[0, time, 2; 3, 4, 1; time, 1, 0]",
        lambda t: 1 / np.linalg.det(inverse(t)),
    ),
    "Polynomials.evaluate": ("{1, 2, 3}, time", lambda t: t**2 + 2 * t + 3),
    "Polynomials.evaluateWithRange": (
        "{1, 2, 3}, 0.2, 0.8, time",
        lambda t: t**2 + 2 * t + 3 - (max(t, 0.8) - 0.8) ** 2 - (min(t, 0.2) - 0.2) ** 2,
    ),
    "Polynomials.derivativeValue": ("{1, 2, 3}, time", lambda t: 2 * t + 2),
    "Polynomials.secondDerivativeValue": ("{1, 2, 3}, time", lambda t: 2.0),
    "Polynomials.integralValue": ("{3, 2, 1}, time", lambda t: t**3 + t**2 + t),
    "Distributions.Uniform.density": ("time, 0.2, 0.7", lambda t: 2.0 * (0.2 <= t <= 0.7)),
    "Distributions.Uniform.cumulative": ("time, 0.2, 0.7", lambda t: np.clip(2 * t - 0.4, 0, 1)),
    "Distributions.Uniform.quantile": ("time, 0.2, 0.7", lambda t: 0.2 + t / 2),
    "Distributions.Normal.density": ("time, 0.4, 0.3", stats.norm(0.4, 0.3).pdf),
    "Distributions.Normal.cumulative": ("time, 0.4, 0.3", stats.norm(0.4, 0.3).cdf),
    "Distributions.Normal.quantile": ("time, 0.4, 0.3", stats.norm(0.4, 0.3).ppf),
    "Distributions.TruncatedNormal.density": (
        "time, 0.2, 0.8, 0.4, 0.3",
        stats.truncnorm(-2 / 3, 4 / 3, 0.4, 0.3).pdf,
    ),
    "Distributions.TruncatedNormal.cumulative": (
        "time, 0.2, 0.8, 0.4, 0.3",
        stats.truncnorm(-2 / 3, 4 / 3, 0.4, 0.3).cdf,
    ),
    "Distributions.TruncatedNormal.quantile": (
        "time, 0.2, 0.8, 0.4, 0.3",
        stats.truncnorm(-2 / 3, 4 / 3, 0.4, 0.3).ppf,
    ),
    "Distributions.Weibull.density": ("time, 0.5, 2", stats.weibull_min(2, 0, 0.5).pdf),
    "Distributions.Weibull.cumulative": ("time, 0.5, 2", stats.weibull_min(2, 0, 0.5).cdf),
    "Distributions.Weibull.quantile": ("time, 0.5, 2", stats.weibull_min(2, 0, 0.5).ppf),
    "Nonlinear.quadratureLobatto": (
        "function Modelica.Math.Nonlinear.Examples.UtilityFunctions.fun6(k = 0.6), 0, 1",
        lambda t: scipy.integrate.quad(lambda u: 1 / np.sqrt(1 - 0.36 * np.sin(u) ** 2), 0, 1)[0],
    ),
    "Nonlinear.solveOneNonlinearEquation": (
        "function Modelica.Math.Nonlinear.Examples.UtilityFunctions.fun2(w = 3), 0, 5",
        lambda t: 0.6448544035840081,
    ),
}
FIRST: dict[str, tuple[str, str, Meant]] = {  # vectors: arguments, the element read, its value
    "Vectors.normalize": ("{time, -2, 1}", "[1]", lambda t: t / np.sqrt(t**2 + 5)),
    "Vectors.reverse": ("{time, -2, 1}", "[3]", lambda t: t),
    "Vectors.sort": ("{0.5, time, 0.2}", "[2]", lambda t: sorted([0.5, t, 0.2])[1]),
    "Vectors.relNodePositions": ("5", "[3]", lambda t: 0.5),
    "Matrices.inv": ("[0, time, 2; 3, 4, 1; time, 1, 0]", "[1, 3]", lambda t: inverse(t)[0, 2]),
    "Matrices.solve": (
        "[0, time, 2; 3, 4, 1; time, 1, 0], {1, time, 2}",
        "[2]",
        lambda t: (inverse(t) @ [1, t, 2])[1],
    ),
    "Matrices.flipLeftRight": ("[time, 2; 3, 4]", "[1, 2]", lambda t: t),
    "Matrices.flipUpDown": ("[time, 2; 3, 4]", "[2, 1]", lambda t: t),
    "Matrices.eigenValues": ("[time, 2; 2, 4]", "[1, 1]", lambda t: 0.0),
    "Matrices.exp": ("[0, time; 0, 0]", "[1, 2]", lambda t: t),
    "Polynomials.derivative": ("{1, time, 3}", "[2]", lambda t: t),
    "Polynomials.integral": ("{3, time, 1}", "[2]", lambda t: t / 2),
    "Polynomials.roots": ("{1, 0, -time}", "[1, 1]", lambda t: np.sqrt(t)),
}
COUNTED: dict[str, tuple[str, Meant]] = {  # Boolean and Integer results
    "isEqual": ("floor(2*time), 1", lambda t: float(t > 0.5)),
    "isPowerOf2": ("integer(5*time) + 1", lambda t: float(int(5 * t) + 1 in (1, 2, 4))),
    "Vectors.isEqual": ("{floor(2*time), 1}, {1, 1}", lambda t: float(t > 0.5)),
    "Vectors.find": ("floor(2*time), {5, 1, 0}", lambda t: 2.0 if t > 0.5 else 3.0),
    "Matrices.isEqual": ("[floor(2*time), 1], [1, 1]", lambda t: float(t > 0.5)),
    "BooleanVectors.allTrue": ("{time > 0.5, time > 0.2}", lambda t: float(t > 0.5)),
    "BooleanVectors.andTrue": ("{time > 0.5, time > 0.2}", lambda t: float(t > 0.5)),
    "BooleanVectors.anyTrue": ("{time > 0.5, time > 0.2}", lambda t: float(t > 0.2)),
    "BooleanVectors.oneTrue": ("{time > 0.5, time > 0.2}", lambda t: float(0.2 < t < 0.5)),
    "BooleanVectors.countTrue": (
        "{time > 0.5, time > 0.2}",
        lambda t: float(t > 0.5) + float(t > 0.2),
    ),
    "BooleanVectors.firstTrueIndex": ("{time > 0.5, true}", lambda t: 1.0 if t > 0.5 else 2.0),
    "FastFourierTransform.realFFTsamplePoints": ("4, 0.2", lambda t: 200.0),
    "Random.Utilities.automaticGlobalSeed": ("", lambda t: 0.0),
}
BOOLEAN = ("isEqual", "isPowerOf2", "allTrue", "andTrue", "anyTrue", "oneTrue")


class Outcome(NamedTuple):
    """What came of one function; `error`: relative to 1 + |value|."""

    function: str
    state: str  # right, wrong, refused, stopped
    error: float | None
    said: str


def model_of(name: str) -> tuple[str, Meant]:
    """A model whose y(t) is the function's result, and what that should be."""
    path = f"Modelica.Math.{name}"
    if name in FIRST:
        given, element, meant = FIRST[name]
        sizes = ":" + ", :" * element.count(",")
        text = f"""  function chosen
    input Real v[{sizes}]; output Real y;
  algorithm
    y := v{element};
  end chosen;
  output Real y = chosen({path}({given}));"""
        return f"model M\n{text}\nend M;\n", meant
    given, meant = (COUNTED | SCALAR)[name]
    call = f"{path}({given})"
    if name.rsplit(".", 1)[-1] in BOOLEAN:
        call = f"if {call} then 1 else 0"
    return f"model M\n  output Real y = {call};\nend M;\n", meant


def tried(name: str) -> Outcome:
    text, meant = model_of(name)
    with TemporaryDirectory(prefix="math-functions-") as folder:
        try:
            found = runner.run(text, ["y"], TIMES, Path(folder))["y"]
        except InputError as refusal:
            return Outcome(name, "refused", None, str(refusal).replace(f"{folder}/", ""))
        except runner.Stopped as stop:
            return Outcome(name, "stopped", None, str(stop))
    wanted = np.array([meant(t) for t in TIMES], float)
    error = float(np.max(np.abs(found - wanted) / (1 + np.abs(wanted))))
    return Outcome(name, "right" if error <= TOLERANCE else "wrong", error, "")


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("libraries", type=Path)
    parser.add_argument("--only", default="", metavar="TEXT")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    os.environ["MODELICAPATH"] = str(options.libraries.resolve())
    outcomes = []
    for name in [n for n in (*SCALAR, *FIRST, *COUNTED) if options.only in n]:
        made = tried(name)
        made = made._replace(said=made.said.replace(f"{options.libraries.resolve()}/", ""))
        outcomes.append(made)
        error = "" if made.error is None else f"{made.error:.1e}"
        print(f"{made.state:8} {error:8} {made.function}  {made.said}", flush=True)
    counts = Counter(o.state for o in outcomes)
    print(f"{len(outcomes)} functions: " + ", ".join(f"{n} {s}" for s, n in counts.items()))
    if options.json is not None:
        options.json.write_text(json.dumps([o._asdict() for o in outcomes], indent=1) + "\n")
    return 1 if counts["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
