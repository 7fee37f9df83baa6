"""The wheel in a clean environment outside the checkout: built, installed, looked at, used:
`python -m benchmarks.clean_install [--short] [--zig] [--json FILE]`.

What a new user does who has no checkout: `pip install`, `pneugantry demo`, `pneugantry build`, the
fmpy script of the documents. Nothing of the checkout is on the path of the new environment; with
`--zig` nothing else is either, so that ziglang is the only C compiler, and all five platforms are
built.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import struct
import subprocess
import sys
import tempfile
import time
import venv
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modelica_fmu.errors import RunError
from modelica_fmu.toolchain import PLATFORMS, host_platform

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("modelica_fmu", "pyfmi_runner", "controllers", "pneugantry")
FMPY_SCRIPT = ROOT / "docs" / "tutorials" / "fmu-in-other-tools.md"

ELF, PE, MACH_O = b"\x7fELF", b"MZ", b"\xcf\xfa\xed\xfe"  # how their files begin
MACHINES = {  # the number of the machine in the header of each format
    ELF: {62: "x86_64", 183: "aarch64"},
    PE: {0x8664: "x86_64", 0xAA64: "aarch64"},
    MACH_O: {0x01000007: "x86_64", 0x0100000C: "aarch64"},
}
SYSTEMS = {ELF: "linux", PE: "windows", MACH_O: "darwin"}

__all__ = ["binaries", "build_wheel", "main", "top_level"]


def build_wheel(out: Path) -> Path:
    """The wheel of this checkout, built into `out`. Raises RunError with what the build said."""
    words = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out)]
    done = subprocess.run([*words, str(ROOT)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RunError(f"the wheel could not be built: {(done.stderr or done.stdout)[-1000:]}")
    (wheel,) = out.glob("*.whl")
    return wheel


def top_level(wheel: Path) -> dict[str, int]:
    """What the wheel puts into site-packages: number of files by top-level name."""
    found: dict[str, int] = {}
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            top = name.split("/")[0]
            found[top] = found.get(top, 0) + 1
    return found


def binaries(fmu: Path) -> dict[str, str]:
    """The shared libraries of an FMU: its folder of binaries -> the platform that the header of the
    library in it names, as "x86_64-linux".
    """
    found: dict[str, str] = {}
    with zipfile.ZipFile(fmu) as archive:
        for name in archive.namelist():
            if name.startswith("binaries/") and not name.endswith("/"):
                found[name.split("/")[1]] = _platform(archive.read(name))
    return found


def _platform(library: bytes) -> str:
    """What the header of a shared library says. Raises RunError for another kind of file."""
    for magic, machines in MACHINES.items():
        if library.startswith(magic):
            (offset,) = struct.unpack_from("<I", library, 0x3C)  # of the PE header
            at = {ELF: 18, PE: offset + 4, MACH_O: 4}[magic]
            (machine,) = struct.unpack_from("<I" if magic == MACH_O else "<H", library, at)
            if machine in machines:
                return f"{machines[machine]}-{SYSTEMS[magic]}"
    raise RunError(f"a library of an unknown kind begins with {library[:8].hex()}")


@dataclass(frozen=True)
class CleanEnvironment:
    """A virtual environment in a folder outside the checkout; commands run in that folder.

    alone: PATH holds the environment's own programs and no others.
    """

    folder: Path
    alone: bool = False

    @classmethod
    def made(cls, folder: Path, alone: bool = False) -> CleanEnvironment:
        venv.create(folder / "env", with_pip=True)
        return cls(folder, alone)

    def program(self, name: str) -> str:
        where = "Scripts" if os.name == "nt" else "bin"
        return str(self.folder / "env" / where / name)

    def run(self, name: str, *arguments: str) -> tuple[str, float, float]:
        """Standard output, wall and processor seconds. Raises RunError for an exit code that is not
        0.
        """
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL"))}
        kept |= {"PNEUGANTRY_CACHE": str(self.folder / "cache"), "MPLBACKEND": "agg"}
        if self.alone:
            kept.pop("CC", None)
            kept["PATH"] = str(Path(self.program("python")).parent)
        before, began = os.times(), time.perf_counter()
        done = subprocess.run(
            [self.program(name), *arguments],
            cwd=self.folder,
            env=kept,
            capture_output=True,
            text=True,
            check=False,
        )
        seconds, after = time.perf_counter() - began, os.times()
        if done.returncode != 0:
            said = (done.stderr or done.stdout)[-1000:]
            raise RunError(f"{name} {' '.join(arguments)}: exit code {done.returncode}: {said}")
        return done.stdout, seconds, sum(after[2:4]) - sum(before[2:4])  # of the children


def fmpy_script() -> str:
    """The documents' script that needs fmpy and an FMU, and nothing of ours."""
    blocks = re.findall(r"```python\n(.*?)```", FMPY_SCRIPT.read_text(encoding="utf-8"), re.DOTALL)
    return next(block for block in blocks if "simulate_fmu" in block)


