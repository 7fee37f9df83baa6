"""Measuring campaigns: a folder of logs with one campaign.toml that says how each was taken, or a
single log.
"""

from __future__ import annotations

import dataclasses
import math
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from modelica_fmu.errors import InputError
from pyfmi_runner.controller_file import is_known_controller, read_controller
from pyfmi_runner.log import (
    COLUMNS,
    MEASURED,
    OPTIONAL,
    PERIOD,
    REQUIRED,
    STROKE_X,
    STROKE_Z,
    Log,
    read_log,
    write_atomically,
    write_log,
)
from pyfmi_runner.log_import import ABSENT, NAMES, Import, import_from
from pyfmi_runner.scenario import (
    Fields,
    Phases,
    Scenario,
    clamp_windows,
    parse_toml,
    to_toml,
    toml_key,
)
from pyfmi_runner.suspicions import touches
from pyfmi_runner.workpiece import default_standoff

__all__ = [
    "DRIVEN",
    "SUFFIXES",
    "Campaign",
    "LogSetup",
    "LoggedRun",
    "campaign_of_log",
    "read_campaign",
    "scenario_setup",
    "setup_from",
    "setup_table",
    "with_controller",
    "write_campaign",
]

INDEX = "campaign.toml"
SUFFIXES = (".parquet", ".pq", ".csv", ".mat")
KEYS = (
    "file",
    "loop",
    "clamped",
    "start",
    "workpiece",
    "standoff",
    "surface_finish",
    "phases",
    "approach_command",
    "f_nd",
    "v_td",
    "controller",
    "gains",
)
DRIVEN = ("time", "u_x", "u_z")  # columns without which a log drives nothing
SLACK = 0.02  # s, by which a log may end early: a recorder's last interval
TOP = ("log", "name", "import")  # keys of campaign.toml itself
IMPORT = (
    "import"  # how a recorder's columns, units and rate become a log's: pyfmi_runner.log_import
)


@dataclass(frozen=True)
class LogSetup:
    """How a log was taken; None is what nobody said. Raises ValueError for a clamp that cannot be
    read.
    """

    loop: str = "open"  # "open" or "closed"
    clamped: tuple[str, ...] = ()  # "x", "z", "x until contour"
    start_x: float = 0.95  # m
    start_z: float = 0.0  # m
    workpiece: str = "none"  # a named workpiece, "none", or the path of a CSV of x, z_w
    standoff: float | None = None  # m, z_0; None: the workpiece's own
    surface_finish: bool = False
    phases: Phases = field(default_factory=dict)
    approach_command: tuple[float, float] | None = (
        None  # V, u_x and u_z until the contact phase starts
    )
    f_nd: float | None = None  # N, > 0 presses into the workpiece
    v_td: float | None = None  # m/s, < 0 tracks towards -x
    controller: str | None = None
    gains: str | dict[str, float] | None = None  # a gain table's name, or gains by name

    def __post_init__(self) -> None:
        clamp_windows(self.clamped, self.phases)

    @property
    def z_0(self) -> float:
        """Stand-off [m]; NaN where there is no workpiece."""
        if self.workpiece == "none":
            return math.nan
        return default_standoff(self.workpiece) if self.standoff is None else self.standoff

    def clamp_windows(self, axis: str) -> list[tuple[float, float]]:
        """Stretches [t0, t1) in s over which an axis ("x" or "z") is clamped; infinite ends mean
        the log's ends.
        """
        return clamp_windows(self.clamped, self.phases)[axis]

    def clamp_signal(self, axis: str, time: ArrayLike) -> NDArray[np.bool_]:
        """Whether an axis ("x" or "z") is clamped over [t_k, t_k + 1 ms); shape of time [s]."""
        instant = (
            np.asarray(time, dtype=np.float64) + 0.5 * PERIOD
        )  # half a sample off the edges: safe from rounding
        held = np.zeros(instant.shape, dtype=np.bool_)
        for start, end in self.clamp_windows(axis):
            held |= (instant >= start) & (instant < end)
        return held


@dataclass(frozen=True, eq=False)
class LoggedRun:
    """A log and how it was taken."""

    setup: LogSetup
    log: Log


@dataclass(frozen=True, eq=False)
class Campaign:
    """Logs of one rig, in the order of campaign.toml. notes: what was left out or does not fit, one
    sentence each.
    """

    name: str
    path: Path
    logs: dict[str, LoggedRun]
    notes: list[str] = field(default_factory=list)

    def __iter__(self) -> Iterator[LoggedRun]:
        return iter(self.logs.values())


