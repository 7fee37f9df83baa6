"""Cuts a subsystem out of a model: the smallest part that computes some variables from inputs and
from other variables that are known, because they are measured.

A known variable becomes an input and its own equation is dropped; what nothing needs any more is
pruned. The rest is compiled like any model and keeps its parameters' names. Which variable an
equation determines follows from a matching of equations and unknowns (bipartite graph).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_bipartite_matching

from modelica_fmu.alone import alone
from modelica_fmu.compiled import CompiledModel, Structure
from modelica_fmu.compiler import compile_system
from modelica_fmu.errors import InputError
from modelica_fmu.frontend import flatten
from modelica_fmu.hybrid import HybridSystem
from modelica_fmu.initialisation import is_free_parameter
from modelica_fmu.ir import FlatVariable
from modelica_fmu.symbols import Scalar, hidden
from modelica_fmu.translation import build_system

__all__ = ["Structure", "cut", "structure"]


class _Graph:
    """Equations, unknowns and which equation determines which unknown."""

    def __init__(self, system: HybridSystem) -> None:
        self.system = system
        table = system.table
        self.symbols = {s.name: s.symbol for s in table.of("algebraic")}
        self.symbols |= {f"der({n})": symbol for n, symbol in system.derivatives.items()}
        unknowns = list(self.symbols)
        self.residuals = [residual for residual, _ in system.residuals]
        self.names = [{v.name() for v in ca.symvar(r)} for r in self.residuals]
        pattern = ca.jacobian_sparsity(
            ca.vertcat(*self.residuals), ca.vertcat(*self.symbols.values())
        )
        rows, columns = pattern.get_triplet()
        graph = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=pattern.shape)
        match = maximum_bipartite_matching(graph, perm_type="row")
        self.equation_of = {name: int(match[j]) for j, name in enumerate(unknowns)}
        if len(self.residuals) != len(unknowns) or (match < 0).any():
            raise table.source.refuse(
                f"{len(self.residuals)} equations for {len(unknowns)} unknowns",
                hint="write one equation per unknown",
            )
        self.roots = self._roots()

    def _roots(self) -> dict[str, str]:
        """Another name of a variable: its equation says that both are equal."""
        known = {s.name for s in self.system.table.of("algebraic", "state", "input")}
        roots = {name: name for name in known}
        for name in self.symbols:
            index = self.equation_of[name]
            others = self.names[index] - {name}
            if name not in known or len(others) != 1 or not others <= known:
                continue
            other = next(iter(others))
            table = self.system.table.scalars
            residual, a, b = self.residuals[index], table[name].symbol, table[other].symbol
            for sign in (1, -1):
                if ca.is_equal(ca.simplify(residual + sign * (a - b)), ca.SX(0), 3):
                    roots[name] = other
        for name in roots:  # to the end of the chain
            while roots[roots[name]] != roots[name]:
                roots[name] = roots[roots[name]]
        return roots


def _translated(model: Path, class_name: str) -> HybridSystem:
    """The equations of a class, to be changed at will. A diagnosis cuts sixty parts out of one
    model: half of the time went into reading it.
    """
    text = model.read_bytes() if model.is_file() else b""
    return _kept(model, class_name, text).copy()


@lru_cache(maxsize=2)  # a plant, and the one whose equations are opened
def _kept(model: Path, class_name: str, text: bytes) -> HybridSystem:
    return build_system(flatten(model, class_name))


@alone
def structure(model: Path, class_name: str) -> Structure:
    """Structure of a class of a Modelica file. Raises InputError."""
    graph = _Graph(_translated(model, class_name))
    states = set(graph.system.derivatives)
    rates = {}
    for state in states:
        index = graph.equation_of[f"der({state})"]
        others = graph.names[index] - {f"der({state})"}
        if len(others) == 1 and (other := next(iter(others))) in graph.roots:
            rates[state] = graph.roots[other]
    scalars = graph.system.table.scalars
    numbers = frozenset(name for name, s in scalars.items() if s.variable.type == "Real")
    units = {name: unit for name in numbers if (unit := scalars[name].variable.unit)}
    return Structure(graph.roots, frozenset(states), rates, numbers, units)


@alone
def deciders(model: Path, class_name: str) -> dict[str, frozenset[str]]:
    """Variable -> those that decide it at once, no state between. Raises InputError."""
    graph = _Graph(_translated(model, class_name))
    found: dict[str, frozenset[str]] = {}
    for name in graph.symbols:
        reached, waiting = {name}, [name]
        while waiting:
            for other in graph.names[graph.equation_of[waiting.pop()]] - reached:
                reached.add(other)
                if other in graph.symbols:
                    waiting.append(other)
        found[name] = frozenset(reached - {name})
    return found


@alone
def cut(
    model: Path,
    class_name: str,
    outputs: Sequence[str],
    known: Iterable[str] = (),
    fixed: Mapping[str, float] | None = None,
) -> CompiledModel:
    """The part of `class_name` that computes `outputs` from its inputs and the `known` variables.

    Its inputs are those of the class and the known variables that it needs, under their own names.
    fixed: parameters that become numbers; what they leave without effect is no part of it. Raises
    InputError for a name that is no variable.
    """
    system = _translated(model, class_name)
    _fix(system, fixed or {})
    graph = _Graph(system)
    known = tuple(known)
    for name in (*outputs, *known):
        if name not in graph.roots:
            raise InputError(
                f"{class_name} has no variable of that name that changes with time",
                file=model,
                field=name,
                hint="name a state, an input or another variable of the model",
            )
    ends = {graph.roots[name] for name in known}
    part = _needed(graph, outputs, ends)
    _keep_equations(system, part)
    _keep_events(system, part)
    _keep_beginning(system)
    _keep_scalars(system, part, outputs)
    return compile_system(system, part=True)


def _fix(system: HybridSystem, fixed: Mapping[str, float]) -> None:
    """Puts numbers in the place of parameters, and of what follows from them alone, in place."""
    scalars = system.table.scalars
    for name in fixed:
        if name not in scalars or scalars[name].kind != "parameter":
            raise system.table.source.refuse(
                f"{name} is no parameter", hint="fix parameters that the model declares"
            )
    values = {scalars[n].symbol.name(): ca.SX(v) for n, v in fixed.items()}
    if not values:
        return
    found: object = True
    while found:
        follow = {
            s.symbol.name(): _with(s.value, values)
            for s in scalars.values()
            if s.kind == "calculated" and s.value is not None and s.symbol.name() not in values
            if not is_free_parameter(s)
        }
        found = {n: v for n, v in follow.items() if v.is_constant()}
        values |= found
    system.residuals = [(_with(r, values), place) for r, place in system.residuals]
    system.initial_residuals = [(_with(r, values), node) for r, node in system.initial_residuals]
    for relation in system.relations:
        relation.indicator = _with(relation.indicator, values)
    for delay in system.delays:
        delay.expression = _with(delay.expression, values)
        delay.time, delay.maximum = _with(delay.time, values), _with(delay.maximum, values)
    for branch in system.branches:
        branch.condition = _with(branch.condition, values)
        branch.assigns = {n: _with(v, values) for n, v in branch.assigns.items()}
        branch.reinits = {n: _with(v, values) for n, v in branch.reinits.items()}
    for sample in system.samples:
        sample.start = _with(sample.start, values)
        sample.interval = _with(sample.interval, values)
    for scalar in scalars.values():
        if scalar.value is not None and scalar.name not in fixed:
            scalar.value = _with(scalar.value, values)


def _with(expression: ca.SX, values: Mapping[str, ca.SX]) -> ca.SX:
    """An expression with numbers in the place of symbols; CasADi drops what they make zero."""
    old = [v for v in ca.symvar(expression) if v.name() in values]
    new = [values[v.name()] for v in old]
    return ca.substitute([expression], old, new)[0] if old else expression


@dataclass(frozen=True)
class _Needed:
    """What outputs depend on."""

    equations: frozenset[int]  # indices of residuals
    names: frozenset[str]
    inputs: frozenset[str]  # known variables among the names: inputs of the part


def _needed(graph: _Graph, outputs: Sequence[str], known: set[str]) -> _Needed:
    """Equations and variables that the outputs depend on; a known variable ends the way."""
    equations: set[int] = set()
    names: set[str] = set()
    leads = _leads(graph.system)
    waiting = list(outputs)
    while waiting:
        name = waiting.pop()
        if name in names:
            continue
        names.add(name)
        if name in known:
            continue
        waiting += leads.get(name, ())
        index = graph.equation_of.get(name)
        if index is not None:
            equations.add(index)
            waiting += graph.names[index] - {name}
    return _Needed(frozenset(equations), frozenset(names), frozenset(names & known))


def _leads(system: HybridSystem) -> dict[str, list[str]]:
    """Name -> names that it depends on other than through its equation: indicators of relations,
    delayed values, derivatives, memories, assignments and restarts at events, initial equations.
    """
    leads: dict[str, list[str]] = {}

    def add(name: str, *expressions: ca.SX) -> None:
        found = [v.name() for e in expressions for v in ca.symvar(e)]
        leads.setdefault(name, []).extend(found)

    for relation in system.relations:
        add(relation.symbol.name(), relation.indicator)
    for delay in system.delays:
        add(delay.symbol.name(), delay.expression, delay.time, delay.maximum)
    for name, symbol in system.pre.items():
        leads.setdefault(symbol.name(), []).append(name)
    for name in system.derivatives:
        leads.setdefault(name, []).append(f"der({name})")
    for branch in system.branches:
        for name, value in (*branch.assigns.items(), *branch.reinits.items()):
            add(name, value, branch.condition)
    for residual, _ in system.initial_residuals:
        for name in _begun(system, residual):
            add(name, residual)
    return leads


def _begun(system: HybridSystem, residual: ca.SX) -> list[str]:
    """States and memories that an initial equation is about, by themselves or by their rate."""
    found = [_bare(v.name()) for v in ca.symvar(residual)]
    return [n for n in found if n in system.derivatives or n in system.pre]


def _bare(name: str) -> str:
    """A variable's name without der() or pre()."""
    return name[4:-1] if name.startswith(("der(", "pre(")) else name


