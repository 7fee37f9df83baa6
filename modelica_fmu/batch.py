"""A part of a model as a shared library that simulates many runs over records in one call."""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modelica_fmu import source_key
from modelica_fmu.compiled import CompiledModel
from modelica_fmu.errors import InputError
from modelica_fmu.lanes import asserted_once, in_lanes, with_elementary
from modelica_fmu.toolchain import (
    compile_library,
    find_compiler,
    host_platform,
    own_processor,
    processor,
)

__all__ = [
    "Correction",
    "Course",
    "Drive",
    "Part",
    "PartVariable",
    "Subsystem",
    "build_part",
    "part_key",
    "read_part",
]

# Of a row, after which each mode holds for as large a share of it: nothing of a row's inside is
# read, and a part that chatters would cost as much as a hundred that do not.
EVENTS = 8
# Internal steps of a row, or of a part of one, after which stiffness is looked for, and how many at
# the limit of stability tell it: a row is too short for the hundred that an FMU waits for.
STIFF = (8, 4)
# Functions of a model that lanes call, of one without states and of others.
LANED_STILL = ("observed", "conditions", "updates")
LANED = ("rates", "outputs", "conditions", "updates")
PART_FLAGS = ("-ftree-vectorize", "-fno-math-errno", "-fno-trapping-math")  # no bit changes
# Without states, and of a large part (a whole plant) that seldom runs: more takes the compiler
# twice as long and gains less than that.
QUICK_FLAGS = ("-O1",)
LARGE = 100_000  # characters of C

Array = NDArray[np.float64]
Kinds = tuple[int, NDArray[np.uint8] | None]  # rows until out of bounds; None: all are STEADY
STEADY, SWITCHED = 1, 2  # RowKind of batch.c
CSRC = Path(__file__).parent / "csrc"
SOURCES = "sources.json"  # of a part: file name -> text, until it is compiled


@dataclass(frozen=True)
class PartVariable:
    """A variable of a part; its value reference is its position in `Part.variables`."""

    name: str
    kind: str  # as compiled.Kind
    type: str
    start: float | None
    unit: str | None
    min: float | None
    max: float | None


@dataclass(frozen=True)
class Part:
    """What is known of a part before it is loaded."""

    library: Path  # compiled when the part is loaded first
    variables: tuple[PartVariable, ...]
    switching: frozenset[str]  # states whose rate changes its form at events

    def of(self, kind: str) -> list[str]:
        return [v.name for v in self.variables if v.kind == kind]


@dataclass(frozen=True, eq=False)
class Correction:
    """States drawn towards measured values: x += share * (measured - x) once a period."""

    states: tuple[str, ...]
    measured: Array  # (N, states); NaN: no correction at this row
    shares: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Course:
    """An input over a record. Drives may share it."""

    at: Array  # (N,), at the rows
    over: Array  # (N,) held over the period behind each row, or (N, parts): over its equal parts
    kinds: dict[tuple[Path, int], Kinds] = field(default_factory=dict)  # to an input of a part

    @classmethod
    def of(cls, values: Array | tuple[Array, Array] | Course) -> Course:
        """Of values that are held over the period behind each row, or of both."""
        if isinstance(values, Course):
            return values
        if not isinstance(values, tuple):
            held = np.ascontiguousarray(values, dtype=float)
            return cls(held, held)
        at, over = (np.ascontiguousarray(v, dtype=float) for v in values)
        return cls(at, over)

    @cached_property
    def addresses(self) -> tuple[int, int]:
        """Where its values lie; asked for once, for that takes as long as many additions."""
        return self.at.ctypes.data, self.over.ctypes.data

    @property
    def values(self) -> Array | tuple[Array, Array]:
        """As `of` takes them."""
        return self.at if self.at is self.over else (self.at, self.over)

    @property
    def parts(self) -> int:
        """Of a period, over which it may differ."""
        return self.over.shape[1] if self.over.ndim == 2 else 1


