"""C functions of a generated model for several instances side by side, as loops that compilers
vectorise: nothing in a loop branches. What calls a library stands in a loop of its own, and so does
what parameters alone switch on, which is left out where no lane needs it.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

__all__ = ["asserted_once", "in_lanes", "with_elementary"]

ELEMENTARY = re.compile(r"\b(exp|log|pow|sin|cos|tan|tanh)\(")  # those of elementary.h
CALLS = re.compile(r"\b(?!model_|vector_|fabs|sqrt)[a-z]\w*\(")  # no vector instruction
NAME = re.compile(r"\bw\d+\b")
HELD = re.compile(r"q->(?:time\b|(?:x|u|p|h|m|d|pre|fired|tick|late)\[\d+\])")
CONSTANT = re.compile(r"q->[ph]\[\d+\]")  # parameters, and what depends on them alone


@dataclass(frozen=True)
class _Statement:
    """`name` = `text` where all conditions hold, the outermost first; else 0."""

    name: str
    whole: bool  # a condition itself
    text: str
    conditions: tuple[str, ...]
    gate: tuple[str, ...]  # parameters without which nothing needs it

    @property
    def calls(self) -> bool:
        """A library's function."""
        return CALLS.search(self.text) is not None

    @property
    def read(self) -> set[str]:
        """Other statements' names."""
        return {n for text in (self.text, *self.conditions) for n in NAME.findall(text)}


def with_elementary(source: str) -> str:
    """A generated model.c with the elementary functions that lanes use, for the same bits."""
    return '#include "elementary.h"\n' + ELEMENTARY.sub(r"scalar_\1(", source)


def in_lanes(source: str, names: Sequence[str]) -> str:
    """C functions `lanes_NAME` that do what `model_NAME` of a generated model.c does, for LANES
    instances: what differs between them has one index more.
    """
    made = [_contradict(source)]
    for name in names:
        start = source.index(f"void model_{name}(")
        head, body = source[start : source.index("\n}\n", start)].split(" {\n", 1)
        arrays = "".join(f", Lane *restrict {r}" for r in re.findall(r"double \*(\w+)", head))
        statements, results = _read(ELEMENTARY.sub(r"vector_\1(", body).splitlines())
        lines = "\n".join(_loops(statements, results))
        made.append(
            f"APART void lanes_{name}(const LaneData *restrict q{arrays}) {{\n{lines}\n}}\n"
        )
    return "\n".join(made)


def asserted_once(source: str) -> bool:
    """Whether the assertions of a generated model.c hang on parameters alone."""
    start = source.index("void model_check(")
    read = source[start : source.index("\n}\n", start)].split(" {\n", 1)[1]
    return "q->" not in CONSTANT.sub("", read)


def _contradict(source: str) -> str:
    """Adds to `off` how many relations of each lane their operands z contradict; straight on, for
    a loop over relations would wait for each sum in turn.
    """
    (told,) = re.findall(r"model_inclusive\[\] = \{(.*)\};", source)
    inclusive = told.split(", ")
    terms = [
        f"odd += fabs((z[{i}][l] {'>=' if own == '1' else '>'} 0 ? 1.0 : 0.0) - q->m[{i}][l]);"
        for i, own in enumerate(inclusive)
    ]
    body = _over_lanes(["double odd = 0;", *terms, "off[l] += odd;"])
    lines = ["#if N_RELATIONS > 0", *body, "#endif"]
    head = "const LaneData *restrict q, const Lane *restrict z, double *restrict off"
    unused = "(void)q, (void)z, (void)off;"
    return f"static inline void contradict({head}) {{\n{unused}\n" + "\n".join(lines) + "\n}\n"


