"""Crosstalk from a channel that a record lacks."""

from __future__ import annotations

import numpy as np

from pneugantry.engine.plant import Record
from pneugantry.engine.signals.sensors import sensed, true_signal

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
