"""What all tests share: a result against its schema, and which tests stay together.

On several cores (`make test`, `--dist loadgroup`) a file is one group, so that what its tests share
is made once. What kills processes or measures time is one group of its own: such tests never run
beside one another. Pages and notebooks share nothing and are dealt out one by one, last.
"""

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from modelica_fmu import toolchain

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
SMALL = ("examples/", "pneugantry/engine/", "pneugantry/learn/")  # plants are fitted there


def _keeps_to_schema(result: dict[str, Any]) -> None:
    """Raises ValidationError where a result is not what the schema that it names says."""
    name = result["schema"].split("/")[0]
    schema = json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8"))
    Draft202012Validator(schema).validate(result)


@pytest.fixture(scope="session")
def keeps_to_schema() -> Callable[[dict[str, Any]], None]:
    return _keeps_to_schema


@contextmanager
def _compiled_by(*instead: str) -> Iterator[None]:
    """Other flags of the C compiler in the place of those that make it optimise."""
    rest = (flag for flag in toolchain.FLAGS if not flag.startswith("-O"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(toolchain, "FLAGS", (*rest, *instead))
        yield


@pytest.fixture(scope="session")
def without_optimisation() -> Callable[[], AbstractContextManager[None]]:
    """In its context FMUs are compiled without optimisation: where what is tested is the model or
    the files, the C compiler is what takes time. Results are the same to the last bit. A part that
    is built in it is to be run in it, too, for that is when it is compiled.
    """
    return _compiled_by


@pytest.fixture
def unoptimised() -> Iterator[None]:
    """The same for a whole test."""
    with _compiled_by():
        yield


@pytest.fixture(scope="module", autouse=True)
def quickly_compiled(request: pytest.FixtureRequest) -> Iterator[None]:
    """Where small plants are fitted, much of the time is the C compiler's: it optimises less.
    Results are the same to the last bit.
    """
    fits = request.path.relative_to(HERE).as_posix().startswith(SMALL)
    with _compiled_by("-O1") if fits else nullcontext():
        yield


@pytest.fixture(autouse=True)
def no_line_for_a_stage_that_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a command says on standard error does not depend on how fast this machine is."""
    monkeypatch.setattr("pneugantry.progress.REFRESH", 3600.0)


def group(test: str) -> str:
    """What is dealt out whole, by a test's id (FILE::NAME, from the root or from here)."""
    name = test.split("::")[0].removeprefix("tests/")
    if name in SINGLE:
        return test
    return "processes and time" if name in ALONE else name


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Deals out groups. Not by marks: pytest 9.2 drops what xdist 3.8 writes into a test's id, and
    every test went its own way, its file's fixtures made once for each worker.
    """
    if config.getvalue("dist") != "loadgroup":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Groups(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return group(nodeid)

    return Groups(config, log)
