"""`pneugantry build`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from modelica_fmu.toolchain import PLATFORMS
from pneugantry.listening import logged
from pneugantry.options import out_folder
from pneugantry.progress import Stages
from pyfmi_runner.plant import DEFAULT_CLASS

HELP = """Compile a Modelica class, or a controller, to an FMU (co-simulation and model exchange
in one).

Rebuilds only if the Modelica file, the compiler or the platforms have changed.

  pneugantry build                                       the gantry, FMI 2.0, this machine
  pneugantry build --fmi 3.0
  pneugantry build --class PneuGantry.Valve              one block
  pneugantry build --library Modelica --class Modelica.Blocks.Examples.PID_Controller
  pneugantry build --controller pi_fv  a controller, sampled at 1 ms: a loop of two FMUs
  pneugantry build --platform linux64 --platform win64   needs the extra [zig]
  pneugantry build --parts              what a diagnosis of the gantry runs, too: no later one waits
  pneugantry build --parts plant.toml   of a plant of your own, or of a campaign's channels"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--model",
        metavar="FILE.mo",
        type=Path,
        help="Modelica file (default: models/PneuGantry.mo)",
    )
    command.add_argument(
        "--class",
        dest="class_name",
        metavar="NAME",
        default=DEFAULT_CLASS,
        help="class to compile (default: %(default)s)",
    )
    command.add_argument(
        "--controller",
        metavar="NAME",
        help="controller to export instead of a class; `pneugantry list controllers` names them",
    )
    command.add_argument(
        "--fmi", choices=("2.0", "3.0"), default="2.0", help="FMI version (default: %(default)s)"
    )
    platforms = (
        f"platform of the binary, may be repeated (default: this machine): "
        f"{', '.join(p.fmi3 for p in PLATFORMS)}"
    )
    command.add_argument("--platform", action="append", metavar="NAME", help=platforms)
    command.add_argument(
        "--out",
        metavar="DIR",
        type=out_folder,
        help="folder of the FMU (default: the user's cache)",
    )
    command.add_argument(
        "--library",
        action="append",
        metavar="DIR",
        type=Path,
        help="folder of a package, may be repeated; those of $MODELICAPATH come behind",
    )
    command.add_argument(
        "--parts",
        nargs="?",
        const="",
        metavar="CAMPAIGN_OR_PLANT",
        help="compile the parts of the model that a diagnosis runs, too (default: of the gantry "
        "with all its channels); else the first one that needs a part makes it",
    )
    command.add_argument("--force", action="store_true", help="build even if nothing has changed")


def _check(options: argparse.Namespace) -> None:
    """Raises InputError for what is of one FMU beside --parts."""
    for option in ("model", "controller", "library"):
        if options.parts is not None and getattr(options, option) is not None:
            hint = "leave it out: a plant of your own is named behind --parts"
            raise InputError("is not for --parts", field=f"--{option}", hint=hint)


def _parts(source: str) -> int:
    """Parts that were made; of the gantry where no source is named."""
    from pneugantry.api.diagnosis import compile_parts

    with Stages("build", "parts") as say:
        return compile_parts(source or None, say=say)


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from modelica_fmu import Target
    from pneugantry.api import models

    _check(options)
    with (
        Stages("build", "binary", len(options.platform or [""])) as say,
        logged("modelica_fmu", say),
    ):
        built = models.build(
            options.class_name,
            model=options.model,
            controller=options.controller,
            libraries=options.library or (),
            target=Target(options.fmi, options.platform, options.force),
            out=options.out,
        )
    parts = None if options.parts is None else _parts(options.parts)
    print(f"{'built' if built.rebuilt else 'up to date'}: {built.path}")
    for platform, made in built.manifest["compilers"].items():
        glibc = f"; runs with glibc {made['glibc']} or newer" if "glibc" in made else ""
        print(f"  {platform}: {made['version']}{glibc}")
    if parts is None:
        return built.as_json(), 0
    print(
        f"parts of a diagnosis: {parts} compiled" if parts else "parts of a diagnosis: up to date"
    )
    return {**built.as_json(), "parts": parts}, 0
