"""Modelica functions: their bodies are run symbolically, so a call becomes an expression (loops
unrolled, branches merged).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi as ca

from modelica_fmu import ir
from modelica_fmu.arrays import fill
from modelica_fmu.expressions import (
    Given,
    Translator,
    Value,
    choose,
    compare,
    elementwise,
    flatten,
)
from modelica_fmu.source import Source, undecided

MAX_ITERATIONS = 10_000  # of all loops of one call
DEEPEST = 20  # calls of one function within one another
FINISHED = "return"  # in FunctionScope.values: 1 where a return has been passed
BROKEN = "break"  # the same of a break of the innermost loop
OUTSIDE = ("der", "pre", "sample", "delay", "edge", "change")


class FunctionScope:
    """Names inside one call; relations are plain (a function body makes no events)."""

    def __init__(self, library: FunctionLibrary) -> None:
        self.library = library
        self.values: dict[str, Value] = {}

    def name(self, name: str, node: Any) -> Value:
        if name in self.values:
            return self.values[name]
        raise self.library.source.refuse(
            f"{name} has no value yet", node, hint="assign it before use"
        )

    def relation(self, op: str, lhs: ca.SX, rhs: ca.SX, event: bool, node: Any) -> ca.SX:
        return compare(op, lhs, rhs)

    def rounded(self, value: ca.SX, event: bool, node: Any) -> ca.SX:
        return ca.floor(value)

    def dimensions(self, node: Any) -> int | None:
        return None

    def operator(
        self, function: str, args: tuple[Any, ...], translate: Translator, node: Any
    ) -> Value | None:
        if function in OUTSIDE:
            raise self.library.source.refuse(f"{function}() is not allowed in a function", node)
        if function in ("initial", "terminal"):
            return ca.SX(0)
        return None

    def call(self, node: ir.Call, translate: Translator, every: bool = False) -> Value:
        given = self.values.get(node.function)
        if isinstance(given, Given):
            return self.library.call_given(given, node, translate)
        return self.library.call(node, translate, every)


class FunctionLibrary:
    def __init__(self, source: Source, functions: Mapping[str, ir.Function]) -> None:
        self.source, self.functions = source, functions
        self._open: list[str] = []  # functions being run
        self.parameters: frozenset[str] = frozenset()  # names of the model's parameter scalars

    def call(self, node: ir.Call, translate: Translator, every: bool = False) -> Value:
        """The first output, or all of them (`every`) as a list."""
        return self._run(node.function, node, translate, {}, every)

    def call_given(self, given: Given, node: ir.Call, translate: Translator) -> Value:
        """The first output of a function that was given as an argument."""
        return self._run(given.function, node, translate, given.named)

    def _run(
        self,
        name: str,
        node: ir.Call,
        translate: Translator,
        bound: dict[str, Value],
        every: bool = False,
    ) -> Value:
        function = self.functions.get(name)
        if function is None or function.external:
            raise self.source.refuse(
                f"not supported: the function {name} is written in another language",
                node,
                hint="write it in Modelica",
            )
        if not function.outputs:
            raise self.source.refuse(f"{name} has no output", node)
        args = [translate(arg) for arg in node.args]
        named = bound | {name: translate(arg) for name, arg in node.named}
        if self._open.count(name) > DEEPEST:
            told = self.source.refuse(
                f"not supported: {name} calls itself without an end that is known", node
            )
            raise undecided(told, *_numbers([*args, *named.values()]))
        self._open.append(name)
        try:
            results = _Run(self, function).results(args, named, node)
        finally:
            self._open.pop()
        return results if every else results[0]


class Interpreter:
    """Runs statements symbolically; `scope.values` holds what has been assigned."""

    def __init__(self, source: Source, scope: Any, translate: Translator) -> None:
        self.source, self.scope, self.translate, self.iterations = source, scope, translate, 0
        self.parameters: frozenset[str] = frozenset()  # names of scalars that could be fixed
        self.branches = 0  # conditions known only while running, around the statement

    def statements(self, body: tuple[ir.Statement, ...]) -> None:
        for statement in body:
            if self._over():
                return
            method = getattr(self, f"_{type(statement).__name__.lower()}", None)
            if method is None:
                kind = type(statement).__name__
                raise self.source.refuse(
                    f"not supported: the statement {kind} in a function", statement
                )
            method(statement)

    def _over(self) -> bool:
        """Whether a return or break that surely happened lies behind."""
        marks = (self.scope.values.get(mark) for mark in (FINISHED, BROKEN))
        return any(m is not None and m.is_constant() and float(m) != 0 for m in marks)

    def _skipping(self) -> ca.SX | None:
        """Where a return or break may lie behind: the condition for it."""
        marks = [self.scope.values.get(mark) for mark in (FINISHED, BROKEN)]
        open_ = [m for m in marks if m is not None and not m.is_constant()]
        if not open_:
            return None
        return open_[0] if len(open_) == 1 else ca.logic_or(*open_)

    def _leave(self, node: ir.Leave) -> None:
        mark = FINISHED if node.word == "return" else BROKEN
        skipping = self._skipping()
        before = self.scope.values.get(mark, ca.SX(0))
        self.scope.values[mark] = (
            ca.SX(1) if skipping is None else ca.if_else(skipping, before, ca.SX(1))
        )

    def _assertion(self, node: ir.Assertion) -> None:
        """Checks in functions do not stop a run; one that fails for sure is refused."""
        if self.branches or self._skipping() is not None:
            return
        held = self.translate(node.condition)
        if isinstance(held, ca.SX) and held.is_constant() and not float(held):
            raise self.source.refuse(f"an assertion fails: {node.message}", node)

    def _terminate(self, node: ir.Terminate) -> None:
        raise self.source.refuse("terminate() is not allowed in a function", node)

    def _assign(self, node: ir.Assign) -> None:
        if len(node.targets) > 1:
            if not isinstance(node.value, ir.Call):
                raise self.source.refuse("several names take a function's results", node)
            results = self.scope.call(node.value, self.translate, every=True)
            for target, value in zip(node.targets, results, strict=False):
                if target is not None:
                    self._put(target, value)
            return
        target = node.targets[0]
        value = self.translate(node.value)
        if target is not None:
            self._put(target, value)

    def _put(self, target: ir.Name | ir.Field, value: Value) -> None:
        skipping = self._skipping()
        root, steps = _steps(target)
        before = self.scope.values.get(root)
        if before is None and steps:
            before = self.scope.name(root, target)
        if not steps and isinstance(before, list) and not isinstance(value, list):
            value = fill(value, ca.SX(len(before))) if before else value
        after = self._changed(before, steps, value, target)
        if skipping is not None and before is not None:
            after = choose(skipping, before, after)
        self.scope.values[root] = after

    def _changed(self, old: Value, steps: list[Any], value: Value, target: Any) -> Value:
        if not steps:
            return value
        first, rest = steps[0], steps[1:]
        if isinstance(first, str):
            return {**old, first: self._changed(old.get(first), rest, value, target)}
        if not isinstance(old, list):
            raise self.source.refuse("a subscript stands behind a scalar", target)
        if isinstance(first, ir.Slice):
            index: Value = [ca.SX(i + 1) for i in range(len(old))]
        else:
            index = self.translate._with_last(first, len(old))
        new = list(old)
        if isinstance(index, list):
            for k, at in enumerate(index):
                item = value[k] if isinstance(value, list) else value
                i = self._position(at, len(old), target)
                new[i] = self._changed(old[i], rest, item, target)
            return new
        if index.is_constant():
            i = self._position(index, len(old), target)
            new[i] = self._changed(old[i], rest, value, target)
            return new
        return [
            choose(index == i + 1, self._changed(item, rest, value, target), item)
            for i, item in enumerate(old)
        ]

    def _position(self, at: ca.SX, size: int, target: Any) -> int:
        number = float(at)
        if not number.is_integer() or not 1 <= number <= size:
            name = getattr(target, "name", "")
            message = f"subscript {number:g} does not fit the array {name}"
            raise self.source.refuse(message, target, hint="correct the subscript")
        return int(number) - 1

    def _forloop(self, node: ir.ForLoop) -> None:
        if isinstance(node.range, ir.Range):
            items: list[Value] = [ca.SX(v) for v in self.translate.range_values(node.range)]
        else:
            items = self.translate.items(node.range)
        kept = self._before_loop()
        for value in items:
            self._count(node)
            self.scope.values[node.name] = value
            self.statements(node.body)
            if self._over():
                break
        self._after_loop(kept)

    def _before_loop(self) -> Value:
        kept = self.scope.values.get(BROKEN)
        self.scope.values[BROKEN] = ca.SX(0)
        return kept

    def _after_loop(self, kept: Value) -> None:
        if kept is None:
            self.scope.values.pop(BROKEN, None)
        else:
            self.scope.values[BROKEN] = kept

    def _whileloop(self, node: ir.WhileLoop) -> None:
        kept = self._before_loop()
        rounds = 0
        while not self._over():
            condition = self.translate.scalar(node.condition)
            if condition.is_constant():
                if not float(condition):
                    break
            elif not self._may_go_on(condition, rounds, node):
                break
            rounds += not condition.is_constant()
            self._count(node)
            self.statements(node.body)
        self._after_loop(kept)

    def _may_go_on(self, condition: ca.SX, rounds: int, node: ir.WhileLoop) -> bool:
        """A condition known only while running: as many rounds as the longest array has elements
        are kept, each under its condition. What has not ended then is no number.
        """
        values = self.scope.values
        most = max((len(v) for v in values.values() if isinstance(v, list)), default=0) + 2
        if most <= 2:
            told = self.source.refuse(
                "not supported: the statement while with a condition that is not constant",
                node,
                hint="write a for that covers all rounds, with an if inside",
            )
            raise undecided(told, condition)
        before = values.get(BROKEN, ca.SX(0))
        values[BROKEN] = ca.logic_or(before, ca.logic_not(condition))
        if rounds < most:
            return True
        if all(v.name() in self.parameters for v in ca.symvar(condition)):
            told = self.source.refuse("a loop whose end is not known while compiling", node)
            raise undecided(told, condition)
        for name in {target.name for target in assigned_names(node.body)}:
            spoilt = elementwise(lambda v: v * ca.SX(float("nan")), values[name])
            values[name] = choose(values[BROKEN], values[name], spoilt)
        return False

    def _count(self, node: Any) -> None:
        self.iterations += 1
        if self.iterations > MAX_ITERATIONS:
            raise self.source.refuse(
                f"a function loops more than {MAX_ITERATIONS} times", node, hint="shorten it"
            )

    def _ifstatement(self, node: ir.IfStatement) -> None:
        before = dict(self.scope.values)
        outcomes: list[tuple[ca.SX, dict[str, Value]]] = []
        for condition, body in node.branches:
            test = self.translate.scalar(condition)
            if test.is_constant():
                if not float(test):
                    continue
                self.statements(body)
                break
            self.scope.values = dict(before)
            self.branches += 1
            self.statements(body)
            outcomes.append((test, self.scope.values))
            self.scope.values = dict(before)
        else:
            self.statements(node.otherwise)
        self.branches -= len(outcomes)
        for test, values in reversed(outcomes):
            for name, value in values.items():
                other = self.scope.values.get(name, value)
                self.scope.values[name] = value if value is other else choose(test, value, other)


class _Run(Interpreter):
    """One call."""

    def __init__(self, library: FunctionLibrary, function: ir.Function) -> None:
        scope = FunctionScope(library)
        super().__init__(library.source, scope, Translator(library.source, scope, events=False))
        self.function, self.parameters = function, library.parameters

    def results(self, args: list[Value], named: dict[str, Value], node: Any) -> list[Value]:
        function, values = self.function, self.scope.values
        if len(args) > len(function.inputs):
            raise self.source.refuse(
                f"{function.name} takes {len(function.inputs)} arguments, not {len(args)}", node
            )
        for i, declared in enumerate(function.inputs):
            if i < len(args):
                values[declared.name] = args[i]
            elif declared.name in named:
                values[declared.name] = named[declared.name]
            elif declared.default is not None:
                values[declared.name] = self.translate(declared.default)
            else:
                raise self.source.refuse(
                    f"{function.name} lacks its input {declared.name}", node, hint="give it"
                )
        values[FINISHED] = ca.SX(0)
        waiting = [*function.locals, *function.outputs]
        while waiting:  # a size may stand on a variable declared later
            names = {local.name for local in waiting}
            ready = next((w for w in waiting if not _needs(w) & (names - {w.name})), waiting[0])
            waiting.remove(ready)
            self._declare(ready)
        self.statements(function.body)
        return [self.scope.name(output.name, node) for output in function.outputs]

    def _declare(self, local: ir.Local) -> None:
        values = self.scope.values
        if local.default is not None:
            values[local.name] = self._spread(local, self.translate(local.default))
        elif all(d is not None for d in local.dims) and (local.dims or local.fields):
            values[local.name] = self._zeros(local)

    def _spread(self, local: ir.Local, value: Value) -> Value:
        """A scalar given for an array stands for all its elements."""
        if isinstance(value, list) or not local.dims or any(d is None for d in local.dims):
            return value
        return fill(value, *(self.translate(d) for d in local.dims))

    def _zeros(self, local: ir.Local) -> Value:
        value: Value = {f.name: self._zeros(f) for f in local.fields} or ca.SX(0)
        sizes = [self.translate.number(d, "a size") for d in local.dims]
        count = 1
        for size in sizes:
            count *= size
        if count > MAX_ITERATIONS:
            raise self.source.refuse(
                f"{local.name} has more than {MAX_ITERATIONS} elements",
                local,
                hint="make it smaller",
            )
        return fill(value, *map(ca.SX, sizes))


def _numbers(values: list[Value]) -> list[ca.SX]:
    """All scalars of arguments, those of functions among them too."""
    found: list[ca.SX] = []
    for value in flatten(values):
        if isinstance(value, Given):
            found += _numbers(list(value.named.values()))
        elif isinstance(value, ca.SX):
            found.append(value)
    return found


def _needs(local: ir.Local) -> set[str]:
    """Names that a variable's sizes and first value ask for."""
    return {n.name for n in ir.nodes([*local.dims, local.default]) if isinstance(n, ir.Name)}


