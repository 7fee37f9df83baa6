"""The diagnosis of a campaign, or of a plant of one's own, as a function with a typed result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from modelica_fmu.errors import InputError
from modelica_fmu.files import refuse_replacing
from pneugantry.api.html import html_page, html_table
from pneugantry.api.inputs import CampaignSource, FmuSource, PathLike, campaign_from, fmu_from
from pneugantry.engine.rules import Rules

if TYPE_CHECKING:
    from pneugantry.engine.run import Found
    from pneugantry.learn.learned import Learned
    from pyfmi_runner.campaign import Campaign
    from pyfmi_runner.fmu import FmuFile

__all__ = ["Diagnosis", "Gap", "compile_parts", "diagnose", "diagnose_change"]

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
    found: Found  # how it was found
    campaign: Campaign | None = None  # of the gantry; None for a plant of one's own
    fmu: FmuFile | None = None
    learned: Learned | None = None  # what the catalogue lacks; None: it was not looked for
    rules: Rules = field(default_factory=Rules)  # thresholds that it was made with

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

    @property
    def term(self) -> Learned | None:
        """What was learnt and is accepted; None: nothing."""
        learned = self.learned
        accepted = learned is not None and learned.accepted and learned.after is not None
        return learned if accepted else None

    def write_html(self, path: PathLike) -> Path:
        """The report as one self-contained page."""
        from pneugantry.plants.gantry.page import extras_of
        from pneugantry.report.page import Extras, write_page

        extras = Extras() if self.campaign is None else extras_of(self.campaign, self.found)
        extras = replace(extras, learned=self.json.get("learned"), rules=self.rules)
        return write_page(self.found, Path(path), extras)

    def write_augmented(self, folder: PathLike) -> tuple[Path, Path]:
        """The plant with the causes added, and with the term that was learnt where it is accepted,
        as Modelica and as FMU; returns both paths. Raises InputError for a plant of FMUs without
        source, and where the plant's own file would be replaced.
        """
        found, term = self.found, self.term
        if term is not None and term.after is not None:
            own, found = term.before.task.plant.model, term.after
            refuse_replacing(Path(folder) / found.task.plant.model.name, [own], "--augmented")
        if self.fmu is None:
            from pneugantry.plants.described import write_augmented as write_described

            return write_described(Path(folder), found, with_base=term is not None)
        return self._write_augmented_gantry(Path(folder), found, self.fmu)

    def _write_augmented_gantry(
        self, folder: Path, found: Found, fmu: FmuFile
    ) -> tuple[Path, Path]:
        from pneugantry.plants.gantry.augmented import write_augmented
        from pyfmi_runner.build import build_fmu, default_model
        from pyfmi_runner.fmu import FmuFile

        plant = found.task.plant
        if self.term is not None:
            fmu = FmuFile.read(build_fmu(plant.class_name, plant.model).path)
        remarks = [f"{c.key}: probability {c.probability:.2f}" for c in found.diagnosis.causes]
        values = {**plant.parameters, **found.values}
        own = None if plant.model == default_model() else plant.model
        return write_augmented(folder, fmu, values, remarks, own)

    def with_missing_term(self, say: Say | None = None) -> Diagnosis:
        """The same with the term that the plant's equations lack, looked for where what no
        catalogue has is likely enough, or an answer may stand in for it, in a plant with Modelica
        source; else unchanged. say: told the name of each stage.
        """
        from pneugantry.plants.missing_term import to_json, with_missing_term

        say = say or (lambda stage: None)
        found, term = with_missing_term(self.found, self.rules, self.campaign, say)
        if term is None:
            return self
        return replace(self, json=to_json(found, term), found=found, learned=term)

    def write_catalogue(self, folder: PathLike) -> tuple[Path, Path]:
        """A catalogue with the learnt term as an effect, and the Modelica file that has it as a
        parameter; returns both paths. Raises InputError where no term was accepted, and where the
        plant's own file would be replaced.
        """
        from pneugantry.learn.answer.export import write_catalogue

        if self.learned is None:
            hint = "it is where what no catalogue has is likely, in a plant with Modelica source"
            raise InputError("no missing term was looked for", field="--catalogue-out", hint=hint)
        return write_catalogue(Path(folder), self.learned)

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
    say: Say | None = None,
) -> Diagnosis:
    """Where a measured campaign and the model differ, which effects cause it, and how far the gap
    shrinks with them.

    source: a campaign folder, a log file, a `Log`, a pandas table with a log's columns, or the TOML
    description of a plant of one's own. setup: how a single log was taken (keys as in
    campaign.toml). controller: the rig's own, a Python file, for the closed-loop check. catalogue:
    effects of one's own, a file (beside the gantry's) or a folder (instead of them). fmu: the
    nominal gantry with other parameters. say: told the name of each stage. Where something may
    be unknown, `with_missing_term` of the result looks for what the equations lack. Raises
    InputError naming file, field and hint.
    """
    from pneugantry.engine.answer.result import to_json
    from pneugantry.plants.described import is_plant_description
    from pneugantry.plants.gantry.catalogue import catalogue_of, model_of
    from pneugantry.plants.gantry.diagnosis import diagnose as diagnose_gantry
    from pneugantry.plants.gantry.nominal import Nominal

    say = say or (lambda stage: None)
    if isinstance(source, str | Path) and is_plant_description(Path(source)):
        _no_gantry(fmu, controller)
        return _diagnose_described(Path(source), catalogue, say)
    own = None if catalogue is None else Path(catalogue)
    effects, model = catalogue_of(own), model_of(own)
    campaign = _campaign(source, setup, controller, say)
    given = None if fmu is None else fmu_from(fmu)
    found = diagnose_gantry(campaign, effects, nominal=Nominal(given, model), say=say)
    return Diagnosis(to_json(found.diagnosis), found, campaign, given or _gantry(model))


def diagnose_change(
    before: CampaignSource,
    after: CampaignSource,
    *,
    controller: PathLike | None = None,
    catalogue: PathLike | None = None,
    fmu: FmuSource = None,
    say: Say | None = None,
) -> Diagnosis:
    """What came, what went and what stayed between two campaigns of one rig: `json["changes"]`
    beside what `diagnose` tells; gap and augmented plant are those after the change.

    before, after: sources of one kind, as of `diagnose`; of two descriptions the first tells
    catalogue and tolerance. Other arguments and errors as of `diagnose`.
    """
    from pneugantry.engine.answer.result import to_json
    from pneugantry.plants.described import is_plant_description
    from pneugantry.plants.gantry.catalogue import catalogue_of, model_of
    from pneugantry.plants.gantry.diagnosis import both
    from pneugantry.plants.gantry.diagnosis import diagnose as diagnose_gantry
    from pneugantry.plants.gantry.nominal import Nominal

    say = say or (lambda stage: None)
    described = [
        isinstance(s, str | Path) and is_plant_description(Path(s)) for s in (before, after)
    ]
    if isinstance(after, str | Path) and not Path(after).exists():
        hint = "name a campaign's folder or a plant's description"
        raise InputError("there is no such campaign", file=Path(after), field="--after", hint=hint)
    if described[0] != described[1]:
        hint = "give two campaigns of the gantry, or two descriptions of one plant"
        raise InputError("is of another kind than the campaign before", field="--after", hint=hint)
    own = None if catalogue is None else Path(catalogue)
    if all(described):
        _no_gantry(fmu, controller)
        return _described_change((Path(str(before)), Path(str(after))), own, say)
    campaigns = [_campaign(source, None, controller, say) for source in (before, after)]
    given = None if fmu is None else fmu_from(fmu)
    effects, nominal = catalogue_of(own), Nominal(given, model_of(own))
    found = diagnose_gantry(campaigns[0], effects, nominal=nominal, say=say, after=campaigns[1])
    gantry = given or _gantry(nominal.model)
    return Diagnosis(to_json(found.diagnosis), found, both(*campaigns), gantry)


def compile_parts(
    source: CampaignSource | None = None,
    *,
    catalogue: PathLike | None = None,
    say: Say | None = None,
) -> int:
    """Compiles what a diagnosis of a campaign runs, ahead of it; returns how many parts were made.

    source, catalogue: as of `diagnose`; None: the gantry with all its channels. say: told what is
    being made. A plant of FMUs without source has no parts. Raises InputError as `diagnose` does.
    """
    from pneugantry.engine.parts import compile_parts as compiled
    from pneugantry.plants.described import described_task, is_plant_description
    from pneugantry.plants.gantry.any_campaign import any_campaign
    from pneugantry.plants.gantry.catalogue import catalogue_of, model_of
    from pneugantry.plants.gantry.diagnosis import task_of

    say, rules = say or (lambda stage: None), Rules()
    own = None if catalogue is None else Path(catalogue)
    if isinstance(source, str | Path) and is_plant_description(Path(source)):
        read, task = described_task(Path(source), own)
        return compiled(task, read.rules, say)
    campaign = any_campaign() if source is None else _campaign(source, None, None, say)
    return compiled(task_of(campaign, catalogue_of(own), rules, model=model_of(own)), rules, say)


def _gantry(model: Path | None) -> FmuFile:
    """The FMU of the gantry's model."""
    from pyfmi_runner.build import build_fmu
    from pyfmi_runner.fmu import FmuFile

    return FmuFile.read(build_fmu(model=model).path)


