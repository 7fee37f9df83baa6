"""How honest the FMU's own solver is: `python -m benchmarks.solver_check [--json FILE]`.

(a) Reference: the FMU's derivatives and event indicators, through model exchange, integrated by
scipy's DOP853 at rtol 1e-11 with the
    events located on its dense output: difference of the trajectories in sensor sigmas, and of the
        instants of events.
(b) Convergence: solver.max_step halved with error control off; between events the error against the
reference falls 16-fold.
(c) The default step against a converged one, on every log from beginning to end.
(d) fmpy's CVode on the same model-exchange FMU, FMI 2.0 and 3.0, against the reference.

The commands are those recorded in the nominal campaign, replayed in the open; without it a
programme of commands of the same kind.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import brentq

from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import LogSetup, read_campaign
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.plant import CLAMPS, COMMANDS, OUTPUTS, plant_parameters
from pyfmi_runner.sensors import SIGMA

ROOT = Path(__file__).resolve().parents[1]

Array = NDArray[np.float64]
CAMPAIGN = ROOT.parent / "shared" / "campaigns" / "nominal"
PERIOD = 1e-3  # s
INPUTS = (*COMMANDS, *CLAMPS)
MODES = (  # Booleans whose changes are the events compared
    "axis_x.friction.stick",
    "axis_z.friction.stick",
    "contact.touching",
    "axis_x.at_high",
    "axis_x.at_low",
    "axis_z.at_high",
    "axis_z.at_low",
)
LAWS = {"vdfm": 2, "ddfm": 3, "lugre": 4}  # Types.FrictionLaw, on z
CONVERGED = {"solver.max_step": 2.5e-5, "solver.tolerance": 1e6}
STEPS = (1e-3, 5e-4, 2.5e-4, 1.25e-4)  # s
CONVERGENCE = (
    ("free_motion", "vdfm"),
    ("free_motion", "ddfm"),
    ("contact_steps", "vdfm"),
    ("contact_steps", "ddfm"),
    ("contact_steps", "lugre"),
)
CVODE = (
    ("contact_steps", "vdfm", 2.0),
    ("contact_steps", "ddfm", 2.0),
    ("free_motion", "vdfm", 3.0),
    ("contour_straight", "ddfm", 4.0),
)
CVODE_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Replay:
    """A log's commands and the FMU parameters of its set-up."""

    name: str
    parameters: dict[str, float]
    inputs: Array  # (n, 4): u_x, u_z [V], clamp_x, clamp_z, held over [t_k, t_k + 1 ms)

    def with_law(self, law: str) -> Replay:
        """The same with another friction law on z."""
        return replace(self, parameters=self.parameters | {"axis_z.friction.law": LAWS[law]})

    def until(self, stop: float) -> Replay:
        return replace(self, inputs=self.inputs[: round(stop / PERIOD)])

    def start(self) -> dict[str, Any]:
        """Parameters and first inputs."""
        return self.parameters | dict(zip(INPUTS, typed(self.inputs[0]), strict=True))


@dataclass
class Trajectory:
    outputs: Array  # (n + 1, 8), at the window's start and after each sample
    modes: NDArray[np.bool_]  # (n + 1, len(MODES))
    events: list[tuple[float, int, bool]] = field(
        default_factory=list
    )  # (s, index into MODES, new value)


def replays(campaign: Path = CAMPAIGN) -> dict[str, Replay]:
    """The campaign's logs, or the own programme where there is none."""
    if not campaign.is_dir():
        return programme()
    result = {}
    for name, run in read_campaign(campaign).logs.items():
        clamps = [run.setup.clamp_signal(axis, run.log.time) for axis in "xz"]
        inputs = np.column_stack([*(run.log[u] for u in COMMANDS), *clamps]).astype(np.float64)
        result[name] = Replay(name, plant_parameters(run.setup), inputs)
    return result