def read_campaign(
    path: str | os.PathLike[str],
    *,
    strict: bool = True,
    setup: Mapping[str, Any] | None = None,
    needs: Sequence[str] = REQUIRED,
) -> Campaign:
    """Read a folder with campaign.toml, or a single log as a campaign of one.

    The setup of a single log is taken from the first of: a TOML file of the same name beside it,
    its table in a campaign.toml beside it, its own provenance; else: open loop, no workpiece,
    starting where its first rows are. Keys in `setup` (as in campaign.toml) go before all of these.
    With strict=False logs that cannot be used are left out and named in `notes`. needs: columns
    that every log must have; with DRIVEN a rig may measure as little as one channel, and `notes`
    name those that are missing. Raises InputError naming file, key and hint.
    """
    path = Path(path)
    if os.path.isdir(path):
        return _read_folder(path, strict, needs)
    return _read_single(path, dict(setup or {}), needs)


def _read_needed(file: Path, convert: Import | None, needs: Sequence[str]) -> Log:
    """A log with the columns that it needs, and one measured channel at least."""
    log = read_log(file, convert, needs)
    if not any(name in log for name in MEASURED):
        hint = f"add one of {', '.join(MEASURED)}"
        raise InputError("measures nothing", file=file, field="columns", hint=hint)
    return log


def _read_folder(folder: Path, strict: bool, needs: Sequence[str]) -> Campaign:
    index = folder / INDEX
    if not index.is_file():
        hint = "write one [log.NAME] table per log, or name a single log file"
        raise InputError("no such file", file=index, hint=hint)
    content = parse_toml(index)
    tables = _log_tables(content, index)
    name = Fields(content, TOP, index).of_type("name", str, "")
    logs: dict[str, LoggedRun] = {}
    notes: list[str] = []
    for key, table in tables.items():
        try:
            given = setup_from(_setup_of(table), index, f"log.{key}.")
            convert = _import_of(content, table, index)
            log = _read_needed(_log_file(folder, key, table, index), convert, needs)
        except InputError as error:
            if strict:
                raise
            notes.append(f"{key} left out: {error}")
            continue
        logs[key] = LoggedRun(given, dataclasses.replace(log, name=key))
        notes += _misfits(key, logs[key])
    for stray in _strays(folder, tables, logs):
        message = f"{stray.name} has no table [log.{stray.stem}]"
        if strict:
            raise InputError(message, file=index, hint="add the table, or move the file away")
        notes.append(f"{message}: left out")
    if not logs:
        raise InputError(f"no usable log ({notes[0]})", file=index, hint="correct its logs")
    return Campaign(name or folder.resolve().name, folder, logs, notes)


def _log_tables(index: Mapping[str, Any], file: Path) -> dict[str, Mapping[str, Any]]:
    top = Fields(index, TOP, file)
    tables = top.table.get("log", {})
    if not isinstance(tables, Mapping) or not tables:
        top.refuse("log", "there is no log table", "write one [log.NAME] table per log")
    for name, table in tables.items():
        Fields(table, (*KEYS, IMPORT), file, f"log.{name}.")
    return dict(tables)


def _setup_of(table: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if key != IMPORT}


def _import_of(
    content: Mapping[str, Any], table: Mapping[str, Any], file: Path | None
) -> Import | None:
    """A log's own import table, its columns put over those that hold for all logs."""
    shared, own = content.get(IMPORT, {}), table.get(IMPORT, {})
    for given in (shared, own):
        Fields(given, (*NAMES, "rate"), file, "import.")
    return import_from({**shared, **own}, file) if shared or own else None


def _log_file(folder: Path, name: str, table: Mapping[str, Any], index: Path) -> Path:
    if "file" in table:
        fields = Fields(table, (*KEYS, IMPORT), index, f"log.{name}.")
        file: str = fields.of_type("file", str, "")
        return folder / file
    names = [name + suffix for suffix in SUFFIXES if name + suffix != table.get("workpiece")]
    present = [folder / file for file in names if os.path.isfile(folder / file)]
    if len(present) == 1:
        return present[0]
    if present:
        found = " and ".join(p.name for p in present)
        raise InputError(
            f"found {found}", file=index, field=f"log.{name}", hint='keep one, or say file = "..."'
        )
    message, hint = (
        f"no {name}.parquet or {name}.csv in the folder",
        "add the log, or remove its table",
    )
    raise InputError(message, file=index, field=f"log.{name}", hint=hint)


def _strays(
    folder: Path, tables: Mapping[str, Mapping[str, Any]], logs: Mapping[str, LoggedRun]
) -> list[Path]:
    """Log files that no table speaks of; profiles of workpieces are none."""
    spoken = {str(table.get(key, "")) for table in tables.values() for key in ("file", "workpiece")}
    files = sorted(
        p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith(".")
    )
    return [p for p in files if p.stem not in tables and p.name not in spoken]


