"""Solutions of textbook models, written by hand from their equations; nothing of their source."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

Solution = dict[str, Callable[[np.ndarray], np.ndarray]]
PARAMETERS: dict[str, dict[str, float]] = {  # of models that leave them open
    "BasicEquations.CoolingExample.NewtonCooling": {
        "T_inf": 300.0,
        "T0": 363.15,
        "h": 0.7,
        "A": 1.0,
        "m": 0.1,
        "c_p": 1.2,
    },
}
STOP_TIMES: dict[str, float] = {  # s, where 5 s is not the time to look at
    "DiscreteBehavior.Decay.Decay1": 1.99,  # at 2 s it takes the root of a negative number
    "DiscreteBehavior.Decay.Decay2": 1.99,
    "DiscreteBehavior.BouncingBall.BouncingBall": 2.5,  # before its bounces accumulate
    "DiscreteBehavior.BouncingBall.StableBouncingBall": 2.5,
}


def integrated(
    rates: Callable[[float, Any], Any], start: list[float], names: list[str], stop: float
) -> Solution:
    found = solve_ivp(
        rates, (0, stop), start, "LSODA", rtol=1e-9, atol=1e-12, dense_output=True, max_step=0.01
    )
    return {name: row_of(found.sol, k) for k, name in enumerate(names)}


def row_of(solution: Any, k: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: solution(t)[k]


def newton_cooling(stop: float) -> Solution:
    rate = 0.7 * 1.0 / (0.1 * 1.2)
    return {"T": lambda t: 300.0 + 63.15 * np.exp(-rate * t)}


def two_inertias(stop: float) -> Solution:
    """Two inertias, two springs with dampers in a row, the second one to ground."""
    j1, j2, c1, c2, d1, d2 = 0.4, 1.0, 11.0, 5.0, 0.2, 1.0

    def rates(t: float, x: Any) -> list[float]:
        p1, p2, w1, w2 = x
        torque = c1 * (p2 - p1) + d1 * (w2 - w1)
        return [w1, w2, torque / j1, (-torque - c2 * p2 - d2 * w2) / j2]

    return integrated(rates, [0, 1, 0, 0], ["phi1", "phi2", "omega1", "omega2"], stop)


def backlash(stop: float) -> Solution:
    """The same with play: beyond 0.25 rad a stiff spring acts as well."""
    j1, j2, c1, c2, d1, d2, kb, b = 0.4, 1.0, 11.0, 5.0, 0.2, 1.0, 1000.0, 0.5

    def rates(t: float, x: Any) -> list[float]:
        p1, p2, w1, w2 = x
        d = p2 - p1
        torque = kb * np.sign(d) * max(abs(d) - b / 2, 0) + c1 * d + d1 * (w2 - w1)
        return [w1, w2, torque / j1, (-torque - c2 * p2 - d2 * w2) / j2]

    return integrated(rates, [0, 0, 5, 0], ["phi1", "phi2", "omega1", "omega2"], stop)


def two_inertias_as_states(stop: float) -> Solution:
    found = two_inertias(stop)
    names = ["phi1", "phi2", "omega1", "omega2"]
    return {f"x[{k}]": found[name] for k, name in enumerate(names, 1)}


def hares_and_lynxes(stop: float) -> Solution:
    """Lotka and Volterra: x' = x (0.1 - 0.02 y), y' = y (0.02 x - 0.4)."""

    def rates(t: float, x: Any) -> list[float]:
        return [x[0] * (0.1 - 0.02 * x[1]), x[1] * (0.02 * x[0] - 0.4)]

    return integrated(rates, [10, 10], ["x[1]", "x[2]"], stop)


def bouncing(stop: float) -> Solution:
    """Free fall from 1 m; each bounce keeps 0.8 of the speed."""
    g, e = 9.81, 0.8
    first = np.sqrt(2 / g)
    starts, speeds = [0.0, first], [0.0, e * g * first]
    while starts[-1] < stop:
        starts.append(starts[-1] + 2 * speeds[-1] / g)
        speeds.append(e * speeds[-1])

    def of(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k = np.searchsorted(starts, t, side="right") - 1
        since, speed = t - np.array(starts)[k], np.array(speeds)[k]
        height = np.where(k == 0, 1.0, 0.0) + speed * since - g * since**2 / 2
        return height, speed - g * since

    return {"h": lambda t: of(t)[0], "v": lambda t: of(t)[1]}


def sampled_speed(stop: float) -> Solution:
    omega = two_inertias(stop)["omega1"]
    return {"omega1_measured": lambda t: omega(np.floor(t / 0.125 + 1e-9) * 0.125)}


TOOTH = 2 * 3.14159 / 200  # rad


def teeth_passed(stop: float) -> np.ndarray:
    """Times at which the first inertia has turned by one tooth since the last one, either way."""
    phi = two_inertias(stop)["phi1"]
    t = np.linspace(0, stop, 200_001)
    angle, level, found = phi(t), 0.0, []
    for k in range(1, len(t)):
        while abs(angle[k] - level) >= TOOTH:
            level += TOOTH * np.sign(angle[k] - level)
            share = (level - angle[k - 1]) / (angle[k] - angle[k - 1])
            found.append(t[k - 1] + share * (t[1] - t[0]))
    return np.array(found)


def speed_from_intervals(stop: float) -> Solution:
    times = np.concatenate([[0.0], teeth_passed(stop)])
    speeds = np.concatenate([[0.0], TOOTH / np.diff(times)])
    return {
        "omega1_measured": lambda t: speeds[np.searchsorted(times, t, side="right") - 1],
        "last_time": lambda t: times[np.searchsorted(times, t, side="right") - 1],
    }


def speed_from_counts(stop: float) -> Solution:
    times = teeth_passed(stop)
    ticks = np.arange(0, stop + 0.125, 0.125)
    counts = np.diff(np.searchsorted(times, ticks), prepend=0)

    def measured(t: np.ndarray) -> np.ndarray:
        return counts[np.floor(t / 0.125 + 1e-9).astype(int)] * TOOTH / 0.125

    return {"omega1_measured": measured}


def tent(stop: float) -> Solution:
    """Straight lines through (0, 0), (2, 0), (4, 2), (6, 0), and their integral up to 6."""

    def integral(t: np.ndarray) -> np.ndarray:
        rising, falling = np.clip(t - 2, 0, 2), np.clip(t - 4, 0, 2)
        return rising**2 / 2 + 2 * falling - falling**2 / 2

    return {"y": lambda t: np.interp(t, [0, 2, 4, 6], [0, 0, 2, 0]), "z": integral}


def ticks(stop: float) -> Solution:
    """A clock of 0.1 s from 0 s on: how often it has ticked, and the time of its last tick; z: of
    every second one.
    """

    def passed(t: np.ndarray, interval: float) -> np.ndarray:
        return np.floor(t / interval + 1e-9)

    return {
        "tick": lambda t: np.where(t > 0, passed(t, 0.1) + 1, 0),  # its first tick follows 0 s
        "count": lambda t: passed(t, 0.1),
        "pulse": lambda t: passed(t, 0.1) % 2,
        "x": lambda t: 0.1 * passed(t, 0.1),
        "y": lambda t: 0.1 * passed(t, 0.1),
        "z": lambda t: 0.2 * passed(t, 0.2),
        "e": np.zeros_like,
    }


def two_clocks(stop: float) -> Solution:
    """Which of two clocks of 0.1 s is first at an instant is a matter of the last digit of 0.1 k;
    their difference is therefore not compared, each of them is.
    """
    return {name: value for name, value in ticks(stop).items() if name != "e"}


def slid(stop: float) -> Solution:
    """x' = -1 above 1, +1 below: from 2 down to 1, where it stays (Filippov's solution)."""
    return {"x": lambda t: np.maximum(2 - t, 1.0)}


def rectified(stop: float) -> Solution:
    """Integral of twice the positive half periods of a wave of 1 Hz."""
    return {"x": lambda t: np.floor(t) + np.minimum(2 * (t % 1), 1), "y": lambda t: t}


def parabola(stop: float) -> Solution:
    """t^2 - 2 t + 2 and its derivative."""
    value, rate = (lambda t: t**2 - 2 * t + 2), (lambda t: 2 * t - 2)
    return {"yf": value, "yp": value, "d_yf": rate, "d_yp": rate}


AMBIENT, HEATED, WANTED = 285.0, 297.5, 295.0  # K; heated: where 25 W over 2 W/K lead to


def heated_on_and_off(stop: float) -> Solution:
    """Falls from 300 K below 294 K, rises above 296 K, and so on, with a time constant of 0.5 s."""
    starts, levels, on = [0.0], [WANTED + 5], [False]
    while starts[-1] < stop:
        goal, turn = (HEATED, WANTED + 1) if on[-1] else (AMBIENT, WANTED - 1)
        starts.append(starts[-1] + 0.5 * np.log((levels[-1] - goal) / (turn - goal)))
        levels.append(turn)
        on.append(not on[-1])

    def piece(t: np.ndarray) -> np.ndarray:
        return np.searchsorted(starts, t, side="right") - 1

    def temperature(t: np.ndarray) -> np.ndarray:
        k = piece(t)
        goal = np.where(np.array(on)[k], HEATED, AMBIENT)
        return goal + (np.array(levels)[k] - goal) * np.exp(-2 * (t - np.array(starts)[k]))

    def heat(t: np.ndarray) -> np.ndarray:
        return np.array(on)[piece(t)].astype(float)

    return {"T": temperature, "heat": heat, "Q": lambda t: 25 * heat(t)}


def heated_chattering(stop: float) -> Solution:
    """Falls to 295 K and stays there; the heater's power is then only known on average."""
    return {"T": lambda t: np.maximum(AMBIENT + 15 * np.exp(-2 * t), WANTED)}


