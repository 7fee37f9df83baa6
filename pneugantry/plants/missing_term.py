"""The missing term of a diagnosed plant, the gantry or one's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from modelica_fmu.errors import RunError
from pneugantry.engine.answer.result import to_json as diagnosis_json
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found
from pneugantry.learn.wanted import wanted
from pneugantry.plants.gantry.diagnosis import finished
from pyfmi_runner.campaign import Campaign

if TYPE_CHECKING:
    from pneugantry.learn.learned import Learned

__all__ = ["to_json", "with_missing_term"]


def with_missing_term(
    found: Found,
    rules: Rules,
    campaign: Campaign | None = None,
    say: Callable[[str], None] = lambda stage: None,
) -> tuple[Found, Learned | None]:
    """The answer with the term that the plant's equations lack, looked for where it is `wanted`;
    else as it was, and None. campaign: of the gantry, as it was read. say:
    told the name of each stage. Where the looking fails, a note says so and the answer stands.
    """
    if found.task.epoch is not None or not wanted(found):
        return found, None

    from pneugantry.learn.answer.answer import answered  # its import is dear, for who learns
    from pneugantry.learn.learn import learn

    def finish(other: Found) -> Found:
        return other if campaign is None else finished(other, campaign, rules)

    try:
        learned = learn(found, rules, say, finish)
    except (RunError, np.linalg.LinAlgError) as error:
        return _noted(found, f"the missing term was looked for, and that failed: {error}"), None
    made = answered(learned, rules)
    stages = {**found.diagnosis.stages, "missing term": learned.seconds}
    seconds = found.diagnosis.seconds + learned.seconds
    told = replace(made.diagnosis, stages=stages, seconds=seconds)
    return replace(made, diagnosis=told), learned


def _noted(found: Found, note: str) -> Found:
    diagnosis = found.diagnosis
    return replace(found, diagnosis=replace(diagnosis, notes=(*diagnosis.notes, note)))


def to_json(found: Found, learned: Learned | None) -> dict[str, Any]:
    """gap/1, with `learned` where a term was looked for."""
    told = diagnosis_json(found.diagnosis)
    if learned is None:
        return told
    from pneugantry.learn.answer.result import to_json as learned_json

    return {**told, "learned": learned_json(learned)}
