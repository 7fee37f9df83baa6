"""An FMU of FMI 2.0 or 3.0, from any tool, driven by recorded inputs for many parameter sets; no
Python per row.
"""

from __future__ import annotations

import math
import threading
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modelica_fmu.errors import InputError, RunError
from pyfmi_runner.fmu import FmuFile, FmuSession, FmuVariable
from pyfmi_runner.machine_code import kept
from pyfmi_runner.native import call_step, call_step_3, call_values, call_values_3

__all__ = ["DrivenFmu"]

Array = NDArray[np.float64]
FMI_WARNING = 1
ONE_ONLY = "canBeInstantiatedOnlyOncePerProcess"


class DrivenFmu:
    """A co-simulation FMU and its idle instances. Threads may share it: each call takes an instance
    of its own, unless the FMU allows one only.

    step: s, longest communication step; None: one step a row.
    """

    def __init__(self, file: FmuFile, step: float | None = None) -> None:
        self.file, self.step = file, step
        file.identifier("cs")  # refuses an FMU without co-simulation
        self._idle: list[FmuSession] = []
        single = ONE_ONLY in file.description.capabilities["cs"]
        self._turn = threading.Lock() if single else None
        self._end = weakref.finalize(self, _close, self._idle)

    def close(self) -> None:
        """Frees the idle instances; a further run makes new ones."""
        _close(self._idle)

    def run(
        self,
        names: Sequence[str],
        values: Array,
        inputs: Mapping[str, Array | tuple[Array, Array]],
        outputs: Sequence[str],
        period: float,
        rows: int = 0,
    ) -> Array:
        """Outputs (runs, N, outputs) at the rows of a record; NaN from where a run failed on, and
        throughout where the FMU refuses its parameters.

        values (runs, names): set before the initialisation. inputs: (N,) each, held over the period
        behind each row, or a pair (at the rows, over the period behind them). period: s. rows: N
        where there are no inputs. Raises InputError for a name that the FMU lacks or does not let
        be set.
        """
        self._check([*names, *inputs], outputs)
        pairs = {n: v if isinstance(v, tuple) else (v, v) for n, v in inputs.items()}
        at, over = (_columns([p[i] for p in pairs.values()], rows) for i in (0, 1))
        first = dict(zip(pairs, at[0].tolist(), strict=True))
        result = np.full((len(values), len(at), len(outputs)), np.nan)
        with self._instance(dict(zip(names, values[0].tolist(), strict=True)) | first) as session:
            for run, row in enumerate(values.tolist()):
                given = dict(zip(names, row, strict=True)) | first
                if self._start(session, given):
                    self._drive(session, (tuple(pairs), at, over), outputs, period, result[run])
        return result

    def _check(self, set_before: Sequence[str], read: Sequence[str]) -> None:
        for name in (*set_before, *read):
            if name not in self.file.variables:
                raise InputError("no such variable in the FMU", file=self.file.path, field=name)
        for name in set_before:
            v: FmuVariable = self.file.variables[name]
            if not v.settable_before_start:
                what = f"a variable of causality {v.causality} cannot be set"
                raise InputError(what, file=self.file.path, field=name, hint="remove it")

    @contextmanager
    def _instance(self, parameters: Mapping[str, float]) -> Iterator[FmuSession]:
        """An instance that nobody else uses meanwhile."""
        with ExitStack() as stack:
            if self._turn is not None:
                stack.enter_context(self._turn)
            try:
                session = self._idle.pop()
            except IndexError:
                session = self._new(parameters)
            try:
                yield session
            finally:
                self._idle.append(session)

    def _new(self, parameters: Mapping[str, float]) -> FmuSession:
        session = FmuSession(self.file, "cs", parameters)
        try:
            session.__enter__()
        except (InputError, RunError):  # parameters that it refuses, perhaps
            session = FmuSession(self.file, "cs")
            session.__enter__()
        return session

    def _start(self, session: FmuSession, parameters: Mapping[str, float]) -> bool:
        """Whether the FMU takes the parameters; an FMU that cannot be reset is made anew."""
        try:
            session.reset(parameters)
            return True
        except InputError:
            return False
        except RunError:
            session.close()
        session.parameters = dict(parameters)
        try:
            session.__enter__()
            return True
        except (InputError, RunError):
            session.parameters = {}
            session.__enter__()
            return False

    def _drive(
        self,
        session: FmuSession,
        inputs: tuple[Sequence[str], Array, Array],
        outputs: Sequence[str],
        period: float,
        result: Array,
    ) -> None:
        """Fills result (N, outputs) as far as the FMU comes."""
        names, at, over = inputs
        rows, same = len(at), np.array_equal(at, over)
        set_at, *kept = _table(session, "Set", names, at)
        set_over, *also = (set_at, kept) if same else _table(session, "Set", names, over)
        read, filled, references = _table(session, "Get", outputs, np.zeros((rows, len(outputs))))
        flags = np.zeros(16, dtype=np.uint8)
        parts = 1 if self.step is None else max(1, math.ceil(period / self.step - 1e-6))
        status, done = _steps(
            (session.file.description.fmi != "2.0", session.component, session.address("DoStep")),
            (set_at, set_over, read, same),
            (period, parts, rows),
            flags,
        )
        del kept, also, references  # until here the FMU read from them
        session.stepped_natively(done * period, status)
        for layout, values in zip(session.layout(outputs), filled, strict=True):
            result[:done, list(layout.positions)] = values[:done]
        wrong = ~np.isfinite(result).all(axis=1)
        if wrong.any():
            result[int(np.argmax(wrong)) :] = np.nan


