"""Curves as values at nodes, straight between them."""

from __future__ import annotations

import numpy as np

from pneugantry.engine.plant import Array

__all__ = ["hats"]


def hats(place: Array, nodes: int) -> Array:
    """Weights (rows, nodes) of the values at nodes 0, 1, ... at some places (rows,) among them;
    beyond the first and the last one the curve is level.
    """
    inside = np.clip(place, 0.0, nodes - 1.0)
    return np.maximum(0.0, 1.0 - np.abs(inside[:, None] - np.arange(nodes)))
