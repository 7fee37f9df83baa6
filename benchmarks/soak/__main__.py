"""`python -m benchmarks.soak [--short] [--only PART [--count N]] [--json FILE]`: a million
steps, 100,000 instances, a million sanitized calls, damaged files. --only: one kind of damaged
input alone.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.soak.archives import fuzz_archives
from benchmarks.soak.calls import sanitized_calls
from benchmarks.soak.fuzz import crashes, fuzz
from benchmarks.soak.logs import LOGS
from benchmarks.soak.memory import ALLOWED, instances, steps
from benchmarks.soak.models import MODELS, SIZES
from benchmarks.soak.tables import TABLES
from modelica_fmu.errors import InputError, RunError
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

DAMAGED = {"logs": LOGS, "tables": TABLES, "models": MODELS, "sizes": SIZES}


class Counts(NamedTuple):
    """How much of each."""

    steps: int = 1_000_000
    instances: int = 100_000
    calls: int = 1_000_000
    archives: int = 6_000
    logs: int = 100_000
    tables: int = 100_000
    models: int = 10_000
    sizes: int = 100

    def short(self) -> Counts:
        return Counts(*(count // 100 for count in self))


def soak(file: FmuFile, counts: Counts) -> dict[str, Any]:
    """All of it, told as it ends. "passed": no growth beyond ALLOWED, no report of a sanitizer, no
    crash, no file outside.
    """
    result: dict[str, Any] = {"schema": "soak/2", "passed": True}
    for growth in (steps(file, counts.steps), instances(file, counts.instances)):
        result[growth.what] = {
            "count": growth.number,
            "grown_bytes": growth.grown,
            "seconds": growth.seconds,
        }
        result["passed"] &= growth.grown < ALLOWED
        print(
            f"{growth.number} {growth.what} in {growth.seconds:.1f} s: memory grew by "
            f"{growth.grown / 1e6:.2f} MB"
        )
    try:
        result["calls"] = sanitized_calls(file, counts.calls)
        print(
            "calls under the sanitizers: "
            + ", ".join(f"{v} {k}" for k, v in result["calls"].items())
        )
    except RunError as report:
        result |= {"calls": str(report), "passed": False}
        print(report)
    except InputError as error:
        result["calls"] = str(error)
        print(f"not run: {error}")
    result["archives"] = fuzz_archives(file.path, counts.archives)
    result["passed"] &= result["archives"]["escaped"] == 0
    for name, kinds in DAMAGED.items():
        result[name] = fuzz(kinds, getattr(counts, name))
    for name in ("archives", *DAMAGED):
        result["passed"] &= told(name, result[name])
    return result


def told(name: str, found: dict[str, Any]) -> bool:
    """Prints the counts of one kind of damaged input; whether nothing crashed."""
    outside = f", {found['escaped']} files outside" if "escaped" in found else ""
    print(f"{found['tried']} damaged {name}: {crashes(found)} crashes{outside}")
    for kind, seen in found["kinds"].items():
        print(f"  {kind}: " + ", ".join(f"{n} {what}" for what, n in sorted(seen.items())))
    return crashes(found) == 0


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--short", action="store_true", help="a hundredth of it")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the counts as JSON")
    parser.add_argument("--only", choices=DAMAGED, metavar="PART", help=", ".join(DAMAGED))
    parser.add_argument("--count", type=int, metavar="N", help="how many of that kind")
    options = parser.parse_args(arguments)
    counts = Counts().short() if options.short else Counts()
    if options.only:
        count = getattr(counts, options.only) if options.count is None else options.count
        found = fuzz(DAMAGED[options.only], count)
        result = {"schema": "soak/2", "passed": told(options.only, found), options.only: found}
    else:
        result = soak(FmuFile.read(build_fmu().path), counts)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return 0 if result["passed"] else 1


if __name__ == "__main__":
    sys.exit(main())
