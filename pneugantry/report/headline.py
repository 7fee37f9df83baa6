"""The answer in words, from the result's JSON alone: the same sentence in the terminal and on the
page.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pneugantry.engine.chances import UNEXPLAINED
from pneugantry.engine.signals.units import with_unit

__all__ = [
    "cause_name",
    "chance",
    "change_words",
    "confirmed",
    "headline",
    "interval",
    "leaves",
    "number",
    "percent",
    "shrink_words",
    "shrinkable",
    "size_words",
    "verdict_word",
]

CLAIMS = ("identified", "ambiguous")
TINY = 1e-9
PERHAPS = 0.05  # probability from which on what may be there as well is worth a word
LEFT = 2.0  # times the floor, from which on what is left of a gap is worth a word


def number(value: float | None, digits: int = 3) -> str:
    """A number of so many significant digits; "–" where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    if 1 <= abs(value) < 1e6:
        return f"{float(text):.0f}"
    mantissa, exponent = text.split("e")
    return f"{mantissa}·10^{int(exponent)}"


def chance(probability: float) -> str:
    """A probability: never 0 nor 100 %, which no data say, however a sum is rounded."""
    return percent(min(max(probability, TINY), 1.0 - TINY))


def percent(share: float) -> str:
    """A share; what is neither 0 nor 1 does not read as 0 or 100 %."""
    if not math.isfinite(share):
        return "–"
    if 0 < share < 0.01:
        return "< 1 %"
    return "> 99 %" if 0.99 < share < 1 else f"{100 * share:.0f} %"


