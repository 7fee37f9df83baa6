"""The command line: `pneugantry COMMAND`. One file per command under `commands/`; here parsing,
exit codes and JSON.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from typing import Any, NoReturn

from modelica_fmu.errors import InputError, RunError
from pyfmi_runner.log import write_atomically

# each a module of `commands` with HELP, add_arguments, execute
COMMANDS = (
    "demo",
    "build",
    "run",
    "replay",
    "diagnose",
    "blind",
    "identify",
    "linearize",
    "rootlocus",
    "thesis",
    "sweep",
    "bench",
    "completion",
)


class OneLineParser(argparse.ArgumentParser):
    """A wrong option is one line on standard error, as all unusable input is; the options are in
    --help.
    """

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {' '.join(message.split())}; see {self.prog} --help\n")


def parser() -> argparse.ArgumentParser:
    top = OneLineParser(
        prog="pneugantry",
        description="Pneumatic gantry robot: Modelica model, FMU, closed-loop co-simulation, "
        "diagnosis of the sim-to-real gap.",
        epilog="Exit codes: 0 done, 1 a failed check or a run that could not finish, 2 unusable "
        "input.",
    )
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        module = importlib.import_module(f"pneugantry.commands.{name}")
        text = module.HELP.replace("%", "%%")  # argparse formats it
        summary = text.strip().splitlines()[0]
        command = commands.add_parser(
            name,
            help=summary,
            description=text,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add_argument(
            "--json", metavar="FILE", help="write the result as JSON, - for standard output"
        )
        module.add_arguments(command)
        command.set_defaults(execute=module.execute)
    return top


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; returns its exit code."""
    try:
        options = parser().parse_args(arguments)
    except SystemExit as end:  # --help, or a wrong option
        return int(end.code or 0)
    to_stdout = options.json == "-"
    stdout = sys.stdout
    try:
        if to_stdout:
            sys.stdout = sys.stderr  # what a command prints for people stays out of the JSON
        result, code = options.execute(options)
        if options.json:
            _write_json(result, options.json, stdout)
        return int(code)
    except InputError as error:
        print(f"pneugantry: {error}", file=sys.stderr)
        return 2
    except RunError as error:
        print(f"pneugantry: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("pneugantry: cancelled", file=sys.stderr)
        return 1
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 1
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(
            f"pneugantry: {where}{error.strerror or error}; check the path, its "
            f"permissions and the space left",
            file=sys.stderr,
        )
        return 2
    finally:
        sys.stdout = stdout


def _write_json(result: dict[str, Any], target: str, stdout: Any) -> None:
    text = json.dumps(_plain(result), indent=2, allow_nan=False) + "\n"
    if target == "-":
        stdout.write(text)
        stdout.flush()
        return
    write_atomically(target, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def _plain(value: Any) -> Any:
    """JSON values: numpy numbers and arrays unpacked, NaN and infinities as null."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return None
    return value
