"""A folder of campaigns of a plant of one's own: in worker processes, on a cluster, and by itself,
the same answers bit for bit.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.sweep_check import cluster
from benchmarks.two_campaigns import pair_of, written
from pneugantry.api.diagnosis import diagnose
from pneugantry.plants.campaigns import RESULT, Diagnoser, campaign_folders, diagnose_campaigns
from pyfmi_runner.build import build_fmu


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two campaigns of a motor."""
    written(tmp_path / "rigs", pair_of("motor", 91003, "stayed"))
    return tmp_path / "rigs"


def bits(found: dict[str, Any]) -> str:
    """A diagnosis apart from its times, and from what `diagnose_campaigns` adds."""
    left = {k: v for k, v in found.items() if k not in ("seconds", "stages", "diagnosed_by")}
    return json.dumps(left, sort_keys=True, default=float)


def test_a_folder_of_described_plants_is_answered_as_each_by_itself(folder: Path) -> None:
    found = campaign_folders(folder)
    assert [f.name for f in found] == ["after", "before"]
    diagnoser = Diagnoser(build_fmu().path, pages=True)
    work = diagnoser()
    told = json.loads(work(folder / "after"))
    assert bits(told) == bits(diagnose(folder / "after" / "plant.toml").json)
    assert (folder / "after" / "diagnosis.html").is_file()
    stamp = diagnoser.stamp(folder / "after")
    (folder / "after" / RESULT).write_text(json.dumps(told | {"diagnosed_by": stamp}))
    assert diagnose_campaigns([folder / "after"], diagnoser) == {
        folder / "after": told | {"diagnosed_by": stamp}
    }
    (folder / "after" / "steps.csv").write_bytes((folder / "before" / "steps.csv").read_bytes())
    assert diagnoser.stamp(folder / "after") != stamp


@pytest.mark.slow
def test_a_cluster_of_two_workers_gives_the_same_bits(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    found, diagnoser = campaign_folders(folder), Diagnoser(build_fmu().path)
    here = {f: bits(v) for f, v in diagnose_campaigns(found, diagnoser).items()}
    for each in found:
        (each / RESULT).unlink()
    with cluster(tmp_path, 2) as (address, _):
        there = diagnose_campaigns(found, diagnoser, scheduler=address)
    assert {f: bits(v) for f, v in there.items()} == here
