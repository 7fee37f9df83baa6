"""Lag inversion and friction observer."""

import numpy as np
import pytest

from controllers.interface import Reference, Sense
from controllers.observer_fv import M_Z, ObserverFv, observed, observer_next
from controllers.valve import K_Z, TAU_Z, U_0Z

AT_REST = Sense(0.6, 0.04, 0.0, 0.0, 0.0, 30.0, 0.0, 30.0)


def test_observer_finds_a_constant_friction_while_the_piston_accelerates():
    s, v, t, dt = 0.0, 0.0, 0.02, 1e-3
    for _ in range(400):
        net = 12.0 + M_Z * 0.5  # friction 12 N, acceleration 0.5 m/s2
        s = observer_next(s, M_Z, v, net, t, dt)
        v += 0.5 * dt
    assert observed(s, M_Z, v, t, 40.0) == pytest.approx(12.0, abs=0.1)


def test_valve_closes_with_the_lag_divided_by_one_plus_k_f():
    controller = ObserverFv(
        k_p=0.0, k_i=0.0, damping=0.0, k_f=9.0, t_z=1e6
    )  # no observer: f_d is f_nd
    f_a, forces = 0.0, []
    for _ in range(60):
        command = controller.step(Reference(30.0, 0.0), AT_REST._replace(f_az=f_a))
        f_a += (K_Z * (command.u_z - U_0Z) - f_a) * (1.0 - np.exp(-1e-3 / TAU_Z))
        forces.append(f_a)
    at_one_constant = forces[round(1e3 * TAU_Z / 10.0) - 1]
    assert at_one_constant == pytest.approx(30.0 * (1.0 - np.exp(-1.0)), rel=0.05)


def test_integral_waits_while_the_valve_is_saturated():
    controller = ObserverFv()
    for _ in range(50):
        controller.step(Reference(5000.0, 0.0), AT_REST)
    assert controller.state.i_n == 0.0


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [("t_z", 0.0, "t_z must be > 0"), ("k_p", -1.0, "k_p"), ("k_q", 1.0, "unknown")],
)
def test_unusable_options_are_refused_by_name(option, value, message):
    with pytest.raises(ValueError, match=message):
        ObserverFv(**{option: value})
