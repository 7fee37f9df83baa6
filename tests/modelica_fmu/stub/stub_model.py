"""The stub as the compiler would hand it over, and its FMUs."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from modelica_fmu.compiled import CompiledModel, Variable
from modelica_fmu.package import package_fmu

HERE = Path(__file__).parent


def _parameter(name: str, index: int, start: float, **more) -> Variable:
    settings = {"type": "Real", "variability": "fixed"} | more
    return Variable(
        name,
        "parameter",
        causality="parameter",
        initial="exact",
        index=index,
        start=start,
        **settings,
    )


def _state(name: str, index: int, start: float, unit: str) -> Variable:
    return Variable(
        name,
        "state",
        "Real",
        "local",
        "continuous",
        "exact",
        index,
        start,
        unit,
        nominal=0.5 + index,
    )


def _unknown(name: str, kind: str, index: int, unit: str | None = None, **more) -> Variable:
    settings = {"type": "Real", "causality": "local", "variability": "continuous"} | more
    return Variable(name, kind, initial="calculated", index=index, unit=unit, **settings)


STUB = CompiledModel(
    name="Stub.Ball",
    identifier="Stub_Ball",
    description="A ball on a floor: <every> kind & type of variable",
    variables=(
        Variable("time", "time", "Real", "independent", "continuous", None, 0, unit="s"),
        _parameter("m", 0, 1.0, unit="kg", min=0.1, max=100.0, description="Mass"),
        _parameter("g", 1, 9.81, unit="m/s2"),
        _parameter("k", 2, 0.5, unit="N.s/m", min=0.0, max=10.0, variability="tunable"),
        _parameter("e", 3, 0.7, unit="1", min=0.0, max=1.0, variability="tunable"),
        _parameter("medium", 4, 2.0, type="Enumeration", enumeration="Stub.Medium", min=1, max=2),
        _parameter("n", 5, 1.0, type="Integer", min=1, max=3, variability="tunable"),
        _unknown(
            "weight", "calculated", 6, "N", causality="calculatedParameter", variability="fixed"
        ),
        Variable(
            "f", "input", "Real", "input", "continuous", None, 0, 0.0, "N", min=-50.0, max=50.0
        ),
        Variable("on", "input", "Boolean", "input", "discrete", None, 1, 0.0),
        _state("ball.h", 0, 1.0, "m"),
        _state("ball.v", 1, 0.0, "m/s"),
        _unknown("der(ball.h)", "derivative", 0, "m/s", derivative_of=10),
        _unknown("der(ball.v)", "derivative", 1, "m/s2", derivative_of=11),
        _unknown("y", "algebraic", 0, "m", causality="output"),
        _unknown("a", "algebraic", 1, "m/s2", causality="output"),
        _unknown(
            "bounces",
            "discrete",
            0,
            causality="output",
            variability="discrete",
            type="Integer",
            min=0,
        ),
    ),
    states=(10, 11),
    derivatives=(12, 13),
    outputs=(14, 15, 16),
    dependencies={12: (11,), 13: (8, 9, 11), 14: (8, 10), 15: (8, 9, 11), 16: ()},
    initial_unknowns={7: (1, 2), 12: (11,), 13: (1, 2, 3, 5, 6, 8, 9, 11), 14: (8, 10), 16: ()},
    n_indicators=1,
    enumerations={"Stub.Medium": (("vacuum", ""), ("air", "at rest"))},
    sources={name: (HERE / name).read_text() for name in ("model.c", "core.c")},
    default_stop=3.0,
)


@cache
def stub_fmu(fmi: str) -> Path:
    """The stub's FMU, built once a test run."""
    return package_fmu(STUB, fmi, Path(_folder().name) / fmi / "Stub.fmu")


@cache
def _folder() -> TemporaryDirectory[str]:
    """Where it is built: removed when the process ends."""
    return TemporaryDirectory(prefix="stub-fmu-")
