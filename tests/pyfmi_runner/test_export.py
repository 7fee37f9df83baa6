"""A controller as an FMU: the same log as the native one, bit for bit, in our loops and in other
tools.
"""

from __future__ import annotations

import ctypes
import math
import re
import sys
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from numba.extending import register_jitable

from controllers.catalogue import controller_names, make_controller
from controllers.interface import Command, Controller, Reference, Sense, clip_command
from modelica_fmu import Target
from modelica_fmu.errors import InputError
from pyfmi_runner.build import build_controller_fmu, build_fmu
from pyfmi_runner.export.controller import compile_controller
from pyfmi_runner.export.kernel import run_kernel
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.fmu_controller import FmuController
from pyfmi_runner.log import Log
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.sensors import SensorParams
from pyfmi_runner.timing import LoopTiming

pytestmark = pytest.mark.usefixtures("unoptimised")  # what is tested is the code
EXPORTED = (
    "pi_fv",
    "pid_fv",
    "dfv",
    "pi_fv_vdfm",
    "pi_fv_ddfm",
    "pi_fv_combined",
    "pi_fv_scheduled",
    "pi_fv_smith",
    "pi_fv_pressure",
    "observer_fv",
    "robust_fv",
)
PHASES = {
    "approach": (0.0, 0.5),
    "contact": (0.5, 1.0),
    "contour": (1.0, 4.0),
    "retreat": (4.0, 4.2),
}
SCENARIO = Scenario(workpiece="curved", start_z=0.087, phases=PHASES, seed=3)


@pytest.fixture(scope="module")
def plant() -> FmuFile:
    return FmuFile.read(build_fmu().path)


def controller_fmu(name: str, fmi: str = "2.0") -> FmuFile:
    return FmuFile.read(build_controller_fmu(name, Target(fmi)).path)  # type: ignore[arg-type]


def same(a: Log, b: Log) -> bool:
    return bool((a.table.to_numpy() == b.table.to_numpy()).all())


@pytest.mark.parametrize("name", EXPORTED)
def test_an_exported_controller_commands_what_the_native_one_does(name: str) -> None:
    rng, native = np.random.default_rng(11), make_controller(name)
    senses = rng.normal(0, 1, (1500, 8)) * (0.5, 0.05, 0.1, 0.1, 30, 30, 100, 60)
    senses[rng.random(1500) < 0.1, 4:6] = 0.1  # out of contact
    references = np.repeat(rng.normal(0, 1, (15, 2)) * (30.0, 0.06), 100, axis=0)
    with FmuController(controller_fmu(name)) as controller:
        controller.reset()
        for sense, reference in zip(senses.tolist(), references.tolist(), strict=True):
            given = Reference(*reference), Sense(*sense)
            assert controller.step(*given) == native.step(*given)


@pytest.mark.parametrize("name", ["pi_fv"])
def test_the_loop_of_two_fmus_gives_the_native_log_bit_for_bit(name: str, plant: FmuFile) -> None:
    native = run_scenario(SCENARIO, plant, controller=make_controller(name))
    with FmuController(controller_fmu(name)) as controller:
        two = run_scenario(SCENARIO, plant, controller=controller)
        again = run_scenario(SCENARIO, plant, controller=controller)
    assert native.outcome == two.outcome == "done"
    assert same(native.log, two.log)
    assert same(native.log, again.log)


def test_the_python_loop_runs_it_too(plant: FmuFile) -> None:
    native = run_scenario(SCENARIO, plant)
    with FmuController(controller_fmu("pi_fv")) as controller:
        assert same(
            native.log, run_scenario(SCENARIO, plant, controller=controller, compiled=False).log
        )


def test_its_gains_are_parameters(plant: FmuFile) -> None:
    native = run_scenario(SCENARIO, plant, controller=make_controller("pi_fv", gains="table_3_7"))
    changed = {"gains.f_z.k_i": 0.04, "gains.v_z.k_i": 5.0}  # Table 3.7 beside Table 3.11
    with FmuController(controller_fmu("pi_fv"), parameters=changed) as controller:
        assert same(native.log, run_scenario(SCENARIO, plant, controller=controller).log)


