"""Gymnasium environment `PneuGantry-v0`: an agent in the controller's place, on the FMU.

`gymnasium.make("pyfmi_runner.gym_env:PneuGantry-v0")`, or by its bare name once this module is
imported. Needs the extra `gym`.

An episode is a scenario's contact and contouring phase; its approach runs within `reset`.
Observation: what a controller gets, the eight sensed channels and the two references, SI units.
Action: u_x, u_z in volts, held for `hold` milliseconds. Reward: for each of these milliseconds
-0.001 [((f_n - f_nd) / 10 N)^2 + ((v_t - v_td) / 0.05 m/s)^2], each square at most 100, from the
true f_n and v_t, not the sensed ones; so an episode's return is minus the integral over time of the
squared errors in these units. The episode is truncated at the end of the contouring phase; it is
terminated, with a further -1000, when the FMU cannot go on.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from controllers.interface import U_MAX, U_MIN
from modelica_fmu.errors import InputError, RunError
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile, FmuSession, SavedState
from pyfmi_runner.loop import MICROSECOND, set_inputs
from pyfmi_runner.plan import APPROACH, RETREAT, make_plan
from pyfmi_runner.plant import COMMANDS, OUTPUTS, check_gantry
from pyfmi_runner.scenario import Scenario
from pyfmi_runner.sensors import initial_state, sense

__all__ = ["ENV_ID", "GantryEnv"]

ENV_ID = "PneuGantry-v0"
FORCE_SCALE, SPEED_SCALE = 10.0, 0.05  # N, m/s: errors that count as one
WORST = 100.0  # of one squared error
FAILURE = -1000.0
LIMITS = (
    2.0,
    2.0,
    20.0,
    20.0,
    1e4,
    1e4,
    1e4,
    1e4,
    1e3,
    10.0,
)  # of the observation, m, m/s, N, N, m/s; readings are clipped there
Array = NDArray[np.float64]


class GantryEnv(gymnasium.Env[Array, Array]):
    """`scenario`: the run (its controller plays no part); `fmu`: a file with the gantry's
    interface; `hold`: ms that an action lasts.

    `reset(options={"scenario": Scenario(...)})` or `options={"plant": {"contact.K_c": 2e4}}`
    changes the run from there on. Raises InputError for a scenario or FMU that cannot be used,
    ValueError for `hold` < 1.
    """

    metadata = {"render_modes": [], "render_fps": 1000}  # noqa: RUF012 - gymnasium's own form

    def __init__(
        self, scenario: Scenario | None = None, fmu: str | Path | None = None, hold: int = 1
    ) -> None:
        if hold < 1:
            raise ValueError(f"hold must be >= 1 ms, got {hold}")
        self.file = FmuFile.read(fmu or build_fmu().path)
        check_gantry(self.file)
        self.hold = hold
        limits = np.array(LIMITS)
        self.observation_space = spaces.Box(-limits, limits, dtype=np.float64)
        self.action_space = spaces.Box(U_MIN, U_MAX, (2,), dtype=np.float64)
        self._session: FmuSession | None = None
        self._prepare(scenario or Scenario(workpiece="straight"))

    def _prepare(self, scenario: Scenario) -> None:
        """Lays the scenario out and runs its approach once; every episode starts from the state
        saved at its end.
        """
        self.close()
        self.scenario, self.plan = scenario, make_plan(scenario)
        phase = self.plan.phase
        self._first = int(np.argmax(phase != APPROACH))
        self._end = (
            int(np.argmax(phase == RETREAT)) if (phase == RETREAT).any() else self.plan.samples
        )
        self._fmu = FmuSession(self.file, parameters=self.plan.parameters)
        self._fmu.__enter__()
        self._session = self._fmu
        for k in range(self._first):
            set_inputs(self._fmu, self.plan, k)
            self._fmu.set(COMMANDS, self.plan.approach)
            self._step(k)
        self._start: SavedState = self._fmu.save_state()

    def _step(self, k: int) -> None:
        self._fmu.step(self.plan.period * MICROSECOND, time=k * self.plan.period * MICROSECOND)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        options = dict(options or {})
        scenario = options.pop("scenario", self.scenario)
        scenario = replace(scenario, plant=scenario.plant | options.pop("plant", {}))
        if options:
            raise InputError(
                f"unknown option {next(iter(options))!r}",
                field="options",
                hint="give scenario or plant",
            )
        if scenario != self.scenario:
            self._prepare(scenario)
        self._fmu.load_state(self._start)
        self._k = self._first
        speeds = self._fmu.get(("v_x", "v_z"))
        self._sensors = initial_state(*map(float, speeds))
        return self._observe(), self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        if self._k >= self._end:
            raise RunError("the episode has ended; call reset first")
        u = np.clip(np.asarray(action, dtype=np.float64), U_MIN, U_MAX)
        reward, terminated = 0.0, False
        for _ in range(self.hold):
            try:
                set_inputs(self._fmu, self.plan, self._k)
                self._fmu.set(COMMANDS, u)
                self._step(self._k)
                self._k += 1
                reward += self._reward()
            except (RunError, InputError):
                reward, terminated = reward + FAILURE, True
                break
            if self._k >= self._end:
                break
        truncated = not terminated and self._k >= self._end
        if terminated:  # the FMU takes no more questions until the next reset
            return (
                self._last,
                reward,
                True,
                False,
                {"time": self._k * self.plan.period * MICROSECOND},
            )
        return self._observe(), reward, terminated, truncated, self._info()

    def _reward(self) -> float:
        f_n, v_t = self._fmu.get(("f_n", "v_t"))
        row = self._k - 1
        force, speed = (
            (f_n - self.plan.f_nd[row]) / FORCE_SCALE,
            (v_t - self.plan.v_td[row]) / SPEED_SCALE,
        )
        return (
            -float(min(force * force, WORST) + min(speed * speed, WORST))
            * self.plan.period
            * MICROSECOND
        )

    def _observe(self) -> Array:
        row = min(self._k, self.plan.samples - 1)
        draws = self.np_random.standard_normal(8)
        self._sensors, seen = sense(
            self.scenario.sensors, self._sensors, tuple(self._fmu.get(OUTPUTS)), draws
        )
        values = np.array([*seen, self.plan.f_nd[row], self.plan.v_td[row]])
        self._last = np.clip(values, self.observation_space.low, self.observation_space.high)  # type: ignore[attr-defined]
        return self._last

    def _info(self) -> dict[str, Any]:
        f_n, v_t, theta = (float(v) for v in self._fmu.get(("f_n", "v_t", "theta")))
        return {
            "time": self._k * self.plan.period * MICROSECOND,
            "f_n": f_n,
            "v_t": v_t,
            "theta": theta,
        }

    def close(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None


if ENV_ID not in gymnasium.registry:
    gymnasium.register(id=ENV_ID, entry_point="pyfmi_runner.gym_env:GantryEnv")
