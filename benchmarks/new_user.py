"""A new user's path from a fresh clone, timed: environment, plot, own controller, own effect:
`python -m benchmarks.new_user`.

Every step is what README.md, tutorials and notebooks of the clone say: their commands, their
snippets, nothing of our own.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modelica_fmu.errors import RunError

ROOT = Path(__file__).resolve().parents[1]

__all__ = ["Step", "main", "steps"]


@dataclass(frozen=True)
class Step:
    """A command in the clone; `script`: a file that is written before it."""

    name: str
    command: tuple[str, ...]
    script: tuple[str, str] | None = None  # name, text


def steps(clone: Path) -> Iterator[Step]:
    """What follows the clone, as its README, tutorials and notebooks have it."""
    readme = (clone / "README.md").read_text(encoding="utf-8")
    plot = re.search(r"^(pneugantry run .*--plot .*)$", readme, re.MULTILINE)
    page = (clone / "docs" / "tutorials" / "my-own-controller.md").read_text(encoding="utf-8")
    controller = re.search(r'```python title="straight_pi.py"\n(.*?)```', page, re.DOTALL)
    if plot is None or controller is None:
        raise RunError("README.md names no command with --plot, or the tutorial no controller")
    yield Step("environment", ("make", ".venv/.ready"))
    yield Step("first plot", tuple(shlex.split(plot[1])))
    yield Step(
        "first own controller",
        ("pneugantry", "run", "--workpiece", "straight", "--controller", "straight_pi.py"),
        ("straight_pi.py", controller[1]),
    )
    yield Step(
        "first own effect",
        ("python", "my_effect.py"),
        ("my_effect.py", _effect(clone / "notebooks" / "own_controller_and_effect.ipynb")),
    )
    yield Step("same again, nothing to build or compile anew", tuple(shlex.split(plot[1])))


def _effect(notebook: Path) -> str:
    """The notebook's first cell, which imports, and those below its heading on effects."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    heading = next(k for k, cell in enumerate(cells) if "## An effect" in "".join(cell["source"]))
    code = [
        cell
        for k, cell in enumerate(cells)
        if cell["cell_type"] == "code" and (k < 2 or k > heading)
    ]
    return "\n".join("".join(cell["source"]) for cell in code) + "\n"


def timed(step: Step, folder: Path) -> tuple[float, float]:
    """Wall and processor seconds of a step. Raises RunError with the end of what it said."""
    if step.script is not None:
        (folder / step.script[0]).write_text(step.script[1], encoding="utf-8")
    path = os.pathsep.join([str(folder / ".venv" / "bin"), os.environ["PATH"]])
    own = {
        k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV", "PYTHONHOME")
    }
    own |= {"PATH": path, "MPLBACKEND": "agg", "PNEUGANTRY_CACHE": str(folder / ".cache")}
    before, start = os.times(), time.perf_counter()
    try:
        done = subprocess.run(
            step.command, cwd=folder, env=own, capture_output=True, text=True, check=False
        )
    except OSError as error:
        raise RunError(f"{step.name}: {step.command[0]}: {error.strerror}") from None
    seconds, after = time.perf_counter() - start, os.times()
    if done.returncode != 0:
        raise RunError(
            f"{step.name}: exit code {done.returncode}: {(done.stderr or done.stdout)[-1000:]}"
        )
    return (
        seconds,
        after.children_user + after.children_system - before.children_user - before.children_system,
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.new_user", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--source",
        default=str(ROOT),
        metavar="URL",
        help="what is cloned (default: this repository, as committed)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table as JSON")
    options = parser.parse_args(arguments)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="new-user-") as temporary:
        clone = Path(temporary) / "clone"
        print("| step | command | seconds | processor seconds |\n|---|---|---|---|")
        path = [Step("clone", ("git", "clone", "--quiet", options.source, str(clone)))]
        while path:
            step = path.pop(0)
            try:
                seconds, cpu = timed(step, clone if clone.is_dir() else Path(temporary))
            except RunError as error:
                print(error, file=sys.stderr)
                return 1
            if step.name == "clone":
                path = list(steps(clone))
            rows.append({"step": step.name, "seconds": seconds, "processor_seconds": cpu})
            words = " ".join(step.command).replace(options.source, "URL").replace(f" {clone}", "")
            print(f"| {step.name} | `{words}` | {seconds:.1f} | {cpu:.1f} |", flush=True)
        print(
            f"| all | | {sum(r['seconds'] for r in rows):.0f} | "
            f"{sum(r['processor_seconds'] for r in rows):.0f} |"
        )
    if options.json:
        options.json.write_text(
            json.dumps({"schema": "new_user/1", "steps": rows}, indent=2) + "\n", encoding="utf-8"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
