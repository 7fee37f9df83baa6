"""Rigs drawn from a plant's own model."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pneugantry.engine.calibration.draws import KINDS, Source, _Odd, drawn
from pneugantry.engine.plant import Data, Plant, Record
from pneugantry.engine.views.synthetic import Nominal
from pneugantry.plants.described import described_task

MOTOR = Path(__file__).parents[3] / "examples" / "motor" / "plant.toml"


@pytest.fixture(scope="module")
def source() -> Source:
    _, task = described_task(MOTOR)
    defaults = {k: v for view in task.views for k, v in view.defaults.items()}
    return Source(task.plant, task.data, task.catalogue, defaults, task.cache)


def test_a_seed_draws_one_rig(source: Source) -> None:
    one, again, other = drawn(source, 3), drawn(source, 3), drawn(source, 4)
    assert one.effects == again.effects
    for record, same in zip(one.data.fitted, again.data.fitted, strict=True):
        np.testing.assert_array_equal(record.signals["w"], same.signals["w"])
    assert not np.array_equal(one.data.fitted[0].signals["w"], other.data.fitted[0].signals["w"])


def test_a_drawn_rig_is_read_through_the_plants_converters(source: Source) -> None:
    (speed,) = source.plant.signals
    step = 5 * speed.sigma
    coarse = replace(speed, sigma=float(np.hypot(speed.sigma, step / np.sqrt(12))), step=step)
    rig = drawn(replace(source, plant=replace(source.plant, signals=(coarse,))), 3)
    fine = drawn(source, 3)
    for record, other in zip(rig.data.fitted, fine.data.fitted, strict=True):
        cells = record.signals["w"] / step
        np.testing.assert_allclose(cells, np.round(cells), atol=1e-9)
        assert np.abs(record.signals["w"] - other.signals["w"]).max() < 0.6 * step


def test_all_kinds_are_drawn_and_their_causes_show(source: Source) -> None:
    rigs = [drawn(source, seed) for seed in range(32)]
    assert set(Counter(r.kind for r in rigs)) == set(KINDS)
    for rig in rigs:
        assert len(rig.effects) == {"one": 1, "two": 2, "both": 1}.get(rig.kind, 0)
        assert bool(rig.what) == (rig.kind in ("unknown", "both"))
        assert set(rig.effects) <= set(source.catalogue)
        assert np.isfinite(rig.data.held_out.signals["w"]).all()


def test_logs_of_unlike_channels_are_drawn(
    cart: Plant, push: Record, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log lacks the force, which is read coarsely: no discrepancy is in it or of it."""
    full = Nominal(cart, ["f", "v"], cache).record(push)
    bare = replace(full, name="bare", signals={"speed": full.signals["speed"]})
    force, speed = cart.signals
    coarse = replace(cart, signals=(replace(force, sigma=0.05, step=0.1), speed))
    defaults = {"tau": 0.1, "K": 2.0, "m": 1.0, "c": 0.5}
    rigs = Source(coarse, Data((full, bare), None), {}, defaults, cache)
    monkeypatch.setattr("pneugantry.engine.calibration.draws.KINDS", {"unknown": 1.0})
    for seed in range(6):
        rig = drawn(rigs, seed)
        assert "force" not in rig.what
        assert [set(r.signals) for r in rig.data.fitted] == [{"force", "speed"}, {"speed"}]
        cells = rig.data.fitted[0].signals["force"] / 0.1
        np.testing.assert_allclose(cells, np.round(cells), atol=1e-9)


def test_a_discrepancy_has_its_size(source: Source) -> None:
    """Of a smooth function of its argument: equal arguments, equal errors."""
    odd = _Odd("w", False, "", 0.3, np.array([[1.0, 0.0, 1.0], [2.0, 1.0, -0.5]]))
    at = np.concatenate([np.linspace(0, 1, 500), np.linspace(1, 0, 500)])
    added = odd.added(at)
    assert np.std(added) == pytest.approx(0.3)
    np.testing.assert_allclose(added[:500], added[:499:-1], atol=1e-12)
