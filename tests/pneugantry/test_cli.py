"""The command line: exit codes, JSON, and one line on standard error for whatever
cannot be used.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pneugantry.cli import ALIASES, COMMANDS, main
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED, Log, read_log, write_log
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import Scenario

Capture = pytest.CaptureFixture[str]
PHASES = {"approach": (0.0, 1.0), "contact": (1.0, 2.0), "contour": (2.0, 3.0)}
SCENARIO = """
name = "short"
workpiece = "straight"
start = { x = 0.95, z = 0.038 }
phases = { approach = [0.0, 1.0], contact = [1.0, 2.0], contour = [2.0, 3.0] }
seed = 3
"""


@pytest.fixture(scope="module")
def fmu() -> Path:
    return build_fmu().path


@pytest.fixture(scope="module")
def log(fmu: Path) -> Log:
    return run_scenario(
        Scenario(name="run", workpiece="straight", start_z=0.038, phases=PHASES, seed=1),
        FmuFile.read(fmu),
    ).log


def said(capture: Capture, *arguments: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    capture.readouterr()
    code = main(list(arguments))
    out, err = capture.readouterr()
    return code, out, err


@pytest.mark.parametrize(("where", "code"), [(["--json", "told.json"], 0), ([], 1)])
def test_a_command_whose_reader_leaves_still_writes_its_files(
    where: list[str], code: int, tmp_path: Path
) -> None:
    """`pneugantry ... 2>&1 | head -1`: what it would tell further goes nowhere."""
    command = [sys.executable, "-m", "pneugantry", "list", "effects", *where]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=tmp_path, stdout=pipe, stderr=subprocess.STDOUT) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait(60) == code
    assert len(list(tmp_path.glob("told.json"))) == bool(where)


def result(capture: Capture, *arguments: str) -> Any:
    """The JSON that a command that succeeds writes on standard output, which holds nothing else."""
    code, out, _ = said(capture, *arguments, "--json", "-")
    assert code == 0
    return json.loads(out)


def refusal(capture: Capture, *arguments: str) -> str:
    """The one line of a command that cannot use what it was given."""
    code, out, err = said(capture, *arguments)
    assert code == 2, err
    assert out == ""
    assert err.count("\n") == 1
    assert err.endswith("\n")
    assert "Traceback" not in err
    assert err.startswith("pneugantry")
    return err


# ---- what the commands do


def test_build_says_what_it_built_and_builds_once(capsys: Capture, tmp_path: Path) -> None:
    arguments = ("build", "--class", "PneuGantry.Valve", "--out", str(tmp_path))
    first = result(capsys, *arguments)
    assert set(first) == {"schema", "fmu", "manifest", "rebuilt"}
    assert first["schema"] == "build/1"
    assert first["rebuilt"] is True
    assert FmuFile.read(first["fmu"]).description.fmi == "2.0"
    assert json.loads(Path(first["manifest"]).read_text())["model"] == "PneuGantry.Valve"
    assert result(capsys, *arguments)["rebuilt"] is False
    assert result(capsys, *arguments, "--force")["rebuilt"] is True
    three = result(capsys, *arguments, "--fmi", "3.0")
    assert FmuFile.read(three["fmu"]).description.fmi == "3.0"


def test_run_prints_and_writes_what_cli_md_promises(capsys: Capture, tmp_path: Path) -> None:
    scenario = tmp_path / "short.toml"
    scenario.write_text(SCENARIO)
    out, plot = tmp_path / "log.parquet", tmp_path / "run.png"
    found = result(
        capsys,
        "run",
        str(scenario),
        "--set",
        "contact.K_c=2e4",
        "--out",
        str(out),
        "--plot",
        str(plot),
    )
    assert set(found) >= {"schema", "metrics", "steps", "seconds", "realtime_factor"}
    assert (found["controller"], found["workpiece"], found["seed"]) == ("pi_fv", "straight", 3)
    assert found["schema"] == "run/1"
    assert set(found["metrics"]) == {"rmse_fn", "me_fn", "rmse_vt", "me_vt"}
    assert all(isinstance(v, float) and 0 < v < 100 for v in found["metrics"].values())
    assert found["steps"] == 3000
    assert found["realtime_factor"] == pytest.approx(3.0 / found["seconds"])
    log = read_log(out)
    assert log.provenance["parameters"] == {"contact.K_c": 2e4}
    assert log.provenance["seed"] == 3
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_a_controller_that_a_scenario_names_wrongly_is_refused_with_its_file(
    capsys: Capture, tmp_path: Path
) -> None:
    (tmp_path / "short.toml").write_text(SCENARIO + 'controller = "pi_vf"\n')
    text = refusal(capsys, "run", str(tmp_path / "short.toml"))
    assert "short.toml: controller: unknown controller 'pi_vf'; nearest is 'pi_fv'" in text


def test_run_in_words_names_the_four_figures(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(SCENARIO)
    code, out, err = said(
        capsys, "run", str(tmp_path / "short.toml"), "--controller", "dfv", "--seed", "4"
    )
    assert (code, err) == (0, "")
    assert out.startswith("straight, dfv: f_n RMSE ")
    assert out.count(" ME ") == out.count("RMSE") == 2


def test_json_goes_to_a_file_beside_the_words(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(SCENARIO)
    target = tmp_path / "deep" / "run.json"
    code, out, _ = said(capsys, "run", str(tmp_path / "short.toml"), "--json", str(target))
    assert code == 0
    assert "f_n RMSE" in out
    assert json.loads(target.read_text())["schema"] == "run/1"


def test_a_run_that_could_not_finish_ends_with_1_and_its_log(
    capsys: Capture, tmp_path: Path, fmu: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pneugantry.api.runs as api

    def cancelled(scenario: Scenario, file: FmuFile, **options: Any) -> Any:
        return run_scenario(
            scenario, file, compiled=False, progress=lambda done, total: done < 1500
        )

    monkeypatch.setattr(api, "run_scenario", cancelled)
    (tmp_path / "short.toml").write_text(SCENARIO)
    code, out, err = said(
        capsys,
        "run",
        str(tmp_path / "short.toml"),
        "--out",
        str(tmp_path / "log.csv"),
        "--json",
        "-",
    )
    assert code == 1
    assert json.loads(out)["outcome"] == "cancelled"
    assert json.loads(out)["metrics"] is None
    assert "cancelled after 1500 of 3000 samples" in err
    assert len(read_log(tmp_path / "log.csv")) == 1500


def test_replay_gives_gaps_by_log_channel_and_block(
    capsys: Capture, tmp_path: Path, log: Log
) -> None:
    write_log(log, tmp_path / "run.parquet")
    found = result(capsys, "replay", str(tmp_path / "run.parquet"))
    assert set(found) == {"schema", "logs"}
    assert found["schema"] == "replay/1"
    entry = found["logs"]["run"]
    assert set(entry) == {"gap", "channels", "blocks"}
    assert set(entry["channels"]) == set(MEASURED)
    assert set(entry["blocks"]) <= {
        "valve_x",
        "valve_z",
        "friction_x",
        "friction_z",
        "contact",
        "sensors",
        "timing",
    }
    assert all(set(block) == {"gap", "floor"} for block in entry["blocks"].values())
    assert 0.95 < entry["gap"] < 1.05
    assert max(entry["channels"].values()) < 1.06  # 3,000 samples
    code, out, err = said(capsys, "replay", str(tmp_path / "run.parquet"))
    assert (code, err) == (0, "")
    assert "block: gap/floor" in out


def test_replay_of_a_csv_campaign(capsys: Capture, tmp_path: Path, log: Log) -> None:
    write_log(log, tmp_path / "mine.csv")
    text = (
        '[log.mine]\nloop = "closed"\nclamped = ["x until contour"]\nstart = { x = 0.95, z = '
        '0.038 }\nworkpiece = "straight"\n'
    )
    phases = (
        "phases = { approach = [0.0, 1.0], contact = [1.0, 2.0], contour = [2.0, 3.0] "
        "}\nstandoff = 0.04\nf_nd = 30.0\nv_td = -0.06\n"
    )
    (tmp_path / "campaign.toml").write_text(text + phases)
    assert result(capsys, "replay", str(tmp_path))["logs"]["mine"]["gap"] < 1.05


def test_demo_diagnoses_a_rig_that_it_is_not_told_about(
    capsys: Capture, tmp_path: Path, keeps_to_schema: Callable[[Any], None]
) -> None:
    found = result(capsys, "demo", "--out", str(tmp_path / "demo"))
    keeps_to_schema(found)
    keeps_to_schema(found["diagnosis"])
    page = Path(found["report"]).read_text()
    assert Path(found["report"]) == tmp_path / "demo" / "report.html"
    assert "<script" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    (truth,) = found["truth"]
    first = found["diagnosis"]["causes"][0]
    assert (first["effect"], first["axis"]) == (truth["effect"], truth["axis"])
    assert found["diagnosis"]["gap"]["shrink"] > 0.9
    assert (tmp_path / "demo" / "tracking.png").is_file()
    assert len(read_log(tmp_path / "demo" / "curved.parquet")) == 16000


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_is_printed_and_names_the_command(command: str, capsys: Capture) -> None:
    code, out, err = said(capsys, *([command] if command else []), "--help")
    assert (code, err) == (0, "")
    assert out.startswith(f"usage: pneugantry {command}".strip())


HEAVY = {"numpy", "scipy", "pandas", "numba", "casadi", "control", "matplotlib", "rumoca", "fmpy"}


@pytest.mark.parametrize(
    "calls", [[["--help"]], [["--version"]], [["fly"]], [[]], [[c, "--help"] for c in COMMANDS]]
)
def test_the_list_of_commands_and_help_import_no_library(calls: list[list[str]]) -> None:
    code = (
        "import sys; from pneugantry.cli import main; "
        f"[main(call) for call in {calls}]; print(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in done.stderr.split()}
    assert "pneugantry" in loaded
    assert not loaded & HEAVY


def test_a_command_imports_no_other_command() -> None:
    code = (
        "import sys; from pneugantry.cli import main; main(['completion', '--help']); "
        "print(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    commands = [name for name in done.stderr.split() if name.startswith("pneugantry.commands.")]
    assert commands == ["pneugantry.commands.completion"]


def test_the_table_names_every_command_and_no_other() -> None:
    folder = Path(importlib.util.find_spec("pneugantry.commands").submodule_search_locations[0])
    commands = {path.stem for path in folder.glob("*.py") if "\nHELP = " in path.read_text()}
    assert commands == set(COMMANDS)
    assert set(ALIASES.values()) <= set(COMMANDS)


def test_the_version_is_that_of_the_package(capsys: Capture) -> None:
    code, out, _ = said(capsys, "--version")
    assert (code, out) == (0, f"pneugantry {importlib.metadata.version('pneugantry')}\n")


@pytest.mark.parametrize(("alias", "command"), ALIASES.items())
def test_a_former_name_still_calls_its_command(alias: str, command: str, capsys: Capture) -> None:
    code, out, err = said(capsys, alias, "--help")
    assert (code, err) == (0, "")
    assert out.startswith(f"usage: pneugantry {command}")


# ---- what cannot be used


def spoiled(log: Log, path: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> str:
    """A CSV of the log after a change to its table."""
    change(log.table.copy()).to_csv(path, index=False)
    return str(path)


def with_nan(table: pd.DataFrame) -> pd.DataFrame:
    table.loc[17, "f_z"] = np.nan
    return table


def gapped(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(index=range(100, 120))


BAD_LOGS: dict[str, tuple[Callable[[pd.DataFrame], pd.DataFrame], tuple[str, ...]]] = {
    "missing column": (
        lambda t: t.drop(columns="f_az"),
        ("f_az: column is missing", "; add it [N]"),
    ),
    "renamed column": (
        lambda t: t.rename(columns={"v_x": "vx"}),
        ("v_x: column is missing", '; rename column "vx" to "v_x"'),
    ),
    "NaN": (with_nan, ("f_z: row 17 is empty or NaN", "; fill it in")),
    "millimetres": (
        lambda t: t.assign(z=1e3 * t["z"]),
        ("z: row ", "looks like mm", "; divide column z by 1000"),
    ),
    "speed in mm/s": (
        lambda t: t.assign(v_z=1e3 * t["v_z"]),
        ("v_z: ", "looks like mm/s", "; divide column v_z by 1000"),
    ),
    "wrong rate": (
        lambda t: t.iloc[::2],
        ("time: sampled at 500 Hz, expected 1000 Hz", "; record at 1 kHz"),
    ),
    "milliseconds": (
        lambda t: t.assign(time=1e3 * t["time"]),
        ("time: looks like milliseconds", "; divide column time by 1000"),
    ),
    "rows lost": (gapped, ("time: row 100", "gap of 21 ms", "; cut the log there")),
    "no number": (
        lambda t: t.assign(x=t["x"].astype(object).where(t.index != 5, "abc")),
        ("x: row 5 is 'abc', not a number", "; use plain numbers"),
    ),
    "hardly a row": (lambda t: t.iloc[:3], ("3 rows, expected at least 10", "; record")),
}


@pytest.mark.parametrize("case", BAD_LOGS)
def test_a_log_that_cannot_be_used_is_refused_in_one_line(
    case: str, capsys: Capture, tmp_path: Path, log: Log
) -> None:
    change, words = BAD_LOGS[case]
    path = spoiled(log, tmp_path / "bad.csv", change)
    line = refusal(capsys, "replay", path)
    assert line.startswith(
        f"pneugantry: {path}: {words[0]}" if len(words) == 2 else f"pneugantry: {path}: "
    )
    for word in words:
        assert word in line


def test_the_bad_log_of_a_campaign_is_named(capsys: Capture, tmp_path: Path, log: Log) -> None:
    spoiled(log, tmp_path / "mine.csv", with_nan)
    (tmp_path / "campaign.toml").write_text("[log.mine]\nworkpiece = 'straight'\n")
    assert "mine.csv: f_z: row 17 is empty or NaN; fill it in" in refusal(
        capsys, "replay", str(tmp_path)
    )
    (tmp_path / "campaign.toml").write_text("[log.mine]\nworkpeace = 'straight'\n")
    assert "campaign.toml: log.mine.workpeace: unknown key; did you mean workpiece?" in refusal(
        capsys, "replay", str(tmp_path)
    )


@pytest.mark.parametrize("command", [("run",), ("replay", "LOG")])
def test_an_fmu_that_cannot_be_used_is_refused_in_one_line(
    command: tuple[str, ...], capsys: Capture, tmp_path: Path, fmu: Path, log: Log
) -> None:
    write_log(log, tmp_path / "run.parquet")
    arguments = [str(tmp_path / "run.parquet") if word == "LOG" else word for word in command]

    def refused(content: bytes) -> str:
        (tmp_path / "given.fmu").write_bytes(content)
        return refusal(capsys, *arguments, "--fmu", str(tmp_path / "given.fmu"))

    whole = fmu.read_bytes()
    for cut in (whole[: len(whole) // 2], whole[:3000], b""):
        assert "given.fmu: not a zip archive, or a truncated one" in refused(cut)
    assert "; build or download the FMU again" in refused(b"this is no FMU")

    def archived(members: dict[str, str]) -> bytes:
        with zipfile.ZipFile(tmp_path / "given.zip", "w") as archive:
            for name, text in members.items():
                archive.writestr(name, text)
        return (tmp_path / "given.zip").read_bytes()

    assert "given.fmu: modelDescription.xml is missing; this is no FMU" in refused(
        archived({"readme.txt": "hello"})
    )
    outside = refused(archived({"modelDescription.xml": "<a/>", "../../escaped.txt": "gotcha"}))
    assert "given.fmu: ../../escaped.txt: this path leaves the folder" in outside
    assert "; do not trust this file" in outside
    assert not list(tmp_path.parent.rglob("escaped.txt"))
    valve = build_fmu("PneuGantry.Valve", out=tmp_path).path.read_bytes()
    assert (
        "given.fmu: u_x: is the FMU of PneuGantry.Valve, which has no such variable; "
        "give an FMU with" in refused(valve)
    )
    assert "absent.fmu: no such file; build it with" in refusal(
        capsys, *arguments, "--fmu", str(tmp_path / "absent.fmu")
    )


BAD_OPTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "unknown parameter": (
        ("--set", "contact.Kc=1"),
        ("contact.Kc: no such variable; did you mean contact.K_c",),
    ),
    "no parameter of it": (
        ("--set", "f_n=1"),
        ("f_n: a variable of causality output cannot be set; remove it",),
    ),
    "out of bounds": (
        ("--set", "valve_z.tau=-1"),
        ("valve_z.tau: ", "= -1 is refused", "; choose a finite value within 0.001..100 s"),
    ),
    "no number": (
        ("--set", "valve_z.tau=fast"),
        ("--set: 'valve_z.tau=fast' is no PARAM=VALUE; write for example --set",),
    ),
    "no name": (("--set", "=1"), ("--set: '=1' is no PARAM=VALUE; write for example --set",)),
    "NaN parameter": (
        ("--set", "valve_z.tau=nan"),
        ("plant.valve_z.tau: is nan, expected a number; write a plain number",),
    ),
    "unknown controller": (
        ("--controller", "pi_fw"),
        ("controller: unknown controller 'pi_fw'; nearest is 'pi_fv'",),
    ),
    "unknown workpiece": (
        ("--workpiece", "incline_8"),
        ("workpiece: unknown workpiece 'incline_8'; did you mean incline_7?",),
    ),
    "absent profile": (
        ("--workpiece", "nowhere/edge.csv"),
        ("nowhere/edge.csv: workpiece: no such file; check the path",),
    ),
    "seed below 0": (("--seed", "-1"), ("--seed: is -1, expected >= 0; choose",)),
    "seed that is none": (
        ("--seed", "x"),
        ("run: argument --seed: invalid int value: 'x'; see pneugantry run --help",),
    ),
    "unknown option": (
        ("--contoller", "pi_fv"),
        ("unrecognized arguments: --contoller", "; see pneugantry --help"),
    ),
    "unknown kind of log": (
        ("--out", "log.xls"),
        ("log.xls: unknown kind of log file '.xls'; end it in .parquet or .csv",),
    ),
    "unknown kind of picture": (
        ("--plot", "run.xls"),
        ("run.xls: unknown kind of picture '.xls'; end it in .png",),
    ),
    "absent scenario": (("nowhere.toml",), ("nowhere.toml: no such file; check the path",)),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_an_option_that_cannot_be_used_is_refused_in_one_line(
    case: str, capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments, words = BAD_OPTIONS[case]
    line = refusal(capsys, "run", *arguments)
    for word in words:
        assert word in line
    assert not list(tmp_path.iterdir())


BAD_SCENARIOS = {
    "no TOML": ("name = [", "not valid TOML", "; correct that line"),
    "unknown key": ("workpeace = 'curved'", "workpeace: unknown key", "; did you mean workpiece?"),
    "wrong type": (
        "seed = 'one'",
        "seed: is 'one', expected a whole number",
        "; write a whole number",
    ),
    "out of range": (
        "standoff = 5.0",
        "standoff: is 5.0, expected 0..0.101",
        "; choose a value within it",
    ),
    "gap between phases": (
        "phases = { contact = [1.0, 2.0], contour = [2.0, 3.0] }",
        "phases.contact: starts at 1 s, expected 0 s",
        "; leave no gap",
    ),
    "jitter without delay": (
        "timing = { jitter = 0.0001 }",
        "timing: jitter of 0.0001 s RMS reaches",
        "; choose a value within it",
    ),
    "unknown workpiece": (
        "workpiece = 'bent'",
        "workpiece: unknown workpiece 'bent'",
        "; use straight",
    ),
    "profile that is not there": (
        "workpiece = 'edge.csv'",
        "workpiece: no such file",
        "; check the path",
    ),
    "unknown phase": (
        "clamped = ['x until landing']",
        "clamped: has 'x until landing', no phase 'landing'",
        '; write "x"',
    ),
}


@pytest.mark.parametrize("case", BAD_SCENARIOS)
def test_a_scenario_that_cannot_be_used_is_refused_in_one_line(
    case: str, capsys: Capture, tmp_path: Path
) -> None:
    text, *words = BAD_SCENARIOS[case]
    path = tmp_path / "mine.toml"
    path.write_text(text + "\n")
    line = refusal(capsys, "run", str(path))
    assert line.startswith(f"pneugantry: {path}: ")
    for word in words:
        assert word in line


def test_a_profile_in_millimetres_is_refused_in_one_line(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "edge.csv").write_text(
        "x,z_w\n" + "".join(f"{x},{0.01 * x}\n" for x in range(200, 1000, 50))
    )
    line = refusal(capsys, "run", "--workpiece", str(tmp_path / "edge.csv"))
    assert "edge.csv: x: spans 750 m, looks like millimetres; divide column x by 1000" in line


def test_without_a_compiler_the_way_out_is_named(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *rest: None if name == "ziglang" else find(name, *rest),
    )
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    line = refusal(capsys, "build", "--out", str(tmp_path))
    assert "no C compiler for " in line
    assert "; pip install ziglang, or install gcc or clang" in line
    monkeypatch.setenv("CC", "no-such-compiler")
    assert "CC: no compiler 'no-such-compiler'; correct or unset the variable CC" in refusal(
        capsys, "build", "--out", str(tmp_path)
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--class", "PneuGantry.Nope"), "no class PneuGantry.Nope in this file; it holds"),
        (("--model", "nowhere.mo"), "nowhere.mo: no such Modelica file"),
        (("--platform", "amiga"), "--platform: unknown platform 'amiga'; use one of"),
        (("--fmi", "1.0"), "argument --fmi: invalid choice: '1.0'"),
    ],
)
def test_what_cannot_be_built_is_refused_in_one_line(
    arguments: tuple[str, ...], words: str, capsys: Capture, tmp_path: Path
) -> None:
    assert words in refusal(capsys, "build", *arguments, "--out", str(tmp_path))


def test_modelica_that_cannot_be_compiled_names_file_and_line(
    capsys: Capture, tmp_path: Path
) -> None:
    model = tmp_path / "Bad.mo"
    model.write_text(
        "model Bad\n  Real x(start = 0, fixed = true);\nequation\n  der(x) = "
        "spatialDistribution(x);\nend Bad;\n"
    )
    assert f"{model}:4" in refusal(
        capsys, "build", "--model", str(model), "--class", "Bad", "--out", str(tmp_path)
    )


@pytest.mark.parametrize("option", ["--json", "--out", "--plot"])
def test_a_place_that_cannot_be_written_is_refused_in_one_line(
    option: str, capsys: Capture, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "short.toml").write_text(SCENARIO)
    suffix = {"--json": "json", "--out": "csv", "--plot": "png"}[option]
    code, _, err = said(
        capsys, "run", str(tmp_path / "short.toml"), option, str(tmp_path / "file" / f"x.{suffix}")
    )
    assert code == 2
    assert err.count("\n") == 1
    assert f"x.{suffix}: cannot be written" in err


def test_an_unknown_command_is_refused_in_one_line(capsys: Capture) -> None:
    assert "invalid choice: 'fly'" in refusal(capsys, "fly")
    assert "required: COMMAND" in refusal(capsys)
