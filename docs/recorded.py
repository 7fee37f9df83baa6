"""Tables of the results pages, from the JSON that `python docs/record.py` keeps."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.code_size import functions, longest_line

DATA = Path(__file__).parent / "results" / "data"
SETS = ("nofa", "contour", "three", "wide", "random")  # of `pneugantry blind`

__all__ = [
    "bad_input",
    "bam_planted",
    "blind_nuisance",
    "blind_sets",
    "clean_install",
    "code_size",
    "compiler_times",
    "cross_check",
    "diagnosis_time",
    "differential",
    "drive_blind",
    "math_functions",
    "motor",
    "public_models",
    "replay",
    "rootlocus",
    "soak_models",
    "solver_check",
    "standard_library",
    "stiff",
    "textbook",
]


def _read(name: str) -> tuple[str, Any]:
    """The sentence that says where a result comes from, and the result. Raises FileNotFoundError
    for one that is not recorded.
    """
    kept = json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    return f"`{kept['command']}`, version of {kept['version']}.", kept["result"]


def _table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(map(str, row)) + " |" for row in rows]
    return "\n".join(lines)


def replay() -> str:
    """Gap by log and channel."""
    said, found = _read("replay")
    names = list(next(iter(found["logs"].values()))["channels"])
    rows = [
        (log, *(f"{gap:.3f}" for gap in (entry["gap"], *(entry["channels"][c] for c in names))))
        for log, entry in found["logs"].items()
    ]
    words = (
        "A campaign that another simulator of the same plant recorded (not part of this "
        "repository): RMS of (measured - simulated)/sigma over a log; 1 is the sensors' noise."
    )
    return f"{said} {words}\n\n{_table(('log', 'all', *names), rows)}"


def rootlocus() -> str:
    """Poles and limit gains without lag, with tau_z and with tau_x."""
    rows, said = [], []
    for name in ("none", "z", "x"):
        words, found = _read(f"rootlocus_{name}")
        said.append(words.split(",")[0])
        poles = ", ".join(f"{re:.2f}{f' {im:+.2f}j' if im else ''}" for re, im in found["poles"])
        limit = found["limit_gain"]
        sampled = found["sampled"]["limit_gain"]
        rows.append(
            (f"{found['lag']:g}", poles, f"{limit:.4f}" if limit else "none", f"{sampled:.4f}")
        )
    heads = ("lag [s]", "poles [1/s]", "limit gain [V/N]", "sampled at 1 ms")
    return f"{'; '.join(said)}: zero at {found['zeros'][0][0]:.1f} 1/s.\n\n{_table(heads, rows)}"


def solver_check() -> str:
    """Errors of the FMU's own solver, in sensor sigma."""
    said, found = _read("solver_check")
    rows = [
        (
            name,
            f"{row['error']:.0e} ({row['where']})",
            row["events"],
            f"{row['gap']:.2f}",
            f"{row['step_error']:.0e}",
        )
        for name, row in found["accuracy"].items()
    ]
    heads = (
        "log, law of friction on z",
        "against DOP853 at 1e-11",
        "events",
        "their instants [us]",
        "against 1/40 of the step",
    )
    ratios = [r for row in found["convergence"].values() for r in row["ratios"]]
    cvode = max(row["error"] for row in found["cvode"].values())
    words = (
        f"Between events the error falls by {min(ratios):.1f} to {max(ratios):.1f} per halving of "
        f"the step. Model exchange driven by fmpy's CVode stays within {cvode:.3f} sigma."
    )
    first = f"{said} Largest error over a log and its eight channels, in sensor sigma."
    return f"{first}\n\n{_table(heads, rows)}\n\n{words}"


