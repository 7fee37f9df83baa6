"""Which tests stay together when `make test` runs them on several cores (`--dist loadgroup`).

A file is one group, so that what its tests share is made once. What kills processes or measures
time is one group of its own: such tests never run beside one another. Pages and notebooks share
nothing and are dealt out one by one.
"""

from pathlib import Path

import pytest

HERE = Path(__file__).parent
ALONE = (
    "pneugantry/test_kill.py",
    "pneugantry/studies/test_bench.py",
    "pneugantry/studies/test_jobs.py",
    "pneugantry/studies/test_sweep.py",
    "test_wheel.py",
)
SINGLE = ("docs/test_blocks.py", "notebooks/test_notebooks.py")


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
