"""What `pneugantry diagnose` writes, and what it refuses before it diagnoses."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from modelica_fmu.errors import InputError
from pneugantry.api.diagnosis import Diagnosis
from pneugantry.api.diagnosis import diagnose as diagnose_by_api
from pneugantry.cli import main
from pneugantry.learn.answer.export import write_catalogue
from pneugantry.plants import campaigns
from pyfmi_runner.build import default_model

Refused = Callable[..., str]
MOTOR = Path(__file__).parents[2] / "examples" / "motor"
ANSWER = {"verdict": "none", "where": [], "causes": [], "answer_set": [], "gap": None} | {
    "closed_loop": None,
    "seconds": 1.0,
    "probabilities": {"none": 0.99, "unknown": 0.0},
    "unknown_probability": 0.0,
}


@dataclass
class Answered:
    """An answer whose model cannot be written."""

    json: Any
    learned: Any = None
    term: Any = None

    def with_missing_term(self, say: object) -> Answered:
        return self

    def write_html(self, path: Path) -> Path:
        path.touch()
        return path

    def write_augmented(self, folder: Path) -> None:
        raise InputError("cannot be written", file=folder)


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Refused:
    """The line of a command that ends before anything is diagnosed."""

    def reached(*_: object, **__: object) -> None:
        raise AssertionError("it was diagnosed")

    monkeypatch.setattr("pneugantry.api.diagnosis.diagnose", reached)
    monkeypatch.setattr("pneugantry.api.diagnosis.diagnose_change", reached)
    monkeypatch.setattr(campaigns, "run_jobs", reached)

    def line(*words: object) -> str:
        capsys.readouterr()
        assert main(["diagnose", *map(str, words)]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1
        return err

    return line


@pytest.fixture
def motor(tmp_path: Path) -> Path:
    """The tutorial's motor in a folder of its own."""
    shutil.copytree(MOTOR, tmp_path / "motor")
    return tmp_path / "motor" / "plant.toml"


@pytest.mark.parametrize("option", ["--augmented", "--catalogue-out"])
def test_the_plants_own_file_is_not_replaced(option: str, motor: Path, refused: Refused) -> None:
    text = refused(motor, option, motor.parent)
    assert f"{option}: would replace the file that is read" in text
    assert "Motor.mo" in text


def test_no_file_that_is_read_is_replaced(motor: Path, tmp_path: Path, refused: Refused) -> None:
    effects = tmp_path / "effects.toml"
    shutil.copy(next((MOTOR / "effects").glob("*.toml")), effects)
    assert "effects.toml" in refused(motor, "--catalogue", effects, "--catalogue-out", tmp_path)
    (tmp_path / "AugmentedGantry.fmu").touch()
    given = ("--fmu", tmp_path / "AugmentedGantry.fmu", "--augmented", tmp_path)
    assert "AugmentedGantry.fmu" in refused("log.parquet", *given)
    assert "PneuGantry.mo" in refused("log.parquet", "--augmented", default_model().parent)


