"""Input vectors of the neural compensators against their figures."""

import numpy as np
import pytest

from controllers.nn_inputs import checked_inputs, command_input, force_inputs


def test_14_inputs_are_those_of_figure_5_12():
    p = np.zeros(14)
    f_n = [1.0, 2.0, 4.0, 8.0, 16.0, 19.0]
    for k, f in enumerate(f_n):
        force_inputs(p, 30.0 + k, f)
    e = [30.0 + k - f for k, f in enumerate(f_n)]
    assert p.tolist() == [e[5], e[4], e[3], e[5] - e[4], 35, 34, 33, 32, 31, 19, 16, 8, 4, 2]


def test_5_inputs_are_those_of_figure_5_21():
    p = np.zeros(5)
    for f, u in ((1.0, 0.1), (2.0, 0.2), (4.0, 0.3)):
        force_inputs(p, 30.0, f)
        before = p.copy()
        command_input(p, u)
    assert before.tolist() == [26.0, 28.0, 29.0, 0.2, 0.1]


def test_another_number_of_inputs_is_refused():
    with pytest.raises(ValueError, match="n_i must be 14"):
        checked_inputs(6)
