"""Resident memory over many steps and over many instances: the growth after a warm-up."""

from __future__ import annotations

import gc
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from modelica_fmu.errors import InputError
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.plant import COMMANDS

__all__ = ["ALLOWED", "Growth", "instances", "steps"]

# bytes: what the allocator and Python may come to hold; a leak of 20 bytes in 100,000 instances
# exceeds it
ALLOWED = 2_000_000
# whatever keeps a memory or makes events: a delay's history, the play's ticks, bristles, stick band
EFFECTS = {
    "valve_z.delay_time": 0.005,
    "valve_x.delay_time": 0.02,
    "valve_z.play": 0.02,
    "axis_x.friction.law": 4.0,
    "contact.z_0": 0.04,
}


class Growth(NamedTuple):
    what: str
    number: int
    bytes_before: int
    bytes_after: int
    seconds: float

    @property
    def grown(self) -> int:
        return self.bytes_after - self.bytes_before


def steps(file: FmuFile, count: int) -> Growth:
    """`count` steps of 1 ms of one instance with delays, play and friction memories on; a state is
    saved and loaded now and then.
    """
    rng = np.random.default_rng(1)
    with FmuSession(file, parameters=EFFECTS) as fmu:
        saved = fmu.save_state()

        def run(start: int, n: int) -> None:
            for k in range(start, start + n):
                if k % 50 == 0:
                    fmu.set(COMMANDS, rng.uniform((0.3, 0.4), (1.1, 1.4)))
                fmu.step(1e-3, time=k * 1e-3)
                if k % 1000 == 999:
                    fmu.save_state(saved)
                    fmu.load_state(saved)

        warm = min(20_000, count)
        run(0, warm)
        return _measured("steps", count, lambda: run(warm, count))


def instances(file: FmuFile, count: int) -> Growth:
    """`count` instances made, initialised, stepped, saved, freed, one after the other."""

    def run(n: int) -> None:
        for _ in range(n):
            with FmuSession(file, parameters=EFFECTS) as fmu:
                fmu.set("u_z", 1.05)
                fmu.step(1e-3)
                fmu.save_state()
                fmu.step(1e-3)

    run(min(1000, count))
    return _measured("instances", count, lambda: run(count))


def _measured(what: str, count: int, work: Callable[[], None]) -> Growth:
    gc.collect()
    before, start = _resident(), time.perf_counter()
    work()
    seconds = time.perf_counter() - start
    gc.collect()
    return Growth(what, count, before, _resident(), seconds)


def _resident() -> int:
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        raise InputError(
            "resident memory is read from /proc, which this system lacks",
            hint="run the soak on Linux",
        ) from None
    return pages * resource.getpagesize()