def motor() -> str:
    """The tutorial's plant: causes and gap."""
    said, found = _read("motor")
    rows = []
    for cause in found["causes"]:
        for name, p in cause["parameters"].items():
            low, high = p["ci95"]
            value = f"{p['value']:.4f} [{low:.4f}, {high:.4f}] {p['unit']}"
            rows.append((cause["effect"], f"{cause['probability']:.2f}", name, value))
    gap = found["gap"]
    words = (
        f"Verdict {found['verdict']}; gap of {gap['log']} {gap['nominal']:.0f} to "
        f"{gap['augmented']:.2f}, shrink {gap['shrink']:.3f}. Put in: tau_c 0.15, tau_o 0.06 N m."
    )
    return f"{said} {words}\n\n{_table(('cause', 'probability', 'parameter', 'value'), rows)}"


def blind_nuisance() -> str:
    """Sealed rigs on which everything is a little off."""
    return _scored("blind_nuisance")


def drive_blind() -> str:
    """The second plant under blind check."""
    return _scored("drive_blind")


def _scored(file: str) -> str:
    """Scores, calibration and wrong cases of one set."""
    said, found = _read(file)
    rows = [
        (name, _target(found["targets"][name]), "-" if got is None else f"{got:.3g}")
        for name, got in found["table"].items()
    ]
    claims = [(f"{said:.2f}", f"{right:.2f}", n) for said, right, n in found["reliability"]]
    wrong = "\n".join(f"- {text}" for text in found["confusions"])
    return (
        f"{said}\n\n{_table(('measure', 'target', 'got'), rows)}\n\n"
        f"{_table(('probability', 'share right', 'claims'), claims)}\n\nWrong:\n\n{wrong}"
    )


def blind_sets() -> str:
    """Sealed rigs of other kinds, side by side; a set that is not recorded is left out."""
    sets = {n: _read(f"blind_{n}") for n in SETS if (DATA / f"blind_{n}.json").is_file()}
    measures = [m for m in next(iter(sets.values()))[1]["table"] if not m.startswith("seconds")]
    rows = [
        (
            m,
            *(
                f"{got:.3g}" if (got := r["table"][m]) is not None else "-"
                for _, r in sets.values()
            ),
        )
        for m in measures
    ]
    wrong = "\n".join(f"- {n}: {t}" for n, (_, r) in sets.items() for t in r["confusions"])
    said = "\n".join(f"- {text}" for text, _ in sets.values())
    return f"{said}\n\n{_table(('measure', *sets), rows)}\n\nWrong:\n\n{wrong}"


def bam_planted() -> str:
    """Errors planted into the description of a measured servo."""
    from examples.bam.planted import printed  # it is beside the documents, not installed

    said, found = _read("bam_planted")
    return f"{said} {printed(found)}"


def diagnosis_time() -> str:
    """What diagnoses of campaigns cost, beside a version before."""
    said, found = _read("diagnosis_time")
    before_said, before = _read("diagnosis_time_before")
    earlier = {r["campaign"]: r for r in before}
    heads = (
        "campaign",
        *(f"{what} s{when}" for what in ("wall", "CPU", "simulated") for when in ("", " before")),
    )
    rows = []
    for r in found:
        old = earlier[r["campaign"]]
        pairs = [(d[what] for d in (r, old)) for what in ("wall", "cpu")]
        cells = [f"{x:.1f}" for pair in pairs for x in pair]
        rows.append((r["campaign"], *cells, *(f"{_simulated(d):.0f}" for d in (r, old))))
    dear = max(found, key=lambda r: float(r["cpu"]))
    pieces = sorted(dear["pieces"], key=lambda p: -p["cpu"])[:10]
    shares = [
        (f"{p['what']} {p['effects']}", f"{p['cpu']:.2f}", f"{p['simulated']:.0f}") for p in pieces
    ]
    return (
        f"{said} Before: {before_said}\n\n{_table(heads, rows)}\n\n"
        f"What was dearest of `{dear['campaign']}`:\n\n"
        f"{_table(('what', 'CPU s', 'simulated s'), shares)}"
    )


def _simulated(diagnosis: dict[str, Any]) -> float:
    return float(sum(p["simulated"] for p in diagnosis["pieces"]))


def _target(told: object) -> str:
    return f"`{told}`" if told else ""


