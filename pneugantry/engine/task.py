"""What a diagnosis is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pneugantry.engine.chances import Chances
from pneugantry.engine.hypotheses.catalogue import Effect
from pneugantry.engine.plant import Data, Epoch, Plant
from pneugantry.engine.views.view import View

__all__ = ["Task"]


@dataclass(frozen=True, eq=False)
class Task:
    """What a diagnosis is made of."""

    plant: Plant
    views: Sequence[View]
    data: Data
    catalogue: Mapping[str, Effect]
    cache: Path  # of the parts of the model
    chances: Chances = field(default_factory=Chances)
    notes: tuple[str, ...] = ()
    limits: tuple[str, ...] = ()  # what the records cannot show
    epoch: Epoch | None = None  # the campaign whose plant is told, where there are two
