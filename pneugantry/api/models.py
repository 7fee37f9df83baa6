"""FMUs built, and their linear models as python-control objects."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from modelica_fmu import PLAIN, ClassSource, Target
from modelica_fmu.errors import InputError
from pneugantry.api.html import html_page, html_table
from pneugantry.api.inputs import FmuSource, PathLike, fmu_from
from pyfmi_runner.build import build_controller_fmu, build_source, default_model
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.plant import COMMANDS, DEFAULT_CLASS, OUTPUTS, TASK

if TYPE_CHECKING:
    import control

    from pneugantry.analysis.operating_point import OperatingPoint
    from pneugantry.analysis.root_locus import RootLocus

__all__ = ["BuiltFmu", "build", "linearize", "rootlocus"]


@dataclass(frozen=True)
class BuiltFmu:
    """An FMU on disk, and what it was built from."""

    path: Path
    manifest_path: Path
    rebuilt: bool  # False: it was up to date

    @property
    def manifest(self) -> dict[str, Any]:
        """Sources' hashes, compilers and flags."""
        return dict(json.loads(self.manifest_path.read_text(encoding="utf-8")))

    def read(self) -> FmuFile:
        """The FMU, described and checked."""
        return FmuFile.read(self.path)

    def session(self, parameters: Mapping[str, float] | None = None) -> FmuSession:
        """An instance to step sample by sample; use it in a `with`."""
        return FmuSession(self.read(), parameters=parameters or {})

    def as_json(self) -> dict[str, Any]:
        """The JSON of `pneugantry build`, "build/1"."""
        return {
            "schema": "build/1",
            "fmu": str(self.path),
            "manifest": str(self.manifest_path),
            "rebuilt": self.rebuilt,
        }

    def _repr_html_(self) -> str:
        rows = [
            (platform, made["version"]) for platform, made in self.manifest["compilers"].items()
        ]
        return html_page(self.path.name, html_table(("platform", "compiler"), rows))


def build(
    class_name: str = DEFAULT_CLASS,
    *,
    model: PathLike | None = None,
    controller: str | None = None,
    libraries: Sequence[PathLike] = (),
    target: Target = PLAIN,
    out: PathLike | None = None,
) -> BuiltFmu:
    """Compiles a Modelica class to an FMU; what is up to date is not built again.

    class_name: a class of the Modelica file `model` (None: the gantry's). controller: a controller
    of the catalogue, compiled instead of a class. libraries: package folders with classes that it
    uses; without a model, the class is one of theirs. target: what it is built for, as
    `pg.Target(fmi="3.0", platforms=["x86_64-linux"])`. out: a folder; None: the user's cache.
    Raises InputError naming file, line and hint.
    """
    folder = None if out is None else Path(out)
    if controller is not None:
        made = build_controller_fmu(controller, target, folder)
    else:
        file = Path(model) if model is not None else None if libraries else default_model()
        source = ClassSource(class_name, file, libraries=[Path(one) for one in libraries])
        made = build_source(source, target, folder)
    return BuiltFmu(made.path, made.manifest, made.rebuilt)


def linearize(
    point: str | OperatingPoint = "contact_sliding",
    *,
    inputs: Sequence[str] = COMMANDS,
    outputs: Sequence[str] = (*OUTPUTS, *TASK),
    parameters: Mapping[str, float] | None = None,
    fmu: FmuSource = None,
) -> control.StateSpace:
    """The FMU as a continuous `control.StateSpace` at an operating point, from its own derivatives.

    point: `axis_contact`, `contact_stuck`, `contact_sliding`, `free_sliding`, or one of one's own.
    inputs: inputs or states of the FMU; outputs: outputs or local variables. Units are the FMU's
    (SI). Raises InputError for names that the FMU lacks.
    """
    from pneugantry.analysis.gantry_points import POINTS
    from pneugantry.analysis.linearise import linearise

    file = fmu_from(fmu)
    if isinstance(point, str):
        if point not in POINTS:
            hint = f"use one of {', '.join(POINTS)}"
            raise InputError(f"unknown point {point!r}", field="point", hint=hint)
        point = POINTS[point](file, parameters=dict(parameters or {}))
    return linearise(file, point, list(inputs), list(outputs))


def rootlocus(
    axis: str = "z",
    *,
    lag: str | float = "own",
    delay: float = 0.0,
    angle: float | None = None,
    parameters: Mapping[str, float] | None = None,
    fmu: FmuSource = None,
) -> RootLocus:
    """Poles, zeros, stability limits and margins of an axis' force loop, linearised from the FMU.

    lag: of the valve, "own", "none", "x", "z", or seconds; delay: of the command [s]; angle: slope
    of the edge [degrees]. The plant itself, a `control.StateSpace`, is the result's `loop.plant`.
    """
    from pneugantry.analysis.force_loop import force_loop
    from pneugantry.analysis.root_locus import root_locus

    slope = None if angle is None else math.radians(angle)
    file = fmu_from(fmu)
    return root_locus(force_loop(file, axis, lag, delay=delay, angle=slope, parameters=parameters))
