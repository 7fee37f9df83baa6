"""The Gymnasium environment: passes the checker, and an agent that is our controller
gets our log.
"""

from __future__ import annotations

import subprocess
import sys
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402

from controllers.interface import Reference, Sense  # noqa: E402
from controllers.pi_fv import PiFv  # noqa: E402
from modelica_fmu.errors import InputError, RunError  # noqa: E402
from pyfmi_runner.build import build_fmu  # noqa: E402
from pyfmi_runner.fmu import FmuFile  # noqa: E402
from pyfmi_runner.gym_env import ENV_ID, GantryEnv  # noqa: E402
from pyfmi_runner.log import MEASURED  # noqa: E402
from pyfmi_runner.run import run_scenario  # noqa: E402
from pyfmi_runner.scenario import Scenario  # noqa: E402
from pyfmi_runner.sensors import SensorParams  # noqa: E402

PHASES = {
    "approach": (0.0, 0.3),
    "contact": (0.3, 0.6),
    "contour": (0.6, 1.0),
    "retreat": (1.0, 1.2),
}
QUIET = Scenario(
    workpiece="straight", start_z=0.039, phases=PHASES, sensors=SensorParams(noise=False)
)


@pytest.fixture
def env() -> Iterator[GantryEnv]:
    made = GantryEnv(QUIET)
    yield made
    made.close()


def episode(env: GantryEnv, seed: int = 0, **options: Any) -> tuple[np.ndarray, float, bool, bool]:
    """Observations, return, terminated, truncated with our controller as the agent."""
    controller, total = PiFv(), 0.0
    seen, _ = env.reset(seed=seed, options=options or None)
    rows = []
    while True:
        rows.append(seen)
        command = controller.step(Reference(*seen[8:]), Sense(*seen[:8]))
        seen, reward, terminated, truncated, _ = env.step(np.array(command))
        total += reward
        if terminated or truncated:
            return np.array(rows), total, terminated, truncated


def test_gymnasium_makes_it_and_its_checker_passes() -> None:
    made = gymnasium.make(f"pyfmi_runner.gym_env:{ENV_ID}", scenario=QUIET)
    assert made.spec is not None
    assert made.spec.id == ENV_ID
    with warnings.catch_warnings():
        warnings.filterwarnings("error")
        warnings.filterwarnings(
            "ignore", message=".*symmetric and normalized space.*"
        )  # the action is volts
        check_env(made.unwrapped)
    made.close()


def test_our_controller_as_the_agent_gets_our_log(env: GantryEnv) -> None:
    rows, _, terminated, truncated = episode(env)
    log = run_scenario(QUIET, FmuFile.read(build_fmu().path), compiled=False).log.table
    expected = log[list(MEASURED)].to_numpy()[300:1000]
    assert (rows[:, :8] == expected).all()
    assert (rows[:, 8] == log["f_nd"][300:1000]).all()
    assert (terminated, truncated) == (False, True)


def test_an_episode_replays_from_its_seed(env: GantryEnv) -> None:
    noisy = GantryEnv(Scenario(workpiece="straight", start_z=0.039, phases=PHASES))
    first, total, _, _ = episode(noisy, seed=5)
    again, same, _, _ = episode(noisy, seed=5)
    other, _, _, _ = episode(noisy, seed=6)
    noisy.close()
    assert (first == again).all()
    assert total == same
    assert (first != other).any()


def test_the_reward_is_the_documented_integral(env: GantryEnv) -> None:
    env.reset()
    _, reward, _, _, info = env.step(np.array([0.6, 1.2]))
    force, speed = (info["f_n"] - 30.0) / 10.0, info["v_t"] / 0.05
    assert reward == pytest.approx(-1e-3 * (force**2 + speed**2), rel=1e-12)
    assert info["time"] == pytest.approx(0.301)


def test_an_action_can_be_held(env: GantryEnv) -> None:
    held = GantryEnv(QUIET, hold=10)
    held.reset(seed=1)
    env.reset(seed=1)
    u = np.array([0.6, 1.1])
    seen, reward, _, _, _ = held.step(u)
    singles = [env.step(u) for _ in range(10)]
    held.close()
    assert reward == pytest.approx(sum(s[1] for s in singles), rel=1e-12)
    assert (seen[[0, 1]] == singles[-1][0][[0, 1]]).all()


def test_options_change_plant_and_scenario(env: GantryEnv) -> None:
    soft, _, _, _ = episode(env, plant={"contact.K_c": 2e3})
    assert env.scenario.plant == {"contact.K_c": 2e3}
    stiff, _, _, _ = episode(env, plant={"contact.K_c": 1e4})
    assert (soft != stiff).any()
    with pytest.raises(InputError, match="unknown option 'nosuch'"):
        env.reset(options={"nosuch": 1})


def test_an_fmu_that_fails_terminates_the_episode_and_a_reset_mends_it(env: GantryEnv) -> None:
    env.reset()
    seen, reward, terminated, truncated, _ = env.step(np.array([np.nan, 1.0]))
    assert (terminated, truncated) == (True, False)
    assert reward <= -1000.0
    assert env.observation_space.contains(seen)
    _, _, terminated, truncated = episode(env)
    assert (terminated, truncated) == (False, True)
    with pytest.raises(RunError, match="call reset"):
        env.step(np.array([0.0, 0.0]))
    with pytest.raises(ValueError, match="hold must be >= 1"):
        GantryEnv(QUIET, hold=0)


def test_gymnasium_loads_only_with_the_environment() -> None:
    code = "import sys, pneugantry.cli, pyfmi_runner.run; sys.exit('gymnasium' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