def test_the_arrays_of_neural_controllers_are_refused_by_name() -> None:
    others = [name for name in controller_names() if name not in EXPORTED]
    assert others
    for name in others:
        with pytest.raises(InputError, match=r"holds ndarray .*keep it native"):
            build_controller_fmu(name)
    with pytest.raises(InputError, match="--controller"):
        build_controller_fmu("nosuch")


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_fmpy_validates_it(fmi: str) -> None:
    assert validate_fmu(str(controller_fmu("pi_fv", fmi).path)) == []


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_disabled_it_idles_and_starts_afresh(fmi: str) -> None:
    sense = {"f_z": 20.0, "f_nd": 30.0, "v_td": -0.06}
    native = make_controller("pi_fv")
    expected = [
        native.step(Reference(30.0, -0.06), Sense(0, 0, 0, 0, 0, 20.0, 0, 0)).u_z for _ in range(3)
    ]
    with FmuSession(controller_fmu("pi_fv", fmi), parameters={"idle.u_z": 1.05}) as fmu:
        got = []
        for k, enabled in enumerate((False, True, True, True, False, True)):
            fmu.set({"enabled": enabled, **sense})
            fmu.step(1e-3, time=k * 1e-3)
            got.append(fmu.get("u_z"))
    assert got == [1.05, *expected, 1.05, expected[0]]


def test_another_fmu_is_no_controller(plant: FmuFile) -> None:
    with pytest.raises(InputError, match=r"f_nd: is no controller"):
        FmuController(plant)


def test_a_controller_fmu_that_fails_ends_the_run(plant: FmuFile) -> None:
    controller = FmuController(controller_fmu("pi_fv"))
    controller.session.stop_time = 0.3  # s: it refuses to be stepped further
    with controller:
        for compiled in (True, False):
            result = run_scenario(SCENARIO, plant, controller=controller, compiled=compiled)
            assert result.outcome == "failed"
            assert len(result.log) in (799, 800, 801)  # 0.5 s of approach, 0.3 s of its own


# ---- other tools: a master that steps all FMUs at once adds one sample of delay


def test_libcosim_and_ecos_give_the_log_of_a_loop_one_sample_late(plant: FmuFile) -> None:
    quiet = Scenario(
        workpiece="straight",
        start_z=0.04,
        seed=0,
        clamped=(),
        sensors=SensorParams(noise=False),
        timing=LoopTiming(delay=0.001),
        phases={"contact": (0.0, 0.5), "contour": (0.5, 1.0)},
        v_td=0.0,
        approach_u_x=0.0,
        approach_u_z=0.0,
    )
    table = run_scenario(quiet, plant).log.table
    path = str(controller_fmu("pi_fv").path)
    for kind in (_libcosim, _ecos):
        got = kind(str(plant.path), path, plant, controller_fmu("pi_fv"), 500)
        assert got == pytest.approx(
            [table["z"][500], table["f_z"][500], table["x"][500]], rel=1e-12, abs=1e-12
        ), kind.__name__


