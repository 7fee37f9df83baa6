"""`pneugantry linearize`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from modelica_fmu.errors import InputError
from pneugantry.commands.run import parse_settings
from pneugantry.options import add_parameters, out_file
from pyfmi_runner.plant import COMMANDS, OUTPUTS, TASK

if TYPE_CHECKING:
    from pneugantry.analysis.operating_point import OperatingPoint
    from pyfmi_runner.fmu import FmuFile

HELP = """State space of the FMU at an operating point, from its own directional derivatives.

  pneugantry linearize --point contact_sliding
      steady tracking of a 16 degree edge at 30 N, -0.06 m/s
  pneugantry linearize --point contact_stuck --save out/stuck.json
  pneugantry linearize --at out/stuck.json --settle --sampled --delay 0.0015 --json out/model.json
  pneugantry linearize --inputs valve_z.f_a --outputs f_n
      a state as input: the plant without its valve

Points: axis_contact (z in contact, no Coulomb friction, as Fig. 5.7), contact_stuck,
contact_sliding, free_sliding. A STATE.json holds {"states": {..}, "inputs": {..}, "parameters":
{..}} by the FMU's names; what it leaves out keeps the model's start value."""
NAMES = ("axis_contact", "contact_stuck", "contact_sliding", "free_sliding")
CLOSE = 1e-6  # relative, of the checks


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--at", metavar="STATE.json", type=Path, help="operating point from a file"
    )
    command.add_argument(
        "--point",
        choices=NAMES,
        default="contact_sliding",
        help="or one that is solved for (default contact_sliding)",
    )
    command.add_argument(
        "--settle", action="store_true", help="co-simulate from the point until the FMU is at rest"
    )
    command.add_argument(
        "--inputs",
        default=",".join(COMMANDS),
        metavar="NAME,..",
        help="inputs or states (default u_x,u_z)",
    )
    command.add_argument(
        "--outputs",
        default=",".join((*OUTPUTS, *TASK)),
        metavar="NAME,..",
        help="outputs or local variables",
    )
    command.add_argument(
        "--sampled", action="store_true", help="also sampled at 1 ms with zero-order hold"
    )
    command.add_argument(
        "--delay",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="dead time of the inputs of the sampled model",
    )
    add_parameters(command)
    command.add_argument(
        "--check",
        action="store_true",
        help="compare both interfaces and finite differences of co-simulated steps",
    )
    command.add_argument(
        "--save", metavar="STATE.json", type=out_file, help="write the operating point"
    )
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="another FMU (its points come from --at)"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.analysis.linearise import (
        linearise,
        sampled,
    )  # python-control loads only when something is linearised
    from pneugantry.analysis.point_file import point_table, write_point
    from pneugantry.api.inputs import fmu_from
    from pyfmi_runner.log import PERIOD

    if not 0.0 <= options.delay <= 1.0:
        raise InputError(
            f"is {options.delay:g}, expected 0..1 s", field="--delay", hint="give seconds within it"
        )
    file = fmu_from(options.fmu)
    inputs, outputs = (_names(getattr(options, key), key, file) for key in ("inputs", "outputs"))
    point = _point(options, file)
    model = linearise(file, point, inputs, outputs)
    _print(model, point)
    report: dict[str, Any] = {"schema": "linearize/1", "point": point_table(point)} | _matrices(
        model
    )
    if options.sampled or options.delay > 0:
        seen = sampled(model, PERIOD, options.delay)
        report["sampled"] = {"period": PERIOD, "delay": options.delay} | _matrices(seen)
    if options.save:
        write_point(point, options.save)
        print(f"point: {options.save}")
    if not options.check:
        return report, 0
    report["check"] = check = _check(file, point, inputs, outputs)
    return report, 0 if check["interfaces"] == 0.0 and check["finite_differences"] < CLOSE else 1


def _names(text: str, key: str, file: FmuFile) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    states = set(file.description.states)
    for name in names:
        variable = file.variables.get(name)
        if variable is None:
            raise InputError(
                f"the FMU has no variable {name!r}",
                field=f"--{key}",
                hint="see modelDescription.xml for its names",
            )
        usable = (
            name in states or variable.causality == "input"
            if key == "inputs"
            else variable.causality in ("output", "local")
        )
        if not usable or not variable.is_real or (key == "outputs" and name in states):
            what = (
                "an input or a state"
                if key == "inputs"
                else "an output or a local variable, and no state"
            )
            raise InputError(
                f"{name} is not {what} with real values", field=f"--{key}", hint="choose another"
            )
    if not names:
        raise InputError("no name is given", field=f"--{key}", hint="give at least one")
    return names


def _point(options: argparse.Namespace, file: FmuFile) -> OperatingPoint:
    from pneugantry.analysis.gantry_points import POINTS
    from pneugantry.analysis.operating_point import settle
    from pneugantry.analysis.point_file import read_point

    changes = parse_settings(options.set)
    if options.at:
        point = read_point(options.at, file)
        point = replace(point, parameters=point.parameters | changes)
    else:
        point = POINTS[options.point](file, parameters=changes)
    return settle(file, point) if options.settle else point


def _matrices(model: Any) -> dict[str, Any]:
    labels = {
        "states": model.state_labels,
        "inputs": model.input_labels,
        "outputs": model.output_labels,
    }
    poles = [[float(p.real), float(p.imag)] for p in model.poles()]
    return labels | {name: getattr(model, name).tolist() for name in "ABCD"} | {"poles": poles}


def _print(model: Any, point: OperatingPoint) -> None:
    print("operating point")
    for name, value in {**point.states, **{n: v for n, v in point.inputs.items() if v}}.items():
        print(f"  {name:24} {value: .6g}")
    print(
        f"{model.nstates} states, inputs {', '.join(model.input_labels)}, outputs "
        f"{', '.join(model.output_labels)}"
    )
    print(
        "poles [1/s]  "
        + ", ".join(
            f"{p.real:.3f}{p.imag:+.3f}j" if p.imag else f"{p.real:.3f}"
            for p in sorted(model.poles(), key=abs)
        )
    )


def _check(
    file: FmuFile, point: OperatingPoint, inputs: list[str], outputs: list[str]
) -> dict[str, float]:
    from pneugantry.analysis.finite_differences import agreement, differenced_model, stepped_model
    from pneugantry.analysis.linearise import linearise

    exchange, stepped = (linearise(file, point, inputs, outputs, kind) for kind in ("me", "cs"))
    interfaces = max(
        float(abs(getattr(exchange, m) - getattr(stepped, m)).max(initial=0.0)) for m in "ABCD"
    )
    print(f"model exchange against co-simulation: largest difference {interfaces:g}")
    whole = [name for name in inputs if name not in file.description.states] or list(COMMANDS)
    model = linearise(file, point, whole, outputs)
    rates = agreement(model, differenced_model(file, point, whole, outputs))
    steps = agreement(model, stepped_model(file, point, whole, outputs))
    print(
        f"against central differences of the co-simulated FMU's rates: {rates:.2g} "
        f"relative (at most {CLOSE:g})"
    )
    print(
        f"against central differences of co-simulated steps: {steps:.2g} relative (a "
        f"moving point on a bent edge changes on the way)"
    )
    return {"interfaces": interfaces, "finite_differences": rates, "steps": steps}
