"""Friction levels of the seals, and their logs: `python -m examples.seals levels|convert`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from examples.seals.convert import (
    PRESSURES,
    SEALS,
    levels,
    pressure_fit,
    read_raw,
    write_seal,
)
from modelica_fmu.errors import InputError

RAW = Path(__file__).resolve().parents[3] / "shared" / "real" / "pneumatic_seals"


def printed(raw: Path) -> str:
    """Levels by seal and pressure, and what a level that grows with pressure explains."""
    lines = ["Friction in N, median step / half range of the force:", ""]
    lines.append("| seal | " + " | ".join(f"{bar} bar" for bar in PRESSURES) + " |")
    lines.append("|---" * (len(PRESSURES) + 1) + "|")
    rows = []
    for seal in SEALS:
        logs = {bar: read_raw(raw, seal, bar) for bar in PRESSURES if _exists(raw, seal, bar)}
        found = {bar: levels(log) for bar, log in logs.items()}
        cells = [
            f"{found[bar].median:.1f} / {found[bar].half_range:.1f}" if bar in found else "-"
            for bar in PRESSURES
        ]
        lines.append(f"| {seal} | " + " | ".join(cells) + " |")
        fit = pressure_fit(logs)
        rows.append(
            f"| {seal} | {fit['constant']:.2f} | {fit['growing']:.2f} | {fit['F_c']:.2f} "
            f"| {100 * fit['growth_per_bar']:.0f} |"
        )
    lines += ["", "Force while the rod moves, all pressures, RMS left in N:", ""]
    lines += ["| seal | level of 1 bar | level grows with pressure | F_c at 1 bar | % per bar |"]
    return "\n".join([*lines, "|---|---|---|---|---|", *rows])


def _exists(raw: Path, seal: str, bar: int) -> bool:
    return (raw / f"friction__{seal}_{bar}bar.csv").is_file()


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m examples.seals", description=__doc__)
    parser.add_argument("what", choices=("levels", "convert"))
    parser.add_argument("--raw", type=Path, default=RAW, metavar="DIR", help="recorded files")
    parser.add_argument("--out", type=Path, default=Path("out/seals"), metavar="DIR")
    parser.add_argument("--seal", default="O-ring", help=f"one of {', '.join(SEALS)}")
    parser.add_argument(
        "--friction",
        type=float,
        metavar="N",
        help="Coulomb friction of the nominal plant (default: this seal's own at 1 bar)",
    )
    options = parser.parse_args(arguments)
    try:
        if options.what == "levels":
            if not options.raw.is_dir():
                raise InputError("no such folder", file=options.raw, hint="give --raw DIR")
            print(printed(options.raw))
        else:
            print(write_seal(options.raw, options.out, options.seal, options.friction))
    except InputError as wrong:
        print(wrong, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
