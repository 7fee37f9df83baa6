"""FMUs of the shipped model and of its controllers, kept in the user's cache."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from modelica_fmu import (
    PLAIN,
    BuildResult,
    ClassSource,
    Target,
    build_class,
    build_compiled,
    fmu_path,
    source_key,
)
from modelica_fmu.description import FmiVersion
from modelica_fmu.errors import InputError
from pyfmi_runner.cache import cache_folder
from pyfmi_runner.plant import DEFAULT_CLASS

if TYPE_CHECKING:
    from modelica_fmu.compiled import CompiledModel

__all__ = [
    "BuildResult",
    "build_controller_fmu",
    "build_fmu",
    "build_source",
    "cache_folder",
    "default_model",
]

HERE = Path(__file__).resolve().parents[1]  # of the checkout, or site-packages
CONTROLLERS = HERE / "controllers"
EXPORT = Path(__file__).parent / "export"
TOOL = "PneuGantry"  # what the FMUs say made them


def default_model() -> Path:
    """The gantry's Modelica file: in the installed package, or in the checkout's `models/`."""
    packaged = HERE / "pneugantry" / "models" / "PneuGantry.mo"
    return packaged if packaged.is_file() else HERE / "models" / "PneuGantry.mo"


def build_fmu(
    class_name: str = DEFAULT_CLASS,
    model: Path | None = None,
    fmi: FmiVersion = "2.0",
    out: Path | None = None,
    platforms: Sequence[str] | None = None,
    starts: Mapping[str, float] | None = None,
) -> BuildResult:
    """The FMU of a class of `model` (None: the gantry's), in the user's cache unless `out` names a
    folder; see `build_class`.
    """
    source = ClassSource(class_name, model or default_model(), starts or {})
    return build_source(source, Target(fmi, platforms), out)


def build_source(
    source: ClassSource, target: Target = PLAIN, out: Path | None = None
) -> BuildResult:
    """As `build_fmu`, of a class with its libraries."""
    return build_class(source, out or _cached, target, tool=TOOL)


def build_controller_fmu(
    name: str,
    target: Target = PLAIN,
    out: Path | None = None,
    **options: object,
) -> BuildResult:
    """Builds the FMU of a controller of the catalogue, `options` its own (`gains="table_3_7"`).

    Raises InputError for an unknown controller or option, and for one whose parameters or state
    hold arrays.
    """
    from controllers.catalogue import make_controller

    try:
        controller = make_controller(name, **options)
    except (ValueError, TypeError) as error:
        raise InputError(
            str(error),
            field="--controller",
            hint="take a controller that `pneugantry run --help` lists",
        ) from None
    class_name = f"PneuGantry.Controllers.{name}"
    sources = sorted([*CONTROLLERS.glob("*.py"), *EXPORT.glob("*.py")])
    key = source_key(sources, f"{class_name} {controller.params}", target.fmi, target.platforms)

    def compiled() -> CompiledModel:
        from pyfmi_runner.export.controller import compile_controller

        return compile_controller(class_name, controller)

    path = fmu_path(class_name, target.fmi, out or _cached(key))
    return build_compiled(compiled, path, key, target, lambda: {"casadi": version("casadi")})


def _cached(key: str) -> Path:
    """A folder of its own for each key, so that versions of the program do not displace each
    other.
    """
    return cache_folder() / "fmus" / key[:16]