def clean_install() -> str:
    """What lands in site-packages, and the first commands of a new environment."""
    said, found = _read("clean_install")
    landed = ", ".join(f"`{name}` ({count} files)" for name, count in found["landed"].items())
    rows = [
        (f"`{step['command']}`", f"{step['seconds']:.1f}", step["last_line"].strip())
        for step in found["steps"]
    ]
    (built,) = (step["binaries"] for step in found["steps"] if "binaries" in step)
    words = (
        f"In site-packages: {landed}. Binaries of the FMU, by their own headers: "
        f"{', '.join(sorted(built.values()))}."
    )
    return f"{said} {words}\n\n{_table(('command', 'wall seconds', 'its last line'), rows)}"


def bad_input() -> str:
    """Unusable input and special files: what each command said."""
    said, found = _read("bad_input")
    rows = [
        tuple(
            " ".join(str(cell).split()).replace("|", "&#124;")
            for cell in (
                case["kind"],
                f"`{case['command']}`",
                case["code"],
                case["said"].removeprefix("pneugantry: ") if case["code"] else "",
                case["wrong"] or "right",
            )
        )
        for case in found["cases"]
    ]
    wrong = sum(bool(case["wrong"]) for case in found["cases"])
    counted = f"{len(rows)} cases, {wrong} not right."
    return f"{said} {counted}\n\n{_table(('what', 'command', 'exit code', 'said', ''), rows)}"


def code_size() -> str:
    """Longest functions, most arguments, longest line, of the code as it stands."""
    found = list(functions())
    longest = sorted(found, key=lambda f: -f.lines)[:5]
    many = sorted((f for f in found if f.arguments > 6), key=lambda f: -f.arguments)
    rows = [("longest functions", f"{f.lines} lines", f"`{f.file}` `{f.name}`") for f in longest]
    most = many or [max(found, key=lambda f: f.arguments)]
    rows += [("most arguments", str(f.arguments), f"`{f.file}` `{f.name}`") for f in most]
    columns, place = longest_line()
    rows.append(("longest line", f"{columns} columns", f"`{place}`"))
    words = f"`python -m benchmarks.code_size`: {len(found)} functions"
    return f"{words}, {len(many)} with more than six arguments.\n\n{_table(('', '', ''), rows)}"


def _counted(outcomes: Sequence[dict[str, Any]], parts: Sequence[str]) -> str:
    """Outcomes by package and state."""
    states = list(dict.fromkeys(o["state"] for o in outcomes))
    rows = []
    for part in parts:
        inside = [o["state"] for o in outcomes if f".{part}." in o["model"]]
        rows.append((part, len(inside), *(inside.count(s) for s in states)))
    rows.append(("all", len(outcomes), *(sum(o["state"] == s for o in outcomes) for s in states)))
    return _table(("package", "models", *states), rows)


def textbook() -> str:
    """Modelica by Example: compiled, run and right against independent solutions."""
    said, found = _read("textbook")
    parts = ("BasicEquations", "ArrayEquations", "DiscreteBehavior", "Functions")
    others = [
        (o["model"].split(".", 1)[1], o["state"], o["said"].split(": ", 1)[-1])
        for o in found
        if o["state"] != "right"
    ]
    return f"{said}\n\n{_counted(found, parts)}\n\n{_table(('model', '', 'said'), others)}"


def standard_library() -> str:
    """The Modelica Standard Library against the Association's reference results."""
    said, found = _read("standard_library")
    parts = (
        "Blocks.Examples",
        "Math",
        "Mechanics.Translational.Examples",
        "Mechanics.Rotational.Examples",
        "Electrical.Analog.Examples",
    )
    outcomes = found["outcomes"]
    others = [
        (o["model"].split(".", 1)[1], o["state"], o["said"].split(": ", 1)[-1].split(";")[0][:110])
        for o in outcomes
        if o["state"] not in ("right", "compiled")
    ]
    table = _table(("model", "", "said"), others)
    return f"{said} Library version {found['library']}.\n\n{_counted(outcomes, parts)}\n\n{table}"


