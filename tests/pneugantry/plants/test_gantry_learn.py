"""A gantry whose equations lack a term: learnt from a campaign, written out, known on the next."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from pneugantry.blind.sets import SETS, write_case
from pneugantry.cli import main
from pneugantry.learn.answer.export import effects_toml
from pneugantry.learn.equations.points import Point
from pneugantry.learn.equations.sources import components_of, equations_of
from pneugantry.learn.screening.regressors import Regressor
from pneugantry.learn.terms.forms import FORMS
from pneugantry.learn.terms.term import Term, with_term
from pneugantry.plants.gantry.catalogue import catalogue_of, check_names, model_of
from pneugantry.plants.gantry.describe import plant_of
from pneugantry.truth.case import CaseSet
from pyfmi_runner.build import build_fmu, default_model
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.plant import DEFAULT_CLASS

LEARN, NEXT = 1023, 1047  # quadratic drag of x at the middle severity; seeds of development


@pytest.mark.usefixtures("unoptimised")
def test_a_catalogue_s_model_has_the_parameters_that_its_effects_name(tmp_path: Path) -> None:
    model = default_model()
    assert ("PneuGantry", "Cylinder") in components_of(model, DEFAULT_CLASS)["axis_x"]
    balance = next(e for e in equations_of(model) if e.left == "m*a_free")
    point = Point("axis_x", balance)
    assert point.balance
    drag = next(f for f in FORMS if f.name == "signed square")
    term = Term(point, Regressor("axis_x", "v"), drag, (-100.0,), (100.0,), "friction_x")
    written = with_term(plant_of(), term, tmp_path).model
    known = tmp_path / "known"
    known.mkdir()
    assert model_of(known) is None
    assert model_of(None) is None
    (known / model.name).write_bytes(written.read_bytes())
    effect = replace(term.effect, name="drag", forms=(replace(term.effect.forms[0], settings={}),))
    (known / "effects.toml").write_text(effects_toml([effect]), encoding="utf-8")
    own = model_of(known)
    assert own is not None
    fmu = FmuFile.read(build_fmu(model=own).path)
    check_names(catalogue_of(known), fmu)
    assert fmu.variables[f"axis_x.{point.name}.p1"].start == 0.0


@pytest.mark.slow  # 4 CPU min
def test_drag_of_a_gantry_is_learnt_and_known_on_the_next_rig(
    tmp_path: Path, keeps_to_schema: Callable[[dict[str, Any]], None]
) -> None:
    case_set = cast(CaseSet, SETS["unknown12"])
    first, other = (write_case(tmp_path, case_set, seed) for seed in (LEARN, NEXT))
    truth = json.loads((first / "truth.json").read_text(encoding="utf-8"))["causes"][0]
    assert (truth["effect"], truth["axis"]) == ("quadratic_drag", "x")
    out, known, page = tmp_path / "out", tmp_path / "known", tmp_path / "page.html"
    files = ("--json", str(tmp_path / "found.json"), "--html", str(page))
    written = ("--augmented", str(out), "--catalogue-out", str(known))
    assert main(["diagnose", str(first), *files, *written]) == 0
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    keeps_to_schema(found)
    learned = found["learned"]
    assert learned["accepted"], learned["why"]
    term, size = learned["term"], -truth["parameters"]["coefficient"]
    assert (term["block"], term["regressor"]) == ("friction_x", "axis_x.v")
    at, value = (np.array(term["curve"][k]) for k in ("at", "value"))
    exact = size * at * np.abs(at)
    assert value == pytest.approx(exact, abs=0.05 * np.ptp(exact))
    assert learned["gap"]["shrink"] > 0.99
    assert term["formula"] in page.read_text(encoding="utf-8")
    assert "block Residual_" in (out / default_model().name).read_text(encoding="utf-8")
    fmu = FmuFile.read(out / "AugmentedGantry.fmu")
    (name, fitted), *_ = term["parameters"].items()
    assert fmu.variables[name].start == pytest.approx(fitted["value"], rel=0.05)

    again = ("--catalogue", str(known), "--no-learn", "--json", str(tmp_path / "next.json"))
    assert main(["diagnose", str(other), *again]) == 0
    next_one = json.loads((tmp_path / "next.json").read_text(encoding="utf-8"))
    assert next_one["verdict"] == "identified"
    assert next_one["causes"][0]["effect"].startswith("learnt_")
