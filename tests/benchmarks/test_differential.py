"""Random models against an interpreter of their own; `python -m benchmarks.differential` tries as
many as it is told to.
"""

from __future__ import annotations

import random

import pytest

from benchmarks.differential.__main__ import checked, main, tried
from benchmarks.differential.features import FEATURES, model_of

NAMES = list(FEATURES)


@pytest.mark.parametrize("first", range(4))
def test_every_piece_of_the_language_means_what_its_equations_say(first: int) -> None:
    model = model_of(random.Random(first), NAMES[first::4])
    text = model.text()
    assert checked(model, text) == ("right", ""), text


def test_a_wrong_result_a_refusal_and_a_crash_are_told_apart() -> None:
    model = model_of(random.Random(3), ["state", "algebraic"])
    text = model.text()
    state, said = checked(model, text.replace("der(x1) = ", "der(x1) = 0.01 + "))
    assert (state, said.split(" ")[0]) == ("wrong", "x1")
    assert checked(model, text.replace("equation", "equations"))[0] == "refused"
    model.compared.append("nowhere")
    assert checked(model, text)[0] == "crash"


def test_counts_are_printed_and_kept(tmp_path, capsys) -> None:
    kept = tmp_path / "found.json"
    assert main(["--count", "1", "--seed", "5", "--json", str(kept)]) == 0
    assert "1 models: 1 right" in capsys.readouterr().out
    assert '"right": 1' in kept.read_text()


@pytest.mark.slow
def test_two_hundred_models() -> None:
    assert [o for o in map(tried, range(200)) if o.state != "right"] == []
