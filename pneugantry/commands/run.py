"""`pneugantry run`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError
from pneugantry.api.preset_names import PRESETS
from pneugantry.listening import logged
from pneugantry.options import add_parameters, log_target, picture_target
from pneugantry.progress import Stages
from pyfmi_runner.plant import SHAPES

HELP = """Track an edge in closed loop at 1 ms; print RMSE and maximum error of f_n and v_t over
the contouring phase.

  pneugantry run                                   the curved edge, PI force/velocity controller
  pneugantry run --workpiece incline_16 --set contact.K_c=2e4 --plot out/run.png
  pneugantry run --workpiece my_edge.csv           columns x, z_w in metres
  pneugantry run --preset thesis --workpiece straight --controller observer_fv
      a line of the leaderboard
  pneugantry run --controller my.py --gains Kp_fz=0.03
      your own: `pneugantry controller init my.py`
  pneugantry run scenario.toml --out out/run.parquet"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "scenario",
        nargs="?",
        metavar="SCENARIO.toml",
        help="scenario file (default: as the campaigns contour)",
    )
    command.add_argument(
        "--workpiece", metavar="NAME|FILE.csv", help=f"{', '.join(SHAPES)} or a CSV of x, z_w"
    )
    command.add_argument(
        "--controller",
        metavar="NAME|FILE.py|FILE.fmu",
        help="one of `pneugantry list controllers`, a Python file of your own, or an FMU",
    )
    command.add_argument("--preset", metavar="NAME", help=f"conditions: {', '.join(PRESETS)}")
    command.add_argument(
        "--gains",
        action="append",
        default=[],
        metavar="TABLE|NAME=VALUE",
        help="gains of the controller: a table's name, or single ones as Kp_fz=0.03",
    )
    command.add_argument(
        "--phases", metavar="short|thesis", help="16 s as the campaigns, 45 s as the thesis"
    )
    command.add_argument("--f_nd", type=float, metavar="N", help="wanted normal force")
    command.add_argument(
        "--v_td", type=float, metavar="M/S", help="wanted tangential speed, < 0 towards -x"
    )
    add_parameters(command)
    command.add_argument("--seed", type=int, help="of sensor noise and jitter")
    command.add_argument(
        "--out", metavar="LOG", type=log_target, help="write the log, .parquet or .csv"
    )
    command.add_argument(
        "--plot", metavar="FILE.png", type=picture_target, help="draw f_n, v_t, theta and z over x"
    )
    command.add_argument(
        "--fmu", metavar="FILE.fmu", type=Path, help="another FMU with the gantry's interface"
    )


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.api import runs

    with Stages("run") as say, logged("modelica_fmu", lambda _: say.unusual()):
        done = runs.run(
            options.scenario,
            controller=options.controller,
            preset=options.preset,
            fmu=options.fmu,
            say=say,
            workpiece=options.workpiece,
            gains=parse_gains(options.gains),
            phases=options.phases,
            f_nd=options.f_nd,
            v_td=options.v_td,
            parameters=parse_settings(options.set),
            seed=options.seed,
        )
    if options.out:
        done.write(options.out)
        print(f"log: {options.out} ({len(done.log)} rows)")
    if options.plot:
        from pneugantry.analysis.plots import save

        save(done.figure(), options.plot)
        print(f"picture: {options.plot}")
    if done.metrics is None:
        print(f"pneugantry: the run {done.outcome}: {done.reason}", file=sys.stderr)
        return done.as_json(), 1
    m = done.metrics
    print(
        f"{done.scenario.workpiece}, {done.scenario.controller}: f_n RMSE {m.rmse_fn:.2f} N, "
        f"ME {m.me_fn:.1f} N; v_t RMSE {m.rmse_vt:.3f} m/s, ME {m.me_vt:.3f} m/s  "
        f"({done.simulated:.0f} s in {done.seconds:.2f} s)"
    )
    if done.limit_cycle is not None:
        print(
            f"note: f_n swings by +-{done.limit_cycle.amplitude:.1f} N every "
            f"{1e3 * done.limit_cycle.period:.0f} ms: a limit cycle. Gains and this plant do not "
            f"fit; the thesis tuned for its own contact (--preset thesis)"
        )
    return done.as_json(), 0


def parse_gains(texts: list[str]) -> str | dict[str, float] | None:
    """A gain table's name, or single gains by name; None where nothing is given."""
    if not texts:
        return None
    if len(texts) == 1 and "=" not in texts[0]:
        return texts[0]
    return parse_settings(texts, "--gains", "Kp_fz=0.03")


def parse_settings(
    texts: list[str], option: str = "--set", example: str = "contact.K_c=2e4"
) -> dict[str, float]:
    """NAME=VALUE texts as a table. Raises InputError naming the option."""
    words = {"true": 1.0, "false": 0.0}
    settings = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        try:
            if not name:
                raise ValueError
            settings[name] = words[value.lower()] if value.lower() in words else float(value)
        except ValueError:
            raise InputError(
                f"{text!r} is no PARAM=VALUE",
                field=option,
                hint=f"write for example {option} {example}",
            ) from None
    return settings
