"""What `identify` found, as JSON values and as tables for people.

Numbers in, numbers and text out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pneugantry.analysis.identify.friction_tests import RuleResult
from pneugantry.analysis.identify.identification import Identification
from pneugantry.analysis.identify.interval import Estimate
from pneugantry.analysis.identify.valve import Step

__all__ = ["as_json", "as_text"]

# averages of the thesis' Tables 4.1-4.5 by axis and position [mm], filling and exhausting [s]
PRINTED_LAGS = {
    ("x", 1000): (0.13, 0.16),
    ("x", 500): (0.25, 0.25),
    ("x", 0): (0.50, 0.48),
    ("z", 100): (0.16, 0.16),
    ("z", 0): (0.14, 0.14),
}


def as_json(found: Identification, seconds: float) -> dict[str, Any]:
    """The result of `pneugantry identify --json`: null where the logs do not tell."""
    joint, estimates = found.joint, found.joint.estimates()
    parameters = {}
    for u in joint.coordinates.unknowns:
        source = joint.sources[u.name]
        told = source != "none"
        parameters[u.name] = {
            "symbol": u.symbol,
            "axis": u.axis,
            "unit": u.unit,
            "provenance": u.source,
            "plant_sheet": u.nominal,
            "value": estimates[u.name].value if told else None,
            "ci95": _ends(estimates[u.name]) if told and joint.fits else None,
            "rests_on": source,
            "why_not": None if told else found.reason(u),
        }
    return {
        "schema": "identify/1",
        "parameters": parameters,
        "sums": {name: _estimate(e) for name, e in joint.sums().items()} if joint.fits else {},
        "fits": joint.fits,
        "gap": joint.gap,
        "logs": {
            name: {"gap": gap, "samples": joint.rows[name][0], "of": joint.rows[name][1]}
            for name, gap in joint.gaps.items()
        },
        "tests": {
            "valve": {axis: _valve_json(found, axis) for axis in "xz"},
            "rules": [_rule_json(r) for r in found.rules],
            "hysteresis": None
            if found.hysteresis is None
            else {
                "beta": found.hysteresis.beta,
                "sigma": found.hysteresis.sigma,
                "rms": found.hysteresis.rms,
                "presliding": found.hysteresis.presliding,
            },
            "noise": {
                n.channel: {
                    "rms": n.rms,
                    "ci95": [n.low, n.high],
                    "snr_db": n.snr,
                    "table_3_3": n.printed,
                }
                for n in found.noise
            },
        },
        "notes": [*found.campaign.notes, *found.notes],
        "seconds": seconds,
    }


def _ends(e: Estimate) -> list[float]:
    return [e.low, e.high]


def _estimate(e: Estimate) -> dict[str, Any]:
    return {"value": e.value, "ci95": _ends(e)}


def _valve_json(found: Identification, axis: str) -> dict[str, Any]:
    fitted = found.lines[axis]
    direction = found.joint.coordinates.direction[axis]
    return {
        "steps": [
            {
                "log": s.log,
                "position": s.position,
                "u": [s.u_from, s.u_to],
                "f_a": [s.f_from, s.f_to],
                "filling": s.filling,
                "time_65": s.time_65,
                "tau_65": _estimate(s.tau_65),
                "tau_fit": _estimate(s.tau),
            }
            for s in found.steps[axis]
        ],
        "line": None
        if fitted is None
        else {
            "K": _estimate(_times(fitted.slope, direction)),
            "u_0": _estimate(fitted.zero),
            "r2": fitted.r2,
        },
        "by_log": [
            {
                "log": f.log,
                "position": f.position,
                "K": _estimate(f.K),
                "u_0": _estimate(f.u_0),
                "tau": _estimate(f.tau),
                "gap": f.gap,
            }
            for f in found.lags[axis]
        ],
        "depends_on": [
            {
                "question": c.question,
                "difference": _estimate(c.difference),
                "share": c.share,
                "p": c.p,
            }
            for c in found.comparisons[axis]
        ],
    }


def _times(e: Estimate, factor: float) -> Estimate:
    return Estimate(e.value * factor, e.sigma * abs(factor), e.reach)


def _rule_json(r: RuleResult) -> dict[str, Any]:
    freed = (
        _estimate(r.estimate) if math.isfinite(r.estimate.sigma) else {"value": None, "ci95": None}
    )
    return {
        "symbol": r.rule.symbol,
        "axis": r.rule.axis,
        "unit": r.rule.unit,
        "how": r.rule.how,
        "by_rule": r.rule.value,
        "bias": r.bias,
        "count": r.rule.count,
    } | freed


# ---------------------------------------------------------------- text


def as_text(found: Identification) -> Iterator[str]:
    """Lines to print."""
    for axis in "xz":
        if found.steps[axis]:
            yield from _lag_tables(found, axis)
    yield from _rule_table(found)
    yield from _noise_table(found)
    yield from _joint_table(found)
    for note in (*found.campaign.notes, *found.notes):
        yield f"note: {note}"


def _pm(e: Estimate, digits: int = 4) -> str:
    if not math.isfinite(e.sigma):
        return f"{e.value:.6g}"
    half = e.reach * e.sigma
    places = max(0, digits if half == 0 else 1 - math.floor(math.log10(half)))
    return f"{e.value:.{min(places, 9)}f} +- {half:.{min(places, 9)}f}"


def _lag_tables(found: Identification, axis: str) -> Iterator[str]:
    yield (
        f"Valve {axis}: tau by the 65 % rule (a lag reaches 65 % at 1.05 tau) and by fit, as "
        f"Tables 4.1-4.5; +- 95 %"
    )
    for log in dict.fromkeys(s.log for s in found.steps[axis]):
        of_log = [s for s in found.steps[axis] if s.log == log]
        position = 1000 * of_log[0].position
        yield f"  {log}, {axis} = {position:.0f} mm"
        yield (
            "    command [V]   force [N]           filling      t_65 [s]  tau_65 [s]         "
            "  tau by fit [s]"
        )
        for s in of_log:
            yield (
                f"    {s.u_from:4.2f} - {s.u_to:4.2f}   {s.f_from:7.2f} to {s.f_to:7.2f} "
                f" {'filling' if s.filling else 'exhausting':10} "
                f"{s.time_65:9.4f}  {_pm(s.tau_65):20} {_pm(s.tau)}"
            )
        yield "    average       " + _averages(of_log) + _printed(axis, position)
    line = found.lines[axis]
    if line is not None:
        direction = found.joint.coordinates.direction[axis]
        K = _pm(_times(line.slope, direction))
        yield (
            f"  line through the steady forces: K = {K} N/V, u_0 = {_pm(line.zero)} V, R^2 = "
            f"{line.r2:.7f}"
        )
    for c in found.comparisons[axis]:
        verdict = "depends" if c.p < 0.01 else "no dependence seen"
        yield (
            f"  tau on {c.question}: {_pm(c.difference)}, {100 * c.share:+.2f} % between the "
            f"extremes, p = {c.p:.2g}: {verdict}"
        )
    yield ""


def _averages(of_log: list[Step]) -> str:
    cells = []
    for filling, word in ((True, "filling"), (False, "exhausting")):
        tau = [s.tau.value for s in of_log if s.filling == filling]
        if tau:
            cells.append(f"{word} {sum(tau) / len(tau):.4f} s")
    return ", ".join(cells)


def _printed(axis: str, position: float) -> str:
    for (of_axis, at), (filling, exhausting) in PRINTED_LAGS.items():
        if of_axis == axis and abs(at - position) < (60 if axis == "x" else 10):
            return f"   (thesis, {at} mm: {filling:.2f}, {exhausting:.2f} s)"
    return ""


def _rule_table(found: Identification) -> Iterator[str]:
    if not found.rules:
        return
    yield (
        "Tests of friction, mass and contact. Bias: of the rule itself, on noisy copies of "
        "the fitted plant's own logs"
    )
    yield f"  {'':7} {'test':28} {'times':>5} {'by rule':>11} {'bias':>10}   freed of bias, +- 95 %"
    for r in found.rules:
        rule = r.rule
        bias = f"{r.bias:+10.4g}" if math.isfinite(r.bias) else f"{'?':>10}"
        freed = (
            f"{_pm(r.estimate)} {rule.unit}"
            if math.isfinite(r.estimate.sigma)
            else f"not judged [{rule.unit}]"
        )
        yield (
            f"  {rule.symbol + (' ' + rule.axis if rule.axis else ''):7} {rule.how:28} "
            f"{rule.count:5} {rule.value:11.6g} {bias}   {freed}"
        )
    yield ""


def _noise_table(found: Identification) -> Iterator[str]:
    if found.noise:
        yield "Sensor noise where nothing moves, against Table 3.3"
        yield "  channel    RMS          95 %                       Table 3.3    max. SNR [dB]"
        for n in found.noise:
            yield (
                f"  {n.channel:8} {n.rms:.4e}   {n.low:.4e} .. {n.high:.4e}   "
                f"{n.printed:.1e}      {n.snr:.0f}"
            )
        yield ""


def _joint_table(found: Identification) -> Iterator[str]:
    joint, estimates = found.joint, found.joint.estimates()
    yield "Joint fit of the whole plant to all logs by command replay; gap 1 is the noise"
    yield "  " + ", ".join(f"{name} {gap:.3f}" for name, gap in joint.gaps.items())
    yield (
        f"  {'parameter':24} {'value':>12}   95 % interval                      "
        f"{'plant sheet':>12} {'off by':>9}"
    )
    for u in joint.coordinates.unknowns:
        e, source = estimates[u.name], joint.sources[u.name]
        if source == "none":
            yield f"  {u.name:24} {'-':>12}   not identified: {found.reason(u)}"
            continue
        off = 100 * (e.value / u.nominal - 1)
        if not joint.fits:
            yield (
                f"  {u.name:24} {e.value:12.7g}   {'none: the plant does not replay':34} "
                f"{u.nominal:12g} {off:+8.3f} %"
            )
            continue
        rests = " rests on F_w of the plant sheet" if source == "sheet" else ""
        interval = f"{e.low:.7g} .. {e.high:.7g} {u.unit}"
        yield f"  {u.name:24} {e.value:12.7g}   {interval:34} {u.nominal:12g} {off:+8.3f} %{rests}"
    for name, e in joint.sums().items() if joint.fits else ():
        yield (
            f"  {name:30} {e.value:6.7g}   {e.low:.7g} .. {e.high:.7g} N   what the logs "
            f"show by themselves"
        )
    yield ""