def programme() -> dict[str, Replay]:
    """Valve steps, free motion, contact steps and a contouring run without a controller."""
    time = np.arange(14_000) * PERIOD

    def stairs(*values: float, each: float) -> Array:
        return np.array(values)[np.minimum((time / each).astype(int), len(values) - 1)]

    free, fixed = np.zeros_like(time), np.ones_like(time)
    valve = stairs(0.65, 0.9, 1.15, each=1.5)
    push = 0.735 + 0.3 + 0.1 * np.sin(40 * time)
    contour = np.where(time < 7.0, 0.0, 0.80 + 0.02 * np.sin(30 * time))
    clamp = (time < 7.0).astype(float)
    pull = 0.8 + 0.15 * np.sin(7 * time)
    tables = {
        "valve_steps_500": (LogSetup(start_x=0.5, start_z=0.05), valve, valve + 0.2, fixed, fixed),
        "free_motion": (
            LogSetup(),
            np.where(time < 1, 0.0, pull),
            np.where(time < 1, 0.0, push),
            free,
            free,
        ),
        "contact_steps": (
            LogSetup(workpiece="straight", standoff=0.04),
            free,
            stairs(1.05, 0.8, 0.9, 1.0, 1.1, each=1.0),
            fixed,
            free,
        ),
        "contour_straight": (
            LogSetup(workpiece="straight", standoff=0.04),
            contour,
            1.05 + 0.02 * np.sin(50 * time),
            clamp,
            free,
        ),
        "contour_curved": (
            LogSetup(workpiece="curved", standoff=0.09),
            contour,
            1.05 + 0.02 * np.sin(50 * time),
            clamp,
            free,
        ),
    }
    return {
        n: Replay(n, plant_parameters(setup), np.column_stack(columns))
        for n, (setup, *columns) in tables.items()
    }


# ---- the FMU's own solver


def own_solver(
    file: FmuFile, run: Replay, settings: dict[str, float] | None = None, modes: bool = False
) -> Trajectory:
    """Co-simulation, one step a sample. With `modes` also the instants of events, by bisecting the
    length of the step they fall into.
    """
    inputs, n = run.inputs, len(run.inputs)
    outputs, seen, events = (
        np.empty((n + 1, len(OUTPUTS))),
        np.zeros((n + 1, len(MODES)), dtype=bool),
        [],
    )
    with FmuSession(file, "cs", run.start() | (settings or {})) as fmu:
        outputs[0] = fmu.get(OUTPUTS)
        seen[0] = fmu.get(MODES) if modes else False
        saved = None
        for k in range(n):
            if k == 0 or np.any(inputs[k] != inputs[k - 1]):
                fmu.set(INPUTS, typed(inputs[k]))
            saved = fmu.save_state(saved) if modes else None
            fmu.step(PERIOD, time=k * PERIOD)
            outputs[k + 1] = fmu.get(OUTPUTS)
            if saved:
                seen[k + 1] = fmu.get(MODES)
                for i in np.flatnonzero(seen[k + 1] != seen[k]):
                    events.append(
                        (
                            k * PERIOD + _instant(fmu, saved, int(i), bool(seen[k, i])),
                            int(i),
                            bool(seen[k + 1, i]),
                        )
                    )
        return Trajectory(outputs, seen, events)


def _instant(fmu: FmuSession, saved: Any, mode: int, before: bool) -> float:
    """How far into the step from `saved` a mode changes; the session is left at the end of that
    step.
    """
    low, high = 0.0, PERIOD
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        fmu.load_state(saved)
        fmu.step(middle)
        if bool(fmu.get(MODES[mode])) == before:
            low = middle
        else:
            high = middle
    fmu.load_state(saved)
    fmu.step(PERIOD)
    return high


def typed(row: Array) -> list[float | bool]:
    return [float(row[0]), float(row[1]), bool(row[2]), bool(row[3])]


# ---- the reference


def reference(file: FmuFile, run: Replay, rtol: float = 1e-11) -> Trajectory:
    """DOP853 on the FMU's derivatives; an event is where an indicator changes sign on the dense
    output.
    """
    inputs, n = run.inputs, len(run.inputs)
    result = Trajectory(np.empty((n + 1, len(OUTPUTS))), np.zeros((n + 1, len(MODES)), dtype=bool))
    with FmuSession(file, "me", run.start()) as fmu:
        fmu.update_discrete()
        fmu.enter_continuous()
        result.outputs[0], result.modes[0] = fmu.get(OUTPUTS), fmu.get(MODES)
        modes = result.modes[0]
        atol = 1e-2 * rtol * fmu.nominals()
        first = 0
        while first < n:  # stretches of constant inputs
            last = first + 1
            while last < n and np.array_equal(inputs[last], inputs[first]):
                last += 1
            _event(fmu, typed(inputs[first]))
            for k in range(first, last):
                for instant in _integrate(fmu, k * PERIOD, (k + 1) * PERIOD, rtol, atol):
                    now = np.asarray(fmu.get(MODES), dtype=bool)
                    result.events += [
                        (instant, int(i), bool(now[i])) for i in np.flatnonzero(now != modes)
                    ]
                    modes = now
                result.outputs[k + 1], result.modes[k + 1] = fmu.get(OUTPUTS), modes
            first = last
    return result


