"""Design of `robust_fv`, and of its peers with the same means: the same linear margins asked for,
the same runs, the same number of candidates.

A candidate must keep, with every plant of `design_plants` in python-control, the distance |1 + L|
of its loops from the critical point (`needed`). Of those that do, the best is the one whose RMSE
f_n, relative to what is asked for (1.0 N on the nominal plant, 1.5 N elsewhere, the thesis' PI FV
where that exceeds 4 N or the friction is a stick band), has the smallest mean sixth power over
training runs: structures and draws of the random finish that no board scores. Local random search,
from several starts where asked for; `python -m pneugantry.thesis.robust_design [NAME ...]` prints
values, cost, distance, and RMSE f_n on the board's nominal structure, which no search sees. With
`--nominal` a peer is tuned by runs on the thesis' plant alone, with no margin asked for: what it
can reach there.

Dead time and presliding together are left out of the linear demand: at rest the displacement-
dependent law is a spring without loss, which no controller fast enough holds 10 ms late; off rest
it slips. Runs judge that case (contact phase of every run with dead time).
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from controllers.catalogue import make_controller
from modelica_fmu.errors import RunError
from pneugantry.analysis.command_loop import (
    LoopPlant,
    command_loop,
    controller_block,
    is_stable,
    x_plant,
    z_plant,
)
from pneugantry.analysis.frequency import response
from pneugantry.thesis.conditions import CHOICE, SOFT, Run
from pneugantry.thesis.peers import PEERS, Flat, Peer
from pneugantry.thesis.runner import run_one
from pneugantry.thesis.structures import NOMINAL, Structure
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

__all__ = ["Tuned", "Tuner", "design_plants", "distances", "needed", "search", "tune"]

SLIDING, STUCK, LATEST = 0.35, 0.10, 0.20  # smallest |1 + L|: any plant, z stuck, 20 ms late
WAVES = np.geomspace(0.1, 3141.0, 500)  # rad/s
CANDIDATES = 400  # of a search
STEP, SHRINK, GROW = 0.5, 0.97, 1.3  # of a search, in the logarithm
APART = 1.0  # of further starts from the first, standard deviation in the logarithm
FIRST_SEED = 21
EDGES = ("straight", "curved")
CHANGED = 0.5  # share of the values that a candidate changes
POWER = 6
STRIBECK = 5.0  # Types.FrictionLaw
UNUSABLE = 10.0  # cost of a candidate that misses the margins, plus by how much


@dataclass(frozen=True)
class Tuned:
    """The best candidate."""

    values: Flat
    cost: float  # mean sixth power ^ 1/6 of RMSE f_n / what is asked for
    distance: float  # smallest |1 + L| over the plants that demand one; NaN: no linear model


def needed(plant: LoopPlant) -> float:
    """Distance that a plant demands; 0 where nothing is demanded."""
    late = plant.name.startswith("dead time")
    if plant.stuck:
        return -math.inf if late else STUCK
    return LATEST if plant.name == "dead time 20 ms" else SLIDING


def design_plants(fmu: FmuFile) -> list[LoopPlant]:
    """Linear plants of both axes that a design has to bear; z sliding and stuck."""
    changes: dict[str, Flat] = {
        "nominal": {},
        "stiffness x 2": {"contact.K_c": 2.0 * CHOICE.contact_stiffness},
        "second lag 40 ms": {"valve_x.tau_2": 0.04, "valve_z.tau_2": 0.04},
        "dead time 10 ms": {"valve_x.delay_time": 0.01, "valve_z.delay_time": 0.01},
        "dead time 20 ms": {"valve_x.delay_time": 0.02, "valve_z.delay_time": 0.02},
    }
    stiff, soft = _contact(CHOICE), _contact(SOFT)
    cases = {name: {**stiff, **change} for name, change in changes.items()}
    cases["contact of Fig. 5.7"] = soft
    found = []
    for name, parameters in cases.items():
        found += [z_plant(fmu, name, stuck=stuck, parameters=parameters) for stuck in (False, True)]
        if not name.startswith(("stiffness", "contact")):
            found.append(x_plant(fmu, name, parameters=parameters))
    return found


def _contact(choice: Any) -> Flat:
    return {name: choice.plant()[name] for name in ("contact.K_c", "contact.C_c")}


def distances(controller: Any, plants: list[LoopPlant]) -> dict[str, float]:
    """Smallest |1 + L| by plant; negative where the loop is unstable."""
    blocks = {axis: controller_block(controller, axis) for axis in "xz"}
    found: dict[str, float] = {}
    for plant in plants:
        loop = command_loop(blocks[plant.axis], plant)
        distance = float(np.abs(1.0 + response(loop)(WAVES)).min())
        found[plant.label] = distance if is_stable(loop) else -distance
    return found


def _case(edge: str, draw: int, *plant: tuple[str, float]) -> Run:
    structure = Structure("training", "training", tuple(plant))
    return structure.run(edge, "pi_fv", finish="random", draw=draw, seed=draw)


def nominal_runs() -> list[Run]:
    """The thesis' plant on draws that no setting uses."""
    return [_case("straight", 5001), _case("curved", 5010), _case("incline_16", 5011)]


