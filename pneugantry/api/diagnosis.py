"""The diagnosis of a campaign, or of a plant of one's own, as a function with a typed result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from modelica_fmu.errors import InputError
from pneugantry.api.html import html_page, html_table
from pneugantry.api.inputs import CampaignSource, FmuSource, PathLike, campaign_from, fmu_from
from pneugantry.report.headline import cause_name

if TYPE_CHECKING:
    from pneugantry.diagnosis.diagnose import Diagnosis as GantryDiagnosis
    from pyfmi_runner.fmu import FmuFile

__all__ = ["Diagnosis", "Gap", "diagnose"]

Say = Callable[[str], None]


@dataclass(frozen=True)
class Gap:
    """Misfit of a log that no fit has seen: RMS of (measured - simulated)/sigma."""

    nominal: float
    augmented: float  # with the causes added
    floor: float  # what noise alone leaves
    shrink: float  # 1 - (augmented^2 - floor^2)/(nominal^2 - floor^2)


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Where plant and model differ, which effects cause it, how far the gap shrinks with them."""

    json: dict[str, Any]  # "gap/1", as `pneugantry diagnose --json` writes it
    gantry: GantryDiagnosis | None = None  # None for a plant of one's own
    fmu: FmuFile | None = None

    @property
    def verdict(self) -> str:
        """ "identified", "ambiguous", "unknown" or "none"."""
        return str(self.json["verdict"])

    @property
    def where(self) -> pd.DataFrame:
        """Blocks by their share of the gap: block, share, logs, regime."""
        return pd.DataFrame(self.json["where"], columns=["block", "share", "logs", "regime"])

    @property
    def causes(self) -> pd.DataFrame:
        """One row per fitted parameter of a cause: effect, axis, probability, parameter, value, low
        and high (95 %), unit.
        """
        heads = ["effect", "axis", "probability", "parameter", "value", "low", "high", "unit"]
        rows = []
        for cause in self.json["causes"]:
            named = (cause["effect"], cause["axis"], cause["probability"])
            for parameter, p in cause["parameters"].items() or [("", None)]:
                fitted = (p["value"], *p["ci95"], p["unit"]) if p else (None, None, None, "")
                rows.append((*named, parameter, *fitted))
        return pd.DataFrame(rows, columns=heads)

    @property
    def answer_set(self) -> list[list[str]]:
        """The smallest set of hypotheses that together hold 95 % probability."""
        return [list(keys) for keys in self.json["answer_set"]]

    @property
    def gap(self) -> Gap | None:
        """Of the held-out log; None where it could not be replayed."""
        found = self.json["gap"]
        return found and Gap(**{key: found[key] for key in Gap.__dataclass_fields__})

    def write_html(self, path: PathLike) -> Path:
        """The report as one self-contained page. Raises InputError for a plant of one's own, which
        has no page yet.
        """
        if self.gantry is None:
            raise InputError(
                "the page shows the gantry",
                field="--html",
                hint="use --json for a plant of your own",
            )
        from pneugantry.diagnosis.report import write_report

        return write_report(self.gantry, Path(path), self.fmu)

    def write_augmented(self, folder: PathLike) -> tuple[Path, Path]:
        """The plant with the causes added, as Modelica and as FMU; returns both paths."""
        if self.gantry is None or self.fmu is None:
            raise InputError(
                "is for the gantry", field="--augmented", hint="leave it out for your own plant"
            )
        from pneugantry.diagnosis.augmented import write_augmented

        remarks = [
            f"{cause_name(cause)}: probability {cause['probability']:.2f}"
            for cause in self.json["causes"]
        ]
        return write_augmented(Path(folder), self.fmu, self.gantry.values, remarks)

    def _repr_html_(self) -> str:
        shares = html_table(
            ("block", "share", "regime"),
            ((w["block"], w["share"], w["regime"]) for w in self.json["where"]),
        )
        table = self.causes
        causes = html_table(list(table.columns), table.itertuples(index=False, name=None))
        gap = self.gap
        said = (
            f"<p>gap {gap.nominal:.3g} &rarr; {gap.augmented:.3g} times the noise, shrink "
            f"{gap.shrink:.3f}</p>"
            if gap
            else ""
        )
        return html_page(f"verdict: {self.verdict}", shares, causes, said)


def diagnose(
    source: CampaignSource,
    *,
    setup: Mapping[str, Any] | None = None,
    controller: PathLike | None = None,
    catalogue: PathLike | None = None,
    fmu: FmuSource = None,
    workers: int = 2,
    say: Say | None = None,
) -> Diagnosis:
    """Where a measured campaign and the model differ, which effects cause it, and how far the gap
    shrinks with them.

    source: a campaign folder, a log file, a `Log`, a pandas table with a log's columns, or the TOML
    description of a plant of one's own. setup: how a single log was taken (keys as in
    campaign.toml). controller: the rig's own, a Python file, for the closed-loop check. catalogue:
    effects of one's own, a file or a folder. workers: processes. say: told the name of each stage.
    Raises InputError naming file, field and hint.
    """
    from pneugantry.diagnosis.diagnose import diagnose as diagnose_gantry
    from pneugantry.diagnosis.diagnose import report_json
    from pneugantry.diagnosis.own_plant import is_own_plant
    from pneugantry.diagnosis.usable import long_enough
    from pneugantry.engine.catalogue import read_catalogue
    from pyfmi_runner.campaign import with_controller

    if isinstance(source, str | Path) and is_own_plant(Path(source)):
        return _diagnose_own(Path(source), catalogue, fmu, say)
    effects = read_catalogue(None if catalogue is None else Path(catalogue))
    campaign = long_enough(campaign_from(source, setup, strict=False))
    if controller is not None:
        campaign = with_controller(campaign, Path(controller))
    for note in campaign.notes:
        if say is not None and "pneugantry log init" in note:
            say(f"note: {note}")  # before the answer that rests on it
    gantry = fmu_from(fmu)
    found = diagnose_gantry(campaign, gantry, effects, say, workers)
    return Diagnosis(report_json(found), found, gantry)


def _diagnose_own(
    description: Path, catalogue: PathLike | None, fmu: FmuSource, say: Say | None
) -> Diagnosis:
    """A plant of one's own with a catalogue of one's own."""
    from pneugantry.diagnosis.own_diagnose import diagnose_own, own_json
    from pneugantry.diagnosis.own_plant import read_own_plant
    from pneugantry.engine.catalogue import read_catalogue
    from pyfmi_runner.fmu import FmuFile

    path = fmu.path if isinstance(fmu, FmuFile) else None if fmu is None else Path(fmu)
    plant = read_own_plant(description, path)
    source = catalogue or plant.catalogue
    if source is None:
        hint = "write catalogue = ..., or give --catalogue"
        raise InputError("names no catalogue", file=description, field="plant", hint=hint)
    return Diagnosis(own_json(diagnose_own(plant, read_catalogue(Path(source)), say)))