def _columns(values: Sequence[Array], rows: int) -> Array:
    """Inputs (N, inputs); rows: N where there are none."""
    columns = np.column_stack(values) if values else np.empty((rows, 0))
    return np.ascontiguousarray(columns, dtype=float)


def _close(sessions: list[FmuSession]) -> None:
    while sessions:
        sessions.pop().close()


def _table(
    session: FmuSession, verb: str, names: Sequence[str], values: Array
) -> tuple[NDArray[np.uint64], list[NDArray[Any]], list[NDArray[np.uint32]]]:
    """What the loop passes for each type of variable (types, 5): function, references, count,
    first row, bytes from row to row; then the rows (N, count) and the references of each, which
    must outlive the loop.
    """
    found, kept, known = [], [], []
    for layout in session.layout(names) if names else ():
        own = values[:, list(layout.positions)]
        if verb == "Set" and not np.issubdtype(layout.dtype, np.floating):
            own = np.rint(own)
        if layout.word == "Boolean":
            own = own != 0
        rows = np.ascontiguousarray(own, dtype=layout.dtype)
        references = layout.references
        found.append(
            (
                session.address(verb + layout.word),
                references.ctypes.data,
                len(references),
                rows.ctypes.data,
                rows.strides[0],
            )
        )
        kept.append(rows)
        known.append(references)
    return np.array(found, dtype=np.uint64).reshape(-1, 5), kept, known


@kept
def _pass(three, component, table, row):  # type: ignore[no-untyped-def]
    """Sets or gets one row of all types."""
    status = 0
    for g in range(len(table)):
        function, references, count, values, stride = table[g]
        address = values + np.uint64(row) * stride
        if three:
            said = call_values_3(function, component, references, count, address)
        else:
            said = call_values(function, component, references, count, address)
        status = max(status, said)
    return status


@kept
def _steps(calls, tables, clock, flags):  # type: ignore[no-untyped-def]
    """Status, and the rows that were read."""
    three, component, do_step = calls
    at, over, read, same = tables
    period, parts, rows = clock
    for k in range(rows):
        status = _pass(three, component, at, k)
        status = max(status, _pass(three, component, read, k))
        if status > FMI_WARNING:
            return status, k
        if k + 1 == rows:
            break
        if not same:
            status = _pass(three, component, over, k)
        for p in range(parts):
            time = (k + p / parts) * period
            if three:
                said = call_step_3(do_step, component, time, period / parts, flags.ctypes.data)
            else:
                said = call_step(do_step, component, time, period / parts)
            status = max(status, said)
            if status > FMI_WARNING or flags[1]:
                return status, k + 1
    return 0, rows