def training_runs() -> list[Run]:
    """Structures between those of the board, on random draws that no setting uses."""
    late = (("valve_x.delay_time", 0.013), ("valve_z.delay_time", 0.013))
    later = (("valve_x.delay_time", 0.018), ("valve_z.delay_time", 0.018))
    slow = (("valve_x.tau_2", 0.045), ("valve_z.tau_2", 0.045))
    return [
        _case("straight", 5001),
        _case("straight", 5002, *later),
        _case("straight", 5003, *slow),
        _case("straight", 5004, ("contact.K_c", 8e4)),
        _case("straight", 5005, ("contact.K_c", 1.2e4), ("contact.C_c", 36.0)),
        _case("straight", 5006, ("axis_z.friction.law", STRIBECK)),
        _case("incline_30", 5007, *late),
        _case("curved", 5008, *late),
        _case("curved", 5009, *slow),
    ]


class Tuner:
    """Costs of candidates on one FMU. nominal: no distance is demanded, no structure is run."""

    def __init__(self, fmu: FmuFile, *, nominal: bool = False) -> None:
        self.fmu, self.nominal = fmu, nominal
        self.plants = design_plants(fmu)
        self.runs = nominal_runs() if nominal else training_runs()
        benchmark = [run_one(run, fmu).scores.rmse_fn for run in self.runs]
        self.asked = [_asked(run, rmse) for run, rmse in zip(self.runs, benchmark, strict=True)]

    def shortfall(self, peer: Peer, values: Flat) -> float:
        """By how much a candidate misses the distance asked for; 0 where it does not."""
        if not peer.linear or self.nominal:
            return 0.0
        controller = make_controller(peer.controller, **peer.options(values))
        found = distances(controller, self.plants)
        return max(0.0, *(needed(plant) - found[plant.label] for plant in self.plants))

    def cost(self, peer: Peer, values: Flat, beat: float = math.inf) -> float:
        """Infinite as soon as it cannot be below `beat`."""
        short = self.shortfall(peer, values)
        if short > 0.0:
            return UNUSABLE + short
        options = tuple(peer.options(values).items())
        total = 0.0
        for run, asked in zip(self.runs, self.asked, strict=True):
            try:
                done = run_one(run.changed(controller=peer.controller, options=options), self.fmu)
            except RunError:
                return UNUSABLE
            total += (done.scores.rmse_fn / asked) ** POWER / len(self.runs)
            if total > beat**POWER:
                return math.inf
        return float(total ** (1.0 / POWER))


def _asked(run: Run, benchmark: float) -> float:
    """RMSE f_n [N] asked for on a run; benchmark: the thesis' PI FV's."""
    banded = dict(run.plant).get("axis_z.friction.law") == STRIBECK
    if banded or benchmark >= 4.0:
        return benchmark
    return 1.5 if run.plant else 1.0


def tune(
    peer: Peer,
    tuner: Tuner,
    candidates: int = CANDIDATES,
    seed: int = FIRST_SEED,
    start: Flat | None = None,
) -> Tuned:
    """Local random search in the logarithm of the values; start: None, the peer's own."""
    rng = np.random.default_rng(seed)
    best, step = dict(start or peer.start), STEP
    cost = tuner.cost(peer, best)
    for _ in range(candidates):
        tried = dict(best)
        for name, (low, high) in peer.span.items():
            if rng.random() < CHANGED:
                moved = tried[name] * np.exp(step * rng.standard_normal())
                tried[name] = float(np.clip(moved, low, high))
        found = tuner.cost(peer, tried, cost)
        if found < cost:
            best, cost, step = tried, found, min(step * GROW, 0.8)
        else:
            step = max(step * SHRINK, 0.05)
    return Tuned(best, cost, _nearest(peer, best, tuner))


