"""Everything that a campaign says of the plant: the thesis' own tests and the joint fit (App. B, C,
sections 3.2, 4.1).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pneugantry.analysis.identify.breakaway import breakaways
from pneugantry.analysis.identify.edge import edge_test
from pneugantry.analysis.identify.friction_tests import KnownPlant, RuleResult, judged
from pneugantry.analysis.identify.hysteresis import Hysteresis, hysteresis
from pneugantry.analysis.identify.interval import Line
from pneugantry.analysis.identify.joint import JointFit, fit_logs
from pneugantry.analysis.identify.motion import sliding
from pneugantry.analysis.identify.parameters import CABLE_TOLERANCE, DDFM, Coordinates, Unknown
from pneugantry.analysis.identify.replayed import Plants, replayed_logs
from pneugantry.analysis.identify.sensor_noise import Noise, sensor_noise
from pneugantry.analysis.identify.signals import free_signals
from pneugantry.analysis.identify.valve import Comparison, Step, comparisons, steady_line, steps
from pneugantry.analysis.identify.valve_fit import ValveFit, valve_fit
from pyfmi_runner.campaign import Campaign
from pyfmi_runner.fmu import FmuFile

__all__ = ["Identification", "Start", "fit_campaign", "identify", "starting_point"]

Array = NDArray[np.float64]
Values = dict[str, float]
SHUT = 2.0  # N, actuator force below which a valve counts as shut throughout


@dataclass(frozen=True, eq=False)
class Start:
    """What the blocks' own tests give: parameters of the FMU, those of the VDFM and of the DDFM
    where the hysteresis shows them.
    """

    values: Values
    hysteresis: Hysteresis | None


@dataclass(frozen=True, eq=False)
class Identification:
    """Tests and fit of one campaign. steps, lines, lags and comparisons are by axis."""

    campaign: Campaign
    steps: Mapping[str, list[Step]]
    lines: Mapping[str, Line | None]
    lags: Mapping[str, list[ValveFit]]  # one fit to each log
    comparisons: Mapping[str, list[Comparison]]
    noise: list[Noise]
    hysteresis: Hysteresis | None
    joint: JointFit
    rules: list[RuleResult]
    notes: list[str]

    def reason(self, unknown: Unknown) -> str:
        """Why a parameter is not told by the logs."""
        return reason(self.campaign, unknown)


def starting_point(campaign: Campaign, file: FmuFile) -> Start:
    """Parameters by block, from measured signals on both sides of it: exact, and free of missed
    break-aways.
    """
    start = {
        name: float(v.start)
        for name, v in file.variables.items()
        if v.causality == "parameter" and isinstance(v.start, int | float)
    }
    values: Values = {}
    found: Hysteresis | None = None
    for axis in "xz":
        values |= _valve_start(campaign, start, axis)
        motion, cable = (
            sliding(free_signals(campaign, axis), start[f"axis_{axis}.F_w"]),
            start[f"axis_{axis}.F_w"],
        )
        if motion is None or motion.m.value <= 0 or motion.C.value <= 0:
            continue
        cable = motion.F_w.value if motion.F_w else cable
        m, C, prefix = motion.m.value, motion.C.value, f"axis_{axis}."
        values |= {
            prefix + "m": m,
            prefix + "C": C,
            prefix + "F_w": cable,
            prefix + "friction.F_d": motion.F_d.value,
        }
        starts = breakaways(free_signals(campaign, axis), m, C, cable)
        pushed = [b.corrected for b in starts if b.way == start[f"valve_{axis}.direction"]]
        if pushed:
            values[prefix + "friction.F_s"] = float(np.median(pushed))
        if axis == "z":
            found = hysteresis(campaign, m, C, cable)
            if found is not None:
                values |= {
                    prefix + "friction.beta": found.beta,
                    prefix + "friction.sigma": found.sigma,
                }
    edge = edge_test(campaign)
    if edge is not None:
        values |= {"contact.K_c": edge.K_c.value, "contact.C_c": edge.C_c.value}
    return Start(values, found)


def _valve_start(campaign: Campaign, start: Mapping[str, float], axis: str) -> Values:
    names = [f"valve_{axis}.{p}" for p in ("K", "u_0", "tau")]
    guess = tuple(start[name] for name in names)
    fit = valve_fit(
        list(campaign),
        axis,
        start[f"valve_{axis}.direction"],
        guess,  # type: ignore[arg-type]
        start[f"valve_{axis}.f_max"],
    )
    return (
        {}
        if fit is None
        else dict(zip(names, (fit.K.value, fit.u_0.value, fit.tau.value), strict=True))
    )


def fit_campaign(
    campaign: Campaign,
    file: FmuFile,
    plants: Plants,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Start, JointFit]:
    """The joint fit from the blocks' own tests. Raises RunError where the FMU fails."""
    start = starting_point(campaign, file)
    candidates = [Coordinates(file)]
    if start.hysteresis is not None and start.hysteresis.presliding:
        candidates.append(Coordinates(file, {"z": DDFM}))
    best = candidates[0]
    if len(candidates) > 1:
        best = min(
            candidates, key=lambda coordinates: _misfit(campaign, coordinates, plants, start.values)
        )
    return start, fit_logs(
        replayed_logs(campaign, best, plants), plants, best, start.values, progress
    )


