"""Who stands on the leaderboard over structures: the catalogue's controllers as they are, and those
tuned with the means of `robust_design`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from controllers.catalogue import controller_names
from pneugantry.thesis.peers import PEERS
from pneugantry.thesis.tuned import TUNED, TUNED_NOMINAL

__all__ = ["BENCHMARK", "JUDGED", "ROBUST", "Entrant", "entrants", "tuned_entrants"]

BENCHMARK, ROBUST = "pi_fv", "robust_fv"
JUDGED = (BENCHMARK, ROBUST)  # without them nothing is asked


@dataclass(frozen=True)
class Entrant:
    """A controller with its options, under a name of its own."""

    name: str
    controller: str
    options: tuple[tuple[str, Any], ...] = ()


def entrants() -> list[Entrant]:
    return [Entrant(name, name) for name in controller_names()] + tuned_entrants()


def tuned_entrants() -> list[Entrant]:
    """The peers of `robust_fv`, equally tuned (its own tuned values are its defaults), and those
    tuned for the nominal plant alone.
    """
    found = []
    for values_of, suffix in ((TUNED, "tuned"), (TUNED_NOMINAL, "nominal")):
        for name, values in values_of.items():
            peer = PEERS[name]
            options = tuple(peer.options(values).items())
            found.append(Entrant(f"{name}_{suffix}", peer.controller, options))
    return found