def stiff() -> str:
    """Errors and steps of stiff and high-index models."""
    said, found = _read("stiff")
    rows = [
        (
            run["example"],
            f"{run['tolerance']:.0e}",
            run["steps"],
            f"{run['explicit_steps']:.1e}" if run["explicit_steps"] else "",
            f"{run['error']:.1e}",
        )
        for run in found
    ]
    heads = ("model", "tolerance", "internal steps", "explicit ones, stable", "error")
    return f"{said}\n\n{_table(heads, rows)}"


def public_models() -> str:
    """Models of other public sources against their equations by hand."""
    said, found = _read("public_models")
    rows = [
        (
            row["model"],
            row["repository"],
            row["state"],
            "" if row["error"] is None else f"{row['error']:.0e}",
            row["said"].split(": ", 1)[-1][:110],
        )
        for row in found
    ]
    return f"{said}\n\n{_table(('model', 'of', '', 'error', 'said'), rows)}"


def differential() -> str:
    """Random models against an interpreter of their own."""
    said, found = _read("differential")
    counts = ", ".join(f"{n} {state}" for state, n in found["counts"].items())
    pieces = ", ".join(f"{name} {n}" for name, n in found["pieces"].items())
    others = [(o["seed"], o["state"], o["said"][:110]) for o in found["others"]]
    table = f"\n\n{_table(('seed', '', 'said'), others)}" if others else ""
    return f"{said} {found['models']} models: {counts}. Pieces drawn: {pieces}.{table}"


def math_functions() -> str:
    """Functions of Modelica.Math beside numpy and scipy."""
    said, found = _read("math_functions")
    counts = Counter(o["state"] for o in found)
    told = ", ".join(f"{n} {state}" for state, n in counts.items())
    right = ", ".join(o["function"] for o in found if o["state"] == "right")
    others = [
        (o["function"], o["state"], o["said"].split(": ", 1)[-1].split(";")[0][:110])
        for o in found
        if o["state"] != "right"
    ]
    worst = max(o["error"] for o in found if o["state"] == "right")
    return (
        f"{said} {len(found)} functions: {told}; largest error of the right ones {worst:.1e}. "
        f"Right: {right}.\n\n{_table(('function', '', 'said'), others)}"
    )


def soak_models() -> str:
    """Mangled Modelica: taken, refused, crashed."""
    said, found = _read("soak_models")
    kinds = found["models"]["kinds"]
    rows = []
    for kind, seen in kinds.items():
        crashed = sum(n for what, n in seen.items() if what.startswith("crash"))
        changed, tried = kind.removeprefix("Modelica "), sum(seen.values())
        rows.append((changed, tried, seen.get("read", 0), seen.get("refused", 0), crashed))
    heads = ("changed", "texts", "compiled", "refused in one line", "crashes")
    return f"{said}\n\n{_table(heads, rows)}"


def cross_check() -> str:
    """FMUs and files as FMI's cross-check wants them."""
    said, found = _read("cross_check")
    rows = [
        (r["model"], r["type"], f"{r['distance']:.0e}", "; ".join(r["found"]) or "nothing")
        for r in found
    ]
    return f"{said}\n\n{_table(('model', 'type', 'distance', 'found by the check'), rows)}"


def compiler_times() -> str:
    """Build and step of the gantry."""
    said, found = _read("compiler_times")
    same = "the same bytes" if found["same_bytes"] else "different bytes"
    low, middle, high = found["ratio"]
    apart = found["apart_sigma"]
    outputs = "the same bits" if apart == 0 else f"{apart:.1e} of the sensors' sigma apart"
    return (
        f"{said} CPU time of a build of the gantry's FMU: {found['cold_s']:g} s cold, "
        f"{found['warm_s']:g} s warm; a step of 1 ms at rest: {found['step_us']:g} us. Two builds "
        f"of the same sources: {same}. A step with commands, beside the FMU of the commit before "
        f"the compiler was enlarged: {found['now_us']:g} us, {found['before_us']:g} us before; "
        f"ratio of pairs {middle:.3f} (quartiles {low:.3f} to {high:.3f}), outputs: {outputs}."
    )
