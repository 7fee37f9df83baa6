"""README.md stays short, and its links and pictures are there. Its blocks run in tests/docs."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

from pneugantry.cli import COMMANDS
from pyfmi_runner.campaign import setup_from
from pyfmi_runner.log import COLUMNS
from pyfmi_runner.scenario import parse_toml, scenario_from

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(page: str, title: str, folder: Path) -> Path:
    """A titled block of a page, written into a folder."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    found = re.search(rf'```\w+ title="{re.escape(title)}"\n(.*?)```', text, re.DOTALL)
    assert found is not None
    (folder / title).write_text(found[1], encoding="utf-8")
    return folder / title


def file_map_module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("file_map", ROOT / "docs" / "file_map.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_it_is_at_most_eight_kilobytes() -> None:
    assert len(README.encode()) <= 8192


def test_its_commands_are_those_of_the_command_line() -> None:
    rows = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| [^|]+ \|$", README, re.MULTILINE)
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    assert set(named) <= set(COMMANDS)
    assert len(named) >= 10


def test_pictures_and_links_are_there() -> None:
    for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"):
        for target in re.findall(
            r"\]\((?!http)([^)#]+)", (ROOT / name).read_text(encoding="utf-8")
        ):
            assert (ROOT / target).is_file(), (name, target)


def test_the_scenario_and_the_campaign_of_the_documents_are_ones(tmp_path: Path) -> None:
    scenario = parse_toml(block("how-to/scenarios.md", "mine.toml", tmp_path))
    assert scenario_from(scenario).timing.delay == 0.0015
    campaign = parse_toml(block("reference/logs.md", "campaign.toml", tmp_path))
    for table in campaign["log"].values():
        assert setup_from(table).workpiece == "curved"


def test_the_columns_of_the_documents_are_those_of_a_log() -> None:
    page = (ROOT / "docs" / "reference" / "logs.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \|$", page, re.MULTILINE)
    assert [(name, COLUMNS[name].unit, COLUMNS[name].sign) for name in COLUMNS] == rows


def test_every_module_says_in_a_sentence_what_it_is() -> None:
    module = file_map_module()
    for package in module.PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            if path.read_text(encoding="utf-8").strip():
                assert module.summary(path), path
