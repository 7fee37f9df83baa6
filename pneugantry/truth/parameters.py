"""Every number of the rig, as plain structured arrays that the compiled plant reads by field name.

Source: docs "plant" sheet after Abu Mallouh 2008 (Tables 3.3, 3.13, C.1, C.2, 4.1-4.6, section
4.1). SI units. Index 0 is the x axis, 1 the z axis. Fields marked (effect) are neutral here and are
set by `effects` only.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Record = Any  # one entry of a structured array, read by field name in compiled code
X, Z = 0, 1
CHANNELS = ("x", "z", "v_x", "v_z", "f_x", "f_z", "f_ax", "f_az")
SIGMA = np.array(
    [3e-4, 1e-4, 1e-3, 5e-4, 0.05, 0.05, 0.05, 0.05]
)  # m, m, m/s, m/s, N, N, N, N; Table 3.3, RMS
ROUNDING = np.array(
    [5e-5, 2e-5, 2e-4, 1e-4, 0.01, 0.01, 0.01, 0.01]
)  # grid of a logged channel, about sigma / 5
COMMAND_ROUNDING = 1e-4  # V

VDFM, DAHL, LUGRE, IWAN = 0, 1, 2, 3  # friction laws; DDFM (Eq. 4-8) is DAHL with exponent 2
LAG, LEVEL, FORCE = (
    0,
    1,
    2,
)  # rows of Rig.profile: factor on tau, on Coulomb friction; force [N] towards -axis
# places of a random term: valve_x, valve_z, friction_x, friction_z, contact, eight sensors
TERMS = 13
FEATURES = 16  # waves that make up a random function
TERM_LENGTH = 12 + 4 * FEATURES
NODES = 401  # nodes of a stroke profile, evenly spaced from 0 to the end of stroke

# name, x, z, meaning [unit]; source
_AXIS = [
    ("mass", 7.3, 2.25, "moving mass [kg]; section 4.1.1"),
    ("viscous", 74.0, 40.0, "C [N s/m]; Table 3.13"),
    ("static", 25.0, 20.0, "F_s, break-away force [N]; Tables C.1, C.2"),
    ("dynamic", 11.0, 15.0, "F_d, Coulomb force while sliding [N]; Tables C.1, C.2"),
    ("cable", 5.0, 5.0, "F_w, transducer cable, pulls towards -axis [N]; assumed"),
    ("band", 0.01, 0.01, "v_th, half-width of the stick band [m/s]; Eq. 3-18"),
    ("stroke", 1.0, 0.101, "end stop [m], the other one is at 0"),
    ("gain", 186.0, 100.0, "K, valve gain [N/V]; Tables 4.1-4.5"),
    ("offset", 0.635, 0.735, "u_0, dead point of the valve [V]; Tables 4.1-4.5"),
    ("lag", 0.30, 0.15, "tau, lag of the chamber force [s]; section 4.1.3"),
    ("limit", 443.0, 156.0, "f_max [N]: 551 kPa on bores of 32 and 19 mm"),
    ("sign", -1.0, 1.0, "s, direction in which the valve pushes; section 4.3.1"),
    ("bidirectional", 0.0, 0.0, "1: u - u_0 may push either way"),
    # valve (effect)
    ("delay", 0.0, 0.0, "transport delay of the command [s]"),
    ("play", 0.0, 0.0, "full width of the play on the command [V]"),
    (
        "play_elements",
        1.0,
        1.0,
        "1: one play; 2..8: equal plays of graded width in parallel (Prandtl-Ishlinskii)",
    ),
    (
        "spool_stick",
        0.0,
        0.0,
        "the spool holds until the command is this far away, then jumps to it [V]",
    ),
    (
        "dead_band",
        0.0,
        0.0,
        "spool overlap: width of command around `dead_centre` that changes nothing [V]",
    ),
    ("dead_centre", 0.0, 0.0, "command at the middle of the overlap [V]"),
    ("drift", 0.0, 0.0, "final shift of u_0 while the valve warms up [V]"),
    ("drift_time", 1.0, 1.0, "time constant of that shift [s]"),
    ("knee", 0.0, 0.0, "width over which the valve opens softly above u_0 [V]"),
    ("lag_rise", 1.0, 1.0, "factor on tau while |f_a| rises"),
    ("lag_fall", 1.0, 1.0, "factor on tau while |f_a| falls"),
    ("lag_blend", 0.0, 0.0, "force difference over which rise turns to fall [N]; 0: abrupt"),
    ("second_lag", 0.0, 0.0, "time constant of a second stage before the chamber [s]"),
    (
        "spool_omega",
        0.0,
        0.0,
        "natural frequency of a spool in front of the chamber [rad/s]; 0: none",
    ),
    ("spool_zeta", 1.0, 1.0, "its damping ratio"),
    ("sag", 0.0, 0.0, "fraction of the supply lost at full load"),
    ("sag_flow", 0.0, 0.0, "fraction of a full chamber's filling that the reservoir loses"),
    ("sag_exponent", 1.0, 1.0, "the lost fraction grows as (|f_a| / f_max)^exponent"),
    ("sag_time", 0.5, 0.5, "time constant of sagging [s]"),
    ("recover_time", 2.0, 2.0, "time constant of recovering [s]"),
    ("leak", 0.0, 0.0, "leak of the chamber above `leak_from`, times 1/tau"),
    ("leak_from", 0.0, 0.0, "chamber force at which the seal starts to leak [N]"),
    ("slew", 0.0, 0.0, "largest rate of the chamber force [N/s]; 0: none"),
    ("curvature", 0.0, 0.0, "share of the gain lost per volt above u_0 [1/V]"),
    ("lag_pressure", 0.0, 0.0, "growth of tau at 100 N of chamber force"),
    ("cycle", 0.0, 0.0, "fraction of the supply lost where the compressor starts to fill"),
    ("cycle_time", 2.0, 2.0, "period of the compressor [s]"),
    ("cycle_phase", 0.0, 0.0, "share of a period that has passed when the rig is switched on"),
    ("cycle_fill", 0.3, 0.3, "share of a period in which the supply rises"),
    # friction (effect)
    ("law", 0.0, 0.0, "friction law, VDFM, DAHL, LUGRE or IWAN"),
    ("stiffness", 1e5, 1e5, "pre-sliding stiffness at F = 0 [N/m]; read off Fig. 4.14/4.17"),
    ("bristle_damping", 0.0, 0.0, "sigma_1 of LuGre [N s/m]"),
    (
        "limit_ratio",
        1.0,
        0.8,
        "limit force of a smooth law over F_d: beta = 12 N on z, Fig. 4.14/4.17",
    ),
    ("dahl_exponent", 2.0, 2.0, "exponent of the Dahl law; Eq. 4-8 has 2"),
    ("stribeck", 0.0, 0.0, "v_s, Stribeck speed [m/s]; 0: none"),
    ("stribeck_shape", 1.0, 1.0, "> 0: exp(-(v/v_s)^shape); 0: 1/(1 + (v/v_s)^2)"),
    ("direction", 0.0, 0.0, "Coulomb level times 1 + this towards +axis, 1 - this towards -axis"),
    ("load", 0.0, 0.0, "growth of the Coulomb level at 10 N of contact force"),
    ("load_exponent", 1.0, 1.0, "it grows as (|f_n| / 10 N)^exponent"),
    ("cubic", 0.0, 0.0, "C_3 of a force C_3 v^3 [N s^3/m^3]"),
    ("quadratic", 0.0, 0.0, "C_2 of a force C_2 v |v| [N s^2/m^2]"),
    ("seal", 0.0, 0.0, "growth of the Coulomb level at 100 N of chamber force"),
    ("thin", 0.0, 0.0, "fraction of C lost when the grease is warm"),
    ("thin_work", 1.0, 1.0, "work of friction that warms it to 63 % [J]"),
    ("shake", 0.0, 0.0, "amplitude of a force from outside [N]"),
    ("shake_hz", 8.0, 8.0, "its frequency [Hz]"),
    ("shake_phase", 0.0, 0.0, "its phase when the rig is switched on [rad]"),
    ("base_ratio", 0.0, 0.0, "moving mass over the mass of an elastic base; 0: rigid base"),
    ("base_omega", 50.0, 50.0, "natural frequency of the base [rad/s]"),
    ("base_zeta", 0.05, 0.05, "its damping ratio"),
    ("dwell", 0.0, 0.0, "growth of F_s per decade of rest"),
    ("dwell_from", 0.05, 0.05, "rest from which F_s grows [s]"),
    ("warm", 0.0, 0.0, "fraction of the Coulomb friction lost when warm"),
    ("warm_work", 0.0, 0.0, "work of friction that warms the seal to 63 % [J]; 0: by time"),
    ("warm_time", 10.0, 10.0, "time that warms it to 63 % [s]"),
    ("coupling", 0.0, 0.0, "force on this axis per acceleration of the other [kg]"),
    ("coupling_limit", 0.0, 0.0, "level at which that force saturates [N]; 0: never"),
]
_CONTACT = [
    ("stiffness", 1.0e4, "K_c [N/m]; Fig. 5.7"),
    ("damping", 30.0, "C_c [N s/m]; Fig. 5.7"),
    # (effect)
    ("harden_at", 0.0, "deflection at which the stiffness force doubles [m]; 0: linear"),
    ("harden_power", 1.0, "p in K_c d (1 + (d / harden_at)^p)"),
    ("drag", 0.0, "mu of f_t = mu f_n sgn v_t"),
    ("drag_speed", 0.005, "speed over which that sign turns [m/s]"),
    ("drag_stribeck", 0.0, "extra share of mu at low speed, gone at ten times drag_speed"),
    ("tilt", 0.0, "extra mounting angle of the workpiece [rad]"),
    ("pivot", 0.95, "x about which it is tilted [m]"),
    (
        "tilt_bow",
        0.0,
        "share of the tilt that comes from a bow: the angle changes by this share over the edge",
    ),
    ("impact_damping", 0.0, "Hunt-Crossley damping [N s/m^2]"),
    ("loss", 0.0, "relative difference of the spring force between loading and unloading, halved"),
    ("loss_rate", 1e-3, "deflection rate over which it turns [m/s]"),
    ("creep_stiffness", 0.0, "stiffness of a Maxwell branch in parallel (Zener) [N/m]"),
    ("creep_time", 0.3, "its time constant [s]"),
    ("soft_depth", 0.0, "relative loss of stiffness at the soft spot of the edge"),
    ("soft_at", 0.7, "middle of the soft spot [m]"),
    ("soft_width", 0.05, "its width [m]"),
    ("gradient", 0.0, "relative growth of K_c per metre along x [1/m]"),
    ("gradient_mid", 0.7, "x at which K_c is as given [m]"),
    ("rate_square", 0.0, "damping that grows with the square of the deflection rate [N s^2/m^2]"),
]
_SENSOR = [  # one entry per channel
    ("bias", 0.0, "offset of the channel [its unit]"),
    ("bias_time", 0.0, "time constant with which the offset builds up [s]; 0: at once"),
    ("gain", 1.0, "scale of the channel"),
    ("gain_negative", 1.0, "further scale of negative readings"),
    ("cubic", 0.0, "relative error at `cubic_at`, growing as the cube"),
    ("cubic_at", 50.0, "reading at which it holds [its unit]"),
    ("cross", 0.0, "share of the partner channel (other axis) that leaks in"),
    ("lag", 0.0, "mean lag of the channel [s]"),
    ("lag_stages", 1.0, "equal first-order stages that make up the lag; 0: running mean"),
    ("step", 0.0, "step of the converter [its unit]; 0: none"),
    ("step_floor", 0.0, "1: the converter cuts off, 0: it rounds"),
    ("drift", 0.0, "drift rate [its unit per s]"),
    ("noise", 1.0, "factor on the noise"),
    ("dropout", 0.0, "chance per sample that a hold begins"),
    ("hold", 0.0, "length of a hold [samples]"),
    ("full", 0.0, "reading at which the channel saturates softly [its unit]; 0: never"),
    ("cyclic", 0.0, "amplitude of an error that repeats along the scale [its unit]"),
    ("cyclic_pitch", 0.02, "length over which it repeats [its unit]"),
    ("play", 0.0, "half-width of an elastic hysteresis [its unit]; 0: none"),
    ("play_share", 0.0, "share of the reading that has it"),
    ("hum", 0.0, "amplitude of a hum [its unit]"),
    ("hum_hz", 50.0, "its frequency [Hz]"),
]
_TIMING = [
    ("sense_delay", 0.0, "samples by which the controller sees the sensors late"),
    ("act_delay", 0.0, "samples by which a computed command acts late"),
    ("jitter", 0.0, "extra delay, uniform in 0..jitter samples, drawn anew each sample"),
    ("miss", 0.0, "chance that the controller misses a sample and holds its command"),
    ("divider", 1.0, "the controller runs each `divider` samples"),
    ("clock", 0.0, "relative excess of the true sample period over 1 ms"),
    ("burst", 0.0, "length of a stall of the controller, once a second [samples]"),
]


def _record(rows: list[tuple], count: int) -> np.ndarray:
    out = np.zeros(count, dtype=[(row[0], "f8") for row in rows])
    for name, *values, _ in rows:
        out[name] = values if len(values) == count else values[0]
    return out


def _flat_profile() -> np.ndarray:
    profile = np.ones((2, 3, NODES))
    profile[:, FORCE] = 0.0
    return profile


@dataclass
class Rig:
    """One rig. `axis`: 2 records; `contact`, `timing`: 1; `sensor`: 8, in the order of CHANNELS;
    `profile[axis, kind, node]`: factor or force along the stroke; `edge`: extra profile of the
    workpiece, x [m] -> z [m], or None; `terms`: one random function per place, as `random_term`
    lays it out.
    """

    axis: np.ndarray = field(default_factory=lambda: _record(_AXIS, 2))
    contact: np.ndarray = field(default_factory=lambda: _record(_CONTACT, 1))
    sensor: np.ndarray = field(default_factory=lambda: _record(_SENSOR, 8))
    timing: np.ndarray = field(default_factory=lambda: _record(_TIMING, 1))
    profile: np.ndarray = field(default_factory=_flat_profile)
    edge: Callable[[np.ndarray], np.ndarray] | None = None
    terms: np.ndarray = field(default_factory=lambda: np.zeros((TERMS, TERM_LENGTH)))

    def copy(self) -> Rig:
        """A rig that shares nothing with this one."""
        return deepcopy(self)

    def stroke_nodes(self, axis: int) -> np.ndarray:
        """Positions [m] of the nodes of `profile[axis]`."""
        return np.linspace(0.0, self.axis["stroke"][axis], NODES)


def nominal() -> Rig:
    """The rig of the diagnosis' nominal model: VDFM on both axes, constant tau, no
    surface finish.
    """
    return Rig()


def with_smooth_friction(rig: Rig, axis: int, law: int = DAHL) -> Rig:
    """The same rig with a displacement-dependent friction law (DDFM by default) on `axis`."""
    out = rig.copy()
    out.axis["law"][axis] = law
    return out
