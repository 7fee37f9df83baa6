"""Fisher information of effects beside nuisances: closed forms on a linear Gaussian toy."""

from __future__ import annotations

import numpy as np
import pytest

from pneugantry.engine.planning.information import SEEN, Information, score, sights


def information(columns: np.ndarray, precisions: list[float], **effects: int) -> Information:
    """One view, two records: odd and even rows of the columns."""
    cells = {}
    for record, rows in (("a", columns[::2]), ("b", columns[1::2])):
        cells["view", record] = (tuple(range(columns.shape[1])), rows.T @ rows)
    places, start = {}, len(precisions)
    for key, count in effects.items():
        places[key] = tuple(range(start, start + count))
        start += count
    return Information(np.array(precisions), places, cells, prior=2.0)


def test_without_nuisances_an_effect_stands_out_by_its_length() -> None:
    columns = np.random.default_rng(0).standard_normal((50, 1))
    (found,) = sights(information(columns, [], lone=1))
    assert found.sigma == pytest.approx(np.linalg.norm(columns))
    assert found.told == found.sigma
    assert found.rival is None
    assert found.smallest == pytest.approx(SEEN / np.linalg.norm(columns))


def test_a_nuisance_costs_what_the_posterior_of_linear_gaussians_says() -> None:
    """1/sigma^2 is the effect's variance when nuisances have Gaussian priors."""
    columns = np.random.default_rng(1).standard_normal((60, 3))
    precisions = [4.0, 0.5]
    (found,) = sights(information(columns, precisions, lone=1))
    whole = columns.T @ columns + np.diag([*precisions, 0.0])
    assert found.sigma**-2 == pytest.approx(np.linalg.inv(whole)[2, 2])


def test_an_effect_in_a_nuisance_s_shadow_stands_out_by_the_prior_alone() -> None:
    """The same signature, 1000 sigma long: it is seen where it exceeds the tolerance."""
    column = np.full((100, 1), 100.0)
    columns = np.hstack([column, 5 * column])  # usual size: five times the tolerance
    (found,) = sights(information(columns, [1.0], lone=1))
    assert found.sigma == pytest.approx(5.0, rel=1e-4)
    columns = np.hstack([column, 2 * column])
    (small,) = sights(information(columns, [1.0], lone=1))
    assert small.sigma == pytest.approx(2.0, rel=1e-4)
    assert not small.visible


def test_two_effects_with_the_same_signature_are_not_told_apart() -> None:
    rng = np.random.default_rng(2)
    one, other = 3 * rng.standard_normal((2, 80, 1))
    found = {
        s.effect: s for s in sights(information(np.hstack([one, one, other]), [], a=1, b=1, c=1))
    }
    assert found["a"].visible
    assert found["a"].rival == "b"
    assert found["a"].rivals == ("b",)
    assert found["a"].told < 0.6  # what is left is the other's prior: 1/2
    assert found["c"].rivals == ()
    assert found["c"].own_share > 0.8
    assert score(found.values()) == pytest.approx(1.0 + 2 * found["a"].told / SEEN)


def test_of_several_parameters_each_counts() -> None:
    columns = np.diag([3.0, 4.0])
    (found,) = sights(information(columns, [], both=2))
    assert found.sigma == pytest.approx(5.0)


def test_fewer_records_tell_less() -> None:
    columns = np.random.default_rng(3).standard_normal((40, 2))
    whole = information(columns, [1.0], lone=1)
    (both,), (one,) = sights(whole), sights(whole, ["a"])
    assert one.sigma < both.sigma
    assert {r for _, r, _ in one.seen_by} == {"a"}
    assert sum(share for _, _, share in both.seen_by) == pytest.approx(1.0)


def test_what_no_row_shows_is_never_seen() -> None:
    (found,) = sights(information(np.zeros((20, 1)), [], lone=1))
    assert found.sigma == 0.0
    assert found.smallest == np.inf
    assert not found.seen_by
