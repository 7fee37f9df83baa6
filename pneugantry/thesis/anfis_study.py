"""The ANFIS friction model of §4.2.4: trained on the constrained open-loop test, beside the rule
based DDFM (Fig. 4.20).

`python -m pneugantry.thesis.anfis_study` trains the model that `controllers.anfis_trained` carries,
and writes that file.
"""

from __future__ import annotations

import base64
import textwrap
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from controllers import anfis_trained
from controllers.anfis import AnfisModel, anfis_output
from controllers.anfis_training import anfis_train
from pneugantry.thesis.conditions import CHOICE, DDFM
from pneugantry.thesis.plant_tests import Hysteresis, hysteresis
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

__all__ = ["AnfisFit", "anfis_fit", "modelled_friction", "training_data"]

Array = NDArray[np.float64]
LUGRE = 4.0  # Types.FrictionLaw
RIG = {
    "axis_z.friction.F_s": 14.0,
    "axis_z.friction.F_d": 12.0,
}  # N: a rig whose friction is neither DDFM nor VDFM
EVERY = 3  # training takes every third of the 10 ms samples


@dataclass(frozen=True)
class AnfisFit:
    """Off-line fit, as in Fig. 4.20: a rig's friction, the rule based DDFM in the same test, and
    the ANFIS on the rig's signals.
    """

    rig: Hysteresis
    ddfm: Hysteresis
    anfis: Array  # N, in contact
    rmse_anfis: float  # N
    rmse_ddfm: float  # N, over the same command


def training_data(test: Hysteresis) -> tuple[Array, Array]:
    """Inputs f_az, its change, f_n, travel in contact, its change (N, 5) and F_z (N,), while the
    piston touches the edge.
    """
    touching = np.flatnonzero(test.f_z[1:] > 0.5) + 1
    z = test.z - test.z[touching[0]]
    inputs = np.column_stack(
        [test.f_az, np.diff(test.f_az, prepend=0.0), test.f_z, z, np.diff(z, prepend=z[0])]
    )
    return inputs[touching], test.friction[touching]


def modelled_friction(model: AnfisModel, inputs: Array) -> Array:
    """F_z [N] of each row."""
    n, m = model.centre.shape
    scaled, grade = np.zeros(n), np.zeros((n, m))
    return np.array([anfis_output(model, row, scaled, grade) for row in inputs])


def anfis_fit(fmu: FmuFile, epochs: int = 10) -> AnfisFit:
    """Trains on the rig's test and compares."""
    rig, ddfm = hysteresis(fmu, LUGRE, CHOICE, **RIG), hysteresis(fmu, DDFM, CHOICE)
    inputs, friction = training_data(rig)
    model = anfis_train(inputs[::EVERY], friction[::EVERY], epochs=epochs).model
    found = modelled_friction(model, inputs)
    touching = np.flatnonzero(rig.f_z[1:] > 0.5) + 1
    off = ddfm.friction[touching] - rig.friction[touching]
    return AnfisFit(
        rig,
        ddfm,
        found,
        float(np.sqrt(np.mean((found - friction) ** 2))),
        float(np.sqrt(np.mean(off**2))),
    )


def packed(model: AnfisModel) -> str:
    """The model's numbers as text: float32, compressed."""
    flat = np.concatenate([np.ravel(part) for part in model]).astype("<f4")
    return base64.b85encode(zlib.compress(flat.tobytes(), 9)).decode("ascii")


def write_trained(fmu: FmuFile) -> Path:
    """Trains on the DDFM plant and writes `controllers/anfis_trained.py` anew."""
    inputs, friction = training_data(hysteresis(fmu, DDFM, CHOICE))
    text = packed(anfis_train(inputs[::EVERY], friction[::EVERY]).model)
    path = Path(anfis_trained.__file__)
    head = path.read_text(encoding="utf-8").split("PACKED = (")[0]
    lines = "\n".join(f'    r"{part}"' for part in textwrap.wrap(text, 125, break_on_hyphens=False))
    path.write_text(f"{head}PACKED = (\n{lines}\n)\n", encoding="utf-8")
    return path


if __name__ == "__main__":
    print(write_trained(FmuFile.read(build_fmu().path)))
