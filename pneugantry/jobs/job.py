"""What is run and what comes back: a job, its end, and the function that a worker makes once."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from modelica_fmu.errors import InputError, RunError

__all__ = [
    "ATTEMPTS",
    "DIED",
    "Ended",
    "Factory",
    "Function",
    "Job",
    "answer",
    "end_of",
    "reason_of",
]

ATTEMPTS = 3  # a case that took this many workers with it is given up
# the same words here and on a cluster: results do not tell who ran them
DIED = "its worker died each time it was tried"

Function = Callable[[Any], Any]  # argument -> value; what it raises is the case's reason
Factory = Callable[
    [], Function
]  # pickles; called once in each worker, there the costly things are made


@dataclass(frozen=True)
class Job:
    """One case. key: its name in the results; argument: pickles."""

    key: int | str
    argument: Any


@dataclass(frozen=True)
class Ended:
    """How a job ended: with a value, or with the reason why not."""

    key: int | str
    value: Any = None
    failure: str = ""  # one line, empty: it has a value
    seconds: float = 0.0  # wall time in the worker
    worker: str = ""  # host:process


def answer(function: Function, job: Job) -> Ended:
    """Runs a job where it stands; whatever it raises is recorded and nothing is thrown."""
    started = time.perf_counter()
    try:
        ended = Ended(job.key, function(job.argument))
    except Exception as error:
        ended = Ended(job.key, failure=reason_of(error))
    return replace(
        ended, seconds=time.perf_counter() - started, worker=f"{socket.gethostname()}:{os.getpid()}"
    )


def end_of(job: Job) -> Ended:
    """The end of a job whose worker died too often."""
    return Ended(job.key, failure=DIED)


def reason_of(error: BaseException) -> str:
    """An error in one line."""
    text = " ".join(str(error).split())
    return (
        text
        if isinstance(error, InputError | RunError)
        else f"{type(error).__name__}: {text}".rstrip(": ")
    )
