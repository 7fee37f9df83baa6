"""Whatever a file holds, it is taken or refused in one line that names it; `python -m
benchmarks.soak` tries many more of each kind.
"""

from __future__ import annotations

import random
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.soak.fuzz import Kinds, crashes, fuzz, outcome
from benchmarks.soak.logs import LOGS
from benchmarks.soak.models import MODELS, SIZES
from benchmarks.soak.tables import TABLES
from modelica_fmu.errors import InputError

RANDOMS = st.randoms(
    use_true_random=False
)  # hypothesis draws and shrinks what the generators ask for


def tried(kinds: Kinds, kind: str, rng: random.Random) -> str:
    with TemporaryDirectory(prefix="fuzz-") as folder:
        return outcome(kinds[kind](rng, Path(folder)))


@pytest.mark.parametrize("kind", LOGS)
@settings(max_examples=40, deadline=None, derandomize=True)
@given(rng=RANDOMS)
def test_a_mangled_log_is_read_or_refused_in_one_line(kind: str, rng: random.Random) -> None:
    assert tried(LOGS, kind, rng) in ("read", "refused")


@pytest.mark.parametrize("kind", TABLES)
@settings(max_examples=60, deadline=None, derandomize=True)
@given(rng=RANDOMS)
def test_mangled_toml_is_read_or_refused_in_one_line(kind: str, rng: random.Random) -> None:
    assert tried(TABLES, kind, rng) in ("read", "refused")


@pytest.mark.parametrize("kind", MODELS)
@settings(max_examples=25, deadline=None, derandomize=True)
@given(rng=RANDOMS)
def test_mangled_modelica_becomes_c_or_is_refused_in_one_line(
    kind: str, rng: random.Random
) -> None:
    assert tried(MODELS, kind, rng) in ("read", "refused")


@pytest.mark.slow
def test_far_too_large_models_are_refused_in_time() -> None:
    assert crashes(fuzz(SIZES, 20, seed=2)) == 0


@pytest.mark.parametrize("kinds", [LOGS, TABLES, MODELS], ids=["logs", "tables", "models"])
@pytest.mark.parametrize("count", [20, pytest.param(100, marks=pytest.mark.slow)])
def test_every_kind_is_refused_mostly_but_not_always(kinds: Kinds, count: int) -> None:
    found = fuzz(kinds, count * len(kinds))
    assert crashes(found) == 0
    for kind, counts in found["kinds"].items():
        assert counts["refused"] > 0, kind
    assert sum(counts.get("read", 0) for counts in found["kinds"].values()) > 0


def test_a_crash_and_a_refusal_that_says_too_little_are_told_apart() -> None:
    def refuse(**known: str) -> object:
        raise InputError("is bad", **known)

    assert outcome(lambda: refuse(file="a.csv", hint="hint it")) == "refused"
    assert outcome(lambda: refuse(hint="hint it")).startswith("crash: says too little")
    assert outcome(lambda: [][1]).startswith("crash: IndexError")
    assert outcome(lambda: 1) == "read"
