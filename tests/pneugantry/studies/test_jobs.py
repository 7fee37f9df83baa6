"""Jobs in workers: every job ends once, with a value or a reason, whatever becomes of
the workers.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest

from modelica_fmu.errors import InputError, RunError
from pneugantry.jobs.job import DIED, Ended, Factory, Job
from pneugantry.jobs.run import run_jobs


class Square:
    """A factory whose function squares, refuses the odd thing, and dies on command."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self) -> Any:
        (self.folder / f"made_{os.getpid()}").touch(exist_ok=False)
        return self.run

    def run(self, argument: Any) -> Any:
        if argument == "poison" or (argument == "once" and not (self.folder / "died").exists()):
            (self.folder / "died").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if argument == "once":
            return "alive"
        if argument == "thread":
            return lambda: None  # does not pickle
        return argument**2


def unfit() -> Any:
    raise InputError("no binary for this machine", file="plant.fmu")


def stillborn() -> Any:
    os._exit(3)


def ends(factory: Factory, arguments: list[Any], workers: int = 2) -> dict[Any, Ended]:
    found = list(
        run_jobs(
            factory, [Job(i, argument) for i, argument in enumerate(arguments)], workers=workers
        )
    )
    assert sorted(ended.key for ended in found) == list(range(len(arguments)))
    return {ended.key: ended for ended in found}


def test_every_job_ends_once_and_each_worker_is_made_once(tmp_path: Path) -> None:
    found = ends(Square(tmp_path), list(range(20)))
    assert [found[i].value for i in range(20)] == [i**2 for i in range(20)]
    assert {f"made_{ended.worker.split(':')[1]}" for ended in found.values()} <= {
        path.name for path in tmp_path.glob("made_*")
    }


def test_a_case_that_fails_says_why_and_stops_nothing(tmp_path: Path) -> None:
    found = ends(Square(tmp_path), [1, "text", "thread", 3])
    assert (found[0].value, found[3].value) == (1, 9)
    assert found[1].failure.startswith("TypeError: unsupported operand")
    assert "pickle" in found[2].failure


def test_a_dead_worker_costs_its_case_a_second_try_and_a_deadly_case_is_given_up(
    tmp_path: Path,
) -> None:
    found = ends(Square(tmp_path), ["once", 2, "poison", 3, 4])
    assert found[0].value == "alive"
    assert found[2].failure == DIED
    assert [found[i].value for i in (1, 3, 4)] == [4, 9, 16]


def test_workers_that_cannot_be_made_ready_end_the_study() -> None:
    with pytest.raises(RunError, match=r"plant\.fmu: no binary for this machine"):
        ends(unfit, [1, 2])
    with pytest.raises(RunError, match=r"before they are ready \(exit code 3\)"):
        ends(stillborn, [1, 2], workers=1)


def test_unusable_workers_and_schedulers_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="--workers: is 0"):
        run_jobs(Square(tmp_path), [Job(0, 1)], workers=0)
    pytest.importorskip("distributed")
    monkeypatch.setattr("pneugantry.jobs.cluster.CONNECT", 0.5)
    with pytest.raises(InputError, match=r"no scheduler answers at 'tcp://127\.0\.0\.1:1'"):
        list(run_jobs(Square(tmp_path), [Job(0, 1)], scheduler="tcp://127.0.0.1:1"))
    with pytest.raises(InputError, match="no scheduler answers at 'nonsense'"):
        list(run_jobs(Square(tmp_path), [Job(0, 1)], scheduler="nonsense"))
