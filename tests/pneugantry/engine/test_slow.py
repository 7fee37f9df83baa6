"""What slow sensors' readings stand for: against sines, and the signal itself."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pneugantry.engine.plant import Array, Record
from pneugantry.engine.signals.readings import Readings
from pneugantry.engine.signals.sensors import sensed, slowness
from pneugantry.engine.signals.slow import stood_for

PERIOD = 1e-3  # s
SIGMA_V = 3e-4  # m/s
SLOW = [{"lag": 0.015}, {"delay": 0.0125}, {"window": 0.05}, {"lag": 0.004, "delay": 0.003}]


def errors_of(slow: dict[str, float]) -> dict[str, float]:
    return {f"sensors.v.{what}": value for what, value in slow.items()}


def motion(seed: int, rows: int = 6000) -> Array:
    """A speed in m/s that is driven through a lag of 50 ms, at rest before and after."""
    rng = np.random.default_rng(seed)
    pushed = np.repeat(rng.standard_normal(rows // 200), 200)
    pushed[:400] = pushed[-600:] = 0.0
    keep = np.exp(-PERIOD / 0.05)
    return np.asarray(0.1 * lfilter([1 - keep], [1.0, -keep], pushed))


def read(true: Array, slow: dict[str, float], seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    still = Record("r", PERIOD, {}, {"v": true}, {})
    said = sensed("v", true, still, errors_of(slow))
    noisy = said + SIGMA_V * rng.standard_normal(len(true))
    return Record("r", PERIOD, {}, {"v": noisy}, {})


@pytest.mark.parametrize("slow", SLOW)
def test_the_response_is_that_of_the_sensor(slow: dict[str, float]) -> None:
    """To sines of 1 to 20 Hz, once what was at first has died away."""
    time = PERIOD * np.arange(4000)
    for hertz in (1.0, 5.0, 20.0):
        omega = 2 * np.pi * hertz
        true = np.sin(omega * time)
        said = sensed("v", true, Record("r", PERIOD, {}, {"v": true}, {}), errors_of(slow))
        own = slowness("v", errors_of(slow))
        assert own is not None
        answer = own.response(np.array([omega]))[0]
        expected = np.imag(answer * np.exp(1j * omega * time))
        np.testing.assert_allclose(said[1000:], expected[1000:], atol=2e-3)


@pytest.mark.parametrize("slow", SLOW)
def test_a_slow_speed_is_told_nearly_as_its_noise_allows(slow: dict[str, float]) -> None:
    """Of a motion with corners: near its noise, and within what the readings leave that are only
    earlier.
    """
    errors, left = errors_of(slow), []
    readings = Readings({"v": SIGMA_V}, {}, frozenset({"v"}), averaging=True)
    middle = round(1e3 * (sum(slow.values()) - 0.5 * slow.get("window", 0.0)))
    for seed in range(3):
        true = motion(seed)
        record = read(true, slow, seed)
        earlier = np.append(record.signals["v"][middle:], np.zeros(middle))
        found = readings.value("v", record, errors).at
        left.append([np.std(found - true), np.std(earlier - true)])
    own, shifted = np.sqrt(np.mean(np.square(left), axis=0))
    assert own < 3 * SIGMA_V
    assert own < 0.8 * shifted


def test_a_steady_signal_stays_what_it_is() -> None:
    own = slowness("v", errors_of({"lag": 0.01, "window": 0.02}))
    assert own is not None
    steady = stood_for(np.full(1000, 3.0), own, 0.1, PERIOD)
    np.testing.assert_allclose(steady, 3.0, atol=1e-9)


@pytest.mark.parametrize("slow", [{"lag": 0.01}, {"delay": 0.0073}])
def test_without_noise_it_is_the_signal(slow: dict[str, float]) -> None:
    time = PERIOD * np.arange(3000)
    true = np.sin(5 * time)
    said = sensed("v", true, Record("r", PERIOD, {}, {"v": true}, {}), errors_of(slow))
    assert np.abs(said - true).max() > 0.01
    readings = Readings({"v": SIGMA_V}, {}, frozenset({"v"}), averaging=True)
    back = readings.value("v", Record("r", PERIOD, {}, {"v": said}, {}), errors_of(slow)).at
    inside = slice(400, -400)  # the filter takes the record for a period, which jumps at its ends
    np.testing.assert_allclose(back[inside], true[inside], atol=1e-4)
