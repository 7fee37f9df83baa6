"""All effects of the truth plant: the catalogue's, in one or several forms each, and those that no
catalogue lists.
"""

from __future__ import annotations

import numpy as np

from pneugantry.truth.effects_contact import CONTACT_FORMS
from pneugantry.truth.effects_friction import FRICTION_FORMS
from pneugantry.truth.effects_missing import MISSING_FORMS
from pneugantry.truth.effects_random import RANDOM_FORMS
from pneugantry.truth.effects_sensing import SENSING_FORMS
from pneugantry.truth.effects_unknown import UNKNOWN_FORMS
from pneugantry.truth.effects_valve import VALVE_FORMS
from pneugantry.truth.form import Cause, Form

KNOWN_FORMS: list[Form] = [*VALVE_FORMS, *FRICTION_FORMS, *CONTACT_FORMS, *SENSING_FORMS]
OUTSIDE_FORMS: list[Form] = [*UNKNOWN_FORMS, *MISSING_FORMS, *RANDOM_FORMS]
ALL_FORMS: list[Form] = [*KNOWN_FORMS, *OUTSIDE_FORMS]


def names(forms: list[Form]) -> list[tuple[str, str]]:
    """(effect, axis) pairs that the forms offer, each once, in their order."""
    return list(dict.fromkeys((form.effect, axis) for form in forms for axis in form.axes))


def draw_cause(rng: np.random.Generator, effect: str, axis: str, form: str | None = None) -> Cause:
    """A cause of the given effect and axis; its form (one of the effect's, evenly), size and shape
    are drawn.
    """
    offered = [
        f for f in ALL_FORMS if f.effect == effect and axis in f.axes and form in (None, f.form)
    ]
    if not offered:
        raise ValueError(
            f"effect must be one of the truth plant's, got {effect}/{axis} form {form}"
        )
    chosen = offered[int(rng.integers(len(offered)))]
    return Cause(chosen, axis, chosen.draw_size(rng), int(rng.integers(2**31)))
