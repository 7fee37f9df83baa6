"""A learnt term as a catalogue's effect, so that the next rig is recognised by it."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

from modelica_fmu.errors import InputError
from modelica_fmu.files import refuse_replacing, write_atomically
from pneugantry.engine.hypotheses.catalogue import Effect, Parameter
from pneugantry.learn.learned import Learned
from pneugantry.learn.terms.term import Term, with_term

__all__ = ["effect_name", "effects_toml", "write_catalogue"]


def write_catalogue(folder: Path, learned: Learned) -> tuple[Path, Path]:
    """Writes a catalogue, the plant's own effects and the learnt one, and the plant's Modelica file
    in which that effect is a parameter, neutral at 0; returns both paths. Raises InputError where
    no term was accepted, where the plant's own file would be replaced, and where the folder cannot
    be written.
    """
    if learned.best is None or not learned.accepted:
        hint = "add what you know of the rig to the catalogue by hand"
        raise InputError("no missing term was accepted", field="--catalogue-out", hint=hint)
    term, task = learned.best.term, learned.before.task
    forms = tuple(replace(f, settings={}) for f in term.effect.forms)  # the model has its tables
    summary = f"learnt: {term.formula()}"
    named = replace(term.effect, name=effect_name(term), summary=summary, forms=forms)
    own = [e for e in task.catalogue.values() if not e.outside]
    model = with_term(task.plant, term, task.cache).model
    paths = folder / "effects.toml", folder / model.name
    for path in paths:
        refuse_replacing(path, [task.plant.model], "--catalogue-out")
    text = _said(term) + effects_toml([*own, named])
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(paths[0], lambda at: at.write_text(text, encoding="utf-8"))
        write_atomically(paths[1], lambda at: shutil.copy(model, at))
    except OSError as error:
        hint = "name a folder that can"
        raise InputError(f"cannot be written ({error.strerror})", file=folder, hint=hint) from None
    return paths


def _said(term: Term) -> str:
    """What the description of the next rig has to say, where a sensor reads the term."""
    if not term.point.sensor:
        return ""
    read = term.point.equation.left
    return (
        f'# In the description this sensor reads: variable = "{read}" of the output concerned\n\n'
    )


def effect_name(term: Term) -> str:
    """As `learnt_signed_square_of_v`."""
    return re.sub(r"\W+", "_", f"learnt {term.name}")


def effects_toml(effects: list[Effect]) -> str:
    """Effects as `read_catalogue` reads them, each of its axis alone."""
    lines: list[str] = []
    for e in effects:
        lines += ["[[effect]]", f"name = {_text(e.name)}", f"block = {_text(e.block)}"]
        lines += [f"axes = [{_text(e.axis)}]"] if e.axis else []
        lines += [f"summary = {_text(e.summary)}"]
        lines += [f"refines = [{', '.join(map(_text, e.refines))}]"] if e.refines else []
        for form in e.forms:
            lines += ["[[effect.form]]", f"name = {_text(form.name)}"]
            if form.settings:
                lines += ["[effect.form.settings]"]
                lines += [f"{_text(n)} = {v!r}" for n, v in form.settings.items()]
            for p in form.parameters:
                lines += [f"[effect.form.parameters.{_text(p.name)}]", *_parameter(p)]
        lines.append("")
    return "\n".join(lines)


def _parameter(p: Parameter) -> list[str]:
    """A parameter's fields but its name: those that must be given, and those off their default."""
    given = {"neutral": p.neutral, "scale": p.scale, "low": p.low, "high": p.high}
    given |= {"step": p.step} if p.step else {}
    lines = [f"{k} = {float(v)!r}" for k, v in given.items()]
    lines += [f"unit = {_text(p.unit)}"]
    lines += ["relative = true"] if p.relative else []
    lines += ["positive = true"] if p.positive else []
    lines += [f"starts = {[float(s) for s in p.starts]!r}"] if p.starts else []
    return lines


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)
