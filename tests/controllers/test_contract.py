"""What every controller of the catalogue promises."""

import pickle
from typing import Any

import numpy as np
import pytest

from controllers.catalogue import controller_names, make_controller
from controllers.interface import Controller


@pytest.fixture(params=controller_names())
def controller(request: pytest.FixtureRequest) -> Controller:
    return make_controller(request.param)


def flat(value: Any) -> bytes:
    """Bits of all numbers in a state, in order."""
    if isinstance(value, tuple):
        return b"".join(flat(item) for item in value)
    return np.asarray(value).tobytes()


def all_finite(value: Any) -> bool:
    if isinstance(value, tuple):
        return all(all_finite(item) for item in value)
    return bool(np.all(np.isfinite(value)))


def shapes(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(shapes(item) for item in value)
    return np.asarray(value).shape, np.asarray(value).dtype


def test_reset_replays_bit_for_bit(controller, samples, run_python):
    first = run_python(controller, *samples)
    controller.reset()
    assert run_python(controller, *samples).tobytes() == first.tobytes()


def test_reset_allocates_a_state_of_its_own(controller, samples, run_python):
    before = controller.state
    bits = flat(before)
    controller.reset()
    run_python(controller, samples[0][:20], samples[1][:20])
    assert flat(before) == bits


@pytest.mark.parametrize("seed", [7, 8])
def test_compiled_loop_equals_python_bit_for_bit(
    controller, seed, run_python, run_compiled, noisy_samples
):
    references, senses = noisy_samples(seed)
    commands = run_python(controller, references, senses)
    last = flat(controller.state)
    controller.reset()
    compiled = run_compiled(controller, references, senses)
    assert np.flatnonzero((commands != compiled).any(axis=1)).size == 0
    assert flat(controller.state) == last


def test_commands_stay_within_0_to_5_volt(controller, samples, run_python):
    commands = run_python(controller, *samples)
    assert commands.min() >= 0.0
    assert commands.max() <= 5.0
    assert np.isfinite(commands).all()
    assert (commands == 0.0).any()


def test_state_stays_finite_and_of_one_shape(controller, samples, run_python):
    start = shapes(controller.state)
    run_python(controller, *samples)
    assert all_finite(controller.state)
    assert shapes(controller.state) == start


def test_controller_pickles_with_its_state(controller, samples, run_python):
    references, senses = samples
    run_python(controller, references[:100], senses[:100])
    copy = pickle.loads(pickle.dumps(controller))
    assert flat(copy.params) == flat(controller.params)
    assert (
        run_python(copy, references, senses).tobytes()
        == run_python(controller, references, senses).tobytes()
    )


def test_run_may_go_on_in_python_after_the_compiled_loop(
    controller, samples, run_python, run_compiled
):
    references, senses = samples[0][:300], samples[1][:300]
    whole = run_python(controller, references, senses)
    controller.reset()
    compiled = run_compiled(controller, references[:150], senses[:150])
    python = run_python(controller, references[150:], senses[150:])
    assert np.vstack([compiled, python]).tobytes() == whole.tobytes()


def test_two_controllers_share_nothing(controller, samples, run_python):
    other = pickle.loads(pickle.dumps(controller))
    other.reset()
    bits = flat(controller.state)
    run_python(other, samples[0][:50], samples[1][:50])
    assert flat(controller.state) == bits


def test_unknown_name_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match="unknown controller 'pi_vf'; nearest is 'pi_fv'"):
        make_controller("pi_vf")


def test_unknown_option_is_refused():
    with pytest.raises(ValueError, match=r"pi_fv.*gain_table"):
        make_controller("pi_fv", gain_table="table_3_5")
