"""When a neural compensator learns."""

from numba.extending import register_jitable

from controllers.interface import U_MAX, U_MIN


@register_jitable
def learns(u_z: float, e_fn: float) -> bool:
    """False where the clipped command u_z [V] is at a limit and the error e_fn [N] drives it
    further out.
    """
    return not ((u_z >= U_MAX and e_fn > 0.0) or (u_z <= U_MIN and e_fn < 0.0))
