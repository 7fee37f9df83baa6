"""Folders that the model of an answer goes into: refused before a diagnosis, where it has no model
to write or would replace a file that it reads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from modelica_fmu.errors import InputError
from modelica_fmu.files import refuse_replacing
from pneugantry.engine.hypotheses.catalogue import catalogue_files
from pneugantry.plants.calibration_file import files_of
from pneugantry.plants.gantry.catalogue import model_of
from pyfmi_runner.build import default_model
from pyfmi_runner.plant import DEFAULT_CLASS
from pyfmi_runner.scenario import parse_toml

__all__ = ["AUGMENTED", "CATALOGUE", "NO_SOURCE", "SET_BY_HAND", "Targets", "augmented_name"]

AUGMENTED, CATALOGUE = "--augmented", "--catalogue-out"
NO_SOURCE = "an FMU without source cannot be extended"
SET_BY_HAND = "set the fitted parameters of --json in the tool that made the FMU"


def augmented_name(class_name: str) -> str:
    """Of the class that extends another one with what was fitted."""
    return f"Augmented{class_name.rsplit('.', 1)[-1]}"


@dataclass(frozen=True)
class Targets:
    """augmented, catalogue: folders; None: not asked for. learns: whether a term may be learnt: the
    plant's own file is then written as well.
    """

    augmented: Path | None = None
    catalogue: Path | None = None
    learns: bool = True

    def check_described(self, description: Path, effects: Path | None = None) -> None:
        """Raises InputError for a plant of FMUs without source, and where a file of a description
        would be replaced. effects: read instead of the description's.
        """
        table = parse_toml(description)
        plant = table.get("plant")
        if not isinstance(plant, dict):
            return  # whoever reads it says so
        if "fmu" in table or "fmu" in plant:
            for folder, field in ((self.augmented, AUGMENTED), (self.catalogue, CATALOGUE)):
                if folder is not None:
                    raise InputError(NO_SOURCE, file=description, field=field, hint=SET_BY_HAND)
        model, class_name = str(plant.get("model", "")), str(plant.get("class", ""))
        self._check(Path(model).name, class_name, files_of(description, effects))

    def check_gantry(self, effects: Path | None = None, read: Sequence[Path] = ()) -> None:
        """Raises InputError where a file of the gantry would be replaced. effects: file or folder
        of the catalogue; read: what else is read.
        """
        model = model_of(effects) or default_model()
        files = [model, *read]
        files += [] if effects is None else catalogue_files(effects)
        self._check(model.name, DEFAULT_CLASS, files)

    def _check(self, model: str, class_name: str, read: Sequence[Path]) -> None:
        own = [model] if self.learns and model else []
        made = augmented_name(class_name)
        for folder, field, names in (
            (self.augmented, AUGMENTED, (f"{made}.mo", f"{made}.fmu", *own)),
            (self.catalogue, CATALOGUE, ("effects.toml", *own)),
        ):
            if folder is not None:
                for name in names:
                    refuse_replacing(folder / name, read, field)
