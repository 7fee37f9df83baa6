"""A compiled model as an FMU: description, sources and one binary a platform, byte-identical for
identical input.

Beside `NAME.fmu` goes `NAME.manifest.json`, which says what it was made of and with.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import os
import tempfile
import uuid
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from modelica_fmu.compiled import CompiledModel
from modelica_fmu.description import FmiVersion, model_description
from modelica_fmu.errors import InputError
from modelica_fmu.toolchain import (
    Platform,
    compile_library,
    find_compiler,
    find_platform,
    flags_for,
    glibc_needed,
    host_platform,
)

CSRC = Path(__file__).parent / "csrc"
_LOG = logging.getLogger(__name__)  # INFO: what is being made, for whoever shows progress
_WRAPPERS = {"2.0": "fmi2.c", "3.0": "fmi3.c"}
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the zip format's first date


def package_fmu(
    compiled: CompiledModel,
    fmi: FmiVersion,
    out_path: str | os.PathLike[str],
    platforms: Sequence[str] | None = None,
    *,
    csrc: Path = CSRC,
    provenance: Mapping[str, Any] | None = None,
) -> Path:
    """Writes the FMU and its manifest; returns the FMU's path.

    `platforms`: names of `toolchain.PLATFORMS`, this machine's if None. `csrc`: the folder of the
    solver core and wrappers. `provenance`: entries to add to the manifest, such as the hash of the
    Modelica file.
    """
    out = Path(out_path)
    if fmi not in _WRAPPERS:
        raise InputError(f"unknown FMI version {fmi!r}", field="--fmi", hint="use 2.0 or 3.0")
    targets = [find_platform(name) for name in platforms] if platforms else [host_platform()]
    sources = _sources(compiled, fmi, csrc)
    files = sorted(name for name in sources if name.endswith(".c"))
    token = _token(sources, model_description(compiled, fmi, "", files))
    sources["fmu_config.h"] = _config(compiled, token)
    members = {"modelDescription.xml": model_description(compiled, fmi, token, files)}
    members |= {f"sources/{name}": text.encode() for name, text in sources.items()}
    if fmi == "3.0":
        members["sources/buildDescription.xml"] = _build_description(compiled, files)
    members["documentation/index.html"] = _documentation(compiled, token)
    binaries, compilers = _binaries(compiled, fmi, sources, files, targets, bool(platforms))
    members |= binaries
    manifest = (
        _manifest(compiled, fmi, token, members) | {"compilers": compilers} | dict(provenance or {})
    )
    listed = out.with_suffix(".manifest.json")
    listed.unlink(
        missing_ok=True
    )  # killed in between, the new FMU must not stand beside the old one's manifest
    _write(out, _archive(members))
    _write(listed, json.dumps(manifest, indent=2, sort_keys=True).encode() + b"\n")
    return out


def _sources(compiled: CompiledModel, fmi: str, csrc: Path) -> dict[str, str]:
    """All C but fmu_config.h, by file name: the core and the wrapper of this FMI version, and the
    generated model.
    """
    others = {name for version, name in _WRAPPERS.items() if version != fmi}
    paths = sorted(p for p in csrc.iterdir() if p.suffix in (".c", ".h") and p.name not in others)
    return {p.name: p.read_text(encoding="utf-8") for p in paths} | dict(compiled.sources)


def _token(sources: Mapping[str, str], description: bytes) -> str:
    digest = hashlib.sha256(description)
    for name in sorted(sources):
        digest.update(f"\0{name}\0{sources[name]}".encode())
    return f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"


def _config(compiled: CompiledModel, token: str) -> str:
    nominals = [compiled.variables[state].nominal or 1.0 for state in compiled.states] or [1.0]
    return (
        f"/* What the wrapper needs to know of {compiled.name}; generated. */\n"
        f'#define FMU_TOKEN "{token}"\n'
        f"#define FMU_BUILD UINT64_C(0x{hashlib.sha256(token.encode()).hexdigest()[:16]})\n"
        f"#define FMU_NOMINALS {{{', '.join(repr(abs(float(n))) for n in nominals)}}}\n"
    )


def _build_description(compiled: CompiledModel, files: Sequence[str]) -> bytes:
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = ElementTree.SubElement(
        root, "BuildConfiguration", modelIdentifier=compiled.identifier
    )
    file_set = ElementTree.SubElement(configuration, "SourceFileSet", language="C11")
    for name in files:
        ElementTree.SubElement(file_set, "SourceFile", name=name)
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def _documentation(compiled: CompiledModel, token: str) -> bytes:
    html = ElementTree.Element("html", lang="en")
    head = ElementTree.SubElement(html, "head")
    ElementTree.SubElement(head, "meta", charset="utf-8")
    ElementTree.SubElement(head, "title").text = compiled.name
    body = ElementTree.SubElement(html, "body")
    ElementTree.SubElement(body, "h1").text = compiled.name
    for text in (compiled.description, *compiled.notes, f"Made by {compiled.tool}; build {token}."):
        ElementTree.SubElement(body, "p").text = text
    return (
        b"<!DOCTYPE html>\n"
        + bytes(ElementTree.tostring(html, encoding="utf-8", method="html"))
        + b"\n"
    )


def _binaries(
    compiled: CompiledModel,
    fmi: str,
    sources: Mapping[str, str],
    files: Sequence[str],
    targets: Sequence[Platform],
    portable: bool,
) -> tuple[dict[str, bytes], dict[str, dict[str, object]]]:
    """Zip members and, for the manifest, compiler and flags by platform."""
    binaries: dict[str, bytes] = {}
    compilers: dict[str, dict[str, object]] = {}
    with tempfile.TemporaryDirectory(prefix="fmu-build-") as temporary:
        folder = Path(temporary)
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        for number, target in enumerate(targets, start=1):
            _LOG.info("binary %d of %d, %s", number, len(targets), target.fmi3)
            compiler = find_compiler(target, portable)
            name = f"binaries/{target.folder(fmi)}/{compiled.identifier}{target.extension}"
            binaries[name] = compile_library(compiler, target, folder, files, name).read_bytes()
            made: dict[str, object] = {
                "version": compiler.version,
                "flags": list(flags_for(compiler, target)),
            }
            compilers[target.folder(fmi)] = made | (
                {"glibc": glibc} if (glibc := glibc_needed(binaries[name])) else {}
            )
    return binaries, compilers


def _manifest(
    compiled: CompiledModel, fmi: str, token: str, members: Mapping[str, bytes]
) -> dict[str, object]:
    return {
        "schema": "fmu/1",
        "model": compiled.name,
        "identifier": compiled.identifier,
        "fmi": fmi,
        "token": token,
        "tool": compiled.tool,
        "platforms": sorted(name.split("/")[1] for name in members if name.startswith("binaries/")),
        "sha256": {
            name: hashlib.sha256(data).hexdigest() for name, data in sorted(members.items())
        },
    }


def _archive(members: Mapping[str, bytes]) -> bytes:
    """modelDescription.xml first, the rest by name; fixed dates and modes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(members, key=lambda name: (name != "modelDescription.xml", name)):
            info = zipfile.ZipInfo(name, _EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3
            info.external_attr = 0o644 << 16
            archive.writestr(info, members[name])
    return buffer.getvalue()


def _write(path: Path, data: bytes) -> None:
    """A reader sees the old file or the new one, never a part."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise InputError(
            f"cannot be written ({error.strerror})",
            file=path,
            hint="choose another place with --out",
        ) from None
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
