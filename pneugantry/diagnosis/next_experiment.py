"""The experiment that would tell two hypotheses apart: of a few that the rig can do, the one in
which their plants differ most.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from modelica_fmu.errors import InputError, RunError
from pneugantry.diagnosis.confirm import Augmented, sensed_outputs
from pyfmi_runner.campaign import Campaign, LogSetup, scenario_setup
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import STROKE_Z
from pyfmi_runner.own_controller import is_known_controller
from pyfmi_runner.replay import SIGMAS, Replayer
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario, scenario_text, short_phases
from pyfmi_runner.sensors import SensorParams

__all__ = ["candidates", "next_experiment"]

MOST_FORCE = 150.0  # N, contact force that the rig may see
OPEN = 8.0  # s
# times the noise: beyond it a difference counts no more, or one missed break-away would choose
MOST = 10.0
TELLING = 1.2  # separation below which an experiment is not worth its time


def next_experiment(
    campaign: Campaign,
    gantry: FmuFile,
    first: Mapping[str, float],
    second: Mapping[str, float],
    keys: Sequence[Sequence[str]],
) -> dict[str, Any] | None:
    """The candidate in which the two fitted plants differ most (docs/reference/gap.md); None
    where none of them tells.

    `first`, `second`: fitted values by name; `keys`: the effects of each. The separation is the RMS
    over channels and time of the difference of what the sensors would say for the same commands, in
    units of their noise, no more than MOST of them at any instant.
    """
    plants = [Augmented.of(values) for values in (first, second)]
    best: tuple[float, str, Scenario] | None = None
    with Replayer(gantry) as replayer:
        for what, scenario in candidates(campaign):
            separation = _separation(gantry, replayer, scenario, plants)
            if separation is not None and (best is None or separation > best[0]):
                best = separation, what, scenario
    if best is None or best[0] < TELLING:
        return None
    separation, what, scenario = best
    names = " and ".join(" + ".join(k) or "no effect" for k in keys)
    return {
        "what": f"{what}: {names} then differ by {separation:.2g} times the sensors' noise (RMS "
        f"over all channels)",
        "scenario": scenario_text(replace(scenario, sensors=SensorParams())),
        "separates": [list(k) for k in keys],
        "separation": separation,
    }


def candidates(campaign: Campaign) -> Iterator[tuple[str, Scenario]]:
    """Experiments in words and as scenarios, with the controller and gains of the campaign's own
    closed-loop logs.
    """
    base = Scenario(sensors=SensorParams(noise=False))
    closed = [
        run.setup
        for run in campaign
        if run.setup.loop == "closed"
        and run.setup.controller is not None
        and is_known_controller(run.setup.controller)
    ]
    if closed:
        base = _with_controller(base, closed[-1])
    for workpiece in ("straight", "incline_16", "incline_30", "curved"):
        phases = short_phases(workpiece)
        for force, speed in ((base.f_nd, base.v_td), (60.0, -0.06), (12.0, -0.03)):
            what = f"track the {workpiece} edge with {force:g} N at {abs(1e3 * speed):g} mm/s"
            yield (
                what,
                replace(
                    base,
                    name="next",
                    workpiece=workpiece,
                    standoff=None,
                    f_nd=force,
                    v_td=speed,
                    phases=phases,
                ),
            )
    phases = {
        "approach": (0.0, OPEN),
        "contact": (OPEN, OPEN + 0.01),
        "contour": (OPEN + 0.01, OPEN + 0.02),
    }  # open loop
    for u_x, u_z in ((0.9, 1.1), (1.2, 1.4), (2.0, 2.0)):
        step = replace(
            base,
            name="next",
            workpiece="straight",
            phases=phases,
            approach_u_x=u_x,
            approach_u_z=u_z,
        )
        what = (
            f"with both pistons clamped, step the commands from 0 to {u_x:g} V (x) and "
            f"{u_z:g} V (z) for {OPEN:g} s"
        )
        yield what, replace(step, clamped=("x", "z"), start_x=0.5, start_z=0.05, standoff=0.09)
        what = (
            f"without a workpiece, let both axes run free at {u_x:g} V (x) and {u_z:g} V (z) "
            f"for {OPEN:g} s"
        )
        yield what, replace(step, clamped=(), standoff=STROKE_Z)


def _with_controller(base: Scenario, setup: LogSetup) -> Scenario:
    gains = setup.gains if setup.gains is not None else base.gains
    force, speed = setup.f_nd or base.f_nd, setup.v_td or base.v_td
    return replace(
        base,
        controller=setup.controller or base.controller,
        gains=gains,
        f_nd=float(force),
        v_td=float(speed),
    )


def _separation(
    gantry: FmuFile, replayer: Replayer, scenario: Scenario, plants: Sequence[Augmented]
) -> float | None:
    """RMS difference of the two plants for the commands that the first one sees; None where the
    experiment cannot be done.
    """
    try:
        run = run_scenario(replace(scenario, plant=dict(plants[0].plant)), gantry)
        if run.outcome != "done" or np.hypot(run.log["f_x"], run.log["f_z"]).max() > MOST_FORCE:
            return None
        commands, setup = (
            np.column_stack([run.log["u_x"], run.log["u_z"]]),
            scenario_setup(scenario),
        )
        said = [
            sensed_outputs(replayer.drive(setup, commands, run.log.time, p.plant), p.sensors)
            for p in plants
        ]
    except (InputError, RunError):
        return None
    return float(np.sqrt(np.mean(np.minimum(np.abs(said[0] - said[1]) / SIGMAS, MOST) ** 2)))