HAND_WRITTEN: dict[str, Callable[[float], Solution]] = {
    "BasicEquations.CoolingExample.NewtonCooling": newton_cooling,
    "BasicEquations.LotkaVolterra.QuiescentModelWithModifications": lambda stop: {
        "x": lambda t: np.full_like(t, 30.0),
        "y": lambda t: np.full_like(t, 5.0),
    },
    "BasicEquations.RotationalSMD.SecondOrderSystem": two_inertias,
    "BasicEquations.RotationalSMD.SecondOrderSystemInitParams": two_inertias,
    "ArrayEquations.StateSpace.Examples.RotationalSMD": two_inertias_as_states,
    "ArrayEquations.StateSpace.Examples.RotationalSMD_Concat": two_inertias_as_states,
    "ArrayEquations.StateSpace.Examples.LotkaVolterra": hares_and_lynxes,
    "DiscreteBehavior.Backlash.Backlash": backlash,
    "DiscreteBehavior.BouncingBall.BouncingBall": bouncing,
    "DiscreteBehavior.BouncingBall.StableBouncingBall": bouncing,
    "Functions.Interpolation.IntegrateInterpolatedVector": tent,
    "DiscreteBehavior.Decay.Decay1": lambda stop: {"x": lambda t: (1 - t / 2) ** 2},
    "DiscreteBehavior.Decay.Decay2": lambda stop: {"x": lambda t: (1 - t / 2) ** 2},
    "DiscreteBehavior.SpeedMeasurement.SampleAndHold": sampled_speed,
    "DiscreteBehavior.SpeedMeasurement.IntervalMeasure": speed_from_intervals,
    "DiscreteBehavior.SpeedMeasurement.CounterWithAlgorithm": speed_from_counts,
    "DiscreteBehavior.Counter.Counter": ticks,
    "DiscreteBehavior.PulseGenerator.PulseGenerator": ticks,
    "DiscreteBehavior.SynchronousSystems.IndependentSampling": two_clocks,
    "DiscreteBehavior.SynchronousSystems.SynchronizedSampling": ticks,
    "DiscreteBehavior.SynchronousSystems.SubsamplingWithIntegers": ticks,
    "DiscreteBehavior.Decay.Decay4": slid,
    "DiscreteBehavior.Decay.Decay5": slid,
    "DiscreteBehavior.Chatter.WithChatter": slid,
    "DiscreteBehavior.Chatter.WithoutChatter": slid,
    "DiscreteBehavior.Accuracy.WithEvents": rectified,
    "DiscreteBehavior.Accuracy.WithNoEvents": rectified,
    "DiscreteBehavior.Hysteresis.ChatteringControl": heated_chattering,
    "DiscreteBehavior.Hysteresis.HysteresisControl": heated_on_and_off,
    "DiscreteBehavior.Hysteresis.HysteresisControlWithAlgorithms": heated_on_and_off,
    "Functions.Polynomials.Differentiation1": parabola,
    "Functions.Polynomials.Differentiation2": parabola,
}
