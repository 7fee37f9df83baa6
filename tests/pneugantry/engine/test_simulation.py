"""Runs of views over records, dealt out to threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from pneugantry.engine.plant import Array, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.simulation import Simulation
from pneugantry.engine.views import View


class Scale:
    """A view whose residual is a parameter."""

    name = "scale"

    def shows(self, record: Record) -> bool:
        return True

    def residuals(self, record: Record, values: Sequence[Mapping[str, float]]) -> Array:
        return np.array([[[v["p"]]] for v in values])


@pytest.mark.parametrize("counts", [(1, 0), (3, 40), (0, 0), (9, 70)])
def test_each_run_comes_back_in_its_place(counts: tuple[int, int]) -> None:
    """A cell without a job is none: what is tried about an end may be out of bounds altogether."""
    records = [SimpleNamespace(name=n, rows=10, period=0.1) for n in ("a", "b")]
    simulation = Simulation(
        [cast(View, Scale())], [cast(Record, record) for record in records], Rules()
    )
    jobs = {
        ("scale", r.name): [{"p": float(k)} for k in range(n)]
        for r, n in zip(records, counts, strict=True)
    }
    found = simulation.run(jobs)
    simulation.close()
    assert set(found) == {cell for cell, own in jobs.items() if own}
    for cell, made in found.items():
        assert made[:, 0, 0].tolist() == [job["p"] for job in jobs[cell]]
