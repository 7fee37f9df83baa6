"""The diagnosis of any plant as one self-contained page: verdict, where, which, how far, every
record's signals, tolerance, what is left, limits, next experiment.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import jinja2

from modelica_fmu.files import write_atomically
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found
from pneugantry.engine.task import Task
from pneugantry.report.headline import (
    chance,
    change_words,
    confirmed,
    headline,
    number,
    percent,
    shrink_words,
    shrinkable,
    verdict_word,
)
from pneugantry.report.learned import term_svg
from pneugantry.report.logs import Shot, shots, shown_of
from pneugantry.report.pictures import (
    CURVES,
    SAMPLES,
    Phase,
    gap_svg,
    packed,
    panel_svg,
    strip_svg,
)
from pneugantry.report.visibility import visibility
from pneugantry.report.words import (
    label,
    left_over,
    made,
    next_steps,
    parameter_rows,
    rivals,
    runner_up,
    summaries,
    tolerance,
)

__all__ = ["Extras", "write_page"]

TEMPLATE = Path(__file__).with_name("page.html")
OTHER_SAMPLES = 4000  # per curve of a record that is not shown first
FEW = 6  # nuisances that are shown without being asked for


@dataclass(frozen=True, eq=False)
class Extras:
    """What a plant's own package adds to the page."""

    drawing: str | None = None  # of the plant, SVG; blocks by their share
    closed_loop: Mapping[str, float] | None = None  # nominal, augmented, floor, shrink
    next_experiment: Mapping[str, Any] | None = None  # what, scenario, separates, ...
    phases: Mapping[str, Sequence[Phase]] = field(default_factory=dict)  # by record
    setups: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # by record: head, words
    learned: Mapping[str, Any] | None = None  # the missing term, as `learned` of gap/1
    rules: Rules = field(default_factory=Rules)  # that the diagnosis was made with
    source: str = ""  # what `pneugantry diagnose` was given; empty: not known


def write_page(found: Found, path: Path, extras: Extras | None = None) -> Path:
    """Writes the page, whole or not at all; returns its path. Every record is replayed for it,
    and every effect simulated in every fitted record. Raises InputError where the file system
    refuses.
    """
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters |= {"number": number, "percent": percent, "chance": chance}
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    text = template.render(_context(found, extras or Extras()))
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return path


def _context(found: Found, extras: Extras) -> dict[str, Any]:
    facts = {**to_json(found.diagnosis), "learned": extras.learned}
    seen, unseen = shots(found)
    after = "tolerance fitted" if found.diagnosis.verdict == "none" else "augmented"
    doubted = confirmed(facts) is False
    return {
        "plant": found.task.plant.name,
        "verdict": found.diagnosis.verdict,
        "word": verdict_word(facts),
        "doubted": doubted,
        "sentence": headline(facts, summaries(found)),
        "changes": change_words(facts),
        "steps": next_steps(facts, extras.learned, extras.source),
        "after": after,
        "drawing": extras.drawing,
        **_where(found),
        **_which(found, facts),
        **_how_far(found, facts, after),
        **_signals(found, seen, extras, after),
        "closed": extras.closed_loop or facts["closed_loop"],
        "next": extras.next_experiment or facts["next_experiment"],
        **_rest(found, facts, unseen),
        "seen": visibility(_shared(found.task), extras.rules),
        "learned": extras.learned,
        "curve": term_svg(extras.learned["term"])
        if extras.learned and extras.learned["term"]
        else "",
        "logs": _logs(found, extras),
        "heads": list(dict.fromkeys(h for own in extras.setups.values() for h in own)),
        "made": made(found),
        "stages": facts["stages"],
        "seconds": facts["seconds"],
        "styles": CURVES,
    }


def _shared(task: Task) -> Task:
    """With each effect once: in all records, where there are two campaigns."""
    return replace(task, catalogue={k: e for k, e in task.catalogue.items() if not e.epoch})


def _where(found: Found) -> dict[str, Any]:
    rows = []
    for place in found.diagnosis.where:
        whole = place.explained + place.left
        share = place.explained / whole if whole > 0 else math.nan
        rows.append({"place": place, "explained": share})
    return {"where": rows}


