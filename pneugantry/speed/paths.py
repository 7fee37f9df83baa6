"""Every path that steps the gantry FMU through one experiment: each returns the CPU seconds of its
stepping, set-up left out.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import fmpy
import fmpy.fmi2
import numpy as np
from numpy.typing import NDArray

from controllers.interface import Command, Reference, Sense
from controllers.pi_fv import PiFv
from pneugantry.speed.c_master import c_loop
from pyfmi_runner.compiled_loop import compiled_loop
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.loop import Rows, python_loop
from pyfmi_runner.plan import APPROACH, Plan, make_plan
from pyfmi_runner.plant import CLAMPS, COMMANDS, OUTPUTS
from pyfmi_runner.scenario import Scenario

__all__ = ["PATHS", "Experiment", "StepPath", "Unavailable", "quiet"]

READ = (*OUTPUTS, "theta")


class Unavailable(Exception):
    """A path whose library is not installed here; says which."""


@dataclass(frozen=True)
class Experiment:
    """One closed-loop run that every path can do: the straight edge, all parameters at their
    defaults.
    """

    file: FmuFile
    plan: Plan
    sensors: Any

    @classmethod
    def of(cls, file: FmuFile, scenario: Scenario | None = None) -> Experiment:
        scenario = scenario or Scenario(workpiece="straight")
        return cls(file, make_plan(scenario), scenario.sensors)

    def references(self, names: tuple[str, ...]) -> list[int]:
        return [self.file.variables[name].reference for name in names]

    def recorded(self) -> NDArray[np.float64]:
        """Commands of the closed loop, for a path that can only replay."""
        with FmuSession(self.file, parameters=self.plan.parameters) as fmu:
            return compiled_loop(fmu, self.plan, PiFv(), self.sensors).commands

    def shortened(self, share: float) -> Experiment:
        """Its first samples."""
        n = max(1, round(share * self.plan.samples))
        rows = ("phase", "f_nd", "v_td", "clamps", "manual", "acts", "noise")
        return replace(
            self,
            plan=replace(
                self.plan, samples=n, **{name: getattr(self.plan, name)[:n].copy() for name in rows}
            ),
        )


def _session(loop: Callable[..., Rows]) -> Callable[[Experiment], float]:
    def run(experiment: Experiment) -> float:
        with FmuSession(experiment.file, parameters=experiment.plan.parameters) as fmu:
            start = time.process_time()
            rows = loop(fmu, experiment.plan, PiFv(), experiment.sensors)
            seconds = time.process_time() - start
        assert rows.done == experiment.plan.samples
        return seconds

    return run


def _commands(experiment: Experiment) -> Iterator[Callable[[Any], Command]]:
    """One function a sample: from the values read to the command, as `python_loop` has it, without
    sensor noise.
    """
    controller, plan = PiFv(), experiment.plan
    approach = Command(*plan.approach)
    for k in range(plan.samples):
        if plan.phase[k] == APPROACH:
            yield lambda values: approach
        else:
            reference = Reference(float(plan.f_nd[k]), float(plan.v_td[k]))
            yield lambda values, reference=reference: controller.step(reference, Sense(*values[:8]))  # type: ignore[misc]


def _clamps(plan: Plan, k: int) -> list[int] | None:
    """Clamps where they change."""
    if k == 0 or (plan.clamps[k] != plan.clamps[k - 1]).any():
        return [int(c) for c in plan.clamps[k]]
    return None


def fmpy_slave(file: FmuFile) -> fmpy.fmi2.FMU2Slave:
    """An instance as fmpy makes it, initialised at 0 s."""
    description = fmpy.read_model_description(str(file.path))
    fmu = fmpy.fmi2.FMU2Slave(
        guid=description.guid,
        unzipDirectory=str(file.unpack()),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="fmpy",
    )
    fmu.instantiate()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    return fmu


def fmpy_loop(experiment: Experiment) -> float:
    """What a user of fmpy writes: setReal, doStep, getReal a sample and the controller
    in Python.
    """
    plan, fmu = experiment.plan, fmpy_slave(experiment.file)
    read, write, clamps = (
        experiment.references(READ),
        experiment.references(COMMANDS),
        experiment.references(CLAMPS),
    )
    log = np.empty((plan.samples, 11))
    start = time.process_time()
    for k, command in enumerate(_commands(experiment)):
        clamped = _clamps(plan, k)
        if clamped is not None:
            fmu.setBoolean(clamps, clamped)
        values = fmu.getReal(read)
        u = command(values)
        log[k, :9], log[k, 9:] = values, u
        fmu.setReal(write, u)
        fmu.doStep(currentCommunicationPoint=k * 1e-3, communicationStepSize=1e-3)
    seconds = time.process_time() - start
    fmu.terminate()
    fmu.freeInstance()
    return seconds


def simulate_fmu(experiment: Experiment) -> float:
    """fmpy.simulate_fmu in the open loop, with the closed loop's commands as input."""
    plan = experiment.plan
    names, recorded = (*COMMANDS, *CLAMPS), experiment.recorded()
    signal = np.empty(
        plan.samples,
        dtype=[("time", float), *((n, float if n in COMMANDS else bool) for n in names)],
    )
    signal["time"] = np.arange(plan.samples) * 1e-3
    for column, name in enumerate(COMMANDS):
        signal[name] = recorded[:, column]
    for column, name in enumerate(CLAMPS):
        signal[name] = plan.clamps[:, column]
    folder = str(experiment.file.unpack())
    description = fmpy.read_model_description(folder)
    start = time.process_time()
    result = fmpy.simulate_fmu(
        folder,
        model_description=description,
        fmi_type="CoSimulation",
        stop_time=plan.samples * 1e-3,
        output_interval=1e-3,
        input=signal,
        output=list(READ),
    )
    seconds = time.process_time() - start
    assert len(result) == plan.samples + 1
    return seconds


