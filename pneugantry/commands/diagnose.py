"""`pneugantry diagnose`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from modelica_fmu.errors import InputError
from pneugantry.engine.signals.units import with_unit
from pneugantry.options import out_file, out_folder
from pneugantry.progress import Stages, bar
from pneugantry.report.headline import (
    cause_name,
    chance,
    change_words,
    headline,
    interval,
    number,
    percent,
    shrinkable,
    verdict_word,
)

if TYPE_CHECKING:
    from pneugantry.api.diagnosis import Diagnosis

HELP = """Where the sim-to-real gap of a campaign lies, which effect causes it, and how far it
shrinks with that effect added.

Logs that cannot be used are left out and named. One log gives what one log can; the report says
what it cannot excite.

  pneugantry diagnose FOLDER --html report.html --json out.json
  pneugantry diagnose FOLDER --augmented out/
      the plant with the effect added, as Modelica and as FMU
  pneugantry diagnose LOG.parquet               a campaign of one
  pneugantry diagnose BEFORE --after AFTER
      two campaigns of one rig (or two descriptions of one plant): what came, went, stayed
  pneugantry diagnose plant.toml
      a plant of your own: FMU, logs and catalogue as that file says
  pneugantry diagnose FOLDER_OF_CAMPAIGNS
      each one (with a campaign.toml or a plant.toml): diagnosis.json and diagnosis.html beside
      it; the same command goes on

Where what no catalogue explains is likely (from one in five on), the term that the plant's
equations lack is looked for: where it enters, of which variable, in which form. With --augmented it
stands in the model. On a campaign of the gantry that takes one to two minutes more."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "campaign",
        metavar="CAMPAIGN_OR_LOG",
        help="folder with campaign.toml, one log, a plant.toml, or a folder of campaigns",
    )
    command.add_argument(
        "--after",
        metavar="CAMPAIGN_OR_LOG",
        help="a second campaign of the same rig, after a change: says which effect came, which "
        "went and which stayed",
    )
    command.add_argument(
        "--catalogue",
        metavar="FILE.toml",
        type=Path,
        help="effects of your own: a file with [[effect]] tables (beside the gantry's), or a "
        "folder (instead of them)",
    )
    command.add_argument(
        "--fmu",
        metavar="FILE.fmu",
        type=Path,
        help="an FMU of the gantry's model: its parameters are the nominal ones",
    )
    command.add_argument(
        "--augmented",
        metavar="FOLDER",
        type=out_folder,
        help="write the plant with the effect added: a Modelica file and its FMU",
    )
    command.add_argument(
        "--html", metavar="FILE", type=out_file, help="write the report, one self-contained page"
    )
    command.add_argument(
        "--controller",
        metavar="FILE.py",
        type=Path,
        help="the rig's own controller, for the closed-loop check; the file is run",
    )
    command.add_argument(
        "--catalogue-out",
        metavar="FOLDER",
        type=out_folder,
        help="write the learnt term as an effect beside those of the catalogue, and the model that "
        "has it as a parameter, for the next rig: of the gantry with --catalogue FOLDER",
    )
    command.add_argument(
        "--no-learn",
        action="store_true",
        help="do not look for the term that the catalogue lacks",
    )
    command.add_argument(
        "--workers",
        type=int,
        default=2,
        metavar="N",
        help="processes for a folder of campaigns (default: %(default)s)",
    )
    command.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="for a folder of campaigns: an existing Dask cluster that sees the same folder",
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.plants.campaigns import campaign_folders

    source = Path(options.campaign)
    if folders := campaign_folders(source):
        _check_many(folders, options)
        return _execute_many(folders, options)
    if options.scheduler is not None:
        raise InputError(
            "is for a folder of campaigns",
            field="--scheduler",
            hint="leave it out: one campaign is diagnosed here",
        )
    _check_targets(options)
    kind = "change" if options.after else _kind(source)
    with Stages("diagnose", kind) as say:
        found = _diagnosed(options, say)
    print_diagnosis(found.json)
    options.then = partial(_write_beside, found, options)
    return found.json, 0


def _check_targets(options: argparse.Namespace) -> None:
    """Refuses folders into which no model can go, or in which one would replace what is read."""
    from pneugantry.plants.described import is_plant_description
    from pneugantry.plants.targets import Targets

    if options.catalogue_out is not None:
        for option, given in (("--after", options.after), ("--no-learn", options.no_learn)):
            if given:
                text = f"writes a learnt term, and with {option} none is looked for"
                raise InputError(text, field="--catalogue-out", hint="leave one of them out")
    learns = not (options.no_learn or options.after)
    targets = Targets(options.augmented, options.catalogue_out, learns)
    sources = [Path(s) for s in (options.campaign, options.after) if s is not None]
    described = [s for s in sources if is_plant_description(s)]
    for source in described:
        targets.check_described(source, options.catalogue)
    if not described:
        read = [p for p in (options.fmu, options.controller) if p is not None]
        targets.check_gantry(options.catalogue, read)


def _write_beside(found: Diagnosis, options: argparse.Namespace) -> None:
    """Page, model and catalogue of an answer whose JSON is written."""
    if options.html is not None:
        print(f"report: {found.write_html(options.html)}")
    if options.augmented is not None:
        model, fmu = found.write_augmented(options.augmented)
        print(f"augmented plant: {model}, {fmu}")
    if options.catalogue_out is None:
        return
    if found.term is None:
        why = "was looked for" if found.learned is None else "was accepted"
        note = f"note: --catalogue-out: no missing term {why}, so none is written"
        print(f"{note} to {options.catalogue_out}", file=sys.stderr)
        return
    effects, base = found.write_catalogue(options.catalogue_out)
    print(f"catalogue with the learnt term: {effects}, for the model {base}")


