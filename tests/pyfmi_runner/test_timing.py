"""Loop timing: instants are whole microseconds, in order, never before their sample."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pyfmi_runner.timing import LoopTiming, action_instants


def test_without_delay_a_command_acts_at_its_sample() -> None:
    assert action_instants(LoopTiming(), 4).tolist() == [0, 1000, 2000, 3000]


def test_fractions_of_a_millisecond_and_more_than_one_are_kept() -> None:
    assert action_instants(LoopTiming(delay=0.00237), 3).tolist() == [2370, 3370, 4370]


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.floats(0.0, 2.8e-4), st.floats(0.0, 0.003), st.integers(0, 2**32))
def test_commands_keep_order_and_never_act_before_their_sample(
    jitter: float, extra: float, seed: int
) -> None:
    timing = LoopTiming(delay=np.sqrt(3) * jitter + extra, jitter=jitter)
    instants = action_instants(timing, 200, seed)
    assert instants.dtype == np.int64
    assert (np.diff(instants) >= 0).all()
    late = instants - 1000 * np.arange(200)
    assert late.min() >= 0
    assert abs(late - 1e6 * timing.delay).max() <= 1e6 * timing.reach + 1


def test_jitter_has_the_rms_it_is_given_and_follows_the_seed() -> None:
    timing = LoopTiming(delay=0.0005, jitter=0.0002)
    instants = action_instants(timing, 20_000, 1)
    assert (instants - 1000 * np.arange(20_000)).std() == pytest.approx(200, rel=0.02)
    assert np.array_equal(instants, action_instants(timing, 20_000, 1))
    assert not np.array_equal(instants, action_instants(timing, 20_000, 2))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"delay": -0.001}, "delay must be 0..600"),
        ({"period": 0.0}, "period must be"),
        ({"period": 0.0010005}, "whole number of microseconds"),
        ({"jitter": 0.0001}, "delay must be at least"),
        ({"jitter": 0.0003, "delay": 0.01}, "in order"),
        ({"delay": float("nan")}, "delay must be 0..600"),
    ],
)
def test_impossible_timings_are_refused(arguments: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LoopTiming(**arguments)
