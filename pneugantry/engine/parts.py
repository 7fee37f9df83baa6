"""The parts of a model that a diagnosis runs, compiled ahead of it.

Each hypothesis has a part of its own in every view that its effects touch (see `pieces`), which the
C compiler otherwise makes when it is asked for first.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from modelica_fmu.errors import RunError
from modelica_fmu.toolchain import host_platform
from pneugantry.engine.answer.confirm import replay
from pneugantry.engine.fitting.fitter import Fitter
from pneugantry.engine.hypotheses.hypothesis import Hypothesis
from pneugantry.engine.rules import Rules
from pneugantry.engine.task import Task
from pneugantry.engine.views.foreign import ForeignPlant

__all__ = ["compile_parts"]

AT_ONCE = 8  # hypotheses that are prepared together


def compile_parts(task: Task, rules: Rules, say: Callable[[str], None] = lambda stage: None) -> int:
    """Makes the parts for tolerance alone, for each effect in each form, for any effect beside one,
    and for replays; what is there stays. Two effects in one view have a part of their own, which is
    made when a search meets them. say: told what is being made. Returns how many were made; an FMU
    without source has none.
    """
    if isinstance(task.plant, ForeignPlant):
        return 0
    before = _count(task)
    effects, none = list(task.catalogue.values()), Hypothesis()
    singles = [none.plus(e, f) for e in effects for f in e.forms]
    fitter = Fitter(task.plant, task.views, task.data.fitted, rules)
    try:
        for at in range(0, len(singles), AT_ONCE):
            say(f"effects ({at} of {len(singles)})")
            fitter.prepare([none, *singles[at : at + AT_ONCE]])
        say("effects side by side")
        fitter.prepare_any(none, effects)
    finally:
        fitter.close()
    say("replay")
    with contextlib.suppress(RunError):  # of a record that the nominal plant does not follow
        replay(task.plant, task.data.fitted[0], {}, task.cache)
    return _count(task) - before


def _count(task: Task) -> int:
    return sum(1 for _ in task.cache.glob(f"*/part{host_platform().extension}"))
