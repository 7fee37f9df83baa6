"""The gantry's FMU."""

import pytest

from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile


@pytest.fixture(scope="session")
def gantry() -> FmuFile:
    return FmuFile.read(build_fmu().path)
