"""Front end: a Modelica file and libraries → a flat model (ir.py); what is refused names file and
line.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from modelica_fmu.ir import FlatModel

__all__ = ["flatten"]


def flatten(
    path: Path | None,
    class_name: str,
    libraries: Sequence[Path] = (),
    fixed: frozenset[str] = frozenset(),
) -> FlatModel:
    """Flattens `class_name` of the file `path`; further classes come from the libraries. `fixed`:
    parameters that become constants.

    Raises InputError with file and line for what is no Modelica or is not supported.
    """
    from modelica_fmu.modelica.flat import flat_model

    return flat_model(path, class_name, libraries, fixed)