def libcosim(experiment: Experiment) -> float:
    """libcosimpy with the controller in Python: a manipulator writes, an observer reads, one step a
    sample.
    """
    try:
        modules = [
            importlib.import_module(f"libcosimpy.Cosim{name}")
            for name in ("Execution", "Manipulator", "Observer", "Slave")
        ]
    except (ImportError, OSError) as error:
        raise Unavailable(f"libcosimpy ({error})") from None
    execution_module, manipulator, observer_module, slave = modules
    execution = execution_module.CosimExecution.from_step_size(1_000_000)
    index = execution.add_local_slave(slave.CosimLocalSlave(str(experiment.file.path), "gantry"))
    override, observer = (
        manipulator.CosimManipulator.create_override(),
        observer_module.CosimObserver.create_last_value(),
    )
    execution.add_manipulator(override)
    execution.add_observer(observer)
    read, write, clamps = (
        experiment.references(READ),
        experiment.references(COMMANDS),
        experiment.references(CLAMPS),
    )
    plan = experiment.plan
    log = np.empty((plan.samples, 11))
    execution.step(0)
    start = time.process_time()
    for k, command in enumerate(_commands(experiment)):
        clamped = _clamps(plan, k)
        if clamped is not None:
            override.slave_boolean_values(index, clamps, [bool(c) for c in clamped])
        values = observer.last_real_values(index, read)
        u = command(values)
        log[k, :9], log[k, 9:] = values, u
        override.slave_real_values(index, write, list(u))
        execution.step(1)
    return time.process_time() - start


def ecos(experiment: Experiment) -> float:
    """ecospy with the controller in Python: set_real, step, get_real a sample."""
    tbb = Path(sys.prefix) / "lib" / "libtbb.so.12"
    if tbb.is_file():  # where the wheel of tbb puts it, which the loader does not search
        ctypes.CDLL(str(tbb), ctypes.RTLD_GLOBAL)
    try:
        ecospy = importlib.import_module("ecospy")
    except (ImportError, OSError) as error:
        raise Unavailable(f"ecospy ({error})") from None
    structure, plan = ecospy.EcosSimulationStructure(), experiment.plan
    structure.add_model("gantry", str(experiment.file.path))
    log = np.empty((plan.samples, 11))
    read = [f"gantry::{name}" for name in READ]
    with ecospy.EcosSimulation(structure=structure, step_size=1e-3) as simulation:
        simulation.init()
        start = time.process_time()
        for k, command in enumerate(_commands(experiment)):
            clamped = _clamps(plan, k)
            if clamped is not None:
                for name, value in zip(CLAMPS, clamped, strict=True):
                    simulation.set_bool(f"gantry::{name}", bool(value))
            values = [simulation.get_real(name) for name in read]
            u = command(values)
            log[k, :9], log[k, 9:] = values, u
            simulation.set_real("gantry::u_x", u.u_x)
            simulation.set_real("gantry::u_z", u.u_z)
            simulation.step(1)
        seconds = time.process_time() - start
        simulation.terminate()
    return seconds


@dataclass(frozen=True)
class StepPath:
    """A way to step the FMU.

    `share`: of the experiment's samples, fewer where a step takes long.
    """

    name: str
    run: Callable[[Experiment], float]
    share: float = 1.0


PATHS = (
    StepPath("C master loop", _session(c_loop)),
    StepPath("compiled loop", _session(compiled_loop)),
    StepPath("Python loop", _session(python_loop), 0.25),
    StepPath("fmpy loop, controller in Python", fmpy_loop, 0.5),
    StepPath("fmpy.simulate_fmu, recorded commands", simulate_fmu, 0.5),
    StepPath("libcosimpy, controller in Python", libcosim, 0.25),
    StepPath("ecospy, controller in Python", ecos, 0.5),
)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Whatever a library writes on the process's standard output and error, its C code included,
    goes to nowhere.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile() as sink, contextlib.ExitStack() as stack:
        for number in (1, 2):
            kept = os.dup(number)
            stack.callback(os.close, kept)
            stack.callback(os.dup2, kept, number)
            os.dup2(sink.fileno(), number)
        yield
