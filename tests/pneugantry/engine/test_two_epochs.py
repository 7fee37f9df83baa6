"""The joined plant of two campaigns, and its views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pneugantry.engine.change import EpochView, _plant
from pneugantry.engine.plant import Array, Epoch, Nuisance, Plant, Record
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.synthetic import Nominal
from pneugantry.engine.views.view import Run

FORCE = "sensors.force.bias"


def test_a_signal_has_the_rougher_readings_of_both_campaigns(cart: Plant) -> None:
    force, speed = cart.signals
    own = replace(cart, nuisances=(*cart.nuisances, Nuisance(FORCE, force.sigma)))
    coarse = replace(force, sigma=0.3, step=1.0, error=0.2, lasting=0.5)
    later = replace(
        cart,
        signals=(coarse, speed),
        nuisances=(Nuisance("K", 0.5, relative=True), Nuisance(FORCE, 0.3)),
    )
    for before, after in ((own, later), (later, own)):
        both = _plant(before, after)
        assert both.signals == (coarse, speed)
        tolerance = {n.parameter: n.sigma for n in both.nuisances}
        assert tolerance[FORCE] == 0.3
        assert tolerance["K"] == next(n.sigma for n in before.nuisances if n.parameter == "K")


def test_a_record_of_a_campaign_is_read_once(
    cart: Plant, push: Record, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The view within is given the same record each time, and finds what it kept of it."""
    epoch = Epoch("after", {}, frozenset())
    full = Nominal(cart, ["f", "v"], cache).record(push)
    record = replace(full, name=f"after/{full.name}", epoch=epoch)
    (inner, *_) = build_views(cart, ["force", "speed"], cache, push.period, Rules())
    given: list[Record] = []
    residuals = inner.residuals

    def noted(runs: Sequence[Run]) -> list[Array]:
        given.extend(r for r, _ in runs)
        return residuals(runs)

    monkeypatch.setattr(inner, "residuals", noted)
    view = EpochView(inner, epoch)
    first, second = (view.residuals([(record, {"K": k})])[0] for k in (2.0, 2.0))
    assert given[0] is given[1]
    assert given[0].name == full.name
    assert np.array_equal(first, second)
    assert view.shows(record)
