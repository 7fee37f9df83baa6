"""The conclusions over all settings: which runs they need, and their verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pneugantry.thesis.conclusions import (
    EBPA_STARTS,
    Conclusion,
    networks,
    start_runs,
    tracking_conclusions,
    tracking_runs,
)
from pneugantry.thesis.conditions import DDFM, NO_LAG, VDFM, Run
from pneugantry.thesis.edge import ladder_conclusion, ladder_runs
from pneugantry.thesis.lag_readings import readings_conclusion
from pneugantry.thesis.perfect import STRAIGHT, PerfectRun, perfect_conclusion, perfect_run
from pneugantry.thesis.plant_tests import (
    drawn_friction,
    friction_conclusion,
    hysteresis,
    locus_conclusion,
)
from pneugantry.thesis.runner import Results
from pneugantry.thesis.scores import Scores
from pneugantry.thesis.settings import (
    CONTACTS,
    FITTED,
    GROUPS,
    UNFITTED,
    Seen,
    Setting,
    settings,
)
from pneugantry.thesis.tables import cells, met_share, table_runs
from pneugantry.thesis.verdicts import Range, Verdict, spread, verdict
from pyfmi_runner.fmu import FmuFile

__all__ = [
    "Judged",
    "PerfectPair",
    "cell_shares",
    "ladder_traced",
    "perfect_from",
    "perfect_settings",
    "perfect_values",
    "plant_judged",
    "plant_values",
    "setting_runs",
    "verdicts_of",
]

Judged = list[tuple[str, Conclusion]]
PERFECT_DRAWS = 3  # of the random finish, for the one loop that runs in Python
STARTS = "EBPA starts that no table picked"


@dataclass(frozen=True)
class PerfectPair:
    """The perfect compensator with and without lag."""

    with_lag: PerfectRun
    without_lag: PerfectRun


def setting_runs(draws: int) -> list[Run]:
    """Every tracking run of every setting."""
    found = []
    for setting in settings(draws):
        runs = [*table_runs(), *tracking_runs()]
        if setting.group in UNFITTED:
            runs += start_runs()
        found += [setting.applied(run) for run in runs]
    for choice in CONTACTS.values():
        for draw in range(draws):
            found += [run for pair in ladder_runs(choice, draw).values() for run in pair]
    return found


def ladder_traced(draws: int) -> frozenset[Run]:
    return frozenset(
        run
        for choice in CONTACTS.values()
        for draw in range(draws)
        for pair in ladder_runs(choice, draw).values()
        for run in pair
    )


def perfect_settings(draws: int) -> list[Setting]:
    """The fitted setting, and a few random draws of each contact."""
    few = min(draws, PERFECT_DRAWS)
    return [FITTED] + [s for s in settings(draws) if s.group in UNFITTED and s.number < few]


def perfect_values(setting: Setting, fmu: str) -> list[dict[str, Any]]:
    """The pair as JSON holds it; `perfect_from` reads it."""
    file, run = FmuFile.read(fmu), setting.applied(STRAIGHT)
    pair = (perfect_run(run, file), perfect_run(run.changed(plant=NO_LAG), file))
    return [
        {"scores": one.scores, "time": one.time.tolist(), "f_n": one.f_n.tolist()} for one in pair
    ]


def perfect_from(values: Sequence[Mapping[str, Any]]) -> PerfectPair:
    return PerfectPair(
        *(PerfectRun(Scores(*v["scores"]), np.array(v["time"]), np.array(v["f_n"])) for v in values)
    )


def plant_values(fmu: str, contact: str, draw: int) -> list[dict[str, Any]]:
    """Conclusion 9 on a draw of the friction, and 14 with the first: no tracking run feeds them."""
    file, choice = FmuFile.read(fmu), CONTACTS[contact]
    pair = (hysteresis(file, law, choice, **drawn_friction(draw)) for law in (DDFM, VDFM))
    found = [friction_conclusion(*pair)]
    if draw == 0:
        found.append(locus_conclusion(file, choice))
    return [asdict(conclusion) for conclusion in found]


def plant_judged(values: Mapping[str, Sequence[Mapping[str, Any]]]) -> Judged:
    """Conclusions 9, 14 and 15; values: what `plant_values` gave, in all, by contact."""
    judged: Judged = [("printed readings", readings_conclusion())]
    for contact, found in values.items():
        judged += [(contact, Conclusion(**one)) for one in found]
    return judged


def verdicts_of(
    results: Results, draws: int, perfect: Sequence[tuple[Setting, PerfectPair]], plant: Judged
) -> list[Verdict]:
    """All fifteen, by number."""
    judged: Judged = list(plant)
    unfitted = [*UNFITTED, *CONTACTS, "printed readings", STARTS]
    for setting in settings(draws):
        seen = Seen(results, setting)
        judged += [(setting.group, c) for c in tracking_conclusions(seen)]
        if setting.group in UNFITTED:
            judged += [(STARTS, networks(seen, start)) for start in EBPA_STARTS[1:]]
    for setting, pair in perfect:
        seen = Seen(results, setting)
        judged.append((setting.group, perfect_conclusion(seen, pair.with_lag, pair.without_lag)))
    for contact, choice in CONTACTS.items():
        judged += [(contact, ladder_conclusion(results, choice, d)) for d in range(draws)]
    by_id: dict[int, Judged] = {}
    for group, conclusion in judged:
        by_id.setdefault(conclusion.id, []).append((group, conclusion))
    return [verdict(by_id[number], unfitted) for number in sorted(by_id)]


def cell_shares(results: Results, draws: int) -> dict[str, dict[str, Range]]:
    """Share of the unique simulation cells that are met: by group of settings and over all phases
    and draws of a contact, plain and allowing for the rounding of the print.
    """
    shares: dict[str, dict[str, list[float]]] = {}
    for setting in settings(draws):
        found = cells(Seen(results, setting))
        for name in _share_groups(setting):
            group = shares.setdefault(name, {"met": [], "met in print": []})
            group["met"].append(met_share(found))
            group["met in print"].append(met_share(found, in_print=True))
    return {
        group: {name: spread(values) for name, values in kinds.items()}
        for group, kinds in shares.items()
    }


def _share_groups(setting: Setting) -> list[str]:
    """The groups that a setting counts in: its own, and that of its contact."""
    contact = [
        f"all phases and draws, {c}"
        for c in CONTACTS
        if setting.group in GROUPS and setting.group.endswith(c)
    ]
    return [setting.group, *contact]
