"""Modelica → FMU: compiled and packaged, and built again only when the sources have changed."""

from __future__ import annotations

import functools
import hashlib
import json
import logging
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from modelica_fmu.description import FmiVersion
from modelica_fmu.toolchain import find_compiler, find_platform, flags_for, host_platform

if TYPE_CHECKING:
    from modelica_fmu.compiled import CompiledModel

__all__ = [
    "PLAIN",
    "BuildResult",
    "ClassSource",
    "Target",
    "build_class",
    "build_compiled",
    "fmu_path",
    "source_key",
]

COMPILER = Path(__file__).parent
_LOG = logging.getLogger(__name__)  # INFO: what is being made, for whoever shows progress


class BuildResult(NamedTuple):
    path: Path
    manifest: Path
    rebuilt: bool


@dataclass(frozen=True)
class ClassSource:
    """A Modelica class and what it is compiled from.

    model: its file; None: it is looked up in the libraries. starts: values of parameters in place
    of the model's own. libraries: package folders or files in which classes are looked up, those of
    MODELICAPATH behind them.
    """

    name: str
    model: Path | None
    starts: Mapping[str, float] = field(default_factory=dict)
    libraries: Sequence[Path] = ()


@dataclass(frozen=True)
class Target:
    """What an FMU is built for. platforms: their names, None for this machine alone; force: it is
    built anew even where it is up to date.
    """

    fmi: FmiVersion = "2.0"
    platforms: Sequence[str] | None = None
    force: bool = False


PLAIN = Target()  # FMI 2.0, for this machine, kept where it is up to date


def fmu_path(class_name: str, fmi: FmiVersion, out: Path) -> Path:
    """File of a class's FMU: "Drive_Motor.fmu", and "..._fmi3.fmu" for FMI 3.0."""
    suffix = "_fmi3" if fmi == "3.0" else ""
    return out / f"{class_name.replace('.', '_')}{suffix}.fmu"


def build_class(
    source: ClassSource,
    out: Path | Callable[[str], Path],
    target: Target = PLAIN,
    tool: str = "modelica_fmu",
) -> BuildResult:
    """Builds the FMU of a Modelica class into the folder `out`, or `out(source_key)`.

    tool: what the FMU says made it. It is rebuilt only if a Modelica file that was read, the
    compiler, its libraries, the C compiler, its flags or the platforms differ from those that the
    manifest beside it names. Raises InputError for unusable Modelica, an unknown parameter or
    platform and a missing C compiler.
    """
    model = source.model
    of_starts = repr(sorted(source.starts.items())) if source.starts else ""
    where = "".join(f" {Path(folder).resolve()}" for folder in source.libraries)
    files = [model] if model is not None and model.is_file() else []
    key = source_key(files, source.name + of_starts + where, target.fmi, target.platforms)
    read: list[Path] = []

    def compiled() -> CompiledModel:
        from modelica_fmu.compiler import compile_model  # CasADi loads slowly

        made = compile_model(model, source.name, source.starts, source.libraries)
        read.extend(made.files)
        return replace(made, tool=tool)

    def provenance() -> dict[str, Any]:
        found: dict[str, Any] = {"casadi": version("casadi")}
        if model is not None:
            found |= {
                "modelica_sha256": _sha256(model.read_bytes()),
                "modelica_file": model.name,
            }
        others = [file for file in read if model is None or not file.samefile(model)]
        if others:
            hashes = {str(f.resolve()): _sha256(f.read_bytes()) for f in sorted(others)}
            found["library_files"] = hashes
        return found

    folder = out(key) if callable(out) else out
    return build_compiled(
        compiled, fmu_path(source.name, target.fmi, folder), key, target, provenance
    )


def build_compiled(
    compiled: Callable[[], CompiledModel],
    path: Path,
    key: str,
    target: Target,
    provenance: Callable[[], Mapping[str, Any]],
) -> BuildResult:
    """Packages what `compiled()` returns at `path`, unless the manifest there has the same key."""
    manifest = path.with_suffix(".manifest.json")
    if not target.force and _fresh(path, manifest, key):
        return BuildResult(path, manifest, rebuilt=False)
    from modelica_fmu.package import package_fmu

    _LOG.info("equations of %s", path.stem)
    made = compiled()
    said = {"source_key": key, **provenance()}
    package_fmu(made, target.fmi, path, target.platforms, provenance=said)
    return BuildResult(path, manifest, rebuilt=True)


def source_key(models: Sequence[Path], what: str, fmi: str, platforms: Sequence[str] | None) -> str:
    """Hash of all that decides what the FMU will be: `models` and the compiler's own files."""
    targets = [find_platform(name) for name in platforms] if platforms else [host_platform()]
    digest = hashlib.sha256(f"{what} {fmi}".encode())
    for target in targets:
        compiler = find_compiler(target, portable=bool(platforms))
        digest.update(f"{target.fmi3} {compiler.version} {flags_for(compiler, target)}".encode())
    digest.update("".join(map(_told, models)).encode())
    digest.update(_own_files().encode())
    return digest.hexdigest()


@functools.cache
def _own_files() -> str:
    """The compiler's own files and what it is built on: a process has loaded them."""
    files = (p for p in COMPILER.rglob("*") if p.suffix in (".py", ".c", ".h"))
    return f"{version('casadi')} {version('fmpy')}" + "".join(map(_told, sorted(files)))


def _told(file: Path) -> str:
    return f"\0{file.name}\0{_sha256(file.read_bytes())}"


def _fresh(path: Path, manifest: Path, key: str) -> bool:
    try:
        made = json.loads(manifest.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    if not isinstance(made, dict) or made.get("source_key") != key or not zipfile.is_zipfile(path):
        return False
    files = made.get("library_files", {})
    return all(Path(f).is_file() and _sha256(Path(f).read_bytes()) == h for f, h in files.items())


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
