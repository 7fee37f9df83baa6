"""Mangled Modelica: each text becomes C that a compiler takes, or is refused in one line."""

from __future__ import annotations

import random
import re
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.soak.fuzz import Kinds, Read, with_bytes_changed
from modelica_fmu.compiler import compile_model
from modelica_fmu.modelica.lexer import KEYWORDS
from modelica_fmu.package import CSRC
from modelica_fmu.toolchain import find_compiler, host_platform

__all__ = ["MODELS", "SIZES"]

LONGEST = 180  # s for one text: what takes longer counts as a hang
SMALL = (
    """model M "A ball"
  parameter Real g(unit = "m/s2", min = 0) = 9.81 "Gravity";
  parameter Real e = 0.7;
  Real h(start = 1, fixed = true, unit = "m");
  Real v(start = 0, fixed = true);
equation
  der(h) = v;
  der(v) = -g;
  when h < 0 then
    reinit(v, -e*pre(v));
  end when;
  assert(h > -1, "fell through");
end M;
""",
    """type Law = enumeration(off "none", viscous "C v", coulomb);
function force "Force at a speed"
  input Real C[:];
  input Real v;
  input Law law;
  output Real f;
protected
  Real w[2];
algorithm
  f := 0;
  w := {v, abs(v)};
  for i in 1:size(C, 1) loop
    f := f + C[i]*w[1]^i;
  end for;
  if law == Law.coulomb then
    f := noEvent(if v > 0 then 1 else -1);
  elseif law == Law.off then
    f := 0;
  end if;
end force;
model M
  parameter Law law = Law.viscous;
  parameter Real C[2] = {4, 0.5};
  parameter Integer n = 2;
  input Real u(start = 0);
  output Real y;
  Real v(start = 0, fixed = true), s[2](each start = 0, each fixed = true);
equation
  2*der(v) = u - force(C, v, law);
  for i in 1:n loop
    der(s[i]) = if i == 1 then v else s[i - 1] - s[i];
  end for;
  y = delay(s[2], 0.1, 0.2) + sin(time);
end M;
""",
    """package P
  connector Pin
    Real p;
    flow Real q;
  end Pin;
  block Gain
    parameter Real k = 1;
    input Real u;
    output Real y = k*u;
  end Gain;
  partial model Base
    Real x(start = 0.5, fixed = true);
  end Base;
end P;
model M
  extends P.Base(x(start = 0.25));
  P.Gain a(k = 2), b[2](k = {1, 3});
  parameter Boolean on = true;
  final constant Real pi = 3.14159;
  discrete Real held(start = 0);
  Real p, q;
equation
  a.u = x;
  b[1].u = a.y;
  b[2].u = b[1].y + held;
  p + q = x; // a linear loop
  p - 2*q = if on and x > 0.1 or x < -pi then 1 else a.y;
  when sample(0, 0.01) then
    held = pre(held) + 0.1*x;
  end when;
  der(x) = -b[2].y/max(p^2 + 1, 0.5); /* decays */
end M;
""",
    """record Pair "what a function gives back"
  Real a = 1, b = 2;
end Pair;
partial function Curve
  input Real u; output Real y;
end Curve;
function line
  extends Curve;
  input Real k = 2;
algorithm
  y := k*u;
end line;
function sum_of "functions as arguments, rounds that end"
  input Curve f;
  input Integer n;
  output Pair p;
protected
  Integer i = 1;
  Real s = 0;
algorithm
  while i <= n loop
    s := s + f(i);
    if s > 100 then
      break;
    end if;
    i := i + 1;
  end while;
  p := Pair(a = s, b = s/n);
end sum_of;
model M
  parameter Integer n = 3;
  parameter Real k(fixed = false, start = 1);
  Pair p = sum_of(function line(k = 0.5), n);
  Real x[2], y[2], z(start = 1), w;
  Boolean on(start = false, fixed = true);
  Integer count(start = 0, fixed = true);
initial equation
  der(x[1]) = 0;
  x[2] = p.b;
  k*z = 2;
equation
  if time < 0.5 then
    y = {x[1], p.a};
  else
    y[1] = -x[1];
    y[2] = mod(x[2], 0.3);
  end if;
  der(x) = {1 - x[1]*k, semiLinear(x[1] - x[2], 1, 2)};
  z + homotopy(exp(z), z + 1) = 3 + y[1]; // a loop
  w = sum(i*y[i] for i in 1:2) + smooth(0, if z > 0 then z else 0);
  on = edge(on) or w > 0.1;
  when {change(on), initial()} then
    count = pre(count) + 1;
  elsewhen sample(0.1, 0.1) then
    count = integer(w);
  end when;
end M;
""",
)
WORDS = (
    "0",
    "1",
    "-1",
    "1e999",
    "1e-320",
    "99999999999",
    "0.5",
    "true",
    '"a"',
    "'x y'",
    "{}",
    "{1, 2}",
    "[1, 2; 3, 4]",
    "1:0",
    "1:100000000",
    "x",
    "v",
    "M",
    "P",
    "nothing",
    "time",
    "der",
    "pre",
    "der(x)",
    "if",
    "then",
    "else",
    "end if",
    "when",
    "end when",
    "for i in 1:3 loop",
    "end for",
    "while",
    "loop",
    "equation",
    "algorithm",
    "initial equation",
    "protected",
    "model",
    "end M",
    "function",
    "package",
    "extends",
    "connect(a, b)",
    "import",
    "within",
    "parameter",
    "constant",
    "discrete",
    "input",
    "output",
    "flow",
    "final",
    "each",
    "Real",
    "Integer",
    "Boolean",
    "String",
    "Complex",
    "(",
    ")",
    "[",
    "]",
    "{",
    "}",
    ",",
    ";",
    ":",
    ":=",
    "=",
    "==",
    "<>",
    "<",
    "+",
    "-",
    "*",
    "/",
    "^",
    ".*",
    ".",
    "and",
    "or",
    "not",
    "sin(",
    "sqrt(-1)",
    "1/0",
    "mod(v, 0)",
    "abs(",
    "size(",
    "sum(",
    "zeros(3)",
    "fill(1, 2)",
    "ones(1000)",
    "[1]",
    "[0]",
    "[-1]",
    "[3]",
    "[1.5]",
    "[:]",
    "reinit(x, 1)",
    "delay(v, -1)",
    "sample(0, 0)",
    "smooth(0, v)",
    "noEvent(v > 0)",
    'assert(false, "")',
    'terminate("")',
    "semiLinear(v, 1, 2)",
    "Modelica.Math.sin(v)",
    "String(v)",
    "integer(v)",
    "floor(v)",
    "div(1, 0)",
    "//",
    "/*",
    "*/",
    '"',
    "\\",
    "é",
    "\u0000",
    "annotation(x = 1)",
    'external "C"',
)
OPERATORS = ("+", "-", "*", "/", "^", "<", ">", "<=", ">=", "==", "<>", "and", "or", ".*", "./")
TYPES = (
    "Real",
    "Integer",
    "Boolean",
    "String",
    "Law",
    "P.Gain",
    "P.Pin",
    "parameter",
    "constant",
    "discrete",
    "input",
    "output",
    "M",
)
NUMBERS = ("0", "-1", "1", "2", "3", "1e300", "1e-320", "0.5", "7", "true", "1000")
EXPRESSIONS = (
    "(@ + @)",
    "(-@)",
    "abs(@)",
    "sqrt(@)",
    "sin(@)",
    "atan2(@, @)",
    "max(@, 1)",
    "max({@, 1})",
    "min(@)",
    "sum({@, 1})",
    "product({@})",
    "der(@)",
    "pre(@)",
    "edge(@ > 0)",
    "change(@)",
    "delay(@, 0.1)",
    "delay(@, @, 1)",
    "sample(@, 1)",
    "smooth(1, @)",
    "noEvent(@)",
    "semiLinear(@, 1, 2)",
    "initial()",
    "terminal()",
    "integer(@)",
    "floor(@)",
    "ceil(@)",
    "mod(@, 2)",
    "rem(@, 0)",
    "div(@, 2)",
    "sign(@)",
    "exp(@)",
    "log(@)",
    "log10(@)",
    "tanh(@)",
    "cross(@, @)",
    "(if @ > 0 then 1 else @)",
    "(if true then @ else 1)",
    "{@, @}",
    "{@ for i in 1:2}",
    "sum(@ for i in 1:2)",
    "size(@, 1)",
    "ndims(@)",
    "zeros(2)",
    "fill(@, 2)",
    "identity(2)",
    "transpose([@])",
    "[@, 1; 2, 3]",
    "@[1]",
    "@[2]",
    "@[1, 1]",
    "@[end]",
    "@[:]",
    "@.x",
    "a.@",
    "b[1].u",
    "b.u",
    "Law.coulomb",
    "Integer(Law.off)",
    "String(@)",
    "time",
    "(@ > 0)",
    "not @",
    "1:@",
    "force({1, 2}, @, Law.off)",
    "force(@)",
    "force(C = {@}, v = 1, law = Law.viscous)",
    "P.Gain(@)",
    "@()",
    "homogeneous(@)",
    "cardinality(@)",
    "inStream(@)",
    "actualStream(@)",
    "getInstanceName()",
    "spatialDistribution(@, @, 1, true)",
    '"text"',
    "1/0",
    "0/0",
)
NO_NAMES = KEYWORDS.union(TYPES, ["assert"])
TOKEN = re.compile(
    r'"[^"]*"|[A-Za-z_]\w*|\d+\.?\d*(?:[eE][-+]?\d+)?|:=|==|<>|<=|>=|\s+|.', re.DOTALL
)


