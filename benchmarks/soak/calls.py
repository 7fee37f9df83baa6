"""The FMU's C under AddressSanitizer and UBSan, its functions called in any order (`calls.c`)."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import zipfile
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError, RunError
from modelica_fmu.toolchain import find_compiler, fmi_headers, host_platform
from pyfmi_runner.fmu import FmuFile

__all__ = ["sanitized_calls"]

FLAGS = (
    "-std=c11",
    "-g",
    "-O0",  # sanitized, an optimised model takes the compiler three times as long
    "-ffp-contract=off",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
)


def sanitized_calls(file: FmuFile, calls: int, seed: int = 1) -> dict[str, Any]:
    """Counts by status of `calls` calls. RunError with the sanitizer's report; InputError where the
    compiler has no sanitizers.
    """
    with tempfile.TemporaryDirectory(prefix="soak-calls-") as temporary:
        folder = Path(temporary)
        with zipfile.ZipFile(file.path) as archive:
            for name in archive.namelist():
                if name.startswith("sources/"):
                    (folder / Path(name).name).write_bytes(archive.read(name))
        shutil.copy(Path(__file__).parent / "calls.c", folder)
        compiler = find_compiler(host_platform())
        files = sorted(p.name for p in folder.glob("*.c"))
        command = [
            *compiler.command,
            *FLAGS,
            "-isystem",
            str(fmi_headers()),
            "-I.",
            *files,
            "-o",
            "calls",
            "-lm",
        ]
        built = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if built.returncode != 0:
            reason = built.stderr.strip().splitlines()[-1]
            raise InputError(
                f"{compiler.command[-1]} builds no sanitized program ({reason})",
                hint="install its sanitizer libraries",
            )
        arguments = ["./calls", str(seed), str(calls), file.description.token]
        done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RunError(f"seed {seed}: exit code {done.returncode}: {done.stderr.strip()[-2000:]}")
    counts: dict[str, Any] = json.loads(done.stdout)
    return counts
