"""Where a diagnosis spends its time: `python -m benchmarks.diagnosis_time CAMPAIGN...`.

For each campaign: wall and processor seconds of all and of each stage, and of each fit the
processor seconds and how many seconds of records its simulations cover. Runs that feel the same are
simulated once but counted each time. A first diagnosis with an empty cache compiles its parts:
measure the second.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pneugantry.engine.selection.contenders as contenders
import pneugantry.engine.selection.rivals as rivals
import pneugantry.engine.selection.search as searching
from pneugantry.engine.fitting.fit import Fit
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.selection.scouts import Scouts
from pneugantry.plants.gantry.diagnosis import diagnose
from pyfmi_runner.campaign import read_campaign

__all__ = ["Timed", "timed"]


@dataclass(frozen=True)
class Piece:
    """One fit, one screening of all effects, or what was done side by side."""

    what: str
    effects: str
    cpu: float  # s
    simulated: float  # s of records


@dataclass(frozen=True)
class Timed:
    """One diagnosis."""

    campaign: str
    verdict: str
    wall: float  # s
    cpu: float  # s
    stages: dict[str, float]  # wall s
    pieces: list[Piece]

    @property
    def simulated(self) -> float:
        return sum(p.simulated for p in self.pieces)


def timed(folder: Path) -> Timed:
    """Diagnoses a campaign of the gantry, with its fits counted."""
    with _counted() as pieces:
        wall, cpu = time.perf_counter(), time.process_time()
        found = diagnose(read_campaign(folder))
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    said = found.diagnosis
    return Timed(folder.name, said.verdict, wall, cpu, dict(said.stages), pieces)


@contextmanager
def _counted() -> Iterator[list[Piece]]:
    """Outermost calls alone: of those inside others it is not known whose simulations are whose."""
    pieces: list[Piece] = []
    inside = False

    def counting(what: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(by: Fitter | Scouts, *rest: Any, **more: Any) -> Any:
            nonlocal inside
            if inside:
                return call(by, *rest, **more)
            simulation = (by if isinstance(by, Fitter) else by.fitter).simulation
            cpu, simulated, inside = time.process_time(), simulation.seconds, True
            try:
                made = call(by, *rest, **more)
            finally:
                inside = False
            cpu, simulated = time.process_time() - cpu, simulation.seconds - simulated
            fits = [f for f in (made if isinstance(made, list) else [made]) if isinstance(f, Fit)]
            effects = ", ".join(" + ".join(f.keys) for f in fits)
            if simulated > 0:
                pieces.append(Piece(what, effects, cpu, simulated))
            return made

        return counted

    with (
        patch.object(Fitter, "null", counting("tolerance", Fitter.null)),
        patch.object(Fitter, "explore", counting("fit", Fitter.explore)),
        patch.object(Fitter, "again", counting("fit of all views", Fitter.again)),
        patch.object(Fitter, "together", counting("fits side by side", Fitter.together)),
        patch.object(Scouts, "gains", counting("scouts", Scouts.gains)),
        patch.object(searching, "screen", counting("screen", searching.screen)),
        patch.object(rivals, "screen", counting("screen of rivals", rivals.screen)),
        patch.object(contenders, "foremost", counting("from afar", contenders.foremost)),
    ):
        yield pieces


def _show(found: Timed) -> None:
    print(
        f"{found.campaign}: {found.verdict}, {found.wall:.1f} s, {found.cpu:.1f} CPU s, "
        f"{found.simulated:.0f} simulated s in {len(found.pieces)} fits and screens"
    )
    print("  " + ", ".join(f"{name} {s:.1f} s" for name, s in found.stages.items()))
    for p in sorted(found.pieces, key=lambda p: -p.cpu)[:12]:
        print(f"  {p.cpu:6.2f} CPU s {p.simulated:8.0f} simulated s  {p.what} {p.effects}")


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("campaigns", nargs="+", type=Path, metavar="CAMPAIGN")
    options.add_argument("--json", type=Path)
    given = options.parse_args()
    results = []
    for folder in given.campaigns:
        results.append(timed(folder))
        _show(results[-1])
    if given.json:
        given.json.write_text(json.dumps([asdict(r) for r in results], indent=1) + "\n")
