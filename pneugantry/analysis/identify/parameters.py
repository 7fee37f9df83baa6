"""What is identified: the plant's parameters, and the coordinates in which the joint fit moves
them.

A piston that is only ever pushed one way tells F_s and F_d only together with the cable force, so
the fit's coordinates are F_s + d F_w and F_d + d F_w (d: the valve's direction, Eq. 4-1 solved for
the break-away force) beside F_w itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyfmi_runner.fmu import FmuFile

__all__ = ["DDFM", "VDFM", "Coordinates", "Unknown", "unknowns"]

Array = NDArray[np.float64]
VDFM, DDFM = 2.0, 3.0  # values of axis_*.friction.law
CABLE_TOLERANCE = (
    0.02  # RMS, relative; a rig's cable force against the plant sheet's (docs/reference/gap.md)
)
# RMS, relative; prior of everything else: it only keeps what no log shows at its nominal value
WIDE = 1.0


@dataclass(frozen=True)
class Unknown:
    """One parameter of the plant."""

    name: str  # of the FMU
    symbol: str  # as the thesis prints it
    axis: str  # "x", "z" or "" for the contact
    unit: str
    source: str
    nominal: float


_VALVE = (
    ("K", "K", "N/V", "Tables 4.1-4.5"),
    ("u_0", "u_0", "V", "Tables 4.1-4.5"),
    ("tau", "tau", "s", "section 4.1.3"),
)
_AXIS = (
    ("m", "m", "kg", "section 4.1.1"),
    ("C", "C", "N s/m", "Table 3.13"),
    ("F_w", "F_w", "N", "assumed"),
)
_VDFM = (
    ("F_s", "F_s", "N", "Tables C.1, C.2"),
    ("F_d", "F_d", "N", "Tables C.1, C.2"),
    ("v_th", "v_th", "m/s", "Eq. 3-18"),
)
_DDFM = (("beta", "beta", "N", "Fig. 4.14"), ("sigma", "sigma", "N/m", "Fig. 4.14"))
_CONTACT = (("K_c", "K_c", "N/m", "Fig. 5.7"), ("C_c", "C_c", "N s/m", "Fig. 5.7"))
_LEVELS = ("F_s", "F_d", "beta")  # friction levels that show together with the cable force


def unknowns(file: FmuFile, laws: Mapping[str, float] | None = None) -> tuple[Unknown, ...]:
    """The parameters of a gantry FMU; `laws`: friction law by axis, VDFM where not given."""
    found = []
    for axis in "xz":
        friction = _DDFM if (laws or {}).get(axis) == DDFM else _VDFM
        rows = [
            (f"valve_{axis}.", _VALVE),
            (f"axis_{axis}.", _AXIS),
            (f"axis_{axis}.friction.", friction),
        ]
        found += [(prefix + row[0], row, axis) for prefix, table in rows for row in table]
    found += [("contact." + row[0], row, "") for row in _CONTACT]
    return tuple(
        Unknown(name, symbol, axis, unit, source, float(file.variables[name].start or 0.0))
        for name, (_, symbol, unit, source), axis in found
    )


class Coordinates:
    """theta <-> parameters: values = matrix @ (scale * theta); theta is about 1 at the nominal
    values.
    """

    def __init__(self, file: FmuFile, laws: Mapping[str, float] | None = None) -> None:
        self.laws = dict(laws or {})
        self.unknowns = unknowns(file, laws)
        self.names = tuple(u.name for u in self.unknowns)
        self.nominal = np.array([u.nominal for u in self.unknowns])
        self.direction = {
            axis: float(file.variables[f"valve_{axis}.direction"].start or 1.0) for axis in "xz"
        }
        self.matrix = np.eye(len(self.names))
        for i, u in enumerate(self.unknowns):
            if u.symbol in _LEVELS:
                self.matrix[i, self.names.index(f"axis_{u.axis}.F_w")] = -self.direction[u.axis]
        self._inverse = np.linalg.inv(self.matrix)
        self.scale = np.abs(self.nominal)

    def values(self, theta: Array) -> dict[str, float]:
        """Parameters of the FMU."""
        values = self.matrix @ (self.scale * theta)
        return dict(zip(self.names, values.tolist(), strict=True)) | {
            f"axis_{axis}.friction.law": law for axis, law in self.laws.items()
        }

    def theta(self, values: Mapping[str, float]) -> Array:
        """Coordinates of parameters; those not given are nominal."""
        given = np.array([values.get(u.name, u.nominal) for u in self.unknowns])
        return np.asarray((self._inverse @ given) / self.scale)

    def covariance(self, of_theta: Array) -> Array:
        """Covariance of the parameters from that of theta."""
        change = self.matrix * self.scale
        return np.asarray(change @ of_theta @ change.T)

    def label(self, i: int) -> str:
        """Name of coordinate i; of a friction level, the sum that it is."""
        u = self.unknowns[i]
        if u.symbol not in _LEVELS:
            return u.name
        return f"{u.name} {'+' if self.direction[u.axis] > 0 else '-'} F_w"

    @property
    def prior(self) -> Array:
        """Standard deviation of the prior of each theta, about the nominal values."""
        return np.array([CABLE_TOLERANCE if u.symbol == "F_w" else WIDE for u in self.unknowns])
