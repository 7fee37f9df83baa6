"""`pneugantry controller`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from modelica_fmu.files import write_atomically
from pneugantry.options import out_file

HELP = """A controller of your own, to start from.

  pneugantry controller init my.py                         writes one that tracks an edge
  pneugantry run --controller my.py --workpiece straight   runs it, in Python or compiled alike

The file is Python: a kernel of arithmetic, `math.*` and plain loops, its parameters and its
state. Sweeps take it as controller = "my.py", `pneugantry diagnose FOLDER --controller my.py`
runs a rig's own loop again with it."""
TEMPLATE = Path(__file__).parents[1] / "controller_template.py"


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("action", choices=("init",))
    command.add_argument("file", metavar="FILE.py", type=out_file, help="the file to write")
    command.add_argument("--force", action="store_true", help="replace a file")


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    target: Path = options.file
    if target.suffix != ".py":
        raise InputError("is no Python file", file=target, hint="end it in .py")
    if target.exists() and not options.force:
        raise InputError("is there already", file=target, hint="edit it, or give --force")
    text = TEMPLATE.read_text(encoding="utf-8")
    write_atomically(target, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    print(f"controller: {target}; try `pneugantry run --controller {target} --workpiece straight`")
    return {"schema": "controller/1", "file": str(target)}, 0
