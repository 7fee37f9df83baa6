"""Plans of a small plant: from structure and simulation to what can be told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.planning.plan import Case, Experiment, Plan, make_plan
from pneugantry.engine.planning.report import as_html, as_json, as_text
from pneugantry.engine.plant import Plant, Record, Signal
from pneugantry.engine.rules import Rules
from pneugantry.engine.views.synthetic import Nominal, noisy


@pytest.fixture(scope="module")
def case(cart: Plant, push: Record, catalogue: dict[str, Effect], cache: Path) -> Case:
    return Case(cart, (push,), catalogue, Rules(), cache)


@pytest.fixture(scope="module")
def plan(case: Case) -> Plan:
    return make_plan(case)


def test_what_tolerance_can_imitate_is_seen_beyond_it(plan: Plan) -> None:
    """30 % of a parameter that is off by 2 % RMS, times the rules' 1.5: ten sigma at most."""
    found = {s.effect: s for s in plan.sights}
    for name in ("drag", "gain"):
        assert found[name].sigma == pytest.approx(10.0, rel=0.02)
    assert found["spring"].sigma > 10.0  # no tolerance moves it
    assert found["bias"].visible


def test_an_effect_that_no_view_reads_is_said(plan: Plan) -> None:
    assert plan.unread == ("nowhere",)
    assert "nothing measured shows: nowhere" in list(as_text(plan))


def test_smallest_sizes_are_in_the_effect_s_own_unit(plan: Plan) -> None:
    (found,) = (s for s in plan.sights if s.effect == "drag")
    assert plan.sizes["drag"].usual == pytest.approx(0.3 * 0.5)
    told = next(e for e in as_json(plan)["effects"] if e["effect"] == "drag")
    assert told["smallest"] == pytest.approx(3 / found.sigma * 0.15)
    assert told["smallest_share"] == pytest.approx(3 / found.sigma)


def test_with_a_sensor_less_effects_are_less_visible(case: Case, plan: Plan, cart: Plant) -> None:
    """Without the force the speed alone must tell actuator and mass."""
    alone = make_plan(replace(case, plant=replace(cart, signals=cart.signals[1:])))
    before = {s.effect: s.sigma for s in plan.sights}
    after = {s.effect: s.sigma for s in alone.sights}
    assert "bias" in alone.unread
    assert after["spring"] < before["spring"]
    assert after["drag"] <= before["drag"] * (1 + 1e-6)


def test_an_experiment_and_a_sensor_that_add_are_told(case: Case, push: Record) -> None:
    quiet = replace(push, name="still", inputs={"u": np.zeros(2000)})
    experiments = tuple(Experiment(r.name, r) for r in (replace(push, name="again"), quiet))
    sensors = (Signal("position", "s", 0.0, "m"),)
    found = make_plan(replace(case, experiments=experiments, sensors=sensors))
    assert [a.what for a in found.experiments] == ["again", "still"]
    assert found.experiments[0].finer > 1.0
    assert found.experiments[1].finer == pytest.approx(1.0, abs=0.02)
    (position,) = found.sensors
    assert position.sigma > 0.0
    assert position.finer > 0.9


def test_text_and_page_hold_every_effect(plan: Plan) -> None:
    text, page = "\n".join(as_text(plan)), as_html(plan)
    assert as_json(plan)["schema"] == "plan/1"
    for sight in plan.sights:
        assert sight.effect in text
        assert sight.effect in page
    assert "http" not in page


def test_missing_signals_are_simulated_and_measured_ones_kept(
    cart: Plant, push: Record, cache: Path
) -> None:
    nominal = Nominal(cart, [s.variable for s in cart.signals], cache)
    own = np.full(2000, 7.0)
    found = nominal.record(push, {"speed": own})
    assert found.signals["speed"] is own
    assert 0.1 < np.abs(found.signals["force"]).max() < 2.0  # N, below K u
    louder = noisy(cart, found)
    assert louder.name != found.name
    noise = louder.signals["force"] - found.signals["force"]
    assert np.std(noise) == pytest.approx(0.01, rel=0.1)


def test_a_noisy_sensor_hides_nothing_that_the_diagnosis_would_see(case: Case, cart: Plant) -> None:
    """Where views are cut as a diagnosis cuts them, the speed tells what it drowns as known."""
    force, *others = cart.signals
    noisy_force = replace(force, sigma=1000 * force.sigma)
    coarse = replace(case, plant=replace(cart, signals=(noisy_force, *others)))
    told = [make_plan(replace(coarse, sharp=s)) for s in (False, True)]
    as_known, sharp = ({s.effect: s.sigma for s in p.sights}.get("gain", 0.0) for p in told)
    assert sharp > 2 * as_known
