"""Results written whole or not at all, without destroying what stands at their path; sources read
only where a read comes to an end.

A regular file is replaced in one step; a link is followed; what is no regular file (a pipe, a
terminal, /dev/stdout) is written through and stays what it is.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from modelica_fmu.errors import InputError

__all__ = [
    "check_folder",
    "check_source",
    "check_target",
    "refuse_replacing",
    "write_atomically",
]

DESCRIPTOR = re.compile(r"/dev/(stdin|stdout|stderr)|(?:/dev/fd|/proc/self/fd)/(\d+)")
STANDARD = {"stdin": 0, "stdout": 1, "stderr": 2}
THROUGH = {stat.S_IFCHR: "device", stat.S_IFIFO: "pipe"}  # written through
REFUSED = {stat.S_IFBLK: "a disk", stat.S_IFSOCK: "a socket", stat.S_IFDIR: "a folder"}
ENDLESS = {stat.S_IFBLK: "a disk", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device"}


def write_atomically(path: str | os.PathLike[str], write: Callable[[Path], object]) -> None:
    """Let `write` fill a hidden file beside `path`, then put it in place in one step; makes the
    folder if need be. Links are followed; pipes and devices get the bytes and stay.

    Raises InputError where the file system refuses, for a folder, a socket and a disk.
    """
    path = Path(path)
    try:
        descriptor, kind = _descriptor(path), _kind(path)
        if descriptor is None and kind in REFUSED:
            raise _refused(path, kind)
        if descriptor is not None or kind in THROUGH:
            _write_through(path, descriptor, write)
        else:
            _replace(Path(os.path.realpath(path)), write)
    except OSError as error:
        raise _unwritable(path, error) from None


def check_source(path: str | os.PathLike[str], pipes: bool = False) -> None:
    """Raises InputError where something stands at `path` that cannot be read to an end: a device as
    /dev/zero, a disk, a socket; and a pipe, unless `pipes`: it is read once, when it is written to.
    Says nothing of what is not there, or a folder.
    """
    path = Path(path)
    try:
        kind = _kind(path)
    except OSError:
        return  # whoever reads it says why not
    found = ENDLESS.get(kind or 0)
    if kind == stat.S_IFIFO and not pipes:
        found = "a pipe"
    if found:
        raise InputError(f"is {found}, expected a file", file=path, hint="name a file")


def check_target(path: str | os.PathLike[str]) -> None:
    """Raises InputError where `write_atomically` could not put a file at `path`: asked before a
    long computation. Leaves nothing behind.
    """
    path = Path(path)
    try:
        kind = _kind(path)
        if _descriptor(path) is not None:
            return
        if kind in REFUSED:
            raise _refused(path, kind)
        if kind is not None and not os.access(path, os.W_OK):
            raise PermissionError(0, "it is write-protected")
        if kind not in THROUGH:
            _try_folder(Path(os.path.realpath(path)).parent)
    except OSError as error:
        raise _unwritable(path, error) from None


def check_folder(path: str | os.PathLike[str]) -> None:
    """Raises InputError where no file can be written into the folder `path`, which need not exist
    yet. Leaves nothing behind.
    """
    try:
        _try_folder(Path(os.path.realpath(path)))
    except OSError as error:
        raise InputError(
            f"no file can be written there ({error.strerror})",
            file=path,
            hint="choose another folder",
        ) from None


def refuse_replacing(
    target: str | os.PathLike[str], read: Iterable[str | os.PathLike[str]], field: str
) -> None:
    """Raises InputError where a result, of an option `field`, would take the place of a file that
    is read.
    """
    if not os.path.isfile(target):
        return
    if any(os.path.isfile(path) and os.path.samefile(path, target) for path in read):
        hint = "choose another place"
        text = "would replace the file that is read"
        raise InputError(text, file=target, field=field, hint=hint)


def _kind(path: Path) -> int | None:
    """Kind of what stands at a path, links followed; None where there is nothing."""
    if "\0" in str(path):
        raise OSError(0, "the path holds a NUL")
    try:
        return stat.S_IFMT(os.stat(path).st_mode)
    except FileNotFoundError:
        return None


def _descriptor(path: Path) -> int | None:
    """The open file that a path like /dev/stdout stands for."""
    match = DESCRIPTOR.fullmatch(os.path.abspath(path))
    if match is None:
        return None
    return STANDARD[match[1]] if match[1] else int(match[2])


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(
        f"cannot be written ({error.strerror})", file=path, hint="choose another place"
    )


def _refused(path: Path, kind: int) -> InputError:
    hint = "name a file in it" if kind == stat.S_IFDIR else "name a file"
    return InputError(f"is {REFUSED[kind]}, expected a file", file=path, hint=hint)


def _try_folder(folder: Path) -> None:
    """Makes and removes a nameless file in a folder, or in the next one above it that exists."""
    while not folder.exists():
        folder = folder.parent
    with tempfile.TemporaryFile(dir=folder):
        pass


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(0, "it is write-protected")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(temporary)
        with contextlib.suppress(FileNotFoundError):
            shutil.copymode(path, temporary)  # the old file's permissions stay
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    finally:
        with contextlib.suppress(OSError):  # it is gone, or its folder is none
            temporary.unlink(missing_ok=True)


def _write_through(path: Path, descriptor: int | None, write: Callable[[Path], object]) -> None:
    """Fills a temporary file, then copies its bytes; without making or cutting what is there."""
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / path.name
        write(whole)
        if descriptor is None:
            target = os.open(path, os.O_WRONLY)
        else:
            sys.stdout.flush()
            sys.stderr.flush()
            target = os.dup(descriptor)
        with os.fdopen(target, "wb") as stream, whole.open("rb") as source:
            shutil.copyfileobj(source, stream)
