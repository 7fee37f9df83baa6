"""Options that commands share. The types of those that name where a result goes refuse an
unwritable place when the command line is read, before anything is computed.
"""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable
from pathlib import Path

from modelica_fmu.errors import InputError
from modelica_fmu.files import check_folder, check_target, refuse_replacing

__all__ = [
    "INPUTS",
    "OUTPUTS",
    "add_parameters",
    "json_target",
    "log_target",
    "out_file",
    "out_folder",
    "picture_target",
    "refuse_overwriting_inputs",
]

LOGS = (".parquet", ".csv")
# options of all commands that name what is read, and where a result goes
INPUTS = (
    *("campaign", "after", "plant", "source", "log", "parts", "runs"),
    *("scenario", "spec", "at", "workpiece", "controller"),
    *("fmu", "model", "library", "catalogue"),
)
OUTPUTS = ("json", "html", "out", "plot", "save", "augmented", "catalogue_out", "write", "file")
PICTURES = (".png", ".svg", ".pdf")
PAGES = (".html", ".json")


def add_parameters(command: ArgumentParser) -> None:
    """Adds --set, a list of texts "PARAM=VALUE"."""
    command.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="PARAM=VALUE",
        help="plant parameter, may be repeated",
    )


def out_file(text: str) -> Path:
    """The path of a file to write. Raises ArgumentTypeError where it cannot be."""
    return _checked(text, check_target)


def out_folder(text: str) -> Path:
    """The path of a folder to write into. Raises ArgumentTypeError where that cannot be, and for
    what reads as a file's name: a new folder `lags.png` is what nobody asks for.
    """
    path = _checked(text, check_folder)
    if path.suffix.lower() in (*PICTURES, *LOGS, *PAGES) and not path.is_dir():
        raise ArgumentTypeError(f"{path}: names a file, expected a folder; leave out {path.suffix}")
    return path


def _checked(text: str, check: Callable[[Path], None]) -> Path:
    """The path, if `check` does not refuse it; argparse puts the option's name before why not."""
    path = Path(text)
    try:
        check(path)
    except InputError as error:
        raise ArgumentTypeError(str(error)) from None
    return path


def json_target(text: str) -> str:
    """`-` for standard output, or the path of a file to write."""
    if text in ("-", "/dev/stdout"):
        return "-"
    return str(out_file(text))


def log_target(text: str) -> Path:
    """The path of a log to write, Parquet or CSV by its suffix."""
    return _of_kind(text, "log file", LOGS)


def picture_target(text: str) -> Path:
    """The path of a picture to write, its kind by its suffix."""
    return _of_kind(text, "picture", PICTURES)


def _of_kind(text: str, what: str, suffixes: tuple[str, ...]) -> Path:
    path = out_file(text)
    if path.suffix.lower() not in suffixes:
        endings = f"{', '.join(suffixes[:-1])} or {suffixes[-1]}"
        raise ArgumentTypeError(
            f"{path}: unknown kind of {what} {path.suffix!r}; end it in {endings}"
        )
    return path


def refuse_overwriting_inputs(options: Namespace) -> None:
    """Raises InputError where a result would take the place of a file that is read."""
    given = {name: value for name, value in vars(options).items() if value is not None}
    read: list[str] = []
    for name in INPUTS:
        value = given.get(name, [])
        read += [str(v) for v in (value if isinstance(value, list) else [value])]
    for output in OUTPUTS:
        if output in given:
            refuse_replacing(str(given[output]), read, f"--{output.replace('_', '-')}")
