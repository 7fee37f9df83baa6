"""PI and PID laws on short hand-computed sequences."""

import pytest

from controllers.gains import PidGains
from controllers.pi import barred_side, pi_integrate, pi_output
from controllers.pid import PidState, pid_next, pid_output

GAINS = PidGains(2.0, 10.0, 0.5)


def test_output_uses_the_integral_before_this_error():
    integral, outputs = 0.0, []
    for error in (1.0, -3.0, 0.5):
        outputs.append(pi_output(GAINS, integral, error))
        integral = pi_integrate(GAINS, integral, error, 0.1, 0)
    assert outputs == pytest.approx([2.0, -6.0 + 1.0, 1.0 + 1.0 - 3.0])
    assert integral == pytest.approx(1.0 - 3.0 + 0.5)


@pytest.mark.parametrize(
    ("barred", "error", "taken"), [(1, 1.0, 0.0), (1, -1.0, -1.0), (-1, -1.0, 0.0), (-1, 1.0, 1.0)]
)
def test_integral_takes_only_errors_that_lead_away_from_the_barred_side(barred, error, taken):
    assert pi_integrate(GAINS, 0.0, error, 0.1, barred) == pytest.approx(taken)


def test_barred_side_is_that_of_c_and_the_limits_themselves_are_free():
    assert [barred_side(u, 1) for u in (-0.1, 0.0, 5.0, 5.1)] == [-1, 0, 0, 1]
    assert [barred_side(u, -1) for u in (-0.1, 0.0, 5.0, 5.1)] == [1, 0, 0, -1]


def test_derivative_is_the_backward_difference_and_0_at_the_first_sample():
    state = PidState()
    assert pid_output(GAINS, state, 1.0, 0.1) == pytest.approx(2.0)
    state = pid_next(GAINS, state, 1.0, 0.1, 0)
    assert pid_output(GAINS, state, 1.2, 0.1) == pytest.approx(2.4 + 1.0 + 0.5 * 0.2 / 0.1)
