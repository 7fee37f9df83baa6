"""How far a command is: what a library logs is told while a command asks for it, and no longer."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from pneugantry.progress import Stages, logged
from pyfmi_runner.build import build_controller_fmu


def test_a_build_names_its_equations_and_each_binary(tmp_path: Path) -> None:
    seen: list[str] = []
    with logged("modelica_fmu", seen.append):
        build_controller_fmu("pi_fv", out=tmp_path)
        logging.getLogger("modelica_fmu").debug("of no interest")
    assert seen[0] == "equations of PneuGantry_Controllers_pi_fv"
    assert [text.split(",")[0] for text in seen[1:]] == ["binary 1 of 1"]
    with logged("modelica_fmu", seen.append):
        assert not build_controller_fmu("pi_fv", out=tmp_path).rebuilt
    logging.getLogger("modelica_fmu").warning("nobody listens")
    assert len(seen) == 2


def test_a_stage_that_lasts_is_a_line_where_there_is_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("pneugantry.progress.REFRESH", 0.01)
    with Stages("build") as say:
        for text in ("equations of X", "binary 1 of 2, x86_64-linux"):
            say(text)
            while say.told != text:
                say.end.wait(0.005)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(" (")[0] for line in lines] == [
        "build: equations of X",
        "build: binary 1 of 2, x86_64-linux",
    ]
