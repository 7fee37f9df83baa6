"""Why a conclusion is not reached: the same tables and conclusions with other values of what the
thesis does not print, or prints twice. A variant decides nothing; it shows on what a conclusion
hangs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pneugantry.thesis.conclusions import tracking_conclusions, tracking_runs
from pneugantry.thesis.conditions import CHOICE, SOFT, VDFM, Choice, Run
from pneugantry.thesis.edge import UP_ANGLES, ladder_cuts, ladder_runs
from pneugantry.thesis.printed import COLUMNS, printed_rows
from pneugantry.thesis.run_store import RunStore
from pneugantry.thesis.runner import Results, Tell, Workers
from pneugantry.thesis.settings import Seen, Setting
from pneugantry.thesis.tables import ablation_run, cells, met_share, table_runs
from pneugantry.thesis.verdicts import Range, Share, spread

__all__ = ["VARIANTS", "Tried", "Variant", "run_variants", "variant_lines", "variant_report"]

LUGRE, STRIBECK = 4.0, 5.0  # Types.FrictionLaw
INCLINES = ("incline_7", "incline_16")
GROUP = "random angle"


@dataclass(frozen=True)
class Variant:
    """Values in place of the choice's."""

    name: str
    source: str  # what speaks for them
    choice: Choice = CHOICE
    plant: tuple[tuple[str, float], ...] = ()

    def setting(self, draw: int) -> VariantSetting:
        return VariantSetting(GROUP, self.choice, "random", draw, extra=self.plant)


@dataclass(frozen=True)
class VariantSetting(Setting):
    """A setting with plant parameters of its own, which a table's case still overrides."""

    extra: tuple[tuple[str, float], ...] = ()

    def applied(self, run: Run) -> Run:
        run = super().applied(run)
        return run.changed(plant=self.extra + run.plant)


def _friction(law: float) -> tuple[tuple[str, float], ...]:
    return (("axis_z.friction.law", law),)


def _contact(stiffness: float, damping: float, limit: float = CHOICE.ddfm_limit) -> Choice:
    return replace(CHOICE, contact_stiffness=stiffness, contact_damping=damping, ddfm_limit=limit)


VARIANTS = (
    Variant("K_c 5e4, C_c 150", "the choice: Fig. 4.14, zero of Fig. 5.7"),
    Variant("K_c 1e4, C_c 30, beta 12", "Fig. 5.7; Figs. 4.14, 4.17", SOFT),
    Variant("K_c 5e4, C_c 30", "each as its figure reads: 4.14 and 5.7", _contact(5e4, 30.0)),
    Variant("K_c 5e4, C_c 30, beta 12", "the same, and 4.17", _contact(5e4, 30.0, 12.0)),
    Variant("K_c 2e4, C_c 60", "between the two figures", _contact(2e4, 60.0)),
    Variant("VDFM on z", "the first model, §4.2.1", plant=_friction(VDFM)),
    Variant("LuGre on z", "presliding and the F_s of Table C.2", plant=_friction(LUGRE)),
    Variant("Stribeck on z", "the F_s of Table C.2", plant=_friction(STRIBECK)),
    Variant("sigma 3e4 N/m", "not printed", replace(CHOICE, ddfm_stiffness=3e4)),
    Variant("sigma 3e5 N/m", "not printed", replace(CHOICE, ddfm_stiffness=3e5)),
    Variant("F_w 10 N", "not printed", replace(CHOICE, cable_x=10.0, cable_z=10.0)),
    Variant("F_w 15 N", "not printed", replace(CHOICE, cable_x=15.0, cable_z=15.0)),
)


@dataclass(frozen=True)
class Tried:
    """A variant over the draws of the random angle."""

    variant: Variant
    held: dict[int, Share]  # conclusions that tracking runs feed
    met: Range  # share of the unique printed simulation numbers
    no_lag: dict[str, float]  # N, RMSE f_n without lag, mean over draws, by workpiece
    pull: dict[float, tuple[float, float]]  # by uphill angle [deg]: cut of f_n, of v_t by pulling


def variant_runs(variant: Variant, draws: int) -> list[Run]:
    asked = [*table_runs(), *tracking_runs()]
    found = [variant.setting(draw).applied(run) for draw in range(draws) for run in asked]
    return [*found, *_ladder(variant)]


