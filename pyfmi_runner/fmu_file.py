"""An FMU on disk (FMI 2.0, 3.0): its description, and its content unpacked to a cache.

Files from anywhere come in, so they are read with suspicion. Nothing here runs code of the FMU.
"""

from __future__ import annotations

import hashlib
import io
import os
import platform as host
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal

from modelica_fmu.errors import InputError
from pyfmi_runner.cache import cache_folder
from pyfmi_runner.fmu_description import Description, FmuVariable, parse_description

__all__ = ["FmuFile", "FmuVariable", "Kind"]

Kind = Literal["cs", "me"]

MAX_MEMBERS = 10_000
MAX_BYTES = 2**30  # unpacked
MAX_RATIO = 500  # unpacked to packed, of members over 1 MiB
MAX_DESCRIPTION_BYTES = 64 * 2**20
_REBUILD = "build or download the FMU again"


@dataclass(frozen=True)
class FmuFile:
    """path: as given; sha256: of the file; description: what modelDescription.xml says."""

    path: Path
    sha256: str
    description: Description

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> FmuFile:
        """InputError on anything but a readable FMU of version 2.0 or 3.0."""
        file = Path(path)
        if not os.path.isfile(file):
            raise InputError(
                "no such file",
                file=file,
                hint="build it with `pneugantry build` or correct the path",
            )
        data = file.read_bytes()
        with _archive(file, data) as archive:
            _check_members(file, archive)
            try:
                info = archive.getinfo("modelDescription.xml")
            except KeyError:
                hint = f"this is no FMU; {_REBUILD}"
                raise InputError("modelDescription.xml is missing", file=file, hint=hint) from None
            if info.file_size > MAX_DESCRIPTION_BYTES:
                raise InputError(
                    f"{info.file_size} bytes",
                    file=file,
                    field="modelDescription.xml",
                    hint=_REBUILD,
                )
            description = parse_description(_read(file, archive, info), file)
        return cls(file, hashlib.sha256(data).hexdigest(), description)

    @property
    def variables(self) -> dict[str, FmuVariable]:
        return self.description.variables

    def identifier(self, kind: Kind) -> str:
        """Model identifier of an interface; InputError if the FMU lacks it."""
        identifier = self.description.identifiers.get(kind)
        if identifier is None:
            what = (
                f"the FMU has no {'co-simulation' if kind == 'cs' else 'model exchange'} interface"
            )
            raise InputError(what, file=self.path, hint="build it with both interfaces")
        return identifier

    def library(self, kind: Kind) -> Path:
        """The shared library for this machine, unpacked."""
        folder, extension = _binary_folder(self.description.fmi)
        binaries = self.unpack() / "binaries"
        library = binaries / folder / f"{self.identifier(kind)}{extension}"
        if not library.is_file():
            others = (
                ", ".join(sorted(p.name for p in binaries.iterdir())) if binaries.is_dir() else ""
            )
            raise InputError(
                f"no binary for this machine, binaries/{folder}/{library.name}; the FMU "
                f"has {others or 'none'}",
                file=self.path,
                hint=f"build it with `pneugantry build --platform {folder}`",
            )
        return library

    def unpack(self) -> Path:
        """The FMU's content in the cache, in a folder named by its hash; unpacked once."""
        folder = cache_folder() / "fmu" / self.sha256
        if folder.is_dir():
            return folder
        data = self.path.read_bytes()
        if hashlib.sha256(data).hexdigest() != self.sha256:
            raise InputError(
                "the file has changed since it was read", file=self.path, hint="read it again"
            )
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix="unpack-", dir=folder.parent))
        try:
            with _archive(self.path, data) as archive:
                for info in _check_members(self.path, archive):
                    target = temporary.joinpath(*PurePosixPath(info.filename).parts)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_bytes(_read(self.path, archive, info))
            _publish(temporary, folder)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
        return folder


def _publish(temporary: Path, folder: Path) -> None:
    try:
        temporary.rename(folder)
    except OSError:
        if not folder.is_dir():  # else another process was faster: same content
            raise


def _binary_folder(fmi: str) -> tuple[str, str]:
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        host.machine().lower(), host.machine().lower()
    )
    system = host.system().lower()
    extension = {"windows": ".dll", "darwin": ".dylib"}.get(system, ".so")
    two = {"windows": "win64", "linux": "linux64", "darwin": "darwin64"}
    if fmi == "2.0" and machine == "x86_64" and system in two:
        return two[system], extension
    return f"{machine}-{system}", extension


def _archive(file: Path, data: bytes) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(io.BytesIO(data))
    except (
        Exception
    ) as error:  # BadZipFile, and struct, Unicode or value errors of damaged directories
        raise InputError(
            f"not a zip archive, or a truncated one ({error})", file=file, hint=_REBUILD
        ) from None


def _read(file: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    try:
        return archive.read(info)  # zipfile stops at the declared size and checks the checksum
    except (
        Exception
    ) as error:  # zlib, lzma, struct, EOF, encryption, unknown method: all mean an unreadable file
        raise InputError(
            f"cannot be unpacked ({error})", file=file, field=info.filename, hint=_REBUILD
        ) from None


def _check_members(file: Path, archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """The members that are files; InputError on one that leaves the folder or on an absurd size."""
    members = archive.infolist()
    total = sum(info.file_size for info in members)
    if len(members) > MAX_MEMBERS or total > MAX_BYTES:
        what = (
            f"{len(members)} members of {total} bytes; at most {MAX_MEMBERS} and {MAX_BYTES} "
            f"are read"
        )
        raise InputError(what, file=file, hint=_REBUILD)
    seen: set[str] = set()
    for info in members:
        for fault in _faults(info, seen):
            raise InputError(
                fault, file=file, field=info.filename, hint=f"do not trust this file; {_REBUILD}"
            )
        seen.add(info.filename)
    return [info for info in members if not info.is_dir()]


def _faults(info: zipfile.ZipInfo, seen: set[str]) -> Iterator[str]:
    name = info.orig_filename
    parts = PurePosixPath(name).parts
    if (
        not parts
        or name.startswith("/")
        or ".." in parts
        or "\\" in name
        or ":" in name
        or "\0" in name
    ):
        yield "this path leaves the folder it is unpacked to"
    if stat.S_ISLNK(info.external_attr >> 16):
        yield "symbolic links are refused"
    if info.filename in seen:
        yield "this path occurs twice"
    if info.file_size > 2**20 and info.file_size > MAX_RATIO * max(info.compress_size, 1):
        yield f"{info.file_size} bytes packed into {info.compress_size} bytes"
