"""Equations of a Modelica file as text, and the file with a term added to some of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from modelica_fmu.modelica.grammar import parse
from modelica_fmu.modelica.lexer import TOKEN
from modelica_fmu.modelica.syntax import ClassDef, Component, Extends, Ref

__all__ = [
    "Addition",
    "Declared",
    "EquationText",
    "components_of",
    "declared_in",
    "equations_of",
    "with_additions",
    "with_outputs",
]

ClassPath = tuple[str, ...]
SECTIONS = ("algorithm", "public", "protected", "initial", "external", "annotation")
BLOCKS = ("if", "for", "when")


@dataclass(frozen=True)
class EquationText:
    """A plain equation of a class: `left = right`, by offsets into the file's text."""

    of_class: ClassPath
    number: int  # within its class, from 1
    left: str
    right: str
    start: int  # of the right-hand side
    end: int
    section: int  # of the keyword `equation` before it
    kind: str = ""  # declared type of the left-hand side, where that is one name of the class


@dataclass(frozen=True)
class Addition:
    """What is added to one equation."""

    declared: str  # elements of the class, whole lines
    term: str  # added to the right-hand side
    equations: str  # further equations of the class, whole lines
    elsewhere: tuple[tuple[int, str], ...] = ()  # further text, by offsets into the file's


@dataclass(frozen=True)
class Declared:
    """Where a component of a class may be given one more modifier."""

    at: int  # offset into the file's text
    alone: bool  # whether it has none yet

    def with_modifier(self, text: str) -> tuple[int, str]:
        """What is to be inserted where."""
        return self.at, f"({text})" if self.alone else f"{text}, "


@dataclass(frozen=True)
class _Word:
    kind: str
    text: str
    line: int
    at: int


def equations_of(model: Path) -> list[EquationText]:
    """Plain equations of all classes of a file, in its order. Those within loops, branches and
    `when` are left out. Raises InputError for what is no Modelica.
    """
    text = model.read_text(encoding="utf-8")
    words = _words(text)
    found: list[EquationText] = []
    for path, made in _classes(parse(text, model)[1], ()):
        inner = [e for e in made.elements if isinstance(e, ClassDef)]
        own = [
            w
            for w in words
            if made.place.line <= w.line <= made.end_line
            and not any(c.place.line <= w.line <= c.end_line for c in inner)
        ]
        kinds = {e.name: str(e.type) for e in made.elements if isinstance(e, Component)}
        found += [replace(e, kind=kinds.get(e.left, "")) for e in _of_class(path, own, text)]
    return sorted(found, key=lambda e: e.start)


def with_additions(text: str, additions: Mapping[EquationText, Addition]) -> str:
    """The file's text with the terms added."""
    pieces: list[tuple[int, str]] = []
    for equation, added in additions.items():
        pieces.append((equation.section, f"public\n{added.declared}\n  "))
        pieces.append((equation.start, "("))
        pieces.append((equation.end, f") + {added.term}"))
        pieces.append((_after(text, equation.end), f"\n{added.equations}"))
        pieces += added.elsewhere
    for at, piece in sorted(pieces, key=lambda p: -p[0]):
        text = text[:at] + piece + text[at:]
    return text


def with_outputs(text: str, equations: list[EquationText], outputs: Mapping[str, str]) -> str:
    """The file's text with one more real output for each name, equal to the variable beside it, in
    the class that has these equations.
    """
    declared = "".join(f"  output Real {name};\n" for name in outputs)
    named = "".join(f"\n  {name} = {variable};" for name, variable in outputs.items())
    section, end = equations[0].section, _after(text, equations[-1].end)
    return f"{text[:section]}public\n{declared}{text[section:end]}{named}{text[end:]}"


def components_of(model: Path, class_name: str) -> dict[str, list[ClassPath]]:
    """Component path -> classes of the file whose equations hold there (its own and its bases');
    "" is the class itself. Arrays of components, and classes of other files, are left out.
    """
    text = model.read_text(encoding="utf-8")
    known = dict(_classes(parse(text, model)[1], ()))
    found: dict[str, list[ClassPath]] = {}
    waiting = [("", tuple(class_name.split(".")))]
    while waiting:
        prefix, path = waiting.pop()
        if path not in known or path in found.get(prefix, []):
            continue
        found.setdefault(prefix, []).append(path)
        for element in known[path].elements:
            if isinstance(element, Extends):
                waiting.append((prefix, _resolved(element.base, path, known)))
            elif isinstance(element, Component) and not element.dims:
                name = f"{prefix}.{element.name}" if prefix else element.name
                waiting.append((name, _resolved(element.type, path, known)))
    return found


