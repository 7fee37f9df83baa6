"""Smith predictor: with a perfect model it commands as PI does on the plant without lag."""

import math

import numpy as np
import pytest

from controllers.catalogue import make_controller
from controllers.interface import Reference, Sense
from controllers.smith import FORCE_LOOP, ForceLoop, held_rows


def fine_step(loop: ForceLoop, state: np.ndarray, held: float, dt: float, lag: bool) -> np.ndarray:
    """(f, d, d') after dt in 200 RK4 steps; without lag f is the held force."""

    def rate(y: np.ndarray) -> np.ndarray:
        f = y[0] if lag else held
        force = f - (loop.c_c + loop.c) * y[2] - loop.k_c * y[1]
        return np.array([(held - y[0]) / loop.tau, y[2], force / loop.m])

    h = dt / 200
    for _ in range(200):
        a = rate(state)
        b = rate(state + h / 2 * a)
        c = rate(state + h / 2 * b)
        state = state + h / 6 * (a + 2 * b + 2 * c + rate(state + h * c))
    return state


def closed_loop(name: str, lag: bool, steps: int) -> np.ndarray:
    """Commands u_z [V] of a controller on the linear z force plant, from rest at 0 N."""
    loop, controller, state, commands = FORCE_LOOP, make_controller(name), np.zeros(3), []
    for _ in range(steps):
        f_z = loop.c_c * state[2] + loop.k_c * state[1]
        command = controller.step(
            Reference(10.0, 0.0), Sense(0.9, 0.04, 0.0, 0.0, 0.0, f_z, 0.0, 0.0)
        )
        state = fine_step(loop, state, loop.k * (command.u_z - 0.735), 1e-3, lag)
        commands.append(command.u_z)
    return np.array(commands)


def test_with_a_perfect_model_it_commands_as_pi_without_lag():
    smith = closed_loop("pi_fv_smith", lag=True, steps=150)
    assert smith == pytest.approx(closed_loop("pi_fv", lag=False, steps=150), abs=1e-9)
    assert np.abs(smith - closed_loop("pi_fv", lag=True, steps=150)).max() > 0.01


def test_transition_is_the_plant_without_lag_less_the_plant_with_lag():
    free, lagged, held = np.array([3.0, 2e-3, -0.05]), np.array([3.0, 5e-4, 0.01]), 12.0
    start = np.append(free - lagged, held)
    start[0] = 3.0
    after_free, after_lagged = (
        fine_step(FORCE_LOOP, s, held, 1e-3, lag=on) for s, on in ((free, False), (lagged, True))
    )
    after = after_free - after_lagged
    after[0] = after_lagged[0]
    assert np.array(held_rows(FORCE_LOOP, 1e-3)) @ start == pytest.approx(after, rel=1e-9)


def test_lagged_force_starts_at_the_measured_one():
    controller = make_controller("pi_fv_smith")
    controller.step(Reference(30.0, 0.0), Sense(0.9, 0.04, 0.0, 0.0, 0.0, 30.0, 0.0, 15.0))
    assert controller.state.force == pytest.approx(15.0 * math.exp(-1e-3 / 0.15))


def test_impossible_model_is_refused():
    with pytest.raises(ValueError, match=r"tau must be > 0, got 0\.0"):
        make_controller("pi_fv_smith", loop=ForceLoop(tau=0.0))
