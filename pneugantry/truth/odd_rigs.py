"""Nine rigs that earlier versions answered wrongly, made again by number: one thing is off on each,
everything else as on a rig without nuisances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pneugantry.truth.campaign import Campaign
from pneugantry.truth.case import Case, run_case
from pneugantry.truth.effects import draw_cause
from pneugantry.truth.form import Cause
from pneugantry.truth.nuisance import PLAIN, draw_rig
from pneugantry.truth.parameters import CHANNELS, Rig

__all__ = ["ODD_RIGS", "OddRigs"]


def _dead_points(rig: Rig) -> None:
    rig.axis["offset"] *= (1.016, 0.988)


def _noise(rig: Rig) -> None:
    rig.sensor["noise"] = 1.4


def _actuator_offset(rig: Rig) -> None:
    rig.sensor["bias"][CHANNELS.index("f_ax")] = 0.5


def _tachometer(rig: Rig) -> None:
    rig.sensor["gain"][CHANNELS.index("v_z")] = 1.03


def _hum(rig: Rig) -> None:
    rig.sensor["hum"][CHANNELS.index("f_z")] = 0.1


def _nothing(rig: Rig) -> None:
    """As it was drawn."""


@dataclass(frozen=True)
class OddRig:
    """What is off, and the right answer. kind: as in a case's label; sensor: (effect, channel) of a
    sensor that is wrong; cause: (effect, axis, size) of a term that no catalogue lists.
    """

    name: str
    change: Callable[[Rig], None]
    kind: str = "none"
    parameters: float = 0.02  # RMS, relative
    standoff: float = 0.0  # m
    sensor: tuple[str, str] = ("", "")
    cause: tuple[str, str, float] | None = None


ODD_RIGS = (
    OddRig("dead_points", _dead_points),
    OddRig("wide_tolerance", _nothing, parameters=0.05),
    OddRig("standoff", _nothing, standoff=5e-4),
    OddRig(
        "stiffness_along_edge",
        _nothing,
        "unknown",
        cause=("stiffness_gradient", "", 0.8),  # 20 % over 0.25 m to either side
    ),
    OddRig("noise", _noise),
    OddRig("actuator_offset", _actuator_offset, "one", sensor=("bias", "f_ax")),
    OddRig("tachometer_scale", _tachometer, "one", sensor=("scale", "v_z")),
    OddRig("hum", _hum, "one", sensor=("hum", "f_z")),
    OddRig("supply_cycling", _nothing, "unknown", cause=("supply_cycling", "", 0.03)),
)


@dataclass(frozen=True)
class OddRigs:
    """A set whose seeds are the places in ODD_RIGS."""

    name: str = "odd"

    def plan(self, seed: int) -> Case:
        """The case of a place. Raises ValueError for one that does not exist."""
        if not 0 <= seed < len(ODD_RIGS):
            raise ValueError(f"seed must be 0..{len(ODD_RIGS) - 1} in this set, got {seed}")
        odd = ODD_RIGS[seed]
        rng = np.random.default_rng([seed, 21])
        drawn = draw_rig(rng, seed, replace(PLAIN, parameters=odd.parameters))
        odd.change(drawn.rig)
        causes: tuple[Cause, ...] = ()
        if odd.cause is not None:
            effect, axis, size = odd.cause
            causes = (replace(draw_cause(rng, effect, axis), size=size),)
        return Case(seed, odd.kind, drawn.rig, drawn.off, causes, odd.standoff)

    def draw(self, seed: int) -> tuple[Campaign, dict]:
        """(campaign, label) of a place."""
        campaign, label = run_case(self.plan(seed))
        odd = ODD_RIGS[seed]
        if odd.sensor[0]:
            effect, channel = odd.sensor
            entry = {"effect": effect, "axis": channel, "known": True, "block": "sensors"}
            label["causes"] = [{**entry, "blocks": ["sensors"]}]
        return campaign, {"set": self.name, "rig": odd.name, **label}
