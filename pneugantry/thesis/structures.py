"""The structures of plant that a controller has to bear: friction laws, dead time, a second lag,
droop, stiffness, noise, and each effect of the catalogue at its usual size. One thing at a time
differs from the thesis' plant; pairs stand apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pneugantry.engine.hypotheses.catalogue import Effect, Parameter
from pneugantry.engine.signals.sensors import PREFIX, neutral
from pneugantry.plants.gantry.catalogue import catalogue_of
from pneugantry.plants.gantry.closed_loop import augmented_of, left_out
from pneugantry.thesis.conditions import CHOICE, SOFT, Choice, Run
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.sensors import SIGMA, SensorParams, converter_steps

__all__ = ["NOMINAL", "Structure", "catalogue_structures", "pairs", "scatter", "structures"]

LAWS = {"none": 1.0, "VDFM": 2.0, "DDFM": 3.0, "LuGre": 4.0, "Stribeck": 5.0}
DEAD_TIMES = (0.005, 0.010, 0.015, 0.020)  # s, of both valves
SECOND_LAG = 0.040  # s, Table 3.2: response of the VER2000 valve
AMPLIFIER = 0.060  # s, Table 3.2: response of its VEA250 amplifier
DROOP = (0.1, 0.2)  # steady loss of supply at full force
STIFFNESS = (0.5, 0.7, 1.4, 2.0)
NOISE = 3.0


@dataclass(frozen=True)
class Structure:
    """What differs from the thesis' plant."""

    name: str
    family: str  # "nominal", "friction", "valve", "contact", "sensors", "catalogue", "beyond"
    plant: tuple[tuple[str, float], ...] = ()
    sensors: tuple[tuple[str, object], ...] = ()
    delay: float = 0.0  # s, from sample to action
    choice: Choice = CHOICE

    def run(self, edge: str, controller: str, **more: object) -> Run:
        """A controller on it, with the thesis' finish on the rig."""
        run = Run(
            edge,
            controller,
            plant=self.plant,
            sensors=self.sensors,
            delay=self.delay,
            choice=self.choice,
        )
        return run.changed(**more)


NOMINAL = Structure("nominal", "nominal")


def structures() -> list[Structure]:
    """The nominal and every structure but the catalogue's."""
    return [NOMINAL, *_frictions(), *_valves(), *_contacts(), *_sensors()]


def _frictions() -> Iterator[Structure]:
    for name, law in LAWS.items():
        if name != "DDFM":
            yield Structure(f"{name} on z", "friction", (("axis_z.friction.law", law),))
        if name not in ("none", "VDFM"):
            yield Structure(f"{name} on x", "friction", (("axis_x.friction.law", law),))
    both = (("axis_x.friction.law", LAWS["Stribeck"]), ("axis_z.friction.law", LAWS["Stribeck"]))
    yield Structure("Stribeck on both", "friction", both)


def _valves() -> Iterator[Structure]:
    for late in DEAD_TIMES:
        yield Structure(f"dead time {1e3 * late:g} ms", "valve", _both("delay_time", late))
    yield Structure(f"second lag {1e3 * SECOND_LAG:g} ms", "valve", _both("tau_2", SECOND_LAG))
    for droop in DROOP:
        yield Structure(f"supply droop {droop:.0%}", "valve", _both("droop", droop))
    by_place = (("valve_x.tau", 0.25), ("valve_x.lag_low", 1.96), ("valve_x.lag_high", 0.58))
    yield Structure("tau_x by position", "valve", by_place)


def _both(name: str, value: float) -> tuple[tuple[str, float], ...]:
    return (f"valve_x.{name}", value), (f"valve_z.{name}", value)


def _contacts() -> Iterator[Structure]:
    for factor in STIFFNESS:
        plant = (("contact.K_c", factor * CHOICE.contact_stiffness),)
        yield Structure(f"stiffness x {factor:g}", "contact", plant)
    yield Structure("contact of Fig. 5.7", "contact", choice=SOFT)


def _sensors() -> Iterator[Structure]:
    sigma = tuple(NOISE * s for s in SIGMA)
    yield Structure(f"noise x {NOISE:g}", "sensors", sensors=(("sigma", sigma),))
    yield from _converter()