def search(peer: Peer, tuner: Tuner, candidates: int, starts: int) -> list[Tuned]:
    """A search from each start, the best first: the peer's own start, and others about it."""
    rng = np.random.default_rng(FIRST_SEED)
    begins = [dict(peer.start)]
    for _ in range(starts - 1):
        moved = {n: v * np.exp(APART * rng.standard_normal()) for n, v in peer.start.items()}
        begins.append({n: float(np.clip(v, *peer.span[n])) for n, v in moved.items()})
    found = [tune(peer, tuner, candidates, FIRST_SEED + k, b) for k, b in enumerate(begins)]
    return sorted(found, key=lambda tuned: tuned.cost)


def nominal_rmse(peer: Peer, values: Flat, fmu: FmuFile) -> dict[str, float]:
    """RMSE f_n [N] on the board's nominal structure, by edge; infinite where a run is lost."""
    options = tuple(peer.options(values).items())
    found = {}
    for edge in EDGES:
        try:
            done = run_one(NOMINAL.run(edge, peer.controller, options=options), fmu)
            found[edge] = done.scores.rmse_fn
        except RunError:
            found[edge] = math.inf
    return found


def _nearest(peer: Peer, values: Flat, tuner: Tuner) -> float:
    if not peer.linear:
        return float("nan")
    controller = make_controller(peer.controller, **peer.options(values))
    found = distances(controller, tuner.plants)
    return min(found[p.label] for p in tuner.plants if needed(p) > 0.0)


def _peer_report(name: str, tuner: Tuner, candidates: int, starts: int) -> dict[str, Any]:
    peer = PEERS[name]
    found = search(peer, tuner, candidates, starts)
    best = found[0]
    return {
        "controller": name,
        **asdict(best),
        "distance": None if math.isnan(best.distance) else best.distance,
        "evaluations": starts * (candidates + 1),
        "cost_by_start": [tuned.cost for tuned in found],
        "nominal_rmse_fn": nominal_rmse(peer, best.values, tuner.fmu),
        "nominal_rmse_fn_untuned": nominal_rmse(peer, peer.start, tuner.fmu),
    }


def _lines(found: dict[str, Any]) -> str:
    values = ", ".join(f'"{key}": {value:.3g}' for key, value in found["values"].items())
    distance = "none" if found["distance"] is None else f"{found['distance']:.2f}"
    costs = ", ".join(f"{cost:.3f}" for cost in found["cost_by_start"])
    nominal, before = (
        ", ".join(f"{edge} {rmse:.2f} N" for edge, rmse in found[key].items())
        for key in ("nominal_rmse_fn", "nominal_rmse_fn_untuned")
    )
    return (
        f"{found['controller']}: cost {found['cost']:.3f}, smallest |1 + L| {distance}; "
        f"{found['evaluations']} candidates, cost by start {costs}\n  {values}\n"
        f"  RMSE f_n on the board's nominal: {nominal} (from {before})"
    )


def main(words: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(PEERS))
    parser.add_argument("--nominal", action="store_true", help="the thesis' plant, no margins")
    parser.add_argument("--candidates", type=int, default=CANDIDATES, metavar="N")
    parser.add_argument("--starts", type=int, default=1, metavar="N", help="searches of each")
    parser.add_argument("--json", type=Path, metavar="FILE", help="what was found")
    asked = parser.parse_args(words)
    unknown = [name for name in asked.names if name not in PEERS]
    if unknown:
        parser.error(f"no peer {unknown[0]!r}; known are {', '.join(PEERS)}")
    if min(asked.candidates, asked.starts) < 1:
        parser.error("--candidates and --starts must be at least 1")
    tuner = Tuner(FmuFile.read(build_fmu().path), nominal=asked.nominal)
    peers = []
    for name in asked.names or list(PEERS):
        peers.append(_peer_report(name, tuner, asked.candidates, asked.starts))
        print(_lines(peers[-1]))
        sys.stdout.flush()
    if asked.json:
        report = {"schema": "thesis_peers/1", "nominal": asked.nominal, "peers": peers}
        asked.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