def _campaign(
    source: CampaignSource,
    setup: Mapping[str, Any] | None,
    controller: PathLike | None,
    say: Say,
) -> Campaign:
    """Of the gantry, as read; what an answer rests on is said."""
    from pyfmi_runner.campaign import DRIVEN, with_controller

    campaign = campaign_from(source, setup, strict=False, needs=DRIVEN)
    if controller is not None:
        campaign = with_controller(campaign, Path(controller))
    for note in campaign.notes:
        if "pneugantry log init" in note:
            say(f"note: {note}")  # before the answer that rests on it
    return campaign


def _described_change(paths: tuple[Path, Path], catalogue: Path | None, say: Say) -> Diagnosis:
    """Two campaigns of a plant of one's own."""
    from pneugantry.engine.answer.result import to_json
    from pneugantry.plants.changed import diagnose_change as diagnose_described

    found, rules = diagnose_described(*paths, catalogue, say=say)
    return Diagnosis(to_json(found.diagnosis), found, rules=rules)


def _no_gantry(fmu: FmuSource, controller: PathLike | None) -> None:
    """Refuses what a plant of one's own has no use for."""
    if fmu is not None:
        hint = "name the model or the FMUs in the description"
        raise InputError("is for the gantry", field="--fmu", hint=hint)
    if controller is not None:
        hint = "leave it out: only the gantry's loop is run again"
        raise InputError("is for the gantry", field="--controller", hint=hint)


def _diagnose_described(description: Path, catalogue: PathLike | None, say: Say) -> Diagnosis:
    """A plant of one's own with a catalogue of one's own."""
    from pneugantry.engine.answer.result import to_json
    from pneugantry.plants.described import diagnose_described

    own = None if catalogue is None else Path(catalogue)
    found, rules = diagnose_described(description, own, say=say)
    return Diagnosis(to_json(found.diagnosis), found, rules=rules)
