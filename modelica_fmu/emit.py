"""SX expressions → C, written to be fast where models branch.

CasADi's own printer evaluates both sides of every conditional. Here a value that only one side
needs is computed inside that side's `if`, one that several conditionals need under the same
condition inside an `if` of its own ahead of them, and whatever depends on parameters alone is
hoisted: computed when a parameter changes, read from an array afterwards.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import casadi as ca

C_UNARY = {
    ca.OP_NEG: "-{0}",
    ca.OP_EXP: "exp({0})",
    ca.OP_LOG: "log({0})",
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_SIN: "sin({0})",
    ca.OP_COS: "cos({0})",
    ca.OP_TAN: "tan({0})",
    ca.OP_ASIN: "asin({0})",
    ca.OP_ACOS: "acos({0})",
    ca.OP_ATAN: "atan({0})",
    ca.OP_SINH: "sinh({0})",
    ca.OP_COSH: "cosh({0})",
    ca.OP_TANH: "tanh({0})",
    ca.OP_FLOOR: "floor({0})",
    ca.OP_CEIL: "ceil({0})",
    ca.OP_FABS: "fabs({0})",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_ASSIGN: "{0}",
    ca.OP_SIGN: "({0} > 0) - ({0} < 0)",
    ca.OP_LOG1P: "log1p({0})",
    ca.OP_EXPM1: "expm1({0})",
    ca.OP_ASINH: "asinh({0})",
    ca.OP_ACOSH: "acosh({0})",
    ca.OP_ATANH: "atanh({0})",
}
C_BINARY = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_POW: "pow({0}, {1})",
    ca.OP_CONSTPOW: "pow({0}, {1})",
    ca.OP_FMIN: "model_min({0}, {1})",
    ca.OP_FMAX: "model_max({0}, {1})",
    ca.OP_ATAN2: "atan2({0}, {1})",
    ca.OP_FMOD: "fmod({0}, {1})",
    ca.OP_HYPOT: "hypot({0}, {1})",
    ca.OP_COPYSIGN: "copysign({0}, {1})",
    ca.OP_REMAINDER: "remainder({0}, {1})",
}
C_LOGIC = {
    ca.OP_LT: "{0} < {1}",
    ca.OP_LE: "{0} <= {1}",
    ca.OP_EQ: "{0} == {1}",
    ca.OP_NE: "{0} != {1}",
    ca.OP_NOT: "!({0})",
    ca.OP_AND: "{0} && {1}",
    ca.OP_OR: "{0} || {1}",
}
CHEAP = (
    *C_LOGIC,
    ca.OP_NEG,
    ca.OP_ASSIGN,
    ca.OP_ADD,
    ca.OP_SUB,
    ca.OP_MUL,
    ca.OP_SQ,
    ca.OP_TWICE,
    ca.OP_FABS,
    ca.OP_FMIN,
    ca.OP_FMAX,
)
COST = dict.fromkeys(CHEAP, 1) | {
    ca.OP_DIV: 4,
    ca.OP_INV: 4,
    ca.OP_SQRT: 4,
}  # of an operation, in additions; 8 where it is not named
WORTH_A_BRANCH = 8
SLOT = re.compile(r"q->h\[(\d+)\]")
PART = 200  # parameter-only values that are computed in one C function


@dataclass
class Node:
    op: int
    args: tuple[int, ...] = ()
    text: str = ""  # of inputs and constants
    hoisted: bool = False  # depends on parameters alone
    guard: tuple[int, ...] | None = (
        None  # the conditionals, outermost first, inside which it is needed
    )
    needs: frozenset[int] = frozenset()  # conditions that hold wherever it is needed
    slot: str = ""  # of a hoisted value, once it is printed


@dataclass
class Hoist:
    """Parameter-only values of all functions of a model: a C expression for each slot, in an order
    in which each reads earlier ones only.

    `readers`: for each delayed value, the parameter-only conditions, all of them, around each
    function's readings of it.
    """

    slots: dict[str, int] = field(default_factory=dict)
    readers: dict[str, set[frozenset[str]]] = field(default_factory=dict)

    def slot(self, expression: str) -> str:
        return _stored(self.slots.setdefault(expression, len(self.slots)))

    def stored(self, functions: str) -> tuple[str, str, int]:
        """`model_prepare`, the functions, and how many values are stored: those that a function
        reads, then what one part of `model_prepare` reads of another. All else is local: of a table
        with 150 nodes the C compiler takes a fifth of the time (decision 0215).
        """
        part = {slot: slot // PART for slot in self.slots.values()}
        reads = {slot: _slots(expression) for expression, slot in self.slots.items()}
        told = _slots(functions)
        carried = {r for slot, own in reads.items() for r in own if part[r] != part[slot]} - told
        place = {slot: i for i, slot in enumerate([*sorted(told), *sorted(carried)])}
        lines: list[str] = []
        for expression, slot in self.slots.items():
            if slot % PART == 0:
                lines += ["}"] if lines else []
                lines.append(f"static void prepare_{part[slot]}(ModelData *q) {{")
            own = {r: f"h{r}" if part[r] == part[slot] else _stored(place[r]) for r in reads[slot]}
            lines.append(f"    const double h{slot} = {_renamed(expression, own)};")
            if slot in place:
                lines.append(f"    {_stored(place[slot])} = h{slot};")
        parts = [f"prepare_{k}" for k in sorted(set(part.values()))]
        lines += [*(["}"] if parts else []), *_calling(parts)]
        places = {slot: _stored(i) for slot, i in place.items()}
        return "\n".join(lines), _renamed(functions, places), len(place)


def _calling(parts: list[str]) -> list[str]:
    """`model_prepare`. It calls its parts by a table, lest a compiler makes them one again."""
    if not parts:
        return ["void model_prepare(ModelData *q) { (void)q; }", ""]
    return [
        f"static void (*const preparing[])(ModelData *) = {{{', '.join(parts)}}};",
        "void model_prepare(ModelData *q) {",
        f"    for (int i = 0; i < {len(parts)}; i++) preparing[i](q);",
        "}",
        "",
    ]


def _stored(place: int) -> str:
    return f"q->h[{place}]"


def _slots(text: str) -> set[int]:
    """That a text reads."""
    return {int(slot) for slot in SLOT.findall(text)}


def _renamed(text: str, names: dict[int, str]) -> str:
    """With names for its slots."""
    return SLOT.sub(lambda m: names[int(m[1])], text)


class Emitter:
    """Prints functions of named input groups.

    `groups`: name of the C array ("q->x", ...; a scalar where the vector has one element and the
    name ends in "time", "initial" or "path") → column of symbols. Symbols of the groups named in
    `constant_groups` change only with the parameters.
    """

    def __init__(
        self, groups: dict[str, ca.SX], constant_groups: tuple[str, ...], hoist: Hoist
    ) -> None:
        self.groups, self.constant_groups, self.hoist = groups, constant_groups, hoist

    def function(self, name: str, outputs: dict[str, ca.SX], arguments: str) -> str:
        """`static`-free C function `void name(arguments)` that fills the arrays named in
        `outputs`.
        """
        keys = list(self.groups)
        f = ca.Function(
            "f", [self.groups[k] for k in keys], ca.cse([ca.densify(v) for v in outputs.values()])
        )
        nodes, results = self._nodes(f, keys, list(outputs))
        body = self._body(nodes, results)
        return f"void {name}({arguments}) {{\n" + "\n".join(body) + "\n}\n"

    def _nodes(
        self, f: ca.Function, keys: list[str], out_names: list[str]
    ) -> tuple[list[Node], list[tuple[str, int]]]:
        nodes: list[Node] = []
        at: dict[int, int] = {}  # work slot -> node that last wrote it
        results: list[tuple[str, int]] = []
        for k in range(f.n_instructions()):
            op, ins, outs = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
            if op == ca.OP_OUTPUT:
                results.append((f"{out_names[outs[0]]}[{outs[1]}]", at[ins[0]]))
                continue
            if op == ca.OP_INPUT:
                key = keys[ins[0]]
                scalar = key.endswith(("->time", "->initial", "->path"))
                node = Node(
                    op,
                    text=key if scalar else f"{key}[{ins[1]}]",
                    hoisted=key in self.constant_groups,
                )
            elif op == ca.OP_CONST:
                node = Node(op, text=_number(f.instruction_constant(k)), hoisted=True)
            else:
                args = tuple(at[i] for i in ins)
                node = Node(op, args, hoisted=all(nodes[i].hoisted for i in args))
            at[outs[0]] = len(nodes)
            nodes.append(node)
        return nodes, results

    def _body(self, nodes: list[Node], results: list[tuple[str, int]]) -> list[str]:
        self._guards(nodes, results)
        self._note_readers(nodes)
        names: dict[int, str] = {}
        blocks: dict[tuple[int, ...], list[int]] = {}
        for i, node in enumerate(nodes):
            if node.guard is not None and not self._inline(nodes, i, names):
                blocks.setdefault(node.guard, []).append(i)
        lines: list[str] = []
        self._block((), nodes, blocks, names, lines, "    ")
        return lines + [f"    {target} = {names[i]};" for target, i in results]

    def _inline(self, nodes: list[Node], i: int, names: dict[int, str]) -> bool:
        """Inputs, constants and hoisted values need no statement."""
        node = nodes[i]
        if node.op in (ca.OP_INPUT, ca.OP_CONST):
            names[i] = node.text
        elif node.hoisted:
            names[i] = self._hoisted(nodes, i)
        else:
            return False
        return True

    def _hoisted(self, nodes: list[Node], i: int) -> str:
        node = nodes[i]
        if node.op in (ca.OP_INPUT, ca.OP_CONST):
            return node.text
        if not node.slot:
            args = [self._hoisted(nodes, a) for a in node.args]
            chosen = node.op == ca.OP_IF_ELSE_ZERO
            text = f"({args[0]} != 0) ? {args[1]} : 0.0" if chosen else _expression(node.op, args)
            node.slot = self.hoist.slot(text)
        return node.slot

    def _guards(self, nodes: list[Node], results: list[tuple[str, int]]) -> None:
        for _, i in results:
            nodes[i].guard = ()
        for i in range(len(nodes) - 1, -1, -1):
            node = nodes[i]
            if node.guard is None:
                continue
            for position, a in enumerate(node.args):
                lazy = node.op == ca.OP_IF_ELSE_ZERO and position == 1
                need = (*node.guard, i) if lazy else node.guard
                needs = node.needs | {node.args[0]} if lazy else node.needs
                known = nodes[a].guard
                nodes[a].needs = needs if known is None else nodes[a].needs & needs
                nodes[a].guard = need if known is None else _common(known, need)

    def _note_readers(self, nodes: list[Node]) -> None:
        for node in nodes:
            if node.guard is not None and node.text.startswith("q->late["):
                conditions = [nodes[i].args[0] for i in node.guard]
                known = frozenset(self._hoisted(nodes, c) for c in conditions if nodes[c].hoisted)
                self.hoist.readers.setdefault(node.text, set()).add(known)

    def _block(
        self,
        guard: tuple[int, ...],
        nodes: list[Node],
        blocks: dict[tuple[int, ...], list[int]],
        names: dict[int, str],
        lines: list[str],
        indent: str,
    ) -> None:
        inside = frozenset(nodes[i].args[0] for i in guard)
        ahead: list[int] = []  # statements in a row that are needed under the same conditions
        shared: tuple[str, ...] = ()
        for i in blocks.get(guard, []):
            node = nodes[i]
            branch = node.op == ca.OP_IF_ELSE_ZERO
            conditions = () if branch else _visible(nodes, i, node.needs - inside, names)
            if branch or conditions != shared:
                lines += _statements(nodes, ahead, shared, names, indent)
                ahead, shared = [], conditions
            names[i] = f"w{i}"
            if not branch:
                ahead.append(i)
                continue
            inner: list[str] = []
            self._block((*guard, i), nodes, blocks, names, inner, indent + "    ")
            condition, value = (names[a] for a in node.args)
            if not inner:
                lines.append(f"{indent}const double w{i} = ({condition}) ? {value} : 0.0;")
                continue
            lines += [f"{indent}double w{i} = 0.0;", f"{indent}if ({condition}) {{", *inner]
            lines += [f"{indent}    w{i} = {value};", f"{indent}}}"]
        lines += _statements(nodes, ahead, shared, names, indent)


def _visible(
    nodes: list[Node], i: int, needs: frozenset[int], names: dict[int, str]
) -> tuple[str, ...]:
    """The conditions among `needs` that node i can be put behind: already computed, and in its own
    scope.
    """
    guard = nodes[i].guard or ()

    def visible(c: int) -> bool:
        inlined = nodes[c].hoisted or nodes[c].op in (ca.OP_INPUT, ca.OP_CONST)
        return c in names and (inlined or nodes[c].guard == guard[: len(nodes[c].guard or ())])

    return tuple(names[c] for c in sorted(needs) if visible(c))


def _statements(
    nodes: list[Node],
    row: list[int],
    conditions: tuple[str, ...],
    names: dict[int, str],
    indent: str,
) -> list[str]:
    """Statements in a row, inside an `if` where that spares more than the branch costs."""
    kinds = {i: "int" if nodes[i].op in C_LOGIC else "double" for i in row}
    texts = {i: _expression(nodes[i].op, [names[a] for a in nodes[i].args]) for i in row}
    if not conditions or sum(COST.get(nodes[i].op, 8) for i in row) < WORTH_A_BRANCH:
        return [f"{indent}const {kinds[i]} w{i} = {texts[i]};" for i in row]
    declared = [f"{indent}{kinds[i]} w{i} = 0;" for i in row]
    return [
        *declared,
        f"{indent}if ({' && '.join(conditions)}) {{",
        *(f"{indent}    w{i} = {texts[i]};" for i in row),
        f"{indent}}}",
    ]


def _common(a: tuple[int, ...], b: tuple[int, ...]) -> tuple[int, ...]:
    n = 0
    while n < len(a) and n < len(b) and a[n] == b[n]:
        n += 1
    return a[:n]


def _expression(op: int, args: list[str]) -> str:
    for table in (C_UNARY, C_BINARY, C_LOGIC):
        if op in table:
            return table[op].format(*args)
    raise NotImplementedError(f"CasADi operation {op} has no C form")


ENDLESS = {"inf": "HUGE_VAL", "-inf": "(-HUGE_VAL)", "nan": "NAN"}


def _number(value: float) -> str:
    text = repr(float(value))
    if text in ENDLESS:
        return ENDLESS[text]
    text = text if any(c in text for c in ".en") else text + ".0"
    return f"({text})" if text.startswith("-") else text
