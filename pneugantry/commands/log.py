"""`pneugantry log`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from modelica_fmu.files import write_atomically
from pneugantry.options import log_target, out_file

HELP = """A recorder's own log made usable: columns, units, rate, and how it was taken.

  pneugantry log init rig.csv  writes rig.toml: guessed columns and units, the set-up to fill in
  pneugantry log check rig.csv  reads it as rig.toml says; what was changed, what looks wrong
  pneugantry log convert rig.csv --out rig.parquet
      the same log at 1 kHz in SI units, its set-up inside

Parquet, CSV (comma, semicolon or tab; decimal point or comma) and MATLAB files (-v7). After
`init`, every command reads the log as it is: pneugantry diagnose rig.csv."""
ACTIONS = ("init", "check", "convert")


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("action", choices=ACTIONS)
    command.add_argument("log", metavar="LOG", type=Path, help="one log file")
    command.add_argument(
        "--out",
        metavar="FILE",
        type=out_file,
        help="init: the set-up file (default: the log's name, .toml); convert: the log to write",
    )
    command.add_argument("--force", action="store_true", help="init: replace a set-up file")


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    if options.action == "init":
        return _init(options.log, options.out, options.force), 0
    return _read(options.log, options.out if options.action == "convert" else None), 0


def _init(path: Path, out: Path | None, force: bool) -> dict[str, Any]:
    from pyfmi_runner.log import read_table
    from pyfmi_runner.log_template import guessed_columns, template

    target = out or path.with_suffix(".toml")
    if target.exists() and not force:
        raise InputError("is there already", file=target, hint="edit it, or give --force")
    table, _ = read_table(path)
    text = template(path, table)
    write_atomically(target, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    found = guessed_columns(table)
    for name, guess in found.items():
        print(f"{name:<6} = {guess.column!r} [{guess.unit}]")
    missing = [line.split()[0] for line in text.splitlines() if "NOT FOUND" in line]
    if missing:
        print(f"not found: {', '.join(missing)}")
    print(f"set-up: {target}; check its lines, then `pneugantry log check {path}`")
    columns = {name: guess._asdict() for name, guess in found.items()}
    return {"schema": "log/1", "setup": str(target), "columns": columns, "missing": missing}


def _read(path: Path, out: Path | None) -> dict[str, Any]:
    from pyfmi_runner.campaign import read_campaign, setup_table
    from pyfmi_runner.log import write_log
    from pyfmi_runner.suspicions import log_warnings

    campaign = read_campaign(path)
    run = next(iter(campaign))
    warnings = log_warnings(run.log)
    rows = len(run.log)
    print(f"{path}: {rows} rows, {rows / 1000:.1f} s at 1 kHz")
    for text in [*campaign.notes, *warnings]:
        print(f"note: {text}")
    result: dict[str, Any] = {
        "schema": "log/1",
        "rows": rows,
        "setup": setup_table(run.setup),
        "notes": campaign.notes,
        "warnings": warnings,
    }
    if out is not None:
        run.log.provenance["setup"] = setup_table(run.setup)
        write_log(run.log, log_target(str(out)))
        print(f"log: {out}")
        result["log"] = str(out)
    return result
