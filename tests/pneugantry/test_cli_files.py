"""What a user brings or asks for: own controllers, gains, presets, names of things,
special files.
"""

from __future__ import annotations

import argparse
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from controllers.catalogue import controller_names
from controllers.gains import TABLES, gains_named, named_gains
from pneugantry.cli import main, parser
from pneugantry.options import INPUTS, OUTPUTS

Capture = pytest.CaptureFixture[str]


def result(capture: Capture, *arguments: str) -> Any:
    capture.readouterr()
    assert main([*arguments, "--json", "-"]) == 0
    return json.loads(capture.readouterr().out)


def test_a_controller_to_start_from_tracks_the_edge(capsys: Capture, tmp_path: Path) -> None:
    own = tmp_path / "my.py"
    assert main(["controller", "init", str(own)]) == 0
    assert main(["controller", "init", str(own)]) == 2
    assert "is there already" in capsys.readouterr().err
    run = ("run", "--controller", str(own), "--workpiece", "straight")
    done = result(capsys, *run)
    assert done["metrics"]["rmse_fn"] < 0.1  # N, the sensors' noise is 0.05
    assert done["limit_cycle"] is None
    assert done["controller"] == str(own.resolve())
    other = result(capsys, *run, "--gains", "kp_f=0.05", "--f_nd", "20")
    assert other["metrics"] != done["metrics"]


def test_a_sweep_takes_it_too(capsys: Capture, tmp_path: Path) -> None:
    main(["controller", "init", str(tmp_path / "my.py")])
    spec = tmp_path / "study.toml"
    spec.write_text(
        'base = { workpiece = "straight" }\n[grid]\ncontroller = ["my.py", "pi_fv"]\n',
        encoding="utf-8",
    )
    found = result(capsys, "sweep", str(spec), "--workers", "1", "--out", str(tmp_path / "out"))
    assert found["failed"] == 0
    table = pd.read_parquet(found["results"])
    assert table["rmse_fn"].max() < 0.1
    spec.write_text(spec.read_text(encoding="utf-8").replace("my.py", "your.py"), encoding="utf-8")
    assert main(["sweep", str(spec)]) == 2
    assert "grid.controller: no such file" in capsys.readouterr().err


def test_the_leaderboard_s_conditions_are_a_preset(capsys: Capture) -> None:
    from pneugantry.thesis.conditions import CHOICE, Run, scenario_of
    from pneugantry.thesis.scores import score_log
    from pyfmi_runner.build import build_fmu
    from pyfmi_runner.fmu import FmuFile
    from pyfmi_runner.run import run_scenario

    run = Run(workpiece="straight", controller="pi_fv")
    log = run_scenario(scenario_of(run), FmuFile.read(build_fmu().path)).log
    scores = score_log(log, quiet=CHOICE.quiet, v_td=run.v_td, f_nd=30.0)
    found = result(capsys, "run", "--preset", "thesis", "--workpiece", "straight")
    assert found["metrics"] == pytest.approx(
        {
            "rmse_fn": scores.rmse_fn,
            "me_fn": scores.me_fn,
            "rmse_vt": scores.rmse_vt,
            "me_vt": scores.me_vt,
        }
    )
    assert main(["run", "--preset", "thesys"]) == 2
    assert "--preset: unknown preset 'thesys'; use campaign or thesis" in capsys.readouterr().err


def test_the_rigs_converter_is_a_preset(capsys: Capture, tmp_path: Path) -> None:
    """12 bits over +-10 V: every reading lies on the converter's steps; ideal sensors have none."""
    from pyfmi_runner.sensors import converter_steps

    step = converter_steps()[4]  # N, of f_x and f_z
    for preset, on_steps in (("thesis", False), ("thesis_converter", True)):
        log = tmp_path / f"{preset}.parquet"
        result(capsys, "run", "--preset", preset, "--workpiece", "straight", "--out", str(log))
        steps = pd.read_parquet(log)["f_z"].to_numpy() / step
        assert bool((abs(steps - steps.round()) < 1e-6).all()) is on_steps


def test_a_limit_cycle_is_said(capsys: Capture) -> None:
    found = result(capsys, "run", "--workpiece", "straight", "--controller", "observer_fv")
    assert found["limit_cycle"]["period"] == pytest.approx(0.27, abs=0.05)
    main(["run", "--workpiece", "straight", "--controller", "observer_fv"])
    assert "a limit cycle" in capsys.readouterr().out


def test_single_gains_go_over_a_table_s(capsys: Capture) -> None:
    run = ("run", "--workpiece", "straight")
    assert (
        result(capsys, *run, "--gains", "table_4_6")["metrics"] == result(capsys, *run)["metrics"]
    )
    named = result(capsys, *run, "--gains", "Kp_fz=0.03")["metrics"]
    assert named != result(capsys, *run)["metrics"]
    assert main([*run, "--gains", "table_9"]) == 2
    assert main([*run, "--gains", "Kp_q=1"]) == 2
    err = capsys.readouterr().err
    assert "gains must name a table" in err
    assert "unknown gain 'Kp_q'" in err
    assert "pneugantry list gains" in err  # where the names stand
    for table in TABLES.values():
        name = next(n for n, t in TABLES.items() if t is table)
        assert gains_named(named_gains(name)) == table


