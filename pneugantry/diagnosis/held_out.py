"""What the leading hypotheses leave on the log that no fit has seen."""

from __future__ import annotations

from pneugantry.diagnosis.bench import Bench
from pneugantry.diagnosis.decide import contest
from pneugantry.diagnosis.evidence import Search
from pyfmi_runner.campaign import Campaign, LoggedRun
from pyfmi_runner.fmu import FmuFile

__all__ = ["examine"]

EXAMINED = 10  # hypotheses that lead on the fitted logs


def examine(found: Search, campaign: Campaign, held: LoggedRun, gantry: FmuFile) -> None:
    """Judges tolerance alone and the leading hypotheses on `held`, every view at the values that
    they have on the other logs.
    """
    alone = Campaign(campaign.name, campaign.path, {held.log.name: held}, campaign.notes)
    plain = found.plain
    with Bench(alone, gantry) as bench:
        found.held_out = bench.judged(plain)
        for trial, _ in sorted(contest(found), key=lambda entry: entry[1])[:EXAMINED]:
            if trial is not None:
                trial.held_out = bench.judged(plain | trial.outcome.values)
