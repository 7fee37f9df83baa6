"""`python -m studies.soak [--short] [--json FILE]`: a million steps, 100,000 instances, a million sanitized calls, 6,000 damaged files."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from pyfmi_runner.build import build_fmu
from pyfmi_runner.errors import InputError, RunError
from pyfmi_runner.fmu import FmuFile
from studies.soak.archives import fuzz_archives
from studies.soak.calls import sanitized_calls
from studies.soak.memory import ALLOWED, instances, steps


def soak(file: FmuFile, n_steps: int, n_instances: int, n_calls: int, n_files: int) -> dict[str, Any]:
    """All four, told as they end. "passed": no growth beyond ALLOWED, no report of a sanitizer, no crash, no file outside."""
    result: dict[str, Any] = {"schema": "soak/1", "passed": True}
    for growth in (steps(file, n_steps), instances(file, n_instances)):
        result[growth.what] = {"count": growth.number, "grown_bytes": growth.grown, "seconds": growth.seconds}
        result["passed"] &= growth.grown < ALLOWED
        print(f"{growth.number} {growth.what} in {growth.seconds:.1f} s: memory grew by {growth.grown / 1e6:.2f} MB")
    try:
        result["calls"] = sanitized_calls(file, n_calls)
        print("calls under the sanitizers: " + ", ".join(f"{v} {k}" for k, v in result["calls"].items()))
    except RunError as report:
        result |= {"calls": str(report), "passed": False}
        print(report)
    except InputError as error:
        result["calls"] = str(error)
        print(f"not run: {error}")
    result["files"] = fuzz_archives(file.path, n_files)
    crashes = sum(n for kind in result["files"]["kinds"].values() for what, n in kind.items() if what.startswith("crash"))
    result["passed"] &= crashes == 0 and result["files"]["escaped"] == 0
    print(f"{n_files} damaged files: {crashes} crashes, {result['files']['escaped']} files outside")
    for kind, counts in result["files"]["kinds"].items():
        print(f"  {kind}: " + ", ".join(f"{n} {what}" for what, n in sorted(counts.items())))
    return result


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m studies.soak", description=__doc__)
    parser.add_argument("--short", action="store_true", help="a hundredth of it")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the counts as JSON")
    options = parser.parse_args(arguments)
    share = 100 if options.short else 1
    file = FmuFile.read(build_fmu().path)
    result = soak(file, 1_000_000 // share, 100_000 // share, 1_000_000 // share, 6_000 // share)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    return 0 if result["passed"] else 1


if __name__ == "__main__":
    sys.exit(main())