def install(environment: CleanEnvironment, wheel: Path, extra: str) -> float:
    """Seconds of `pip install`, at the versions of requirements.lock."""
    target = f"pneugantry{extra} @ {wheel.as_uri()}"
    constraints = ROOT / "requirements.lock"
    words = ("-m", "pip", "install", "--quiet", "--constraint", str(constraints), target)
    return environment.run("python", *words)[1]


def use(environment: CleanEnvironment, platforms: Sequence[str], short: bool) -> list[Any]:
    """The documented first steps; each command with its seconds."""
    (environment.folder / "in_fmpy.py").write_text(fmpy_script(), encoding="utf-8")
    chosen = [word for name in platforms for word in ("--platform", name)]
    steps = [
        ("pneugantry", "--help"),
        ("pneugantry", "--version"),
        ("pneugantry", "run", "--workpiece", "straight"),
        ("pneugantry", "run", "--workpiece", "straight"),
        ("pneugantry", "build", "--out", "fmus", *chosen),
        ("python", "in_fmpy.py"),
    ]
    if not short:
        steps.append(("pneugantry", "demo"))
    rows: list[dict[str, Any]] = []
    for step in steps:
        said, seconds, processor = environment.run(*step)
        last = said.strip().splitlines()[-1] if said.strip() else ""
        times = {"seconds": seconds, "processor_seconds": processor}
        rows.append({"command": " ".join(step)} | times | {"last_line": last})
        said = f"{seconds:7.2f} s, {processor:.2f} s of a processor  {' '.join(step)}"
        print(f"{said}\n           {last}", flush=True)
        if step[1] == "build":
            (fmu,) = (environment.folder / "fmus").glob("*.fmu")
            rows[-1]["binaries"] = check_binaries(fmu, platforms)
    return rows


def check_binaries(fmu: Path, platforms: Sequence[str]) -> dict[str, str]:
    """The binaries of a built FMU, printed. Raises RunError where they are not those asked for."""
    found = binaries(fmu)
    for folder, platform in found.items():
        print(f"           binaries/{folder}: {platform}")
    if sorted(found.values()) != sorted(platforms):
        raise RunError(f"{fmu.name} holds binaries for {', '.join(found.values()) or 'nothing'}")
    return found


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.clean_install", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--short", action="store_true", help="without the demo")
    parser.add_argument(
        "--zig", action="store_true", help="ziglang as the only compiler, all platforms"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write what was found as JSON")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="clean-install-") as temporary:
        folder = Path(temporary)
        try:
            wheel = build_wheel(folder / "dist")
            environment = CleanEnvironment.made(folder, alone=options.zig)
            extra = "[zig]" if options.zig else ""
            seconds = install(environment, wheel, extra)
            landed = top_level(wheel)
            print(
                f"{wheel.name}: {wheel.stat().st_size / 1e3:.0f} kB; installed in {seconds:.0f} s"
            )
            for name, count in sorted(landed.items()):
                print(f"  site-packages/{name}: {count} files")
            here = [host_platform().fmi3]
            platforms = [p.fmi3 for p in PLATFORMS] if options.zig else here
            rows = use(environment, platforms, options.short)
        except RunError as error:
            print(error, file=sys.stderr)
            return 1
    if options.json:
        found = {"schema": "clean_install/2", "landed": landed, "install_seconds": seconds}
        found["steps"] = rows
        options.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
