"""Controllers by name."""

from collections.abc import Callable
from difflib import get_close_matches
from functools import partial
from typing import Any

from controllers.anfis_comp import AnfisComp
from controllers.anfis_scheduler import AnfisScheduler
from controllers.combined_comp import CombinedComp
from controllers.ddfm_comp import DdfmComp
from controllers.dfv import Dfv
from controllers.ebpa_comp import EbpaComp
from controllers.gain_scheduler import GainScheduler
from controllers.interface import Controller
from controllers.mbpm_comp import MbpmComp
from controllers.observer_fv import ObserverFv
from controllers.pi_fv import PiFv
from controllers.pid_fv import PidFv
from controllers.pressure_feedback import PressureFeedback
from controllers.robust_fv import RobustFv
from controllers.smith import Smith
from controllers.vdfm_comp import VdfmComp

# Silent in the thesis: the activation functions' start. Chosen by Table 5.5
# (docs/results/thesis.md):
# bounds at the valve's 5 V.
EBPA_START: dict[str, Any] = {"upper": 5.0, "lower": -5.0, "slope": 3.0}
CATALOGUE: dict[str, Callable[..., Controller]] = {
    "pi_fv": PiFv,
    "pid_fv": PidFv,
    "dfv": Dfv,
    "pi_fv_vdfm": VdfmComp,
    "pi_fv_ddfm": DdfmComp,
    "pi_fv_combined": CombinedComp,
    "pi_fv_scheduled": GainScheduler,
    "pi_fv_anfis": AnfisComp,
    "pi_fv_anfis_scheduled": AnfisScheduler,
    "pi_fv_ebpa": partial(EbpaComp, **EBPA_START),
    "pi_fv_ebpa_zero": partial(EbpaComp, weight=0.0, **EBPA_START),
    "pi_fv_mbpm": MbpmComp,
    "pi_fv_mbpm_5": partial(MbpmComp, n_i=5),
    "pi_fv_mbpm_both": partial(MbpmComp, axes="both"),
    "pi_fv_smith": Smith,
    "pi_fv_pressure": PressureFeedback,
    "observer_fv": ObserverFv,
    "robust_fv": RobustFv,
}
ALIASES = {"pi_force_velocity": "pi_fv"}  # as campaign.toml writes it


def controller_names() -> list[str]:
    return list(CATALOGUE)


def controller_named(name: str) -> bool:
    """Whether the catalogue has a controller of this name."""
    return ALIASES.get(name, name) in CATALOGUE


def make_controller(name: str, **options: Any) -> Controller:
    """Controller by catalogue name; options are those of its class (``gains="table_3_7"`` and so
    on).

    Raises ValueError for an unknown name (naming the nearest), an unknown option and an option out
    of range.
    """
    name = ALIASES.get(name, name)
    if name not in CATALOGUE:
        near = get_close_matches(name, [*CATALOGUE, *ALIASES], n=1, cutoff=0.0)[0]
        raise ValueError(
            f"unknown controller {name!r}; nearest is {near!r}, known are {', '.join(CATALOGUE)}"
        )
    try:
        return CATALOGUE[name](**options)
    except TypeError as error:
        if "unexpected keyword" not in str(error):
            raise
        raise ValueError(f"controller {name!r}: {error}") from error
