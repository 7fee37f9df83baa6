"""Parser of whole Modelica files, by recursive descent (appendix A of the specification)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from modelica_fmu.errors import InputError
from modelica_fmu.modelica.expressions import ExpressionParser
from modelica_fmu.modelica.lexer import tokens, unexpected, unquoted
from modelica_fmu.modelica.syntax import (
    Action,
    Assign,
    Call,
    CallEquation,
    ClassDef,
    Component,
    Connect,
    Equation,
    Extends,
    External,
    For,
    If,
    Import,
    Leave,
    Modifier,
    Part,
    Place,
    Ref,
    Tuple,
    When,
    While,
)

KINDS = ("class", "model", "block", "record", "connector", "type", "package", "function")
BEFORE_CLASS = ("partial", "encapsulated", "pure", "impure", "operator", "expandable")
OF_COMPONENT = ("flow", "stream", "discrete", "parameter", "constant", "input", "output")
SECTIONS = ("public", "protected", "equation", "algorithm", "initial", "external", "annotation")
T = TypeVar("T")


def parse(text: str, file: Path) -> tuple[tuple[str, ...], list[ClassDef]]:
    """The package that a file says it lies within, and its classes.

    Raises InputError with file and line for what is no Modelica.
    """
    return FileParser(tokens(text, file), file).file_of_classes()


class FileParser(ExpressionParser):
    def file_of_classes(self) -> tuple[tuple[str, ...], list[ClassDef]]:
        within: tuple[str, ...] = ()
        if self.take("within"):
            if not self.is_("op", ";"):
                within = self.dotted()
            self.need(";")
        classes: list[ClassDef] = []
        while self.token.kind != "end":
            self.take("final")
            classes.append(self.class_definition(frozenset()))
            self.need(";")
        return within, classes

    # ---- classes

    def class_definition(self, prefixes: frozenset[str]) -> ClassDef:
        place, found = self.place, set(prefixes)
        while self.token.text in BEFORE_CLASS and self.token.kind in ("keyword", "name"):
            found.add(self.advance().text)
        if "operator" in found and self.token.text not in KINDS:
            kind = "package"  # `operator 'constructor'` holds functions
        elif self.token.text in KINDS:
            kind = self.advance().text
        else:
            raise self.unexpected()
        return self._class_body(ClassDef(place, kind, "", prefixes=frozenset(found)))

    def _class_body(self, made: ClassDef) -> ClassDef:
        if self.take("extends"):
            base = self.name()
            made.prefixes |= {"class extends"}
            made.elements.append(
                Extends(made.place, Ref(made.place, (Part(base, ()),)), self.modifiers())
            )
            made.name = base
        else:
            made.name = self.name()
            if self.take("="):
                return self._short_class(made)
        made.description = self.description()
        self._sections(made)
        made.end_line = self.token.line
        self.need("end")
        end = self.name()
        if end != made.name:
            raise self.error(f"`end {end}` closes the class {made.name}")
        return made

    def _short_class(self, made: ClassDef) -> ClassDef:
        made.end_line = self.token.line
        if self.take("enumeration"):
            self.need("(")
            if self.take(":"):
                literals: list[tuple[str, str]] = []
            else:
                literals = self.listed(self._literal)
            self.need(")")
            made.literals = tuple(literals)
        elif self.take("der"):
            self.need("(")
            base = self.reference()
            names: list[str] = []
            while self.take(","):
                names.append(self.name())
            self.need(")")
            made.derivatives = (base, tuple(names))
        else:
            causality = next((w for w in ("input", "output") if self.take(w)), "")
            connection = next((w for w in ("flow", "stream") if self.take(w)), "")
            place, base = self.place, self.reference(with_subscripts=False)
            made.alias = Component(
                place,
                made.name,
                base,
                self.dims(),
                self.modifiers(),
                causality=causality,
                connection=connection,
            )
        made.description, made.annotation = self.comment()
        return made

    def _literal(self) -> tuple[str, str]:
        name = self.name()
        return name, self.comment()[0]

    def _sections(self, made: ClassDef) -> None:
        protected = False
        while not self.is_("keyword", "end"):
            if self.take("public"):
                protected = False
            elif self.take("protected"):
                protected = True
            elif self.token.text in SECTIONS:
                self._section(made)
            elif self.token.kind == "end":
                raise self.unexpected()
            else:
                made.elements += self._element(protected)
                self.need(";")

    def _section(self, made: ClassDef) -> None:
        if self.is_("keyword", "annotation"):
            made.annotation += self.annotation()
            self.need(";")
        elif self.take("external"):
            made.external = self._external()
        else:
            initial = self.take("initial")
            if self.take("equation"):
                self._equations(made.initial_equations if initial else made.equations)
            elif self.take("algorithm"):
                body = tuple(self._until(self.statement))
                (made.initial_algorithms if initial else made.algorithms).append(body)
            else:
                raise self.unexpected()

    def _external(self) -> External:
        place, language, target, name = self.place, "C", None, ""
        args: tuple[Any, ...] = ()
        if self.token.kind == "string":
            language = unquoted(self.advance().text)
        if not self.is_("op", ";") and not self.is_("keyword", "annotation"):
            first = self.reference()
            if self.take("="):
                target, first = first, self.reference()
            name = str(first)
            self.need("(")
            args = tuple(self.listed(self.expression)) if not self.is_("op", ")") else ()
            self.need(")")
        if self.is_("keyword", "annotation"):
            self.annotation()
        self.need(";")
        return External(place, language, name, target, args)

    def _element(self, protected: bool) -> list[Any]:
        if self.take("import"):
            return [self._import()]
        if self.is_("keyword", "extends"):
            return [self._extends()]
        words: set[str] = set()
        while self.token.text in ("redeclare", "final", "inner", "outer", "replaceable"):
            words.add(self.advance().text)
        if self.token.text in (*KINDS, *BEFORE_CLASS) and self.token.kind == "keyword":
            made = self.class_definition(frozenset(words))
            self._constrained()
            if made.alias is None and made.literals is None:
                self.comment()
            return [made]
        return self._components(frozenset(words), protected)

    def _constrained(self) -> None:
        if self.take("constrainedby"):
            self.reference(with_subscripts=False)
            self.modifiers()
            self.comment()

    def _import(self) -> Import:
        place, names = self.place, [self.name()]
        if self.take("="):
            path = self.dotted()
            self.comment()
            return Import(place, path, alias=names[0])
        while self.token.text in (".", ".*"):
            if self.advance().text == ".*":
                self.comment()
                return Import(place, tuple(names), everything=True)
            if self.take("*"):
                self.comment()
                return Import(place, tuple(names), everything=True)
            if self.take("{"):
                chosen = tuple(self.listed(self.name))
                self.need("}")
                self.comment()
                return Import(place, tuple(names), names=chosen)
            names.append(self.name())
        self.comment()
        return Import(place, tuple(names))

    def _extends(self) -> Extends:
        place = self.place
        self.need("extends")
        made = Extends(place, self.reference(with_subscripts=False), self.modifiers())
        if self.is_("keyword", "annotation"):
            self.annotation()
        return made

    # ---- components

    def _components(self, words: frozenset[str], protected: bool) -> list[Component]:
        base = self._component_prefix(words, protected)
        made = [self._declared(base)]
        while self.take(","):
            made.append(self._declared(base))
        return made

    def _component_prefix(self, words: frozenset[str], protected: bool) -> Component:
        place, found = self.place, set[str]()
        while self.token.text in OF_COMPONENT and self.token.kind == "keyword":
            found.add(self.advance().text)

        def one(*names: str) -> str:
            return next((name for name in names if name in found), "")

        return Component(
            place,
            "",
            self.reference(with_subscripts=False),
            self.dims(),
            variability=one("constant", "parameter", "discrete"),
            causality=one("input", "output"),
            connection=one("flow", "stream"),
            scope=words & {"inner", "outer"},
            final="final" in words,
            replaceable="replaceable" in words,
            protected=protected,
        )

    def _declared(self, base: Component) -> Component:
        place, name = self.place, self.name()
        dims = self.dims() + base.dims
        modifiers = self.modifiers()
        value = self.expression() if self.take("=") or self.take(":=") else None
        condition = self.expression() if self.take("if") else None
        self._constrained()
        description, _ = self.comment()
        self._constrained()
        return replace(
            base,
            place=place,
            name=name,
            dims=dims,
            modifiers=modifiers,
            value=value,
            condition=condition,
            description=description,
        )

    def dims(self) -> tuple[Any, ...]:
        return self.subscripts() if self.is_("op", "[") else ()

    # ---- modifications

    def modifiers(self) -> tuple[Modifier, ...]:
        if not self.take("("):
            return ()
        made = [] if self.is_("op", ")") else self.listed(self._modifier)
        self.need(")")
        return tuple(made)

    def _modifier(self) -> Modifier:
        place, words = self.place, set[str]()
        while self.token.text in ("redeclare", "replaceable", "each", "final"):
            words.add(self.advance().text)
        each, final = "each" in words, "final" in words
        if words & {"redeclare", "replaceable"} or self.token.text in (*KINDS, "partial"):
            of = frozenset(words & {"replaceable", "final"})
            if self.token.text in (*KINDS, *BEFORE_CLASS):
                made: ClassDef | Component = self.class_definition(of)
            else:
                made = self._declared(self._component_prefix(of, False))
            self._constrained()
            return Modifier(place, (made.name,), each=each, final=final, redeclared=made)
        name = self.dotted()
        inner = self.modifiers()
        value = self.expression() if self.take("=") or self.take(":=") else None
        self.description()
        return Modifier(place, name, inner, value, each, final)

    def annotation(self) -> tuple[Modifier, ...]:
        self.need("annotation")
        return self.modifiers()

    def comment(self) -> tuple[str, tuple[Modifier, ...]]:
        description = self.description()
        return description, self.annotation() if self.is_("keyword", "annotation") else ()

    def description(self) -> str:
        parts: list[str] = []
        while self.token.kind == "string":
            parts.append(unquoted(self.advance().text))
            if not self.take("+"):
                break
        return "".join(parts)

    # ---- equations and statements

    def _equations(self, into: list[Action]) -> None:
        into += self._until(self.equation)

    def _until(self, one: Callable[[], Action]) -> list[Action]:
        found = []
        while not (
            self.token.kind == "keyword"
            and self.token.text in (*SECTIONS, "end", "else", "elseif", "elsewhen")
            and not (self.token.text == "initial" and self.ahead().text == "(")
        ):
            if self.token.kind == "end":
                raise self.unexpected()
            found.append(one())
            self.comment()
            self.need(";")
        return found

    def equation(self) -> Action:
        place = self.place
        if self.token.kind == "keyword":
            if self.take("connect"):
                self.need("(")
                first = self.reference()
                self.need(",")
                second = self.reference()
                self.need(")")
                return Connect(place, first, second)
            if self.token.text in ("for", "when", "while") or self._starts_if():
                return self._structured(self.equation)
        left = self.expression(simple=True)
        if self.take("="):
            return Equation(place, left, self.expression())
        if isinstance(left, Call):
            return CallEquation(place, left)
        raise self.unexpected()

    def statement(self) -> Action:
        place = self.place
        if self.token.kind == "keyword":
            if self.token.text in ("break", "return"):
                return Leave(place, self.advance().text)
            if self.token.text in ("for", "when", "while", "if"):
                return self._structured(self.statement)
        target = self.primary()
        if self.take(":="):
            if not isinstance(target, Ref | Tuple):
                raise self.error("only a name can be assigned")
            return Assign(place, target, self.expression())
        if isinstance(target, Call):
            return CallEquation(place, target)
        raise self.unexpected()

    def _starts_if(self) -> bool:
        """An if-equation, not an equation whose left side is an if-expression in parentheses."""
        return self.is_("keyword", "if")

    def _structured(self, one: Callable[[], Action]) -> Action:
        place, word = self.place, self.advance().text
        if word == "for":
            iterators = self.iterators()
            self.need("loop")
            body = tuple(self._until(one))
            self._end("for")
            return For(place, iterators, body)
        condition = self.expression()
        if word == "while":
            self.need("loop")
            body = tuple(self._until(one))
            self._end("while")
            return While(place, condition, body)
        self.need("then")
        branches = [(condition, tuple(self._until(one)))]
        while self.take("elseif" if word == "if" else "elsewhen"):
            condition = self.expression()
            self.need("then")
            branches.append((condition, tuple(self._until(one))))
        otherwise = tuple(self._until(one)) if word == "if" and self.take("else") else ()
        self._end(word)
        return (
            If(place, tuple(branches), otherwise) if word == "if" else When(place, tuple(branches))
        )

    def _end(self, word: str) -> None:
        self.need("end")
        self.need(word)


__all__ = ["InputError", "Place", "parse", "unexpected"]
