"""Readings that no effect is behind: what is said of them before anything is searched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pneugantry.engine.answer.confirm import Replay
from pneugantry.engine.plant import Array, Plant, Record
from pneugantry.plants import doubts
from pneugantry.plants.doubts import doubts_of

TIME = np.arange(500) / 100
SIGMA = 0.01
TOLD = {"v": np.sin(3 * TIME), "T": 300 + 20 * np.exp(-TIME), "w": np.cos(5 * TIME)}


def replay(read: Mapping[str, Array], name: str = "log") -> Replay:
    told = np.column_stack([TOLD[n] for n in read])
    measured = np.column_stack(list(read.values()))
    sigma = np.full(len(read), SIGMA)
    return Replay(name, tuple(read), told, (measured - told) / SIGMA, measured, sigma, 0.01)


def said(monkeypatch: pytest.MonkeyPatch, *found: Replay) -> str:
    by_name = {r.record: r for r in found}
    monkeypatch.setattr(doubts, "replays", lambda _, record, *rest: [by_name[record.name]])
    records = [Record(r.record, 0.01, {}, {}, {}) for r in found]
    data = SimpleNamespace(fitted=tuple(records), unseen=())
    task: Any = SimpleNamespace(plant=None, cache=None, data=data)
    return " | ".join(doubts_of(task))


def noisy(values: Array) -> Array:
    return np.asarray(values + SIGMA * np.random.default_rng(0).standard_normal(len(values)))


def test_sound_readings_are_not_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor those of a rig on which much is off."""
    sound = {n: noisy(v) for n, v in TOLD.items()}
    off = {n: noisy(1.25 * (v - v.mean()) + v.mean() + 0.5) for n, v in TOLD.items()}
    assert said(monkeypatch, replay(sound), replay(off, "off")) == ""


@pytest.mark.parametrize(
    ("name", "read", "told"),
    [
        ("v", 1e3 * TOLD["v"], "reads 1e+03 times what the model tells, as thousandths"),
        ("v", -TOLD["v"], "check the sign of it"),
        ("T", TOLD["T"] - 273.15, "beside what the model tells, as degrees Celsius for kelvins"),
        ("T", TOLD["T"] + 270.0, "as kelvins for degrees Celsius would"),
    ],
)
def test_another_unit_is_told(
    name: str, read: Array, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert told in said(monkeypatch, replay({**TOLD, name: noisy(read)}))


def test_signals_that_read_as_each_other_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    found = said(monkeypatch, replay({**TOLD, "v": noisy(TOLD["w"]), "w": noisy(TOLD["v"])}))
    assert found == (
        "log: v reads as w would, and w as v: check whether their columns are exchanged"
    )


@pytest.mark.parametrize(("other", "told"), [("w", True), ("still", False)])
def test_a_sensor_that_stands_still_in_one_log_alone_is_told(
    other: str, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In all of them it may have nothing to tell: friction holds."""
    still = np.full(len(TIME), 0.25)
    logs = [replay({**TOLD, "w": still}), replay({**TOLD, "w": TOLD.get(other, still)}, "other")]
    found = said(monkeypatch, *logs)
    expected = "log: w reads 0.25 throughout, not in other logs: check its sensor and the cable"
    assert found == (expected if told else "")


def test_inputs_in_each_other_s_place_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def made(
        plant: Plant, record: Record, values: Sequence[Any], cache: object
    ) -> Sequence[Replay]:
        told = 2 * record.inputs["a"] + 0.3 * record.inputs["b"]
        read = record.signals["y"]
        error = ((read - told) / SIGMA)[:, None]
        shape = (told[:, None], error, read[:, None])
        return [Replay(record.name, ("y",), *shape, np.array([SIGMA]), 0.01)]

    monkeypatch.setattr(doubts, "replays", made)
    a, b, c = np.sin(TIME), np.sign(np.sin(7 * TIME)), np.zeros_like(TIME)

    def found(first: Array, second: Array) -> tuple[str, ...]:
        signals = {"y": noisy(2 * a + 0.3 * b)}
        own = Record("log", 0.01, {"a": first, "b": second, "c": c}, signals, {})
        data = SimpleNamespace(fitted=(own,), unseen=())
        task: Any = SimpleNamespace(plant=None, cache=None, data=data)
        return doubts_of(task)

    assert found(a, b) == found(1.1 * a, b) == ()
    (note,) = found(b, a)
    assert "with a and b exchanged: check whether their columns are" in note