class Drive:
    """What drives runs over a record: inputs and a correction."""

    def __init__(
        self,
        inputs: Mapping[str, Array | tuple[Array, Array] | Course],
        correction: Correction | None = None,
        rows: int = 0,
    ) -> None:
        """inputs: (N,) each, held over the period behind each row, or a pair (at the rows, over the
        period behind them); what holds over the period may be (N, parts). rows: N where there are
        no inputs. Raises ValueError where inputs differ in length, or in parts of more than one.
        """
        self.inputs = {name: Course.of(v) for name, v in inputs.items()}
        self.correction = correction
        own = self.inputs.values()
        self.parts = max((c.parts for c in own), default=1)
        self.rows = len(next(iter(own)).at) if own else rows
        if any(len(c.at) != self.rows or len(c.over) != self.rows for c in own):
            raise ValueError("inputs of one drive have the same rows")
        if any(c.parts not in (1, self.parts) for c in own):
            raise ValueError("inputs of one drive have the same parts of their rows, or one")

    @cached_property
    def measured(self) -> Array:
        """Corrected states (N, states) as measured; one row where none is corrected."""
        held = np.zeros((1, 1)) if self.correction is None else self.correction.measured
        return np.ascontiguousarray(held, dtype=float)


class _Batch(ctypes.Structure):
    _fields_ = [
        *((n, ctypes.c_size_t) for n in ("n_runs", "n_parameters", "n_parts")),
        *((n, ctypes.c_size_t) for n in ("n_inputs", "n_corrected", "n_outputs", "n_drives")),
        ("period", ctypes.c_double),
        *((n, ctypes.c_void_p) for n in ("parameters", "values", "drive", "inputs", "rows")),
        *((n, ctypes.c_void_p) for n in ("sound", "kind", "at", "over", "apart", "corrected")),
        *((n, ctypes.c_void_p) for n in ("measured", "gains", "outputs", "result")),
    ]


