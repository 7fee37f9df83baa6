"""The effects that a gantry may have."""

from __future__ import annotations

from pathlib import Path

from pneugantry.engine.catalogue import Effect, read_catalogue

__all__ = ["FOLDER", "QUANTISATION", "catalogue_of"]

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
