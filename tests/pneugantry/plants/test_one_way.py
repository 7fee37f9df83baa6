"""However a description is diagnosed, it goes one way: what may be a wrong unit is told."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from modelica_fmu.errors import RunError
from pneugantry.api.diagnosis import diagnose as diagnose_by_api
from pneugantry.engine.rules import Rules
from pneugantry.plants import campaigns, changed, described, doubts
from pneugantry.plants.campaigns import Diagnoser
from pneugantry.plants.changed import diagnose_change

TOLD = "speed reads 1000 times what the model tells"


@dataclass(frozen=True)
class Answer:
    verdict: str = "unknown"
    notes: tuple[str, ...] = ()
    causes: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Answered:
    task: Any
    diagnosis: Answer = Answer()


@pytest.fixture
def description(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A plant whose diagnosis is a stand-in, with a note on a unit."""
    read, task = SimpleNamespace(rules=Rules()), SimpleNamespace(data=SimpleNamespace(unseen=()))
    for module, name, value in (
        (described, "described_task", lambda *_: (read, task)),
        (described, "run", lambda own, *_: Answered(own)),
        (described, "doubts_of", lambda _: [TOLD]),
        (changed, "changed_task", lambda *_: (read, task)),
        (changed, "with_changes", lambda found, _: found),
        (campaigns, "to_json", lambda found, _: {"notes": found.diagnosis.notes}),
    ):
        monkeypatch.setattr(module, name, value)
    json_of = "pneugantry.engine.answer.result.to_json"
    monkeypatch.setattr(json_of, lambda own: {"notes": own.notes})
    (tmp_path / "plant.toml").write_text("[plant]\n", encoding="utf-8")
    return tmp_path / "plant.toml"


def test_a_doubtful_unit_is_told_by_itself_in_a_folder_and_between_two(description: Path) -> None:
    in_folder = json.loads(Diagnoser(learn=False)()(description.parent))
    found, _ = diagnose_change(description, description)
    assert in_folder["notes"] == [TOLD]
    assert diagnose_by_api(description).json["notes"] == found.diagnosis.notes == (TOLD,)


def test_a_log_that_cannot_be_replayed_ends_no_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    def ring(*_: object) -> Sequence[None]:
        raise RunError("FMUs feed each other in a ring")

    monkeypatch.setattr(doubts, "replays", ring)
    data = SimpleNamespace(fitted=("log",), unseen=())
    task: Any = SimpleNamespace(plant=None, cache=None, data=data)
    assert doubts.doubts_of(task) == ()


@pytest.mark.parametrize(("scale", "told"), [(3.6, (TOLD,)), (0.2, (TOLD,)), (1.1, ())])
def test_a_scale_that_no_sensor_has_may_be_another_unit(
    scale: float, told: tuple[str, ...]
) -> None:
    size = SimpleNamespace(value=scale)
    cause = SimpleNamespace(parameters={"sensors.v.scale": size, "axis.k": size})
    found = Answered(None, Answer("identified", causes=(cause,)))
    noted: Any = doubts.with_doubts(found, [TOLD])  # type: ignore[arg-type]
    assert noted.diagnosis.notes == told
