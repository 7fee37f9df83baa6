"""Runs that pictures of chapter 3 look into; their scores stand in the tables."""

from __future__ import annotations

from pneugantry.thesis.conditions import Run

__all__ = ["COMPENSATED", "DRAWN", "SPEEDS", "picture_runs", "rig_speed_run"]

SPEEDS = {  # m/s, by picture: Figs. 3.26-3.29
    "fig_3_26_curved_medium": ("curved", 0.06),
    "fig_3_27_curved_low": ("curved", 0.03),
    "fig_3_28_straight_medium": ("straight", 0.06),
    "fig_3_29_straight_low": ("straight", 0.03),
}
COMPENSATED = Run("straight", "pi_fv_vdfm")  # Fig. 3.34
DRAWN = Run("straight", finish="random")  # Figs. 4.5, 4.7


def rig_speed_run(piece: str, speed: float) -> Run:
    """Of Tables 3.9 and 3.10, before the controller was retuned; speed in m/s, > 0."""
    return Run(piece, gains="table_3_7", v_td=-speed)


def picture_runs() -> list[Run]:
    return [*(rig_speed_run(*case) for case in SPEEDS.values()), COMPENSATED, DRAWN]
