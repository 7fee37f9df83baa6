"""What a diagnosis runs, compiled ahead of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from test_search import CATALOGUE, PERIOD, SIGMA, parts, plant, record

from modelica_fmu.toolchain import host_platform
from pneugantry.engine.parts import compile_parts
from pneugantry.engine.plant import Data, Plant
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import run
from pneugantry.engine.task import Task
from pneugantry.engine.views.build import build_views
from pneugantry.engine.views.model_parts import structure_of
from pneugantry.plants.gantry.any_campaign import any_campaign
from pneugantry.plants.gantry.describe import data_of
from pneugantry.truth.setups import campaign_setups
from pyfmi_runner.campaign import LogSetup
from pyfmi_runner.plant import plant_parameters

__all__ = ["parts", "plant"]  # fixtures


def test_a_diagnosis_compiles_nothing_that_was_made_ahead(plant: Plant, tmp_path: Path) -> None:
    rules, few = Rules(), {k: CATALOGUE[k] for k in ("drag", "leak", "current_bias")}
    views = build_views(plant, list(SIGMA), tmp_path, PERIOD, rules)
    data = Data((record("one", 1, drag=2.0), record("two", 2, drag=2.0)), record("held", 3))
    task = Task(plant, views, data, few, tmp_path)
    made = compile_parts(task, rules)
    library = f"*/part{host_platform().extension}"
    libraries = sorted(tmp_path.glob(library))
    assert made == len(libraries) > len(few)
    assert compile_parts(task, rules) == 0
    again = replace(task, views=build_views(plant, list(SIGMA), tmp_path, PERIOD, rules))
    assert run(again, rules).diagnosis.causes[0].key == "drag"
    assert sorted(tmp_path.glob(library)) == libraries


def test_a_structure_that_a_stop_tore_is_found_again(plant: Plant, tmp_path: Path) -> None:
    whole = structure_of(plant, tmp_path)
    (file,) = tmp_path.iterdir()
    text = file.read_text(encoding="utf-8")
    for torn in (text[: len(text) // 2], "", "{}", "[1]"):
        file.write_text(torn, encoding="utf-8")
        assert structure_of(plant, tmp_path) == whole
        assert file.read_text(encoding="utf-8") == text
    assert list(tmp_path.iterdir()) == [file]


def test_the_parts_of_the_gantry_are_those_of_the_usual_experiments() -> None:
    """A parameter that logs set is open in the parts of all of them."""
    usual = {
        name
        for setup in campaign_setups().values()
        for name in plant_parameters(
            LogSetup(start_x=setup.start[0], start_z=setup.start[1], workpiece=setup.workpiece)
        )
    }
    fitted = data_of(any_campaign(), Rules()).fitted
    assert {name for record in fitted for name in record.parameters} == usual
