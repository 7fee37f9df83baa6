"""Optima that lie side by side: a parameter's step, and the points that are tried about an end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from modelica_fmu.errors import InputError
from pneugantry.engine.fitting.probing import _side_by_side
from pneugantry.engine.hypotheses.catalogue import Parameter, read_catalogue
from pneugantry.engine.hypotheses.hypothesis import effect_coordinate
from pneugantry.engine.views.simulation import Point

EFFECT = """
name = "late"
block = "timing"
[[form]]
[form.parameters."timing.delay"]
scale = 0.005
low = 0.0
high = 0.1
"""


def test_a_step_is_told_in_usual_sizes(tmp_path: Path) -> None:
    (tmp_path / "late.toml").write_text(EFFECT + "step = 0.001\n", encoding="utf-8")
    (parameter,) = read_catalogue(tmp_path)["late"].forms[0].parameters
    assert effect_coordinate(parameter, 0.0, 2.0).step == pytest.approx(0.2)


@pytest.mark.parametrize("more", ["step = -0.001", "step = 0.001\npositive = true"])
def test_a_step_that_is_none_is_refused(tmp_path: Path, more: str) -> None:
    text = EFFECT.replace("low = 0.0", "low = 1e-4") + more
    (tmp_path / "late.toml").write_text(text + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="step"):
        read_catalogue(tmp_path)


def test_points_side_by_side_are_a_step_off_or_a_step_there_and_one_back() -> None:
    late = [Parameter(n, 0.0, 0.005, 0.0, 0.1, step=0.001) for n in ("delay", "sensing")]
    drag = Parameter("drag", 0.0, 2.0, -10.0, 10.0)
    coordinates = tuple(effect_coordinate(p, 0.0, 2.0) for p in (late[0], drag, late[1]))
    point = Point(coordinates, np.ones(3), {})
    moves = {tuple(np.round(m, 9).tolist()) for m in _side_by_side(point, [0, 1, 2])}
    once = {(0.2, 0.0, 0.0), (0.0, 0.0, 0.2), (0.2, 0.0, -0.2)}
    assert moves == {m for own in once for m in (own, tuple(-x for x in own))}
    assert _side_by_side(point, [1]) == []


def test_no_point_side_by_side_lies_beyond_a_bound() -> None:
    late = Parameter("delay", 0.0, 0.005, 0.0, 0.1, step=0.001)
    point = Point((effect_coordinate(late, 0.0, 2.0),), np.zeros(1), {})
    assert [m.tolist() for m in _side_by_side(point, [0])] == [pytest.approx([0.2])]