class Subsystem:
    """A loaded part. Threads may share it: every call has instances of its own."""

    def __init__(self, part: Part, *, often: bool = True) -> None:
        """often: whether it runs so often that compiling a large part well pays. Raises InputError
        where its library has yet to be compiled and cannot be.
        """
        self.part = part
        self._library = ctypes.CDLL(os.fspath(_compiled(part, often)))
        self._library.batch_run.argtypes = [ctypes.POINTER(_Batch)]
        self._library.batch_run.restype = ctypes.c_int
        self._references = {v.name: i for i, v in enumerate(part.variables)}
        self._library.batch_kinds.restype = ctypes.c_size_t
        self._inputs = frozenset(part.of("input"))

    def run(
        self,
        names: Sequence[str],
        values: Array,
        drive: Drive,
        outputs: Sequence[str],
        period: float,
    ) -> Array:
        """Outputs (runs, N, outputs) of runs that are driven alike; see `runs`."""
        which = [0] * len(np.atleast_2d(values))
        return np.stack(self.runs(names, values, [drive], outputs, period, which))

    def runs(
        self,
        names: Sequence[str],
        values: Array,
        drives: Sequence[Drive],
        outputs: Sequence[str],
        period: float,
        which: Sequence[int],
    ) -> list[Array]:
        """Outputs (N, outputs) of each run at the rows of its record; NaN from where it failed on.

        values (runs, names): parameters of each run. drives: of the same inputs and corrected
        states, and parts of rows; they may differ in length. which (runs,): that of each run.
        period: s. Raises InputError for a name that is no input or variable of the part, and a
        correction of what is no state.
        """
        inputs = drives[0].inputs
        strange = set(inputs) - self._inputs
        if strange:
            raise InputError(
                "is no input of this part",
                field=min(strange),
                hint=f"the part has {', '.join(sorted(self._inputs))}",
            )
        if len({d.parts for d in drives}) > 1:
            raise ValueError("drives of one call have the same parts of their rows")
        courses = [[d.inputs[n] for n in inputs] for d in drives]
        rows = np.array([d.rows for d in drives], dtype=np.uintp)
        values = np.ascontiguousarray(np.atleast_2d(values), dtype=float)
        own = np.array(which, dtype=np.uint32)
        order = np.argsort(-rows[own].astype(int), kind="stable")  # side by side: as long ones
        values, own = np.ascontiguousarray(values[order]), own[order]
        made = [np.empty((int(n), len(outputs))) for n in rows[own]]
        held = drives[0].correction or Correction((), np.zeros((1, 1)), (0.0,))
        shares = np.array(held.shares)
        lists = [self._references_of(n) for n in (names, tuple(inputs), held.states, outputs)]
        places = [(*c.addresses, c.parts) for cs in courses for c in cs]
        tables = list(np.array(places, dtype=np.uintp).reshape(-1, 3).T.copy())
        measured, results = _addresses([d.measured for d in drives]), _addresses(made)
        runs = (len(values), len(names), drives[0].parts)
        sizes = (*runs, len(inputs), len(held.states), len(outputs), len(drives))
        each = [self._kinds_of(cs, lists[1], d.rows) for cs, d in zip(courses, drives, strict=True)]
        sound = np.array([n for n, _ in each], dtype=np.uintp)
        kinds = _addresses([k for _, k in each])
        arrays: tuple[NDArray[Any], ...] = (lists[0], values, own, lists[1], rows, sound, kinds)
        behind: tuple[NDArray[Any], ...] = (*tables, lists[2], measured, shares, lists[3], results)
        batch = _Batch(*sizes, period, *(a.ctypes.data for a in (*arrays, *behind)))
        if self._library.batch_run(ctypes.byref(batch)) < 0:
            raise InputError(f"cannot correct {', '.join(held.states)}: no states of the part")
        return [made[i] for i in np.argsort(order)]

    def _kinds_of(
        self, courses: Sequence[Course], references: NDArray[np.uint32], rows: int
    ) -> tuple[int, NDArray[np.uint8]]:
        """Rows until an input is out of its bounds, and of what kind each is."""
        sound = rows
        kinds: NDArray[np.uint8] = np.full(rows, STEADY, dtype=np.uint8)
        for course, reference in zip(courses, references.tolist(), strict=False):
            key = self.part.library, reference
            if key not in course.kinds:
                course.kinds[key] = self._kind_of(course, reference)
            own, other = course.kinds[key]
            sound = min(sound, own)
            if other is not None:
                told = (kinds & other & STEADY) | ((kinds | other) & SWITCHED)
                kinds = told.astype(np.uint8)
        return sound, kinds

    def _kind_of(self, course: Course, reference: int) -> Kinds:
        kinds = np.empty(len(course.at), np.uint8)
        pointers = [ctypes.c_void_p(a) for a in (*course.addresses, kinds.ctypes.data)]
        sizes = [ctypes.c_size_t(n) for n in (len(course.at), course.parts)]
        sound = self._library.batch_kinds(ctypes.c_uint(reference), *sizes, *pointers)
        return int(sound), None if np.all(kinds == STEADY) else kinds

    def _references_of(self, names: Sequence[str]) -> NDArray[np.uint32]:
        """Value references; one that nobody reads where there is no name."""
        missing = [n for n in names if n not in self._references]
        if missing:
            raise InputError(
                "is no variable of this part",
                field=missing[0],
                hint=f"the part has {', '.join(list(self._references)[:8])}, ...",
            )
        return np.array([self._references[n] for n in names] or [0], dtype=np.uint32)


def _addresses(arrays: Sequence[NDArray[Any]]) -> NDArray[np.uintp]:
    """Where arrays lie; they must live on."""
    return np.array([a.ctypes.data for a in arrays], dtype=np.uintp)