def _tokens(rng: random.Random, text: str) -> bytes:
    """Tokens left out, doubled, changed for another word, swapped, or put elsewhere."""
    tokens = TOKEN.findall(text)
    real = [k for k, token in enumerate(tokens) if not token.isspace()]
    for _ in range(rng.choice([1, 1, 1, 2, 3, 6])):
        k, j = rng.choice(real), rng.choice(real)
        change = rng.randrange(6)
        if change == 0:
            tokens[k] = ""
        elif change == 1:
            tokens[k] += " " + tokens[k]
        elif change == 2:
            tokens[k], tokens[j] = tokens[j], tokens[k]
        elif change == 3:
            tokens[k] = tokens[j]
        elif change == 4:
            tokens[k] += " " + rng.choice(WORDS) + " "
        else:
            tokens[k] = rng.choice(WORDS)
    return "".join(tokens).encode()


def _meaning(rng: random.Random, text: str) -> bytes:
    """A name, number, operator or type changed for another of its kind, or for a whole expression:
    it still parses, mostly.
    """
    tokens = TOKEN.findall(text)
    groups = [
        [k for k, token in enumerate(tokens) if token in words] for words in (OPERATORS, TYPES)
    ]
    names = [k for k, t in enumerate(tokens) if t.isidentifier() and t not in NO_NAMES]
    numbers = [k for k, token in enumerate(tokens) if token[0].isdigit()]
    for _ in range(rng.choice([1, 1, 2, 3])):
        kind = rng.randrange(6)
        if kind == 0 and groups[0]:
            tokens[rng.choice(groups[0])] = rng.choice(OPERATORS)
        elif kind == 1 and groups[1]:
            tokens[rng.choice(groups[1])] = rng.choice(TYPES)
        elif kind == 2:
            tokens[rng.choice(names)] = tokens[rng.choice(names)]
        elif kind == 3:
            tokens[rng.choice(numbers)] = rng.choice(NUMBERS)
        else:
            k, whole = rng.choice(names + numbers), rng.choice(EXPRESSIONS)
            tokens[k] = whole.replace("@", tokens[k])
    return "".join(tokens).encode()