def _event(fmu: FmuSession, inputs: list[float | bool] | None = None) -> None:
    fmu.enter_event()
    if inputs:
        fmu.set(INPUTS, inputs)
    fmu.update_discrete()
    fmu.enter_continuous()


def _integrate(
    fmu: FmuSession, time: float, end: float, rtol: float, atol: Array
) -> Iterator[float]:
    """To `end`, yielding after each event on the way."""

    def put(t: float, x: Array) -> None:
        fmu.set_time(t)
        fmu.set_states(x)

    def rates(t: float, x: Array) -> Array:
        put(t, x)
        return fmu.derivatives()

    while time < end:
        fmu.set_time(time)
        before = fmu.indicators()
        whole: Any = {"rtol": rtol, "atol": atol, "first_step": end - time}
        solver = DOP853(rates, time, fmu.states(), end, **whole)
        while solver.status == "running":
            solver.step()
            put(solver.t, solver.y)
            after = fmu.indicators()
            crossed = np.flatnonzero((before > 0) != (after > 0))
            if len(crossed):
                break
        else:
            fmu.completed_step()
            return
        dense = solver.dense_output()

        def indicator(t: float, i: int, dense: Any = dense) -> float:
            put(t, dense(t))
            return float(fmu.indicators()[i])

        roots = [
            brentq(indicator, solver.t_old, solver.t, args=(i,), xtol=1e-13, rtol=1e-15)
            for i in crossed
            if before[i] != 0
        ]
        if not roots:  # an indicator that stood at zero and left it
            roots = [solver.t]
        time = min(min(roots) + 1e-12, end)
        put(time, dense(time))
        fmu.completed_step()
        _event(fmu)
        yield time


# ---- the figures


def in_sigma(a: Array, b: Array) -> tuple[float, str]:
    """Largest difference and the output in which it occurs."""
    worst = np.max(np.abs(a - b), axis=0) / np.array(SIGMA)
    return float(worst.max()), OUTPUTS[int(worst.argmax())]


def event_gap(own: Trajectory, ref: Trajectory) -> tuple[int, float]:
    """Events compared and the largest difference of their instants, s; infinite where they do not
    pair up.

    Leaving an end stop is left out: the position leaves it from rest, as t^3, so the instant at
    which it has left the indicator's margin of 1e-10 m is undefined to 0.4 ms; break-away itself is
    an event of the force balance.
    """
    pairs = []
    for trajectory in (own, ref):
        kept = [
            e for e in trajectory.events if e[2] or not MODES[e[1]].endswith(("at_high", "at_low"))
        ]
        pairs.append(sorted(kept, key=lambda e: (e[1], e[0])))
    if [e[1:] for e in pairs[0]] != [e[1:] for e in pairs[1]]:
        return len(pairs[1]), float("inf")
    return len(pairs[0]), max((abs(a[0] - b[0]) for a, b in zip(*pairs, strict=True)), default=0.0)


def accuracy(file: FmuFile, run: Replay) -> dict[str, Any]:
    """Figures (a) and (c) of one log."""
    own, ref = own_solver(file, run, modes=True), reference(file, run)
    error, where = in_sigma(own.outputs, ref.outputs)
    step, step_where = in_sigma(own.outputs, own_solver(file, run, CONVERGED).outputs)
    events, gap = event_gap(own, ref)
    return {
        "error": error,
        "where": where,
        "events": events,
        "gap": gap,
        "step_error": step,
        "step_where": step_where,
    }


def convergence(file: FmuFile, run: Replay, ref: Trajectory | None = None) -> dict[str, Any]:
    """Figure (b): errors at STEPS against the reference, their ratios while they exceed tenfold
    what event location leaves (floor).
    """
    ref = ref or reference(file, run)
    errors = [
        in_sigma(
            own_solver(file, run, {"solver.max_step": h, "solver.tolerance": 1e6}).outputs,
            ref.outputs,
        )[0]
        for h in STEPS
    ]
    floor = in_sigma(own_solver(file, run, CONVERGED).outputs, ref.outputs)[0]
    ratios = [a / b for a, b in pairwise(errors) if b > 10 * floor]
    return {"errors": errors, "floor": floor, "ratios": ratios}