def assigned_names(body: tuple[ir.Statement, ...]) -> list[ir.Name]:
    """Plain variables that statements assign, those within other statements too."""
    found: list[ir.Name] = []
    for statement in body:
        if isinstance(statement, ir.Assign):
            found += [t for t in statement.targets if isinstance(t, ir.Name)]
        elif isinstance(statement, ir.IfStatement):
            for inner in (*(b for _, b in statement.branches), statement.otherwise):
                found += assigned_names(inner)
        elif isinstance(statement, ir.ForLoop | ir.WhileLoop):
            found += assigned_names(statement.body)
    return found


def _steps(target: ir.Name | ir.Field) -> tuple[str, list[Any]]:
    """The variable behind a target, and the way to the part that is meant."""
    if isinstance(target, ir.Field):
        base = target.base
        if not isinstance(base, ir.Name | ir.Field):
            return target.name, []
        root, steps = _steps(base)
        return root, [*steps, target.name]
    return target.name, list(target.subscripts)


def call_with_numbers(
    table: Any, node: ir.Call, args: list[Any], named: dict[str, Any]
) -> Any | None:
    """A function's first output for plain numbers; None where it is no number."""

    def symbolic(value: Any) -> Value:
        if isinstance(value, list):
            return [symbolic(v) for v in value]
        return ca.SX(float(value))

    library = FunctionLibrary(Source(Path(node.place.file)), table.made)
    function = table.made[node.function]
    if function.external:
        return None
    given = {name: symbolic(value) for name, value in named.items()}
    results = _Run(library, function).results([symbolic(a) for a in args], given, node)
    if not results:
        return None
    result = results[0]
    if not all(isinstance(v, ca.SX) and v.is_constant() for v in flatten(result)):
        return None
    return _plain(result, function.outputs[0].type)


def _plain(value: Value, type_: str) -> Any:
    if isinstance(value, list):
        return [_plain(v, type_) for v in value]
    if isinstance(value, dict):
        return None
    number = float(value)
    if type_ == "Real":
        return number
    return bool(number) if type_ == "Boolean" else int(number)
