"""The C master loop (`master.c`): compiled with the compiler of the FMU's binary, called once a
run.
"""

from __future__ import annotations

import ctypes
import tempfile
from ctypes import POINTER, Structure, c_double, c_int32, c_int64, c_uint32, c_void_p
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from controllers.pi_fv import PiFv
from modelica_fmu.errors import InputError, RunError
from modelica_fmu.toolchain import compile_library, find_compiler, host_platform
from pyfmi_runner.fmu import FmuSession
from pyfmi_runner.loop import Rows
from pyfmi_runner.plan import Plan
from pyfmi_runner.plant import CLAMPS, COMMANDS, MANUAL, OUTPUTS
from pyfmi_runner.sensors import SensorParams

__all__ = ["c_loop", "master_library"]

SOURCE = Path(__file__).parent / "master.c"


class _Wiring(Structure):
    _fields_ = [
        *(
            (name, c_void_p)
            for name in ("component", "set_real", "set_boolean", "get_real", "do_step")
        ),
        *((name, c_void_p) for name in ("commands", "clamps", "manual", "outputs")),
    ]


class _Course(Structure):
    _fields_ = [
        ("samples", c_int64),
        ("period", c_int64),
        *(
            (name, c_void_p)
            for name in ("phase", "acts", "f_nd", "v_td", "manual", "noise", "clamps")
        ),
        ("approach", c_double * 2),
        ("sigma", c_double * 8),
    ]


class _Controller(Structure):
    _fields_ = [
        ("gains", c_double * 8),
        ("offsets", c_double * 3),
    ]  # k_p, k_i of v_x, f_z, f_x, v_z; u_0x, u_0z, dt


@lru_cache(maxsize=1)
def master_library() -> Any:
    """`master.c` compiled and loaded; InputError where there is no C compiler."""
    with tempfile.TemporaryDirectory(prefix="c-master-") as folder:
        target = host_platform()
        (Path(folder) / SOURCE.name).write_bytes(SOURCE.read_bytes())
        path = compile_library(
            find_compiler(target), target, Path(folder), [SOURCE.name], f"master{target.extension}"
        )
        library = ctypes.CDLL(str(path))
    library.master_run.restype = c_int64
    library.master_run.argtypes = [
        POINTER(_Wiring),
        POINTER(_Course),
        POINTER(_Controller),
        *[c_void_p] * 4,
    ]
    return library


def c_loop(fmu: FmuSession, plan: Plan, controller: PiFv, sensors: SensorParams) -> Rows:
    """`compiled_loop` in C, for the PI force/velocity controller, sensors whose one error is noise,
    and the model's own edges.
    """
    if (
        plan.profile is not None
        or sensors != SensorParams(sigma=sensors.sigma, dt=sensors.dt)
        or not isinstance(controller, PiFv)
    ):
        raise InputError(
            "the C master knows the model's edges, noisy sensors and pi_fv alone",
            hint="take the compiled loop",
        )
    rows, raw = Rows.empty(plan.samples), fmu.raw()
    references = [
        fmu.references(names) for names in (COMMANDS, CLAMPS, MANUAL, (*OUTPUTS, "theta"))
    ]
    wiring = _Wiring(
        raw.component,
        raw.set_real,
        raw.set_boolean,
        raw.get_real,
        raw.do_step,
        *(_address(r, c_uint32) for r in references),
    )
    arrays = [
        _address(a, kind)
        for a, kind in (
            (plan.phase, c_int64),
            (plan.acts, c_int64),
            (plan.f_nd, c_double),
            (plan.v_td, c_double),
            (plan.manual, c_double),
            (plan.noise, c_double),
            (plan.clamps, c_int32),
        )
    ]
    course = _Course(plan.samples, plan.period, *arrays, plan.approach, sensors.sigma)
    params = controller.params
    gains = [value for pid in params.gains for value in (pid.k_p, pid.k_i)]
    law = _Controller((c_double * 8)(*gains), (params.u_0x, params.u_0z, params.dt))
    given = np.empty((plan.samples, 2))
    out = [_address(a, c_double) for a in (given, rows.commands, rows.measured, rows.theta)]
    rows.done = master_library().master_run(wiring, course, law, *out)
    now = rows.done * plan.period * 1e-6
    if rows.done < plan.samples:
        raise RunError(f"at t = {now:.6g} s: {fmu.stepped_natively(now, 3)}")
    fmu.stepped_natively(now)
    return rows


def _address(array: Any, kind: type) -> int:
    if not array.flags.c_contiguous or array.dtype != np.dtype(kind):
        raise TypeError(
            f"the C master needs a contiguous array of {kind.__name__}, got {array.dtype}"
        )
    return int(array.ctypes.data)
