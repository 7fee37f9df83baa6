"""Effects of the catalogue in the blocks `sensors` and `timing` (measured signals -> u)."""

from __future__ import annotations

import numpy as np

from pneugantry.truth.form import AXES, Build, Form, Parameters, either, relative
from pneugantry.truth.parameters import CHANNELS, Rig

FULL_SCALE = np.array(
    [1.0, 0.1, 1.0, 1.0, 100.0, 100.0, 500.0, 200.0]
)  # m, m, m/s, m/s, N, N, N, N
FORCE_CHANNEL, PRESSURE_CHANNEL, SPEED_CHANNEL = (
    tuple(CHANNELS.index(name) for name in pair)
    for pair in (("f_x", "f_z"), ("f_ax", "f_az"), ("v_x", "v_z"))
)


def _bias(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
    bias = either(rng) * size
    rig.sensor["bias"][FORCE_CHANNEL[i]] += bias
    return {"bias": bias}


def _scale(channels: tuple[int, ...]) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        factor = relative(rng, size)
        rig.sensor["gain"][channels[i]] *= factor
        return {"factor": factor}

    return build


def _crosstalk(kind: str) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        into_x = either(rng) * size
        into_z = {
            "mutual": into_x,
            "rotation": -into_x,
            "unequal": into_x * rng.uniform(-1.0, 1.0),
        }[kind]
        rig.sensor["cross"][4], rig.sensor["cross"][5] = into_x, into_z
        return {"z_into_x": into_x, "x_into_z": into_z}

    return build


def _velocity_lag(stages: int) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        rig.sensor["lag"][SPEED_CHANNEL[i]], rig.sensor["lag_stages"][SPEED_CHANNEL[i]] = (
            size,
            stages,
        )
        return {"lag": size, "stages": stages}

    return build


def _converter(channels: slice, cut: bool) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        rig.sensor["step"][channels] = size * FULL_SCALE[channels]
        rig.sensor["step_floor"][channels] = float(cut)
        return {"bits": -np.log2(size), "cuts_off": cut}

    return build


def _loop_delay(kind: str) -> Build:
    def build(rig: Rig, i: int, size: float, rng: np.random.Generator) -> Parameters:
        samples = max(round(1000.0 * size), 1)
        sense = {"sense": samples, "act": 0, "both": samples // 2}[kind]
        rig.timing["sense_delay"], rig.timing["act_delay"] = sense, samples - sense
        return {"delay": samples / 1000.0, "sense_share": sense / samples}

    return build


def _forms(
    effect: str,
    part: str,
    axes: tuple[str, ...],
    sizes: tuple[float, float, str],
    **builds: Build,
) -> list[Form]:
    """One form a build, by name; sizes: least, largest, unit."""
    low, high, unit = sizes
    return [
        Form(effect, name, part, axes, low, high, unit, build) for name, build in builds.items()
    ]


SENSING_FORMS = [
    *_forms("force_bias", "sensors", AXES, (0.03, 3.0, "N"), constant=_bias),
    *_forms("force_gain", "sensors", AXES, (0.03, 0.3, "relative"), factor=_scale(FORCE_CHANNEL)),
    *_forms(
        "force_crosstalk",
        "sensors",
        ("",),
        (0.01, 0.2, "share"),
        mutual=_crosstalk("mutual"),
        rotation=_crosstalk("rotation"),
        unequal=_crosstalk("unequal"),
    ),
    *_forms(
        "pressure_gain", "sensors", AXES, (0.03, 0.3, "relative"), factor=_scale(PRESSURE_CHANNEL)
    ),
    *_forms(
        "velocity_lag",
        "sensors",
        AXES,
        (0.003, 0.08, "s"),
        first_order=_velocity_lag(1),
        cascade=_velocity_lag(3),
        running_mean=_velocity_lag(0),
    ),
    *_forms(
        "quantisation",
        "sensors",
        ("",),
        (2.0**-10, 2.0**-6, "of full scale"),
        rounding=_converter(slice(0, 8), False),
        cutting=_converter(slice(0, 8), True),
        forces=_converter(slice(4, 8), False),
    ),
    *_forms(
        "loop_delay",
        "timing",
        ("",),
        (0.001, 0.04, "s"),
        sense=_loop_delay("sense"),
        act=_loop_delay("act"),
        both=_loop_delay("both"),
    ),
]
