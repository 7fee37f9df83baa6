"""How far a command is: a bar with an estimate on a terminal, a line for each stage elsewhere."""

from __future__ import annotations

import contextlib
import json
import math
import statistics
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar

from tqdm import tqdm

from modelica_fmu.errors import InputError
from modelica_fmu.files import write_atomically
from pyfmi_runner.cache import cache_folder

if TYPE_CHECKING:
    from pyfmi_runner.loop import Progress

__all__ = ["Stages", "bar", "counter", "loop_progress"]

T = TypeVar("T")
REFRESH = 1.0  # s, between two drawings of a stage's line
WORTH = 2.0  # s, of a whole command below which its length is not remembered
PAUSE = 30.0  # s, a longer gap between two ticks is a machine that slept, or a clock that jumped
LONGEST = 6 * 3600.0  # s, a longer command is neither remembered nor predicted
KEPT = 5  # last lengths of a command, of which the median is predicted
WIDTH = 24  # characters of a bar


def bar(items: Iterable[T], total: int | None = None, what: str = "") -> Iterator[T]:
    """Iterates with a bar on standard error if that is a terminal; elsewhere a line at each
    quarter of a longer iteration.
    """
    if sys.stderr.isatty():
        return iter(tqdm(items, total=total, desc=what, delay=1.0, leave=False))
    return _lines(items, total, what)


def _lines(items: Iterable[T], total: int | None, what: str) -> Iterator[T]:
    began, told = time.perf_counter(), 0
    for done, item in enumerate(items):
        if total and done * 4 // total > told and time.perf_counter() - began > 10.0:
            told = done * 4 // total
            left = (time.perf_counter() - began) * (total - done) / done
            _say(f"{what}: {done} of {total}, about {_seconds(left)} left")
        yield item


def counter(what: str) -> Callable[[int, int], None]:
    """A callback (done, total) for work that other processes do: a bar on a terminal, a line at
    each quarter elsewhere.
    """
    if sys.stderr.isatty():
        shown = tqdm(total=None, desc=what, delay=1.0, leave=False, unit="job")

        def draw(done: int, total: int) -> None:
            shown.total = total
            shown.update(done - shown.n)
            if done >= total:
                shown.close()

        return draw
    began, told = time.perf_counter(), [0]

    def tell(done: int, total: int) -> None:
        if total and done * 4 // total > told[0]:
            told[0] = done * 4 // total
            left = (time.perf_counter() - began) * (total - done) / done
            _say(f"{what}: {done} of {total}, about {_seconds(left)} left")

    return tell


def loop_progress(what: str) -> Progress:
    """A callback for the sampled loops."""
    shown = tqdm(
        total=None, desc=what, delay=1.0, leave=False, disable=not sys.stderr.isatty(), unit="step"
    )

    def report(done: int, total: int) -> bool:
        shown.total = total
        shown.update(done - shown.n)
        if done >= total:
            shown.close()
        return True

    return report


class Watch:
    """Seconds that were worked: a gap of more than PAUSE between two ticks counts as PAUSE, and one
    below 0 as none. To be ticked about every second.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock, self.last, self.worked = clock, clock(), 0.0

    def tick(self) -> float:
        """Seconds worked so far."""
        now = self.clock()
        self.worked += min(max(now - self.last, 0.0), PAUSE)
        self.last = now
        return self.worked


class Stages:
    """`with Stages("build", "binary", 5) as say: say("equations") ...`: names each stage as it
    begins and estimates what is left from how long such commands took on this machine.

    unit, size: what the work is counted in and how much it is: lengths are remembered for each
    command and unit. A command whose length follows no count names its kind of work as unit.
    """

    def __init__(self, command: str, unit: str = "", size: float = 1.0) -> None:
        self.command, self.size = command, max(size, 1e-9)
        self.key = f"{command} {unit}".strip()
        self.usual = _usual(self.key, self.size)  # s, 0: not known
        self.stage, self.watch = "", Watch()
        self.worked = 0.0  # s
        self.usually = True
        self.terminal = sys.stderr.isatty()
        self.told = ""
        self.end = threading.Event()
        self.painter = threading.Thread(target=self._paint, daemon=True)

    def __enter__(self) -> Stages:
        self.painter.start()
        return self

    def __call__(self, stage: str) -> None:
        """Begins a stage; a text that begins with "note: " is told as it is."""
        if stage.startswith("note: "):
            _say(f"{self.command}: {stage}")
            return
        if not stage or stage == self.stage:
            return
        self.stage = stage

    def unusual(self) -> None:
        """Once in a while more has to be done first: this length predicts no other."""
        self.usually, self.usual = False, 0.0

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end.set()
        self.painter.join()
        if self.terminal:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
        if kind is None and self.usually and WORTH < self.watch.tick() < LONGEST:
            _remember(self.key, self.watch.worked / self.size)

    def _left(self) -> str:
        left = self.usual - self.worked
        return f", about {_seconds(left)} left" if left > 1.0 else ""

    def _paint(self) -> None:
        while not self.end.wait(REFRESH):
            self.worked = self.watch.tick()
            if not self.terminal:
                self._tell()
                continue
            share = min(self.worked / self.usual, 0.99) if self.usual else 0.0
            filled = round(WIDTH * share)
            drawn = f" [{'#' * filled}{'.' * (WIDTH - filled)}]" if self.usual else ""
            text = f"{self.command}: {self.stage}{drawn} {_seconds(self.worked)}{self._left()}"
            sys.stderr.write(f"\r\x1b[K{text}")
            sys.stderr.flush()

    def _tell(self) -> None:
        """A line for a stage that lasts."""
        if self.stage != self.told:
            self.told = self.stage
            _say(f"{self.command}: {self.stage} ({_seconds(self.worked)} so far{self._left()})")


def _seconds(value: float) -> str:
    return f"{value:.0f} s" if value < 120 else f"{value / 60:.0f} min"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _durations() -> dict[str, Any]:
    try:
        table = json.loads((cache_folder() / "durations.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return table if isinstance(table, dict) else {}


def _lengths(key: str) -> list[float]:
    """Seconds for each unit of size, of the last commands; values that cannot be are left out."""
    values = _durations().get(key)
    return [
        float(v)
        for v in (values if isinstance(values, list) else [])
        if isinstance(v, int | float) and math.isfinite(v) and v > 0
    ]


def _usual(key: str, size: float) -> float:
    """Seconds that work of this size takes; 0 where it is not known."""
    lengths = _lengths(key)
    usual = statistics.median(lengths) * size if lengths else 0.0
    return usual if usual < LONGEST else 0.0


def _remember(key: str, each: float) -> None:
    text = json.dumps(_durations() | {key: [*_lengths(key), each][-KEPT:]})
    with contextlib.suppress(InputError):  # an estimate is no reason to fail
        write_atomically(
            cache_folder() / "durations.json",
            lambda temporary: temporary.write_text(text, encoding="utf-8"),
        )
