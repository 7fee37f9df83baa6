"""`pneugantry calibrate`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.progress import bar

HELP = """Probabilities for a plant of your own: rigs whose truth is known are drawn from its model
under the inputs of its logs, diagnosed, and the weights of the decision fitted to them.

  pneugantry calibrate plant.toml --cases 60

A rig has tolerance and noise, and nothing else, one or two effects of the catalogue, or a random
function of a random signal in an input or a sensor. The result, plant.calibration.json beside the
description, serves `pneugantry diagnose plant.toml` from then on, until the description, a file
that it names or the catalogue changes. Rigs that are done are kept in plant.rigs.jsonl: the same
command with more cases goes on from there."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("plant", metavar="PLANT.toml", type=Path, help="a plant's description")
    command.add_argument(
        "--cases", type=int, default=60, metavar="N", help="number of rigs (default: %(default)s)"
    )
    command.add_argument(
        "--seed", type=int, default=0, metavar="S", help="seed of the first (default: %(default)s)"
    )
    command.add_argument(
        "--catalogue", metavar="PATH", type=Path, help="effects instead of the description's own"
    )
    command.add_argument(
        "--workers", type=int, default=2, metavar="N", help="processes (default: %(default)s)"
    )
    command.add_argument(
        "--scheduler", metavar="ADDRESS", help="an existing Dask cluster, as in tcp://host:8786"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.engine.calibration.weights import error
    from pneugantry.plants.calibrate import calibration_of
    from pneugantry.plants.calibration_file import as_json, write_calibration
    from pneugantry.plants.described import is_plant_description

    if not is_plant_description(options.plant):
        raise InputError(
            "is no description of a plant",
            file=options.plant,
            hint="give a TOML file with a [plant] table: see the tutorial My own plant",
        )
    rigs, failed = _rigs(options)
    for reason in failed:
        print(f"not diagnosed: {reason}")
    found = calibration_of(rigs)
    path = write_calibration(options.plant, found, options.seed, options.catalogue)
    print(f"{found.rigs} rigs; mean log probability of the truth, each rig unseen by its weights:")
    print(f"  before {found.before:.3f}, calibrated {found.score:.3f}")
    if found.score <= found.before:
        print("  no better than before: these rigs do not tell, more would")
    print("claim     probability  share right  claims")
    for b in found.reliability:
        print(f"{b.what:<9} {b.said:11.2f} {b.right:12.2f} {b.claims:7d}")
    print(f"expected calibration error: {error(found.reliability):.3f}")
    print(f"calibration: {path}")
    more = {"failed": failed, "error": error(found.reliability), "file": str(path)}
    return {**as_json(found), **more}, 0


def _rigs(options: argparse.Namespace) -> tuple[list[dict[str, Any]], list[str]]:
    """Diagnosed rigs, those of an earlier call included, and why others were not diagnosed."""
    from pneugantry.jobs.job import Job
    from pneugantry.jobs.run import run_jobs
    from pneugantry.plants.calibrate import LEAST, Rigs
    from pneugantry.plants.calibration_file import stamp_of

    if options.cases < LEAST:
        told = f"is {options.cases}, expected >= {LEAST}"
        raise InputError(told, field="--cases", hint="draw more")
    kept = options.plant.with_suffix(".rigs.jsonl")
    seeds = range(options.seed, options.seed + options.cases)
    stamp = stamp_of(options.plant, options.catalogue)
    done = {r["seed"]: r for r in _kept(kept, stamp) if r["seed"] in seeds}
    jobs = [Job(seed, seed) for seed in seeds if seed not in done]
    failed = []
    counter = bar(range(len(jobs)), len(jobs), "calibrate")
    factory = Rigs(options.plant, options.catalogue)
    if jobs:
        factory()  # an unusable description is refused here, not by every worker
    torn = _torn(kept)
    with kept.open("a", encoding="utf-8") as stream:
        stream.write("\n" if torn else "")
        for ended in run_jobs(factory, jobs, workers=options.workers, scheduler=options.scheduler):
            next(counter, None)
            if ended.failure:
                failed.append(f"rig {ended.key}: {ended.failure}")
                continue
            done[int(ended.key)] = ended.value
            stream.write(json.dumps(ended.value | {"plant": stamp}) + "\n")
            stream.flush()
    return [done[s] for s in sorted(done)], failed


def _torn(path: Path) -> bool:
    """Whether a stop has cut off a file's last line."""
    return path.is_file() and path.read_bytes()[-1:] not in (b"", b"\n")


def _kept(path: Path, stamp: str) -> list[dict[str, Any]]:
    """Rigs of an earlier call for the same description, files and effects; a line that a stop cut
    off is left out, and what another version has said.
    """
    from pneugantry.plants.calibrate import KEPT

    found = []
    if path.is_file():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                rig = json.loads(line)
            except ValueError:
                continue
            if rig.get("plant") == stamp and set(KEPT) <= set(rig.get("answer", ())):
                found.append(rig)
    return found
