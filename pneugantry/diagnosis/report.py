"""The diagnosis as one self-contained HTML page: verdict, where, which, how far, parameters,
limits, next experiment.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from numpy.typing import NDArray

from pneugantry.diagnosis.diagnose import Diagnosis, report_json
from pneugantry.report.headline import (
    confirmed,
    headline,
    interval,
    number,
    percent,
    shrink_words,
    shrinkable,
    verdict_word,
)
from pneugantry.diagnosis.report_logs import LogView, log_views, strip_svg
from pneugantry.diagnosis.report_pictures import (
    CURVES,
    gap_svg,
    packed,
    panel_svg,
    plant_svg,
    unit_of,
)
from pneugantry.diagnosis.report_words import rivals, runner_up, summaries
from pyfmi_runner.campaign import LoggedRun
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED, SIGMA, write_atomically

__all__ = ["write_report"]

TEMPLATE = Path(__file__).with_name("report_template.html")
OTHER_SAMPLES = 4000  # per curve of a log that is not the held-out one
STRAINED = 3.0  # standard deviations of tolerance that are worth a mark


def write_report(d: Diagnosis, path: Path, gantry: FmuFile | None = None) -> Path:
    """Writes the page, whole or not at all; returns its path. gantry: the nominal FMU, with which
    every log is replayed for the page; without it the page shows the held-out log alone. Raises
    InputError where the file system refuses.
    """
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters |= {"number": number, "percent": percent}
    text = environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(_context(d, gantry))
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return path


def _context(d: Diagnosis, gantry: FmuFile | None) -> dict[str, Any]:
    facts = report_json(d)
    views, unseen = log_views(d.campaign, gantry, d.values) if gantry else ([], [])
    after = "tolerance fitted" if d.decision.verdict == "none" else "augmented"
    return {
        "campaign": d.campaign.name,
        "verdict": d.decision.verdict,
        "word": verdict_word(facts),
        "doubted": confirmed(facts) is False,
        "sentence": headline(facts, summaries(d)),
        "after": after,
        "where": facts["where"],
        "plant": plant_svg({w["block"]: w["share"] for w in facts["where"]}),
        "rivals": rivals(d.decision),
        "runner_up": runner_up(d),
        "causes": facts["causes"],
        "answer_set": [" + ".join(keys) or "no effect" for keys in facts["answer_set"]],
        "unexplained": (min(d.decision.unexplained, 1.0), d.decision.unknown_view)
        if d.decision.unknown_view
        else None,
        "gap": facts["gap"],
        "shrinks": shrinkable(facts["gap"]),
        "shrink_words": shrink_words(facts["gap"]),
        "closed": facts["closed_loop"],
        "channels": _channels(d),
        "gap_picture": _gap_picture(d, after),
        "parameters": _parameters(facts["causes"], _chosen(d)),
        "tolerance": _tolerance(d),
        "limits": d.limits,
        "notes": list(dict.fromkeys(n for n in [*facts["notes"], *unseen] if n not in d.limits)),
        "made": _made(gantry),
        "steps": _steps(d, facts),
        "plan": facts.get("plan"),  # tables of engines that have them
        "learned": facts.get("learned"),
        "next": facts["next_experiment"],
        "logs": _logs(d),
        "single": len(d.campaign.logs) == 1,
        "stages": facts["stages"],
        "seconds": facts["seconds"],
        "styles": CURVES,
    } | _overlay(d, views, after)


def _chosen(d: Diagnosis) -> tuple[str, ...]:
    return d.decision.best.choice.keys if d.decision.best is not None else ()


def _channels(d: Diagnosis) -> list[dict[str, Any]]:
    """Table of the held-out log by channel."""
    if d.gap is None:
        return []
    rows = []
    for name, (nominal, augmented) in d.gap.channels.items():
        unit, factor = unit_of(name)
        sigma = SIGMA[name] * factor
        rows.append(
            {"name": name, "unit": unit, "sigma": sigma, "nominal": nominal, "augmented": augmented}
        )
    return rows


def _gap_picture(d: Diagnosis, after: str) -> str:
    if d.gap is None:
        return ""
    rows = [(name, *pair) for name, pair in d.gap.channels.items()]
    return gap_svg(
        [*rows, ("all", float(d.gap.nominal), float(d.gap.augmented))], d.gap.floor, after
    )


def _parameters(causes: list[dict[str, Any]], chosen: tuple[str, ...]) -> list[dict[str, Any]]:
    """Fitted parameters of the effects that the diagnosis names first."""
    rows = []
    for cause in causes:
        key = f"{cause['effect']}/{cause['axis']}" if cause["axis"] else cause["effect"]
        for name, entry in cause["parameters"].items():
            low, high = entry["ci95"]
            digits = interval(entry["value"], low, high)
            wide = not math.isfinite(high - low) or high - low > max(abs(entry["value"]), 1e-300)
            rows.append(
                {
                    "effect": key,
                    "name": name,
                    "chosen": key in chosen,
                    "wide": wide,
                    "unit": entry["unit"],
                    "form": entry.get("form", ""),
                    **dict(zip(("value", "low", "high"), digits, strict=True)),
                }
            )
    return rows


def _tolerance(d: Diagnosis) -> list[dict[str, Any]]:
    """Nominal parameters as the augmented model has them: how far off, and in standard deviations
    of the tolerance.
    """
    coordinates: dict[str, Any] = {}
    outcomes = [
        *d.found.null.values(),
        *([d.decision.best.outcome] if d.decision.best is not None else []),
    ]
    for outcome in outcomes:
        coordinates |= {
            c.name: c for c in outcome.fit.coordinates if not c.effect and c.name in d.values
        }
    rows = []
    for name, c in sorted(coordinates.items()):
        deviations = c.theta(d.values[name]) / c.spread
        off = d.values[name] / c.neutral - 1.0 if c.neutral else math.nan
        rows.append(
            {
                "name": name,
                "nominal": c.neutral,
                "value": d.values[name],
                "off": off,
                "deviations": deviations,
                "strained": abs(deviations) > STRAINED,
            }
        )
    return rows


def _logs(d: Diagnosis) -> list[dict[str, Any]]:
    single = len(d.campaign.logs) == 1
    rows = []
    for name, run in d.campaign.logs.items():
        use = "fit and gap" if single else "held out: gap" if name == d.held_out else "fit"
        s = run.setup
        rows.append(
            {
                "name": name,
                "seconds": float(run.log.time[-1] - run.log.time[0]),
                "loop": s.loop,
                "clamped": ", ".join(s.clamped) or "none",
                "workpiece": s.workpiece,
                "use": use,
            }
        )
    return rows


def _made(gantry: FmuFile | None) -> str:
    """Date, version and the FMU's hash, by which a page can be made again."""
    fmu = f", nominal FMU sha256 {gantry.sha256[:16]}" if gantry is not None else ""
    return (
        f"{datetime.now().astimezone():%Y-%m-%d %H:%M} by pneugantry {version('pneugantry')}{fmu}"
    )


