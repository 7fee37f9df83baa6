"""Replies to an addend: a matrix from few pulses says what a simulation says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from pneugantry.engine.plant import Record
from pneugantry.learn.curves.curve import Wave, finer, knots_over
from pneugantry.learn.experiments import variants
from pneugantry.learn.screening.reply import Pulses, Reply, both_ways, means, reply_of

ROWS, STEP = 600, 0.01  # s


@dataclass
class Lag:
    """A first-order lag whose time constant changes with time, read every second row."""

    tau: float  # s
    runs: int = 0

    def __call__(self, series: list[np.ndarray]) -> np.ndarray:
        self.runs += len(series)
        found = np.zeros((len(series), ROWS // 2, 1))
        for n, u in enumerate(series):
            y = np.zeros(ROWS)
            for k in range(1, ROWS):
                y[k] = y[k - 1] + STEP / (self.tau * (1 + k / ROWS)) * (u[k - 1] - y[k - 1])
            found[n, :, 0] = y.reshape(-1, 2).mean(axis=1)
        return found


def replies(reply: Reply, series: np.ndarray) -> np.ndarray:
    """(rows, signals, n) to series (rows of the record, n)."""
    return np.asarray(reply.matrix @ means(series, reply.block))


def pulses(most: int) -> Pulses:
    return Pulses(("view", "log"), ROWS, ROWS // 2, 2, 1, np.array([1e-3]), most)


@pytest.mark.parametrize(("tau", "most", "runs"), [(0.03, 24, 30), (2.0, 24, 30), (0.2, 6, 14)])
def test_a_few_pulses_say_what_a_simulation_says(tau: float, most: int, runs: int) -> None:
    lag = Lag(tau)
    reply = reply_of(pulses(most), lag, 1.0)
    assert reply is not None
    assert lag.runs <= runs
    t = STEP * np.arange(ROWS)
    series = np.column_stack([np.sin(9 * t), np.tanh(8 * np.sin(3 * t)), t**2])
    for k in range(3):
        exact, told = lag([series[:, k]])[0, :, 0], replies(reply, series)[:, 0, k]
        assert told == pytest.approx(exact, abs=0.03 * np.ptp(exact))


def test_a_carriage_that_sticks_for_a_while_still_replies() -> None:
    """Nothing answers at the places that are tried first."""

    def stuck(series: list[np.ndarray]) -> np.ndarray:
        found = np.zeros((len(series), ROWS // 2, 1))
        for n, u in enumerate(series):
            free = np.where(np.arange(ROWS) > 0.75 * ROWS, u, 0.0)
            found[n, :, 0] = 0.3 * free.reshape(-1, 2).mean(axis=1)
        return found

    reply = reply_of(pulses(24), stuck, 1.0)
    assert reply is not None
    series = np.sin(0.02 * np.arange(ROWS))[:, None]
    told, exact = replies(reply, series)[:, 0, 0], stuck([series[:, 0]])[0, :, 0]
    assert told == pytest.approx(exact, abs=0.02)


def test_events_that_one_direction_meets_are_no_part_of_a_slope() -> None:
    """A carriage breaks away from a push of 0.01 in one row, for five rows, and one that hangs in
    the balance does so however small the push: both would be a hundred times the slope.
    """

    def carriage(series: list[np.ndarray]) -> np.ndarray:
        made = 2.0 * np.stack(series)
        made[:, 300:305] += np.where(np.stack(series)[:, 300:301] > 0.01, 40.0, 0.0)
        made[:, 100:105] += 40.0
        return made[:, :, None]

    push = 0.02 * np.cos(0.01 * np.arange(ROWS))
    alone, both = carriage([push])[0, :, 0], both_ways(carriage)([push])[0, :, 0]
    assert np.abs(alone - 2 * push).max() == 40.0
    there = np.r_[300:305, 100:105]
    elsewhere = np.delete(np.arange(ROWS), there)
    assert both[elsewhere] == pytest.approx(2 * push[elsewhere])
    assert np.abs(both[there]).max() <= 0.04 + 1e-12
    failed = both_ways(lambda series: np.full((len(series), ROWS, 1), np.nan))
    assert np.isnan(failed([push])).all()


def test_what_is_over_at_once_is_told_row_by_row() -> None:
    """A hit that lasts three rows, in a block of ten: its mean says little of it."""
    gain = 1 + 0.5 * np.sin(0.05 * np.arange(ROWS))

    def spring(series: list[np.ndarray]) -> np.ndarray:
        made = [gain * u + 0.3 * np.append(0.0, (gain * u)[:-1]) for u in series]
        return np.stack(made)[..., None]

    fine = Pulses(("view", "log"), ROWS, ROWS, 10, 10, np.array([0.1]), 24)
    reply = reply_of(fine, spring, 1.0)
    assert reply is not None
    assert reply.fine
    hit = np.zeros((ROWS, 1))
    hit[203:206, 0] = [1.0, 3.0, -2.0]
    assert reply.told(hit)[:, 0, 0] == pytest.approx(spring([hit[:, 0]])[0, :, 0], abs=1e-9)
    assert reply.at(hit).shape == (ROWS, 1)
    assert reply.felt()[100, 0] == pytest.approx(np.hypot(gain[100], 0.3 * gain[100]) / 0.1)
    coarse = replies(reply, hit)[:, 0, 0]
    assert np.abs(coarse).max() < 0.2 * np.abs(reply.told(hit)).max()


def test_what_answers_whole_blocks_alone_is_told_by_blocks() -> None:
    def dead_zone(series: list[np.ndarray]) -> np.ndarray:
        felt = np.repeat(np.stack(series).reshape(len(series), -1, 10).mean(axis=2), 10, axis=1)
        return np.where(np.abs(felt) > 0.15, felt, 0.0)[..., None]

    sigma = np.array([0.5])
    reply = reply_of(Pulses(("view", "log"), ROWS, ROWS, 10, 10, sigma, 24), dead_zone, 1.0)
    assert reply is not None
    assert not reply.fine


def test_what_lasts_is_told_by_blocks() -> None:
    reply = reply_of(pulses(24), Lag(0.03), 1.0)
    assert reply is not None
    assert not reply.fine
    with pytest.raises(ValueError, match="fine"):
        reply.felt()


def test_what_does_not_answer_has_no_reply() -> None:
    assert reply_of(pulses(8), lambda series: np.zeros((len(series), 300, 1)), 1.0) is None


def test_means_leave_out_what_is_no_whole_block() -> None:
    assert means(np.arange(7.0), 3)[:, 0].tolist() == [1.0, 4.0]


def test_fine_knots_hold_what_is_narrow() -> None:
    knots = knots_over(np.linspace(-1.0, 1.0, 500), [np.ones(500)])
    assert knots is not None
    fine = finer(knots)
    z = np.linspace(-0.95, 0.95, 200)
    bump = np.exp(-(((z - 0.3) / 0.07) ** 2))
    left = []
    for basis in (knots, fine):
        shapes = basis.shapes(z)
        left.append(bump - shapes @ np.linalg.lstsq(shapes, bump, rcond=None)[0])
    assert np.abs(left[1]).max() < 0.1 < np.abs(left[0]).max()
    assert Wave(0.5).prior(2.0, Wave(0.5).bends[0]).tolist() == [[0.25, 0.0], [0.0, 0.25]]


def test_runs_are_made_of_logged_ones() -> None:
    t = STEP * np.arange(ROWS)
    inputs = {"u": np.sin(t), "supply": np.full(ROWS, 7.4)}
    made = variants(Record("log", STEP, inputs, {"v": t}, {}))
    assert made["with its inputs reversed"].inputs["u"] == pytest.approx(-np.sin(t))
    assert made["with its inputs reversed"].inputs["supply"] == pytest.approx(7.4)
    later = made["after a rest of 2 s"]
    assert later.rows == ROWS + 200
    assert later.inputs["u"][200:] == pytest.approx(np.sin(t))
    assert made["at twice its speed"].rows == ROWS // 2


def test_what_was_recorded_within_rows_drives_no_other_run() -> None:
    t = np.arange(10.0)
    within = {"u": np.column_stack([t - 4.5, t - 4.0])}
    record = Record("log", STEP, {"u": t - 4.5}, {"v": t}, {}, within=within)
    made = variants(record)
    (logged, *others) = made.values()
    assert logged is record
    for varied in others:
        assert len(varied.driving("u")) == varied.rows
        assert not np.array_equal(varied.driving("u"), t - 4.5)
