"""The wheel in a clean environment outside the checkout: built, installed, looked at, used:
`python -m benchmarks.clean_install [--short] [--zig] [--json FILE]`.

What a new user does who has no checkout: `pip install`, `pneugantry demo`, `pneugantry build`, the
fmpy script of the documents. Nothing of the checkout is on the path of the new environment.
"""

from __future__ import annotations

import argparse
import json
import os
import re
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

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("modelica_fmu", "pyfmi_runner", "controllers", "pneugantry")
FMPY_SCRIPT = ROOT / "docs" / "tutorials" / "fmu-in-other-tools.md"

__all__ = ["build_wheel", "main", "top_level"]


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


@dataclass(frozen=True)
class CleanEnvironment:
    """A virtual environment in a folder outside the checkout; commands run in that folder."""

    folder: Path

    @classmethod
    def made(cls, folder: Path) -> CleanEnvironment:
        venv.create(folder / "env", with_pip=True)
        return cls(folder)

    def program(self, name: str) -> str:
        where = "Scripts" if os.name == "nt" else "bin"
        return str(self.folder / "env" / where / name)

    def run(self, name: str, *arguments: str) -> tuple[str, float]:
        """Standard output and wall seconds. Raises RunError where the exit code is not 0."""
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL"))}
        kept |= {"PNEUGANTRY_CACHE": str(self.folder / "cache"), "MPLBACKEND": "agg"}
        began = time.perf_counter()
        done = subprocess.run(
            [self.program(name), *arguments],
            cwd=self.folder,
            env=kept,
            capture_output=True,
            text=True,
            check=False,
        )
        seconds = time.perf_counter() - began
        if done.returncode != 0:
            said = (done.stderr or done.stdout)[-1000:]
            raise RunError(f"{name} {' '.join(arguments)}: exit code {done.returncode}: {said}")
        return done.stdout, seconds


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
    rows = []
    for step in steps:
        said, seconds = environment.run(*step)
        last = said.strip().splitlines()[-1] if said.strip() else ""
        rows.append({"command": " ".join(step), "seconds": seconds, "last_line": last})
        print(f"{seconds:7.2f} s  {' '.join(step)}\n           {last}", flush=True)
    return rows


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.clean_install", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--short", action="store_true", help="without the demo")
    parser.add_argument("--zig", action="store_true", help="install the extra, build for Windows")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write what was found as JSON")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="clean-install-") as temporary:
        folder = Path(temporary)
        try:
            wheel = build_wheel(folder / "dist")
            environment = CleanEnvironment.made(folder)
            extra = "[zig]" if options.zig else ""
            seconds = install(environment, wheel, extra)
            landed = top_level(wheel)
            print(
                f"{wheel.name}: {wheel.stat().st_size / 1e3:.0f} kB; installed in {seconds:.0f} s"
            )
            for name, count in sorted(landed.items()):
                print(f"  site-packages/{name}: {count} files")
            platforms = ["x86_64-linux", "x86_64-windows"] if options.zig else ["x86_64-linux"]
            rows = use(environment, platforms, options.short)
        except RunError as error:
            print(error, file=sys.stderr)
            return 1
    if options.json:
        found = {"schema": "clean_install/1", "landed": landed, "steps": rows}
        options.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