def _ladder(variant: Variant) -> list[Run]:
    """The uphill edges with the nominal x axis."""
    return [run for pair in _pairs(variant).values() for run in pair]


def _pairs(variant: Variant) -> dict[float, tuple[Run, Run]]:
    return {
        angle: (
            one.changed(plant=variant.plant + one.plant),
            both.changed(plant=variant.plant + both.plant),
        )
        for angle, (one, both) in ladder_runs(variant.choice, 0).items()
    }


def run_variants(
    fmu: Path,
    *,
    workers: int = 2,
    tell: Tell | None = None,
    draws: int = 8,
    store: RunStore | None = None,
) -> list[Tried]:
    """Raises RunError where the FMU cannot finish a run."""
    with Workers(fmu, workers, tell, store) as pool:
        traced = frozenset(run for variant in VARIANTS for run in _ladder(variant))
        wanted = [run for variant in VARIANTS for run in variant_runs(variant, draws)]
        results = pool.collect(pool.start_runs(wanted, traced))
    return [tried(variant, results, draws) for variant in VARIANTS]


def tried(variant: Variant, results: Results, draws: int) -> Tried:
    seen = [Seen(results, variant.setting(draw)) for draw in range(draws)]
    judged = [c for one in seen for c in tracking_conclusions(one)]
    by_id: dict[int, list[bool]] = {}
    for conclusion in judged:
        by_id.setdefault(conclusion.id, []).append(conclusion.holds)
    no_lag = {
        piece: sum(one[ablation_run(piece, "no lag")].rmse_fn for one in seen) / draws
        for piece in INCLINES
    }
    return Tried(
        variant,
        {number: Share(sum(held), len(held)) for number, held in sorted(by_id.items())},
        spread([met_share(cells(one)) for one in seen]),
        no_lag,
        {angle: ladder_cuts(results, pair, angle) for angle, pair in _pairs(variant).items()},
    )


def printed_no_lag() -> dict[str, float]:
    """RMSE f_n [N] of Tables 4.12 and 4.13 without lag."""
    column = COLUMNS.index("RMSE f_n")
    rows = [r for r in printed_rows() if r.table in ("4.12", "4.13") and r.row.startswith("no lag")]
    return {row.workpiece: float(row.values[column] or 0.0) for row in rows}


def variant_report(found: list[Tried]) -> dict[str, Any]:
    """The JSON, `thesis_variants/1`."""
    return {
        "schema": "thesis_variants/1",
        "printed_no_lag": printed_no_lag(),
        "variants": [
            {
                "name": t.variant.name,
                "source": t.variant.source,
                "held": {str(number): share.held for number, share in t.held.items()},
                "draws": next(iter(t.held.values())).of,
                "met": t.met.mean,
                "met_range": (t.met.low, t.met.high),
                "no_lag": t.no_lag,
                "pull": [
                    {"angle": angle, "cut_f_n": f_n, "cut_v_t": v_t}
                    for angle, (f_n, v_t) in t.pull.items()
                ],
            }
            for t in found
        ],
    }


def variant_lines(found: list[Tried]) -> Iterator[str]:
    numbers = list(found[0].held)
    draws = next(iter(found[0].held.values())).of
    yield (
        f"Other values of what is not printed, {draws} draws of the random angle: draws in which a "
        "conclusion holds; printed numbers met"
    )
    yield f"  {'':<26}" + "".join(f"{n:>5}" for n in numbers) + "    met"
    for t in found:
        held = "".join(f"{share.held:>5}" for share in t.held.values())
        yield f"  {t.variant.name:<26}{held}{t.met.mean:>7.0%}   {t.variant.source}"
    printed = ", ".join(f"{piece} {rmse:g}" for piece, rmse in printed_no_lag().items())
    yield f"\nRMSE f_n [N] without lag on the inclines (printed: {printed})"
    for t in found:
        yield f"  {t.variant.name:<26}" + "".join(f"{v:>8.2f}" for v in t.no_lag.values())
    yield "\nCut of RMSE f_n / v_t by valves that also pull, by uphill angle (conclusion 8)"
    yield f"  {'':<26}" + "".join(f"{angle:>14g}" for angle in UP_ANGLES)
    for t in found:
        cuts = "".join(f"{f_n:>7.0%} {v_t:>6.0%}" for f_n, v_t in t.pull.values())
        yield f"  {t.variant.name:<26}{cuts}"
