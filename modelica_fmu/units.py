"""Modelica unit strings as exponents of the SI base units that FMI knows.

Modelica 3.6, section 19.1: factors joined by ".", at most one "/" (the rest is the denominator),
exponents written behind the symbol ("m2", "s-1"). A string that does not parse has no BaseUnit,
which FMI allows.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


class BaseUnit(NamedTuple):
    """value_si = factor * value + offset, with the unit prod(BASE[i] ** exponents[i])."""

    exponents: tuple[int, ...]
    factor: float
    offset: float = 0.0


def _unit(factor: float = 1.0, offset: float = 0.0, **exponents: int) -> BaseUnit:
    return BaseUnit(tuple(exponents.get(base, 0) for base in BASE), factor, offset)


_SYMBOLS = {
    **{base: _unit(**{base: 1}) for base in BASE},
    "g": _unit(1e-3, kg=1),
    "Hz": _unit(s=-1),
    "N": _unit(kg=1, m=1, s=-2),
    "Pa": _unit(kg=1, m=-1, s=-2),
    "J": _unit(kg=1, m=2, s=-2),
    "W": _unit(kg=1, m=2, s=-3),
    "V": _unit(kg=1, m=2, s=-3, A=-1),
    "C": _unit(s=1, A=1),
    "F": _unit(kg=-1, m=-2, s=4, A=2),
    "Ohm": _unit(kg=1, m=2, s=-3, A=-2),
    "S": _unit(kg=-1, m=-2, s=3, A=2),
    "Wb": _unit(kg=1, m=2, s=-2, A=-1),
    "T": _unit(kg=1, s=-2, A=-1),
    "H": _unit(kg=1, m=2, s=-2, A=-2),
    "l": _unit(1e-3, m=3),
    "L": _unit(1e-3, m=3),
    "bar": _unit(1e5, kg=1, m=-1, s=-2),
    "min": _unit(60.0, s=1),
    "h": _unit(3600.0, s=1),
    "d": _unit(86400.0, s=1),
    "t": _unit(1e3, kg=1),
    "deg": _unit(math.pi / 180.0, rad=1),
    "rev": _unit(2.0 * math.pi, rad=1),
    "rpm": _unit(2.0 * math.pi / 60.0, rad=1, s=-1),
    "degC": _unit(1.0, 273.15, K=1),
    "%": _unit(0.01),
}
_PREFIXES = {
    "G": 1e9,
    "M": 1e6,
    "k": 1e3,
    "h": 1e2,
    "d": 1e-1,
    "c": 1e-2,
    "m": 1e-3,
    "u": 1e-6,
    "n": 1e-9,
    "p": 1e-12,
}
_UNPREFIXED = frozenset({"kg", "min", "h", "d", "deg", "rev", "rpm", "degC", "%"})
_FACTOR = re.compile(r"(?P<symbol>[A-Za-z]+|%)(?P<exponent>[+-]?\d+)?\Z")


def _symbol(text: str) -> BaseUnit | None:
    if text in _SYMBOLS:
        return _SYMBOLS[text]
    unit = _SYMBOLS.get(text[1:])
    if unit is None or text[0] not in _PREFIXES or text[1:] in _UNPREFIXED:
        return None
    return unit._replace(factor=unit.factor * _PREFIXES[text[0]])


def _product(text: str) -> BaseUnit | None:
    if text.startswith("(") and text.endswith(")"):
        text = text[1:-1]
    exponents, factor, offset = [0] * len(BASE), 1.0, 0.0
    factors = text.split(".")
    for part in factors:
        if part == "1":
            continue
        match = _FACTOR.match(part)
        unit = _symbol(match["symbol"]) if match else None
        if match is None or unit is None:
            return None
        power = int(match["exponent"] or 1)
        exponents = [e + power * f for e, f in zip(exponents, unit.exponents, strict=True)]
        factor *= unit.factor**power
        if len(factors) == 1 and power == 1:  # an offset means something for the plain unit only
            offset = unit.offset
    return BaseUnit(tuple(exponents), factor, offset)


def base_unit(text: str) -> BaseUnit | None:
    """The SI meaning of a Modelica unit string such as "N.s/m", "1/m", "rad" or "%"; None if it is
    not understood.
    """
    numerator, slash, denominator = text.strip().partition("/")
    top = _product(numerator)
    if top is None or not slash:
        return top
    bottom = _product(denominator)
    if bottom is None:
        return None
    exponents = tuple(a - b for a, b in zip(top.exponents, bottom.exponents, strict=True))
    return BaseUnit(exponents, top.factor / bottom.factor)


def rate_unit(text: str | None) -> str | None:
    """Unit of the time derivative: "m/s2" for "m/s", "N/s" for "N", "1/s" for "1"; None where the
    unit is not understood.
    """
    if text is None or base_unit(text) is None:
        return None
    numerator, _, denominator = text.strip().partition("/")
    inside = denominator.removeprefix("(").removesuffix(")")
    factors = [part for part in inside.split(".") if part not in ("", "1")]
    seconds = [part for part in factors if re.fullmatch(r"s\d*", part)]
    power = sum(int(part[1:] or 1) for part in seconds) + 1
    factors = [part for part in factors if part not in seconds]
    factors.append("s" if power == 1 else f"s{power}")
    return f"{numerator}/" + (factors[0] if len(factors) == 1 else f"({'.'.join(factors)})")