def _libcosim(
    plant_path: str, controller_path: str, plant: FmuFile, controller: FmuFile, steps: int
) -> list[float]:
    pytest.importorskip("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(1_000_000)
    gantry = execution.add_local_slave(CosimLocalSlave(plant_path, "gantry"))
    law = execution.add_local_slave(CosimLocalSlave(controller_path, "law"))
    for name in Sense._fields:
        execution.connect_real_variables(
            gantry, plant.variables[name].reference, law, controller.variables[name].reference
        )
    for name in Command._fields:
        execution.connect_real_variables(
            law, controller.variables[name].reference, gantry, plant.variables[name].reference
        )
    execution.real_initial_value(law, controller.variables["f_nd"].reference, 30.0)
    execution.real_initial_value(gantry, plant.variables["axis_z.s_start"].reference, 0.04)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    assert execution.step(steps)
    return list(
        observer.last_real_values(gantry, [plant.variables[n].reference for n in ("z", "f_z", "x")])
    )


def _ecos(
    plant_path: str, controller_path: str, plant: FmuFile, controller: FmuFile, steps: int
) -> list[float]:
    tbb = Path(sys.prefix) / "lib" / "libtbb.so.12"
    if tbb.is_file():
        ctypes.CDLL(str(tbb), ctypes.RTLD_GLOBAL)
    ecospy = pytest.importorskip("ecospy", exc_type=(ImportError, OSError))
    structure = ecospy.EcosSimulationStructure()
    structure.add_model("gantry", plant_path)
    structure.add_model("law", controller_path)
    for name in Sense._fields:
        structure.make_real_connection(f"gantry::{name}", f"law::{name}")
    for name in Command._fields:
        structure.make_real_connection(f"law::{name}", f"gantry::{name}")
    structure.add_parameter_set("start", {"gantry::axis_z.s_start": 0.04, "law::f_nd": 30.0})
    with ecospy.EcosSimulation(structure=structure, step_size=1e-3) as simulation:
        simulation.init(parameter_set="start")
        simulation.step(steps)
        got = [simulation.get_real(f"gantry::{n}") for n in ("z", "f_z", "x")]
        simulation.terminate()
    return got


def test_fmpy_simulates_it() -> None:
    signal = np.array(
        [(0.0, 20.0, 30.0), (1.0, 20.0, 30.0)],
        dtype=[("time", float), ("f_z", float), ("f_nd", float)],
    )
    path = str(controller_fmu("pi_fv").path)
    result = fmpy.simulate_fmu(
        path, stop_time=0.1, output_interval=1e-3, input=signal, output=["u_z"]
    )
    assert result["u_z"][-1] == pytest.approx(0.735 + 0.02 * 10 + 0.08 * 10 * 0.099, abs=1e-12)


# ---- kernels


class Numbers(NamedTuple):
    a: float = 1.0
    n: int = 3


@register_jitable
def peculiar(
    params: Numbers, state: Numbers, reference: Reference, sense: Sense
) -> tuple[Numbers, Command]:
    """Loops, early returns within them, merged names, truth values, element by a computed index,
    nested conditions.
    """
    total, flag = 0.0, False
    for i in range(params.n):
        total += (i + 1) * sense.v_x
        if total > 2.0:
            return Numbers(total, i), Command(0.0, 1.0)
    if sense.x > 0.5 and (sense.z < 0.0 or not params.n):
        total, flag = -total, True
    elif sense.x > 0.2:
        total -= 1
    table = (1.0, -2.0, total)
    at = 2 if flag else 0 if total < 0 else 1
    u = (
        table[at] * math.hypot(sense.f_x, sense.f_z)
        + abs(state.a)
        + min(
            params.a,
            sense.z,
        )
        ** 2
        if sense.z > 0.1
        else max(total, 0.5)
    )
    return state._replace(a=u, n=at), Command(
        clip_command(u), -u if 0.0 < u <= 1.0 else math.fmod(u, 0.7)
    )


class Peculiar(Controller[Numbers, Numbers]):
    kernel = staticmethod(peculiar)

    def initial_state(self) -> Numbers:
        return Numbers(0.0, 0)


def test_a_kernel_on_symbols_gives_what_it_gives_on_numbers() -> None:
    symbols = ca.SX.sym("s", 9)
    state, command = run_kernel(
        peculiar,
        Numbers(1.5, 3),
        Numbers(symbols[8], 0),
        Reference(0.0, 0.0),
        Sense(*ca.vertsplit(symbols[:8])),
    )
    function = ca.Function("f", [symbols], [ca.vertcat(*map(ca.SX, (*state, *command)))])
    rng = np.random.default_rng(5)
    for _ in range(500):
        values = rng.normal(0, 0.6, 9)
        expected = peculiar(
            Numbers(1.5, 3), Numbers(values[8], 0), Reference(0.0, 0.0), Sense(*values[:8])
        )
        assert np.array(function(values)).ravel() == pytest.approx(
            [*expected[0], *expected[1]], rel=1e-15, abs=1e-300
        )


def refused(kernel: object) -> str:
    class Own(Controller[Numbers, Numbers]):
        def initial_state(self) -> Numbers:
            return Numbers()

    Own.kernel = staticmethod(kernel)  # type: ignore[assignment]
    with pytest.raises(InputError) as error:
        compile_controller("Own", Own(Numbers()))
    return str(error.value)


def test_what_cannot_be_exported_is_refused_with_file_and_line() -> None:
    def while_loop(
        params: Numbers, state: Numbers, reference: Reference, sense: Sense
    ) -> tuple[Numbers, Command]:
        u = sense.x
        while u < 1.0:
            u += 1.0
        return state, Command(u, u)

    def library(
        params: Numbers, state: Numbers, reference: Reference, sense: Sense
    ) -> tuple[Numbers, Command]:
        return state, Command(np.tanh(sense.x), 0.0)

    def one_sided(
        params: Numbers, state: Numbers, reference: Reference, sense: Sense
    ) -> tuple[Numbers, Command]:
        if sense.x > 0:
            u = 1.0
        return state, Command(u, 0.0)

    def two_forms(
        params: Numbers, state: Numbers, reference: Reference, sense: Sense
    ) -> tuple[Numbers, Command]:
        u = (1.0, 2.0) if sense.x > 0 else 3.0
        return state, Command(u, 0.0)  # type: ignore[arg-type]

    where = rf"{Path(__file__).name}:\d+: "
    for kernel, said in (
        (while_loop, "While"),
        (library, "a call of"),
        (one_sided, "u, which only one side"),
        (two_forms, "one side gives"),
    ):
        text = refused(kernel)
        assert re.search(where + ".*" + said, text), text
        assert "keep the controller native" in text
