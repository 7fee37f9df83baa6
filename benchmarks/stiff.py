"""Stiff and high-index models: errors and internal steps beside independent solutions.

    python -m benchmarks.stiff [--only NAME] [--json FILE]

Van der Pol (mu = 1e6, time in units of mu: published values at t = 2, Hairer & Wanner), Robertson's
kinetics (published values at t = 40 s), an RC chain of 200 (closed form by its eigenvalues), a
pendulum in Cartesian coordinates (its angle by DOP853), a clutch that slips, sticks and slips again
(closed form). The error is the largest one over states and times, in parts of each state's range;
of published values, at the end.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from modelica_fmu.compiled import CompiledModel
from modelica_fmu.compiler import compile_model
from modelica_fmu.package import CSRC
from modelica_fmu.toolchain import compile_library, find_compiler, host_platform

CORE = ("core.c", "core.h", "newton.h", "implicit.h")
TOLERANCES = (1e-4, 1e-6, 1e-8)
Solution = Callable[
    [np.ndarray], np.ndarray
]  # times, s -> states of the model, (n_times, n_states)


class Example(NamedTuple):
    source: str  # Modelica
    times: np.ndarray  # s, of communication
    solution: Solution
    last_only: bool = False  # the solution is known at the last time
    explicit_step: float = 0.0  # s, the longest that is stable for classical Runge and Kutta


class Run(NamedTuple):
    example: str
    tolerance: float
    steps: int
    explicit_steps: float  # that stability alone would ask of the explicit method
    error: float
    said: str


def van_der_pol() -> Example:
    source = """model M
  Real x(start = 2, fixed = true), v(start = 0, fixed = true);
equation
  der(x) = v;
  der(v) = 1e6*((1 - x^2)*v - x);
end M;
"""
    published = np.array([[1.706167732170483, -0.8928097010247975]])
    times = np.linspace(0, 2, 201)
    return Example(source, times, lambda t: published, True, 2.785 / 3e6)


def robertson() -> Example:
    source = """model M
  Real a(start = 1, fixed = true);
  Real b(start = 0, fixed = true, nominal = 1e-5);
  Real c(start = 0, fixed = true);
equation
  der(a) = -0.04*a + 1e4*b*c;
  der(b) = 0.04*a - 1e4*b*c - 3e7*b^2;
  der(c) = 3e7*b^2;
end M;
"""
    published = np.array([[0.7158270687193941, 0.9185534764557338e-5, 0.2841637457458309]])
    return Example(source, np.linspace(0, 40, 101), lambda t: published, True, 2.785 / 2.2e3)


CELLS, RATE, OMEGA = 200, 1e6, 10.0  # of the chain: R C = 1 us; rad/s of its source


def rc_chain() -> Example:
    source = f"""model M
  parameter Integer n = {CELLS};
  parameter Real R = 1, C = {1 / RATE};
  Real v[n](each start = 0, each fixed = true);
equation
  C*der(v[1]) = (sin({OMEGA}*time) - v[1])/R - (v[1] - v[2])/R;
  for i in 2:n - 1 loop
    C*der(v[i]) = (v[i - 1] - v[i])/R - (v[i] - v[i + 1])/R;
  end for;
  C*der(v[n]) = (v[n - 1] - v[n])/R;
end M;
"""
    matrix = np.diag(np.full(CELLS, -2.0)) + np.eye(CELLS, k=1) + np.eye(CELLS, k=-1)
    matrix[-1, -1] = -1.0
    rates, modes = np.linalg.eigh(RATE * matrix)
    drive = RATE * modes[0] / (1j * OMEGA - rates)  # each mode's answer to exp(i omega t)

    def solution(t: np.ndarray) -> np.ndarray:
        forced = np.imag(drive * np.exp(1j * OMEGA * t[:, None]))
        free = -np.imag(drive) * np.exp(rates * t[:, None])
        return (forced + free) @ modes.T

    return Example(source, np.linspace(0, 0.2, 201), solution, explicit_step=2.785 / (4 * RATE))


def pendulum() -> Example:
    source = """model M
  parameter Real g = 9.81, L = 1;
  Real x(start = 1, fixed = true), y(start = 0), u(start = 0, fixed = true), w(start = 0);
  Real pull "force by mass and length";
equation
  der(x) = u;
  der(y) = w;
  der(u) = -pull*x;
  der(w) = -pull*y - g;
  x^2 + y^2 = L^2;
end M;
"""

    def solution(t: np.ndarray) -> np.ndarray:
        found = solve_ivp(
            lambda t, s: [s[1], -9.81 * np.sin(s[0])],
            (0, t[-1]),
            [np.pi / 2, 0.0],
            "DOP853",
            rtol=1e-12,
            atol=1e-12,
            t_eval=t,
        )
        angle, speed = found.y
        return np.column_stack(
            [np.sin(angle), -np.cos(angle), speed * np.cos(angle), speed * np.sin(angle)]
        )

    return Example(source, np.linspace(0, 5, 501), solution)


def clutch() -> Example:
    source = """model M "1 kg.m2 and 2 kg.m2; the clutch carries 6 N.m at most"
  parameter Real J1 = 1, J2 = 2, most = 6;
  Real w1(start = 10, fixed = true), w2(start = 0, fixed = true);
  Integer slips(start = 1, fixed = true);
  Real drive, together, torque;
