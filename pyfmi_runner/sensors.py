"""The measurement chain of the sampled loop: gain, bias, crosstalk; tachometer lag; noise;
quantisation, in that order.

Channels are ordered as in the logs: x, z [m], v_x, v_z [m/s], f_x, f_z, f_ax, f_az [N]
(`log.MEASURED`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

__all__ = [
    "Channels",
    "SensorParams",
    "SensorState",
    "check_sensors",
    "converter_steps",
    "initial_state",
    "noise_rows",
    "sense",
]

Channels = tuple[float, float, float, float, float, float, float, float]
# RMS noise per channel in its unit, Table 3.3
SIGMA: Channels = (0.3e-3, 0.1e-3, 1.0e-3, 0.5e-3, 0.05, 0.05, 0.05, 0.05)
BORES = 0.032, 0.019  # m, x and z (App. A)
# Each channel's unit per volt: positions and speeds Eq. B-2 and B.3, contact forces Eq. B-1, 48 and
# 49 kPa per volt on the bores Eq. B-3
PER_VOLT: Channels = (
    0.180,
    0.056,
    0.3333,
    0.1323,
    17.0,
    17.0,
    48e3 * math.pi / 4.0 * BORES[0] ** 2,
    49e3 * math.pi / 4.0 * BORES[1] ** 2,
)
NO_STEPS: Channels = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class SensorParams(NamedTuple):
    """What the sensors do to the true values; the defaults are the rig's (Table 3.3)."""

    sigma: Channels = SIGMA  # RMS noise per channel, in its unit
    quantum: Channels = NO_STEPS  # converter step per channel, in its unit; 0: none
    bias_f_x: float = 0.0  # N, added
    bias_f_z: float = 0.0  # N, added
    gain_f_x: float = 1.0
    gain_f_z: float = 1.0
    crosstalk_f_x: float = 0.0  # share of the true f_z that f_x reads besides its own
    crosstalk_f_z: float = 0.0  # share of the true f_x that f_z reads besides its own
    gain_f_ax: float = 1.0
    gain_f_az: float = 1.0
    tau_v_x: float = 0.0  # s, tachometer's time constant; 0: none
    tau_v_z: float = 0.0  # s
    dt: float = 0.001  # s, sampling period
    noise: bool = True


class SensorState(NamedTuple):
    """Tachometers at the last sample."""

    out_x: float  # m/s, filter's output
    out_z: float  # m/s
    in_x: float  # m/s, true speed
    in_z: float  # m/s


def converter_steps(bits: int = 12) -> Channels:
    """Step of a converter over +-10 V per channel, in its unit, by the calibration lines of App. B
    (Eq. B-1 to B-3, B.3; pressure times the bore's area): 12 bits are the thesis' rig.

    Raises ValueError for bits outside 1..24.
    """
    if not 1 <= bits <= 24:
        raise ValueError(f"bits must be 1..24, got {bits!r}")
    volts = 20.0 / 2**bits
    x, z, v_x, v_z, f_x, f_z, f_ax, f_az = (volts * slope for slope in PER_VOLT)
    return x, z, v_x, v_z, f_x, f_z, f_ax, f_az


def initial_state(v_x: float = 0.0, v_z: float = 0.0) -> SensorState:
    """Tachometers that have settled at the true speeds [m/s]."""
    return SensorState(v_x, v_z, v_x, v_z)


def noise_rows(samples: int, seed: int) -> NDArray[np.float64]:
    """Standard normal draws, one row of eight a sample, shape (samples, 8); `sense` scales them by
    sigma.
    """
    return np.random.default_rng(seed).standard_normal((samples, 8))


def check_sensors(params: SensorParams) -> None:
    """Raise ValueError for a value out of range: sigma, quantum and tau >= 0, dt > 0,
    all finite.
    """
    for name, value in params._asdict().items():
        values = value if isinstance(value, tuple) else (value,)
        if name in ("sigma", "quantum") and len(values) != 8:
            raise ValueError(f"{name} must have 8 values, one per channel, got {len(values)}")
        if not all(math.isfinite(v) for v in values):
            raise ValueError(f"{name} must be finite, got {value!r}")
        if name in ("sigma", "quantum", "tau_v_x", "tau_v_z") and min(values) < 0:
            raise ValueError(f"{name} must be >= 0, got {value!r}")
    if params.dt <= 0:
        raise ValueError(f"dt must be > 0 s, got {params.dt!r}")


@register_jitable
def _lag(tau: float, dt: float, out: float, before: float, now: float) -> float:
    """Output of tau*dy/dt + y = v after dt, exact where v runs straight from `before` to `now`."""
    if tau <= 0.0:
        return now
    share = -math.expm1(-dt / tau)
    return out + share * (before - out) + (1.0 - share * tau / dt) * (now - before)


@register_jitable
def _convert(params: SensorParams, channel: int, value: float, draw: float) -> float:
    """Noise, then quantisation to the nearest step (halves upwards)."""
    if params.noise:
        value = value + params.sigma[channel] * float(draw)
    step = params.quantum[channel]
    if step > 0.0:
        value = step * math.floor(value / step + 0.5)
    return value


@register_jitable
def sense(
    params: SensorParams, state: SensorState, true: Channels, noise: NDArray[np.float64]
) -> tuple[SensorState, Channels]:
    """What the sensors say of the true values (tuple or row of 8) at one sample, and their next
    state.

    noise: one row of `noise_rows`. Call once a sample, `dt` apart. A pure kernel: same bits in
    Python and compiled.
    """
    v_x = _lag(params.tau_v_x, params.dt, state.out_x, state.in_x, true[2])
    v_z = _lag(params.tau_v_z, params.dt, state.out_z, state.in_z, true[3])
    f_x = params.gain_f_x * true[4] + params.crosstalk_f_x * true[5] + params.bias_f_x
    f_z = params.gain_f_z * true[5] + params.crosstalk_f_z * true[4] + params.bias_f_z
    measured = (
        _convert(params, 0, true[0], noise[0]),
        _convert(params, 1, true[1], noise[1]),
        _convert(params, 2, v_x, noise[2]),
        _convert(params, 3, v_z, noise[3]),
        _convert(params, 4, f_x, noise[4]),
        _convert(params, 5, f_z, noise[5]),
        _convert(params, 6, params.gain_f_ax * true[6], noise[6]),
        _convert(params, 7, params.gain_f_az * true[7], noise[7]),
    )
    return SensorState(v_x, v_z, true[2], true[3]), measured