def _misfits(name: str, run: LoggedRun) -> Iterator[str]:
    """What was changed on the way in, and where a log contradicts its setup."""
    for said in run.log.provenance.get("import", []):
        yield f"{name} {said}"
    if missing := [c for c in MEASURED if c not in run.log]:
        other = [str(c) for c in run.log.table.columns if c not in COLUMNS]
        hint = "`pneugantry log init FILE` maps names and units"
        cure = f"; column {', '.join(other)} is not known: {hint}" if other else ""
        yield f"{name} does not measure {', '.join(missing)}{cure}"
    for axis, said, slack in (("x", run.setup.start_x, 0.01), ("z", run.setup.start_z, 0.003)):
        first = float(np.mean(run.log[axis][:10])) if axis in run.log else said
        if abs(first - said) > slack:
            yield f"{name} starts at {axis} = {first:.4g} m, its setup says {said:.4g} m"
    felt = [c for c in ("f_x", "f_z") if c in run.log and touches(run.log[c])]
    if felt and run.setup.workpiece == "none":
        yield (
            f"{name} feels a contact force in {' and '.join(felt)}, its setup says no workpiece: "
            "the model then has nothing to press against"
        )
    if run.setup.controller and not is_known_controller(run.setup.controller):
        yield _foreign_loop(name, run.setup.controller)
    end = max((end for _, end in run.setup.phases.values()), default=-math.inf)
    if end > run.log.time[-1] + SLACK:
        yield f"{name} ends at {run.log.time[-1]:.3f} s, its phases at {end:g} s"


def _read_single(path: Path, given: dict[str, Any], needs: Sequence[str]) -> Campaign:
    if str(given.get("workpiece", "")).lower().endswith(".csv"):
        given["workpiece"] = str(
            Path(given["workpiece"]).resolve()
        )  # from the working folder, not from the log's
    table, convert, source = _said_beside(path)
    try:
        log = _read_needed(path, convert, needs)
    except InputError as error:
        if convert is not None or error.field not in (*REQUIRED, *OPTIONAL):
            raise
        hint = f"{error.hint}; or let `pneugantry log init {path.name}` map columns, units and rate"
        raise InputError(error.message, file=error.file, field=error.field, hint=hint) from None
    if source is None and isinstance(log.provenance.get("setup"), Mapping):
        table, source = log.provenance["setup"], path
    setup = setup_from(_setup_of_one(log, table, given), source)
    return _campaign_of_one(log, path, setup, {**table, **given})


def _said_beside(path: Path) -> tuple[dict[str, Any], Import | None, Path | None]:
    """Setup and import of a single log from the TOML file of its name, or the campaign.toml beside
    it; where they stand.
    """
    beside, index = path.with_suffix(".toml"), path.parent / INDEX
    if beside.is_file():
        content = parse_toml(beside)
        table: Mapping[str, Any] = content
        if "log" in content:
            tables = _log_tables(content, beside)
            table = tables.get(path.stem, next(iter(tables.values())))
        shared = content if table is not content else {}
        return _setup_of(table), _import_of(shared, table, beside), beside
    if index.is_file() and path.stem in (
        tables := _log_tables(content := parse_toml(index), index)
    ):
        table = tables[path.stem]
        return _setup_of(table), _import_of(content, table, index), index
    return {}, None, None


def campaign_of_log(log: Log, setup: Mapping[str, Any] | None = None) -> Campaign:
    """A log in memory as a campaign of one. `setup`: keys of a table [log.NAME] in campaign.toml;
    they go before what the log's provenance says. Raises InputError naming the key.
    """
    said = log.provenance.get("setup")
    table = {**(said if isinstance(said, Mapping) else {}), **(setup or {})}
    return _campaign_of_one(log, Path(log.name), setup_from(_setup_of_one(log, table, {})), table)


