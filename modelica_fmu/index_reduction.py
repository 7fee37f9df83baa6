"""Index reduction: equations are differentiated until they determine every highest derivative
(Pantelides), and what they leave of redundant states is removed or projected.

A constraint that gives a state explicitly makes it algebraic (a dummy derivative that can never
become singular). Of the others all states are kept; the solver projects them onto the constraints
after each step, so that no choice of states has to change on the way.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from modelica_fmu.hybrid import HybridSystem
from modelica_fmu.initialisation import is_fixed
from modelica_fmu.symbols import TIME, Scalar, hidden

MOST_DIFFERENTIATIONS = 2000  # equations differentiated, before the model is called singular


@dataclass
class Element:
    """A variable or one of its derivatives; `rate`: the element that is its derivative."""

    symbol: ca.SX
    name: str
    scalar: Scalar | None = None
    rate: int | None = None
    of: int | None = None
    algebraic: bool = False  # no derivative of it stands in the model's own equations


@dataclass
class Equation:
    residual: ca.SX
    node: Any
    rate: int | None = None  # its derivative
    elements: set[int] = field(default_factory=set)


class Structure:
    def __init__(self, system: HybridSystem) -> None:
        self.system = system
        self.elements: list[Element] = []
        self.at: dict[int, int] = {}  # hash of a symbol -> element
        for scalar in system.table.of("state"):
            rate = system.derivatives[scalar.name]
            first = self._add(Element(scalar.symbol, scalar.name, scalar))
            second = self._add(Element(rate, f"der({scalar.name})", of=first))
            self.elements[first].rate = second
        for scalar in system.table.of("algebraic"):
            self._add(Element(scalar.symbol, scalar.name, scalar, algebraic=True))
        self.equations: list[Equation] = []
        for residual, node in system.residuals:
            self._equation(residual, node)

    def _add(self, element: Element) -> int:
        self.elements.append(element)
        self.at[element.symbol.__hash__()] = len(self.elements) - 1
        return len(self.elements) - 1

    def _equation(self, residual: ca.SX, node: Any) -> int:
        inside = {self.at.get(v.__hash__(), -1) for v in ca.symvar(residual)} - {-1}
        self.equations.append(Equation(residual, node, elements=inside))
        return len(self.equations) - 1

    def rate_of(self, at: int) -> int:
        element = self.elements[at]
        if element.rate is None:
            name = f"der({element.name})"
            element.rate = self._add(Element(ca.SX.sym(name), name, of=at))
        return element.rate

    def differentiate(self, number: int) -> int:
        """The time derivative of an equation, as a new one."""
        equation = self.equations[number]
        total = ca.SX(0)
        for symbol in ca.symvar(equation.residual):
            at = self.at.get(symbol.__hash__())
            if at is not None:
                rate = self.elements[self.rate_of(at)].symbol
                total += ca.jacobian(equation.residual, symbol) * rate
            elif symbol.__hash__() == TIME.__hash__():
                total += ca.jacobian(equation.residual, symbol)
            else:
                self._constant(symbol, equation)
        made = self._equation(total, equation.node)
        equation.rate = made
        return made

    def _constant(self, symbol: ca.SX, equation: Equation) -> None:
        """Parameters and what is frozen between events have no derivative; inputs are refused."""
        scalar = self.system.table.scalars.get(symbol.name())
        moving = symbol.name().startswith("delay_") or (
            scalar is not None and scalar.kind == "input" and not scalar.discrete_valued
        )
        if moving:
            raise self.system.table.source.refuse(
                f"the derivative of {symbol.name()} would be needed, which is an input or delayed",
                equation.node,
                hint="filter it, or let it act on a rate",
            )

    def can_be_reduced(self) -> bool:
        """Whether each equation can determine a variable of its own, whatever its derivative."""
        residuals = ca.vertcat(*(e.residual for e in self.equations))
        pattern = ca.jacobian_sparsity(residuals, ca.vertcat(*(e.symbol for e in self.elements)))
        return int(ca.sprank(ca.DM(pattern, 1))) == len(self.equations)

    # ---- Pantelides

    def reduce(self) -> None:
        """Differentiates equations until each can be given a highest derivative of its own."""
        assigned: dict[int, int] = {}  # element -> equation
        for number in range(len(self.equations)):
            at = number
            while True:
                seen_elements: set[int] = set()
                seen_equations: set[int] = set()
                if self._augment(at, assigned, seen_elements, seen_equations):
                    break
                if len(self.equations) > len(self.system.residuals) + MOST_DIFFERENTIATIONS:
                    raise self._singular(number)
                if not seen_elements and not self._moves(at):
                    raise self._singular(number)
                for element in sorted(seen_elements):
                    self.rate_of(element)
                for equation in sorted(seen_equations):
                    self.differentiate(equation)
                for element in sorted(seen_elements):
                    rate = self.elements[element].rate
                    derived = self.equations[assigned[element]].rate
                    assert rate is not None
                    assert derived is not None
                    assigned[rate] = derived
                derived = self.equations[at].rate
                assert derived is not None
                at = derived

    def _moves(self, number: int) -> bool:
        """Whether differentiating an equation can bring in anything new."""
        return bool(self.equations[number].elements)

    def _singular(self, number: int) -> Exception:
        return self.system.table.source.refuse(
            "the equations are structurally singular, however often they are differentiated",
            self.equations[number].node,
            hint="write an equation for each unknown",
        )

    def _augment(
        self, number: int, assigned: dict[int, int], elements: set[int], equations: set[int]
    ) -> bool:
        """A place for an equation among the highest derivatives; what was looked at is noted."""
        equations.add(number)
        highest = [e for e in self.equations[number].elements if self.elements[e].rate is None]
        for element in highest:
            if element not in assigned:
                assigned[element] = number
                return True
        for element in highest:
            if element in elements:
                continue
            elements.add(element)
            if self._augment(assigned[element], assigned, elements, equations):
                assigned[element] = number
                return True
        return False

    # ---- states that are left

    def demote(self) -> tuple[set[int], list[int]]:
        """(elements that constraints give explicitly, constraints that remain)."""
        demoted: set[int] = set()
        left: list[int] = []
        for number, equation in enumerate(self.equations):
            if equation.rate is None:
                continue
            chosen = self._explicit(equation, demoted)
            if chosen is None:
                left.append(number)
            else:
                demoted.add(chosen)
        return demoted, left

    def _explicit(self, equation: Equation, demoted: set[int]) -> int | None:
        found: list[tuple[tuple[int, ...], int]] = []
        for at in equation.elements:
            element = self.elements[at]
            if element.rate is None or at in demoted:
                continue
            factor = ca.jacobian(equation.residual, element.symbol)
            if factor.is_constant() and float(factor) != 0:
                found.append((self._wish(at, demoted), at))
        return min(found)[1] if found else None

    def _wish(self, at: int, demoted: set[int]) -> tuple[int, ...]:
        """Lower: rather made algebraic."""
        element = self.elements[at]
        follows = element.of is not None and element.of in demoted
        scalar = element.scalar
        if scalar is None:
            return (0 if follows else 1, 0, 0, -at)
        given = 2 * is_fixed(scalar) + (scalar.variable.start is not None)
        return (0 if element.algebraic or follows else 1, scalar.variable.prefer, given, -at)


def reduce_index(system: HybridSystem) -> None:
    """Leaves a system of index 1; does nothing where it is one.

    Raises InputError for a structurally singular system and where an input's derivative is needed.
    """
    unknowns = len(system.derivatives) + len(system.table.of("algebraic"))
    if len(system.residuals) != unknowns or _regular(system):
        return
    structure = Structure(system)
    if not structure.can_be_reduced():
        return  # sorting says which unknown lacks an equation
    structure.reduce()
    demoted, constraints = structure.demote()
    system.residuals = [
        (e.residual, e.node) for k, e in enumerate(structure.equations) if k not in constraints
    ]
    system.constraints = [structure.equations[k].residual for k in constraints]
    _rebuild(system, structure, demoted)


def _regular(system: HybridSystem) -> bool:
    unknowns = [*system.derivatives.values(), *(s.symbol for s in system.table.of("algebraic"))]
    if not unknowns:
        return True
    residuals = ca.vertcat(*(r for r, _ in system.residuals))
    pattern = ca.jacobian_sparsity(residuals, ca.vertcat(*unknowns))
    return int(ca.sprank(ca.DM(pattern, 1))) == len(unknowns)


def _rebuild(system: HybridSystem, structure: Structure, demoted: set[int]) -> None:
    """States, derivatives and algebraic variables as the reduction leaves them."""
    table = system.table
    system.derivatives = {}
    for at, element in enumerate(structure.elements):
        is_state = element.rate is not None and at not in demoted
        rate = structure.elements[element.rate].symbol if element.rate is not None else None
        if element.scalar is not None:
            element.scalar.kind = "state" if is_state else "algebraic"
            if is_state and rate is not None:
                system.derivatives[element.scalar.name] = rate
        elif is_state and rate is not None:  # a derivative that is integrated itself
            name = f"rate_of_{element.name[4:-1]}"
            while name in table.scalars:
                name += "_"
            made = hidden(name, "state")
            table.scalars[made.name] = made
            system.derivatives[made.name] = rate
            system.residuals.append((element.symbol - made.symbol, None))
    known = {symbol.__hash__() for symbol in system.derivatives.values()}
    for element in structure.elements:
        if element.scalar is None and element.symbol.__hash__() not in known:
            table.scalars[element.name] = hidden(element.name, "algebraic", element.symbol)
