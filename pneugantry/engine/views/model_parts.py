"""Parts of a plant's model and its structure, made once and kept."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from modelica_fmu.batch import Part, build_part, part_key, read_part
from modelica_fmu.compiled import Structure
from modelica_fmu.files import write_atomically
from pneugantry.engine.plant import Plant
from pneugantry.engine.views.view import Values

__all__ = ["known_variables", "longest_step", "part_of", "structure_of"]

STEPS = 50  # within a row that the solver's longest step asks for; a part gives up beyond 100


def longest_step(period: float, usual: float = 1e-3) -> float:
    """Of the solver, s: its tolerance bounds the error, and rows of a slow plant hold many usual
    steps. period: s, between rows.
    """
    return max(usual, period / STEPS)


def part_of(
    plant: Plant,
    outputs: Sequence[str],
    known: Sequence[str],
    cache: Path,
    fixed: Values | None = None,
) -> Part:
    """The part that computes `outputs` from inputs and `known` variables, built once. fixed:
    parameters that are numbers in it.
    """
    what = (plant.class_name, list(outputs), list(known), sorted((fixed or {}).items()))
    key = part_key(plant.model, repr(what))
    part = read_part(cache, key)
    if part is None:
        from modelica_fmu.cut import cut  # the compiler is loaded where it has to work

        part = build_part(cut(plant.model, plant.class_name, outputs, known, fixed), cache, key)
    return part


def known_variables(plant: Plant, cache: Path) -> tuple[Mapping[str, str], frozenset[str]]:
    """Variable -> the one that it is another name of; those that are states."""
    shape = structure_of(plant, cache)
    return shape.roots, shape.states


def structure_of(plant: Plant, cache: Path) -> Structure:
    """States, rates and other names of a plant's model, found once."""
    key = part_key(plant.model, f"structure of {plant.class_name}")
    path = cache / f"{key}.json"
    known = _read_structure(path)
    if known is not None:
        return known
    from modelica_fmu.cut import structure

    shape = structure(plant.model, plant.class_name)
    told = {
        "roots": dict(shape.roots),
        "states": sorted(shape.states),
        "rates": dict(shape.rates),
        "numbers": sorted(shape.numbers),
        "units": dict(shape.units),
    }
    text = json.dumps(told)
    write_atomically(path, lambda at: at.write_text(text, encoding="utf-8"))
    return shape


def _read_structure(path: Path) -> Structure | None:
    """A structure that was found before; None where its file is missing or damaged."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        states, numbers = frozenset(told["states"]), frozenset(told["numbers"])
        return Structure(told["roots"], states, told["rates"], numbers, told["units"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
