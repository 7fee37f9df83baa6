"""What `python -m pneugantry.thesis.robust_design` found for the peers of `robust_fv`."""

from __future__ import annotations

__all__ = ["TUNED", "TUNED_NOMINAL"]

TUNED: dict[str, dict[str, float]] = {
    "pi_fv": {
        "f_z.k_p": 0.0302,
        "f_z.k_i": 0.254,
        "v_x.k_p": 1.31,
        "v_x.k_i": 0.4,
        "f_x.k_p": 0.00186,
        "f_x.k_i": 0.248,
    },
    "pi_fv_pressure": {
        "f_z.k_p": 0.0166,
        "f_z.k_i": 0.268,
        "v_x.k_p": 1.65,
        "v_x.k_i": 0.4,
        "f_x.k_p": 0.0172,
        "f_x.k_i": 0.0504,
        "k_f": 0.805,
    },
    "pi_fv_mbpm": {"h_1": 0.00543, "h_2": 0.172, "lam": 0.489, "k_z": 0.1, "k_v": 0.0606},
}
# with `--nominal --starts 4`: by runs on the thesis' plant alone, no margin asked for
TUNED_NOMINAL: dict[str, dict[str, float]] = {
    "pi_fv_pressure": {
        "f_z.k_p": 0.0271,
        "f_z.k_i": 1.6,
        "v_x.k_p": 0.99,
        "v_x.k_i": 0.4,
        "f_x.k_p": 0.0269,
        "f_x.k_i": 0.329,
        "k_f": 3.59,
    },
}