def _diagnosed(options: argparse.Namespace, say: Callable[[str], None]) -> Diagnosis:
    """One campaign, or two of one rig."""
    from pneugantry.api import diagnosis

    rest = {
        "controller": options.controller,
        "catalogue": options.catalogue,
        "fmu": options.fmu,
        "say": say,
    }
    if options.after is not None:
        return diagnosis.diagnose_change(options.campaign, options.after, **rest)
    found = diagnosis.diagnose(options.campaign, **rest)
    return found if options.no_learn else found.with_missing_term(say)


def _kind(source: Path) -> str:
    """What is diagnosed: each kind takes a time of its own."""
    return "campaign" if source.is_dir() else "plant" if source.suffix == ".toml" else "log"


def _check_many(folders: list[Path], options: argparse.Namespace) -> None:
    """Refuses what is not for each campaign of a folder."""
    from pneugantry.plants.campaigns import is_described

    for option, value, hint in (
        ("--after", options.after, "give two campaigns"),
        ("--html", options.html, "leave it out; each campaign gets a diagnosis.html beside it"),
        ("--augmented", options.augmented, "diagnose that campaign by itself"),
        ("--catalogue-out", options.catalogue_out, "diagnose that campaign by itself"),
    ):
        if value is not None:
            raise InputError("is for one campaign", field=option, hint=hint)
    own = next((f for f in folders if is_described(f)), None)
    for option, value in (("--fmu", options.fmu), ("--controller", options.controller)):
        if own is not None and value is not None:
            hint = f"{own.name} has a plant of its own: diagnose that one by itself"
            raise InputError("is for the gantry", field=option, hint=hint)


def _execute_many(folders: list[Path], options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    """A folder of campaigns, in worker processes."""
    from pneugantry.api.inputs import fmu_from
    from pneugantry.plants.campaigns import Diagnoser, diagnose_campaigns
    from pneugantry.plants.gantry.catalogue import catalogue_of
    from pyfmi_runner.controller_file import read_controller

    catalogue_of(options.catalogue)  # refused here, not by every worker
    gantry = None if options.fmu is None else fmu_from(options.fmu)
    if options.controller is not None:
        read_controller(options.controller)
    counter = bar(range(len(folders)), len(folders), "diagnose")
    results = diagnose_campaigns(
        folders,
        Diagnoser(
            None if gantry is None else gantry.path,
            options.catalogue,
            strict=False,
            pages=True,
            learn=not options.no_learn,
            controller=options.controller,
        ),
        workers=options.workers,
        scheduler=options.scheduler,
        done=lambda _: next(counter, None),
    )
    for folder, found in results.items():
        causes = " + ".join(cause_name(c) for c in found["causes"])
        shrink = f", shrink {found['gap']['shrink']:.3f}" if found["gap"] and causes else ""
        reason = f": {found['reason']}" if "reason" in found else ""
        print(f"{folder.name}: {found['verdict']}{' ' if causes else ''}{causes}{shrink}{reason}")
    failed = sum(found["verdict"] == "failed" for found in results.values())
    return {
        "schema": "gaps/1",
        "campaigns": {folder.name: found for folder, found in results.items()},
    }, int(failed == len(results))


def print_diagnosis(found: dict[str, Any]) -> None:
    """The diagnosis in a few lines: the headline that the page has too, then what it rests on."""
    for note in dict.fromkeys(found.get("notes", [])):
        print(f"note: {note}")
    print(f"verdict: {verdict_word(found)}")
    print(headline(found))
    for line in change_words(found):
        print(line)
    for entry in found["where"]:
        logs = f"  {', '.join(entry['logs'])}" if entry["logs"] else ""
        print(
            f"where: {entry['block']:<11} {percent(entry['share'])}{logs}"
            + (f"; {entry['regime']}" if entry["regime"] else "")
        )
    for cause in found["causes"]:
        print(f"cause: {cause_name(cause):<22} probability {chance(cause['probability'])}")
        for parameter, entry in cause["parameters"].items():
            value, low, high = interval(entry["value"], *entry["ci95"])
            size = with_unit(value, entry["unit"])
            print(f"         {parameter} = {size}, 95 % from {low} to {high}")
    if found["answer_set"]:
        answers = (" + ".join(keys) or "no effect" for keys in found["answer_set"])
        print("answer set (95 %): " + "; or ".join(answers))
    _print_gap("gap", found["gap"])
    _print_gap("closed loop", found["closed_loop"])
    if found.get("next_experiment"):
        print(f"next experiment: {found['next_experiment']['what']}")
    if found.get("learned"):
        print(found["learned"]["sentence"])
    print(f"seconds: {found['seconds']:.1f}")


def _print_gap(what: str, entry: dict[str, Any] | None) -> None:
    if not entry:
        return
    log = f" of {entry['log']}" if "log" in entry else ""
    ends = f" [{entry['ci95'][0]:.3f}, {entry['ci95'][1]:.3f}]" if "ci95" in entry else ""
    shrink = f"shrink {entry['shrink']:.3f}{ends}" if shrinkable(entry) else "nothing to shrink"
    print(
        f"{what}{log}: nominal {number(entry['nominal'])}, augmented "
        f"{number(entry['augmented'])}, floor {number(entry['floor'])}; {shrink}"
    )