LISTS = ("parameters", "effects", "controllers", "gains", "workpieces", "presets", "columns")


@pytest.mark.parametrize("what", LISTS)
def test_what_can_be_named_is_listed(what: str, capsys: Capture) -> None:
    entries = result(capsys, "list", what)["entries"]
    assert entries
    assert all(entry["about"] for entry in entries), [e for e in entries if not e["about"]][:3]
    part = entries[-1]["name"]
    assert part in [entry["name"] for entry in result(capsys, "list", what, part)["entries"]]


def test_the_controllers_that_are_listed_as_fmus_can_be_exported(capsys: Capture) -> None:
    from pyfmi_runner.build import build_controller_fmu

    entries = {e["name"]: e["export"] for e in result(capsys, "list", "controllers")["entries"]}
    assert list(entries) == controller_names()
    assert sum(kind == "FMU" for kind in entries.values()) == 11
    assert build_controller_fmu("observer_fv").path.is_file()
    assert entries["observer_fv"] == "FMU"
    assert entries["pi_fv_mbpm"] == "-"


# ---- special files


@pytest.mark.skipif(os.name != "posix", reason="links and devices of POSIX")
def test_results_do_not_replace_what_is_no_file(capsys: Capture, tmp_path: Path) -> None:
    target, link = tmp_path / "real.json", tmp_path / "link.json"
    target.write_text("old", encoding="utf-8")
    link.symlink_to(target)
    assert main(["list", "workpieces", "--json", str(link)]) == 0
    assert link.is_symlink()
    assert json.loads(target.read_text(encoding="utf-8"))["schema"] == "list/1"
    if Path("/dev/full").exists():
        capsys.readouterr()
        assert main(["list", "workpieces", "--json", "/dev/full"]) == 2
        assert capsys.readouterr().err.count("\n") == 1
        assert not Path("/dev/full").is_file()
        assert main(["list", "gains", "--json", "/dev/stdout"]) == 0
        assert json.loads(capsys.readouterr().out)["what"] == "gains"


def test_an_unwritable_place_is_refused_before_the_work(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("pneugantry.plants.gantry.catalogue.catalogue_of", None)  # not reached
    for option in ("--html", "--json"):
        page = str(tmp_path / "file" / "page.html")
        assert main(["diagnose", str(tmp_path), option, page]) == 2
        err = capsys.readouterr().err
        assert f"argument {option}: {page}: cannot be written" in err
        assert err.count("\n") == 1


def test_a_result_does_not_replace_what_is_read(capsys: Capture, tmp_path: Path) -> None:
    scenario = tmp_path / "s.toml"
    scenario.write_text('workpiece = "straight"\n', encoding="utf-8")
    assert main(["run", str(scenario), "--json", str(scenario)]) == 2
    assert "--json: would replace the file that is read" in capsys.readouterr().err
    assert scenario.read_text(encoding="utf-8") == 'workpiece = "straight"\n'


@pytest.mark.parametrize(
    "words",
    [
        ("calibrate", "FILE"),
        ("diagnose", "a.parquet", "--after", "FILE"),
        ("diagnose", "a.parquet", "--controller", "FILE"),
        ("build", "--parts", "FILE"),
        ("thesis", "--runs", "FILE"),
    ],
)
def test_no_command_replaces_what_it_reads(
    words: tuple[str, ...], capsys: Capture, tmp_path: Path
) -> None:
    path = tmp_path / "given.toml"
    path.write_text("[plant]\n", encoding="utf-8")
    command = [str(path) if word == "FILE" else word for word in words]
    assert main([*command, "--json", str(path)]) == 2
    assert "--json: would replace the file that is read" in capsys.readouterr().err
    assert path.read_text(encoding="utf-8") == "[plant]\n"


NAMES_A_PLACE = re.compile(r"FILE|FOLDER|DIR|PATH|LOG|CAMPAIGN|PLANT|\.\w+$")


def options_of(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Of a parser and of all commands in it."""
    for action in parser._actions:
        if isinstance(action.choices, dict):
            for command in action.choices.values():
                yield from options_of(command)
        else:
            yield action


def test_every_option_that_names_a_place_says_whether_it_is_read_or_written() -> None:
    places = {
        action.dest
        for action in options_of(parser())
        if action.type is Path or NAMES_A_PLACE.search(str(action.metavar or ""))
    }
    assert not set(INPUTS) & set(OUTPUTS)
    assert places == {*INPUTS, *OUTPUTS}


@pytest.mark.parametrize(
    ("command", "option"), [("identify", "--plot"), ("diagnose", "--augmented"), ("demo", "--out")]
)
def test_a_folder_that_reads_as_a_file_is_refused(
    command: str, option: str, capsys: Capture, tmp_path: Path
) -> None:
    path = tmp_path / "lags.png"
    named = [] if command == "demo" else ["a.parquet"]
    assert main([command, *named, option, str(path)]) == 2
    assert f"{option}: {path}: names a file, expected a folder" in capsys.readouterr().err
    assert not path.exists()
