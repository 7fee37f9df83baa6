"""Types of equations: numbers, Booleans, enumerations and Strings do not mix (section 6.7)."""

from __future__ import annotations

from typing import Any

from modelica_fmu import ir
from modelica_fmu.modelica.scope import refuse

NUMBERS = ("Real", "Integer")
ARITHMETIC = ("+", "-", "*", "/", "^")
LIKE_ARGUMENT = ("abs", "sum", "product", "min", "max", "pre", "noEvent", "homotopy", "delay")
TRUTHS = ("initial", "terminal", "edge", "change", "sample")


def check(model: ir.FlatModel) -> None:
    """Raises InputError at an equation, value or condition whose types do not fit."""
    types = {name: v.type for name, v in model.variables.items()} | {"time": "Real"}
    checker = Checker(types, model.functions)
    for equation in [*model.equations, *model.initial_equations]:
        checker.equation(equation)
    for when in model.whens:
        for condition, actions in when.branches:
            checker.truth(condition)
            for action in actions:
                checker.action(action)
    for assertion in model.assertions:
        checker.truth(assertion.condition)
    for variable in model.variables.values():
        for value in (variable.binding, variable.start):
            if value is not None and variable.place is not None:
                checker.fits(variable.type, checker.type(value), value.place)


class Checker:
    """Types of expressions; None where the form does not tell."""

    def __init__(self, types: dict[str, str], functions: dict[str, ir.Function]) -> None:
        self.types, self.functions = types, functions

    def equation(self, node: Any) -> None:
        if isinstance(node, ir.IfEquation):
            for condition, body in node.branches:
                self.truth(condition)
                for inner in body:
                    self.equation(inner)
            for inner in node.otherwise:
                self.equation(inner)
            return
        left, right = self.type(node.left), self.type(node.right)
        plain = isinstance(node.left, ir.Name)
        self.fits(left, right, node.place, both_ways=not plain)

    def action(self, node: Any) -> None:
        if isinstance(node, ir.Equation | ir.IfEquation):
            self.equation(node)
        elif isinstance(node, ir.Reinit):
            self.fits("Real", self.type(node.value), node.place)

    def fits(
        self, wanted: str | None, got: str | None, place: ir.Place, both_ways: bool = False
    ) -> None:
        if wanted is None or got is None or wanted == got:
            return
        if wanted == "Real" and got == "Integer":
            return
        if both_ways and wanted == "Integer" and got == "Real":
            return
        raise refuse(
            f"type mismatch: {wanted} is needed, got {got}", place, hint="convert it, or correct it"
        )

    def truth(self, node: ir.Expr) -> None:
        if isinstance(node, ir.Array):
            for item in node.items:
                self.truth(item)
            return
        self.fits("Boolean", self.type(node), node.place)

    def type(self, node: ir.Expr) -> str | None:
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        return None if method is None else method(node)

    def _literal(self, node: ir.Literal) -> str:
        return node.type

    def _text(self, node: ir.Text) -> str:
        return "String"

    def _name(self, node: ir.Name) -> str | None:
        return self.types.get(node.name)

    def _index(self, node: ir.Index) -> str | None:
        return self.type(node.base)

    def _array(self, node: ir.Array) -> str | None:
        found = [self.type(item) for item in node.items]
        if not found or None in found:
            return None
        if all(f in NUMBERS for f in found):
            return "Integer" if all(f == "Integer" for f in found) else "Real"
        for item, other in zip(node.items, found, strict=True):
            self.fits(found[0], other, item.place)
        return found[0]

    def _unary(self, node: ir.Unary) -> str | None:
        found = self.type(node.operand)
        if node.op == "not":
            self.fits("Boolean", found, node.place)
            return "Boolean"
        self._number(found, node.place)
        return found

    def _number(self, found: str | None, place: ir.Place) -> None:
        if found is not None and found not in NUMBERS:
            raise refuse(
                f"type mismatch: a number is needed, got {found}", place, hint="correct it"
            )

    def _binary(self, node: ir.Binary) -> str | None:
        chain = [node]
        while isinstance(chain[-1].left, ir.Binary):
            chain.append(chain[-1].left)
        found = self.type(chain[-1].left)
        for one in reversed(chain):
            found = self._operation(one, found, self.type(one.right))
        return found

    def _operation(self, node: ir.Binary, left: str | None, right: str | None) -> str | None:
        op = node.op.removeprefix(".")
        if op in ("and", "or"):
            self.fits("Boolean", left, node.place)
            self.fits("Boolean", right, node.place)
            return "Boolean"
        if op in ARITHMETIC:
            if op == "+" and left == "String":
                return "String"
            self._number(left, node.place)
            self._number(right, node.place)
            if left is None or right is None:
                return None
            whole = left == right == "Integer" and op in ("+", "-", "*")
            return "Integer" if whole else "Real"
        numbers = left in NUMBERS and right in NUMBERS
        if left is not None and right is not None and left != right and not numbers:
            raise refuse(
                f"type mismatch: {left} compared with {right}", node.place, hint="correct it"
            )
        return "Boolean"

    def _choice(self, node: ir.Choice) -> str | None:
        for condition, _ in node.branches:
            self.truth(condition)
        found = [self.type(value) for _, value in node.branches] + [self.type(node.otherwise)]
        if None in found:
            return None
        if all(f in NUMBERS for f in found):
            return "Integer" if all(f == "Integer" for f in found) else "Real"
        for other in found[1:]:
            self.fits(found[0], other, node.place)
        return found[0]

    def _builtin(self, node: ir.Builtin) -> str | None:
        name = node.function
        if name in TRUTHS:
            for arg in node.args:
                self.type(arg)
            return "Boolean" if name != "sample" or len(node.args) == 2 else None
        if name in LIKE_ARGUMENT and node.args:
            found = [self.type(arg) for arg in node.args]
            if name in ("min", "max") and "Real" in found:
                return "Real"
            return found[0]
        if name in ("integer", "size", "ndims", "Integer"):
            return "Integer"
        if name in ("mod", "rem", "div") and all(self.type(a) == "Integer" for a in node.args):
            return "Integer"
        if name in ("smooth", "fill", "cat", "transpose", "vector", "matrix", "scalar"):
            at = 1 if name in ("smooth", "cat") else 0
            return self.type(node.args[at]) if len(node.args) > at else None
        for arg in node.args:
            self._number(self.type(arg), arg.place)
        return "Real"

    def _call(self, node: ir.Call) -> str | None:
        function = self.functions.get(node.function)
        if function is None or not function.outputs:
            return None
        for declared, arg in zip(function.inputs, node.args, strict=False):
            if not declared.fields:
                self.fits(declared.type, self.type(arg), arg.place)
        return None if function.outputs[0].fields else function.outputs[0].type
