"""FMUs for the tests of the build: the stub and the real model, in both FMI versions."""

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "stub"))

from stub_model import stub_fmu
from tiny import Tiny, library_of

from pyfmi_runner.build import build_fmu


@cache
def real_fmu(fmi: str) -> Path:
    return build_fmu(fmi=fmi).path


@pytest.fixture(params=["2.0", "3.0"])
def fmi(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def stub(fmi: str) -> Path:
    return stub_fmu(fmi)


@pytest.fixture(params=[stub_fmu, real_fmu], ids=["stub", "real"])
def fmu(
    request: pytest.FixtureRequest,
    fmi: str,
    without_optimisation: Callable[[], AbstractContextManager[None]],
) -> Path:
    """The real one of FMI 2.0 is that of all other tests, so it is there already, optimised."""
    with nullcontext() if fmi == "2.0" else without_optimisation():
        return request.param(fmi)


@pytest.fixture(params=[stub_fmu, real_fmu], ids=["stub", "real"])
def fmu2(request: pytest.FixtureRequest) -> Path:
    return request.param("2.0")


@pytest.fixture
def tiny(tmp_path: Path) -> Callable[..., Tiny]:
    """model(text, name="M"): an instance of a class of a Modelica file, not yet started."""

    def model(text: str, name: str = "M") -> Tiny:
        return library_of(text, tmp_path, name)

    return model