def _steps(d: Diagnosis, facts: dict[str, Any]) -> list[str]:
    """What to do with the answer."""
    if confirmed(facts) is False:
        return [
            "Record the held-out experiment once more, and diagnose again.",
            "Look at the signals below where the augmented plant leaves the measured ones.",
        ]
    augmented = "pneugantry diagnose FOLDER --augmented out/ writes the plant with the effect, as "
    return {
        "none": ["Use the model as it is; its fitted tolerance stands below."],
        "identified": [
            f"{augmented}Modelica and FMU: simulate with that one.",
            "Mend the cause on the rig if it can be mended, record again: the verdict should be "
            "none.",
        ],
        "ambiguous": ["Run the next experiment below and add its log to the campaign."],
        "unknown": [
            "Look in the strip and the signals below where and when the residual is large.",
            "Describe the effect in a catalogue of your own (--catalogue) and diagnose again.",
        ],
    }.get(d.decision.verdict, [])


def _phases(run: LoggedRun) -> list[tuple[str, float, float]]:
    return [(name, float(start), float(end)) for name, (start, end) in run.setup.phases.items()]


def _json(data: dict[str, Any]) -> str:
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")


def _others(d: Diagnosis, views: list[LogView], after: str) -> list[dict[str, Any]]:
    """What the page holds of each log beside the held-out one's signals."""
    return [
        {
            "name": view.name,
            "gap": view.gap,
            "strip": strip_svg(view, _phases(view.run), after) if view.strips else "",
            "data": ""
            if view.name == d.held_out
            else _json(packed(view.run.log.time, view.curves, _phases(view.run), OTHER_SAMPLES)),
        }
        for view in views
        if len(view.run.log) > 1
    ]


def _overlay(d: Diagnosis, views: list[LogView], after: str) -> dict[str, Any]:
    """Panels and data of the held-out log's signals, data of the others."""
    run = d.campaign.logs.get(d.held_out)
    if run is None or d.gap is None or len(run.log) < 2:
        return {"panels": [], "data": "", "curves": [], "views": []}
    time = run.log.time
    curves: Mapping[str, NDArray[np.float64]] = {
        "measured": run.log.measured(),
        **{name: d.gap.curves[name] for name in ("nominal", "augmented")},
    }
    phases = _phases(run)
    panels = [
        panel_svg(channel, time, {name: values[:, i] for name, values in curves.items()}, phases)
        for i, channel in enumerate(MEASURED)
    ]
    data = _json(packed(time, curves, phases))
    return {
        "panels": list(zip(MEASURED, panels, strict=True)),
        "data": data,
        "curves": list(curves),
        "views": _others(d, views, after),
    }