def _misfit(campaign: Campaign, coordinates: Coordinates, plants: Plants, values: Values) -> float:
    """Sum of squares over the open-loop logs at the starting point: which friction law comes
    closer?
    """
    logs = [
        log for log in replayed_logs(campaign, coordinates, plants) if log.run.setup.loop == "open"
    ]
    theta = coordinates.theta(values)
    return float(sum(np.sum(log.residual(theta) ** 2) for log in logs))


def identify(
    campaign: Campaign, file: FmuFile, progress: Callable[[str], None] = lambda _: None
) -> Identification:
    """All tests and the joint fit. Raises RunError where the FMU fails."""
    with ThreadPoolExecutor(1) as beside, Plants(file) as plants:
        told = beside.submit(_valve_tests, campaign, file)  # while the fit waits for its replays
        progress("tests by block")
        start, joint = fit_campaign(campaign, file, plants, progress)
        progress("bias of the rules")
        logs = replayed_logs(campaign, joint.coordinates, plants)
        simulated = {
            log.name: plants.drive(log.run.setup, log.commands, log.run.log.time, joint.values)
            for log in logs
        }
        valves, noise = told.result()
        biased = judged(campaign, simulated, _known(joint), plants.side_by_side)
    return Identification(
        campaign,
        valves.steps,
        {axis: steady_line(valves.steps[axis]) for axis in "xz"},
        valves.lags,
        {axis: comparisons(valves.steps[axis]) for axis in "xz"},
        noise,
        start.hysteresis,
        joint,
        biased,
        list(_notes(campaign, joint, start.hysteresis)),
    )


@dataclass(frozen=True, eq=False)
class _ValveTests:
    """By axis: every step, and one fit to each log of steps."""

    steps: dict[str, list[Step]]
    lags: dict[str, list[ValveFit]]


def _valve_tests(campaign: Campaign, file: FmuFile) -> tuple[_ValveTests, list[Noise]]:
    """Tests that need no replay."""
    found = {axis: steps(campaign, axis) for axis in "xz"}
    lags = {axis: list(_lags_by_log(campaign, file, axis, found[axis])) for axis in "xz"}
    return _ValveTests(found, lags), sensor_noise(campaign)


def _known(joint: JointFit) -> KnownPlant:
    """What the rules are judged by: the fitted plant."""
    return KnownPlant(
        {(u.symbol, u.axis): joint.values[u.name] for u in joint.coordinates.unknowns},
        joint.coordinates.direction,
        {axis: joint.values[f"axis_{axis}.F_w"] for axis in "xz"},
    )


def _lags_by_log(
    campaign: Campaign, file: FmuFile, axis: str, found: list[Step]
) -> Iterator[ValveFit]:
    """K, u_0, tau of each log of steps by itself: does the lag depend on position?"""
    start = {
        p: float(file.variables[f"valve_{axis}.{p}"].start or 0.0)
        for p in ("K", "u_0", "tau", "direction", "f_max")
    }
    for name in dict.fromkeys(step.log for step in found):
        fit = valve_fit(
            [campaign.logs[name]],
            axis,
            start["direction"],
            (start["K"], start["u_0"], start["tau"]),
            start["f_max"],
        )
        if fit is not None:
            yield fit


def reason(campaign: Campaign, unknown: Unknown) -> str:
    """Why these logs do not tell a parameter."""
    axis = unknown.axis or "z"
    if unknown.name.startswith("valve_"):
        force = max(float(np.abs(run.log[f"f_a{axis}"]).max()) for run in campaign)
        if force < SHUT:
            return f"the {axis} valve stays shut"
        return f"u_{axis} does not move enough to tell K, u_0 and tau apart"
    free = any(not run.setup.clamp_signal(axis, run.log.time).all() for run in campaign)
    if not unknown.axis:
        if all(run.setup.workpiece == "none" for run in campaign):
            return "nothing is touched"
        return "z is clamped" if not free else "the contact is not moved enough"
    if not free:
        return f"{axis} is clamped"
    travel = max(float(np.ptp(run.log[axis])) for run in campaign)
    return (
        f"{axis} hardly moves" if travel < 5e-3 else f"{axis} does not move in a way that shows it"
    )


def _notes(campaign: Campaign, joint: JointFit, found: Hysteresis | None) -> Iterator[str]:
    for axis in "xz":
        if joint.sources[f"axis_{axis}.F_w"] == "sheet":
            yield (
                f"F_w of {axis} cannot be told from its friction: {axis} is never pushed "
                f"both ways, and the logs show only F_s and F_d"
                f" together with it. It is taken from the plant sheet, "
                f"+-{100 * CABLE_TOLERANCE:g} % RMS, and they rest on it."
            )
    shut = [
        axis for axis in "xz" if max(float(run.log[f"u_{axis}"].max()) for run in campaign) < 2.0
    ]
    if shut:
        yield f"f_max of {' and '.join(shut)} is never reached, and not identified"
    if joint.coordinates.laws.get("z") == DDFM and found is not None:
        yield (
            "z creeps before it slides: fitted with the DDFM (beta, sigma) in place of "
            "F_s, F_d and v_th;"
            f" its law leaves {found.rms:.2f} N of the measured hysteresis"
        )
    elif found is not None:
        yield (
            "z does not creep before it slides, as far as the sensors see: no DDFM here, "
            "beta and sigma are not identified"
        )
    if not joint.fits:
        worst = max(joint.gaps, key=lambda name: joint.gaps[name])
        yield (
            f"the plant does not replay these logs (gap {joint.gaps[worst]:.3g} on "
            f"{worst}): no interval is given, and a parameter may"
            " stand for something else; see `pneugantry diagnose`"
        )
