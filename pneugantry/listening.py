"""What libraries log, handed on while a command asks for it. Imports nothing of ours and no bar."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator

__all__ = ["logged"]


class _Told(logging.Handler):
    """Hands messages on."""

    def __init__(self, say: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self.say = say

    def emit(self, record: logging.LogRecord) -> None:
        self.say(record.getMessage())


@contextlib.contextmanager
def logged(name: str, say: Callable[[str], None]) -> Iterator[None]:
    """`with logged("modelica_fmu", say): ...`: what the loggers below that name say, told to `say`;
    for libraries that know nothing of a terminal.
    """
    logger, handler = logging.getLogger(name), _Told(say)
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.removeHandler(handler)