def declared_in(
    model: Path, components: Mapping[str, Collection[ClassPath]]
) -> dict[str, Declared]:
    """Where those components may be modified that a class declares one by one, by path.
    components: all of a class, as of `components_of`.
    """
    text = model.read_text(encoding="utf-8")
    known, words = dict(_classes(parse(text, model)[1], ())), _words(text)
    found: dict[str, Declared] = {}
    for path, classes in components.items():
        own = {c.rpartition(".")[2]: c for c in components if c and c.rpartition(".")[0] == path}
        for of_class in classes if own else ():
            made = _declarations(known[of_class], own, words)
            found |= {own[name]: place for name, place in made.items()}
    return found


def _declarations(
    made: ClassDef, names: Collection[str], words: Sequence[_Word]
) -> dict[str, Declared]:
    """Of a class's own components, by name."""
    own = {e.name for e in made.elements if isinstance(e, Component) and not e.dims}
    inside = (w for w in words if made.place.line <= w.line <= made.end_line)
    found: dict[str, Declared] = {}
    depth = 0
    for word, behind in pairwise(inside):
        if word.text == "equation":
            break
        depth += (word.text in "([{") - (word.text in ")]}")
        follows = behind.kind == "string" or behind.text in ("(", ";", ",")
        named = depth == 0 and word.text in own and follows
        if named and word.text in names and word.text not in found:
            alone = behind.text != "("
            at = word.at + len(word.text) if alone else behind.at + 1
            found[word.text] = Declared(at, alone)
    return found


def _resolved(name: Ref, at: ClassPath, known: Mapping[ClassPath, ClassDef]) -> ClassPath:
    """The class that a name means within another one; () if it is not in the file."""
    parts = tuple(str(name).split("."))
    for depth in range(len(at), -1, -1):
        if (*at[:depth], *parts) in known:
            return (*at[:depth], *parts)
    return ()


def _classes(made: list[ClassDef], path: ClassPath) -> list[tuple[ClassPath, ClassDef]]:
    found: list[tuple[ClassPath, ClassDef]] = []
    for c in made:
        own = (*path, c.name)
        inner = [e for e in c.elements if isinstance(e, ClassDef)]
        found += [(own, c), *_classes(inner, own)]
    return found


def _words(text: str) -> list[_Word]:
    """Tokens with their offsets; space and comments left out."""
    found: list[_Word] = []
    line = 1
    for match in TOKEN.finditer(text):
        kind, word = match.lastgroup or "", match.group()
        if kind not in ("space", "newline"):
            found.append(_Word(kind, word, line, match.start()))
        line += word.count("\n")
    return found


def _of_class(path: ClassPath, words: list[_Word], text: str) -> list[EquationText]:
    found: list[EquationText] = []
    i = 0
    while i < len(words):
        if words[i].text == "equation" and words[i - 1].text != "initial":
            section, i = words[i].at, i + 1
            while i < len(words) and words[i].text not in (*SECTIONS, "end", "equation"):
                end = _statement(words, i)
                equation = _plain(words[i:end], text)
                if equation is not None:
                    left, right, start, stop = equation
                    number = len(found) + 1
                    found.append(EquationText(path, number, left, right, start, stop, section))
                i = end + 1
        else:
            i += 1
    return found


def _statement(words: list[_Word], i: int) -> int:
    """Index of the semicolon that ends the statement from word i on."""
    depth, nested, equal = 0, 0, False
    first = True
    while i < len(words):
        word = words[i].text
        depth += (word in "([{") - (word in ")]}")
        if word == "end" and i + 1 < len(words) and words[i + 1].text in BLOCKS:
            nested, i = nested - 1, i + 1
        elif depth == 0 and first and word in BLOCKS:
            nested += 1
        elif word == ";" and depth == 0 and nested == 0:
            return i
        equal = (equal or word == "=") and word != ";"
        first = word in (";", "loop") or (word in ("then", "else") and not equal)
        i += 1
    return len(words) - 1


def _plain(words: list[_Word], text: str) -> tuple[str, str, int, int] | None:
    """Sides of an equation and the offsets of its right-hand side; None: it is none."""
    if not words or words[0].text in (*BLOCKS, "connect", "assert", "reinit", "terminate"):
        return None
    depth, equal, last = 0, None, len(words)
    for i, word in enumerate(words):
        depth += (word.text in "([{") - (word.text in ")]}")
        if depth == 0 and word.text == "=" and equal is None:
            equal = i
        if depth == 0 and (word.kind == "string" or word.text == "annotation"):
            last = i
            break
    if equal is None or equal + 1 >= last:
        return None
    start, tail = words[equal + 1].at, words[last - 1]
    end = tail.at + len(tail.text)
    return text[words[0].at : words[equal].at].strip(), text[start:end], start, end


def _after(text: str, end: int) -> int:
    """Offset behind the semicolon that ends an equation."""
    for match in TOKEN.finditer(text, end):
        if match.group() == ";":
            return match.end()
    return len(text)
