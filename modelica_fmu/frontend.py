"""Front end: a Modelica file, parsed, type-checked, instantiated and flattened by rumoca, as plain
Python data.
"""

from __future__ import annotations

import bisect
import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError

Tree = dict[
    str, Any
]  # one node of rumoca's expression tree: {"Binary": {...}}, {"VarRef": {...}}, ...

PARSER = Path(__file__).with_name("parser.py")
# s of processor time that the parser may take, where the system can limit it; the gantry takes 1
LONGEST = 60
WAITED = 600.0  # s at most
VARIABILITY = ("Constant", "Parameter", "Discrete")


class Source:
    """The text of a Modelica file, to turn rumoca's character spans into line numbers."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.text = path.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise InputError(
                "no such Modelica file", file=path, hint="give the path with --model"
            ) from None
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(
                f"cannot be read as UTF-8 text ({error})", file=path, hint="give a Modelica file"
            ) from None
        self._lines = [0, *(i + 1 for i, c in enumerate(self.text.encode()) if c == 10)]

    def line(self, tree: Any) -> int | None:
        """Line of the first span found in `tree`, 1-based."""
        start = _first_span(tree)
        return None if start is None else bisect.bisect_right(self._lines, start)

    def refuse(
        self, message: str, tree: Any = None, hint: str = "rewrite it with supported Modelica"
    ) -> InputError:
        line = self.line(tree)
        where = f"{self.path}:{line}" if line else str(self.path)
        return InputError(message, file=where, hint=hint)


def _first_span(tree: Any) -> int | None:
    if isinstance(tree, dict):
        span = tree.get("span")
        if isinstance(span, dict) and "start" in span:
            return int(span["start"])
        tree = list(tree.values())
    if isinstance(tree, list):
        for child in tree:
            if isinstance(child, dict | list):
                found = _first_span(child)
                if found is not None:
                    return found
    return None


@dataclass(frozen=True)
class FlatVariable:
    """One flattened variable; attributes that are expressions stay trees until parameters are
    known.
    """

    name: str
    type: str  # Real, Integer, Boolean, String or the enumeration's name
    variability: str  # Constant, Parameter, Discrete, Continuous
    causality: str  # input, output, ""
    dims: tuple[int, ...]
    binding: Tree | None
    start: Tree | None
    fixed: Tree | None
    min: Tree | None
    max: Tree | None
    nominal: Tree | None
    unit: str | None
    description: str | None
    protected: bool
    final: bool
    tree: Tree  # the whole node, for spans


@dataclass(frozen=True)
class FlatModel:
    name: str
    description: str
    source: Source
    variables: dict[str, FlatVariable]
    equations: list[Tree]
    when_chains: list[Tree]
    asserts: list[Tree]
    functions: dict[str, Tree]
    enumerations: dict[str, tuple[tuple[str, str], ...]]
    literals: dict[str, int]  # "FrictionLaw.vdfm" (and longer forms) -> ordinal

    def scalars(self) -> Iterator[tuple[str, FlatVariable, tuple[int, ...]]]:
        """Every scalar: its FMI name ("A[2]"), its variable, its 1-based subscripts."""
        for variable in self.variables.values():
            for subscripts in subscripts_of(variable.dims):
                yield scalar_name(variable.name, subscripts), variable, subscripts


def scalar_name(name: str, subscripts: tuple[int, ...]) -> str:
    return f"{name}[{','.join(map(str, subscripts))}]" if subscripts else name


def subscripts_of(dims: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    if not dims:
        yield ()
        return
    for i in range(1, dims[0] + 1):
        for rest in subscripts_of(dims[1:]):
            yield (i, *rest)


REFUSED = {  # sections of the flat model that the back end does not take -> what to write instead
    "initial_equations": "an initial equation; give start values with fixed = true",
    "initial_structured_equations": "an initial for-equation; give start values with fixed = true",
    "algorithms": "an algorithm section; write equations or a function",
    "initial_algorithms": "an initial algorithm; give start values with fixed = true",
    "initial_assert_equations": "an initial assert; write it in the equation section",
}


CLASS_TOKEN = re.compile(
    r"\b(?:(?:model|block|class|package|function|record|connector)\s+(\w+)\b(?!\s*=)|end\s+(\w+)\s*;)"
)


def flatten(path: Path, class_name: str) -> FlatModel:
    """Parses `path` and flattens `class_name`.

    Raises InputError with file and line for whatever rumoca or this back end does not accept.
    """
    source = Source(path)
    parsed = _parsed(source, class_name)
    if "error" in parsed:
        raise _front_end_error(source, class_name, parsed["error"], parsed["line"])
    flat: Tree = parsed["flat"]
    for section, instead in REFUSED.items():
        if flat.get(section):
            raise source.refuse(
                f"not supported: {instead.split(';')[0]}",
                flat[section],
                hint=instead.split("; ")[1],
            )
    _refuse_lost_modifiers(source, class_name, flat)
    variables = {name: _variable(flat, name, tree) for name, tree in flat["variables"].items()}
    return FlatModel(
        name=class_name,
        description=_class_description(source, class_name) or flat.get("model_description") or "",
        source=source,
        variables=variables,
        equations=flat["equations"],
        when_chains=flat["when_chains"],
        asserts=flat["assert_equations"],
        functions=flat["functions"],
        enumerations=_enumerations(source, flat),
        literals=dict(flat["enum_literal_ordinals"]),
    )


def _parsed(source: Source, class_name: str) -> dict[str, Any]:
    """What `parser.py` prints. It sees the text alone: Modelica files beside this one are no part
    of it.
    """
    hint = "make its arrays smaller, its expressions shorter, or its components fewer"
    command = [sys.executable, "-P", str(PARSER), class_name, str(LONGEST)]
    slow = source.refuse(f"the parser takes longer than {LONGEST} s", hint=hint)
    try:
        done = subprocess.run(
            command, input=source.text.encode(), capture_output=True, timeout=WAITED, check=False
        )
    except subprocess.TimeoutExpired:
        raise slow from None
    if done.returncode != 0:
        name = (
            signal.Signals(-done.returncode).name
            if done.returncode < 0
            else f"exit code {done.returncode}"
        )
        if name == "SIGXCPU":
            raise slow
        said = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
        raise source.refuse(f"the parser gave up ({': '.join([name, *said])})", hint=hint)
    return dict(json.loads(done.stdout))


def _refuse_lost_modifiers(source: Source, class_name: str, flat: Tree) -> None:
    """In `extends Base(a(b(c = 1)))` rumoca 0.10.2 drops what Base itself says of a.b beside c:
    such a binding is neither Base's nor of the class' own text. Raises InputError at the modifier
    that is lost.
    """
    first, last = _extent(source, class_name)
    if "redeclare" in source.text[first:last]:  # another class brings bindings of its own
        return
    for base in re.findall(r"\bextends\s+([\w.]+)\s*\(", _code(source)[first:last]):
        scopes = class_name.split(".")
        for full in (".".join([*scopes[:i], base]) for i in reversed(range(len(scopes)))):
            inherited = _parsed(source, full).get("flat")
            if inherited is not None:
                break
        else:
            continue
        own = range(*(len(source.text[:place].encode()) for place in (first, last)))
        for name, tree in inherited["variables"].items():
            before, now = (
                _first_span(t["binding"]) for t in (tree, flat["variables"].get(name, tree))
            )
            if before is not None and before != now and now not in own:
                message = (
                    f"{class_name} loses the modifier of {name} in {base}: another one of "
                    f"that component is modified"
                )
                raise source.refuse(
                    message, tree["binding"], hint="repeat it in the extends clause, too"
                )
        _refuse_lost_modifiers(source, full, inherited)


def _extent(source: Source, class_name: str) -> tuple[int, int]:
    """Where the text of a class begins and ends; all of it where it is not found."""
    path, begin, inside = class_name.split("."), 0, list[str]()
    for token in CLASS_TOKEN.finditer(_code(source)):
        opened, closed = token.groups()
        if opened:
            inside.append(opened)
            begin = token.start() if inside == path else begin
        elif inside and inside[-1] == closed:
            if inside == path:
                return begin, token.start()
            inside.pop()
    return 0, len(source.text)


def _front_end_error(
    source: Source, class_name: str, error: str, syntax_line: int | None
) -> InputError:
    """rumoca's message without its frame, and the line it means."""
    message = " ".join(error.split("Related failures")[0].split())
    message = re.sub(r"^(\w+ failed: )?\S+ (failed in \w+|could not be compiled): ", "", message)
    position = re.search(r" ?\[[^\[\]]*:(\d+):\d+\]$", message)
    message = message[: position.start()] if position else message
    if "because resolve/parse failed" in message and _class_header(source, class_name) < 0:
        known = re.findall(
            r"^\s*(?:package|model|block|class)\s+(\w+)", _code(source), re.MULTILINE
        )
        return InputError(
            f"no class {class_name} in this file",
            file=source.path,
            hint=f"it holds {', '.join(known[:8]) or 'none'}",
        )
    line = int(position[1]) if position else syntax_line or _named_line(source, class_name, message)
    return InputError(
        message.split("; ")[0], file=f"{source.path}:{line}", hint="correct the Modelica text"
    )


