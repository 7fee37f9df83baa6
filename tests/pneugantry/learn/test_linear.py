"""A term beside a fit: products of small matrices say what least squares over all rows says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import pytest

from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.weighing import Weighing
from pneugantry.engine.hypotheses.hypothesis import Coordinate
from pneugantry.engine.views.simulation import Point
from pneugantry.learn.screening.linear import Base, Reduced, response_of, trial_of
from pneugantry.learn.screening.reply import means

ROWS, BLOCK, CELLS = 240, 4, (("view", "one"), ("view", "two"))
RNG = np.random.default_rng(3)


class Plain:
    """A weighing without colour."""

    def innovations(self, cell: tuple[str, str], values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[..., c] for c in range(values.shape[-1])], axis=-1)


def base() -> Base:
    """Two records with a fit of two coordinates, one of them off its prior."""
    coordinates = tuple(Coordinate(n, 0.0, 1.0, spread=s) for n, s in (("a", 2.0), ("b", 0.5)))
    fit = cast(Fit, type("Stub", (), {"point": Point(coordinates, np.array([0.3, 0.0]), {})})())
    white = {c: RNG.standard_normal(ROWS) for c in CELLS}
    columns = {c: RNG.standard_normal((ROWS, 2)) for c in CELLS}
    folds = {c: ((c[1], slice(0, ROWS)),) for c in CELLS}
    roots = {c: np.ones(ROWS) for c in CELLS}
    return Base(fit, cast(Weighing, Plain()), roots, white, columns, folds)


@dataclass
class Told:
    """A reply."""

    matrix: np.ndarray
    block: int
    fine = False

    def at(self, series: np.ndarray) -> np.ndarray:
        return means(series, self.block)

    def told(self, series: np.ndarray) -> np.ndarray:
        return np.asarray(self.matrix @ self.at(series))

    def felt(self) -> np.ndarray:
        raise NotImplementedError


def test_products_say_what_least_squares_over_all_rows_says() -> None:
    of, prior = base(), np.diag([0.5, 0.5, 2.0])
    replies = {c: Told(RNG.standard_normal((ROWS, 1, ROWS // BLOCK)), BLOCK) for c in CELLS}
    shapes = {c[1]: RNG.standard_normal((ROWS, 3)) for c in CELLS}
    trial = trial_of(response_of(of, replies), shapes)
    for left_out in ("", "two"):
        kept = [c for c in CELLS if c[1] != left_out]
        j = np.concatenate(
            [
                np.column_stack(
                    [of.columns[c], (replies[c].matrix @ means(shapes[c[1]], BLOCK))[:, 0]]
                )
                for c in kept
            ]
        )
        r = np.concatenate([of.white[c] for c in kept])
        precision = np.zeros((5, 5))
        precision[:2, :2], precision[2:, 2:] = np.diag(of.precision), prior
        start = np.append(of.fit.point.theta, np.zeros(3))
        square = j.T @ j + precision
        move = np.linalg.solve(square, -(j.T @ r) - precision @ start)
        least = float(((r + j @ move) ** 2).sum() + (start + move) @ precision @ (start + move))
        occam = np.linalg.slogdet(square)[1] - np.linalg.slogdet(precision)[1]
        found = trial.solved(prior, left_out)
        assert found.coefficients == pytest.approx(move[2:], rel=1e-8)
        assert found.covariance == pytest.approx(np.linalg.inv(square)[2:, 2:], rel=1e-8)
        assert found.cost == pytest.approx(least + occam, rel=1e-10)


def test_a_term_that_is_there_foretells_what_it_has_not_seen() -> None:
    of, size = base(), np.array([0.8])
    shapes = {c[1]: np.repeat(RNG.standard_normal((ROWS // BLOCK, 1)), BLOCK, 0) for c in CELLS}
    kernel = {
        c: Told(np.kron(np.eye(ROWS // BLOCK), np.ones((BLOCK, 1)))[:, None], BLOCK) for c in CELLS
    }
    response = response_of(of, kernel)
    prior = np.eye(1)
    assert trial_of(response, shapes).gain(prior) < 0.0
    for c in CELLS:
        of.white[c][:] -= shapes[c[1]][:, 0] * size  # a fit misses what the term brings
    there = trial_of(response_of(base_like(of), kernel), shapes)
    assert there.gain(prior) > 100.0
    assert there.solved(prior).coefficients == pytest.approx(size, abs=0.15)
    twice = trial_of(response_of(of, kernel).times(-2.0), shapes)
    assert twice.solved(prior / 4).coefficients == pytest.approx(-size / 2, abs=0.1)


@dataclass
class Fine:
    """A reply row by row: a gain."""

    gain: np.ndarray
    block = BLOCK
    fine = True

    @property
    def matrix(self) -> np.ndarray:
        blocks = np.kron(np.eye(ROWS // BLOCK), np.ones((BLOCK, 1)))
        return np.asarray(self.gain[:, None] * blocks)[:, None]

    def at(self, series: np.ndarray) -> np.ndarray:
        return means(series, 1)

    def told(self, series: np.ndarray) -> np.ndarray:
        return np.asarray(self.gain[:, None] * series)[:, None]

    def felt(self) -> np.ndarray:
        return np.abs(self.gain)[:, None]


def test_a_hit_within_a_block_is_seen_where_the_reply_is_fine() -> None:
    of, gain = base(), np.where(np.arange(ROWS) < ROWS // 2, 2.0, 0.0)
    hit = {c[1]: np.zeros((ROWS, 1)) for c in CELLS}
    for c in CELLS:
        hit[c[1]][[13, 30], 0] = 40.0, -40.0
        of.white[c][:] -= gain * hit[c[1]][:, 0]
    told = {c: Fine(gain) for c in CELLS}
    response, prior = response_of(of, told), np.eye(1)
    assert trial_of(response, hit).gain(prior) > 1000.0
    assert trial_of(response, hit).solved(prior).coefficients == pytest.approx([1.0], abs=0.05)
    at, felt, asked = response.says(CELLS[0], {c[1]: hit[c[1]][:, 0] for c in CELLS})
    assert at.max() == 40.0
    assert felt[ROWS // 2 :].max() == 0.0
    assert sorted(np.argsort(asked)[-2:].tolist()) == [13, 30]
    columns = response.times(-1.0).columns(hit)[CELLS[0]]
    assert columns[:, 0] == pytest.approx(-gain * hit["one"][:, 0])


def base_like(of: Base) -> Base:
    """The same without what was summed before its residuals changed."""
    return Base(of.fit, of.weighing, of.roots, of.white, of.columns, of.folds)


def test_what_rounding_has_left_of_a_square_is_solved_all_the_same() -> None:
    """A difference of large products with an eigenvalue of -1e-6 where it has none."""
    vectors = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    square = (vectors * np.array([-1e-6, 0.0, 2.0, 5.0])) @ vectors.T
    exact = (vectors * np.array([0.0, 0.0, 2.0, 5.0])) @ vectors.T
    pull, prior = vectors @ np.array([0.0, 0.0, 4.0, 5.0]), 1e-8 * np.eye(4)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(square + prior)
    found = Reduced(square, pull, 0.0).solved(prior)
    wanted = Reduced(exact, pull, 0.0).solved(prior)
    assert found.coefficients == pytest.approx(wanted.coefficients, abs=1e-6)
    assert np.linalg.eigvalsh(found.covariance)[0] > 0
