"""Runs, replays and identification as functions with typed results."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import pandas as pd

from controllers.gains import named_gains
from controllers.interface import Controller
from modelica_fmu.errors import InputError
from pneugantry.analysis.limit_cycle import LimitCycle, limit_cycle
from pneugantry.analysis.metrics import Metrics, tracking_metrics
from pneugantry.api.html import html_page, html_table
from pneugantry.api.inputs import CampaignSource, FmuSource, PathLike, campaign_from, fmu_from
from pneugantry.api.presets import conditions
from pneugantry.progress import bar, loop_progress
from pyfmi_runner.blocks import BlockReplayer, noisy_copy
from pyfmi_runner.campaign import Campaign
from pyfmi_runner.enough_rows import long_enough
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.fmu_controller import FmuController
from pyfmi_runner.log import MEASURED, Log, write_log
from pyfmi_runner.loop import Progress
from pyfmi_runner.replay import Replayer, channel_gaps
from pyfmi_runner.run import make_scenario_controller, run_scenario
from pyfmi_runner.scenario import PRESETS as PHASE_PRESETS
from pyfmi_runner.scenario import Phases, Scenario, read_scenario, short_phases
from pyfmi_runner.workpiece import check_workpiece

if TYPE_CHECKING:
    from pneugantry.analysis.identify.identification import Identification
    from pneugantry.analysis.plots import Figure

DEFAULT_GAINS = "table_4_6"  # of the controllers that take gains

__all__ = [
    "Changes",
    "IdentifiedPlant",
    "Replay",
    "TrackingRun",
    "chosen_scenario",
    "identify",
    "replay",
    "run",
]


@dataclass(frozen=True, eq=False)
class TrackingRun:
    """One closed-loop run, whole or as far as it came."""

    scenario: Scenario
    log: Log
    outcome: str  # "done", "cancelled", "failed"
    reason: str  # one sentence where it is not "done"
    seconds: float  # wall time of the stepping, compilation left out
    metrics: Metrics | None  # None where the run is not done
    limit_cycle: LimitCycle | None = None  # of f_n over the contouring phase

    @property
    def table(self) -> pd.DataFrame:
        """The log as a pandas table: SI units, one row a millisecond; how the run was set up stands
        in `attrs["provenance"]`, so that `pg.replay` and `pg.diagnose` take the table as it is.
        """
        table = self.log.table.copy()
        table.attrs["provenance"] = self.log.provenance
        return table

    @property
    def simulated(self) -> float:
        """Simulated time [s]."""
        return len(self.log) * self.scenario.timing.period

    def write(self, path: PathLike) -> None:
        """Writes the log as Parquet or CSV, by the suffix. Raises InputError where it cannot."""
        write_log(self.log, path)

    def figure(self) -> Figure:
        """f_n, v_t, theta and commands over time, z over x."""
        from pneugantry.analysis.plots import tracking_figure

        named = f"{self.scenario.name}: {self.scenario.workpiece}, {self.scenario.controller}"
        return tracking_figure(self.log, named)

    def as_json(self) -> dict[str, Any]:
        """The JSON of `pneugantry run`, "run/1"."""
        factor = self.simulated / self.seconds if self.seconds else 0.0
        return {
            "schema": "run/1",
            "workpiece": self.scenario.workpiece,
            "controller": self.scenario.controller,
            "seed": self.scenario.seed,
            "outcome": self.outcome,
            "reason": self.reason,
            "metrics": self.metrics._asdict() if self.metrics else None,
            "limit_cycle": self.limit_cycle._asdict() if self.limit_cycle else None,
            "steps": len(self.log),
            "seconds": self.seconds,
            "realtime_factor": factor,
        }

    def _repr_html_(self) -> str:
        title = f"{self.scenario.workpiece}, {self.scenario.controller}: {self.outcome}"
        if self.metrics is None:
            return html_page(title, f"<p>{self.reason}</p>")
        m = self.metrics
        rows = [("f_n [N]", m.rmse_fn, m.me_fn), ("v_t [m/s]", m.rmse_vt, m.me_vt)]
        return html_page(title, html_table(("", "RMSE", "largest error"), rows))


class Changes(TypedDict, total=False):
    """What may differ from a scenario."""

    workpiece: str | None
    parameters: Mapping[str, float] | None  # of the plant
    seed: int | None  # of noise and jitter
    gains: str | Mapping[str, float] | None  # a table's name, or single gains over its own
    phases: str | None  # "short" or "thesis"
    f_nd: float | None  # N
    v_td: float | None  # m/s


def run(
    scenario: Scenario | PathLike | None = None,
    *,
    controller: Controller | str | None = None,
    preset: str | None = None,
    fmu: FmuSource = None,
    say: Callable[[str], None] | None = None,
    **changes: Unpack[Changes],
) -> TrackingRun:
    """Runs a scenario in closed loop at 1 ms on the FMU.

    scenario: a `Scenario`, a TOML file, or None for the curved edge with `pi_fv`; or by preset, the
    name of conditions (`presets.PRESETS`). The rest is what differs from it: controller (a name, a
    Python file, an FMU's path, or an object of one's own), workpiece, parameters of the plant, seed
    of noise and jitter, gains, phases, f_nd, v_td. say: told the name of each stage. A run that
    fails on the way is a result with its reason. Raises InputError for a name or a value that
    cannot be used.
    """
    named = controller if isinstance(controller, str) else None
    score: Callable[[Log], Metrics] = tracking_metrics
    if preset is not None:
        if scenario is not None:
            raise InputError(
                "is given beside a scenario", field="--preset", hint="keep one of them"
            )
        scenario, score = conditions(preset, changes.get("workpiece"), named)
        changes["workpiece"] = None
    chosen = chosen_scenario(scenario, named, **changes)
    own = None if isinstance(controller, str) else controller
    if own is not None:
        chosen = replace(chosen, controller=type(own).__name__)  # what the log and figures say
    tell = say or (lambda stage: None)
    tell("model")
    with _fmu_controller(chosen) as exported:
        file = fmu_from(fmu)
        tell("loop, compiled for this controller")
        done = run_scenario(
            chosen,
            file,
            progress=loop_progress(chosen.name) if say is None else _quarters(say),
            controller=own or exported,
        )
    metrics = score(done.log) if done.outcome == "done" else None
    swings = limit_cycle(done.log) if metrics and not chosen.surface_finish else None
    return TrackingRun(chosen, done.log, done.outcome, done.reason, done.seconds, metrics, swings)


def _quarters(say: Callable[[str], None]) -> Progress:
    """A callback for the sampled loops that names the quarter of an experiment."""

    def report(done: int, total: int) -> bool:
        say(f"experiment, {25 * (4 * done // max(total, 1))} % done")
        return True

    return report


def chosen_scenario(
    scenario: Scenario | PathLike | None = None,
    controller: str | None = None,
    **changes: Unpack[Changes],
) -> Scenario:
    """A scenario (a file, an object, or the default) with what is changed in it."""
    chosen = scenario if isinstance(scenario, Scenario) else _read(scenario, controller)
    fields: dict[str, Any] = {"plant": chosen.plant | dict(changes.get("parameters") or {})}
    workpiece = changes.get("workpiece")
    if workpiece:
        check_workpiece(workpiece)
        fields |= {"workpiece": workpiece, "standoff": None}
        if chosen.phases == short_phases(chosen.workpiece):
            fields["phases"] = short_phases(workpiece)
    if controller:
        own = controller.lower().endswith(".py")
        fields["controller"] = os.path.abspath(controller) if own else controller
    if changes.get("phases"):
        fields["phases"] = _phases(str(changes["phases"]), workpiece or chosen.workpiece)
    seed = changes.get("seed")
    if seed is not None and seed < 0:
        hint = "choose a whole number from 0 on"
        raise InputError(f"is {seed}, expected >= 0", field="--seed", hint=hint)
    plain = {"seed": seed, "f_nd": changes.get("f_nd"), "v_td": changes.get("v_td")}
    fields |= {name: value for name, value in plain.items() if value is not None}
    gains = changes.get("gains")
    if gains is not None:
        named = str(fields.get("controller", chosen.controller))
        fields["gains"] = _gains(gains, chosen, named.endswith(".py"))
    return replace(chosen, **fields)


def _phases(name: str, workpiece: str) -> Phases:
    if name not in PHASE_PRESETS:
        hint = f"use {' or '.join(PHASE_PRESETS)}, or a scenario's [phases]"
        raise InputError(f"unknown preset {name!r}", field="--phases", hint=hint)
    return PHASE_PRESETS[name](workpiece)


def _gains(
    gains: str | Mapping[str, float], scenario: Scenario, own: bool
) -> str | dict[str, float]:
    """A table's name, or all gains: single ones over those of the scenario or of Table 4.6. A
    controller of one's own gets what is given alone.
    """
    if isinstance(gains, str):
        return gains
    if own:
        return dict(gains)
    base = scenario.gains if scenario.gains is not None else DEFAULT_GAINS
    try:
        return {**named_gains(base), **gains}
    except ValueError as error:
        raise InputError(
            str(error), field="--gains", hint="`pneugantry list gains` names them"
        ) from None


def _read(path: PathLike | None, controller: str | None) -> Scenario:
    if path is None:
        return Scenario()
    scenario = read_scenario(path)
    if not controller and not scenario.controller.endswith(".fmu"):
        make_scenario_controller(scenario, os.fspath(path))  # refused where its file is known
    return scenario


@contextmanager
def _fmu_controller(scenario: Scenario) -> Iterator[FmuController | None]:
    """The controller of a scenario that names an FMU; None where it names one of ours."""
    if not scenario.controller.endswith(".fmu"):
        yield None
        return
    with FmuController(FmuFile.read(scenario.controller)) as controller:
        yield controller


@dataclass(frozen=True, eq=False)
class Replay:
    """Gaps of every log of a campaign: RMS of (measured - simulated)/sigma; 1 is the
    noise floor.
    """

    campaign: Campaign
    logs: dict[str, dict[str, Any]]  # log: {"gap", "channels", "blocks": {block: {"gap", "floor"}}}

    @property
    def channels(self) -> pd.DataFrame:
        """Gap of the whole plant: one row per log; columns: `gap`, then the eight channels."""
        rows = {name: {"gap": e["gap"], **e["channels"]} for name, e in self.logs.items()}
        return pd.DataFrame.from_dict(rows, orient="index", columns=["gap", *MEASURED])

    @property
    def blocks(self) -> pd.DataFrame:
        """Gap and floor of each block fed with measured signals; columns: log, block,
        gap, floor.
        """
        rows = [
            (log, block, gap["gap"], gap["floor"])
            for log, entry in self.logs.items()
            for block, gap in entry["blocks"].items()
        ]
        return pd.DataFrame(rows, columns=["log", "block", "gap", "floor"])

    def as_json(self) -> dict[str, Any]:
        """The JSON of `pneugantry replay`, "replay/1"."""
        notes = {"notes": self.campaign.notes} if self.campaign.notes else {}
        return {"schema": "replay/1", "logs": self.logs, **notes}

    def _repr_html_(self) -> str:
        table = self.channels
        rows = ((str(log), *values) for log, values in zip(table.index, table.values, strict=True))
        return html_page(
            f"gap of {self.campaign.name}", html_table(("log", *map(str, table.columns)), rows)
        )


def replay(
    source: CampaignSource,
    *,
    setup: Mapping[str, Any] | None = None,
    fmu: FmuSource = None,
) -> Replay:
    """Replays measured logs on the FMU by their recorded commands, the whole plant and by block.

    source: a campaign folder, a log file, a `Log`, or a pandas table with a log's columns; setup:
    how a single log was taken (keys as in campaign.toml). Raises InputError naming file, column and
    hint.
    """
    campaign = campaign_from(source, setup)
    logs: dict[str, dict[str, Any]] = {}
    file = fmu_from(fmu)
    with Replayer(file) as plant, BlockReplayer(file) as blocks:
        for name, logged in bar(campaign.logs.items(), len(campaign.logs), "replay"):
            simulated = plant.simulate(logged)
            gaps = channel_gaps(logged.log.measured(), simulated)
            logs[name] = {
                "gap": gaps.gap,
                "channels": gaps.channels,
                "blocks": blocks.gaps(logged, noisy_copy(logged, simulated)),
            }
    return Replay(campaign, logs)


@dataclass(frozen=True, eq=False)
class IdentifiedPlant:
    """What the logs of a campaign say of the plant's parameters."""

    found: Identification
    seconds: float

    @property
    def parameters(self) -> pd.DataFrame:
        """One row per parameter of the FMU: value, 95 % interval (NaN where the logs do not tell),
        unit, the plant sheet's value, why not.
        """
        rows = {}
        for name, entry in self.as_json()["parameters"].items():
            low, high = entry["ci95"] or (float("nan"), float("nan"))
            rows[name] = {
                "value": entry["value"],
                "low": low,
                "high": high,
                "unit": entry["unit"],
                "plant_sheet": entry["plant_sheet"],
                "why_not": entry["why_not"] or "",
            }
        return pd.DataFrame.from_dict(rows, orient="index")

    def as_json(self) -> dict[str, Any]:
        """The JSON of `pneugantry identify`, "identify/1"."""
        from pneugantry.analysis.identify.report import as_json

        return as_json(self.found, self.seconds)

    def _repr_html_(self) -> str:
        table = self.parameters
        rows = ((str(name), *row) for name, row in zip(table.index, table.values, strict=True))
        heads = ("parameter", *map(str, table.columns))
        return html_page(f"parameters from {self.found.campaign.name}", html_table(heads, rows))


def identify(
    source: CampaignSource,
    *,
    setup: Mapping[str, Any] | None = None,
    fmu: FmuSource = None,
    say: Callable[[str], None] | None = None,
) -> IdentifiedPlant:
    """Plant parameters with 95 % intervals from measured logs, by the thesis' tests and by one fit.

    Arguments as of `replay`; say: told the name of each stage. Raises InputError naming file,
    column and hint.
    """
    from pneugantry.analysis.identify.identification import identify as identified

    began = time.perf_counter()
    campaign = long_enough(campaign_from(source, setup), "an identification")
    found = identified(campaign, fmu_from(fmu), say or (lambda _: None))
    return IdentifiedPlant(found, time.perf_counter() - began)