def _keep_equations(system: HybridSystem, part: _Needed) -> None:
    """Leaves the equations and variables of a part, in place. The rate of a known state that other
    equations hold, as those of a mass matrix do, is an unknown like any other.
    """
    for name, symbol in system.derivatives.items():
        rate = f"der({name})"
        if name in part.inputs and rate in part.names:
            system.table.scalars[rate] = hidden(rate, "algebraic", symbol)
    system.residuals = [pair for i, pair in enumerate(system.residuals) if i in part.equations]
    system.derivatives = {
        n: s for n, s in system.derivatives.items() if n in part.names and n not in part.inputs
    }
    system.memories = [s for s in system.memories if s.name in part.names]
    system.pre = {n: s for n, s in system.pre.items() if n in part.names}
    system.assertions = []


def _keep_beginning(system: HybridSystem) -> None:
    """Leaves the initial equations of a part's states and memories, and those that give parameters
    that the part reads, in place.
    """
    every = system.initial_residuals
    kept = {i for i, (residual, _) in enumerate(every) if _begun(system, residual)}
    while True:
        system.initial_residuals = [every[i] for i in sorted(kept)]
        read = _parameters_of(system)
        more = kept | {i for i, (r, _) in enumerate(every) if _given(system, r) & read}
        if more == kept:
            return
        kept = more


