"""The settings under which every table is run again: both contact stiffnesses, the fitted waves
slid along the edge, draws of the random finish, and the rig's converter behind the sensors.

The values of `CHOICE` were fitted to the printed cells with its waves where they are. A share of
met cells, or a conclusion, that holds there alone is a property of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pneugantry.thesis.conditions import CHOICE, SOFT, Choice, Run
from pneugantry.thesis.run_store import Done
from pneugantry.thesis.runner import Results
from pyfmi_runner.sensors import converter_steps

__all__ = ["CONVERTER", "FITTED", "GROUPS", "Seen", "Setting", "settings"]

CONTACTS = {"K_c 5e4": CHOICE, "K_c 1e4": SOFT}  # Fig. 4.14, Fig. 5.7
OTHER_DRAW = 1000  # a rig's own finish ("measured") is another draw than the modelled one


@dataclass(frozen=True)
class Setting:
    """What replaces a table's contact, finish and sensors."""

    group: str  # the settings that a share is taken over
    choice: Choice
    finish: str = "waves"  # or "random"
    number: int = 0  # of the draw
    slide: float = 0.0  # m
    sensors: tuple[tuple[str, Any], ...] = ()  # fields of SensorParams that differ

    def applied(self, run: Run) -> Run:
        """The run under this setting; an edge without finish stays without."""
        run = run.changed(choice=self.choice, sensors=self.sensors + run.sensors)
        if run.finish == "none":
            return run
        if self.finish == "waves":
            return run.changed(slide=self.slide)
        return run.changed(
            finish="random",
            draw=self.number + (OTHER_DRAW if run.finish == "measured" else 0),
            seed=self.number,
        )


FITTED = Setting("fitted", CHOICE)
CONVERTER = Setting(  # §3.1.4: 12 bits over +-10 V; the ideal sensors have none
    "fitted, 12-bit converter", CHOICE, sensors=(("quantum", converter_steps()),)
)


def _groups() -> tuple[str, ...]:
    finishes = ("waves slid", "random angle")
    return tuple(f"{finish}, {contact}" for finish in finishes for contact in CONTACTS)


GROUPS = _groups()
UNFITTED = tuple(group for group in GROUPS if group.startswith("random angle"))


def settings(draws: int) -> list[Setting]:
    """The fitted setting, plain and with the rig's converter, and `draws` of each group. Waves
    slide over the length of the longest strong one, so that each slide is another stretch of the
    same edge.
    """
    found = [FITTED, CONVERTER]
    length = max(zip(CHOICE.modelled.amplitude, CHOICE.modelled.length, strict=True))[1]
    for contact, choice in CONTACTS.items():
        for k in range(draws):
            slide = length * k / draws
            found.append(Setting(f"waves slid, {contact}", choice, "waves", k, slide))
            found.append(Setting(f"random angle, {contact}", choice, "random", k))
    return found


class Seen(Results):
    """Finished runs as one setting sees them: asked for a table's run, it gives that run under the
    setting.
    """

    def __init__(self, results: Results, setting: Setting) -> None:
        super().__init__(results.done, results.lost)
        self.setting = setting

    def finished(self, run: Run) -> Done:
        return super().finished(self.setting.applied(run))
