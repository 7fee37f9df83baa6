"""Modelica functions: their bodies are run symbolically, so a call becomes an expression (loops
unrolled, branches merged).
"""

from __future__ import annotations

import math

import casadi as ca

from modelica_fmu.expressions import Translator, Value, choose, compare
from modelica_fmu.frontend import Source, Tree

MAX_ITERATIONS = 10_000  # of all loops of one call


class FunctionScope:
    """Names inside one call; relations are plain (a function body makes no events)."""

    def __init__(self, library: FunctionLibrary) -> None:
        self.library = library
        self.values: dict[str, Value] = {}

    def name(self, name: str, tree: Tree) -> Value:
        if name in self.values:
            return self.values[name]
        if name in self.library.literals:
            return ca.SX(self.library.literals[name])
        raise self.library.source.refuse(
            f"{name} has no value yet", tree, hint="assign it before use"
        )

    def relation(self, op: str, lhs: ca.SX, rhs: ca.SX, event: bool, tree: Tree) -> ca.SX:
        return compare(op, lhs, rhs)

    def operator(
        self, function: str, args: list[Tree], translate: Translator, tree: Tree
    ) -> Value | None:
        if function in ("Der", "Pre", "Sample", "Delay", "Edge", "Change"):
            raise self.library.source.refuse(
                f"{function.lower()}() is not allowed in a function", tree
            )
        return None

    def call(self, function: str, args: list[Value], tree: Tree) -> Value:
        return self.library.call(function, args, tree)


class FunctionLibrary:
    def __init__(
        self, source: Source, functions: dict[str, Tree], literals: dict[str, int]
    ) -> None:
        self.source, self.functions, self.literals = source, functions, literals
        self._open: list[str] = []  # functions being run

    def call(self, name: str, args: list[Value], tree: Tree) -> Value:
        function = self.functions.get(name) or self.functions.get(name.rsplit(".", 1)[-1])
        if function is None or function.get("external"):
            raise self.source.refuse(
                f"not supported: the function {name}", tree, hint="write it in Modelica"
            )
        if len(function["outputs"]) != 1:
            raise self.source.refuse(
                f"not supported: {name} has {len(function['outputs'])} outputs", tree
            )
        if name in self._open:
            raise self.source.refuse(f"not supported: {name} calls itself", tree, hint="use a loop")
        self._open.append(name)
        try:
            return self._run(name, function, args, tree)
        finally:
            self._open.pop()

    def _run(self, name: str, function: Tree, args: list[Value], tree: Tree) -> Value:
        scope = FunctionScope(self)
        run = _Run(self, scope)
        inputs = function["inputs"]
        for i, declared in enumerate(inputs):
            if i < len(args):
                scope.values[declared["name"]] = args[i]
            elif declared["default"] is not None:
                scope.values[declared["name"]] = run.translate(declared["default"])
            else:
                raise self.source.refuse(
                    f"{name} lacks its input {declared['name']}", tree, hint="give it"
                )
        for local in function["locals"] + function["outputs"]:
            if local["default"] is not None:
                scope.values[local["name"]] = run.translate(local["default"])
            elif dimensions := local["effective_type"]["dimensions"]:
                if math.prod(dimensions) > MAX_ITERATIONS:
                    raise self.source.refuse(
                        f"{local['name']} has more than {MAX_ITERATIONS} elements",
                        tree,
                        hint="make it smaller",
                    )
                scope.values[local["name"]] = _zeros(dimensions)
        run.statements(function["body"])
        return scope.name(function["outputs"][0]["name"], tree)


def _zeros(dimensions: list[int]) -> Value:
    if not dimensions:
        return ca.SX(0)
    return [_zeros(dimensions[1:]) for _ in range(dimensions[0])]


class _Run:
    def __init__(self, library: FunctionLibrary, scope: FunctionScope) -> None:
        self.library, self.scope, self.iterations = library, scope, 0
        self.translate = Translator(library.source, scope, events=False)

    def statements(self, body: list[Tree]) -> None:
        for statement in body:
            kind, node = next(iter(statement.items()))
            method = getattr(self, "_" + kind.lower(), None)
            if method is None:
                raise self.library.source.refuse(
                    f"not supported: the statement {kind} in a function", statement
                )
            method(node)

    def _assignment(self, node: Tree) -> None:
        part = node["comp"]["parts"][-1]
        value = self.translate(node["value"])
        subscripts = [self.translate._subscript(s, node) for s in part["subs"]]
        if not subscripts:
            self.scope.values[part["ident"]] = value
            return
        target = self.scope.values[part["ident"]] = _copy(self.scope.values[part["ident"]])
        for depth, subscript in enumerate(subscripts):
            if not isinstance(target, list) or not 1 <= subscript <= len(target):
                message = f"subscript {subscript} does not fit the array {part['ident']}"
                raise self.library.source.refuse(message, node, hint="correct the subscript")
            if depth < len(subscripts) - 1:
                target = target[subscript - 1]
        target[subscripts[-1] - 1] = value

    def _for(self, node: Tree) -> None:
        if len(node["indices"]) != 1:
            raise self.library.source.refuse(
                "not supported: a for with several indices", node, hint="nest them"
            )
        index = node["indices"][0]
        for value in self._range(index["range"]):
            self.iterations += 1
            if self.iterations > MAX_ITERATIONS:
                raise self.library.source.refuse(
                    f"a function loops more than {MAX_ITERATIONS} times", node, hint="shorten it"
                )
            self.scope.values[index["ident"]] = ca.SX(value)
            self.statements(node["equations"])

    def _range(self, tree: Tree) -> range:
        node = tree.get("Range")
        if node is None:
            raise self.library.source.refuse(
                "not supported: a for over something else than a range", tree
            )
        ends = [
            self.translate.scalar(node[k]) if node[k] is not None else ca.SX(1)
            for k in ("start", "step", "end")
        ]
        if not all(end.is_constant() for end in ends):
            raise self.library.source.refuse(
                "not supported: a for whose range is not constant", tree
            )
        numbers = [float(end) for end in ends]
        if not all(number.is_integer() for number in numbers) or numbers[1] == 0:
            raise self.library.source.refuse(
                "a for needs whole numbers and a step that is not 0", tree, hint="correct its range"
            )
        start, step, end = map(int, numbers)
        return range(start, end + (1 if step > 0 else -1), step)

    def _if(self, node: Tree) -> None:
        before = {k: _copy(v) for k, v in self.scope.values.items()}
        outcomes: list[tuple[ca.SX, dict[str, Value]]] = []
        for block in node["cond_blocks"]:
            condition = self.translate.scalar(block["cond"])
            self.scope.values = {k: _copy(v) for k, v in before.items()}
            self.statements(block["stmts"])
            outcomes.append((condition, self.scope.values))
        self.scope.values = before
        self.statements(node.get("else_block") or [])
        for condition, values in reversed(outcomes):
            for name, value in values.items():
                other = self.scope.values.get(name, value)
                self.scope.values[name] = (
                    value if value is other else choose(condition, value, other)
                )


def _copy(value: Value) -> Value:
    return [_copy(v) for v in value] if isinstance(value, list) else value
