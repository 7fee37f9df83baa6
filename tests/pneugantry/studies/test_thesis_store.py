"""Finished runs are kept, found again, and not mistaken for others."""

import math

import numpy as np
import pytest

from modelica_fmu.errors import InputError, RunError
from pneugantry.thesis import runner
from pneugantry.thesis.conditions import SOFT, Run
from pneugantry.thesis.run_store import Done, RunStore
from pneugantry.thesis.runner import Results, Workers
from pneugantry.thesis.scores import Effort, Scores, Trace

RUN = Run("straight")
DONE = Done(Scores(9.0, 0.1, 3.0, 0.04), Effort(0.0, 0.01, 0.002, 12.0, 42.0, 0.0))
TRACE = Trace(*(np.linspace(0.0, k + 1.0, 5) for k in range(9)))


@pytest.fixture
def store(tmp_path):
    found = RunStore(tmp_path / "deep" / "runs.sqlite", "fmu")
    yield found
    found.close()


def test_a_run_comes_back_bit_for_bit_also_to_the_next_process(store):
    store.add_runs({RUN: DONE._replace(trace=TRACE), RUN.changed(seed=1): "left its range"})
    again = RunStore(store.file, "fmu")
    found = again.runs([RUN, RUN.changed(seed=1), RUN.changed(seed=2)], frozenset([RUN]))
    again.close()
    assert set(found) == {RUN, RUN.changed(seed=1)}
    assert found[RUN].scores == DONE.scores
    assert found[RUN].effort == DONE.effort
    assert all((a == b).all() for a, b in zip(found[RUN].trace, TRACE, strict=True))
    assert found[RUN.changed(seed=1)] == "left its range"


@pytest.mark.parametrize(
    "changed",
    [
        {"choice": SOFT},
        {"draw": 1},
        {"options": (("k_f", 1.0),)},
        {"plant": (("valve_z.tau", 1.0),)},
    ],
)
def test_another_run_or_fmu_is_not_there(store, changed):
    store.add_runs({RUN: DONE})
    assert store.runs([RUN.changed(**changed)], frozenset()) == {}
    other = RunStore(store.file, "another fmu")
    assert other.runs([RUN], frozenset()) == {}
    other.close()


def test_an_edge_from_a_file_counts_by_its_content(store, tmp_path):
    files = [tmp_path / name for name in ("a.csv", "b.csv", "c.csv")]
    for file, text in zip(files, ("same", "same", "other"), strict=True):
        file.write_text(text)
    first, second, third = (Run(str(file)) for file in files)
    store.add_runs({first: DONE})
    assert set(store.runs([second, third], frozenset())) == {second}


def test_a_run_without_the_trace_asked_for_is_run_again(store):
    store.add_runs({RUN: DONE})
    assert store.runs([RUN], frozenset([RUN])) == {}
    store.add_runs({RUN: DONE._replace(trace=TRACE)})
    assert store.runs([RUN], frozenset())[RUN].trace is None
    assert store.taken == 1


def test_values_keep_infinities(store):
    assert store.value("margins") is None
    store.add_value("margins", {"gain": math.inf, "linear": None})
    assert store.value("margins") == {"gain": math.inf, "linear": None}


def test_a_file_that_is_no_store_is_refused_in_one_line(tmp_path):
    file = tmp_path / "runs.sqlite"
    file.write_text("no database, but long enough to be looked at as one" * 40)
    with pytest.raises(InputError, match="holds no finished runs"):
        RunStore(file, "fmu")


def test_workers_keep_each_batch_and_run_nothing_twice(store, tmp_path, monkeypatch):
    runs, ran = [RUN.changed(seed=k) for k in range(40)], []

    def batch(wanted, fmu, traced):
        ran.extend(wanted)
        if len(ran) > runner.BATCH:
            raise KeyboardInterrupt  # killed in the second batch
        return dict.fromkeys(wanted, DONE)

    monkeypatch.setattr(runner, "run_batch", batch)
    with pytest.raises(KeyboardInterrupt), Workers(tmp_path, 1, None, store) as pool:
        pool.start_runs(runs)
    monkeypatch.setattr(runner, "run_batch", lambda wanted, *_: dict.fromkeys(wanted, DONE))
    told = []
    with Workers(tmp_path, 1, lambda *done: told.append(done), store) as pool:
        results = pool.collect(pool.start_runs(runs))
        kept = [pool.keep("answer", len, ran).result() for _ in range(2)]
    assert set(results.done) == set(runs)
    assert store.taken == runner.BATCH + 1
    assert kept[0] == kept[1]
    assert told[0] == (1, 2)  # what was there, and one batch to come
    assert told[-1] == (4, 4)


def test_asking_for_a_lost_run_says_why():
    results = Results(lost={RUN: "left its range"})
    with pytest.raises(RunError, match="left its range"):
        results[RUN]
