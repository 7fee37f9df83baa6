"""Modelica text → tokens (section 2 of the specification)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from modelica_fmu.errors import InputError
from modelica_fmu.modelica.syntax import Place

KEYWORDS = frozenset(
    [
        "algorithm",
        "and",
        "annotation",
        "block",
        "break",
        "class",
        "connect",
        "connector",
        "constant",
        "constrainedby",
        "der",
        "discrete",
        "each",
        "else",
        "elseif",
        "elsewhen",
        "encapsulated",
        "end",
        "enumeration",
        "equation",
        "expandable",
        "extends",
        "external",
        "false",
        "final",
        "flow",
        "for",
        "function",
        "if",
        "import",
        "impure",
        "in",
        "initial",
        "inner",
        "input",
        "loop",
        "model",
        "not",
        "operator",
        "or",
        "outer",
        "output",
        "package",
        "parameter",
        "partial",
        "protected",
        "public",
        "pure",
        "record",
        "redeclare",
        "replaceable",
        "return",
        "stream",
        "then",
        "true",
        "type",
        "when",
        "while",
        "within",
    ]
)
TOKEN = re.compile(
    r"""(?P<space>[ \t\r\f\ufeff]+|//[^\n]*|/\*.*?\*/)
      | (?P<newline>\n)
      | (?P<string>"(?:\\.|[^"\\])*")
      | (?P<name>[A-Za-z_]\w*|'(?:\\.|[^'\\])+')
      | (?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)
      | (?P<op>:=|==|<>|<=|>=|\.\+|\.-|\.\*|\./|\.\^|[-+*/^<>=()\[\]{},;:.])""",
    re.VERBOSE | re.DOTALL | re.ASCII,
)
ESCAPES = {"n": "\n", "t": "\t", "r": "\r", "a": "\a", "b": "\b", "f": "\f", "v": "\v"}


class Token(NamedTuple):
    kind: str  # name, keyword, number, string, op, end
    text: str
    line: int


def tokens(text: str, file: Path) -> list[Token]:
    """All tokens, and one of kind "end". Raises InputError at what is no token."""
    found: list[Token] = []
    line, at = 1, 0
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            raise unexpected(text[at], Place(file, line))
        kind, word = match.lastgroup or "", match.group()
        if kind == "newline":
            line += 1
        elif kind == "space":
            line += word.count("\n")
        else:
            found.append(
                Token("keyword" if kind == "name" and word in KEYWORDS else kind, word, line)
            )
            line += word.count("\n")
        at = match.end()
    found.append(Token("end", "end of input", line))
    return found


def unexpected(what: str, place: Place, wanted: str = "") -> InputError:
    got = f"unexpected {what}" if what == "end of input" else f"unexpected `{what[:40]}`"
    return InputError(
        f"{got}{', ' + wanted + ' is needed' if wanted else ''}",
        file=f"{place.file}:{place.line}",
        hint="correct the Modelica text",
    )


def unquoted(literal: str) -> str:
    """The text that a string literal stands for."""
    return re.sub(r"\\(.)", lambda m: ESCAPES.get(m[1], m[1]), literal[1:-1], flags=re.DOTALL)
