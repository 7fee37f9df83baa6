"""Do the 95 % intervals of `pneugantry identify` hold the truth? `python -m
benchmarks.identify_coverage --cases N --seed S [--json FILE]`.

Campaigns without any effect, drawn from the independent truth plant (every parameter off by 2 %
RMS, but for u_0 and v_th), are fitted as by the command; each interval either holds its parameter
or does not. Holds 93-97 % of the time: the intervals mean what they say.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from scipy.stats import beta as beta_distribution

from pneugantry.analysis.identify.identification import fit_campaign
from pneugantry.analysis.identify.interval import Estimate
from pneugantry.analysis.identify.replayed import Plants
from pneugantry.truth.campaign import generate, write
from pneugantry.truth.case import plan_case
from pneugantry.truth.parameters import Rig
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import read_campaign
from pyfmi_runner.fmu import FmuFile

__all__ = ["Case", "coverage", "run_case", "truth_values"]

_AXIS = {
    "valve_{}.K": "gain",
    "valve_{}.u_0": "offset",
    "valve_{}.tau": "lag",
    "axis_{}.m": "mass",
    "axis_{}.C": "viscous",
    "axis_{}.F_w": "cable",
    "axis_{}.friction.F_s": "static",
    "axis_{}.friction.F_d": "dynamic",
    "axis_{}.friction.v_th": "band",
}
_CONTACT = {"contact.K_c": "stiffness", "contact.C_c": "damping"}


def truth_values(rig: Rig) -> dict[str, float]:
    """The FMU's parameters of a truth rig, and the sums that the logs show where the cable force is
    taken from the plant sheet.
    """
    values = {
        name.format(a): float(rig.axis[field][i])
        for i, a in enumerate("xz")
        for name, field in _AXIS.items()
    }
    values |= {name: float(rig.contact[field][0]) for name, field in _CONTACT.items()}
    for i, axis in enumerate("xz"):
        sign = float(rig.axis["sign"][i])
        for level in ("F_s", "F_d"):
            name = f"axis_{axis}.friction.{level}"
            values[f"{name} {'+' if sign > 0 else '-'} F_w"] = (
                values[name] + sign * values[f"axis_{axis}.F_w"]
            )
    return values


@dataclass(frozen=True)
class Case:
    """One campaign: by parameter its error in standard deviations, whether the interval holds it,
    and its error relative to the truth.
    """

    seed: int
    scores: dict[str, float]
    holds: dict[str, bool]
    errors: dict[str, float]
    sources: dict[str, str]
    gap: float
    seconds: float


def run_case(seed: int, file: FmuFile, plants: Plants, folder: Path) -> Case:
    """Draws, writes, reads and fits one campaign."""
    rig = plan_case(seed, "none").rig
    write(folder, generate(rig, seed))
    began = time.perf_counter()
    _, fit = fit_campaign(read_campaign(folder), file, plants)
    seconds = time.perf_counter() - began
    truth, estimates = truth_values(rig), fit.estimates() | fit.sums()
    known = {
        name: truth[name] for name in estimates
    }  # KeyError: fitted with another friction law than the truth's
    sources = {name: fit.sources.get(name, "logs") for name in estimates}
    return Case(
        seed,
        {
            name: (estimates[name].value - true) / estimates[name].sigma
            for name, true in known.items()
        },
        {name: estimates[name].low <= true <= estimates[name].high for name, true in known.items()},
        {name: estimates[name].value / true - 1 for name, true in known.items()},
        sources,
        fit.gap,
        seconds,
    )


def _share(hits: int, trials: int) -> Estimate:
    """Share with its exact binomial 95 % interval, as value and half-width."""
    low = float(beta_distribution.ppf(0.025, hits, trials - hits + 1)) if hits else 0.0
    high = float(beta_distribution.ppf(0.975, hits + 1, trials - hits)) if hits < trials else 1.0
    return Estimate(hits / trials, (high - low) / 2 / 1.96)


def coverage(cases: Sequence[Case]) -> dict[str, dict[str, float | str]]:
    """By parameter, and "all" for the parameters that the logs tell: share of intervals that hold,
    spread of the scores, worst error.
    """
    table: dict[str, dict[str, float | str]] = {}
    for name in cases[0].scores:
        held = [case.holds[name] for case in cases]
        scores = [case.scores[name] for case in cases]
        table[name] = {
            "cases": len(held),
            "holds": sum(held) / len(held),
            "spread": math.sqrt(sum(s * s for s in scores) / len(scores)),
            "worst": max(abs(case.errors[name]) for case in cases),
            "source": cases[0].sources[name],
        }
    told = [name for name in table if table[name]["source"] == "logs"]
    held = [case.holds[name] for case in cases for name in told]
    share = _share(sum(held), len(held))
    table["all"] = {
        "cases": len(held),
        "holds": share.value,
        "low": share.low,
        "high": share.high,
        "source": "logs",
    }
    everything = [case.holds[u] for case in cases for u in case.holds if " " not in u]
    table["all parameters"] = {
        "cases": len(everything),
        "holds": sum(everything) / len(everything),
        "source": "logs and sheet",
    }
    return table


def _print(table: Mapping[str, Mapping[str, float | str]]) -> None:
    print(
        f"{'parameter':30} {'rests on':>9} {'cases':>6} {'95 % interval holds':>20} "
        f"{'RMS error / sigma':>18} {'worst error':>12}"
    )
    for name, row in table.items():
        spread = (
            f"{row['spread']:18.2f} {100 * float(row['worst']):10.4f} %" if "spread" in row else ""
        )
        if "low" in row:
            spread = (
                f"  {100 * float(row['low']):.1f} .. {100 * float(row['high']):.1f} % by "
                f"the binomial law"
            )
        print(
            f"{name:30} {row['source']:>9} {row['cases']:6} "
            f"{100 * float(row['holds']):18.1f} % {spread}"
        )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=50)
    parser.add_argument(
        "--seed", type=int, default=1000, help="of the first case; the others follow"
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    file = FmuFile.read(build_fmu().path)
    cases = []
    with Plants(file) as plants, tempfile.TemporaryDirectory() as folder:
        for seed in range(options.seed, options.seed + options.cases):
            case = run_case(seed, file, plants, Path(folder) / str(seed))
            cases.append(case)
            held = sum(case.holds.values())
            print(
                f"case {seed}: {held} of {len(case.holds)} intervals hold, gap "
                f"{case.gap:.3f}, {case.seconds:.1f} s",
                flush=True,
            )
    table = coverage(cases)
    _print(table)
    if options.json:
        options.json.write_text(
            json.dumps({"cases": [vars(case) for case in cases], "table": table}, indent=1)
        )
    share = float(table["all"]["holds"])
    return 0 if 0.93 <= share <= 0.97 else 1


if __name__ == "__main__":
    raise SystemExit(main())