def pairs() -> list[Structure]:
    """Beyond what is asked for: two things at once, and a second lag as long as the amplifier's
    response.
    """
    slow = _both("tau_2", SECOND_LAG) + _both("delay_time", 0.010)
    late = _both("delay_time", 0.010)
    vdfm = (("axis_z.friction.law", LAWS["VDFM"]),)
    return [
        Structure(f"second lag {1e3 * AMPLIFIER:g} ms", "beyond", _both("tau_2", AMPLIFIER)),
        Structure("second lag 40 ms, dead time 10 ms", "beyond", slow),
        Structure("VDFM on z, dead time 10 ms", "beyond", vdfm + late),
        Structure("stiffness x 2, dead time 10 ms", "beyond", (("contact.K_c", 1e5), *late)),
    ]


def scatter() -> list[Structure]:
    """What the thesis' own tests scatter over: friction of Tables C.1 and C.2, tau over x."""
    cases = {
        "friction of x, C.1 case 1": (("axis_x.friction.F_d", 12.0), ("axis_x.friction.F_s", 30.0)),
        "friction of x, C.1 case 3": (("axis_x.friction.F_d", 11.0), ("axis_x.friction.F_s", 21.0)),
        "friction of z, C.2 case 1 (14/15)": (("axis_z.friction.level", 14.0 / 15.0),),
        "friction of z, C.2 case 3 (16/15)": (("axis_z.friction.level", 16.0 / 15.0),),
        "VDFM on z": (("axis_z.friction.law", LAWS["VDFM"]),),
    }
    found = [Structure(name, "thesis' scatter", plant) for name, plant in cases.items()]
    by_place = next(s for s in _valves() if s.name == "tau_x by position")
    return [*found, by_place, *_converter()]


def _converter() -> Iterator[Structure]:
    yield Structure("12-bit converter", "sensors", sensors=(("quantum", converter_steps()),))


BEYOND = (  # of a kind that no effect of the catalogue is: name, parameter, usual size, ways
    ("chamber_leak", "valve_{axis}.leak", 0.2, "+"),
    ("dwell_friction", "axis_{axis}.friction.dwell", 0.1, "+-"),
    ("position_force", "axis_{axis}.spring", 2.0, "+-"),
    ("slew_limit", "valve_{axis}.slew", 0.004, "+"),
    ("swinging_spool", "valve_{axis}.spool_time", 0.01, "+"),
    ("warming_seal", "axis_{axis}.friction.warm", 0.15, "+-"),
)
ELSEWHERE = ("loop_delay", "surface_waviness")  # effects that `structures` and the finish stand for


def catalogue_structures(fmu: FmuFile) -> list[Structure]:
    """Each effect's first form with its first parameter moved by its usual size, up and where it
    may down, and what no effect is (BEYOND). Effects whose form replaces the friction law, or that
    the FMU and the sensors have no parameter for, are left out: the former stand among the
    structures.
    """
    found = [
        Structure(
            f"{name}/{axis} {way}", "catalogue", ((at.format(axis=axis), float(way + str(size))),)
        )
        for name, at, size, ways in BEYOND
        for axis in "xz"
        for way in ways
    ]
    for effect in catalogue_of().values():
        form = effect.forms[0]
        if not form.settings and effect.name not in ELSEWHERE:
            found += _moved(effect, form.parameters[0], fmu)
    return sorted(found, key=lambda s: s.name)


def _moved(effect: Effect, parameter: Parameter, fmu: FmuFile) -> Iterator[Structure]:
    name = parameter.name
    base = _nominal(name, fmu)
    if base is None:
        return
    size = parameter.scale * (base if parameter.relative else 1.0)
    low, high = (b * (base if parameter.relative else 1.0) for b in (parameter.low, parameter.high))
    for sign, word in ((1.0, "+"), (-1.0, "-")):
        value = base + sign * size
        if not low <= value <= high:
            continue
        label, said = f"{effect.key} {word}", augmented_of(fmu, {name: value})
        if name.startswith(PREFIX):
            usual = SensorParams()._asdict()
            own = {k.removeprefix(PREFIX): v for k, v in said.sensors.items()}
            moved = tuple((k, v) for k, v in own.items() if v != usual[k])
            yield Structure(label, "catalogue", sensors=moved)
        else:
            yield Structure(label, "catalogue", tuple(said.plant.items()), delay=said.delay)


def _nominal(name: str, fmu: FmuFile) -> float | None:
    """A parameter's value on the thesis' plant; None where it has none."""
    if name.startswith(PREFIX):
        moved = neutral(name) + 1.0
        return None if left_out({name: moved}) else neutral(name)
    if name == "timing.delay":
        return 0.0
    if name in CHOICE.plant():
        return CHOICE.plant()[name]
    start = fmu.variables[name].start if name in fmu.variables else None
    return None if start is None else float(start)
