"""A new user's path from a fresh clone, timed: environment, plot, a log of their own, a plant of
their own, own controller, own effect: `python -m benchmarks.new_user`.

Every step is what README.md, tutorials and notebooks of the clone say: their commands, their
snippets. Two things stand in for the user: a recorder (RECORDER: other names, units, decimal mark
and rate) and the hand that fills in the set-up (HAND).
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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from modelica_fmu.errors import RunError

ROOT = Path(__file__).resolve().parents[1]

VERDICT = ("verdict:", "cause:", "gap of")
RECORDER = '''"""Every second row of a log as another recorder writes it: 500 Hz, mm and ms."""
import pandas as pd

log = pd.read_parquet("out/late.parquet").iloc[::2]
names = {"Xpos_mm": "x", "Zpos_mm": "z", "Xspd_mm_s": "v_x", "Zspd_mm_s": "v_z"}
names |= {"Fx": "f_x", "Fz": "f_z", "Fcyl_x": "f_ax", "Fcyl_z": "f_az"}
table = pd.DataFrame({"Zeit_ms": 1e3 * log["time"], "VentilX": log["u_x"], "VentilZ": log["u_z"]})
for name, column in names.items():
    table[name] = log[column] * (1e3 if "_mm" in name else 1.0)
table.to_csv("rig.csv", sep=";", decimal=",", index=False)
'''
HAND = '''"""What its owner knows of the rig, put into the template of `pneugantry log init`."""
from pathlib import Path

path = Path("rig.toml")
text = path.read_text(encoding="utf-8").replace('workpiece = "?"', 'workpiece = "curved"')
text = text.replace("clamped = []", 'clamped = ["x until contour"]')
text = text.replace("# standoff = 0.04", "standoff = 0.09")
for key in ("phases", "approach_command", "f_nd", "v_td", "controller"):
    text = text.replace(f"# {key} =", f"{key} =")
path.write_text(text, encoding="utf-8")
'''

__all__ = ["Step", "main", "steps"]


@dataclass(frozen=True)
class Step:
    """A command in the clone; `files`: name -> text, written before it; `shown`: how the lines
    begin that are printed of what it says.
    """

    name: str
    command: tuple[str, ...]
    files: Mapping[str, str] = field(default_factory=dict)
    shown: tuple[str, ...] = ()


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
    yield from _own_log(clone)
    yield from _own_plant(clone)
    yield Step(
        "own controller",
        ("pneugantry", "run", "--workpiece", "straight", "--controller", "straight_pi.py"),
        {"straight_pi.py": controller[1]},
    )
    yield Step(
        "own effect",
        ("python", "my_effect.py"),
        {"my_effect.py": _effect(clone / "notebooks" / "own_controller_and_effect.ipynb")},
    )
    yield Step("plot again, nothing to build or compile anew", tuple(shlex.split(plot[1])))


def _own_log(clone: Path) -> Iterator[Step]:
    """A log with other columns and another rate, by the tutorial and `Use a log of your own`."""
    rig = (clone / "docs" / "tutorials" / "diagnose-a-rig.md").read_text(encoding="utf-8")
    page = (clone / "docs" / "how-to" / "import-a-log.md").read_text(encoding="utf-8")
    recorded = re.search(r"^(pneugantry run .*--out out/late.parquet)$", rig, re.MULTILINE)
    found = re.findall(r"^(pneugantry (?:log|diagnose) [^#\n]*)", page, re.MULTILINE)
    if recorded is None or len(found) != 3:
        raise RunError("the tutorial records no out/late.parquet, or the how-to has not 3 commands")
    init, check, diagnose = (tuple(shlex.split(line)) for line in found)
    yield Step("own log: on the rig", tuple(shlex.split(recorded[1])))
    yield Step("own log: its recorder", ("python", "recorder.py"), {"recorder.py": RECORDER})
    yield Step("own log: template", init)
    yield Step("own log: filled in", ("python", "hand.py"), {"hand.py": HAND})
    yield Step("own log: check", check)
    yield Step("own log: first diagnosis", diagnose, shown=VERDICT)


def _own_plant(clone: Path) -> Iterator[Step]:
    """The blocks of `My own plant` written into a folder, with the example's logs."""
    page = (clone / "docs" / "tutorials" / "my-own-plant.md").read_text(encoding="utf-8")
    block = r"<!-- test: same as examples/motor/(\S+) -->\n```\w+\n(.*?)```"
    files = {f"mine/{name}": text for name, text in re.findall(block, page, re.DOTALL)}
    for log in (clone / "examples" / "motor" / "data").glob("*.csv"):
        files[f"mine/data/{log.name}"] = log.read_text(encoding="utf-8")
    model = ("--model", "mine/Motor.mo", "--class", "Motor.Axis", "--out", "out")
    yield Step("own plant: model", ("pneugantry", "build", *model), files)
    diagnose = ("pneugantry", "diagnose", "mine/plant.toml")
    yield Step("own plant: first diagnosis", diagnose, shown=VERDICT)


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


def timed(step: Step, folder: Path) -> tuple[float, float, list[str]]:
    """Wall and processor seconds of a step, and its lines that are shown. Raises RunError with the
    end of what it said.
    """
    for name, text in step.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
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
    processor = sum(after[2:4]) - sum(before[2:4])  # of the children, user and system
    shown = [
        line for line in done.stdout.splitlines() if step.shown and line.startswith(step.shown)
    ]
    return seconds, processor, shown


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
                seconds, cpu, shown = timed(step, clone if clone.is_dir() else Path(temporary))
            except RunError as error:
                print(error, file=sys.stderr)
                return 1
            if step.name == "clone":
                path = list(steps(clone))
            row = {"step": step.name, "seconds": seconds, "processor_seconds": cpu}
            rows.append(row | ({"said": shown} if shown else {}))
            words = " ".join(step.command).replace(options.source, "URL").replace(f" {clone}", "")
            print(f"| {step.name} | `{words}` | {seconds:.1f} | {cpu:.1f} |", flush=True)
            for line in shown:
                print(f"| | {line} | | |", flush=True)
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