def _which(found: Found, facts: Mapping[str, Any]) -> dict[str, Any]:
    chosen = found.final.decision.chosen
    catalogue = found.task.catalogue
    causes = [
        {
            "key": c.key,
            "probability": c.probability,
            "chosen": c.key in chosen,
            "summary": catalogue[c.key].summary if c.key in catalogue else "",
        }
        for c in found.diagnosis.causes
    ]
    return {
        "causes": causes,
        "sound": found.decision.none,
        "outside": found.decision.unknown,
        "rivals": rivals(found),
        "runner_up": "" if found.learnt else runner_up(found),
        "before_learning": found.learnt is not None,
        "answer_set": [label(keys) for keys in found.diagnosis.answer_set],
        "parameters": parameter_rows(facts["causes"], chosen),
        "search": [
            {"effect": s.effect, "gain": s.gain, "dropped": s.dropped}
            for s in found.diagnosis.steps
        ],
    }


def _how_far(found: Found, facts: Mapping[str, Any], after: str) -> dict[str, Any]:
    gap = found.gap
    held = found.task.data.held_out
    told = () if found.nominal is None else shown_of(found.task.plant, found.nominal)
    shown = {signal.name: signal for signal in told}
    by = {} if gap is None else gap.by_signal
    rows = [(name, *pair) for name, pair in by.items()]
    if gap is not None and len(rows) > 1:
        rows.append(("all", gap.nominal, gap.augmented))
    return {
        "gap": facts["gap"],
        "shrinks": shrinkable(facts["gap"]),
        "shrink_words": shrink_words(facts["gap"]),
        "unheld": held is None,
        "channels": [
            {"signal": shown[name], "nominal": pair[0], "augmented": pair[1]}
            for name, pair in by.items()
        ],
        "gap_picture": "" if gap is None else gap_svg(rows, gap.floor, after),
    }


def _signals(found: Found, seen: Sequence[Shot], extras: Extras, after: str) -> dict[str, Any]:
    """Strips and data of every record; static panels of the first."""
    views = []
    for i, shot in enumerate(seen):
        phases = list(extras.phases.get(shot.record.name, ()))
        name = shot.record.name
        words = f"Residual of each signal of {name} over time, nominal above {after}"
        views.append(
            {
                "name": name,
                "held_out": shot.held_out,
                "gap": (shot.nominal.gap, shot.augmented.gap),
                "strip": strip_svg(shot.residuals, shot.curves.end, phases, words),
                "data": _json(packed(shot.curves, phases, OTHER_SAMPLES if i else SAMPLES)),
            }
        )
    every = dict.fromkeys(n for shot in seen for n in shot.nominal.signals)
    first = seen[0] if seen else None
    panels = []
    for name in every:
        picture = ""
        if first is not None and name in first.nominal.signals:
            phases = list(extras.phases.get(first.record.name, ()))
            picture = panel_svg(first.curves, first.nominal.signals.index(name), phases)
        panels.append((name, picture))
    return {"views": views, "panels": panels, "curves": list(CURVES)}


def _json(data: dict[str, Any]) -> str:
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")


def _rest(found: Found, facts: Mapping[str, Any], unseen: Sequence[str]) -> dict[str, Any]:
    """Tolerance, what is left, limits and notes, each once."""
    rows = tolerance(found.final)
    few = [d for i, d in enumerate(rows) if d.unusual or i < FEW]
    limits = found.diagnosis.limits
    return {
        "tolerance": few,
        "tolerance_rest": [d for d in rows if d not in few],
        "tolerance_scale": found.final.decision.best.scale,
        "left": left_over(found.final),
        "noise_level": found.final.excess.level,
        "limits": list(limits),
        "notes": list(dict.fromkeys(n for n in (*facts["notes"], *unseen) if n not in limits)),
    }


def _logs(found: Found, extras: Extras) -> list[dict[str, Any]]:
    data = found.task.data
    held = data.held_out
    rows = []
    for record in (*data.fitted, *([held] if held is not None else [])):
        use = "held out: gap" if record is held else "fit"
        if held is None and found.gap is not None and found.gap.record == record.name:
            use = "fit and gap"
        rows.append(
            {
                "name": record.name,
                "seconds": record.rows * record.period,
                "period": record.period,
                "signals": ", ".join(record.signals),
                "use": use,
                "setup": extras.setups.get(record.name, {}),
            }
        )
    return rows
