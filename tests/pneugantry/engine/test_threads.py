"""Threads of a diagnosis."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from test_search import CATALOGUE, PERIOD, SIGMA, parts, plant, record
from threadpoolctl import threadpool_info, threadpool_limits

from pneugantry.engine.plant import Data, Plant
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import run
from pneugantry.engine.task import Task
from pneugantry.engine.threads import Pooled, one_blas_thread
from pneugantry.engine.views.build import build_views

__all__ = ["parts", "plant"]  # fixtures


def blas_threads() -> list[int]:
    """Of each library that is loaded."""
    return [int(i["num_threads"]) for i in threadpool_info() if i["user_api"] == "blas"]


def test_linear_algebra_has_one_thread_within_and_what_it_had_behind() -> None:
    np.linalg.solve(np.eye(2), np.ones(2))
    scipy.linalg.solve(np.eye(2), np.ones(2))
    with threadpool_limits(2, "blas"):
        before = blas_threads()
        if not before:
            pytest.skip("no BLAS here tells its threads")
        with one_blas_thread():
            assert blas_threads() == [1] * len(before)
        assert blas_threads() == before == [2] * len(before)


def test_a_diagnosis_keeps_to_one(plant: Plant, parts: Path) -> None:
    rules = Rules()
    data = Data((record("one", 1),), record("held", 2))
    views = build_views(plant, list(SIGMA), parts, PERIOD, rules)
    seen: list[list[int]] = []
    with threadpool_limits(2, "blas"):
        if not blas_threads():
            pytest.skip("no BLAS here tells its threads")
        run(
            Task(plant, views, data, CATALOGUE, parts),
            rules,
            say=lambda stage: seen.append(blas_threads()),
        )
    assert len(seen) > 2
    assert all(n == 1 for threads in seen for n in threads)


def test_who_is_at_work_ends_when_the_user_cancels() -> None:
    """Each would go on for ever; so would who waits for them."""

    def do(kind: str, jobs: list[float]) -> list[float]:
        time.sleep(0.01)
        return jobs

    pooled: Pooled[str, float, float] = Pooled(do, 1, 4)
    ended: list[float] = []

    def call(value: float) -> float:
        while True:
            try:
                pooled.run([("kind", value)] * 3)
            except RuntimeError:
                ended.append(value)
                raise
            if value == 0.0:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pooled.side_by_side(call, [0.0, 1.0, 2.0, 3.0])
    pooled.close()
    assert set(ended) <= {1.0, 2.0, 3.0}
    with pytest.raises(RuntimeError, match="closed"):
        pooled.run([("kind", 1.0)])
