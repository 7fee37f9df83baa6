"""What the controller tests share: a sequence of samples, and a controller driven in Python and in
a compiled loop.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numba import njit

from controllers.interface import Command, Controller, Kernel, Reference, Sense

SAMPLES = 1200


@cache
def compiled_loop(kernel: Kernel) -> Callable:
    @njit
    def loop(params, state, references, senses, commands):
        for k in range(senses.shape[0]):
            s = senses[k]
            reference = Reference(references[k, 0], references[k, 1])
            sense = Sense(s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7])
            state, command = kernel(params, state, reference, sense)
            commands[k, 0] = command.u_x
            commands[k, 1] = command.u_z
        return state

    return loop


def compiled_run(controller: Controller, references: np.ndarray, senses: np.ndarray) -> np.ndarray:
    """Commands [V], shape (n, 2), of the kernel in an @njit loop; the controller keeps the last
    state.
    """
    commands = np.empty((len(senses), 2))
    loop = compiled_loop(controller.kernel)
    controller.state = loop(controller.params, controller.state, references, senses, commands)
    return commands


def python_run(controller: Controller, references: np.ndarray, senses: np.ndarray) -> np.ndarray:
    """Commands [V], shape (n, 2), of step() called sample by sample."""
    commands = []
    for reference, sense in zip(references.tolist(), senses.tolist(), strict=True):
        command = controller.step(Reference(*reference), Sense(*sense))
        assert isinstance(command, Command)
        commands.append(command)
    return np.array(commands)


def draw_samples(seed: int, n: int = SAMPLES) -> tuple[np.ndarray, np.ndarray]:
    """References (n, 2) and senses (n, 8): an edge of changing angle, noise, stretches without
    contact and stretches of forces and speeds that saturate either axis at either end.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(n) * 1e-3
    theta = np.deg2rad(50.0) * np.sin(2 * np.pi * t / t[-1])
    f_n = 30.0 + 6.0 * rng.standard_normal(n)
    f_t = rng.standard_normal(n)
    v_t, v_n = -0.06 + 0.05 * rng.standard_normal(n), 0.01 * rng.standard_normal(n)
    fifth = n // 5
    f_n[fifth : fifth + 100] = 0.0
    f_t[fifth : fifth + 100] = 0.0
    f_n[2 * fifth : 2 * fifth + 150] = 600.0
    v_t[3 * fifth : 3 * fifth + 100] = 8.0
    v_t[3 * fifth + 100 : 3 * fifth + 200] = -8.0
    c, s = np.cos(theta), np.sin(theta)
    f_x, f_z = -f_n * s + f_t * c, f_n * c + f_t * s
    v_x, v_z = v_t * c - v_n * s, v_t * s + v_n * c
    x, z = 0.95 + np.cumsum(v_x) * 1e-3, 0.04 + np.cumsum(v_z) * 1e-3
    f_ax, f_az = 5.0 * rng.standard_normal(n) - 10.0, 5.0 * rng.standard_normal(n) + 15.0
    senses = np.column_stack([x, z, v_x, v_z, f_x, f_z, f_ax, f_az])
    senses += np.array([3e-4, 1e-4, 1e-3, 5e-4, 0.05, 0.05, 0.05, 0.05]) * rng.standard_normal(
        (n, 8)
    )
    references = np.column_stack([np.full(n, 30.0), np.where(t < t[n // 6], 0.0, -0.06)])
    references[4 * fifth : 4 * fifth + 100, 0] = 500.0
    return references, senses


@pytest.fixture(scope="session")
def run_python() -> Callable:
    return python_run


@pytest.fixture(scope="session")
def run_compiled() -> Callable:
    return compiled_run


@pytest.fixture(scope="session")
def noisy_samples() -> Callable:
    return draw_samples


@pytest.fixture(scope="session")
def samples() -> tuple[np.ndarray, np.ndarray]:
    return draw_samples(seed=7)
