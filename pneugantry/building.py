"""Says that an FMU is being built, where a command needs one that is not in the cache yet."""

from __future__ import annotations

import contextlib
import logging
import sys
from collections.abc import Iterator

__all__ = ["build_told"]

COMPILER = "modelica_fmu"  # its logger says "equations of NAME" when a build begins
BEGINS = "equations of "


class _Teller(logging.Handler):
    """A line on standard error for each model that is built, once."""

    def __init__(self, command: str) -> None:
        super().__init__(logging.INFO)
        self.command, self.told = command, set[str]()

    def emit(self, record: logging.LogRecord) -> None:
        said = record.getMessage()
        if not said.startswith(BEGINS) or said in self.told:
            return
        self.told.add(said)
        clear = "\r\x1b[K" if sys.stderr.isatty() else ""  # of a stage's line
        model = said.removeprefix(BEGINS)
        print(f"{clear}{self.command}: building the FMU {model}, once", file=sys.stderr, flush=True)


@contextlib.contextmanager
def build_told(command: str) -> Iterator[None]:
    """`with build_told("run"): ...`: whoever waits for a command is told that it builds first."""
    logger, handler = logging.getLogger(COMPILER), _Teller(command)
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.removeHandler(handler)
