"""The gantry's FMU, built once where the tests may write."""

from pathlib import Path

import pytest

from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile


@pytest.fixture(scope="session")
def gantry(tmp_path_factory: pytest.TempPathFactory) -> FmuFile:
    folder: Path = tmp_path_factory.mktemp("gantry")
    return FmuFile.read(build_fmu(out=folder).path)
