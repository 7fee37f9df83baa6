"""The servo pendulum: rungs, logs, planted errors, missing term; `python -m examples.bam -h`."""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from pathlib import Path

import numpy as np

from examples.bam import learnt, planted
from examples.bam.convert import description, read_raw, write_logs
from examples.bam.servo import (
    FITTED_GAINS,
    HELD_GAINS,
    RUNGS,
    error,
    log_names,
    published,
    refitted,
)
from modelica_fmu.errors import InputError

RAW = Path(__file__).resolve().parents[3] / "shared" / "real" / "bam_xl330"
REFITTED = Path(__file__).parent / "refitted.toml"
README_TABLE = {  # RMS position error [rad], as the README beside the data has it
    "m1": (0.137, 0.124, 0.196, 0.033, 0.237),
    "m3": (0.103, 0.099, 0.134, 0.016, 0.256),
    "m6": (0.108, 0.093, 0.167, 0.012, 0.265),
}
README_LOGS = (
    "sin_sin_kp400",
    "sin_sin_kp200",
    "lift_and_drop_kp400",
    "sin_time_square_kp100",
    "up_and_down_kp800",
)


def rungs(raw: Path, rungs_of: tuple[str, ...] = ("m1", "m3", "m6")) -> dict[str, dict]:
    """Errors of each rung: as published, and refitted on the gains 100 and 400 of these logs."""
    logs = {name: read_raw(raw, name) for name in log_names()}
    fitted = {name: logs[name] for name in log_names(FITTED_GAINS)}
    table = {}
    for rung in rungs_of:
        before = published(raw, rung)
        after = refitted(before, RUNGS[rung], fitted)
        table[rung] = {
            "readme": {n: error(before, n, logs[n]) for n in README_LOGS},
            "values": {name: after[name] for name in (*RUNGS[rung], "alpha")},
            **{
                f"{what}_{which}": _mean([error(values, n, logs[n]) for n in log_names(gains)])
                for what, values in (("published", before), ("refitted", after))
                for which, gains in (("fitted", FITTED_GAINS), ("held", HELD_GAINS))
            },
        }
    return table


def _mean(errors: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def printed(table: dict[str, dict]) -> str:
    """The tables in Markdown."""
    lines = ["RMS position error in rad, ours (README beside the data), published parameters:", ""]
    lines.append("| rung | " + " | ".join(README_LOGS) + " |")
    lines.append("|---" * (len(README_LOGS) + 1) + "|")
    for rung, row in table.items():
        known = README_TABLE.get(rung, ())
        cells = [
            f"{row['readme'][name]:.3f} ({value:.3f})"
            for name, value in zip(README_LOGS, known, strict=True)
        ]
        lines.append(f"| {rung} | " + " | ".join(cells) + " |")
    lines += ["", "All 16 logs, RMS; refitted on the gains 100 and 400, the others held out:", ""]
    lines += ["| rung | published, 100 + 400 | published, 200 + 800 | refitted | held out |"]
    lines += ["|---|---|---|---|---|"]
    for rung, row in table.items():
        cells = [
            f"{row[key]:.4f}"
            for key in ("published_fitted", "published_held", "refitted_fitted", "refitted_held")
        ]
        lines.append(f"| {rung} | " + " | ".join(cells) + " |")
    for rung, row in table.items():
        values = ", ".join(f"{name} {value:.5g}" for name, value in row["values"].items())
        lines += ["", f"{rung} refitted: {values}"]
    return "\n".join(lines)


def _planted(options: argparse.Namespace) -> dict:
    """The study of planted errors. Raises InputError for a number of cases below 1."""
    if options.cases is not None and options.cases < 1:
        raise InputError(f"is {options.cases}, expected >= 1", field="--cases", hint="give 1 to 24")
    right = tomllib.loads(REFITTED.read_text(encoding="utf-8"))["parameters"]
    return planted.figures(
        options.raw,
        options.out / ("planted_encoder" if options.encoder else "planted"),
        right,
        cases=options.cases,
        encoder=options.encoder,
        say=lambda name: print(name, file=sys.stderr, flush=True),
    )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m examples.bam", description=__doc__)
    parser.add_argument("what", choices=("rungs", "convert", "planted", "learnt"))
    parser.add_argument("--raw", type=Path, default=RAW, metavar="DIR", help="recorded CSV files")
    parser.add_argument("--out", type=Path, default=Path("out/bam"), metavar="DIR")
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="the table of rungs, learnt or planted as JSON"
    )
    parser.add_argument("--cases", type=int, metavar="N", help="planted: so many of the 24")
    parser.add_argument(
        "--encoder",
        action="store_true",
        help="planted: judge by the encoder's noise, not by what the right plant leaves",
    )
    options = parser.parse_args(arguments)
    try:
        if options.what == "rungs":
            table = rungs(options.raw)
            print(printed(table))
            if options.json:
                options.json.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
        elif options.what == "learnt":
            found = learnt.figures(options.raw, options.out)
            print(learnt.printed(found))
            if options.json:
                options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        elif options.what == "convert":
            logs = write_logs(options.raw, options.out)
            text = description(options.out, logs, {})
            (options.out / "plant.toml").write_text(text, encoding="utf-8")
            print(f"{len(logs)} logs and plant.toml in {options.out}")
        else:
            table = _planted(options)
            print(planted.printed(table))
            if options.json:
                options.json.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    except InputError as wrong:
        print(wrong, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
