"""Effects that no catalogue lists, each in a block of its own right."""

from __future__ import annotations

import numpy as np

from pneugantry.truth.form import AXES, Build, Form, Parameters, either
from pneugantry.truth.parameters import FORCE, Rig

NO_AXIS = ("",)


def _set(record: str, name: str, signed: bool = False, **beside: tuple[float, float]) -> Build:
    """Build that puts the size into one field of `record` and uniform draws into the fields beside
    it.
    """

    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        table = getattr(rig, record)
        drawn = {name: (either(rng) if signed else 1.0) * size}
        drawn.update({key: rng.uniform(*span) for key, span in beside.items()})
        for key, value in drawn.items():
            table[key][i if len(table) == 2 else 0] = value
        return drawn

    return build


def _set_force_cell(name: str, signed: bool = False) -> Build:
    """Build that puts the size into one field of both force channels."""

    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        values = [
            (either(rng) if signed else 1.0) * size * share
            for share in (rng.uniform(0.3, 1.0), 1.0)
        ]
        rig.sensor[name][4:6] = values
        return {f"{name}_f_x": values[0], f"{name}_f_z": values[1]}

    return build


def _saturation(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.sensor["full"][4:6] = 1.0 / size
    return {"full": 1.0 / size}


def _spool_oscillates(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    omega, zeta = 1.0 / size, rng.uniform(0.08, 0.4)
    rig.axis["spool_omega"][i], rig.axis["spool_zeta"][i] = omega, zeta
    return {"omega": omega, "zeta": zeta}


def _slew(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.axis["slew"][i] = 1.0 / size
    return {"slew": 1.0 / size}


def _cogging(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    pitch, phase = rng.uniform(0.05, 0.15) * rig.axis["stroke"][i], rng.uniform(0.0, 2 * np.pi)
    rig.profile[i, FORCE] += size * np.sin(2 * np.pi * rig.stroke_nodes(i) / pitch + phase)
    return {"amplitude": size, "pitch": pitch, "phase": phase}


def _hose_spring(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    free, bend = rng.uniform(0.2, 0.8), rng.uniform(1.0, 2.0)
    arm = np.linspace(0.0, 1.0, rig.profile.shape[2]) - free
    rig.profile[i, FORCE] += size * np.sign(arm) * np.abs(2.0 * arm) ** bend
    return {"force_at_half_stroke": size, "free_at": free * rig.axis["stroke"][i], "exponent": bend}


def _dropout(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    length = rng.integers(5, 60)
    hit = rng.choice(8, size=int(rng.integers(1, 4)), replace=False)
    rig.sensor["dropout"][hit], rig.sensor["hold"][hit] = size, length
    return {"chance": size, "hold": float(length), "channels": len(hit)}


def _noisy(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    hit = rng.choice(8, size=int(rng.integers(1, 4)), replace=False)
    rig.sensor["noise"][hit] *= 1.0 + size
    return {"factor": 1.0 + size, "channels": len(hit)}


def _whole(name: str) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        rig.timing[name] = max(round(size), 1) if name != "divider" else 1 + max(round(size), 1)
        return {name: rig.timing[name][0]}

    return build


def _clock(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.timing["clock"] = either(rng) * size
    return {"excess": rig.timing["clock"][0]}


def _dead_band(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    rig.axis["dead_band"][i], rig.axis["dead_centre"][i] = (
        size,
        rig.axis["offset"][i] + rng.uniform(0.05, 0.3),
    )
    return {"width": size, "centre": rig.axis["dead_centre"][i]}


def _form(
    effect: str,
    part: str,
    axes: tuple[str, ...],
    sizes: tuple[float, float, str],
    build: Build,
) -> Form:
    """sizes: least, largest, unit."""
    low, high, unit = sizes
    return Form(effect, "out_of_catalogue", part, axes, low, high, unit, build, known=False)


UNKNOWN_FORMS = [
    _form(
        "dead_point_drift",
        "valve",
        AXES,
        (0.01, 0.12, "V"),
        _set("axis", "drift", True, drift_time=(1.5, 6.0)),
    ),
    _form("sticking_spool", "valve", AXES, (0.008, 0.08, "V"), _set("axis", "spool_stick")),
    _form("oscillating_spool", "valve", AXES, (1 / 120, 1 / 12, "s/rad"), _spool_oscillates),
    _form(
        "chamber_leak",
        "valve",
        AXES,
        (0.08, 1.0, "of the lag rate"),
        _set("axis", "leak", leak_from=(5.0, 20.0)),
    ),
    _form("slew_limit", "valve", AXES, (1 / 150, 1 / 25, "s/N"), _slew),
    _form("spool_overlap", "valve", AXES, (0.01, 0.12, "V"), _dead_band),
    _form(
        "dwell_friction",
        "friction",
        AXES,
        (0.06, 0.6, "per decade"),
        _set("axis", "dwell", dwell_from=(0.02, 0.2)),
    ),
    _form("cubic_viscous", "friction", AXES, (100.0, 3000.0, "N s^3/m^3"), _set("axis", "cubic")),
    _form("cogging", "friction", AXES, (0.4, 6.0, "N"), _cogging),
    _form(
        "warming_seal",
        "friction",
        AXES,
        (0.08, 0.6, "fraction"),
        _set("axis", "warm", warm_time=(3.0, 12.0)),
    ),
    _form(
        "warming_by_work",
        "friction",
        AXES,
        (0.08, 0.6, "fraction"),
        _set("axis", "warm", warm_work=(0.3, 3.0)),
    ),
    _form("hose_spring", "friction", AXES, (0.5, 8.0, "N"), _hose_spring),
    _form(
        "impact_damping",
        "contact",
        NO_AXIS,
        (3e3, 1.5e5, "N s/m^2"),
        _set("contact", "impact_damping"),
    ),
    _form(
        "elastic_loss",
        "contact",
        NO_AXIS,
        (0.005, 0.15, "relative"),
        _set("contact", "loss", loss_rate=(1e-3, 5e-3)),
    ),
    _form(
        "creep_of_tool",
        "contact",
        NO_AXIS,
        (8e2, 2e4, "N/m"),
        _set("contact", "creep_stiffness", creep_time=(0.1, 1.5)),
    ),
    _form(
        "soft_spot",
        "contact",
        NO_AXIS,
        (0.08, 0.7, "fraction"),
        _set("contact", "soft_depth", soft_at=(0.5, 0.9), soft_width=(0.02, 0.12)),
    ),
    _form("force_drift", "sensors", NO_AXIS, (0.01, 0.3, "N/s"), _set_force_cell("drift", True)),
    _form(
        "force_cubic",
        "sensors",
        NO_AXIS,
        (0.02, 0.3, "relative at 50 N"),
        _set_force_cell("cubic", True),
    ),
    _form("force_saturation", "sensors", NO_AXIS, (1 / 80, 1 / 25, "1/N"), _saturation),
    _form("dropout", "sensors", NO_AXIS, (3e-3, 1e-1, "per sample"), _dropout),
    _form("excess_noise", "sensors", NO_AXIS, (0.5, 6.0, "relative"), _noisy),
    _form("jitter", "timing", NO_AXIS, (2.0, 30.0, "samples"), _whole("jitter")),
    _form("missed_samples", "timing", NO_AXIS, (0.05, 0.9, "per sample"), _set("timing", "miss")),
    _form("clock_drift", "timing", NO_AXIS, (0.01, 0.12, "relative"), _clock),
    _form("slow_controller", "timing", NO_AXIS, (1.0, 30.0, "samples"), _whole("divider")),
    _form("stalls", "timing", NO_AXIS, (10.0, 300.0, "samples"), _whole("burst")),
]