def _given(system: HybridSystem, residual: ca.SX) -> set[str]:
    """Parameters that an initial equation of parameters alone gives."""
    scalars = [system.table.scalars.get(_bare(v.name())) for v in ca.symvar(residual)]
    if not all(s and s.kind in ("parameter", "calculated", "constant") for s in scalars):
        return set()
    return {s.name for s in scalars if s and is_free_parameter(s)}


def _keep_events(system: HybridSystem, part: _Needed) -> None:
    """Leaves the relations, delays, branches and ticks of a part, in place."""
    system.relations = [r for r in system.relations if r.symbol.name() in part.names]
    system.delays = [d for d in system.delays if d.symbol.name() in part.names]
    for branch in system.branches:
        branch.assigns = {n: v for n, v in branch.assigns.items() if n in part.names}
        branch.reinits = {n: v for n, v in branch.reinits.items() if n in system.derivatives}
    system.branches = [b for b in system.branches if b.assigns or b.reinits]
    ticks = {v.name() for b in system.branches for v in ca.symvar(b.condition)} | part.names
    system.samples = [s for s in system.samples if s.symbol.name() in ticks]


def _keep_scalars(system: HybridSystem, part: _Needed, outputs: Sequence[str]) -> None:
    """Leaves the variables and parameters of a part, in place; known variables become inputs."""
    scalars = system.table.scalars
    parameters = _parameters_of(system)
    kept: dict[str, Scalar] = {}
    for name, scalar in scalars.items():
        if scalar.kind in ("parameter", "calculated", "constant"):
            if name in parameters or name.startswith("solver."):
                kept[name] = scalar
        elif name in part.names:
            if name in part.inputs:
                scalar.kind = "input"
                scalar.variable = _as(scalar, "input")
                if scalar.value is None or not scalar.value.is_constant():
                    scalar.value = ca.SX(0)
            elif scalar.kind == "algebraic":  # what is no output nobody reads
                scalar.variable = _as(scalar, "output" if name in outputs else "", name in outputs)
            kept[name] = scalar
    scalars.clear()
    scalars.update(kept)


def _parameters_of(system: HybridSystem) -> set[str]:
    """Names of all that the system's expressions mention, start values and bindings included."""
    expressions = [r for r, _ in (*system.residuals, *system.initial_residuals)]
    expressions += [r.indicator for r in system.relations]
    for delay in system.delays:
        expressions += [delay.expression, delay.time, delay.maximum]
    for branch in system.branches:
        expressions += [branch.condition, *branch.assigns.values(), *branch.reinits.values()]
    for sample in system.samples:
        expressions += [sample.start, sample.interval]
    used = set(system.derivatives) | {s.name for s in system.memories}
    expressions += [
        s.value
        for s in system.table.scalars.values()
        if s.value is not None and (s.name in used or s.kind == "input")
    ]
    names: set[str] = set()
    waiting = [v.name() for e in expressions for v in ca.symvar(e)]
    while waiting:
        name = waiting.pop()
        if name in names:
            continue
        names.add(name)
        scalar = system.table.scalars.get(name)
        if scalar is not None and scalar.kind == "calculated" and scalar.value is not None:
            waiting += [v.name() for v in ca.symvar(scalar.value)]
    return names


def _as(scalar: Scalar, causality: str, shown: bool = True) -> FlatVariable:
    """A scalar's variable with another causality; "": none."""
    return replace(scalar.variable, causality=causality, protected=not shown)