def _named_line(source: Source, class_name: str, message: str) -> int:
    """rumoca gives no position for most other errors: where a name that it quotes stands first in
    the class, else in the file.
    """
    code, start = _code(source), max(_class_header(source, class_name), 0)
    for name in re.findall(r"['`]([A-Za-z_][\w.]*)['`]|(\w+) is not a state|\b(\w+)\(", message):
        pattern = re.compile(r"(?<![\w.])" + re.escape("".join(name)) + r"(?!\w)")
        if "`function" in message:
            pattern = re.compile(r"function\s+" + pattern.pattern)
        elif "is not a state" in message:
            pattern = re.compile(r"reinit\s*\(\s*" + pattern.pattern)
        if match := pattern.search(code, start) or pattern.search(code):
            return code.count("\n", 0, match.start()) + 1
    return code.count("\n", 0, start) + 1


def _class_header(source: Source, class_name: str) -> int:
    """Where the class begins in the text; -1: nowhere."""
    short = class_name.rsplit(".", 1)[-1]
    match = re.search(rf"\b(model|block|class|package)\s+{re.escape(short)}\b", _code(source))
    return match.start() if match else -1


def _code(source: Source) -> str:
    """The text with comments and strings blanked, line by line as it was."""
    return re.sub(
        r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/',
        lambda m: re.sub(r"[^\n]", " ", m.group()),
        source.text,
        flags=re.DOTALL,
    )


