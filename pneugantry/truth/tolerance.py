"""Tolerance: each parameter of a rig is off by a few percent, and that is no cause.

The labelled example campaigns, refitted with this plant, show u_0, v_th and the strokes at their
nominal values, and all of `SPREAD_AXIS` and `SPREAD_CONTACT` off; `valve_offset_too` adds u_0.
"""

from __future__ import annotations

import numpy as np

from pneugantry.truth.parameters import Rig

SPREAD_AXIS = ("mass", "viscous", "static", "dynamic", "cable", "gain", "lag")
SPREAD_CONTACT = ("stiffness", "damping")


def with_tolerance(
    rig: Rig, rng: np.random.Generator, rms: float = 0.02, valve_offset_too: bool = False
) -> tuple[Rig, dict[str, float]]:
    """(a rig whose parameters are each off by a normal draw of `rms`, relative; the factors). F_s
    >= F_d is kept.
    """
    if not 0.0 <= rms < 0.3:
        raise ValueError(f"rms must be >= 0 and < 0.3, got {rms}")
    out, factors = rig.copy(), {}
    fields = (*SPREAD_AXIS, "offset") if valve_offset_too else SPREAD_AXIS
    for name in fields:
        for i, axis in enumerate("xz"):
            factors[f"{name}_{axis}"] = 1.0 + rms * float(rng.standard_normal())
            out.axis[name][i] *= factors[f"{name}_{axis}"]
    for name in SPREAD_CONTACT:
        factors[f"contact_{name}"] = 1.0 + rms * float(rng.standard_normal())
        out.contact[name] *= factors[f"contact_{name}"]
    for i, axis in enumerate("xz"):
        if out.axis["static"][i] < out.axis["dynamic"][i]:
            factors[f"static_{axis}"] *= out.axis["dynamic"][i] / out.axis["static"][i]
            out.axis["static"][i] = out.axis["dynamic"][i]
    return out, factors
