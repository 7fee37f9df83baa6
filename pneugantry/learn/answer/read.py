"""What sensors read, as equations: a term that stands there changes nothing in the plant. Where the
term that is learnt stands elsewhere, the plant has them no more.
"""

from __future__ import annotations

import re
from dataclasses import replace

from modelica_fmu.cut import structure
from pneugantry.engine.plant import Signal
from pneugantry.engine.task import Task
from pneugantry.engine.views.subsystem import SubsystemView
from pneugantry.learn.equations.points import named_again, recut, stored
from pneugantry.learn.equations.sources import equations_of, with_outputs
from pneugantry.learn.learned import Learned, Tried
from pneugantry.learn.terms.term import with_term

__all__ = ["with_readings", "without_readings"]


def with_readings(task: Task) -> Task:
    """A task whose plant has an output for what each sensor reads, where its class has none that
    only names a variable again: a state that is measured stands in no equation of its own, and
    what computes a force computes it for the plant as well.
    """
    plant = task.plant
    of_class = tuple(plant.class_name.split("."))
    own = [e for e in equations_of(plant.model) if e.of_class == of_class]
    named = {e.left for e in own if named_again(e)}
    bare = [s for s in plant.signals if s.variable not in named]
    if not bare or not own:
        return task
    taken = set(structure(plant.model, plant.class_name).roots)
    read = {s.name: replace(s, variable=_free(s, taken)) for s in bare}
    text = plant.model.read_text(encoding="utf-8")
    text = with_outputs(text, own, {read[s.name].variable: s.variable for s in bare})
    signals = tuple(read.get(s.name, s) for s in plant.signals)
    made = replace(plant, model=stored(plant, text, task.cache), signals=signals)
    views = [recut(v, made, task.cache) if isinstance(v, SubsystemView) else v for v in task.views]
    return replace(task, plant=made, views=views)


def without_readings(learned: Learned, task: Task) -> Learned:
    """What was learnt of a task `with_readings`, of the plant as it was: but where the term is in
    what a sensor reads. Equations keep their numbers, for outputs come last.
    """
    before, best = replace(learned.before, task=task), learned.best
    if best is None or learned.after is None:
        return replace(learned, before=before)
    if best.term.point.sensor:
        return learned
    equations = {(e.of_class, e.number): e for e in equations_of(task.plant.model)}

    def own(tried: Tried) -> Tried:
        point = tried.term.point
        key = point.equation.of_class, point.equation.number
        equation = equations.get(key, point.equation)  # a rival may be in what a sensor reads
        return replace(tried, term=replace(tried.term, point=replace(point, equation=equation)))

    answers, tried = tuple(map(own, learned.answers)), tuple(map(own, learned.tried))
    after = learned.after
    model = with_term(task.plant, answers[0].term, task.cache).model
    plant = replace(after.task.plant, model=model, signals=task.plant.signals)
    after = replace(after, task=replace(after.task, plant=plant))
    return replace(learned, before=before, after=after, answers=answers, tried=tried)


def _free(signal: Signal, taken: set[str]) -> str:
    """A name for what a signal's sensor reads."""
    name = re.sub(r"\W", "_", f"{signal.name}_read")
    while name in taken:
        name += "_"
    return name
