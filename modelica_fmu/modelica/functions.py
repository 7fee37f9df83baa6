"""Functions of the text → functions of the flat model (section 12)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modelica_fmu import ir
from modelica_fmu.modelica import syntax as ast
from modelica_fmu.modelica.scope import Scope, refuse

if TYPE_CHECKING:
    from modelica_fmu.modelica.instances import Frame
    from modelica_fmu.modelica.resolve import Resolver


class FunctionTable:
    """All functions that the model calls, each translated once."""

    def __init__(self, resolver: Resolver) -> None:
        self.resolver = resolver
        self.made: dict[str, ir.Function] = {}
        self._names: dict[int, str] = {}
        self._scopes: list[Scope] = []  # kept alive: their ids are keys

    def builtin(self, scope: Scope) -> str:
        """The operator that a function of the standard library stands for."""
        external = scope.cls.external
        for _, base in scope.bases():
            external = external or base.cls.external
        if external is None or external.language != "builtin":
            return ""
        return external.name.rsplit(".", 1)[-1] or scope.cls.name

    def is_function(self, scope: Scope) -> bool:
        return scope.cls.kind == "function" or any(self.is_function(b) for _, b in scope.bases())

    def add(self, scope: Scope, place: ir.Place) -> str:
        """The name under which a function stands in the flat model."""
        name = self._name(scope)
        if name not in self.made:
            self.made[name] = ir.Function(place, name, (), (), (), ())  # it may call itself
            self.made[name] = self._function(name, scope)
        return name

    def _name(self, scope: Scope) -> str:
        """Its path; a function of a redeclared package is told from its namesake."""
        name, wanted = scope.path, (scope.cls, _replacements(scope))
        known = [s for s in self._scopes if s.path == name]
        for i, other in enumerate(known):
            if (other.cls, _replacements(other)) == wanted:
                return name if i == 0 else f"{name}#{i}"
        self._scopes.append(scope)
        return name if not known else f"{name}#{len(known)}"

    def _function(self, name: str, scope: Scope) -> ir.Function:
        from modelica_fmu.modelica.instances import Frame

        declared: list[tuple[ast.Component, Frame]] = []
        body: list[tuple[tuple[ast.Action, ...], Frame]] = []
        external = self._collect(scope, declared, body)
        names = frozenset(c.name for c, _ in declared if c.variability != "constant")
        locals_ = [(self._local(c, frame, names), c) for c, frame in declared if c.name in names]
        statements: list[ir.Statement] = []
        if external is None:
            for actions, frame in body:
                of = Frame(None, frame.scope, {}, names or frozenset({""}))
                statements += StatementMaker(self.resolver, of).all(actions)
        return ir.Function(
            scope.cls.place,
            name,
            tuple(local for local, c in locals_ if c.causality == "input"),
            tuple(local for local, c in locals_ if c.causality == "output"),
            tuple(local for local, c in locals_ if not c.causality),
            tuple(statements),
            external=external is not None,
        )

    def _collect(
        self,
        scope: Scope,
        declared: list[tuple[ast.Component, Frame]],
        body: list[tuple[tuple[ast.Action, ...], Frame]],
    ) -> ast.External | None:
        from modelica_fmu.modelica.instances import Frame

        external = scope.cls.external
        for _, base in scope.bases():
            external = self._collect(base, declared, body) or external
        if scope.cls.derivatives is not None:
            raise refuse("not supported: a function given as a derivative", scope.cls.place)
        frame = Frame(None, scope)
        for element in scope.cls.elements:
            if isinstance(element, ast.Component):
                declared[:] = [d for d in declared if d[0].name != element.name]
                declared.append((element, frame))
        if scope.cls.algorithms:
            body[:] = [(actions, frame) for actions in scope.cls.algorithms]
        return external

    def _local(self, c: ast.Component, frame: Frame, names: frozenset[str]) -> ir.Local:
        from modelica_fmu.modelica.instances import Frame

        inside = Frame(None, frame.scope, {}, names)
        target = frame.scope.find_class(c.type)
        kind, dims, fields = self._type(target, inside)
        own = tuple(None if isinstance(d, ast.Colon) else self._dim(d, inside) for d in c.dims)
        default = self.resolver.expression(c.value, inside) if c.value is not None else None
        return ir.Local(c.place, c.name, kind, (*own, *dims), default, fields)

    def _dim(self, dim: ast.Expr, frame: Frame) -> ir.Expr:
        if isinstance(dim, ast.Ref):
            count = self.resolver.literals_of(dim, frame)
            if count is not None:
                return ir.Literal(dim.place, count, "Integer")
        return self.resolver.expression(dim, frame)

    def _type(
        self, target: Scope, frame: Frame
    ) -> tuple[str, tuple[ir.Expr | None, ...], tuple[ir.Local, ...]]:
        dims: tuple[ir.Expr | None, ...] = ()
        if self.is_function(target):
            return "function", (), ()
        for _ in range(100):
            if target.builtin:
                return target.builtin, dims, ()
            if target.cls.literals is not None:
                self.resolver.enumerations[target.path] = target.cls.literals
                return target.path, dims, ()
            if target.cls.kind == "record" and target.cls.alias is None:
                return target.path, dims, self._fields(target)
            alias, bases = target.cls.alias, target.bases()
            if alias is not None:
                dims += tuple(
                    None if isinstance(d, ast.Colon) else self._dim(d, frame) for d in alias.dims
                )
            if len(bases) != 1:
                break
            target = bases[0][1]
        raise refuse(f"not supported: {target.path} in a function", target.cls.place)

    def _fields(self, record: Scope) -> tuple[ir.Local, ...]:
        from modelica_fmu.modelica.instances import Frame

        found: list[ir.Local] = []
        for _, base in record.bases():
            found += self._fields(base)
        for element in record.cls.elements:
            if isinstance(element, ast.Component):
                found.append(self._local(element, Frame(None, record), frozenset()))
        return tuple(found)


def _replacements(scope: Scope) -> frozenset[tuple[str, int]]:
    found: set[tuple[str, int]] = set()
    at: Scope | None = scope
    while at is not None:
        found |= {(name, id(other.cls)) for name, other in at.redeclared.items()}
        at = at.parent
    return frozenset(found)


class StatementMaker:
    """Statements of a function's body, or of an algorithm of a model."""

    def __init__(self, resolver: Resolver, frame: Frame) -> None:
        self.resolver, self.frame = resolver, frame

    def all(self, actions: tuple[ast.Action, ...]) -> list[ir.Statement]:
        found: list[ir.Statement] = []
        for action in actions:
            made = getattr(self, f"_{type(action).__name__.lower()}")(action)
            found += made if isinstance(made, list) else [made]
        return found

    def expression(self, expr: ast.Expr) -> ir.Expr:
        return self.resolver.expression(expr, self.frame)

    def _assign(self, a: ast.Assign) -> ir.Statement | list[ir.Statement]:
        value = self.expression(a.value)
        if isinstance(a.target, ast.Tuple):
            targets = [None if t is None else self.expression(t) for t in a.target.items]
            return ir.Assign(a.place, tuple(map(self._target, targets)), value)
        target = self.expression(a.target)
        if isinstance(target, ir.Record):
            return [
                ir.Assign(a.place, (self._target(inner),), ir.Field(a.place, value, name))
                for name, inner in target.fields
            ]
        if isinstance(target, ir.Array):
            items = target.items
            return [
                ir.Assign(
                    a.place,
                    (self._target(item),),
                    ir.Index(a.place, value, (ir.Literal(a.place, i, "Integer"),)),
                )
                for i, item in enumerate(items, 1)
            ]
        return ir.Assign(a.place, (self._target(target),), value)

    def _target(self, target: ir.Expr | None) -> ir.Name | ir.Field | None:
        if target is None or isinstance(target, ir.Name | ir.Field):
            return target
        if isinstance(target, ir.Index):
            base = target.base
            if isinstance(base, ir.Field):
                raise refuse("not supported: an element of a record's array assigned", target.place)
        raise refuse("only a variable can be assigned", target.place)

    def _for(self, a: ast.For) -> ir.Statement | list[ir.Statement]:
        first, *rest = a.iterators
        body: tuple[ast.Action, ...] = (ast.For(a.place, tuple(rest), a.body),) if rest else a.body
        if not self.frame.locals:
            found: list[ir.Statement] = []
            for value in self.resolver.values(first, self.frame, list(a.body)):
                inner = self.frame.with_iterator(first.name, value)
                found += StatementMaker(self.resolver, inner).all(body)
            return found
        if first.range is None:
            raise refuse(f"not supported: the range of {first.name} is left open", a.place)
        count = None
        if isinstance(first.range, ast.Ref):
            count = self.resolver.literals_of(first.range, self.frame)
        over = (
            self.expression(first.range)
            if count is None
            else ir.Range(
                a.place,
                ir.Literal(a.place, 1, "Integer"),
                None,
                ir.Literal(a.place, count, "Integer"),
            )
        )
        from modelica_fmu.modelica.instances import Frame

        f = self.frame
        inner = Frame(f.instance, f.scope, f.iterators, f.locals | {first.name})
        return ir.ForLoop(
            a.place, first.name, over, tuple(StatementMaker(self.resolver, inner).all(body))
        )

    def _while(self, a: ast.While) -> ir.Statement:
        return ir.WhileLoop(a.place, self.expression(a.condition), tuple(self.all(a.body)))

    def _if(self, a: ast.If) -> ir.Statement | list[ir.Statement]:
        branches: list[tuple[ir.Expr, tuple[ir.Statement, ...]]] = []
        for condition, body in a.branches:
            test = self.expression(condition)
            known = self.resolver.evaluator.look(test) if not self.frame.locals else None
            if known is not None and not known:
                continue
            if known is not None:
                last = self.all(body)
                return ir.IfStatement(a.place, tuple(branches), tuple(last)) if branches else last
            branches.append((test, tuple(self.all(body))))
        if not branches:
            return self.all(a.otherwise)
        return ir.IfStatement(a.place, tuple(branches), tuple(self.all(a.otherwise)))

    def _when(self, a: ast.When) -> ir.Statement:
        return ir.WhenStatement(
            a.place, tuple((self.expression(c), tuple(self.all(body))) for c, body in a.branches)
        )

    def _leave(self, a: ast.Leave) -> ir.Statement:
        return ir.Leave(a.place, a.word)

    def _callequation(self, a: ast.CallEquation) -> ir.Statement | list[ir.Statement]:
        made = action_of(a, self.resolver, self.frame)
        return [] if made is None else made  # type: ignore[return-value]


