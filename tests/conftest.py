"""What all tests share: a result against its schema, and which tests stay together.

On several cores (`make test`, `--dist loadgroup`) a file is one group, so that what its tests share
is made once. What kills processes or measures time is one group of its own: such tests never run
beside one another. Pages and notebooks share nothing and are dealt out one by one.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

HERE = Path(__file__).parent
SCHEMAS = HERE.parent / "docs" / "reference" / "schemas"
ALONE = (
    "pneugantry/test_kill.py",
    "pneugantry/studies/test_bench.py",
    "pneugantry/studies/test_jobs.py",
    "pneugantry/studies/test_sweep.py",
    "test_wheel.py",
)
SINGLE = ("docs/test_blocks.py", "notebooks/test_notebooks.py")


def _keeps_to_schema(result: dict[str, Any]) -> None:
    """Raises ValidationError where a result is not what the schema that it names says."""
    name = result["schema"].split("/")[0]
    schema = json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8"))
    Draft202012Validator(schema).validate(result)


@pytest.fixture(scope="session")
def keeps_to_schema() -> Callable[[dict[str, Any]], None]:
    return _keeps_to_schema


@pytest.fixture(autouse=True)
def no_line_for_a_stage_that_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a command says on standard error does not depend on how fast this machine is."""
    monkeypatch.setattr("pneugantry.progress.REFRESH", 3600.0)


def group(path: Path) -> str | None:
    """Name of the group of a file's tests; None: each goes by itself."""
    name = path.relative_to(HERE).as_posix()
    if name in SINGLE:
        return None
    return "processes and time" if name in ALONE else name


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not config.pluginmanager.hasplugin("xdist"):
        return
    for item in items:
        name = group(item.path)
        if name is not None and item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(name))
