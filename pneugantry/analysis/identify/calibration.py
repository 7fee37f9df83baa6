"""Calibration lines of the sensors (Appendix B): reading = slope * volts + offset, SI, from known
loads, positions or speeds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pneugantry.analysis.identify.interval import Line, line

__all__ = ["PRINTED", "PrintedLine", "calibrate"]


class PrintedLine(NamedTuple):
    """A line of Appendix B, in SI units of the channel per volt."""

    slope: float
    offset: float
    unit: str
    equation: str


PRINTED = {
    "f_x": PrintedLine(-17.0, 0.0, "N", "B-1"),
    "f_z": PrintedLine(17.0, 0.0, "N", "B-1"),
    "x": PrintedLine(0.180, -0.044, "m", "B-2"),
    "z": PrintedLine(0.056, -0.024, "m", "B-2"),
    "v_x": PrintedLine(0.3333, 0.0, "m/s", "B.3"),
    "v_z": PrintedLine(0.1323, 0.0, "m/s", "B.3"),
    "dp_x": PrintedLine(48e3, -3.9e3, "Pa", "B-3"),
    "dp_z": PrintedLine(49e3, -3.9e3, "Pa", "B-3"),
}


def calibrate(volts: ArrayLike, known: ArrayLike) -> Line:
    """The line through a calibration's steps: volts (n,) [V] against known loads, positions or
    speeds (n,) [SI], n >= 3.

    Its intervals come from the scatter about the line. Raises ValueError for fewer steps, or steps
    at one voltage.
    """
    return line(np.asarray(volts, float), np.asarray(known, float))