def _read(lines: Sequence[str]) -> tuple[list[_Statement], list[str]]:
    """Statements of a generated function, free of its branches, and what it puts into results.

    What is declared inside a branch is read nowhere else, so that its value where the branch is not
    taken is of no account; only a call is spared there.
    """
    statements: list[_Statement] = []
    results: list[str] = []
    wholes: dict[str, bool] = {}
    branches: list[tuple[str, ...]] = []  # conditions of each branch that a line lies in

    def note(name: str, text: str, inner: tuple[str, ...]) -> None:
        every = tuple(dict.fromkeys(c for own in branches for c in own))
        gate = tuple(c for c in every if CONSTANT.fullmatch(c))
        conditions = every if CALLS.search(text) else inner
        statements.append(_Statement(name, wholes[name], text, conditions, gate))

    for line in map(str.strip, lines):
        if begun := re.fullmatch(r"if \((.*)\) \{", line):
            branches.append(tuple(begun[1].split(" && ")))
        elif line == "}":
            branches.pop()
        elif declared := re.fullmatch(r"(int|double) (w\d+) = 0(?:\.0)?;", line):
            wholes[declared[2]] = declared[1] == "int"
        elif plain := re.fullmatch(r"const (int|double) (w\d+) = (.*);", line):
            wholes[plain[2]] = plain[1] == "int"
            note(plain[2], plain[3], ())
        elif chosen := re.fullmatch(r"(w\d+) = (.*);", line):
            note(chosen[1], chosen[2], branches[-1])
        elif not line.startswith("(void)"):
            results.append(line)
    return statements, results


def _loops(statements: Sequence[_Statement], results: Sequence[str]) -> list[str]:
    """Declarations of what several loops read, then the loops."""
    loops: list[list[_Statement]] = []
    for s in statements:
        before = loops[-1][-1] if loops else None
        if before is None or s.calls or before.calls or s.gate != before.gate:
            loops.append([])
        loops[-1].append(s)
    loop_of = {s.name: i for i, loop in enumerate(loops) for s in loop}
    gates = [set(loop[0].gate) for loop in loops] + [set()]  # the last reads for the results
    read = [(n, i) for i, loop in enumerate(loops) for s in loop for n in s.read]
    read += [(n, len(loops)) for r in results for n in NAME.findall(r)]
    shared = {n for n, i in read if loop_of[n] != i}
    beyond = {n for n, i in read if not gates[loop_of[n]] <= gates[i]}
    wholes = {s.name: s.whole for s in statements}
    lines = [f"{'Whole' if wholes[n] else 'Lane'} {n};" for n in sorted(shared)]
    for loop in loops:
        lines += _gated(loop, [line for s in loop for line in _assigned(s, shared)], beyond)
    return lines + _over_lanes([_put(r, shared) for r in results])


def _gated(loop: Sequence[_Statement], lines: Sequence[str], beyond: Collection[str]) -> list[str]:
    """A loop, where some lane's parameters ask for it; else what is read of it beyond is 0: by
    loops that parameters may ask for without it.
    """
    if not loop[0].gate:
        return _over_lanes(lines)
    asked = " & ".join(_true(_of_lane(c, ())) for c in loop[0].gate)
    zero = [f"memset({s.name}, 0, sizeof {s.name});" for s in loop if s.name in beyond]
    body = ["int64_t asked = 0;", *_over_lanes([f"asked += {asked};"]), "if (asked) {"]
    body += [*_indented(_over_lanes(lines)), *(["} else {", *_indented(zero)] if zero else []), "}"]
    return ["{", *_indented(body), "}"]


def _over_lanes(lines: Sequence[str]) -> list[str]:
    return ["for (int l = 0; l < LANES; l++) {", *_indented(lines), "}"]


def _indented(lines: Sequence[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _assigned(s: _Statement, shared: Collection[str]) -> list[str]:
    """What is no call is computed in any case, and chosen afterwards: where a choice holds what is
    computed, compilers make branches of it that they cannot take back.
    """
    text, kind = _of_lane(s.text, shared), "int64_t" if s.whole else "double"
    if both := re.fullmatch(r"(.*) (&&|\|\|) (.*)", text):
        text = f"{_true(both[1])} {both[2][0]} {_true(both[3])}"
    lines = []
    if s.conditions:
        if not s.calls:
            lines, text = [f"const {kind} {s.name}_any = {text};"], f"{s.name}_any"
        joint = " && " if s.calls else " & "
        text = f"({joint.join(_true(_of_lane(c, shared)) for c in s.conditions)}) ? ({text}) : 0"
    if s.name in shared:
        return [*lines, f"{s.name}[l] = {text};"]
    return [*lines, f"const {kind} {s.name} = {text};"]


def _put(result: str, shared: Collection[str]) -> str:
    target, value = result.split(" = ", 1)
    return f"{target}[l] = {_of_lane(value, shared)}"


def _of_lane(text: str, shared: Collection[str]) -> str:
    text = HELD.sub(lambda m: f"{m[0]}[l]", text)
    return NAME.sub(lambda m: f"{m[0]}[l]" if m[0] in shared else m[0], text)


def _true(text: str) -> str:
    return f"({text} != 0)"