def interval(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and its interval with as many digits as tell the ends apart: two of the width."""
    width = high - low
    if not (math.isfinite(width) and width > 0):
        return number(value, 4), number(low, 4), number(high, 4)
    largest = max(abs(value), abs(low), abs(high))
    digits = 2 + math.floor(math.log10(largest)) - math.floor(math.log10(width))
    digits = min(max(digits, 3), 9)
    return _padded((number(value, digits), number(low, digits), number(high, digits)))


def _padded(texts: tuple[str, str, str]) -> tuple[str, str, str]:
    """Numbers with as many decimals each; as they are where one is in powers of ten."""
    if not all(text.lstrip("-").replace(".", "", 1).isdigit() for text in texts):
        return texts
    places = max(len(text.partition(".")[2]) for text in texts)
    value, low, high = (f"{float(text):.{places}f}" for text in texts)
    return value, low, high


def cause_name(cause: Mapping[str, Any]) -> str:
    """An effect with its axis, as `valve_delay/z`; of one of two campaigns alone as
    `valve_delay/z@after`.
    """
    name = f"{cause['effect']}/{cause['axis']}" if cause["axis"] else str(cause["effect"])
    return f"{name}@{cause['campaign']}" if "campaign" in cause else name


def change_words(found: dict[str, Any]) -> list[str]:
    """What became of each effect between two campaigns, a line each: came, went, changed, stayed.
    Empty where there is one campaign.
    """
    if "changes" not in found:
        return []
    told = [
        c
        for what in ("came", "went", "changed", "stayed")
        for c in found["changes"]["effects"]
        if c["what"] == what and c["probabilities"]["absent"] < 0.5
    ]
    return [_became(c) for c in told] or ["nothing came, went or changed"]


def _became(change: dict[str, Any]) -> str:
    sizes = []
    for name, p in change["parameters"].items():
        size, low, high = interval(p["change"], *p["ci95"])
        moved = f", by {size} ({low} to {high})" if change["what"] != "stayed" else ""
        ends = f"from {number(p['before'], 4)} to {number(p['after'], 4)}"
        at = number(p["after"], 4) if change["what"] == "stayed" else ends
        sizes.append(f"{name.split('.')[-1]} {with_unit(at, p['unit'])}{moved}")
    sure = chance(change["probabilities"][change["what"]])
    return ", ".join([f"{change['what']}: {cause_name(change)}", f"probability {sure}", *sizes])


def shrinkable(gap: dict[str, Any] | None) -> bool:
    """Whether there is a gap above the floor to speak of."""
    if gap is None or gap["nominal"] is None or gap["floor"] is None:
        return False
    return bool(gap["nominal"] > 1.05 * gap["floor"])


def judged(found: dict[str, Any]) -> dict[str, Any] | None:
    """The gap by which an answer is judged: up to where its replay leaves the log for good."""
    gap: dict[str, Any] | None = found["gap"]
    return gap and gap.get("until", gap)


def confirmed(found: dict[str, Any]) -> bool | None:
    """Whether a log that no fit has seen bears a claimed effect out: its gap shrinks, by its 95 %
    interval too, up to where the replay leaves the log. None where nothing is claimed or there is
    nothing to shrink.
    """
    gap = judged(found)
    if gap is None or found["verdict"] not in CLAIMS or not shrinkable(gap):
        return None
    return bool(gap["shrink"] > 0 and gap["ci95"][0] > 0)


def verdict_word(found: dict[str, Any]) -> str:
    """The verdict; "not confirmed" where the effect makes an unseen log worse, not better."""
    return "not confirmed" if confirmed(found) is False else str(found["verdict"])


def size_words(cause: dict[str, Any]) -> str:
    """The effect's fitted parameters with their 95 % intervals, as `delay_time 0.022 s
    (0.02199..0.02201)`.
    """
    parts = []
    for name, entry in cause["parameters"].items():
        value, low, high = interval(entry["value"], *entry["ci95"])
        ends = f" ({low} to {high})" if low != high else ""
        parts.append(f"{name.split('.')[-1]} {with_unit(value, entry['unit'])}{ends}")
    return ", ".join(parts)


def shrink_words(gap: dict[str, Any] | None) -> str:
    """The gap before and after, and its shrink, as the end of a sentence."""
    if gap is None:
        return "how far the gap shrinks is not known, the held-out log could not be replayed"
    before, after = number(gap["nominal"]), number(gap["augmented"])
    early = gap.get("until")
    if early is not None:
        return (
            f"{shrink_words(early)} up to {number(early['t'])} s, where the replay misses an event "
            f"and leaves the log for good; over all of it {before} before and {after} after"
        )
    if not shrinkable(gap):
        return (
            f"the gap of {gap['log']} is {before} before and {after} after: at the floor, "
            f"nothing to shrink"
        )
    floor = number(gap["floor"])
    if gap["augmented"] > gap["nominal"]:
        return f"the gap of {gap['log']} grows from {before} to {after} (floor {floor})"
    low, high = gap["ci95"]
    return (
        f"the gap of {gap['log']} falls from {before} to {after} (floor {floor}), "
        f"shrink {gap['shrink']:.3f} [{low:.3f}, {high:.3f}]"
    )


def headline(found: dict[str, Any], summaries: dict[str, str] | None = None) -> str:
    """One sentence: what, how large, how sure, and what it does to the gap. summaries: what an
    effect is, by `cause_name`.
    """
    far, verdict = shrink_words(found["gap"]), found["verdict"]
    where = f" in {found['where'][0]['block']}" if found["where"] else ""
    if verdict == "none":
        return (
            f"Nothing beyond tolerance and noise was found in these logs; with the tolerance "
            f"fitted, {far}.{_rest(found, 'tolerance')}"
        )
    if verdict == "unknown":
        unknown = found.get("unknown_probability") or math.nan
        learnt = (found.get("learned") or {}).get("accepted")
        made = "the term that was learnt" if learnt else "what could be fitted"
        beside = " and ".join(_named(c, summaries or {}) for c in _beside(found))
        return (
            f"A real effect{where} that no entry of the catalogue explains (probability "
            f"{chance(unknown)})"
            f"{f'; beside it {beside}' if beside else ''}; with {made}, {far}."
            f"{_rest(found, 'the term') if learnt else ''}"
        )
    if verdict == "ambiguous":
        answers = [_words(keys) for keys in found["answer_set"]] or ["–"]
        text = f"These logs do not settle which effect it is{where}: {', or '.join(answers)}"
        return f"{text}; with the first one, {far}.{_doubt(found)}"
    named = [_named(cause, summaries or {}) for cause in _best(found)]
    verb = ", explain" if len(named) > 1 else ", explains" if named else " explains"
    more = _perhaps(found)
    return (
        f"{', and '.join(named) or 'An effect'}{verb} the fitted logs; {far}.{more}{_doubt(found)}"
    )


def _perhaps(found: dict[str, Any]) -> str:
    """What may be there as well: of other answers of the set, what they have beyond the first."""
    first, *others = [set(keys) for keys in found["answer_set"]] or [set()]
    more = {k for keys in others if first < keys for k in keys - first}
    chances = {cause_name(c): c["probability"] for c in found["causes"]}
    chances["unknown"] = found.get("unknown_probability") or math.nan
    told = [
        f"{_words([k])} (probability {chance(chances[k])})"
        for k in sorted(more, key=lambda k: -chances.get(k, 0.0))
        if chances.get(k, 0.0) >= PERHAPS
    ]
    return f" There may be {' or '.join(told)} as well." if told else ""


def _best(found: dict[str, Any]) -> list[dict[str, Any]]:
    """The causes that make up the answer."""
    first = found["answer_set"][0] if found["answer_set"] else []
    return [c for c in found["causes"] if cause_name(c) in first] or found["causes"][:1]


def _beside(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Causes that stand in the answer beside something unknown."""
    first = found["answer_set"][0] if found["answer_set"] else []
    return [c for c in found["causes"] if cause_name(c) in first]


def _words(keys: list[str]) -> str:
    """A hypothesis."""
    known = ["something that the catalogue lacks" if k == "unknown" else k for k in keys]
    return " + ".join(known) or "no effect"


def _named(cause: dict[str, Any], summaries: dict[str, str]) -> str:
    name, size = cause_name(cause), size_words(cause)
    said = f" ({summaries[name]})" if summaries.get(name) else ""
    return f"{name}{said}{f', {size}' if size else ''}, probability {chance(cause['probability'])}"


def _doubt(found: dict[str, Any]) -> str:
    """What speaks against the answer, or beside it."""
    gap = judged(found)
    if gap is None or confirmed(found) is None:
        return ""
    if confirmed(found) is False:
        return (
            f" The held-out log {gap['log']} does not bear that out: do not act on it before "
            f"another log does."
        )
    return _rest(found, "this answer")


def _rest(found: dict[str, Any], what: str) -> str:
    """That an unseen log's gap stays large, where it does: of an answer whose fitted logs leave
    noise, a replay of the inputs alone carries small errors on.
    """
    gap = judged(found)
    if gap is None or not leaves(found):
        return ""
    left = number(gap["augmented"] / gap["floor"])
    said = f" What is left of it is {left} times the floor: "
    if found["verdict"] == "unknown" or (found["unknown_probability"] or 0.0) >= UNEXPLAINED:
        return f"{said}{what} is not all."
    return (
        f"{said}its replay carries an error of its start, a missed event or what the fits leave "
        f"open on, or {what} is not all; in the fitted logs no more than noise is left."
    )


def leaves(found: dict[str, Any]) -> bool:
    """Whether the augmented plant leaves far more of an unseen log's gap than noise."""
    gap = judged(found)
    return gap is not None and shrinkable(gap) and gap["augmented"] > LEFT * gap["floor"]
