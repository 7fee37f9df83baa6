"""What a view integrates of a speed, where the axis runs into its end between two rows."""

import numpy as np
import pytest

from pneugantry.engine.plant import Array, Record, thinned
from pneugantry.engine.signals import readings as of_readings
from pneugantry.engine.signals.readings import Filtered, Readings
from pneugantry.engine.signals.slow import Slowness

PERIOD = 1e-3  # s
SIGMA_S, SIGMA_V = 3e-4, 5e-4  # m, m/s


def stopped(into: float, seed: int) -> tuple[Record, float]:
    """Of an axis at 0.5 m/s that meets its end `into` of the row from row 700 on; how far it goes
    in all, m.
    """
    rng = np.random.default_rng(seed)
    rows = np.arange(2000)
    true = 0.5 * PERIOD * np.minimum(rows, 700 + into)
    speed = np.where(rows <= 700, 0.5, 0.0)
    signals = {
        "s": true + SIGMA_S * rng.standard_normal(2000),
        "v": 1.01 * speed + SIGMA_V * rng.standard_normal(2000),
    }
    return Record("r", PERIOD, {}, signals, {}), float(true[-1])


@pytest.mark.parametrize("every", [1, 2])
def test_the_position_tells_when_a_speed_jumped(every: int) -> None:
    off = []
    for seed, into in enumerate(np.linspace(0.02, 0.98, 25)):
        record, way = stopped(into, seed)
        record = thinned(record, every)
        readings = Readings({"s": SIGMA_S, "v": SIGMA_V}, {"s": "v"}, frozenset(), averaging=True)
        found = readings.value("v", record, {"sensors.v.scale": 1.01})
        off.append(record.period * found.over[:-1].sum() - way)
    noise = SIGMA_V * PERIOD * np.sqrt(2000)  # of the readings' sum
    assert np.sqrt(np.mean(np.square(off))) < np.hypot(0.16 * 0.5 * PERIOD, noise)
    # half a row at most, evenly: 0.29 of a row, where the readings of the speed are all there is


@pytest.mark.parametrize("spread", [1, 2])
def test_the_rate_of_a_speed_leaves_out_what_it_jumps_by(spread: int) -> None:
    """An axis that slows down at 2 m/s2 and meets its end, read in one row or over two: the model's
    rate of change knows no jump; about it the steady rates stay what they are.
    """
    rng = np.random.default_rng(0)
    rows = np.arange(2000)
    true = np.where(rows <= 700, 1.9 - 2.0 * PERIOD * rows, 0.0)
    if spread == 2:
        true[701] = 0.3
    record = Record("r", PERIOD, {}, {"v": true + SIGMA_V * rng.standard_normal(2000)}, {})
    readings = Readings({"v": SIGMA_V}, {}, frozenset(), averaging=True)
    found = readings.rate("v", record, {}).over
    assert found[50:690] == pytest.approx(-2.0, abs=0.2)
    assert found[690:712].min() > -2.5
    assert found[690:712].max() < 1.0
    assert found[715:1950] == pytest.approx(0.0, abs=0.2)


def test_views_of_one_plant_make_a_reading_once() -> None:
    """Where they filter it alike."""
    record, shared = stopped(0.3, 0)[0], Filtered()
    sigmas, pairs = {"s": SIGMA_S, "v": SIGMA_V}, {"s": "v"}

    def made(signal: str, averaging: bool, drawn: str) -> object:
        view = Readings(sigmas, pairs, frozenset({drawn}), averaging, shared)
        return view.value(signal, record, {"sensors.s.scale": 1.01})

    first = made("s", True, "v")
    assert made("s", True, "x") is first
    assert made("s", False, "v") is not first
    assert made("s", True, "s") is not first
    assert made("v", True, "v") is not made("v", True, "x")
    shared.forget()
    assert made("s", True, "v") is not first


def test_what_a_slow_speed_stands_for_is_found_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """For its own value, what it jumps by, and the position that is smoothed with it."""
    record, found = stopped(0.3, 0)[0], list[float]()
    own = of_readings.stood_for

    def stood_for(values: Array, slow: Slowness, sigma: float, period: float) -> Array:
        found.append(slow.lag)
        return own(values, slow, sigma, period)

    monkeypatch.setattr(of_readings, "stood_for", stood_for)
    readings = Readings({"s": SIGMA_S, "v": SIGMA_V}, {"s": "v"}, frozenset(), averaging=True)
    for lag in (0.01, 0.02):
        for signal in ("v", "s", "v"):
            readings.value(signal, record, {"sensors.v.lag": lag})
    assert found == [0.01, 0.02]


def test_a_position_is_smoothed_alike_at_once_and_in_parts() -> None:
    """An error that changes in time is taken out before, others behind the filter."""
    record = stopped(0.3, 0)[0]
    readings = Readings({"s": SIGMA_S, "v": SIGMA_V}, {"s": "v"}, frozenset(), averaging=True)
    errors = {"sensors.s.scale": 1.01, "sensors.v.scale": 0.99, "sensors.v.bias": 0.02}
    parts = readings.value("s", record, errors).at
    at_once = readings.value("s", record, {**errors, "sensors.s.drift": 1e-15}).at
    np.testing.assert_allclose(at_once, parts, rtol=0, atol=1e-2 * SIGMA_S)
