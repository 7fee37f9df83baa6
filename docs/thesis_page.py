"""Writes the generated parts of `docs/results/thesis.md` anew from what `python docs/record.py
thesis thesis_gap thesis_board thesis_peers thesis_board_peers thesis_variants thesis_tuning` kept:
`python docs/thesis_page.py`. No figure of those parts is typed; the gap's picture is drawn from the
same.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent / "results"
PAGE, DATA = HERE / "thesis.md", HERE / "data"
SHOWN = 12  # structures, factors
DPI = 90  # of the page's picture, which stays below 200 kB
FAMILIES = ("friction", "valve", "contact", "sensors", "catalogue", "beyond")


def read(name: str) -> tuple[str, dict[str, Any]]:
    """Where a result comes from, and the result."""
    kept = json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    return f"`{kept['command']}`, version of {kept['version']}.", kept["result"]


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(map(str, row)) + " |" for row in rows]
    return "\n".join(lines)


def shares() -> str:
    said, found = read("thesis")
    rows = [
        (group, *(f"{k['mean']:.0%} ({k['low']:.0%} to {k['high']:.0%})" for k in kinds.values()))
        for group, kinds in found["met_shares"].items()
    ]
    words = (
        f"{said} {found['unique_cells']} printed simulation numbers, each counted once; at the "
        f"fitted setting {found['met_share']:.0%} are met within 25 %. Mean and range over the "
        "settings:"
    )
    return f"{words}\n\n{table(('settings', 'met', 'met, the print unrounded'), rows)}"


def tables() -> str:
    """Every printed number that has ours, table by table."""
    said, found = read("thesis")
    by_table: dict[str, dict[str, dict[str, str]]] = {}
    for cell in found["cells"]:
        text = f"{cell['ours']:.3g} / {cell['printed']:.3g}{' *' if cell['met'] else ''}"
        text = f"({text})" if cell["repeat_of"] else text
        by_table.setdefault(cell["table"], {}).setdefault(cell["row"], {})[cell["column"]] = text
    parts = [f"{said} Ours / printed, * within 25 %, (..) printed before by another table."]
    for name, rows in by_table.items():
        columns = list(dict.fromkeys(column for row in rows.values() for column in row))
        lines = [(row, *(cells.get(c, "") for c in columns)) for row, cells in rows.items()]
        kinds = sorted({c["kind"] for c in found["cells"] if c["table"] == name})
        parts.append(f"Table {name} ({', '.join(kinds)}):\n\n{table(('', *columns), lines)}")
    return "\n\n".join(parts)


def conclusions() -> str:
    said, found = read("thesis")
    rows = []
    for c in found["conclusions"]:
        groups = "; ".join(f"{g} {s['held']}/{s['of']}" for g, s in c["groups"].items())
        fitted = {True: "yes", False: "no", None: "-"}[c["fitted"]]
        rows.append(
            (c["id"], c["text"], c["check"], "yes" if c["holds"] else "**no**", fitted, groups)
        )
    held = sum(c["holds"] for c in found["conclusions"])
    reasons = "\n".join(f"- {c['id']}: {c['reason']}." for c in found["conclusions"] if c["reason"])
    heads = ("", "conclusion", "check", "holds", "fitted", "settings in which it holds")
    return (
        f"{said} {held} of {len(rows)} hold where nothing was fitted.\n\n{table(heads, rows)}\n\n"
        f"Why not:\n\n{reasons}"
    )


def numbers() -> str:
    """Mean and range of each conclusion's numbers."""
    _, found = read("thesis")
    rows = []
    for c in found["conclusions"]:
        spans = (
            f"{name} {mean:.3g} ({c['ranges'][name][0]:.3g} to {c['ranges'][name][1]:.3g})"
            for name, mean in c["numbers"].items()
            if mean is not None
        )
        rows.append((c["id"], "; ".join(spans)))
    return table(("", "numbers over the settings that nothing was fitted to: mean (range)"), rows)


def findings() -> str:
    said, found = read("thesis")
    parts = [said]
    for finding in found["findings"]:
        rows = [(n, f"{v:.3g}") for n, v in finding["numbers"].items() if v is not None]
        parts.append(f"**{finding['name']}.** {finding['text']}\n\n{table(('', ''), rows)}")
    return "\n\n".join(parts)