equation
  drive = if time > 2 and time < 3 then 12 else 0;
  together = J2/(J1 + J2)*drive;
  torque = if slips == 0 then together else slips*most;
  J1*der(w1) = drive - torque;
  J2*der(w2) = torque;
  when pre(slips) <> 0 and pre(slips)*(w1 - w2) < -1e-9 then
    slips = 0;
    reinit(w2, w1);
  elsewhen pre(slips) == 0 and together > most then
    slips = 1;
  elsewhen pre(slips) == 0 and together < -most then
    slips = -1;
  end when;
end M;
"""
    at = [0.0, 10 / 9, 2.0, 3.0, 10 / 3, 4.0]  # s: slips, sticks, slips, is let go, sticks
    first = [10.0, 10 / 3, 10 / 3, 28 / 3, 22 / 3, 22 / 3]  # rad/s
    second = [0.0, 10 / 3, 10 / 3, 19 / 3, 22 / 3, 22 / 3]
    return Example(
        source,
        np.linspace(0, 4, 401),
        lambda t: np.column_stack([np.interp(t, at, first), np.interp(t, at, second)]),
    )


EXAMPLES: dict[str, Callable[[], Example]] = {
    "van der Pol": van_der_pol,
    "Robertson": robertson,
    "RC chain of 200": rc_chain,
    "pendulum": pendulum,
    "clutch": clutch,
}


class Counted:
    """A compiled model whose runs count their internal steps."""

    def __init__(self, compiled: CompiledModel, folder: Path) -> None:
        texts = {name: (CSRC / name).read_text(encoding="utf-8") for name in CORE}
        texts["stiff.c"] = Path(__file__).with_suffix(".c").read_text(encoding="utf-8")
        for name, text in (texts | compiled.sources).items():
            (folder / name).write_text(text, encoding="utf-8")
        target = host_platform()
        names = ["core.c", "model.c", "stiff.c"]
        built = compile_library(
            find_compiler(target), target, folder, names, f"stiff{target.extension}"
        )
        self.names = [compiled.variables[v].name for v in compiled.states]
        places = {v.name: i for i, v in enumerate(compiled.variables)}
        self.settings = [places["solver.tolerance"], places["solver.max_step"]]
        self.function = ctypes.CDLL(str(built)).run_counted

    def run(
        self, times: np.ndarray, tolerance: float, longest: float = 1.0
    ) -> tuple[np.ndarray, int, str]:
        """States by time and name, internal steps, the solver's last message. longest: s, of the
        internal steps.
        """
        states = np.zeros((len(times), len(self.names)))
        steps, said = ctypes.c_ulong(), ctypes.create_string_buffer(256)
        double = ctypes.POINTER(ctypes.c_double)
        failed = self.function(
            (ctypes.c_uint * 2)(*self.settings),
            (ctypes.c_double * 2)(tolerance, longest),
            len(times),
            np.ascontiguousarray(times).ctypes.data_as(double),
            states.ctypes.data_as(double),
            ctypes.byref(steps),
            said,
        )
        text = said.value.decode()
        if failed:
            raise RuntimeError(text)
        return states, int(steps.value), text


def counted_of(source: str, folder: Path) -> Counted:
    """The model M of a Modelica text, compiled in a folder."""
    file = folder / "M.mo"
    file.write_text(source, encoding="utf-8")
    return Counted(compile_model(file, "M"), folder)


def measured(name: str, tolerances: Sequence[float] = TOLERANCES) -> list[Run]:
    example = EXAMPLES[name]()
    wanted = example.solution(example.times)
    needed = example.times[-1] / example.explicit_step if example.explicit_step else 0.0
    runs = []
    with TemporaryDirectory(prefix="stiff-") as folder:
        counted = counted_of(example.source, Path(folder))
        for tolerance in tolerances:
            states, steps, said = counted.run(example.times, tolerance)
            size = np.abs(wanted[-1]) if example.last_only else np.ptp(wanted, axis=0)
            difference = np.abs((states[-1:] if example.last_only else states) - wanted)
            error = float(np.max(difference / size))
            runs.append(Run(name, tolerance, steps, needed, error, said))
    return runs


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--only", choices=EXAMPLES)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    runs: list[Run] = []
    print("| model | tolerance | internal steps | stable explicit steps | error |")
    print("|---|---|---|---|---|")
    for name in [options.only] if options.only else EXAMPLES:
        for made in measured(name):
            runs.append(made)
            needed = f"{made.explicit_steps:.1e}" if made.explicit_steps else ""
            cells = f"{made.tolerance:.0e} | {made.steps} | {needed} | {made.error:.1e}"
            print(f"| {made.example} | {cells} |", flush=True)
    if options.json is not None:
        options.json.write_text(json.dumps([r._asdict() for r in runs], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
