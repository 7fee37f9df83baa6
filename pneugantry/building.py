"""Says that an FMU is being built, where a command needs one that is not in the cache yet."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager

from pneugantry.listening import logged

__all__ = ["build_told"]

COMPILER = "modelica_fmu"  # its logger says "equations of NAME" when a build begins
BEGINS = "equations of "


def build_told(command: str) -> AbstractContextManager[None]:
    """`with build_told("run"): ...`: whoever waits for a command is told that it builds first, a
    line on standard error for each model, once.
    """
    told: set[str] = set()

    def tell(said: str) -> None:
        if not said.startswith(BEGINS) or said in told:
            return
        told.add(said)
        clear = "\r\x1b[K" if sys.stderr.isatty() else ""  # of a stage's line
        model = said.removeprefix(BEGINS)
        print(f"{clear}{command}: building the FMU {model}, once", file=sys.stderr, flush=True)

    return logged(COMPILER, tell)
