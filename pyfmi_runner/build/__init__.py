"""Modelica → FMU, controller → FMU: compiled and packaged, and built again only when the sources have changed."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from pyfmi_runner.build.description import FmiVersion
from pyfmi_runner.build.toolchain import find_compiler, find_platform, flags_for, host_platform
from pyfmi_runner.errors import InputError

__all__ = ["ROOT", "BuildResult", "build_controller_fmu", "build_fmu", "default_model", "fmu_path"]

ROOT = Path(__file__).resolve().parents[2]
COMPILER = Path(__file__).parent
CONTROLLERS = ROOT / "controllers"


class BuildResult(NamedTuple):
    path: Path
    manifest: Path
    rebuilt: bool


def default_model() -> Path:
    return ROOT / "models" / "PneuGantry.mo"


def fmu_path(class_name: str, fmi: FmiVersion, out: Path) -> Path:
    """File of a class's FMU: "PneuGantry_Gantry.fmu", and "..._fmi3.fmu" for FMI 3.0."""
    suffix = "_fmi3" if fmi == "3.0" else ""
    return out / f"{class_name.replace('.', '_')}{suffix}.fmu"


def build_fmu(
    class_name: str = "PneuGantry.Gantry",
    model: Path | None = None,
    fmi: FmiVersion = "2.0",
    out: Path | None = None,
    platforms: Sequence[str] | None = None,
    force: bool = False,
    starts: Mapping[str, float] | None = None,
) -> BuildResult:
    """Builds the FMU of a Modelica class into the folder `out` (the project's `fmus/`). `starts`: values of parameters in place of the
    model's own.

    It is rebuilt only if the Modelica file, the compiler, its libraries, the C compiler, its flags or the platforms differ from those
    that the manifest beside it names. Raises InputError for unusable Modelica, an unknown parameter or platform and a missing C compiler.
    """
    model = model or default_model()
    path = fmu_path(class_name, fmi, out or ROOT / "fmus")
    manifest = path.with_suffix(".manifest.json")
    of_starts = repr(sorted(starts.items())) if starts else ""
    key = _source_key([model] if model.is_file() else [], class_name + of_starts, fmi, platforms)
    if not force and _fresh(path, manifest, key):
        return BuildResult(path, manifest, rebuilt=False)
    from pyfmi_runner.build.compiler import compile_model  # rumoca and CasADi load only when something is built
    from pyfmi_runner.build.package import package_fmu

    compiled = compile_model(model, class_name, starts)
    provenance = {"source_key": key, "modelica_sha256": _sha256(model.read_bytes()), "modelica_file": model.name,
                  "rumoca": version("rumoca"), "casadi": version("casadi")}  # fmt: skip
    package_fmu(compiled, fmi, path, platforms, provenance=provenance)
    return BuildResult(path, manifest, rebuilt=True)


def build_controller_fmu(
    name: str,
    fmi: FmiVersion = "2.0",
    out: Path | None = None,
    platforms: Sequence[str] | None = None,
    force: bool = False,
    **options: object,
) -> BuildResult:
    """Builds the FMU of a controller of the catalogue, `options` its own (`gains="table_3_7"`), as `build_fmu` does of a class.

    Raises InputError for an unknown controller or option, and for one whose parameters or state hold arrays.
    """
    from controllers.catalogue import make_controller

    try:
        controller = make_controller(name, **options)
    except (ValueError, TypeError) as error:
        raise InputError(str(error), field="--controller", mend="take a controller that `pneugantry run --help` lists") from None
    class_name = f"PneuGantry.Controllers.{name}"
    path = fmu_path(class_name, fmi, out or ROOT / "fmus")
    manifest = path.with_suffix(".manifest.json")
    key = _source_key(sorted(CONTROLLERS.glob("*.py")), f"{class_name} {controller.params}", fmi, platforms)
    if not force and _fresh(path, manifest, key):
        return BuildResult(path, manifest, rebuilt=False)
    from pyfmi_runner.build.controller import compile_controller
    from pyfmi_runner.build.package import package_fmu

    compiled = compile_controller(class_name, controller)
    package_fmu(compiled, fmi, path, platforms, provenance={"source_key": key, "casadi": version("casadi")})
    return BuildResult(path, manifest, rebuilt=True)


def _fresh(path: Path, manifest: Path, key: str) -> bool:
    try:
        made = json.loads(manifest.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(made, dict) and made.get("source_key") == key and zipfile.is_zipfile(path)


def _source_key(models: Sequence[Path], class_name: str, fmi: str, platforms: Sequence[str] | None) -> str:
    """Hash of all that decides what the FMU will be: `models` and the compiler's own files."""
    targets = [find_platform(name) for name in platforms] if platforms else [host_platform()]
    digest = hashlib.sha256(f"{class_name} {fmi} {version('rumoca')} {version('casadi')} {version('fmpy')}".encode())
    for target in targets:
        compiler = find_compiler(target, portable=bool(platforms))
        digest.update(f"{target.fmi3} {compiler.version} {flags_for(compiler, target)}".encode())
    files = sorted(p for p in COMPILER.rglob("*") if p.suffix in (".py", ".c", ".h"))
    for file in [*models, *files]:
        digest.update(f"\0{file.name}\0{_sha256(file.read_bytes())}".encode())
    return digest.hexdigest()


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
