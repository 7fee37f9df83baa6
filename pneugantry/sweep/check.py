"""Whether scenario, controller and FMU take what a study varies: asked before the first case runs,
each value by itself.
"""

from __future__ import annotations

from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.sweep.cases import Case
from pneugantry.sweep.spec import Spec
from pneugantry.sweep.vary import changed
from pyfmi_runner.fmu import FmuFile, FmuSession
from pyfmi_runner.plan import make_plan
from pyfmi_runner.plant import check_gantry
from pyfmi_runner.run import make_scenario_controller
from pyfmi_runner.scenario import KEYS, scenario_from

__all__ = ["check_spec"]


def check_spec(spec: Spec, fmu: FmuFile) -> None:
    """Raises InputError naming the spec's file, the varied field and the hint.

    Of numbers the smallest and the largest are tried, each in the first case; a combination that
    does not work is a failed case.
    """
    check_gantry(fmu)
    for name in spec.varied:
        _check_name(spec, name, fmu)
        for value in _ends([case[name] for case in spec.cases]):
            try:
                _try(spec, spec.cases[0] | {name: value}, fmu, deep=name.startswith("plant."))
            except InputError as error:
                raise InputError(
                    error.message, file=spec.file, field=f"{spec.section}.{name}", hint=error.hint
                ) from None


def _check_name(spec: Spec, name: str, fmu: FmuFile) -> None:
    head = name.split(".")[0]
    if head not in KEYS:
        hint = (
            f"did you mean plant.{name}?"
            if name in fmu.variables
            else f"name a field of a scenario ({', '.join(KEYS)}) or plant.PARAMETER"
        )
        raise InputError("unknown key", file=spec.file, field=f"{spec.section}.{name}", hint=hint)
    if name.startswith("gains.") and spec.base.get("gains") is None and not _holds_all_gains(spec):
        hint = 'give the others: gains = "table_4_6" in the base, or each gain'
        raise InputError(
            "is one gain of several", file=spec.file, field=f"{spec.section}.{name}", hint=hint
        )


def _holds_all_gains(spec: Spec) -> bool:
    return sum(name.startswith("gains.") for name in spec.varied) >= 8


def _ends(values: list[Any]) -> list[Any]:
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return [min(values), max(values)]
    return list({repr(value): value for value in values}.values())


def _try(spec: Spec, case: Case, fmu: FmuFile, *, deep: bool) -> None:
    scenario = scenario_from(changed(spec.base, case))
    make_scenario_controller(scenario)
    if deep:
        with FmuSession(fmu, parameters=make_plan(scenario).parameters):
            pass  # it took them
