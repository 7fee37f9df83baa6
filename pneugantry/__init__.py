"""PneuGantry: co-simulation of a pneumatic gantry robot, and diagnosis of its sim-to-real gap.

`import pneugantry as pg` imports no library; a name is loaded when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from modelica_fmu import Target
    from modelica_fmu.errors import InputError, RunError
    from pneugantry.api.diagnosis import (
        Diagnosis,
        Gap,
        compile_parts,
        diagnose,
        diagnose_change,
    )
    from pneugantry.api.models import BuiltFmu, build, linearize, rootlocus
    from pneugantry.api.runs import IdentifiedPlant, Replay, TrackingRun, identify, replay, run
    from pyfmi_runner.campaign import Campaign, read_campaign
    from pyfmi_runner.fmu import FmuFile, FmuSession
    from pyfmi_runner.log import Log, read_log, write_log
    from pyfmi_runner.scenario import Scenario, read_scenario

__all__ = [
    "BuiltFmu",
    "Campaign",
    "Diagnosis",
    "FmuFile",
    "FmuSession",
    "Gap",
    "IdentifiedPlant",
    "InputError",
    "Log",
    "Replay",
    "RunError",
    "Scenario",
    "Target",
    "TrackingRun",
    "build",
    "compile_parts",
    "diagnose",
    "diagnose_change",
    "identify",
    "linearize",
    "read_campaign",
    "read_log",
    "read_scenario",
    "replay",
    "rootlocus",
    "run",
    "write_log",
]

_HOME = {
    "modelica_fmu": ("Target",),
    "modelica_fmu.errors": ("InputError", "RunError"),
    "pneugantry.api.diagnosis": (
        "Diagnosis",
        "Gap",
        "compile_parts",
        "diagnose",
        "diagnose_change",
    ),
    "pneugantry.api.models": ("BuiltFmu", "build", "linearize", "rootlocus"),
    "pneugantry.api.runs": (
        "IdentifiedPlant",
        "Replay",
        "TrackingRun",
        "identify",
        "replay",
        "run",
    ),
    "pyfmi_runner.campaign": ("Campaign", "read_campaign"),
    "pyfmi_runner.fmu": ("FmuFile", "FmuSession"),
    "pyfmi_runner.log": ("Log", "read_log", "write_log"),
    "pyfmi_runner.scenario": ("Scenario", "read_scenario"),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    """A name of `__all__` from its module, or `__version__` from the installed package."""
    if name == "__version__":
        from importlib.metadata import version

        return version("pneugantry")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'pneugantry' has no attribute {name!r}")
    value = getattr(importlib.import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__, "__version__"])
