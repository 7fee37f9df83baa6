"""`pneugantry rootlocus`."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from modelica_fmu.errors import InputError
from pneugantry.commands.run import parse_settings
from pneugantry.options import add_parameters, picture_target

if TYPE_CHECKING:
    from pneugantry.analysis.force_loop import ForceLoop
    from pneugantry.analysis.root_locus import RootLocus

HELP = """Root locus of an axis' force loop, linearised from the FMU (Fig. 5.6 and 5.7).

  pneugantry rootlocus --axis z --lag none --json -    Fig. 5.7: no lag, stable for every gain
  pneugantry rootlocus --axis z --lag x
      Fig. 5.6: the thesis puts the x valve's lag (pole -3.33) on z
  pneugantry rootlocus --axis z --lag z --verify
      the z valve's own lag (pole -6.67), limit checked by co-simulation
  pneugantry rootlocus --axis x --lag 0.2 --delay 0.005 --pade 4 --plot out/x.png

Poles and zeros are the open loop's, from u [V] to the axis' force [N]; a delay adds those of its
Pade approximation. limit_gain [V/N] is the proportional gain at which the continuous loop
becomes unstable, with the exact delay; null where there is none. sampled.limit_gain is that of
the loop sampled every millisecond, and is finite even without a lag."""
LONGEST_DELAY = 1.0  # s
PADE_ORDERS = range(1, 11)


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("--axis", choices=("x", "z"), default="z", help="default z")
    command.add_argument(
        "--lag",
        default="own",
        metavar="none|x|z|SECONDS",
        help="of the valve (default: the axis' own)",
    )
    command.add_argument(
        "--delay", type=float, default=0.0, metavar="SECONDS", help="transport delay of the command"
    )
    command.add_argument(
        "--pade",
        type=int,
        default=3,
        metavar="N",
        help="order of the delay's Pade approximation, 1..10 (default 3)",
    )
    command.add_argument(
        "--angle",
        type=float,
        metavar="DEG",
        help="slope of the edge (default: it faces the axis, 0 for z, 90 for x)",
    )
    add_parameters(command)
    command.add_argument(
        "--verify",
        action="store_true",
        help="co-simulate the FMU's closed loop at 0.98 and 1.02 of the limit gains",
    )
    command.add_argument(
        "--plot", metavar="FILE.png", type=picture_target, help="draw root locus, Bode and Nyquist"
    )
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="another FMU with the gantry's interface"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.analysis.force_loop import (
        force_loop,
    )  # python-control loads only when something is linearised
    from pneugantry.analysis.root_locus import root_locus
    from pneugantry.api.inputs import fmu_from

    _check(options)
    file = fmu_from(options.fmu)
    angle = None if options.angle is None else math.radians(options.angle)
    shared: dict[str, Any] = {
        "delay": options.delay,
        "angle": angle,
        "parameters": parse_settings(options.set),
    }
    chosen = root_locus(force_loop(file, options.axis, options.lag, **shared), pade=options.pade)
    others = [
        root_locus(force_loop(file, options.axis, lag, **shared), pade=options.pade)
        for lag in ("none", "z", "x")
    ]
    _print(chosen, dict(zip(("none", "tau_z", "tau_x"), others, strict=True)))
    report = _report(chosen)
    report["compare"] = {
        name: _limits(other) for name, other in zip(("none", "z", "x"), others, strict=True)
    }
    code = 0
    if options.verify:
        report["cosimulated"] = checks = _verify(chosen)
        code = 0 if all(check["holds"] for check in checks.values()) else 1
    if options.plot:
        _draw(chosen, options.plot)
        print(f"picture: {options.plot}")
    return report, code


def _check(options: argparse.Namespace) -> None:
    if not 0.0 <= options.delay <= LONGEST_DELAY:
        raise InputError(
            f"is {options.delay:g}, expected 0..{LONGEST_DELAY:g} s",
            field="--delay",
            hint="give seconds within it",
        )
    if options.pade not in PADE_ORDERS:
        raise InputError(
            f"is {options.pade}, expected 1..10", field="--pade", hint="choose an order within it"
        )
    low, high = (-80.0, 80.0) if options.axis == "z" else (5.0, 90.0)
    if options.angle is not None and not low <= options.angle <= high:
        hint = "the edge must face the axis enough to be pushed"
        raise InputError(
            f"is {options.angle:g}, expected {low:g}..{high:g} degrees on {options.axis}",
            field="--angle",
            hint=hint,
        )


def _pairs(values: Any) -> list[list[float]]:
    return [[float(v.real), float(v.imag)] for v in values]


def _limits(locus: RootLocus) -> dict[str, Any]:
    limit, seen, gain = locus.limit, locus.sampled_limit, locus.loop.valve_gain
    return {
        "lag": locus.loop.lag,
        "limit_gain": limit.gain if limit else None,
        "limit_frequency": limit.frequency if limit else None,
        "limit_gain_force": limit.gain * gain if limit else None,
        "sampled": {
            "period": locus.period,
            "limit_gain": seen.gain if seen else None,
            "limit_frequency": seen.frequency if seen else None,
        },
    }


def _report(locus: RootLocus) -> dict[str, Any]:
    loop, pade = locus.loop, locus.pade
    report = {
        "schema": "rootlocus/1",
        "axis": loop.axis,
        "poles": _pairs(locus.poles),
        "zeros": _pairs(locus.zeros),
    } | _limits(locus)
    report |= {
        "units": {
            "poles": "rad/s",
            "limit_gain": "V/N",
            "limit_gain_force": "N/N",
            "limit_frequency": "rad/s",
            "lag": "s",
        }
    }
    report |= {
        "delay": loop.delay,
        "valve_gain": loop.valve_gain,
        "margins": {"controller": "PI, Table 4.6"} | locus.margins._asdict(),
    }
    if pade:
        limit = pade.limit.gain if pade.limit else None
        report["pade"] = {"order": pade.order, "phase_error_deg": pade.phase, "limit_gain": limit}
    return report


def _print(locus: RootLocus, others: dict[str, RootLocus]) -> None:
    loop, m = locus.loop, locus.margins
    lag = f"lag {loop.lag:g} s" if loop.lag else "no lag"
    print(
        f"{loop.axis} force loop from the FMU, {lag}, delay {loop.delay:g} s: "
        f"{loop.command} [V] -> force [N], K = {loop.valve_gain:g} N/V"
    )
    print(
        "  poles  "
        + ", ".join(f"{p.real:.2f}{p.imag:+.2f}j" for p in locus.poles)
        + "   zeros  "
        + (", ".join(f"{z.real:.1f}{z.imag:+.1f}j" for z in locus.zeros) or "none")
    )
    if locus.pade:
        print(
            f"  Pade order {locus.pade.order}: phase error {locus.pade.phase:.2g} deg at "
            f"the limit; limits below use the exact delay"
        )
    print(
        f"  with the PI gains of Table 4.6, sampled: gain margin "
        f"{_number(m.gain_margin)}, phase margin {_number(m.phase_margin)} deg,"
        f" crossover {_number(m.crossover)} rad/s, bandwidth {_number(m.bandwidth)} rad/s"
    )
    print("  limit gain of proportional control       continuous              sampled at 1 ms")
    for name, other in ({"chosen": locus} | others).items():
        limit, seen = other.limit, other.sampled_limit
        cells = [
            f"{c.gain:.5f} V/N at {c.frequency:7.2f} rad/s" if c else "none: always stable     "
            for c in (limit, seen)
        ]
        print(f"    {name:8} {other.loop.lag:5.3g} s  {cells[0]}   {cells[1]}")
    if loop.axis == "z":
        print(
            "  Fig. 5.6 puts tau_x (pole -3.33) on the z loop; the z valve's own tau_z "
            "gives -6.67 and about half the gain"
        )


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.3g}"


def _verify(locus: RootLocus) -> dict[str, Any]:
    from pneugantry.analysis.closed_loop import CONTINUOUS, cosimulated_limit

    checks = {}
    for name, limit, period in (
        ("sampled", locus.sampled_limit, locus.period),
        ("continuous", locus.limit, CONTINUOUS),
    ):
        if limit is None or locus.loop.lag == 0:
            continue
        below, above, own = cosimulated_limit(locus.loop, limit.gain, period=period)
        holds = below.rate < 0 < above.rate
        checks[name] = {
            "period": period,
            "rate_at_0.98": below.rate,
            "rate_at_1.02": above.rate,
            "limit_gain": own,
            "holds": holds,
        }
        print(
            f"  FMU co-simulated, {name}, every {1e3 * period:g} ms: rate "
            f"{below.rate:+.3f} 1/s at 0.98, {above.rate:+.3f} 1/s at 1.02"
            f" of the predicted gain; own limit {own:.5f} V/N "
            f"({'agrees' if holds else 'DISAGREES'})"
        )
    if not checks:
        print("  nothing to co-simulate: the FMU's valve always lags, at least by 1 ms")
    return checks


def _draw(locus: RootLocus, path: Path) -> None:
    from pneugantry.analysis.frequency import grid, response
    from pneugantry.analysis.locus_picture import locus_picture
    from pneugantry.analysis.plots import save
    from pneugantry.analysis.plots_linear import loop_figure
    from pneugantry.analysis.root_locus import loop_with_pi

    loop: ForceLoop = locus.loop
    w = grid(locus.period, 1e-1)
    curves = {"with PI of Table 4.6, sampled": response(loop_with_pi(loop, locus.period))(w)}
    limit = locus.limit or locus.sampled_limit
    if limit:
        seen = (
            response(loop.plant, loop.delay)
            if locus.limit
            else response(loop.sampled(locus.period))
        )
        kind = "" if locus.limit else ", sampled"
        curves[f"proportional at the limit gain {limit.gain:.4f} V/N{kind}"] = limit.gain * seen(w)
    title = (
        f"{loop.axis} force loop, {f'lag {loop.lag:g} s' if loop.lag else 'no lag'}, delay "
        f"{loop.delay:g} s"
    )
    save(loop_figure(locus_picture(locus), w, curves, title), path)