def _setup_of_one(log: Log, table: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """The setup's table; where it does not say the start, that of the first rows."""
    strokes = {a: s for a, s in (("x", STROKE_X), ("z", STROKE_Z)) if a in log}
    inside = {a: min(max(float(np.mean(log[a][:10])), 0.0), s) for a, s in strokes.items()}
    return {"start": inside, **table, **given}


def _campaign_of_one(log: Log, path: Path, setup: LogSetup, said: Mapping[str, Any]) -> Campaign:
    run = LoggedRun(setup, log)
    notes = list(_misfits(path.stem, run))
    if not said:
        notes.append(
            f"nothing says how {path.name} was taken: open loop, no clamp and no workpiece "
            f"assumed, and the answer is no better than that; `pneugantry log init {path.name}` "
            f"writes {path.stem}.toml, where you say it"
        )
    return Campaign(path.stem, path, {path.stem: run}, notes)


def setup_from(
    table: Mapping[str, Any], file: str | os.PathLike[str] | None = None, prefix: str = ""
) -> LogSetup:
    """A setup from its TOML table; workpiece files are taken from the folder of `file`. Raises
    InputError.
    """
    fields = Fields(table, KEYS, file, prefix)
    for key in KEYS:
        if table.get(key) == ABSENT:
            fields.refuse(key, "is not filled in yet", "say how the log was taken")
    workpiece, loop = fields.workpiece("none", none=True), fields.of_type("loop", str, "open")
    if loop not in ("open", "closed"):
        fields.refuse("loop", f"is {loop!r}", 'write "open" or "closed"')
    phases = fields.phases(workpiece)
    start, command = fields.sub("start", ("x", "z")), fields.sub("approach_command", ("u_x", "u_z"))
    gains = table.get("gains")
    return LogSetup(
        loop=loop,
        clamped=fields.clamped((), phases),
        start_x=start.number("x", 0.95, 0.0, STROKE_X),
        start_z=start.number("z", 0.0, 0.0, STROKE_Z),
        workpiece=workpiece,
        standoff=fields.number("standoff", None, -STROKE_Z, 2 * STROKE_Z),
        surface_finish=fields.of_type("surface_finish", bool, False),
        phases=phases,
        approach_command=(
            command.number("u_x", 0.0, 0.0, 5.0),
            command.number("u_z", 0.0, 0.0, 5.0),
        )
        if "approach_command" in fields
        else None,
        f_nd=fields.number("f_nd", None, 0.0, 1e3),
        v_td=fields.number("v_td", None, -10.0, 10.0),
        controller=_named_only(fields.of_type("controller", str, "")),
        gains=gains if gains is None or isinstance(gains, str) else fields.numbers("gains"),
    )


def with_controller(campaign: Campaign, file: Path) -> Campaign:
    """The campaign with a rig's own controller in its closed-loop logs, and its gains its own.
    Raises InputError where the file cannot be used.
    """
    read_controller(file)
    full = str(file.resolve())
    logs = {
        name: dataclasses.replace(
            run, setup=dataclasses.replace(run.setup, controller=full, gains=None)
        )
        if run.setup.loop == "closed"
        else run
        for name, run in campaign.logs.items()
    }
    gone = {_foreign_loop(n, r.setup.controller) for n, r in campaign.logs.items()}
    notes = [note for note in campaign.notes if note not in gone]
    return dataclasses.replace(campaign, logs=logs, notes=notes)


def _foreign_loop(name: str, controller: str | None) -> str:
    return (
        f"{name} was recorded with the controller {controller!r}, which is none of ours: its loop "
        "is not run again (--controller FILE.py gives it)"
    )


def _named_only(controller: str) -> str | None:
    """A controller as data may name it: never by a path, for no file is run because a
    log says so.
    """
    own = controller.lower().endswith((".py", ".fmu"))
    return (Path(controller.replace("\\", "/")).name if own else controller) or None


def setup_table(setup: LogSetup) -> dict[str, Any]:
    """A setup as the table that `setup_from` reads back as it: for campaign.toml, or a log's
    provenance["setup"].
    """
    command = setup.approach_command
    table = {key: getattr(setup, key) for key in KEYS if hasattr(setup, key)} | {
        "clamped": list(setup.clamped),
        "start": {"x": setup.start_x, "z": setup.start_z},
        "phases": {name: list(span) for name, span in setup.phases.items()},
        "approach_command": {"u_x": command[0], "u_z": command[1]} if command else None,
    }
    return {key: table[key] for key in KEYS if table.get(key) not in (None, {})}


def scenario_setup(scenario: Scenario) -> LogSetup:
    """The setup of the log that a scenario's run gives."""
    return LogSetup(
        loop="closed",
        approach_command=(scenario.approach_u_x, scenario.approach_u_z),
        standoff=scenario.z_0,
        **{key: getattr(scenario, key) for key in _SHARED},
    )


_SHARED = (
    "clamped",
    "start_x",
    "start_z",
    "workpiece",
    "surface_finish",
    "phases",
    "f_nd",
    "v_td",
    "controller",
    "gains",
)


def write_campaign(campaign: Campaign, folder: str | os.PathLike[str]) -> Path:
    """Write a campaign as a folder of Parquet logs with campaign.toml, written last; profiles are
    copied into it.

    Raises InputError where the folder cannot be written.
    """
    folder = Path(folder)
    parts = [
        "# One measuring campaign: every log is 1 kHz, SI units.\n",
        to_toml({"name": campaign.name}),
    ]
    for name, run in campaign.logs.items():
        write_log(run.log, folder / f"{name}.parquet")
        table = setup_table(run.setup)
        if run.setup.workpiece.lower().endswith(".csv"):
            table["workpiece"] = f"{name}_profile.csv"
            write_atomically(
                folder / table["workpiece"], partial(shutil.copyfile, run.setup.workpiece)
            )
        parts.append(f"\n[log.{toml_key(name)}]\n{to_toml(table)}")
    text = "".join(parts)
    write_atomically(folder / INDEX, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return folder / INDEX
