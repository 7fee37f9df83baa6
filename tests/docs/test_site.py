"""The documentation site: built strictly, its generated parts those of the code, its citations
there.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs"))
SOURCES = ("modelica_fmu", "pyfmi_runner", "controllers", "pneugantry", "benchmarks", "examples")


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    words = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
    ]  # --quiet would hide warnings from --strict
    done = subprocess.run(
        [*words, "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    commands = (tmp_path / "site" / "reference" / "cli.html").read_text(encoding="utf-8")
    assert "usage: pneugantry rootlocus" in commands
    python = (tmp_path / "site" / "reference" / "python.html").read_text(encoding="utf-8")
    assert "pneugantry.api.diagnosis.diagnose" in python
    assert "generated:" not in commands
    assert not re.search(r'(?:src|href)="https?://[^"]*\.(?:js|css)', commands)  # no other server


def test_every_generated_part_is_made_by_the_code() -> None:
    import hooks

    for name, make in hooks.GENERATED.items():
        assert len(make()) > 100, name
    used = {
        name
        for page in (ROOT / "docs").rglob("*.md")
        for name in re.findall(r"<!-- generated: (\w+) -->", page.read_text(encoding="utf-8"))
    }
    assert used == set(hooks.GENERATED)
    with pytest.raises(KeyError):
        hooks.generated("<!-- generated: nothing -->")


def test_every_command_has_its_json_in_the_reference() -> None:
    page = (ROOT / "docs" / "reference" / "cli.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"^\| `(\w+)` \| `[a-z_]+/\d+` \|", page, re.MULTILINE))
    assert {"build", "run", "replay", "diagnose", "thesis", "benchmark"} <= documented


def test_what_the_code_cites_is_in_the_documents() -> None:
    pages = {path.name for path in (ROOT / "docs").rglob("*.md")}
    cited = set()
    for folder in (*SOURCES, "tests", "models"):
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in (".py", ".mo", ".c", ".h", ".html") and path != Path(__file__):
                text = path.read_text(encoding="utf-8")
                cited |= {(m, path) for m in re.findall(r"(?<![\w/.])docs/[\w/-]+\.md", text)}
                bare = re.findall(r"(?<![\w/.-])(?:plant|gap|cli|thesis_results)\.md", text)
                assert set(bare) <= pages, path
    assert len({name for name, _ in cited}) >= 5
    for name, path in cited:
        assert (ROOT / name).is_file(), (name, path)


def test_no_path_of_one_machine_and_no_lost_picture() -> None:
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"(?<![\w.])/(work|home|root|tmp|usr|Users)/", text), path
    for picture in (ROOT / "docs" / "images").iterdir():
        assert picture.stat().st_size < 200_000, picture
