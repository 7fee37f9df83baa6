"""The effects that a gantry may have."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from modelica_fmu.errors import InputError
from pneugantry.engine.hypotheses.catalogue import Effect, check_nominal, read_catalogue
from pneugantry.engine.signals.sensors import PREFIX, neutral, signal_of
from pneugantry.plants.gantry.timing import DELAYS
from pyfmi_runner.build import default_model
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED

__all__ = ["FOLDER", "QUANTISATION", "catalogue_of", "check_names", "model_of"]

FOLDER = Path(__file__).parent / "effects"
# read off the readings themselves (`converter`): nothing of it is fitted
QUANTISATION = Effect("quantisation", "", "sensors", "a coarse converter", ())


def catalogue_of(source: Path | None = None) -> dict[str, Effect]:
    """The gantry's effects by key. source: a folder, whose effects stand instead of them, or a
    file, whose effects are added to them or replace those of the same name. Raises InputError.
    """
    if source is None:
        return read_catalogue(FOLDER)
    own = read_catalogue(source)
    return own if source.is_dir() else {**read_catalogue(FOLDER), **own}


def model_of(source: Path | None) -> Path | None:
    """The gantry's Modelica file that lies in a catalogue's folder, as `--catalogue-out` writes it:
    with the learnt terms that its effects name. None: there is none.
    """
    own = None if source is None else source / default_model().name
    return own if own is not None and own.is_file() else None


def check_names(catalogue: Mapping[str, Effect], fmu: FmuFile) -> None:
    """Raises InputError for an effect that names what the gantry does not have, or is a share of a
    value that is 0.
    """
    for effect in catalogue.values():
        for form in effect.forms:
            for name in (*form.settings, *(p.name for p in form.parameters)):
                if name.startswith(PREFIX):
                    known = name.count(".") >= 2 and signal_of(name) in MEASURED
                else:
                    known = name in fmu.variables or name in DELAYS
                if not known:
                    hint = "see `pneugantry list parameters`; a sensor's are as sensors.f_x.scale"
                    text = "the gantry has no such parameter"
                    raise InputError(text, field=f"{effect.key}: {name}", hint=hint)
            for p in form.parameters:
                own = fmu.variables.get(p.name)
                check_nominal(p, neutral(p.name) if own is None else own.start or 0.0, effect.key)
