"""Crosstalk from a channel that a record lacks, and names with dots."""

from __future__ import annotations

import numpy as np

from pneugantry.engine.plant import Record
from pneugantry.engine.signals.sensors import affine, sensed, signal_of, true_signal

VALUES = {"sensors.a.from.b": 0.5}


def test_a_channel_adds_its_share_where_the_record_has_it() -> None:
    a, b = np.arange(4.0), np.ones(4)
    record = Record("both", 1e-3, {}, {"a": a, "b": b}, {})
    assert np.array_equal(sensed("a", a, record, VALUES), a + 0.5)
    assert np.array_equal(true_signal("a", record, VALUES), a - 0.5)


def test_a_channel_that_the_record_lacks_adds_nothing() -> None:
    a = np.arange(4.0)
    record = Record("one", 1e-3, {}, {"a": a}, {})
    assert np.array_equal(sensed("a", a, record, VALUES), a)
    assert np.array_equal(true_signal("a", record, VALUES), a)


def test_two_channels_that_leak_into_each_other_are_told_apart_again() -> None:
    """r = (I + C) g: what leaks back does not count as a scale."""
    rng = np.random.default_rng(0)
    true, leak = rng.normal(size=(40, 2)), np.array([[0.0, 0.2], [-0.3, 0.0]])
    own = true * (1.1, 0.9) + (0.3, 0.0)
    values = {"sensors.a.from.b": 0.2, "sensors.b.from.a": -0.3}
    values |= {"sensors.a.scale": 1.1, "sensors.a.bias": 0.3, "sensors.b.scale": 0.9}
    read = own @ (np.eye(2) + leak).T
    record = Record("both", 1e-3, {}, dict(zip("ab", read.T, strict=True)), {})
    for i, name in enumerate("ab"):
        np.testing.assert_allclose(sensed(name, true[:, i], record, values), read[:, i])
        np.testing.assert_allclose(true_signal(name, record, values), true[:, i])


def test_a_signal_s_name_may_hold_dots() -> None:
    """Its errors are none of a signal whose name its own begins with."""
    values = {"sensors.motor.u.bias": 0.25, "sensors.motor.u.from.motor": 0.5}
    assert [signal_of(name) for name in values] == ["motor.u", "motor.u"]
    assert signal_of("sensors.motor.from.motor.u") == signal_of("sensors.motor.scale") == "motor"
    u, other = np.arange(4.0), np.ones(4)
    record = Record("one", 1e-3, {}, {"motor.u": u, "motor": other}, {})
    assert np.array_equal(sensed("motor.u", u, record, values), u + 0.75)
    assert np.array_equal(true_signal("motor", record, values), other)
    assert affine("motor", values) == (1.0, 0.0)
