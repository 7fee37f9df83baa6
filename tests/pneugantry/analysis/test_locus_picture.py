"""The picture of a root locus: its axes show what decides, its limit gain stands on the axis."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from pneugantry.analysis.force_loop import force_loop
from pneugantry.analysis.locus_picture import locus_picture
from pneugantry.analysis.plots_linear import LocusPicture, root_locus_figure, window
from pneugantry.analysis.root_locus import RootLocus, closed_poles, root_locus, with_pade
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile


@pytest.fixture(scope="module")
def loci() -> dict[str, RootLocus]:
    file = FmuFile.read(build_fmu().path)
    return {
        "x": root_locus(force_loop(file, "x", "0.2", delay=0.005), pade=4),
        "none": root_locus(force_loop(file, "z", "none")),
        "x none": root_locus(force_loop(file, "x", "none")),
        "z": root_locus(force_loop(file, "z", "z")),
    }


@pytest.mark.parametrize("name", ["x", "none", "x none", "z"])
def test_the_branches_fill_the_axes(name: str, loci: dict[str, RootLocus]) -> None:
    picture = locus_picture(loci[name])
    left, right, top = window(picture)
    assert -1000 < left < 0 < right < 200
    inside = (picture.branches.real > left) & (np.abs(picture.branches.imag) < top)
    spread = np.ptp(picture.branches.imag[inside & (picture.branches.real < right)])
    assert spread > 0.5 * top  # not a dot in the middle, as when the delay's poles set the axes


@pytest.mark.parametrize("name", ["x", "z"])
def test_the_limit_gain_puts_a_pole_on_the_axis(name: str, loci: dict[str, RootLocus]) -> None:
    locus = loci[name]
    picture = locus_picture(locus)
    assert picture.limit is not None
    gain, frequency = picture.limit
    found = closed_poles(with_pade(locus.loop, 4), gain)
    assert np.min(np.abs(found - 1j * frequency)) < 1e-3 * frequency
    assert f"{gain:.4f}" in picture.words


def test_a_loop_without_a_limit_says_so(loci: dict[str, RootLocus]) -> None:
    picture = locus_picture(loci["none"])
    assert picture.limit is None
    assert "no gain makes the continuous loop unstable" in picture.words
    figure = root_locus_figure({"none": picture})
    assert isinstance(figure, Figure)
    legend = figure.axes[0].get_legend()
    assert legend is not None
    assert picture.words in [text.get_text() for text in legend.get_texts()]


def test_without_a_limit_the_branches_are_seen_to_reach_the_zero(
    loci: dict[str, RootLocus],
) -> None:
    """The x loop's zero lies at -333/s, nine times as far as its poles: all gains were outside."""
    picture = locus_picture(loci["x none"])
    left, _, top = window(picture)
    zero = float(picture.zeros.real.max())
    assert left < 2 * zero
    assert top > abs(zero)
    figure = root_locus_figure({"x": picture})
    assert len(figure.axes[0].texts) >= 3  # labelled gains


def test_marked_gains_are_dots_on_the_branches(loci: dict[str, RootLocus]) -> None:
    picture = locus_picture(loci["z"])
    assert isinstance(picture, LocusPicture)
    labels = [text.get_text() for text in root_locus_figure({"z": picture}).axes[0].texts]
    assert f"{picture.marked[1]:.2g}" in labels


def test_no_label_covers_the_limit(loci: dict[str, RootLocus]) -> None:
    figure = root_locus_figure({"z": locus_picture(loci["z"])})
    picture = locus_picture(loci["z"])
    assert picture.limit is not None
    figure.canvas.draw()
    mark = figure.axes[0].transData.transform((0.0, picture.limit[1]))
    labels = [text for text in figure.axes[0].texts if text.get_text()]
    assert labels
    assert not any(text.get_window_extent().contains(*mark) for text in labels)
