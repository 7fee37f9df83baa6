"""What comparing the thesis with itself has shown: each finding with the numbers behind it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.gains import TABLE_3_11, PidGains
from pneugantry.analysis.force_loop import force_loop
from pneugantry.analysis.root_locus import root_locus
from pneugantry.thesis.conditions import CHOICE, MOTION_START, SOFT, Run
from pneugantry.thesis.printed import PRINTED_NOTES
from pneugantry.thesis.runner import Results
from pyfmi_runner.fmu import FmuFile

__all__ = [
    "MATERIALS",
    "ROUGHNESS",
    "WHOLE",
    "Finding",
    "finding_runs",
    "findings",
    "limit_gains",
    "rough_run",
]

F_ND, V_TD = 30.0, -0.06  # N, m/s
EDGES = ("straight", "curved")
K_P = TABLE_3_11.f_z.k_p + 0.1  # V/N: Table 4.6's and the k_v of Eq. 5-21 (Table 5.4)
STEEP = TABLE_3_11._replace(f_z=PidGains(K_P, TABLE_3_11.f_z.k_i))
NEURAL_PARTS: dict[str, tuple[str, tuple[tuple[str, object], ...]]] = {
    "PI FV": ("pi_fv", ()),
    f"PI FV, K_p {K_P:g}": ("pi_fv", (("gains", STEEP),)),
    "MBPM, no learning": ("pi_fv_mbpm", (("h_1", 0.0), ("h_2", 0.0), ("lam", 0.0))),
    "MBPM": ("pi_fv_mbpm", ()),
    "MBPM, network alone": ("pi_fv_mbpm", (("k_v", 0.0), ("k_z", 0.0))),
}
EBPA = {
    "momentum 0": Run("straight", "pi_fv_ebpa"),
    "momentum 0.1": Run("straight", "pi_fv_ebpa", options=(("alpha", 0.1),)),
    "curved, momentum 0": Run("curved", "pi_fv_ebpa"),
    "straight without finish, momentum 0": Run("straight", "pi_fv_ebpa", finish="none"),
}


# the curved edge to its end, past the -10 degree dip that the tables' window leaves out
WHOLE = Run("curved", choice=replace(CHOICE, motion=10.0))
DIP = (0.42, 0.52)  # m
ROUGHNESS = (0.0, 0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5)  # of the fitted finish's heights
# N, Table 3.8: RMSE f_n, ME f_n
MATERIALS = {"wood": (1.0, 9.0), "aluminium": (2.0, 10.4), "steel": (4.2, 15.6)}


@dataclass(frozen=True)
class Finding:
    """One sentence and its numbers."""

    name: str
    text: str
    numbers: dict[str, float]


def finding_runs() -> list[Run]:
    return [
        *(_part(name, edge) for name in NEURAL_PARTS for edge in EDGES),
        *EBPA.values(),
        WHOLE,
        *(rough_run(share) for share in ROUGHNESS),
    ]


def findings(results: Results, limits: dict[str, float]) -> list[Finding]:
    """From finished runs and the limit gains of `limit_gains`."""
    return [
        _gain(results, limits),
        _limit_cycle(results),
        _whole_edge(results),
        _materials(results),
        *_notes(),
    ]


def limit_gains(fmu: FmuFile) -> dict[str, float]:
    """Largest proportional gain [V/N] of the sampled z force loop, by contact and lag."""
    found = {}
    for choice in (SOFT, CHOICE):
        contact = {name: choice.plant()[name] for name in ("contact.K_c", "contact.C_c")}
        for lag in ("z", "x"):
            limit = root_locus(force_loop(fmu, "z", lag, parameters=contact)).sampled_limit
            name = f"limit gain, K_c {choice.contact_stiffness:g}, lag of {lag}"
            found[name] = float("inf") if limit is None else limit.gain
    return found


def _part(name: str, edge: str) -> Run:
    controller, options = NEURAL_PARTS[name]
    return Run(edge, controller, options=options)


def _gain(results: Results, limits: dict[str, float]) -> Finding:
    numbers = {
        f"{name}, {edge}": results[_part(name, edge)].rmse_fn
        for name in NEURAL_PARTS
        for edge in EDGES
    }
    text = (
        "Most of the neural gain is the P-gain of Eq. 5-21 (RMSE f_n [N]); and that gain, "
        f"{K_P:g} V/N in all, exceeds the limit of the root locus of Fig. 5.7's plant (V/N)."
    )
    return Finding("P-gain", text, numbers | limits)


def _limit_cycle(results: Results) -> Finding:
    numbers: dict[str, float] = {}
    for name, run in EBPA.items():
        done = results.finished(run)
        numbers |= {
            f"{name}: RMSE f_n [N]": done.scores.rmse_fn,
            f"{name}: share of the scored window, z valve at a limit": done.effort.limits_z,
            f"{name}: share of the motion, z valve at a limit": done.effort.moving_z,
            f"{name}: largest f_n before the scored window [N]": done.effort.peak,
            f"{name}: largest error of f_n there [N]": done.effort.before,
        }
    text = (
        "EBPA from weights of 0.1 meets its RMSE through a limit cycle of the valve, after forces "
        "about three times the wanted 30 N as its network starts, which no table scores."
    )
    return Finding("EBPA limit cycle", text, numbers)


def _whole_edge(results: Results) -> Finding:
    trace = results.trace(WHOLE)
    moving = trace.time >= MOTION_START
    dip = moving & (trace.x > DIP[0]) & (trace.x < DIP[1])
    numbers = {
        "x at the end [m]": float(trace.x[-1]),
        "RMSE f_n [N]": results[WHOLE].rmse_fn,
        "RMSE f_n within the tables' window [N]": results[Run("curved")].rmse_fn,
    }
    if dip.any():
        numbers |= {
            "RMSE f_n in the dip [N]": float(np.sqrt(np.mean((F_ND - trace.f_n[dip]) ** 2))),
            "RMSE v_t in the dip [m/s]": float(np.sqrt(np.mean((V_TD - trace.v_t[dip]) ** 2))),
            "steepest angle in the dip [deg]": float(np.degrees(trace.theta[dip].min())),
        }
    text = "The curved edge run whole, its -10 degree dip included; PI FV, measured finish."
    return Finding("Curved edge, whole", text, numbers)


def rough_run(share: float) -> Run:
    """The straight edge with the finish's heights times `share`, gains as in §3.5."""
    heights = tuple(
        (f"workpiece.A[{k}]", share * a) for k, a in enumerate(CHOICE.measured.amplitude, start=1)
    )
    return Run("straight", gains="table_3_7", plant=heights)


def _materials(results: Results) -> Finding:
    numbers: dict[str, float] = {}
    for name, (rmse, me) in MATERIALS.items():
        numbers |= {f"{name}, measured: RMSE f_n [N]": rmse, f"{name}, measured: ME f_n [N]": me}
    for share in ROUGHNESS:
        scores = results[rough_run(share)]
        numbers |= {
            f"finish x {share:g}: RMSE f_n [N]": scores.rmse_fn,
            f"finish x {share:g}: ME f_n [N]": scores.me_fn,
        }
    text = (
        "Table 3.8: the profiles of wood, aluminium and steel are not printed; the straight edge "
        "with the fitted finish scaled shows which height would give each."
    )
    return Finding("Materials", text, numbers)


def _notes() -> list[Finding]:
    return [Finding(name, text, dict(numbers)) for name, text, numbers in PRINTED_NOTES]