def board(name: str = "thesis_board") -> str:
    said, found = read(name)
    searched = found["searched_to"]
    rows, worst = [], []
    for row in found["rows"]:
        name, drawn = row["controller"], row["drawn_plants"]
        rows.append(
            (
                f"`{name}`",
                *(f"{row[key]:.2f}" for key in ("nominal", "median", "worst")),
                row["worst_on"],
                f"{row['command_noise']:.3f}",
                f"{row['share_at_limits']:.0%}",
                f"{drawn['median']:.2f} ({drawn['worst']:.2f})" if drawn else "",
                _margin(row["margins_linear"], searched["linear"]),
                _margin(row["margins_cosimulated"], searched["cosimulated"]),
            )
        )
        by = {f: [] for f in FAMILIES}
        for structure, outcome in row["outcomes"].items():
            if found["structures"][structure] in by:
                by[found["structures"][structure]].append(outcome["rmse_fn"])
        worst.append((f"`{name}`", *(f"{max(v):.2f}" for v in by.values())))
    limits, missed = found["limits"], found["missed"]
    verdict = "met" if found["met"] else f"missed on {', '.join(missed)}"
    heads = ("controller", "nominal", "median", "worst", "on", "command noise [V]", "at limits")
    margins = ("gain, delay margin, python-control", "co-simulated")
    return (
        f"{said} RMSE f_n [N], the worse of straight and curved, over {len(found['structures'])} "
        f"structures. Asked of `robust_fv`: {limits['structure']} N wherever the thesis' PI stays "
        f"below {limits['where_pi_below']} N, {limits['nominal']} N on the nominal plant: "
        f"**{verdict}**.\n\n{table((*heads, 'drawn plants', *margins), rows)}\n\n"
        "Worst in each family of structures:\n\n"
        f"{table(('controller', *FAMILIES), worst)}"
    )


def peers() -> str:
    """What a peer reaches on the nominal plant when nothing else is asked of it."""
    said, found = read("thesis_peers")
    rows = [
        (
            f"`{peer['controller']}`",
            *(
                f"{peer[when][edge]:.2f}"
                for when in ("nominal_rmse_fn_untuned", "nominal_rmse_fn")
                for edge in ("straight", "curved")
            ),
            peer["evaluations"],
            ", ".join(f"{cost:.3f}" for cost in peer["cost_by_start"]),
            "none" if peer["distance"] is None else f"{peer['distance']:.2f}",
        )
        for peer in found["peers"]
    ]
    heads = (
        "",
        "straight, start",
        "curved, start",
        "straight, tuned",
        "curved, tuned",
        "candidates",
        "cost by start",
        "smallest distance from -1",
    )
    return (
        f"{said} RMSE f_n [N] on the board's nominal plant and finish, which the search does not "
        "see; distance of the loops from -1 over the plants that a design has to bear, < 0 where "
        "one is unstable:\n\n"
        f"{table(heads, rows)}"
    )


def variants() -> str:
    said, found = read("thesis_variants")
    rows = found["variants"]
    numbers = list(rows[0]["held"])
    held = [
        (r["name"], r["source"], *(str(h) for h in r["held"].values()), f"{r['met']:.0%}")
        for r in rows
    ]
    angles = [f"{p['angle']:g} deg" for p in rows[0]["pull"]]
    pulls = [
        (r["name"], *(f"{p['cut_f_n']:.0%}, {p['cut_v_t']:.0%}" for p in r["pull"])) for r in rows
    ]
    pieces = list(found["printed_no_lag"])
    no_lag = [("printed", *(f"{found['printed_no_lag'][p]:g}" for p in pieces))]
    no_lag += [(r["name"], *(f"{r['no_lag'][p]:.2f}" for p in pieces)) for r in rows]
    return (
        f"{said} Draws of the random angle, of {rows[0]['draws']}, in which a conclusion holds, "
        "and printed numbers met, by what replaces the choice:\n\n"
        f"{table(('', 'what speaks for it', *numbers, 'met'), held)}\n\n"
        "RMSE f_n [N] without lag:\n\n"
        f"{table(('', *pieces), no_lag)}\n\n"
        "Cut of RMSE f_n and v_t by valves that also pull, by uphill angle:\n\n"
        f"{table(('', *angles), pulls)}"
    )


def tuning() -> str:
    said, found = read("thesis_tuning")
    first = {}  # the set point that is drawn, by figure
    for r in found["responses"]:
        first.setdefault(r["figure"], r["set_point"])
    steps = [
        (
            r["figure"],
            r["loop"],
            ", ".join(f"{k} {v:g}" for k, v in r["gains"].items() if v) + (" *" * r["kept"]),
            f"{r['set_point']:g}",
            "never" if r["rise"] is None else f"{r['rise']:.2f} s",
            f"{r['overshoot']:.0%}",
            f"{r['unrest']:.2f}",
        )
        for r in found["responses"]
        if r["set_point"] == first[r["figure"]]
    ]
    beaten = ", ".join(f"{name} {count}" for name, count in found["beaten"].items())
    tracks = [
        (t["figure"], t["text"], f"{t['rmse_still']:.2f}", f"{t['rmse_moving']:.2f}")
        for t in found["tracks"]
    ]
    heads = ("figure", "loop", "gains, * kept", "set point", "to 90 %", "overshoot", "unrest")
    span = found["without_cable"]["span"]
    return (
        f"{said} Step responses:\n\n{table(heads, steps)}\n\n"
        "Set points, of three, at which another gain of the figure is both faster and calmer: "
        f"{beaten}.\n\nRMSE of the force [N]:\n\n"
        f"{table(('figure', '', 'at rest', 'in motion'), tracks)}\n\n"
        f"Fig. 4.15, without the cable: f_az - f_z spans {span:.1f} N."
    )


