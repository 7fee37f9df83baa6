"""Where a model's scalars stand in the arrays of the generated C, and the expressions that fill
them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca

from modelica_fmu.symbols import Scalar

__all__ = ["Expressions", "Layout", "close", "column", "seeded"]


@dataclass
class Layout:
    """Order of the scalars within each C array."""

    states: list[Scalar]
    inputs: list[Scalar]
    parameters: list[Scalar]
    calculated: list[Scalar]  # sorted so that each depends on earlier ones only
    memories: list[Scalar]
    algebraics: list[Scalar]  # the exposed ones, outputs first
    n_outputs: int
    part: bool = False  # no FMU: nobody asks for derivatives, the solver's own excepted


@dataclass
class Expressions:
    """Explicit expressions of everything the solver needs."""

    derivatives: list[ca.SX]
    algebraics: list[ca.SX]
    indicators: list[ca.SX]
    conditions: list[ca.SX]
    memory_updates: list[ca.SX]
    state_updates: list[ca.SX]
    assertions: list[ca.SX]
    delays: list[ca.SX]
    delay_times: list[ca.SX]
    calculated: list[ca.SX]  # in free parameters and earlier calculated ones
    starts: list[ca.SX]
    memory_starts: list[ca.SX]
    sample_starts: list[ca.SX]
    sample_intervals: list[ca.SX]
    delay_maxima: list[ca.SX]
    initial_unknowns: list[Scalar] = field(default_factory=list)
    initial_residuals: list[ca.SX] = field(default_factory=list)
    initial_guesses: list[ca.SX] = field(default_factory=list)
    loop_starts: list[ca.SX] = field(default_factory=list)
    roundings: list[ca.SX] = field(default_factory=list)
    constraints: list[ca.SX] = field(default_factory=list)
    chained: bool = False  # what happens at an event depends on what else does


def column(items: list[ca.SX]) -> ca.SX:
    return ca.vertcat(*items) if items else ca.SX.zeros(0, 1)


def seeded(inputs: dict[str, ca.SX], layout: Layout) -> ca.SX:
    """What derivatives are taken by: states, inputs, free parameters, loops' unknowns, time."""
    free = column([s.symbol for s in layout.parameters])
    return ca.vertcat(inputs["q->x"], inputs["q->u"], free, inputs["q->w"], inputs["q->time"])


def close(layout: Layout, e: Expressions) -> list[ca.SX]:
    """Calculated parameters as functions of the free ones alone."""
    closed: list[ca.SX] = []
    for expression in e.calculated:
        known = [s.symbol for s in layout.calculated[: len(closed)]]
        closed.append(ca.substitute([expression], known, closed)[0] if known else expression)
    return closed
