"""Stiff models against published values and closed forms (all: `python -m benchmarks.stiff`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.stiff import counted_of, measured


@pytest.mark.parametrize(
    ("name", "error", "steps"),
    [
        ("van der Pol", 1e-6, 3000),
        ("Robertson", 1e-6, 1000),
        ("RC chain of 200", 1e-6, 1000),
        ("pendulum", 1e-6, 1000),
        ("clutch", 1e-8, 1000),
    ],
)
def test_errors_and_steps(name: str, error: float, steps: int) -> None:
    (made,) = measured(name, [1e-6])
    assert made.error < error
    assert made.steps < steps
    assert ("implicit" in made.said) == (made.explicit_steps > 0)


def test_an_event_is_located_within_an_implicit_step(tmp_path: Path) -> None:
    """x follows time 1 us behind; where it passes 0.5 the clock z starts."""
    counted = counted_of(
        "model M\n  Real x(start = 0, fixed = true), z(start = 0, fixed = true);\nequation\n"
        "  der(x) = 1e6*(time - x);\n  der(z) = if x > 0.5 then 1 else 0;\nend M;\n",
        tmp_path,
    )
    states, steps, said = counted.run(np.linspace(0, 1, 11), 1e-6)
    assert "implicit" in said
    assert steps < 300
    assert states[-1] == pytest.approx([1 - 1e-6, 0.5 - 1e-6], abs=1e-9)


def test_a_model_that_is_not_stiff_stays_explicit(tmp_path: Path) -> None:
    """10 rad/s for 500 internal steps: bound by accuracy."""
    counted = counted_of(
        "model M\n  Real x(start = 1, fixed = true), v(start = 0, fixed = true);\nequation\n"
        "  der(x) = v;\n  der(v) = -100*x;\nend M;\n",
        tmp_path,
    )
    states, steps, said = counted.run(np.array([0.0, 5.0]), 1e-8)
    assert said == ""
    assert steps > 300
    assert states[-1] == pytest.approx([np.cos(50), -10 * np.sin(50)], abs=1e-4)
