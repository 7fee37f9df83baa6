"""Workpieces: closed forms of docs/explanation/plant.md, adaptive quadrature for the curved one,
users' files.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from scipy.integrate import quad

from modelica_fmu.errors import InputError
from pyfmi_runner.workpiece import (
    STANDOFF,
    WORKPIECES,
    default_standoff,
    local_profile,
    read_profile,
    workpiece,
)

X = np.random.default_rng(2).uniform(0.0, 1.0, 200)


def slope_angle(x: float) -> float:
    """theta(x) of the curved workpiece [rad], straight from docs/explanation/plant.md."""
    for peak, s in ((50.0, (0.78 - x) / 0.16), (-10.0, (0.52 - x) / 0.10)):
        if 0 < s < 1:
            return math.radians(peak) * math.sin(math.pi * s) ** 2
    return 0.0


@njit
def local_compiled(coefficients, x0, dx, x):  # type: ignore[no-untyped-def]
    return local_profile(coefficients, x0, dx, x)


def test_curved_height_is_the_integral_of_its_slope() -> None:
    def rise(x: float) -> float:
        breaks = [edge for edge in (0.78, 0.62, 0.52, 0.42) if min(x, 0.95) < edge < max(x, 0.95)]
        return float(
            quad(lambda s: math.tan(slope_angle(s)), 0.95, x, points=breaks or None, epsabs=1e-13)[
                0
            ]
        )

    assert workpiece("curved").height(X) == pytest.approx([rise(x) for x in X], abs=1e-9)


def test_curved_slope_and_curvature_are_those_of_theta() -> None:
    profile, step = workpiece("curved"), 1e-6
    assert profile.slope(X) == pytest.approx([math.tan(slope_angle(x)) for x in X], abs=1e-9)
    bent = (profile.slope(X + step) - profile.slope(X - step)) / (2 * step)
    assert profile.curvature(X) == pytest.approx(bent, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "angle"), [("straight", 0), ("incline_7", 7), ("incline_16", 16), ("incline_30", 30)]
)
def test_inclines_rise_from_the_datum(name: str, angle: float) -> None:
    profile, slope = workpiece(name), math.tan(math.radians(angle))
    assert profile.height(X) == pytest.approx(slope * (X - 0.95), abs=1e-13)
    assert profile.slope(X) == pytest.approx(np.full_like(X, slope), abs=1e-12)
    assert profile.curvature(X) == pytest.approx(np.zeros_like(X), abs=1e-8)


def test_surface_finish_adds_its_three_waves() -> None:
    waves = ((0.20e-3, 0.060, 0.3), (0.08e-3, 0.027, 1.1), (0.03e-3, 0.013, 2.0))
    added = sum(a * np.sin(2 * np.pi * X / length + phase) for a, length, phase in waves)
    rough, smooth = workpiece("curved", surface_finish=True), workpiece("curved")
    assert rough.height(X) - smooth.height(X) == pytest.approx(added, abs=1e-9)


@pytest.mark.parametrize("name", WORKPIECES)
def test_kernel_and_arrays_and_compiled_kernel_agree(name: str) -> None:
    profile = workpiece(name, surface_finish=True)
    grid = (profile.coefficients, profile.x0, profile.dx)
    for x in (*X[:50].tolist(), -0.2, 1.3):
        local = local_profile(*grid, x)
        assert local == local_compiled(*grid, x)
        assert local == tuple(
            float(of(x)) for of in (profile.height, profile.slope, profile.curvature)
        )
    assert all(
        math.isnan(compute(*grid, math.nan)[0]) for compute in (local_profile, local_compiled)
    )


def test_a_users_profile_runs_through_its_points_and_straight_on(tmp_path: Path) -> None:
    path = tmp_path / "wave.csv"
    x = np.linspace(1.0, 0.3, 141)  # falling, as the tracking runs
    z_w = 0.01 * np.sin(2 * np.pi * (x - 0.3) / 0.35)
    path.write_text(
        "# my edge\nx,z_w\n"
        + "".join(f"{a!r},{b!r}\n" for a, b in zip(x.tolist(), z_w.tolist(), strict=True))
    )
    profile = workpiece(str(path))
    assert profile.height(x) == pytest.approx(z_w, abs=1e-9)
    inner = np.linspace(0.31, 0.99, 1000)
    assert profile.height(inner) == pytest.approx(
        0.01 * np.sin(2 * np.pi * (inner - 0.3) / 0.35), abs=1e-6
    )
    before, beyond = profile.height([0.25, 0.20]) - profile.height(0.3)
    assert beyond == pytest.approx(2 * before)
    assert default_standoff(path) == pytest.approx(0.090 - z_w.max())


def test_stand_offs_are_those_of_the_rig() -> None:
    assert {name: default_standoff(name) for name in WORKPIECES} == STANDOFF


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,z\n0,0\n", "z_w: column is missing"),
        ("x,z_w\n0,0\n1,0\n", "2 points"),
        ("x,z_w\n0,0\n0.1,a\n0.2,0\n0.3,0\n", "row 1 is a"),
        ("x,z_w\n0,0\n100,0\n200,0\n300,0\n", "divide column x by 1000"),
        ("x,z_w\n0,0\n0.1,5\n0.2,0\n0.3,0\n", "divide column z_w by 1000"),
        ("x,z_w\n0,0\n0.2,0\n0.1,0\n0.3,0\n", "sort the rows"),
        ("x,z_w\n0,0\n0.1,0\n0.101,0.05\n0.3,0\n", "smooth the profile"),
        ("", "not a readable table"),
    ],
)
def test_unusable_profiles_are_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "edge.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_profile(path)
    assert "edge.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_name_is_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean curved"):
        workpiece("curvd")
