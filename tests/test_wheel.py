"""The wheel: what it puts into site-packages, and that it works where there is no checkout.

`python -m benchmarks.clean_install` does the whole of it in an environment of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from benchmarks.clean_install import PACKAGES, build_wheel, fmpy_script, main, top_level

ROOT = Path(__file__).resolve().parents[1]
GENERATED = {".pyc", ".so"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_wheel(tmp_path_factory.mktemp("dist"))


def test_only_our_packages_land_in_site_packages(wheel: Path) -> None:
    found = top_level(wheel)
    (information,) = (name for name in found if name.endswith(".dist-info"))
    assert set(found) == {*PACKAGES, information}


def test_every_file_of_the_packages_is_in_the_wheel(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        inside = set(archive.namelist())
    ours = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix not in GENERATED
    }
    models = {f"pneugantry/models/{path.name}" for path in (ROOT / "models").glob("*.mo")}
    assert models
    assert ours | models <= inside
    assert {f"{package}/py.typed" for package in PACKAGES} <= inside
    assert any(name.endswith("licenses/LICENSE") for name in inside)


def test_the_unpacked_wheel_builds_its_model_without_a_checkout(
    wheel: Path, tmp_path: Path
) -> None:
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    own = os.environ | {
        "PYTHONPATH": str(tmp_path / "site"),
        "PNEUGANTRY_CACHE": str(tmp_path / "cache"),
    }
    words = [sys.executable, "-P", "-m", "pneugantry", "build", "--class", "PneuGantry.Valve"]
    done = subprocess.run(
        [*words, "--json", "-"], cwd=tmp_path, env=own, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    built = json.loads(done.stdout)
    assert Path(built["fmu"]).is_relative_to(tmp_path / "cache")
    manifest = json.loads(Path(built["manifest"]).read_text(encoding="utf-8"))
    assert manifest["model"] == "PneuGantry.Valve"


def test_the_source_archive_holds_what_the_wheel_is_built_from() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    inside = project["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    assert {f"/{package}" for package in (*PACKAGES, "models")} <= set(inside)
    for name in inside:
        assert (ROOT / name.lstrip("/")).exists(), name


def test_the_documents_script_needs_nothing_of_ours() -> None:
    script = fmpy_script()
    assert "simulate_fmu" in script
    assert not any(f"import {package}" in script for package in PACKAGES)


@pytest.mark.slow
def test_the_wheel_works_in_a_clean_environment(tmp_path: Path) -> None:
    assert main(["--short", "--json", str(tmp_path / "found.json")]) == 0
    steps = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))["steps"]
    (shown,) = (step for step in steps if step["command"] == "pneugantry --help")
    assert shown["processor_seconds"] < 0.5
