"""The controllers side by side: scores on four edges, time of a control step, and the lead of the
robust one over 50 drawn plants. How each bears other structures of plant: `structure_board`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from controllers.catalogue import controller_names, make_controller
from controllers.interface import Reference, Sense
from pneugantry.thesis.conditions import Run
from pneugantry.thesis.printed import WORKPIECES
from pneugantry.thesis.runner import Results
from pneugantry.thesis.scores import Scores
from pyfmi_runner.sensors import SensorParams

__all__ = [
    "EDGES",
    "NEURAL",
    "NEW",
    "Robustness",
    "Row",
    "best_neural",
    "board",
    "board_runs",
    "drawn_runs",
    "robustness",
    "step_times",
]

NEW = "robust_fv"
NEURAL = ("pi_fv_ebpa", "pi_fv_ebpa_zero", "pi_fv_mbpm", "pi_fv_mbpm_5", "pi_fv_mbpm_both")
EDGES = ("straight", "curved")  # where the lead is asked for
PLANTS, SPREAD, SEED = 50, 0.20, 2008
PARAMETERS = {  # of the plant, each drawn within +-20 % of its value
    "axis_x.m": 7.3,
    "axis_z.m": 2.25,
    "axis_x.C": 74.0,
    "axis_z.C": 40.0,
    "axis_x.friction.F_s": 25.0,
    "axis_x.friction.F_d": 11.0,
    "axis_x.friction.v_th": 0.01,
    "valve_x.K": 186.0,
    "valve_z.K": 100.0,
    "valve_x.u_0": 0.635,
    "valve_z.u_0": 0.735,
    "valve_x.tau": 0.30,
    "valve_z.tau": 0.15,
    "valve_x.f_max": 443.0,
    "valve_z.f_max": 156.0,
}
CHOSEN = (
    "contact.K_c",
    "contact.C_c",
    "axis_z.friction.beta",
    "axis_z.friction.sigma",
    "axis_x.F_w",
    "axis_z.F_w",
)  # values of the choice
SAMPLES = 4000


@dataclass(frozen=True)
class Row:
    """A controller's line: scores by edge, and microseconds a control step."""

    controller: str
    scores: dict[str, Scores]
    us_per_step: float


@dataclass(frozen=True)
class Robustness:
    """RMSE f_n [N] of two controllers over the drawn plants, on one edge."""

    edge: str
    new: NDArray[np.float64]
    neural: NDArray[np.float64]

    @property
    def ahead(self) -> int:
        """Plants on which the new one is better."""
        return int((self.new < self.neural).sum())


def board_runs(names: Iterable[str] | None = None) -> list[Run]:
    return [Run(edge, name) for name in names or controller_names() for edge in WORKPIECES]


def board(results: Results, times: dict[str, float]) -> list[Row]:
    """Sorted by RMSE f_n, mean of straight and curved."""
    rows = [
        Row(name, {edge: results[Run(edge, name)] for edge in WORKPIECES}, times[name])
        for name in times
    ]
    return sorted(rows, key=lambda row: sum(row.scores[edge].rmse_fn for edge in EDGES))


def best_neural(results: Results) -> str:
    """The neural controller of the smallest RMSE f_n, mean of straight and curved."""
    return min(NEURAL, key=lambda name: sum(results[Run(edge, name)].rmse_fn for edge in EDGES))


def drawn_runs(controller: str, plants: int = PLANTS) -> list[Run]:
    """Straight and curved edge on each drawn plant; the same plants for every controller."""
    rng = np.random.default_rng(SEED)
    base = Run()
    values = PARAMETERS | {name: base.choice.plant()[name] for name in CHOSEN}
    runs = []
    for _ in range(plants):
        factors = 1.0 + SPREAD * (2.0 * rng.random(len(values)) - 1.0)
        plant = tuple(
            (name, value * float(factor))
            for (name, value), factor in zip(values.items(), factors, strict=True)
        )
        runs += [Run(edge, controller, plant=plant) for edge in EDGES]
    return runs


def robustness(results: Results, neural: str, plants: int = PLANTS) -> list[Robustness]:
    rmse = {
        name: np.array([results[run].rmse_fn for run in drawn_runs(name, plants)])
        for name in (NEW, neural)
    }
    return [
        Robustness(edge, rmse[NEW][k :: len(EDGES)], rmse[neural][k :: len(EDGES)])
        for k, edge in enumerate(EDGES)
    ]


@lru_cache(maxsize=64)
def _control_loop(kernel: Callable[..., Any]) -> Callable[..., Any]:
    @njit
    def loop(params, state, senses):  # type: ignore[no-untyped-def]
        total = 0.0
        for k in range(senses.shape[0]):
            s = senses[k]
            sense = Sense(s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7])
            state, command = kernel(params, state, Reference(30.0, -0.06), sense)
            total += command.u_x + command.u_z
        return total

    return loop  # type: ignore[no-any-return]


def step_times(names: list[str]) -> dict[str, float]:
    """Microseconds a control step takes compiled, smallest of five passes over noisy samples near
    the set point.
    """
    mean = np.array([0.6, 0.04, -0.06, 0.0, 0.5, 30.0, -15.0, 35.0])
    senses = mean + np.array(SensorParams().sigma) * np.random.default_rng(1).standard_normal(
        (SAMPLES, 8)
    )
    times = {}
    for name in names:
        controller = make_controller(name)
        loop = _control_loop(type(controller).kernel)
        passes = []
        for _ in range(6):
            controller.reset()
            started = time.perf_counter()
            loop(controller.params, controller.state, senses)
            passes.append(time.perf_counter() - started)
        times[name] = 1e6 * min(passes[1:]) / SAMPLES  # the first pass compiles
    return times