def test_without_learning_the_plants_folder_is_as_good_as_any(
    motor: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pneugantry.api.diagnosis.diagnose", lambda *_, **__: Answered(ANSWER))
    monkeypatch.setattr(Answered, "write_augmented", lambda *_: ("model", "fmu"))
    assert main(["diagnose", str(motor), "--augmented", str(motor.parent), "--no-learn"]) == 0


@pytest.mark.parametrize("option", ["--augmented", "--catalogue-out"])
def test_an_fmu_cannot_be_extended(option: str, motor: Path, refused: Refused) -> None:
    text = motor.read_text(encoding="utf-8").replace('model = "Motor.mo"', 'fmu = "Motor.fmu"')
    motor.write_text(text.replace('class = "Motor.Axis"\n', ""), encoding="utf-8")
    line = refused(motor, option, motor.parent / "out")
    assert f"plant.toml: {option}: an FMU without source cannot be extended" in line


@pytest.mark.parametrize("beside", [("--no-learn",), ("--after", "other.parquet")])
def test_a_term_that_is_not_looked_for_is_not_written(
    beside: tuple[str, ...], tmp_path: Path, refused: Refused
) -> None:
    line = refused("log.parquet", "--catalogue-out", tmp_path / "known", *beside)
    assert f"with {beside[0]} none is looked for" in line


def test_page_and_json_are_there_where_the_model_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("pneugantry.api.diagnosis.diagnose", lambda *_, **__: Answered(ANSWER))
    page, told = tmp_path / "page.html", tmp_path / "found.json"
    files = ("--html", str(page), "--json", str(told))
    assert main(["diagnose", "log.parquet", "--augmented", str(tmp_path / "out"), *files]) == 2
    assert capsys.readouterr().err.endswith("out: cannot be written\n")
    assert json.loads(told.read_text(encoding="utf-8")) == ANSWER
    assert page.is_file()


def test_no_term_to_write_is_a_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = Answered(ANSWER, learned="something")
    monkeypatch.setattr("pneugantry.api.diagnosis.diagnose", lambda *_, **__: found)
    command = ["diagnose", "log.parquet", "--catalogue-out", str(tmp_path / "known")]
    assert main([*command, "--json", "-"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out) == ANSWER
    assert "note: --catalogue-out: no missing term was accepted" in err


def test_in_python_the_plants_own_file_is_not_replaced_either(
    motor: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = motor.parent / "Motor.mo"
    plant = SimpleNamespace(model=model)
    own = SimpleNamespace(task=SimpleNamespace(plant=plant, catalogue={}, cache=None))
    effect = SimpleNamespace(forms=(), name="")
    term = SimpleNamespace(effect=effect, name="drag", formula=lambda: "v", point=None)
    best = SimpleNamespace(term=term)
    learned: Any = SimpleNamespace(before=own, after=own, accepted=True, best=best)
    with pytest.raises(InputError, match="--augmented: would replace the file that is read"):
        Diagnosis({}, own, learned=learned).write_augmented(motor.parent)  # type: ignore[arg-type]
    home = "pneugantry.learn.answer.export"
    monkeypatch.setattr(f"{home}.with_term", lambda *_: SimpleNamespace(model=model))
    monkeypatch.setattr(f"{home}.replace", lambda *_, **__: None)
    with pytest.raises(InputError, match="--catalogue-out: would replace the file that is read"):
        write_catalogue(motor.parent, learned)


# ---- folders of campaigns


@pytest.fixture
def rigs(tmp_path: Path) -> Path:
    for name, index in (("a", "campaign.toml"), ("b", "campaign.toml"), ("c", "plant.toml")):
        (tmp_path / "rigs" / name).mkdir(parents=True)
        (tmp_path / "rigs" / name / index).touch()
    return tmp_path / "rigs"


@pytest.mark.parametrize("option", ["--after", "--html", "--augmented", "--catalogue-out"])
def test_what_is_for_one_campaign_is_refused(option: str, rigs: Path, refused: Refused) -> None:
    assert f"{option}: is for one campaign" in refused(rigs, option, rigs / "new")


@pytest.mark.parametrize("option", ["--fmu", "--controller"])
def test_what_is_for_the_gantry_is_refused_where_another_plant_is(
    option: str, rigs: Path, motor: Path, refused: Refused
) -> None:
    assert f"{option}: is for the gantry; c has a plant" in refused(rigs, option, "given.file")
    with pytest.raises(InputError, match=f"{option}: is for the gantry"):
        diagnose_by_api(motor, **{option.removeprefix("--"): "given.file"})  # type: ignore[arg-type]


def test_fmu_and_controller_reach_each_campaign(
    rigs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The FMU also where the catalogue brings a model of its own."""
    shutil.rmtree(rigs / "c")
    own, known = tmp_path / "own.py", tmp_path / "known"
    shutil.copytree(MOTOR / "effects", known)
    shutil.copy(default_model(), known)
    given: list[Any] = []
    for name, value in (
        ("read_campaign", lambda *_, **__: "campaign"),
        ("with_controller", lambda campaign, file: (campaign, file)),
        ("diagnose", lambda *words, nominal: given.append((words[0], nominal))),
    ):
        monkeypatch.setattr(campaigns, name, value)
    monkeypatch.setattr(campaigns.FmuFile, "read", lambda path: path)
    monkeypatch.setattr(campaigns.Diagnoser, "_told", lambda *_: "{}")
    fmu = tmp_path / "heavier.fmu"
    campaigns.Diagnoser(fmu, known, controller=own)()(rigs / "a")
    ((campaign, nominal),) = given
    assert campaign == ("campaign", own)
    assert (nominal.fmu, nominal.model) == (fmu, known / default_model().name)
