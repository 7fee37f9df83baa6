"""What is tuned of `robust_fv` and of each of its peers: where a search starts, and within which
span it moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from controllers.gains import TABLE_3_11, FvGains, PidGains

__all__ = ["PEERS", "Flat", "Peer"]

Flat = dict[str, float]


@dataclass(frozen=True)
class Peer:
    """A controller, what is tuned of it, and how the flat values become its options."""

    controller: str
    start: Flat
    span: Mapping[str, tuple[float, float]]
    options: Callable[[Flat], dict[str, Any]] = dict
    linear: bool = True  # has a linear model, so that margins can be asked for


def _gains(values: Flat) -> FvGains:
    """The f_z and v_x loops tuned, the others as in Table 3.11."""
    return TABLE_3_11._replace(
        f_z=PidGains(values["f_z.k_p"], values["f_z.k_i"]),
        v_x=PidGains(values["v_x.k_p"], values["v_x.k_i"]),
        f_x=PidGains(values["f_x.k_p"], values["f_x.k_i"]),
    )


def _pi_options(values: Flat) -> dict[str, Any]:
    own = {name: value for name, value in values.items() if "." not in name}
    return {"gains": _gains(values), **own}


PI_START = {
    f"{loop}.{k}": float(getattr(getattr(TABLE_3_11, loop), k))
    for loop in ("f_z", "v_x", "f_x")
    for k in ("k_p", "k_i")
}
PI_SPAN = {name: (0.1 * value, 20.0 * value) for name, value in PI_START.items()}
OBSERVER = {
    "k_p": 1.0,
    "k_i": 5.0,
    "damping": 300.0,
    "k_v": 120.0,
    "k_vi": 900.0,
    "k_f": 10.0,
    "t_x": 0.15,
    "t_z": 0.02,
}
ROBUST = {
    "k_px": 0.4,
    "k_pz": 0.45,
    "k_i": 0.9,
    "damping_x": 200.0,
    "damping_z": 300.0,
    "k_v": 110.0,
    "k_vi": 410.0,
    "k_fx": 4.5,
    "k_fz": 3.5,
    "k_dx": 0.018,
    "k_dz": 0.053,
    "t_x": 0.135,
    "t_z": 0.0054,
    "t_d": 0.0048,
    "lead_z": 0.067,
    "share_x": 0.4,
    "share_z": 0.77,
}
PEERS = {
    "pi_fv": Peer("pi_fv", PI_START, PI_SPAN, _pi_options),
    "pi_fv_pressure": Peer(
        "pi_fv_pressure", {**PI_START, "k_f": 4.0}, {**PI_SPAN, "k_f": (0.3, 60.0)}, _pi_options
    ),
    "pi_fv_smith": Peer("pi_fv_smith", PI_START, PI_SPAN, _pi_options),
    "pi_fv_mbpm": Peer(
        "pi_fv_mbpm",
        {"h_1": 0.4, "h_2": 0.4, "lam": 0.1, "k_z": 0.01, "k_v": 0.05},
        {
            "h_1": (0.004, 8.0),
            "h_2": (0.004, 8.0),
            "lam": (1e-3, 1.0),
            "k_z": (1e-4, 0.1),
            "k_v": (5e-3, 0.5),
        },
        linear=False,
    ),
    "observer_fv": Peer(
        "observer_fv",
        OBSERVER,
        {
            n: ((0.002, 0.5) if n.startswith("t_") else (0.02 * v, 10.0 * v))
            for n, v in OBSERVER.items()
        },
    ),
    "robust_fv": Peer(
        "robust_fv",
        ROBUST,
        {
            **{n: (0.05 * v, 10.0 * v) for n, v in ROBUST.items()},
            "t_x": (0.004, 0.5),
            "t_z": (0.003, 0.05),
            "t_d": (0.003, 0.02),
            "share_x": (0.2, 1.0),
            "share_z": (0.2, 1.0),
            "damping_z": (10.0, 1000.0),
            "damping_x": (5.0, 1000.0),
        },
    ),
}
