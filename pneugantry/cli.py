"""The command line: `pneugantry COMMAND`.

One file per command under `commands/`, imported only when it is called; here the table of
commands, parsing, exit codes and JSON.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import json
import os
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any, NoReturn

from modelica_fmu.errors import InputError, RunError
from modelica_fmu.files import write_atomically
from pneugantry.building import build_told
from pneugantry.options import json_target, refuse_overwriting_inputs

# command: its line in the list of commands. Each is a module of `commands` with HELP,
# add_arguments and execute.
COMMANDS = {
    "demo": "build the FMU, track five edges, diagnose a rig with a hidden effect",
    "build": "compile a Modelica class, or a controller, to an FMU",
    "run": "closed-loop run at 1 ms; RMSE and maximum error of f_n and v_t",
    "log": "a recorder's own log made usable: columns, units, rate, set-up",
    "replay": "measured logs against the FMU: gap per log, channel and block",
    "plan": "which effects these sensors and logs can tell, and what would add most",
    "diagnose": "which block and which effect make a measured campaign differ",
    "calibrate": "probabilities for a plant of your own, from rigs drawn on its model",
    "blind": "draw sealed cases on the truth plant, diagnose, unseal, score",
    "identify": "plant parameters with 95 % intervals from measured logs",
    "linearize": "state space of the FMU at an operating point",
    "rootlocus": "poles, zeros, stability limit and margins of a force loop",
    "thesis": "every table and conclusion of the thesis, ours beside the printed",
    "sweep": "parameter studies on cores or a Dask cluster, resumable",
    "benchmark": "speed of every path that steps the FMU, and what a run costs",
    "list": "names that the commands take: parameters, effects, controllers, gains, ...",
    "controller": "write a controller of your own to start from",
    "completion": "completion script for bash, zsh or fish",
}
M_ARENA_MAX = -8  # of malloc.h
ALIASES = {"bench": "benchmark"}  # names of earlier versions


class OneLineParser(argparse.ArgumentParser):
    """A wrong option is one line on standard error, as all unusable input is; the options are in
    --help.
    """

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {' '.join(message.split())}; see {self.prog} --help\n")


class PrintVersion(argparse.Action):
    """`--version`: read from the installed package only when asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from pneugantry import __version__

        print(f"pneugantry {__version__}")
        parser.exit()


def parser(only: str | None = None) -> argparse.ArgumentParser:
    """The parser of all commands, or with the options of one command alone (`only`), so that no
    other command is imported.
    """
    top = OneLineParser(
        prog="pneugantry",
        description="Pneumatic gantry robot: Modelica model, FMU, closed-loop co-simulation, "
        "diagnosis of the sim-to-real gap.",
        epilog="`pneugantry COMMAND --help` says more. Exit codes: 0 done, 1 a failed check or a "
        "run that could not finish, 2 unusable input.",
    )
    top.add_argument("--version", action=PrintVersion, nargs=0, help="print the version and exit")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, summary in COMMANDS.items():
        aliases = [alias for alias, meant in ALIASES.items() if meant == name]
        command = commands.add_parser(
            name,
            help=summary.replace("%", "%%"),  # argparse formats it
            aliases=aliases,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if only is None or only in (name, *aliases):
            _add_options(command, name)
    return top


def _add_options(command: argparse.ArgumentParser, name: str) -> None:
    module = importlib.import_module(f"pneugantry.commands.{name}")
    command.description = module.HELP  # argparse formats options and summaries, no description
    command.add_argument(
        "--json",
        metavar="FILE",
        type=json_target,
        help="write the result as JSON, - for standard output",
    )
    module.add_arguments(command)
    command.set_defaults(execute=module.execute, then=None)


def _named_command(arguments: Sequence[str]) -> str:
    """The command among the arguments: the first that is no option (none of ours comes before it
    with a value); "" where there is none.
    """
    return next((word for word in arguments if not word.startswith("-")), "")


class Lasting:
    """A stream whose reader may leave (`| head`): what is still told goes nowhere, and the command
    goes on to the files that it writes.
    """

    def __init__(self, stream: Any) -> None:
        self.stream, self.left = stream, False

    def write(self, text: str) -> int:
        try:
            return int(self.stream.write(text))
        except BrokenPipeError:
            self._leave()
            return len(text)

    def flush(self) -> None:
        try:
            self.stream.flush()
        except BrokenPipeError:
            self._leave()

    def _leave(self) -> None:
        self.left = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.stream.fileno())  # what its buffer still holds goes there as well
        os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; returns its exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    stdout, stderr = sys.stdout, sys.stderr
    told = sys.stdout = Lasting(stdout)
    sys.stderr = Lasting(stderr)
    try:
        try:
            options = parser(only=_named_command(words)).parse_args(words)
        except SystemExit as end:  # --help, or a wrong option
            return int(end.code or 0)
        gc.set_threshold(100_000)  # few objects lie in cycles; to look for them takes long
        _one_arena()
        code = _executed(options, told)
        told.flush()
        return code or int(told.left and options.json in (None, "-"))  # a result that nobody has
    finally:
        sys.stdout, sys.stderr = stdout, stderr


def _one_arena() -> None:
    """What a thread frees serves the others. glibc has an arena for each of them, and most of what
    arrays leave there is kept: 0.6 GB of 1.7 in a long diagnosis. Other systems have no such call.
    """
    if sys.platform == "linux":
        import ctypes  # its import is dear, for who only asks for help

        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
        if mallopt is not None:
            mallopt(M_ARENA_MAX, 1)


def _executed(options: argparse.Namespace, stdout: Lasting) -> int:
    """Exit code of a command that was carried out."""
    try:
        if options.json == "-":
            sys.stdout = sys.stderr  # what a command prints for people stays out of the JSON
        refuse_overwriting_inputs(options)
        with build_told(options.command) if options.command != "build" else nullcontext():
            result, code = options.execute(options)
            if options.json:
                _write_json(result, options.json, stdout)
            if options.then is not None:  # what may fail, without a loss of the result
                options.then()
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
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(
            f"pneugantry: {where}{error.strerror or error}; check the path, its "
            f"permissions and the space left",
            file=sys.stderr,
        )
        return 2


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
