"""Gain tables of the thesis, by name.

A gain acts on an error of one axis and gives a part of c_x or c_z [V]; velocity gains V/(m/s), V/m,
V s/(m/s), force gains V/N, V/(N s), V s/N for k_p, k_i, k_d.
"""

import math
from collections.abc import Mapping
from difflib import get_close_matches
from typing import NamedTuple


class PidGains(NamedTuple):
    k_p: float
    k_i: float
    k_d: float = 0.0


class FvGains(NamedTuple):
    """Gains of the four controllers of Fig. 3.13, Eq. 3-3 to 3-6, in the order of the tables."""

    v_x: PidGains
    f_z: PidGains
    f_x: PidGains
    v_z: PidGains


# Step 1, each controller alone; the only table with a derivative gain.
TABLE_3_5 = FvGains(
    PidGains(0.2, 4.0), PidGains(0.08, 0.1), PidGains(0.02, 0.03), PidGains(0.25, 6.0, 0.05)
)
# Step 2, in pairs (f_z with v_x, f_x with v_z).
TABLE_3_6 = FvGains(
    PidGains(0.05, 1.0), PidGains(0.02, 0.04), PidGains(0.01, 0.06), PidGains(0.5, 3.0)
)
# Step 3, all four, wooden straight edge.
TABLE_3_7 = FvGains(
    PidGains(1.0, 4.0), PidGains(0.02, 0.04), PidGains(0.01, 0.03), PidGains(0.5, 5.0)
)
# Retuned on the aluminum edge at 30 deg; Table 4.6 is the same.
TABLE_3_11 = FvGains(
    PidGains(1.0, 4.0), PidGains(0.02, 0.08), PidGains(0.01, 0.03), PidGains(0.5, 2.0)
)
# Lookup over theta: 0..15, 15..30, 30..45, from 45 deg.
TABLE_5_1 = (
    FvGains(PidGains(0.5, 2.0), PidGains(0.02, 0.08), PidGains(0.025, 0.12), PidGains(0.1, 2.0)),
    FvGains(PidGains(0.5, 2.0), PidGains(0.01, 0.08), PidGains(0.05, 0.06), PidGains(0.4, 2.0)),
    FvGains(PidGains(1.0, 4.0), PidGains(0.02, 0.08), PidGains(0.01, 0.03), PidGains(0.8, 2.0)),
    FvGains(PidGains(2.0, 16.0), PidGains(0.04, 0.32), PidGains(0.025, 0.01), PidGains(1.0, 0.5)),
)

TABLES: dict[str, FvGains] = {
    "table_3_5": TABLE_3_5,
    "table_3_6": TABLE_3_6,
    "table_3_7": TABLE_3_7,
    "table_3_11": TABLE_3_11,
    "table_4_6": TABLE_3_11,
    **{f"table_5_1_set_{i}": gains for i, gains in enumerate(TABLE_5_1, 1)},
}


Gains = str | FvGains | Mapping[str, float]  # what a controller takes as its gains


def gains_named(gains: Gains) -> FvGains:
    """Gains from a table's name, from names as ``Kp_vx`` and ``Ki_fz`` (``Kd_...`` default to 0),
    or as they are.

    Raises ValueError for an unknown table or gain name, a missing gain, and a gain that is not
    finite and >= 0.
    """
    if isinstance(gains, str):
        if gains not in TABLES:
            near = get_close_matches(gains, TABLES, n=1, cutoff=0.0)[0]
            raise ValueError(f"gains must name a table, got {gains!r}; nearest is {near!r}")
        return TABLES[gains]
    if not isinstance(gains, FvGains):
        gains = _from_mapping(gains)
    for loop, pid in zip(FvGains._fields, gains, strict=True):
        for field, value in zip(PidGains._fields, pid, strict=True):
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{loop}.{field} must be finite and >= 0, got {value}")
    return FvGains(*(PidGains(*map(float, pid)) for pid in gains))


def named_gains(gains: str | Mapping[str, float]) -> dict[str, float]:
    """A table's gains by name (``Kp_vx`` and so on), or those given. Raises ValueError for an
    unknown table.
    """
    if not isinstance(gains, str):
        return dict(gains)
    loops = zip(FvGains._fields, gains_named(gains), strict=True)
    return {
        f"K{kind}_{loop.replace('_', '')}": value
        for loop, pid in loops
        for kind, value in zip("pid", pid, strict=True)
        if kind != "d" or value
    }


def _from_mapping(named: Mapping[str, float]) -> FvGains:
    loops = [loop.replace("_", "") for loop in FvGains._fields]
    known = [f"K{kind}_{loop}" for loop in loops for kind in "pid"]
    for name in named:
        if name not in known:
            near = get_close_matches(name, known, n=1, cutoff=0.0)[0]
            raise ValueError(f"unknown gain {name!r}; nearest is {near!r}")
    missing = [name for name in known if name not in named and not name.startswith("Kd")]
    if missing:
        raise ValueError(f"gains must hold all of Kp and Ki, missing {', '.join(missing)}")
    return FvGains(
        *(
            PidGains(named[f"Kp_{at}"], named[f"Ki_{at}"], named.get(f"Kd_{at}", 0.0))
            for at in loops
        )
    )