def build_part(compiled: CompiledModel, folder: Path, key: str) -> Part:
    """Writes a model with the batch driver into `folder`/`key`, unless it is there already. The C
    compiler works when the part is loaded: a diagnosis reads of every part what it computes, and
    runs few of the large ones.
    """
    home = folder / key
    if not (home / "part.json").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as temporary:
            made = Path(temporary) / "part"
            made.mkdir()
            _write(compiled, made)
            if not (home / "part.json").is_file():
                shutil.rmtree(home, ignore_errors=True)  # what a broken run has left
            try:
                made.rename(home)
            except OSError:  # another process was first, and may be compiling what it wrote
                if not (home / "part.json").is_file():
                    raise
    part = read_part(folder, key)
    assert part is not None
    return part


def read_part(folder: Path, key: str) -> Part | None:
    """A part that was built before."""
    try:
        told = json.loads((folder / key / "part.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    variables = tuple(PartVariable(**v) for v in told["variables"])
    library = folder / key / f"part{host_platform().extension}"
    return Part(library, variables, frozenset(told["switching"]))


def part_key(model: Path, what: str) -> str:
    """Hash of what decides a part: sources, compiler, flags, processor, outputs and known
    variables.
    """
    how = f"{what}, {EVENTS} events, stiff {STIFF}, {processor()}"
    key = source_key([model], how, "batch", None)
    return hashlib.sha256(key.encode()).hexdigest()[:24]


def _write(compiled: CompiledModel, folder: Path) -> None:
    """Sources and description of a part."""
    core = ("core.c", "core.h", "implicit.h", "newton.h")
    sources = {name: (CSRC / name).read_text(encoding="utf-8") for name in core}
    for name in ("batch.c", "elementary.h", "lanes.h", "lane_steps.h"):
        sources[name] = (CSRC / "batch" / name).read_text(encoding="utf-8")
    limits = {"MAX_EVENTS": EVENTS, "STIFF_WATCH": STIFF[0], "STIFF_STEPS": STIFF[1]}
    once = asserted_once(compiled.sources["model.c"])
    limits["ASSERTED_ONCE"] = int(once)
    defines = "".join(f"#define {name} {value}\n" for name, value in limits.items())
    sources["core.c"] = defines + sources["core.c"]
    sources |= dict(compiled.sources)
    sources["model.c"] = with_elementary(compiled.sources["model.c"])
    model, kinds = compiled.sources["model.c"], {v.kind for v in compiled.variables}
    names = (*(LANED if "state" in kinds else LANED_STILL), *(() if once else ("check",)))
    sources["model_lanes.h"] = in_lanes(model, names)
    (folder / SOURCES).write_text(json.dumps(sources), encoding="utf-8")
    keys = ("name", "kind", "type", "start", "unit", "min", "max")
    variables = [{k: v for k, v in asdict(x).items() if k in keys} for x in compiled.variables]
    told = {"variables": variables, "switching": sorted(compiled.switching)}
    (folder / "part.json").write_text(json.dumps(told), encoding="utf-8")


def _compiled(part: Part, often: bool) -> Path:
    """A part's library, made from its sources unless it is there. Another process may be at it."""
    library, home = part.library, part.library.parent
    if library.is_file():
        return library
    try:
        sources = json.loads((home / SOURCES).read_text(encoding="utf-8"))
    except FileNotFoundError:
        if library.is_file():
            return library
        raise
    target = host_platform()
    compiler = find_compiler(target)
    flags = (*PART_FLAGS, *own_processor(compiler, target))
    seldom = not often and len(sources["model.c"]) > LARGE
    quick = seldom or not part.of("state")
    flags += QUICK_FLAGS if quick else ()
    names = ["batch.c"]  # holds the others
    with tempfile.TemporaryDirectory(dir=home) as temporary:
        for name, text in sources.items():
            (Path(temporary) / name).write_text(text, encoding="utf-8")
        made = compile_library(compiler, target, Path(temporary), names, library.name, flags)
        made.replace(library)
    (home / SOURCES).unlink(missing_ok=True)
    return library
