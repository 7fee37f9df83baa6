"""Catalogue, fit, converter, waviness, whitening: each against a closed form or data
made for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from modelica_fmu.errors import InputError
from pneugantry.diagnosis.converter import converter_step
from pneugantry.diagnosis.fit import balanced, effect_coordinate, fit, predict, tolerance_coordinate
from pneugantry.diagnosis.parallel import each
from pneugantry.diagnosis.waviness import sines
from pneugantry.diagnosis.whitening import correlation_length, innovations, robust_segments
from pneugantry.engine.catalogue import Parameter, read_catalogue

Array = NDArray[np.float64]


class Line:
    """y = gain * u + offset + noise, two views that share the gain."""

    views = ("first", "second")

    def __init__(self, gain: float, offset: float) -> None:
        generator = np.random.default_rng(1)
        self.u = {view: generator.uniform(-3, 3, 400) for view in self.views}
        self.y = {
            "first": gain * self.u["first"] + generator.standard_normal(400),
            "second": gain * self.u["second"] + offset + generator.standard_normal(400),
        }

    def residual(self, view: str, values: Mapping[str, float]) -> Array:
        model = values["gain"] * self.u[view] + (
            values.get("offset", 0.0) if view == "second" else 0.0
        )
        return np.asarray(self.y[view] - model)

    def depends(self, view: str, name: str) -> bool:
        return name == "gain" or view == "second"


def test_the_catalogue_holds_every_effect_of_the_specification_with_its_block() -> None:
    catalogue = read_catalogue()
    assert len({effect.name for effect in catalogue.values() if not effect.outside}) == 30
    assert catalogue["valve_delay/z"].block == "valve_z"
    assert catalogue["presliding/x"].block == "friction_x"
    assert catalogue["loop_delay"].block == "timing"
    assert {
        effect.axis for effect in catalogue.values() if effect.name == "friction_direction"
    } == {"z"}


def test_a_user_adds_an_effect_in_ten_lines(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        '[[effect]]\nname = "leak"\nblock = "valve"\naxes = ["z"]\n[[effect.form]]\n'
        '[effect.form.parameters."valve_{axis}.droop"]\nscale = 0.1\nlow = 0.0\nhigh = 1.0\n'
    )
    catalogue = read_catalogue(path)
    assert catalogue["leak/z"].forms[0].parameters[0].name == "valve_z.droop"
    assert "presliding/z" in catalogue


def test_a_bad_catalogue_names_file_field_and_mend(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        '[[effect]]\nname = "leak"\nblock = '
        '"valve"\n[[effect.form]]\n[effect.form.parameters.a]\nscale = "big"\nlow = 0\nhigh = 1\n'
    )
    with pytest.raises(InputError) as caught:
        read_catalogue(path)
    assert "mine.toml" in str(caught.value)
    assert "a.scale" in str(caught.value)


def test_a_range_of_indices_stands_for_its_members() -> None:
    profile = read_catalogue()["friction_position/z"].forms[0]
    assert [p.name for p in profile.parameters] == [
        f"axis_z.friction.position_table[{i}]" for i in range(1, 12)
    ]


def test_work_shared_out_gives_what_one_process_gives() -> None:
    assert (
        each(lambda n: n * n, range(7), 2)
        == each(lambda n: n * n, range(7), 1)
        == [n * n for n in range(7)]
    )


def test_the_fit_equals_linear_least_squares_with_its_prior() -> None:
    problem = Line(2.06, 0.8)
    coordinates = [
        tolerance_coordinate("gain", 2.0, 0.02),
        effect_coordinate(Parameter("offset", 0.0, 0.5, -10, 10), None),
    ]
    fitted = fit(problem, coordinates)
    # by hand: unknowns theta, gain = 2 exp(0.02 theta) is nearly 2 + 0.04 theta; offset = 0.5
    # theta, prior spread 2
    rows = [
        np.column_stack([0.04 * problem.u["first"], np.zeros(400)]),
        np.column_stack([0.04 * problem.u["second"], np.full(400, 0.5)]),
    ]
    a, y = (
        np.vstack(rows),
        np.concatenate([problem.y[v] - 2.0 * problem.u[v] for v in problem.views]),
    )
    expected = np.linalg.solve(a.T @ a + np.diag([1.0, 0.25]), a.T @ y)
    assert fitted.theta == pytest.approx(expected, rel=0.02)
    assert fitted.values["offset"] == pytest.approx(0.5 * expected[1], rel=0.02)


def test_a_promise_is_kept_where_the_model_is_linear() -> None:
    problem = Line(2.0, 0.8)
    coordinates = [
        effect_coordinate(Parameter("gain", 2.0, 0.5, -10, 10), None),
        effect_coordinate(Parameter("offset", 0.0, 0.5, -10, 10), None),
    ]
    promised = predict(problem, coordinates, np.zeros(2))
    fitted = fit(problem, coordinates)
    assert promised == pytest.approx(fitted.misfit + fitted.penalty, rel=1e-6)


def test_an_interval_of_what_the_data_leave_open_ends_at_the_bounds() -> None:
    growth = effect_coordinate(Parameter("exponent", 1.0, 1.0, 0.1, 10.0, "1", positive=True), None)
    assert growth.interval(0.0, 1e6) == pytest.approx((0.1, 10.0))


def test_a_factor_takes_over_what_strains_the_tolerance_that_it_multiplies() -> None:
    level = Parameter(
        "level", 1.0, 0.25, 0.05, 10.0, relative=True, multiplies=("static", "dynamic")
    )
    coordinates = [
        tolerance_coordinate("static", 20.0, 0.02),
        tolerance_coordinate("dynamic", 15.0, 0.02),
        effect_coordinate(level, 1.0, 1.0),
    ]
    strained = np.array([coordinates[0].theta(18.0), coordinates[1].theta(13.5), 0.0])
    theta = balanced(coordinates, strained)
    static, dynamic, factor = (c.value(t) for c, t in zip(coordinates, theta, strict=True))
    assert factor * static == pytest.approx(18.0)
    assert factor * dynamic == pytest.approx(13.5)
    assert factor == pytest.approx(0.9, abs=0.005)
    penalty = sum((t / c.spread) ** 2 for c, t in zip(coordinates, theta, strict=True))
    for moved in (-0.01, 0.01):  # nothing else on the ridge is charged less
        other = theta + moved * np.array([-1 / 0.02, -1 / 0.02, 1 / 0.25])
        assert sum((t / c.spread) ** 2 for c, t in zip(coordinates, other, strict=True)) > penalty


def test_bounds_of_a_relative_parameter_are_shares_of_its_nominal_value() -> None:
    coordinate = effect_coordinate(Parameter("C", 0.0, 0.3, 0.05, 20.0, relative=True), 74.0)
    assert coordinate.value(coordinate.bounds[1]) == pytest.approx(20.0 * 74.0)
    assert coordinate.value(0.0) == 74.0


@pytest.mark.parametrize(
    ("step", "found"), [(0.0, False), (0.01, False), (0.05, True), (0.5, True)]
)
def test_a_coarse_converter_is_seen_and_a_logs_own_rounding_is_not(
    step: float, found: bool
) -> None:
    generator = np.random.default_rng(2)
    level = np.repeat(generator.uniform(0.0, 5.0, 40), 500)
    reading = level + 0.05 * generator.standard_normal(len(level))
    if step:
        reading = step * np.round(reading / step)
    reading = 0.01 * np.round(reading / 0.01)
    measured = converter_step(reading, 0.05)
    assert (measured > 0) == found
    if found:
        assert measured == pytest.approx(step, rel=0.05)


def test_a_coarse_converter_is_seen_on_a_channel_that_mostly_rests_in_one_of_its_cells() -> None:
    generator = np.random.default_rng(6)
    level = np.concatenate([np.full(60_000, 0.05), generator.uniform(0.0, 40.0, 15_000)])
    coarse = 0.17 * np.floor((level + 0.05 * generator.standard_normal(len(level))) / 0.17)
    assert converter_step(0.01 * np.round(coarse / 0.01), 0.05) == pytest.approx(0.17)
    fine = np.concatenate(
        [np.zeros(60_000), level[60_000:] + 0.05 * generator.standard_normal(15_000)]
    )
    assert converter_step(0.01 * np.round(fine / 0.01), 0.05) == 0.0


def test_sines_are_read_off_an_edge_with_noise() -> None:
    x = np.sort(np.random.default_rng(3).uniform(0.45, 0.95, 500))
    truth = [(2e-4, 0.060, 0.3), (8e-5, 0.027, 1.1)]
    height = (
        1e-3
        + sum(a * np.sin(2 * np.pi * x / w + p) for a, w, p in truth)
        + 5e-6 * np.random.default_rng(4).standard_normal(500)
    )
    found = sines(x, height)
    rebuilt = sum(a * np.sin(2 * np.pi * x / w + p) for a, w, p in found)
    assert found[0][:2] == pytest.approx(truth[0][:2], rel=0.03)
    assert found[1][:2] == pytest.approx(truth[1][:2], rel=0.03)
    assert np.std(height - rebuilt) < 2e-5


def test_innovations_of_white_noise_plus_a_slow_error_are_white() -> None:
    generator = np.random.default_rng(5)
    slow, phi = np.zeros(40_000), np.exp(-1 / 200)
    for k in range(1, len(slow)):
        slow[k] = phi * slow[k - 1] + np.sqrt(1 - phi**2) * generator.standard_normal()
    white = innovations(slow + generator.standard_normal(len(slow)), 1.0, 200.0)
    assert np.std(white) == pytest.approx(1.0, abs=0.02)
    assert correlation_length(white) < 1.5
    assert correlation_length(slow) > 200


def test_a_segment_that_went_astray_counts_by_its_logarithm() -> None:
    residual = np.concatenate([np.ones(100), np.full(100, 50.0)])[:, None]
    robust = robust_segments(residual).ravel()
    assert np.all(robust[:100] == 1.0)
    assert np.mean(robust[100:] ** 2) == pytest.approx(4 * (1 + np.log(2500 / 4)))


@pytest.mark.parametrize(("rows", "kept"), [(0, 0), (99, 0), (100, 100), (250, 200)])
def test_rows_after_the_last_whole_segment_are_left_out(rows: int, kept: int) -> None:
    assert np.array_equal(robust_segments(np.ones((rows, 3))), np.ones((kept, 3)))