def action_of(
    a: ast.CallEquation, resolver: Resolver, frame: Frame
) -> ir.Assertion | ir.Reinit | ir.Terminate | None:
    """assert, reinit, terminate; None for what only prints or only guides graphics."""
    name, args = str(a.call.function), a.call.args
    named = dict(a.call.named)
    if name == "assert":
        return assertion(a, resolver, frame)
    if name == "reinit" and len(args) == 2:
        state = resolver.expression(args[0], frame)
        if not isinstance(state, ir.Name):
            raise refuse("reinit() takes a state", a.place, hint="name a state")
        return ir.Reinit(a.place, state, resolver.expression(args[1], frame))
    if name == "terminate":
        return ir.Terminate(a.place, message_of(resolver.expression(args[0], frame)))
    if name.startswith("Connections."):
        return None
    if name.rsplit(".", 1)[-1] in ("print", "error") and not named:
        return None
    _checks_only(a, resolver, frame)
    return None


def _checks_only(a: ast.CallEquation, resolver: Resolver, frame: Frame) -> None:
    """A function without outputs can but check: it is run where its arguments are known."""
    from modelica_fmu.functions import call_with_numbers

    made = resolver.expression(a.call, frame)
    function = resolver.functions.made.get(made.function) if isinstance(made, ir.Call) else None
    if function is None or function.outputs or function.external:
        raise refuse(f"not supported: a call of {a.call.function} without a result", a.place)
    args = [resolver.evaluator.look(arg) for arg in made.args]
    named = {name: resolver.evaluator.look(arg) for name, arg in made.named}
    if not frame.locals and all(v is not None for v in (*args, *named.values())):
        call_with_numbers(resolver.functions, made, args, named)


def assertion(a: ast.CallEquation, resolver: Resolver, frame: Frame) -> ir.Assertion:
    args, named = list(a.call.args), dict(a.call.named)
    condition = args[0] if args else named.get("condition")
    message = args[1] if len(args) > 1 else named.get("message")
    level = args[2] if len(args) > 2 else named.get("level")
    if condition is None or message is None:
        raise refuse("assert() needs a condition and a message", a.place)
    warning = False
    if level is not None:
        kind = resolver.evaluator.look(resolver.expression(level, frame))
        warning = kind == 1
    text = message_of(resolver.expression(message, frame))
    return ir.Assertion(a.place, resolver.expression(condition, frame), text, warning)


def message_of(expr: ir.Expr) -> str:
    """The text of a message; "..." stands for what is known only while running."""
    if isinstance(expr, ir.Text):
        return expr.value
    if isinstance(expr, ir.Binary) and expr.op == "+":
        return message_of(expr.left) + message_of(expr.right)
    return "..."
