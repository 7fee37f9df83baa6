"""Finds and runs a C compiler: $CC or cc for this machine, else and for other platforms `python -m
ziglang cc`.
"""

from __future__ import annotations

import functools
import importlib.util
import os
import platform as host
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from modelica_fmu.errors import InputError

# No -ffast-math, no contraction to fused multiply-adds: the same bits wherever IEEE 754 holds.
FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared")


@dataclass(frozen=True)
class Platform:
    """A machine an FMU binary is for; `fmi2` and `fmi3` are its folder names in the two
    standards.
    """

    fmi3: str
    fmi2: str
    extension: str
    zig_target: str

    def folder(self, fmi: str) -> str:
        return self.fmi3 if fmi == "3.0" else self.fmi2


PLATFORMS = (
    Platform("x86_64-linux", "linux64", ".so", "x86_64-linux-gnu.2.17"),
    Platform("aarch64-linux", "aarch64-linux", ".so", "aarch64-linux-gnu.2.17"),
    Platform("x86_64-windows", "win64", ".dll", "x86_64-windows-gnu"),
    Platform("x86_64-darwin", "darwin64", ".dylib", "x86_64-macos"),
    Platform("aarch64-darwin", "aarch64-darwin", ".dylib", "aarch64-macos"),
)


@dataclass(frozen=True)
class Compiler:
    command: tuple[str, ...]
    version: str
    zig: bool


def find_platform(name: str) -> Platform:
    """The platform of an FMI 2.0 or FMI 3.0 name."""
    for known in PLATFORMS:
        if name in (known.fmi2, known.fmi3):
            return known
    names = ", ".join(f"{p.fmi3} ({p.fmi2})" if p.fmi2 != p.fmi3 else p.fmi3 for p in PLATFORMS)
    raise InputError(f"unknown platform {name!r}", field="--platform", hint=f"use one of {names}")


def host_platform() -> Platform:
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        host.machine().lower(), host.machine().lower()
    )
    return find_platform(f"{machine}-{host.system().lower()}")


def fmi_headers() -> Path:
    """The folder of the standards' C headers, which fmpy ships."""
    spec = importlib.util.find_spec("fmpy")  # looked up, not imported
    for location in (spec.submodule_search_locations or ()) if spec else ():
        folder = Path(location) / "c-code"
        if (folder / "fmi3Functions.h").is_file():
            return folder
    raise InputError(
        "the FMI C headers are missing; they come with the fmpy package", hint="pip install fmpy"
    )


def find_compiler(target: Platform, portable: bool = False) -> Compiler:
    """The system compiler if `target` is this machine, else zig; InputError says what to install.

    `portable`: for this machine, too, zig is taken where it is installed and $CC names no compiler:
    its binaries need glibc 2.17 and no newer one, the system compiler's whatever is installed here.
    """
    zig = importlib.util.find_spec("ziglang") is not None
    if target == host_platform() and not (portable and zig and not os.environ.get("CC")):
        command = os.environ.get("CC")
        candidates = [command] if command else ["cc", "gcc", "clang"]
        for candidate in candidates:
            words = tuple(shlex.split(candidate))
            if words and shutil.which(words[0]):
                return Compiler(words, _version(words), zig=False)
        if command:
            raise InputError(
                f"no compiler {command!r}", field="CC", hint="correct or unset the variable CC"
            )
    if zig:
        words = (sys.executable, "-m", "ziglang", "cc")
        return Compiler(words, "zig " + _version(words), zig=True)
    system = (
        ", or install gcc or clang (Debian: apt install gcc)" if target == host_platform() else ""
    )
    raise InputError(f"no C compiler for {target.fmi3}", hint="pip install ziglang" + system)


def glibc_needed(library: bytes) -> str | None:
    """The oldest glibc that a Linux binary runs with, "2.17": the newest version among its
    symbols'. None where it needs none.
    """
    versions = {
        tuple(map(int, v.split(b".")))
        for v in re.findall(rb"\0GLIBC_([0-9]+(?:\.[0-9]+)+)(?=\0)", library)
    }
    return ".".join(map(str, max(versions))) if versions else None


@functools.cache
def _version(words: tuple[str, ...]) -> str:
    result = subprocess.run([*words, "--version"], capture_output=True, text=True, check=False)
    return (
        (result.stdout or result.stderr).strip().splitlines()[0]
        if result.returncode == 0
        else "unknown"
    )


def flags_for(compiler: Compiler, target: Platform) -> tuple[str, ...]:
    flags = FLAGS if target.extension == ".dll" else (*FLAGS, "-fPIC")
    # zig adds debug information, which holds the build's folder and time, unless told not to
    return (*flags, "-g0", "-s", "-target", target.zig_target) if compiler.zig else flags


def own_processor(compiler: Compiler, target: Platform) -> tuple[str, ...]:
    """Flags for code that runs on this machine alone, and faster; none where the compiler or the
    target has no such flag.
    """
    native = target == host_platform() and target.fmi3 == "x86_64-linux" and not compiler.zig
    return ("-march=native", "-mprefer-vector-width=512") if native else ()


@functools.cache
def processor() -> str:
    """What this machine's processor can do, as Linux lists it; "" elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return next((line for line in lines if line.startswith("flags")), "")


def compile_library(
    compiler: Compiler,
    target: Platform,
    folder: Path,
    sources: Sequence[str],
    output: str,
    more: Sequence[str] = (),
) -> Path:
    """Compiles and links `sources` to the shared library `output`; all are names inside `folder`,
    which is left out of it. more: flags.
    """
    command = [
        *compiler.command,
        *flags_for(compiler, target),
        *more,
        "-I",
        str(fmi_headers()),
        "-I",
        ".",
        *sources,
    ]
    command += ["-o", output]
    if target.extension != ".dll":
        command.append("-lm")
    library = folder / output
    library.parent.mkdir(parents=True, exist_ok=True)
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if result.returncode != 0 or not library.is_file():
        message = result.stderr.strip() or result.stdout.strip() or f"exit code {result.returncode}"
        raise InputError(
            f"{compiler.command[-1]} could not compile the model for {target.fmi3}: {message}"
        )
    return library