def _lines(rng: random.Random, text: str) -> bytes:
    """Lines left out, doubled or moved, also into another model."""
    lines = text.splitlines(keepends=True)
    for _ in range(rng.choice([1, 1, 2, 4])):
        k = rng.randrange(len(lines))
        other = rng.choice(SMALL).splitlines(keepends=True)
        change = rng.randrange(4)
        if change == 0 and len(lines) > 1:
            del lines[k]
        elif change == 1:
            lines.insert(rng.randrange(len(lines) + 1), lines[k])
        elif change == 2:
            lines.insert(rng.randrange(len(lines)), lines.pop(k))
        else:
            lines.insert(k, rng.choice(other))
    return "".join(lines).encode()


def _bytes(rng: random.Random, text: str) -> bytes:
    return with_bytes_changed(rng, text.encode())


def _large(rng: random.Random, text: str) -> bytes:
    """One expression, nesting, array or loop that is far too large, or only large."""
    n = 10 ** rng.randint(1, 5)
    x = rng.choice(["v", "x", "1"])
    return rng.choice(
        [
            text.replace("=", f"= {'(' * n}{x}{')' * n} +", 1),
            text.replace("end M;", f"  Real big = {' + '.join([x] * n)};\nend M;"),
            text.replace("end M;", f"  Real big = {'if time > 1 then 1 else ' * n}1;\nend M;"),
            text.replace(
                "equation",
                f"  Real big[{n * n}](each start = 0, each fixed = true);\nequation\n  "
                f"der(big) = -big;",
                1,
            ),
            text.replace(
                "equation", f"  parameter Real big[{n}] = {{{', '.join(['1'] * n)}}};\nequation", 1
            ),
            re.sub(r"\b1:", f"1:{n * n}*", text),
            re.sub(r"\b(n|e|g) = ", rf"\1 = {n}*", text),
            text.replace("end M;", "".join(f"  Real big{k} = {x};\n" for k in range(n)) + "end M;"),
        ]
    ).encode()


def _text(change: Callable[[random.Random, str], bytes]) -> Callable[[random.Random, Path], Read]:
    def draw(rng: random.Random, folder: Path) -> Read:
        path = folder / "m.mo"
        path.write_bytes(change(rng, rng.choice(SMALL)))
        return lambda: _compile(path)

    return draw


def _compile(path: Path) -> None:
    """To C, and that past a compiler's checks."""
    with _limit(LONGEST):
        compiled = compile_model(path, "M")
    for name, text in compiled.sources.items():
        path.with_name(name).write_text(text, encoding="utf-8")
    command = [
        *find_compiler(host_platform()).command,
        "-std=c11",
        "-fsyntax-only",
        f"-I{CSRC}",
        str(path.parent / "model.c"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = next(
            line.partition("error: ")[2] for line in done.stderr.splitlines() if "error: " in line
        )
        raise RuntimeError(f"the C compiler refuses it: {said}")


@contextmanager
def _limit(seconds: int) -> Iterator[None]:
    """TimeoutError after so much processor time of this process, where the system has
    such alarms.
    """
    if not hasattr(signal, "SIGPROF"):
        yield
        return

    def late(*_: object) -> None:
        raise TimeoutError(f"takes longer than {seconds} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


MODELS: Kinds = {
    "Modelica meaning": _text(_meaning),
    "Modelica tokens": _text(_tokens),
    "Modelica lines": _text(_lines),
    "Modelica bytes": _text(_bytes),
}
SIZES: Kinds = {"Modelica sizes": _text(_large)}
