"""Stationary force control on z with the friction laws (Fig. 4.10, 4.18): x clamped, piston at the
edge, f_nd stepped to 40 N.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from controllers.gains import TABLE_3_11, PidGains
from controllers.pi_fv import PiFv
from pneugantry.thesis.conditions import CHOICE, DDFM, VDFM
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario

__all__ = ["INTEGRAL_GAINS", "Responses", "stationary_responses"]

INTEGRAL_GAINS = (0.32, 0.16, 0.08)  # V/(N s), Fig. 4.10
Responses = dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]  # name -> time [s], f_z [N]


def stationary_responses(fmu: str) -> Responses:
    """VDFM with the three integral gains of Fig. 4.10, and DDFM with them."""
    file = FmuFile.read(fmu)
    phases = {"approach": (0.0, 1.0), "contact": (1.0, 13.0), "contour": (13.0, 13.1)}
    found = {}
    for name, law in (("VDFM", VDFM), ("DDFM", DDFM)):
        for k_i in INTEGRAL_GAINS:
            controller = PiFv(gains=TABLE_3_11._replace(f_z=PidGains(0.02, k_i)))
            plant = CHOICE.plant() | {"axis_z.friction.law": law}
            scenario = Scenario(
                workpiece="straight",
                phases=phases,
                clamped=("x",),
                plant=plant,
                f_nd=40.0,
                start_z=0.04,
                approach_u_z=0.0,
            )
            log = run_scenario(scenario, file, controller=controller).log
            found[f"{name}, K_i {k_i:g}"] = (log.time[::10], log["f_z"][::10])
    return found
