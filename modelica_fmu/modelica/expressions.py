"""Parser of Modelica expressions: precedence climbing over the token list."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from modelica_fmu.errors import InputError
from modelica_fmu.modelica.lexer import Token, unexpected, unquoted
from modelica_fmu.modelica.syntax import (
    Binary,
    Braces,
    Brackets,
    Call,
    Colon,
    End,
    Expr,
    IfExpr,
    Iterator,
    Number,
    Part,
    Place,
    Range,
    Ref,
    Text,
    Truth,
    Tuple,
    Unary,
)

T = TypeVar("T")
RELATIONS = ("<", "<=", ">", ">=", "==", "<>")


class ExpressionParser:
    """A token list with a cursor. Every method raises InputError with file and line."""

    def __init__(self, found: list[Token], file: Path) -> None:
        self.tokens, self.file, self.at = found, file, 0

    # ---- the cursor

    @property
    def token(self) -> Token:
        return self.tokens[self.at]

    @property
    def place(self) -> Place:
        return Place(self.file, self.token.line)

    def ahead(self) -> Token:
        return self.tokens[min(self.at + 1, len(self.tokens) - 1)]

    def advance(self) -> Token:
        self.at += 1
        return self.tokens[self.at - 1]

    def is_(self, kind: str, text: str) -> bool:
        return self.token.kind == kind and self.token.text == text

    def take(self, text: str) -> bool:
        """Steps over a keyword or operator if it stands here."""
        if self.token.text == text and self.token.kind in ("keyword", "op"):
            self.at += 1
            return True
        return False

    def need(self, text: str) -> None:
        if not self.take(text):
            raise unexpected(self.token.text, self.place, f"`{text}`")

    def unexpected(self) -> InputError:
        return unexpected(self.token.text, self.place)

    def error(self, message: str) -> InputError:
        hint = "correct the Modelica text"
        return InputError(message, file=f"{self.file}:{self.token.line}", hint=hint)

    def listed(self, one: Callable[[], T]) -> list[T]:
        found = [one()]
        while self.take(","):
            found.append(one())
        return found

    def name(self) -> str:
        if self.token.kind != "name":
            raise unexpected(self.token.text, self.place, "a name")
        return self.advance().text

    def dotted(self) -> tuple[str, ...]:
        self.take(".")
        names = [self.name()]
        while self.take("."):
            names.append(self.name())
        return tuple(names)

    # ---- expressions

    def expression(self, simple: bool = False) -> Expr:
        if self.is_("keyword", "if") and not simple:
            return self._if()
        place, first = self.place, self._or()
        if not self.take(":"):
            return first
        second = self._or()
        if not self.take(":"):
            return Range(place, first, None, second)
        return Range(place, first, second, self._or())

    def _if(self) -> Expr:
        place, branches = self.place, []
        self.need("if")
        while True:
            condition = self.expression()
            self.need("then")
            branches.append((condition, self.expression()))
            if not self.take("elseif"):
                break
        self.need("else")
        return IfExpr(place, tuple(branches), self.expression())

    def _or(self) -> Expr:
        left = self._and()
        while self.is_("keyword", "or"):
            place = self.place
            self.advance()
            left = Binary(place, "or", left, self._and())
        return left

    def _and(self) -> Expr:
        left = self._not()
        while self.is_("keyword", "and"):
            place = self.place
            self.advance()
            left = Binary(place, "and", left, self._not())
        return left

    def _not(self) -> Expr:
        if self.is_("keyword", "not"):
            place = self.place
            self.advance()
            return Unary(place, "not", self._relation())
        return self._relation()

    def _relation(self) -> Expr:
        left = self._sum()
        if self.token.kind == "op" and self.token.text in RELATIONS:
            place, op = self.place, self.advance().text
            return Binary(place, op, left, self._sum())
        return left

    def _sum(self) -> Expr:
        place, sign = self.place, ""
        if self.token.kind == "op" and self.token.text in ("+", "-", ".+", ".-"):
            sign = self.advance().text.lstrip(".")
        left = self._product()
        left = Unary(place, "-", left) if sign == "-" else left
        while self.token.kind == "op" and self.token.text in ("+", "-", ".+", ".-"):
            place, op = self.place, self.advance().text
            left = Binary(place, op, left, self._product())
        return left

    def _product(self) -> Expr:
        left = self._power()
        while self.token.kind == "op" and self.token.text in ("*", "/", ".*", "./"):
            place, op = self.place, self.advance().text
            left = Binary(place, op, left, self._power())
        return left

    def _power(self) -> Expr:
        base = self.primary()
        if self.token.kind == "op" and self.token.text in ("^", ".^"):
            place, op = self.place, self.advance().text
            return Binary(place, op, base, self.primary())
        return base

    def primary(self) -> Expr:
        place, (kind, text, _) = self.place, self.token
        if kind == "number":
            self.advance()
            return Number(place, float(text), text.isdigit())
        if kind == "string":
            return Text(place, unquoted(self.advance().text))
        if kind == "keyword":
            return self._word(place, text)
        if kind == "name" or text == ".":
            return self._reference_or_call()
        if text == "(":
            return self._parenthesis()
        if text == "[":
            self.advance()
            rows = [tuple(self.listed(self.expression))]
            while self.take(";"):
                rows.append(tuple(self.listed(self.expression)))
            self.need("]")
            return Brackets(place, tuple(rows))
        if text == "{":
            return self._braces()
        raise self.unexpected()

    def _word(self, place: Place, text: str) -> Expr:
        if text in ("true", "false"):
            self.advance()
            return Truth(place, text == "true")
        if text == "end":
            self.advance()
            return End(place)
        if text in ("der", "initial", "pure") and self.ahead().text == "(":
            self.advance()
            return self._call(Ref(place, (Part(text, ()),)))
        if text == "not":
            return self._not()
        raise self.unexpected()

    def _parenthesis(self) -> Expr:
        place = self.place
        self.need("(")
        items: list[Expr | None] = []
        several = False
        while True:
            skipped = self.token.text in (",", ")") and self.token.kind == "op"
            items.append(None if skipped else self.expression())
            if not self.take(","):
                break
            several = True
        self.need(")")
        if several or items == [None]:
            return Tuple(place, tuple(items))
        inner = items[0]
        assert inner is not None
        if self.is_("op", "["):
            raise self.error("not supported: subscripts of an expression in parentheses")
        return inner

    def _braces(self) -> Expr:
        place = self.place
        self.need("{")
        if self.take("}"):
            return Braces(place, ())
        first = self.expression()
        if self.take("for"):
            iterators = self.iterators()
            self.need("}")
            return Braces(place, (first,), iterators)
        items = [first]
        while self.take(","):
            items.append(self.expression())
        self.need("}")
        return Braces(place, tuple(items))

    def iterators(self) -> tuple[Iterator, ...]:
        return tuple(self.listed(self._iterator))

    def _iterator(self) -> Iterator:
        name = self.name()
        return Iterator(name, self.expression() if self.take("in") else None)

    # ---- references and calls

    def reference(self, with_subscripts: bool = True) -> Ref:
        place, absolute, parts = self.place, self.take("."), []
        while True:
            name = self.name()
            of = self.subscripts() if with_subscripts and self.is_("op", "[") else ()
            parts.append(Part(name, of))
            if not self.take("."):
                return Ref(place, tuple(parts), absolute)

    def subscripts(self) -> tuple[Expr, ...]:
        self.need("[")
        found = self.listed(self._subscript)
        self.need("]")
        return tuple(found)

    def _subscript(self) -> Expr:
        place = self.place
        if self.is_("op", ":") and self.ahead().text in (",", "]"):
            self.advance()
            return Colon(place)
        return self.expression()

    def _reference_or_call(self) -> Expr:
        found = self.reference()
        return self._call(found) if self.is_("op", "(") else found

    def _call(self, function: Ref) -> Expr:
        place = function.place
        self.need("(")
        args: list[Expr] = []
        named: list[tuple[str, Expr]] = []
        iterators: tuple[Iterator, ...] = ()
        while not self.is_("op", ")"):
            if self.token.kind == "name" and self.ahead().text == "=":
                name = self.name()
                self.need("=")
                named.append((name, self._argument()))
            else:
                args.append(self._argument())
            if self.take("for"):
                iterators = self.iterators()
            if not self.take(","):
                break
        self.need(")")
        return Call(place, function, tuple(args), tuple(named), iterators)

    def _argument(self) -> Expr:
        if self.take("function"):  # a partial application; refused where it is used
            return Call(self.place, Ref(self.place, (Part("function", ()),)), (self.primary(),))
        return self.expression()