def _variable(flat: Tree, name: str, tree: Tree) -> FlatVariable:
    variability = tree["variability"]
    kind = next(iter(variability)) if isinstance(variability, dict) else str(variability)
    causality = tree["causality"]
    cause = next(iter(causality)) if isinstance(causality, dict) else str(causality)
    top_level = "." not in name
    return FlatVariable(
        name=name,
        type=flat["variable_type_names"][name],
        variability=kind if kind in VARIABILITY else "Continuous",
        causality=cause.lower() if cause in ("Input", "Output") and top_level else "",
        dims=tuple(int(d) for d in tree["dims"]),
        binding=tree["binding"],
        start=tree["start"],
        fixed=tree["fixed"],
        min=tree["min"],
        max=tree["max"],
        nominal=tree["nominal"],
        unit=tree["unit"],
        description=tree["description"],
        protected=bool(tree["is_protected"]),
        final=bool(flat["variable_final_flags"].get(name, False)),
        tree=tree,
    )


def _enumerations(source: Source, flat: Tree) -> dict[str, tuple[tuple[str, str], ...]]:
    """Literals in order, with the descriptions that the source text gives them."""
    found: dict[str, dict[int, str]] = {}
    for literal, ordinal in flat["enum_literal_ordinals"].items():
        parts = literal.split(".")
        if (
            len(parts) == 2
            and "'" not in literal
            and parts[0] not in ("StateSelect", "AssertionLevel")
        ):
            found.setdefault(parts[0], {})[int(ordinal)] = parts[1]
    result = {}
    for name, literals in found.items():
        items = [literals[i] for i in sorted(literals)]
        result[name] = tuple(
            (item, _literal_description(source.text, name, item)) for item in items
        )
    return result


def _literal_description(text: str, enumeration: str, literal: str) -> str:
    start = text.find(f"type {enumeration} = enumeration(")
    end = text.find(");", start)
    body = text[start:end]
    body = body[body.find("(") + 1 :]
    found = re.search(rf'\b{re.escape(literal)}\s*"([^"]*)"', body)
    return found.group(1) if found else ""


def _class_description(source: Source, class_name: str) -> str:
    """The string comment behind `model Name`, which rumoca does not hand on."""
    short = class_name.rsplit(".", 1)[-1]
    for line in source.text.splitlines():
        words = line.split()
        if (
            len(words) > 2
            and words[0] in ("model", "block", "class")
            and words[1] == short
            and '"' in line
        ):
            return line.split('"')[1]
    return ""
