"""What each part of the diagnosis earns: the same cases with one rule changed.

`python -m benchmarks.ablations FOLDER [--cases N] [--seed S] [--set NAME] [--json FILE]`: draws N
cases of a set of the truth plant, diagnoses each by the rules as they are and with one changed, and
prints how often the answer is right: the causes named are the rig's, and the verdict fits.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pneugantry.blind.score import judged
from pneugantry.blind.sets import TRUTH, named_set, write_cases
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.rules import Rules
from pneugantry.plants.gantry.diagnosis import diagnose
from pneugantry.progress import bar
from pyfmi_runner.campaign import DRIVEN, read_campaign

__all__ = ["VARIANTS", "judge", "main", "table"]

VARIANTS: Mapping[str, Rules] = {
    "whole": Rules(),
    "one effect at most": replace(Rules(), rounds=1),
    "gains not doubted": replace(Rules(), doubt=0.0),
    "one form for each effect": replace(Rules(), reformed=0),
    "best screened effect alone": replace(Rules(), screened=1, finalists=1),
    "noise without heavy tails": replace(Rules(), tails=1e6),
    "no observer": replace(Rules(), observer=1e6),
}


def judge(folder: Path, variants: Mapping[str, Rules]) -> list[dict[str, Any]]:
    """The answers to one case: variant, kind, whether right, seconds."""
    truth = json.loads((folder / TRUTH).read_text(encoding="utf-8"))
    campaign = read_campaign(folder, needs=DRIVEN)
    rows = []
    for name, rules in variants.items():
        case = judged(folder.name, truth, to_json(diagnose(campaign, rules=rules).diagnosis))
        rows.append(
            {
                "case": folder.name,
                "variant": name,
                "kind": case.kind,
                "right": case.right,
                "block": case.block,
                "seconds": case.seconds,
            }
        )
    return rows


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Cases right by variant and kind, and the seconds that all cases of a variant took."""
    kinds = list(dict.fromkeys(str(r["kind"]) for r in rows))
    lines = [f"{'right':<30}" + "".join(f"{kind:>10}" for kind in kinds) + f"{'seconds':>10}"]
    for variant in dict.fromkeys(str(r["variant"]) for r in rows):
        own = [r for r in rows if r["variant"] == variant]
        cells = []
        for kind in kinds:
            right = [bool(r["right"]) for r in own if r["kind"] == kind]
            cells.append(f"{sum(right)} of {len(right)}")
        seconds = sum(float(r["seconds"]) for r in own)
        lines.append(f"{variant:<30}" + "".join(f"{c:>10}" for c in cells) + f"{seconds:10.0f}")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.ablations",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="of the cases")
    parser.add_argument("--cases", type=int, default=8, metavar="N")
    parser.add_argument("--seed", type=int, default=1000, metavar="S", help="of the first case")
    parser.add_argument("--set", default="nuisance", metavar="NAME", help="which rigs")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows as JSON")
    options = parser.parse_args(arguments)
    seeds = range(options.seed, options.seed + options.cases)
    folders = write_cases(options.folder, named_set(options.set), seeds)
    rows = [
        row for folder in bar(folders, len(folders), "ablate") for row in judge(folder, VARIANTS)
    ]
    print(table(rows))
    if options.json is not None:
        text = json.dumps({"schema": "ablations/1", "rows": rows}, indent=1)
        options.json.write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
