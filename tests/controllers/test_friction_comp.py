"""Friction compensators: what they add to the commands of PI FV."""

import pytest
from numba import njit

from controllers.catalogue import make_controller
from controllers.interface import Reference, Sense
from controllers.perfect_friction import PerfectFriction, SenseWithFriction
from controllers.pi_fv import PiFv

REFERENCE = Reference(30.0, -0.06)
MOVING = Sense(0.9, 0.05, -0.06, 0.02, 0.0, 30.0, -12.0, 40.0)


def added(controller, sense: Sense) -> tuple[float, float]:
    """a_x, a_z [V] at the first sample."""
    with_it, without = controller.step(REFERENCE, sense), PiFv().step(REFERENCE, sense)
    return without.u_x - with_it.u_x, with_it.u_z - without.u_z


def test_vdfm_compensator_adds_the_friction_of_eq_3_20_and_3_21():
    a_x, a_z = added(make_controller("pi_fv_vdfm"), MOVING)
    assert a_x == pytest.approx((-11.0 + 74.0 * -0.06) / 186.0)
    assert a_z == pytest.approx((15.0 + 40.0 * 0.02) / 100.0)


def test_vdfm_compensator_sticks_on_f_a_as_printed_or_on_the_net_force():
    still = MOVING._replace(v_x=0.0, v_z=0.0)
    assert added(make_controller("pi_fv_vdfm"), still) == pytest.approx(
        (-12.0 / 186.0, 20.0 / 100.0)
    )
    net = make_controller("pi_fv_vdfm", net=True)
    assert added(net, still) == pytest.approx(((-12.0 - 5.0) / 186.0, (40.0 - 30.0 - 5.0) / 100.0))


def test_ddfm_compensator_builds_up_over_the_travel_of_z():
    controller = make_controller("pi_fv_ddfm")
    _, a_z = added(controller, MOVING)
    grown = 12.0 * (1.0 - 1.0 / (1.0 + 1e5 * 0.02e-3 / 12.0))
    assert a_z == pytest.approx((grown + 40.0 * 0.02) / 100.0)
    for _ in range(500):
        controller.step(REFERENCE, MOVING)
    assert controller.state.force_z == pytest.approx(12.0, rel=0.02)


def test_combined_compensator_hands_over_from_ddfm_to_vdfm_with_displacement():
    slow = MOVING._replace(v_x=0.0, v_z=0.0101)
    first = make_controller("pi_fv_combined")
    _, a_z = added(first, slow)
    ddfm = 12.0 * (1.0 - 1.0 / (1.0 + 1e5 * 1.01e-5 / 12.0))
    assert a_z == pytest.approx((ddfm + 40.0 * 0.0101) / 100.0)
    for _ in range(120):  # 1.2 mm
        first.step(REFERENCE, slow)
    plain = PiFv()
    for _ in range(121):
        plain.step(REFERENCE, slow)
    a_z = first.step(REFERENCE, slow).u_z - plain.step(REFERENCE, slow).u_z
    assert a_z == pytest.approx((15.0 + 40.0 * 0.0101) / 100.0)


def test_perfect_compensator_adds_the_friction_that_the_plant_has():
    told = SenseWithFriction(*MOVING, friction_x=-7.0, friction_z=3.0)
    a_x, a_z = added(PerfectFriction(), told)
    assert a_x == pytest.approx((-7.0 + 74.0 * -0.06) / 186.0)
    assert a_z == pytest.approx((3.0 + 40.0 * 0.02) / 100.0)


def test_perfect_compensator_compiles_to_the_same_bits():
    kernel = PerfectFriction.kernel

    @njit
    def once(params, state, reference, sense):
        return kernel(params, state, reference, sense)

    controller, told = (
        PerfectFriction(),
        SenseWithFriction(*MOVING, friction_x=-7.0, friction_z=3.0),
    )
    assert once(controller.params, controller.state, REFERENCE, told)[1] == controller.step(
        REFERENCE, told
    )


@pytest.mark.parametrize("options", [{"small": 1e-3, "large": 1e-3}, {"dead": -1.0}])
def test_impossible_bounds_are_refused(options):
    with pytest.raises(ValueError, match="must be"):
        make_controller("pi_fv_combined", **options)