def _margin(found: dict[str, Any] | None, searched: dict[str, float | None]) -> str:
    if found is None:
        return "no linear model"
    if found.get("stable") is False or found["gain"] == 0.0:
        return "unstable"
    gain = _beyond(searched["gain"]) if found["gain"] is None else f"{found['gain']:.1f}"
    if found["delay"] is None:
        return f"{gain}, {_beyond(searched['delay'], 'ms')}"
    return f"{gain}, {1e3 * found['delay']:.0f} ms"


def _beyond(end: float | None, unit: str = "") -> str:
    """end: up to which was searched, a factor or s; None: everywhere."""
    if end is None:
        return "none"
    return f"> {1e3 * end:.0f} ms" if unit else f"> {end:g}"


def gap() -> str:
    said, found = read("thesis_gap")
    printed = [
        (
            p["column"],
            f"{p['modelled']:.3g}",
            f"{p['measured']:.3g}",
            f"{p['explained_by_edge']:.0%}",
        )
        for p in found["printed"]
    ]
    ranked = [
        table(
            ("", "log units", "P"),
            [(r["name"], f"{r['gain']:.1f}", f"{r['probability']:.2f}") for r in rows],
        )
        for rows in (found["factors"], found["structures"][:SHOWN])
    ]
    tests = [
        (
            t["test"],
            t["name"],
            f"{t['gain']:.1f}",
            "" if t["predicted"] is None else f"{t['predicted']:.1f} / {t['measured']:g} N",
        )
        for t in found["tests"]
    ]
    parts_of = (
        "On the tests of the parts, rival explanations (0: the best of its test):",
        table(("test", "explained by", "log units", "ours / measured"), tests),
    )
    heads = (
        "RMS difference from Table 3.12",
        "Table 4.7",
        "Table 4.8",
        "closed by the measured edge",
    )
    answer = "\n".join(f"- {sentence}" for sentence in found["answer"])
    parts = (
        said,
        answer,
        "From the print alone:",
        table(heads, printed),
        "On our plant, one factor changed alone (0: the best combination):",
        ranked[0],
        "On top of the best, one effect at its usual size:",
        ranked[1],
        *parts_of,
        "Every measured cell on the best combination:",
        table(("", "measured", "predicted", "stray, deviations"), _strays(found)),
    )
    return "\n\n".join(parts)


def _strays(found: dict[str, Any]) -> list[tuple[str, ...]]:
    return [
        (
            f"Table {c['table']}, {c['workpiece']}, {c['row']}, {c['column']}",
            f"{c['value']:g}",
            f"{c['predicted']:.3g} ± {c['sd']:.2g}",
            f"{c['stray']:.1f}",
        )
        for c in found["cells"]
    ]


def contents() -> str:
    from pneugantry.thesis.contents import KINDS, contents_report

    listed = contents_report()
    _, found = read("thesis")
    beside: dict[str, list[bool]] = {}
    for cell in found["cells"]:
        if cell["kind"] != "fitted":
            beside.setdefault(f"Table {cell['table']}", []).append(cell["met"])
    rows = [
        (
            e["name"],
            f"`{e['ours']}`" if e["ours"] else "-",
            f"{sum(met)} of {len(met)}" if (met := beside.get(e["name"])) else "",
            e["why_not"],
        )
        for e in listed["entries"]
    ]
    heads = ("", "ours", "numbers met", "why not, or what is left out")
    kinds = "; ".join(f"{listed['kinds'][kind]} {text}" for kind, text in KINDS.items())
    return (
        f"`pneugantry thesis --list`: {listed['ours']} of {len(rows)} have ours: {kinds}. "
        "Numbers within 25 %: of [the tables above](#every-printed-number).\n\n"
        f"{table(heads, rows)}"
    )


PARTS: dict[str, Callable[[], str]] = {
    "shares": shares,
    "tables": tables,
    "conclusions": conclusions,
    "numbers": numbers,
    "findings": findings,
    "board": board,
    "peers": peers,
    "board_peers": lambda: board("thesis_board_peers"),
    "variants": variants,
    "tuning": tuning,
    "gap": gap,
    "contents": contents,
}


def page(text: str) -> str:
    """The page with every part between its marks written anew. Raises KeyError for an unknown
    part.
    """
    marks = r"(<!-- thesis: (\w+) -->\n).*?(<!-- end -->)"
    return re.sub(marks, lambda m: f"{m[1]}{part(m[2])}\n{m[3]}", text, flags=re.DOTALL)


def part(name: str) -> str:
    """A part, or what to run where its result has not been recorded."""
    try:
        return PARTS[name]()
    except FileNotFoundError as error:
        return f"Not recorded yet: `python docs/record.py {Path(error.filename).stem}`."


def draw() -> None:
    """The page's picture."""
    from pneugantry.thesis.gap_report import gap_figure

    path = HERE.parent / "images" / "thesis_gap.png"
    gap_figure(read("thesis_gap")[1]).savefig(path, dpi=DPI, pil_kwargs={"optimize": True})


if __name__ == "__main__":
    draw()
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