def cvode(path: Path, run: Replay, tolerance: float = CVODE_TOLERANCE) -> Array:
    """Outputs by fmpy's CVode, (n + 1, 8).

    Raises ValueError if the clamps change: fmpy sets Boolean inputs in continuous time, too, which
    FMI forbids.
    """
    import fmpy

    if np.any(run.inputs[:, 2:] != run.inputs[0, 2:]):
        raise ValueError(f"the clamps of {run.name} change")
    rows = [(0.0, *run.inputs[0, :2])]
    for k in (
        np.flatnonzero(np.any(np.diff(run.inputs, axis=0) != 0, axis=1)) + 1
    ):  # a jump is two rows of the same time
        rows += [(k * PERIOD, *run.inputs[k - 1, :2]), (k * PERIOD, *run.inputs[k, :2])]
    rows.append((len(run.inputs) * PERIOD, *run.inputs[-1, :2]))
    signals = np.array(rows, dtype=[(name, float) for name in ("time", *COMMANDS)])
    with contextlib.redirect_stdout(
        io.StringIO()
    ):  # fmpy names every input that keeps its start value
        result = fmpy.simulate_fmu(
            str(path),
            fmi_type="ModelExchange",
            solver="CVode",
            relative_tolerance=tolerance,
            start_values=run.start(),
            input=signals,
            stop_time=len(run.inputs) * PERIOD,
            output_interval=PERIOD,
            output=list(OUTPUTS),
            record_events=False,
        )
    return np.column_stack([result[name] for name in OUTPUTS])


def figures(campaign: Path = CAMPAIGN) -> dict[str, Any]:
    """All figures; runs in the order printed."""
    logs = replays(campaign)
    with tempfile.TemporaryDirectory() as folder:
        paths = {fmi: build_fmu(fmi=fmi, out=Path(folder)).path for fmi in ("2.0", "3.0")}
        file = FmuFile.read(paths["2.0"])
        source = str(campaign) if campaign.is_dir() else "own programme"
        table: dict[str, Any] = {"campaign": source, "accuracy": {}, "convergence": {}, "cvode": {}}
        for name, run in logs.items():
            clamped = bool(np.all(run.inputs[:, 2:]))  # then friction does nothing
            for law in ("vdfm",) if clamped else ("vdfm", "ddfm"):
                table["accuracy"][f"{name} {law}"] = accuracy(
                    file, run.with_law(law).until(5.0) if clamped else run.with_law(law)
                )
        for name, law in CONVERGENCE:
            table["convergence"][f"{name} {law}"] = convergence(
                file, logs[name].with_law(law).until(4.0)
            )
        for name, law, stop in CVODE:
            run = logs[name].with_law(law).until(stop)
            ref = reference(file, run)
            for fmi, path in paths.items():
                error, where = in_sigma(cvode(path, run), ref.outputs)
                table["cvode"][f"{name} {law} 0..{stop:g} s, FMI {fmi}"] = {
                    "error": error,
                    "where": where,
                }
    return table


def printed(table: dict[str, Any]) -> str:
    lines = [
        f"commands: {table['campaign']}; errors are the largest over the log, in sensor sigma",
        "",
    ]
    lines.append(
        f"{'(a, c) log, law on z':28} {'vs DOP853 1e-11':>20} {'events':>7} "
        f"{'instants, us':>13} {'vs 1/40 of the step':>22}"
    )
    for name, row in table["accuracy"].items():
        error, step = (
            f"{row['error']:.1e} ({row['where']})",
            f"{row['step_error']:.1e} ({row['step_where']})",
        )
        lines.append(
            f"{name:28} {error:>20} {row['events']:7d} {1e6 * row['gap']:13.4f} {step:>22}"
        )
    steps = " ".join(f"{1e3 * h:>7g} ms" for h in STEPS)
    lines += ["", f"{'(b) log, law on z, 0..4 s':28} {steps} {'floor':>9}   ratio per halving"]
    for name, row in table["convergence"].items():
        ratios = " ".join(f"{r:.1f}" for r in row["ratios"]) or "at the floor"
        lines.append(
            f"{name:28} "
            + " ".join(f"{e:10.1e}" for e in row["errors"])
            + f" {row['floor']:9.1e}   {ratios}"
        )
    lines += ["", f"(d) fmpy's CVode, relative tolerance {CVODE_TOLERANCE:g}, vs DOP853"]
    lines += [
        f"{name:48} {row['error']:.1e} ({row['where']})" for name, row in table["cvode"].items()
    ]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Accuracy of the FMU's own solver.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there, too")
    parser.add_argument(
        "--campaign",
        type=Path,
        default=CAMPAIGN,
        metavar="FOLDER",
        help="measuring campaign whose commands are replayed",
    )
    options = parser.parse_args(arguments)
    table = figures(options.campaign)
    print(printed(table))
    if options.json:
        options.json.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
