"""The conclusions over all settings: which runs they need, and their verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
from pneugantry.thesis.settings import CONTACTS, FITTED, UNFITTED, Seen, Setting, settings
from pneugantry.thesis.tables import cells, met_share, table_runs
from pneugantry.thesis.verdicts import Range, Verdict, spread, verdict
from pyfmi_runner.fmu import FmuFile

__all__ = [
    "Judged",
    "PerfectPair",
    "cell_shares",
    "ladder_traced",
    "perfect_pair",
    "perfect_settings",
    "plant_judged",
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


def perfect_pair(setting: Setting, fmu: str) -> PerfectPair:
    file, run = FmuFile.read(fmu), setting.applied(STRAIGHT)
    return PerfectPair(perfect_run(run, file), perfect_run(run.changed(plant=NO_LAG), file))


def plant_judged(fmu: str, draws: int) -> Judged:
    """Conclusions 9, 14 and 15, which no tracking run feeds."""
    file = FmuFile.read(fmu)
    judged: Judged = [("printed readings", readings_conclusion())]
    for contact, choice in CONTACTS.items():
        judged.append((contact, locus_conclusion(file, choice)))
        for draw in range(draws):
            friction = drawn_friction(draw)
            pair = (hysteresis(file, law, choice, **friction) for law in (DDFM, VDFM))
            judged.append((contact, friction_conclusion(*pair)))
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
    """Share of the unique simulation cells that are met: by group of settings, plain and allowing
    for the rounding of the print.
    """
    shares: dict[str, dict[str, list[float]]] = {}
    for setting in settings(draws):
        found = cells(Seen(results, setting))
        group = shares.setdefault(setting.group, {"met": [], "met in print": []})
        group["met"].append(met_share(found))
        group["met in print"].append(met_share(found, in_print=True))
    return {
        group: {name: spread(values) for name, values in kinds.items()}
        for group, kinds in shares.items()
    }
