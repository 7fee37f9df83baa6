"""Both loops: the same bits, replay from a saved state, a run that fails or is cancelled,
provenance.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.extending import register_jitable

from controllers.catalogue import controller_names
from controllers.interface import Command, Controller, Reference, Sense
from controllers.pi_fv import PiFv
from modelica_fmu.errors import InputError
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.log import MEASURED, Log, read_log, write_log
from pyfmi_runner.plant import COMMANDS, OUTPUTS
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario, scenario_from
from pyfmi_runner.sensors import SensorParams
from pyfmi_runner.timing import LoopTiming

# In contact from 0.3 s on: the piston starts 2 mm off the edge
SHORT = Scenario(
    name="short",
    workpiece="straight",
    start_z=0.038,
    seed=3,
    phases={"approach": (0.0, 0.4), "contact": (0.4, 0.7), "contour": (0.7, 1.2)},
)
LONGER = {"approach": (0.0, 0.4), "contact": (0.4, 0.7), "contour": (0.7, 3.0)}
RETREAT = replace(SHORT, phases={**SHORT.phases, "retreat": (1.2, 1.5)})


def bits(log: Log) -> bytes:
    return np.ascontiguousarray(log.table.to_numpy(dtype=np.float64)).tobytes()


def both(scenario: Scenario, fmu: FmuFile) -> tuple[Log, Log]:
    compiled, python = (run_scenario(scenario, fmu, compiled=c) for c in (True, False))
    assert compiled.outcome == python.outcome == "done"
    return compiled.log, python.log


CASES = {
    "plain": SHORT,
    "curved with all sensor effects": replace(
        SHORT,
        workpiece="curved",
        start_z=0.088,
        sensors=SensorParams(
            quantum=(1e-4, 1e-4, 1e-3, 1e-3, 0.1, 0.1, 0.1, 0.1),
            bias_f_x=0.2,
            gain_f_z=1.1,
            crosstalk_f_x=0.02,
            crosstalk_f_z=0.03,
            gain_f_ax=0.9,
            tau_v_x=0.01,
            tau_v_z=0.02,
        ),
    ),
    "no noise": replace(SHORT, sensors=SensorParams(noise=False)),
    "delay within a period": replace(SHORT, timing=LoopTiming(delay=0.0004)),
    "delay of several periods": replace(SHORT, timing=LoopTiming(delay=0.0032)),
    "delay and jitter": replace(SHORT, timing=LoopTiming(delay=0.0013, jitter=0.0002)),
    "a slower loop": replace(SHORT, timing=LoopTiming(period=0.004, delay=0.001)),
    "retreat": RETREAT,
    "z clamped, too": replace(SHORT, clamped=("x", "z until contour")),
    "other friction, play and transport delay": replace(
        SHORT,
        plant={
            "axis_z.friction.law": 4.0,
            "axis_x.friction.law": 3.0,
            "valve_z.play": 0.05,
            "valve_x.delay_time": 0.012,
        },
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_the_compiled_loop_gives_the_bits_of_the_python_loop(case: str, gantry: FmuFile) -> None:
    compiled, python = both(CASES[case], gantry)
    assert bits(compiled) == bits(python)
    assert len(compiled) == CASES[case].samples
    assert np.abs(compiled["f_z"]).max() > 5  # it came to contact


def test_the_loops_agree_on_a_profile_of_the_user(gantry: FmuFile, tmp_path: Path) -> None:
    x = np.linspace(0.2, 1.0, 81)
    edge = tmp_path / "edge.csv"
    edge.write_text(
        "x,z_w\n"
        + "".join(
            f"{a!r},{b!r}\n"
            for a, b in zip(x.tolist(), (0.004 * np.sin(20 * x)).tolist(), strict=True)
        )
    )
    scenario = replace(
        SHORT,
        workpiece=str(edge),
        standoff=0.042,
        start_z=0.036,
        surface_finish=True,
        phases=LONGER,
    )
    compiled, python = both(scenario, gantry)
    assert bits(compiled) == bits(python)
    contour = compiled["phase"] == 2
    assert np.ptp(compiled["theta"][contour]) > 0.01
    assert np.abs(compiled["f_z"]).max() > 5


@pytest.mark.parametrize("name", controller_names())
def test_the_loops_agree_with_every_controller(name: str, gantry: FmuFile) -> None:
    phases = {"approach": (0.0, 0.4), "contact": (0.4, 0.6), "contour": (0.6, 0.9)}
    compiled, python = both(replace(SHORT, controller=name, phases=phases), gantry)
    assert bits(compiled) == bits(python)
    assert np.ptp(compiled["u_x"][600:]) > 0.01


def test_the_seed_decides_the_run(gantry: FmuFile) -> None:
    first, again, other = (run_scenario(replace(SHORT, seed=s), gantry).log for s in (3, 3, 4))
    assert bits(first) == bits(again)
    assert bits(first) != bits(other)


def test_a_delay_shifts_what_acts(gantry: FmuFile) -> None:
    """The log's command is the one that acts from t_k on: a delay of three samples shifts it by
    three.
    """
    none, three = (
        run_scenario(replace(SHORT, timing=LoopTiming(delay=d)), gantry).log for d in (0.0, 0.003)
    )
    start = 400  # the contact phase begins: up to there both are the same
    assert np.array_equal(none["u_z"][:start], three["u_z"][:start])
    assert none["u_z"][start] == three["u_z"][start + 3]
    assert (three["u_z"][start : start + 3] == SHORT.approach_u_z).all()


# ---- states


@settings(max_examples=25, deadline=None)
@given(
    steps=st.integers(0, 900),
    ahead=st.integers(1, 300),
    serialised=st.booleans(),
    seed=st.integers(0, 99),
)
def test_a_loaded_state_replays_bit_for_bit(
    steps: int, ahead: int, serialised: bool, seed: int, gantry: FmuFile
) -> None:
    """After any number of steps, in memory and through bytes, with play, transport delay and
    displacement-dependent friction on.
    """
    plant = {
        "contact.z_0": 0.001,
        "valve_z.play": 0.02,
        "valve_z.delay_time": 0.0075,
        "axis_z.friction.law": 3.0,
    }
    commands = np.random.default_rng(seed).uniform(0.6, 1.4, (steps + ahead, 2))

    def drive(fmu: FmuSession, start: int, stop: int) -> bytes:
        seen = []
        for k in range(start, stop):
            fmu.set(COMMANDS, commands[k])
            fmu.step(1e-3, time=k * 1e-3)
            seen.append(fmu.get(OUTPUTS))
        return np.array(seen).tobytes()

    with FmuSession(gantry, parameters=plant) as fmu:
        drive(fmu, 0, steps)
        state = fmu.deserialise(fmu.serialise()) if serialised else fmu.save_state()
        first = drive(fmu, steps, steps + ahead)
        fmu.load_state(state)
        assert drive(fmu, steps, steps + ahead) == first


# ---- runs that end early


class Count(NamedTuple):
    samples: float = 0.0


class Nothing(NamedTuple):
    pass


@register_jitable
def faulty_kernel(
    params: Nothing, state: Count, reference: Reference, sense: Sense
) -> tuple[Count, Command]:
    return Count(state.samples + 1.0), Command(0.8, math.nan if state.samples == 100.0 else 1.0)


class Faulty(Controller[Nothing, Count]):
    """Gives a command that is no number after 100 samples."""

    kernel = staticmethod(faulty_kernel)

    def __init__(self) -> None:
        super().__init__(Nothing())

    def initial_state(self) -> Count:
        return Count()


@pytest.mark.parametrize("compiled", [True, False])
def test_a_failing_run_keeps_its_log_and_says_why(
    compiled: bool, gantry: FmuFile, tmp_path: Path
) -> None:
    result = run_scenario(SHORT, gantry, compiled=compiled, controller=Faulty())
    assert result.outcome == "failed"
    assert "u_z = nan is refused" in result.reason
    assert "at t = 0.5 s" in result.reason
    assert "\n" not in result.reason
    assert len(result.log) == 501  # up to the sample whose command was refused
    whole = run_scenario(SHORT, gantry, compiled=compiled).log
    assert np.array_equal(result.log.measured()[:401], whole.measured()[:401])
    assert np.isfinite(result.log.measured()).all()
    assert result.log.provenance["outcome"] == "failed"
    assert result.log.provenance["reason"] == result.reason
    cut = Log(
        result.log.table[:500], "cut", result.log.provenance
    )  # without the NaN command the log reads back
    assert len(read_log(write_log(cut, tmp_path / "cut.parquet"))) == 500


@pytest.mark.parametrize("compiled", [True, False])
def test_a_cancelled_run_keeps_its_log(compiled: bool, gantry: FmuFile) -> None:
    long = replace(
        SHORT, phases={"approach": (0.0, 0.4), "contact": (0.4, 0.7), "contour": (0.7, 6.0)}
    )
    told: list[tuple[int, int]] = []

    def until_half(done: int, total: int) -> bool:
        told.append((done, total))
        return done < 3000

    result = run_scenario(long, gantry, compiled=compiled, progress=until_half)
    assert result.outcome == "cancelled"
    assert result.reason == f"cancelled after {len(result.log)} of 6000 samples"
    assert told[-1] == (len(result.log), 6000)
    assert 3000 <= len(result.log) < 6000
    whole = run_scenario(long, gantry).log
    assert np.array_equal(result.log.measured(), whole.measured()[: len(result.log)])


class Undecorated(Faulty):
    @staticmethod
    def kernel(params: Any, state: Any, reference: Any, sense: Any) -> tuple[Count, Command]:
        return Count(state.samples), Command(0.8, 1.0)


def test_a_kernel_that_cannot_be_compiled_is_refused_by_name(gantry: FmuFile) -> None:
    with pytest.raises(
        InputError, match=r"Undecorated: its kernel cannot be compiled .*register_jitable"
    ) as caught:
        run_scenario(SHORT, gantry, controller=Undecorated())
    assert "\n" not in str(caught.value)
    assert run_scenario(SHORT, gantry, controller=Undecorated(), compiled=False).outcome == "done"


def test_a_scenario_that_names_something_wrongly_is_refused(gantry: FmuFile) -> None:
    with pytest.raises(
        InputError, match=r"contact\.K_d: no such variable; did you mean contact\.K_c"
    ):
        run_scenario(replace(SHORT, plant={"contact.K_d": 1.0}), gantry)
    with pytest.raises(InputError, match=r"controller: unknown controller 'pi_fw'"):
        run_scenario(replace(SHORT, controller="pi_fw"), gantry)


# ---- provenance


def test_a_log_says_all_that_its_run_came_from(gantry: FmuFile, tmp_path: Path) -> None:
    scenario = replace(SHORT, plant={"contact.K_c": 2e4}, timing=LoopTiming(delay=0.001))
    log = run_scenario(scenario, gantry).log
    for suffix in ("parquet", "csv"):
        back = read_log(write_log(log, tmp_path / f"log.{suffix}"))
        said = back.provenance
        assert said["fmu"] == {"file": gantry.path.name, "sha256": gantry.sha256}
        assert said["parameters"] == {"contact.K_c": 2e4}
        assert said["seed"] == 3
        assert set(said["versions"]) == {"pneugantry", "fmpy", "numpy", "numba", "python"}
        assert said["outcome"] == "done"
        again = scenario_from(tomllib.loads(said["scenario"]))
        assert again == scenario
        assert bits(run_scenario(again, gantry).log) == bits(back)
    assert list(log.table.columns) == [
        "time",
        "u_x",
        "u_z",
        *MEASURED,
        "f_nd",
        "v_td",
        "theta",
        "phase",
    ]


def test_the_default_controller_is_the_thesis_own(gantry: FmuFile) -> None:
    assert bits(run_scenario(SHORT, gantry).log) == bits(
        run_scenario(SHORT, gantry, controller=PiFv(gains="table_4_6")).log
    )
