"""Threads of a diagnosis."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from threadpoolctl import threadpool_info, threadpool_limits

from pneugantry.engine.threads import one_blas_thread


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
