"""Pieces of models, each in words of Modelica and as functions; FEATURES by name."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import brentq

from benchmarks.differential.model import (
    Crossing,
    Evaluate,
    Expr,
    Model,
    Tick,
    Values,
    drawn,
    literal,
)


def item(vector: Callable[[Values], np.ndarray], i: int) -> Evaluate:
    return lambda values: float(vector(values)[i])


def algebraic(m: Model) -> None:
    y, e = m.name("y"), drawn(m, jumps=True)
    m.declarations.append(f"Real {y};")
    m.equations.append(f"{y} = {e.text};" if m.rng.random() < 0.7 else f"0 = {e.text} - {y};")
    m.define(y, e.value)
    m.show(y, e.jumps)


def state(m: Model) -> None:
    x, e, start, decay = m.name("x"), drawn(m), m.number(), m.number(0.2, 3)
    m.declarations.append(f"Real {x}(start = {start!r}, fixed = true);")
    m.equations.append(f"der({x}) = tanh({e.text}) - {decay!r}*{x};")
    m.state(x, start, lambda v: math.tanh(e.value(v)) - decay * v[x])


def second_order(m: Model) -> None:
    x, e, start, w = m.name("x"), drawn(m), m.number(), m.number(1, 5)
    m.declarations += [
        f"Real {x}(start = {start!r}, fixed = true);",
        f"Real {x}v(start = 0, fixed = true);",
    ]
    m.equations += [f"{x}v = der({x});", f"der({x}v) + 0.4*{x}v + {w!r}*{x} = tanh({e.text});"]
    m.state(x, start, lambda v: v[f"{x}v"])
    m.state(f"{x}v", 0.0, lambda v: math.tanh(e.value(v)) - 0.4 * v[f"{x}v"] - w * v[x])


def parameters(m: Model) -> None:
    n, a, b = m.rng.randint(1, 4), m.number(), m.number(0.1, 2)
    p, q, r, i = (m.name(s) for s in "pqri")
    m.declarations += [
        f"parameter Real {r} = {q} + {p}^2/{i};",
        f"parameter Integer {i} = {n};",
        f"parameter Real {p} = {a!r};",
        f"parameter Real {q}(min = 0) = {b!r}*{i};",
    ]
    m.parameter(i, n)
    m.parameter(p, a)
    m.parameter(q, b * n)
    m.parameter(r, b * n + a**2 / n)


def arrays(m: Model) -> None:
    n, a = m.rng.randint(2, 4), [m.number() for _ in range(4)]
    e, v, s, d, w = drawn(m, 2, True), m.name("v"), m.name("s"), m.name("d"), m.name("w")
    k = m.rng.randint(1, n)
    m.declarations += [
        f"Real {v}[{n}];",
        f"Real {s}, {d}, {w};",
        f"parameter Real {v}c[:] = {{{', '.join(map(repr, a[:n]))}}};",
    ]
    m.equations += [
        f"for i in 1:size({v}, 1) loop\n    {v}[i] = {v}c[i]*{e.text} + i;\n  end for;",
        f"{s} = sum({v}) + sum({v}c[i]*i^2 for i in 1:{n}) - product({v}c);",
        f"{d} = {v}*{v}c + max({v}c) - min({{{v}[j] for j in 1:{n}}}) + {v}[end]/2;",
        f"{w} = sum(transpose([{v}])*{{{v}c[i] + 1 for i in 1:{n}}}) - {v}[{k}:end]*{v}c[{k}:{n}];",
    ]
    c = np.array(a[:n])

    def vector(values: Values) -> np.ndarray:
        return c * e.value(values) + np.arange(1, n + 1)

    for i in range(n):
        m.define(f"{v}[{i + 1}]", item(vector, i))
        m.show(f"{v}[{i + 1}]", e.jumps)
    squares = float(np.sum(c * np.arange(1, n + 1) ** 2))
    m.define(s, lambda u: float(vector(u).sum() + squares - c.prod()))
    m.define(d, lambda u: float(vector(u) @ c + c.max() - vector(u).min() + vector(u)[-1] / 2))
    m.define(w, lambda u: float(vector(u) @ (c + 1) - vector(u)[k - 1 :] @ c[k - 1 :]))
    for name in (s, d, w):
        m.show(name, e.jumps)


def matrices(m: Model) -> None:
    a = np.array([[m.number() for _ in range(3)] for _ in range(2)])
    e, f, y, z = drawn(m, 2), drawn(m, 2), m.name("y"), m.name("z")
    rows = "; ".join(", ".join(map(repr, row)) for row in a.tolist())
    m.declarations += [
        f"parameter Real {y}A[2, 3] = [{rows}];",
        f"Real {y}[2];",
        f"Real {z}[3];",
        f"Real {z}s;",
    ]
    m.equations += [
        f"{y} = {y}A*{{{e.text}, {f.text}, 1}};",
        f"{z} = transpose({y}A)*{y} + cross({{1, 2, {e.text}}}, {y}A[1, :]);",
        f"{z}s = {y}*{y}A[:, 2] + sum(identity(2)*{y}A) + sum({y}A.*{y}A) + ndims({y}A);",
    ]

    def first(v: Values) -> np.ndarray:
        return a @ np.array([e.value(v), f.value(v), 1.0])

    def second(v: Values) -> np.ndarray:
        return a.T @ first(v) + np.cross([1, 2, e.value(v)], a[0])

    for name, size, function in ((y, 2, first), (z, 3, second)):
        for i in range(size):
            m.define(f"{name}[{i + 1}]", item(function, i))
            m.show(f"{name}[{i + 1}]")
    m.define(f"{z}s", lambda v: float(first(v) @ a[:, 1] + a.sum() + (a * a).sum() + 2))
    m.show(f"{z}s")


def linear_loop(m: Model) -> None:
    n = m.rng.randint(2, 4)
    a = np.array([[m.number(-1, 1) for _ in range(n)] for _ in range(n)]) + (n + 1) * np.eye(n)
    e, z = [drawn(m, 2, True) for _ in range(n)], m.name("z")
    m.declarations.append(f"Real {z}[{n}];")
    if m.rng.random() < 0.5:
        rows = "; ".join(", ".join(map(repr, row)) for row in a.tolist())
        m.equations.append(f"[{rows}]*{z} = {{{', '.join(x.text for x in e)}}};")
    else:
        for i in range(n):
            terms = " + ".join(f"({k!r})*{z}[{j + 1}]" for j, k in enumerate(a[i].tolist()))
            m.equations.append(f"{e[i].text} = {terms};")

    def put(v: Values) -> None:
        found = np.linalg.solve(a, [x.value(v) for x in e])
        v.update({f"{z}[{i + 1}]": float(found[i]) for i in range(n)})

    m.algebra.append(put)
    for i in range(n):
        m.show(f"{z}[{i + 1}]", any(x.jumps for x in e))


def nonlinear_loop(m: Model) -> None:
    e, z, c = drawn(m, 2, True), m.name("z"), m.number(0.1, 0.8)
    m.declarations.append(f"Real {z}, {z}b;")
    m.equations += [f"{z} + {c!r}*tanh({z}b) = tanh({e.text});", f"{z}b = {z} + {z}^3;"]

    def root(v: Values) -> float:
        target = math.tanh(e.value(v))
        return float(brentq(lambda s: s + c * math.tanh(s + s**3) - target, -3, 3, xtol=1e-14))

    m.define(z, root)
    m.define(f"{z}b", lambda v: v[z] + v[z] ** 3)
    m.show(z, e.jumps)
    m.show(f"{z}b", e.jumps)


def if_equation(m: Model) -> None:
    a, b, c = (drawn(m, 2, True) for _ in range(3))
    y, z, at, flag = m.name("y"), m.name("z"), m.number(0.3, 1.7), m.name("flag")
    on = m.rng.random() < 0.5
    m.declarations += [f"Real {y}, {z};", f"parameter Boolean {flag} = {str(on).lower()};"]
    m.equations += [
        f"if time < {at!r} then\n    {y} = {a.text};\n    {z} = {b.text} + {y};\n"
        f"  elseif {flag} then\n    {z} = {c.text};\n    {y} = {z}/2;\n"
        f"  else\n    {y} + {z} = {c.text};\n    {y} - {z} = {a.text};\n  end if;"
    ]

    def put(v: Values) -> None:
        if v["time"] < at:
            v[y] = a.value(v)
            v[z] = b.value(v) + v[y]
        elif on:
            v[z] = c.value(v)
            v[y] = v[z] / 2
        else:
            v[y], v[z] = (c.value(v) + a.value(v)) / 2, (c.value(v) - a.value(v)) / 2

    m.algebra.append(put)
    jumps = a.jumps or b.jumps or c.jumps
    m.show(y, jumps)
    m.show(z, jumps)


def algorithm(m: Model) -> None:
    e, f, y, n = drawn(m, 2, True), drawn(m, 2, True), m.name("y"), m.rng.randint(2, 5)
    c = m.number()
    m.declarations += [f"Real {y}, {y}b;", f"Integer {y}n;"]
    m.algorithms.append(
        f"  {y} := 0;\n  {y}n := 0;\n  {y}b := {f.text};\n"
        f"  for i in 1:{n} loop\n    if mod(i, 2) == 0 then\n      {y} := {y} + {e.text}/i;\n"
        f"    elseif i > 3 then\n      {y} := {y} - ({c!r});\n"
        f"    else\n      {y} := {y}*0.5 + {y}b;\n"
        f"    end if;\n  end for;\n"
        f"  while {y}n < {n} loop\n    {y}n := {y}n + 2;\n  end while;\n"
        f"  {y}b := {y}b + {y}n;"
    )

    def put(v: Values) -> None:
        total, other = 0.0, f.value(v)
        for i in range(1, n + 1):
            if i % 2 == 0:
                total += e.value(v) / i
            elif i > 3:
                total -= c
            else:
                total = total * 0.5 + other
        count = 0
        while count < n:
            count += 2
        v[y], v[f"{y}n"], v[f"{y}b"] = total, count, other + count

    m.algebra.append(put)
    jumps = e.jumps or f.jumps
    m.show(y, jumps)
    m.show(f"{y}b", jumps)
    m.show(f"{y}n")


def function(m: Model) -> None:
    f, y, c, d = m.name("f"), m.name("y"), m.number(), m.number(0.1, 1)
    e, g = drawn(m, 2, True), drawn(m, 2)
    m.classes.append(
        f'function {f} "A polynomial and a count"\n'
        f"  input Real u;\n  input Real C[:] = {{1, {c!r}}};\n"
        f"  input Integer power = 2;\n  output Real sum;\n  output Real last = {d!r};\nprotected\n"
        f"  Real w[size(C, 1)];\n  Integer n = 0;\nalgorithm\n  sum := 0;\n"
        f"  for i in 1:size(C, 1) loop\n    w[i] := C[i]*u^i;\n    sum := sum + w[i];\n"
        f"    if w[i] > {d!r} then\n      last := last + 1;\n"
        f"      break;\n    end if;\n  end for;\n"
        f"  while n < power loop\n    n := n + 1;\n    sum := sum/2;\n  end while;\nend {f};"
    )
    m.declarations += [f"Real {y}, {y}b, {y}c;"]
    m.equations += [
        f"({y}, {y}b) = {f}(tanh({e.text}), {{0.5, {c!r}, -1}}, power = 1);",
        f"{y}c = {f}(C = {{1, {g.text}}}, u = sin({e.text})) + {f}(0.25);",
    ]

    def called(u: float, coefficients: list[float], power: int = 2) -> tuple[float, float]:
        total, last = 0.0, d
        for i, k in enumerate(coefficients):
            total += k * u ** (i + 1)
            if k * u ** (i + 1) > d:
                last += 1
                break
        return total / 2**power, last

    m.define(y, lambda v: called(math.tanh(e.value(v)), [0.5, c, -1], 1)[0])
    m.define(f"{y}b", lambda v: called(math.tanh(e.value(v)), [0.5, c, -1], 1)[1])
    m.define(
        f"{y}c",
        lambda v: called(math.sin(e.value(v)), [1, g.value(v)])[0] + called(0.25, [1, c])[0],
    )
    for name in (y, f"{y}b", f"{y}c"):
        m.show(name, True)


def record(m: Model) -> None:
    r, f, y, b = m.name("R"), m.name("f"), m.name("y"), m.number()
    e, g = drawn(m, 2, True), drawn(m, 2, True)
    m.classes += [
        f"record {r}\n  Real re;\n  Real im[2];\n  Integer k;\nend {r};",
        f"function {f}\n  input {r} p;\n  input Real x;\n  output {r} q;\nalgorithm\n"
        f"  q := {r}(re = p.re*x, im = {{p.im[2], p.im[1] + x}}, k = p.k + 1);\nend {f};",
    ]
    m.declarations += [
        f"{r} {y}, {y}p(re = {e.text}, im = {{{y}q.re, {y}q.im[2]}}, k = 2);",
        f"parameter {r} {y}q(re = {b!r}, im = {{1, 2}}, k = 3);",
    ]
    m.equations.append(f"{y} = {f}({y}p, {g.text});")
    m.define(f"{y}.re", lambda v: e.value(v) * g.value(v))
    m.define(f"{y}.im[1]", lambda v: 2.0)
    m.define(f"{y}.im[2]", lambda v: b + g.value(v))
    m.define(f"{y}.k", lambda v: 3.0)
    for name in (f"{y}.re", f"{y}.im[1]", f"{y}.im[2]", f"{y}.k"):
        m.show(name, e.jumps or g.jumps)


def components(m: Model) -> None:
    """Blocks with modifiers, extends, arrays of them, a replaceable one, a conditional one."""
    p, c, k = m.name("P"), m.name("c"), [m.number() for _ in range(4)]
    e, other, shown = drawn(m, 2, True), m.rng.random() < 0.5, m.rng.random() < 0.5
    m.classes.append(
        f"package {p}\n  constant Real half = 0.5;\n"
        f"  partial block Base\n    input Real u;\n    output Real y;\n    parameter Real k = 1;\n"
        f"  end Base;\n"
        f"  block Gain\n    extends Base;\n  equation\n    y = k*u;\n  end Gain;\n"
        f"  block Shift\n    extends Base(k = 2);\n    parameter Real b = half;\n  equation\n"
        f"    y = k + u + b;\n  end Shift;\n"
        f"  model Both\n    replaceable block First = Gain constrainedby Base;\n"
        f"    parameter Boolean on = false;\n    First a(k = {k[0]!r});\n"
        f"    Shift s[2](b = {{{k[1]!r}, {k[2]!r}}});\n"
        f"    Gain extra(u = 1) if on;\n    input Real u;\n"
        f"    output Real y = s[2].y;\n  equation\n"
        f"    a.u = u;\n    s[1].u = a.y;\n    s[2].u = s[1].y;\n  end Both;\nend {p};"
    )
    redeclared = f"redeclare block First = {p}.Shift, " if other else ""
    m.declarations.append(
        f"{p}.Both {c}({redeclared}s(each k = {k[3]!r}), on = {str(shown).lower()}, u = {e.text});"
    )

    def value(v: Values) -> float:
        first = k[0] + e.value(v) + 0.5 if other else k[0] * e.value(v)
        return k[3] + (k[3] + first + k[1]) + k[2]

    m.define(f"{c}.y", value)
    m.show(f"{c}.y", e.jumps)


def circuit(m: Model) -> None:
    """A ladder of resistors between connectors with flow, solved by its nodes."""
    p, c, n = m.name("P"), m.name("c"), m.rng.randint(2, 4)
    r, e = [m.number(0.5, 3) for _ in range(2 * n)], drawn(m, 2)
    m.classes.append(
        f"package {p}\n  connector Pin\n    Real v;\n    flow Real i;\n  end Pin;\n"
        f"  model Two\n    Pin p, n;\n    Real v, i;\n"
        f"  equation\n    v = p.v - n.v;\n    i = p.i;\n"
        f"    p.i + n.i = 0;\n  end Two;\n"
        f"  model R\n    extends Two;\n    parameter Real R;\n  equation\n    v = R*i;\n  end R;\n"
        f"  model Source\n    extends Two;\n    input Real e;\n"
        f"  equation\n    v = e;\n  end Source;\n"
        f"  model Ground\n    Pin p;\n  equation\n    p.v = 0;\n  end Ground;\nend {p};"
    )
    m.declarations += [
        f"{p}.R {c}a[{n}](R = {{{', '.join(map(repr, r[:n]))}}});",
        f"{p}.R {c}b[{n}](R = {{{', '.join(map(repr, r[n:]))}}});",
        f"{p}.Source {c}s(e = {e.text});",
        f"{p}.Ground {c}g;",
    ]
    m.equations += [f"connect({c}s.n, {c}g.p);", f"connect({c}s.p, {c}a[1].p);"]
    m.equations.append(
        f"for i in 1:{n - 1} loop\n    connect({c}a[i].n, {c}a[i + 1].p);\n  end for;"
    )
    m.equations.append(
        f"for i in 1:{n} loop\n    connect({c}a[i].n, {c}b[i].p);\n"
        f"    connect({c}b[i].n, {c}g.p);\n  end for;"
    )
    g = np.zeros((n, n))
    for i in range(n):
        g[i, i] += 1 / r[i] + 1 / r[n + i]
        if i + 1 < n:
            g[i, i] += 1 / r[i + 1]
            g[i, i + 1] = g[i + 1, i] = -1 / r[i + 1]
    right = np.zeros(n)
    right[0] = 1 / r[0]
    node = np.linalg.solve(g, right)

    def potentials(v: Values) -> np.ndarray:
        return node * e.value(v)

    for i in range(n):
        m.define(f"{c}b[{i + 1}].v", item(potentials, i))
        m.show(f"{c}b[{i + 1}].v")
    m.define(f"{c}s.i", lambda v: -(1 - float(node[0])) / r[0] * e.value(v))
    m.show(f"{c}s.i")


def sampled(m: Model) -> None:
    e, d = drawn(m, 2, True), m.name("d")
    first, interval = m.number(0.01, 0.2) + 1.7e-4 * m.count, m.number(0.08, 0.4) + 1e-5 * m.count
    c = m.number(-0.9, 0.9)
    m.declarations += [
        f"discrete Real {d}(start = 1, fixed = true);",
        f"Integer {d}n(start = 0, fixed = true);",
        f"Real {d}y;",
    ]
    m.equations += [
        f"when sample({first!r}, {interval!r}) then\n    {d} = {c!r}*pre({d}) + tanh({e.text});\n"
        f"    {d}n = if {d} > pre({d}) then pre({d}n) + 1 else pre({d}n);\n  end when;",
        f"{d}y = {d} + {d}n/2;",
    ]
    m.discretes |= {d: 1.0, f"{d}n": 0.0}

    def action(v: Values) -> Values:
        new = c * v[d] + math.tanh(e.value(v))
        return {d: new, f"{d}n": v[f"{d}n"] + (new > v[d])}

    m.ticks.append(Tick(first, interval, action))
    m.define(f"{d}y", lambda v: v[d] + v[f"{d}n"] / 2)
    m.show(d)
    m.show(f"{d}n")
    m.show(f"{d}y")


def once(m: Model) -> None:
    """elsewhen, edge and change, at instants that are known."""
    d, at = m.name("d"), sorted(m.number(0.1, 1.9) + 1.3e-4 * m.count for _ in range(2))
    e = drawn(m, 2)
    m.declarations += [
        f"discrete Real {d}(start = 0, fixed = true);",
        f"Boolean {d}on = time > {at[0]!r} and time < {at[1]!r};",
        f"Integer {d}c(start = 0, fixed = true);",
    ]
    m.equations += [
        f"when time >= {at[1]!r} then\n    {d} = pre({d}) + 10;\n"
        f"  elsewhen time >= {at[0]!r} then\n    {d} = {e.text};\n  end when;",
        f"when change({d}on) then\n"
        f"    {d}c = pre({d}c) + (if edge({d}on) then 1 else 5);\n  end when;",
    ]
    m.discretes |= {d: 0.0, f"{d}c": 0.0}
    never = math.inf
    m.ticks.append(Tick(at[0], never, lambda v: {d: e.value(v), f"{d}c": v[f"{d}c"] + 1}))
    m.ticks.append(Tick(at[1], never, lambda v: {d: v[d] + 10, f"{d}c": v[f"{d}c"] + 5}))
    m.show(d)
    m.show(f"{d}c")


def sawtooth(m: Model) -> None:
    """A state event with reinit."""
    s, e, top = m.name("s"), drawn(m, 2), m.number(0.4, 1.5)
    m.declarations += [
        f"Real {s}(start = 0, fixed = true);",
        f"Integer {s}n(start = 0, fixed = true);",
    ]
    m.equations += [
        f"der({s}) = 1.5 + tanh({e.text});",
        f"when {s} > {top!r} then\n    reinit({s}, -0.1 - 0.2*mod(pre({s}n), 3));\n"
        f"    {s}n = pre({s}n) + 1;\n  end when;",
    ]
    m.discretes[f"{s}n"] = 0.0

    def action(v: Values) -> Values:
        return {s: -0.1 - 0.2 * (v[f"{s}n"] % 3), f"{s}n": v[f"{s}n"] + 1}

    m.crossings.append(Crossing(lambda v: v[s] - top, action))
    m.state(s, 0.0, lambda v: 1.5 + math.tanh(e.value(v)))
    m.show(f"{s}n")


def coupled(m: Model) -> None:
    """Two inertias, geared rigidly: one of the states goes."""
    w, e, j = m.name("w"), drawn(m, 2), [m.number(0.3, 2) for _ in range(2)]
    ratio, start = m.number(0.5, 3), m.number()
    m.declarations += [
        f"Real {w}a(start = {start!r}, fixed = true);",
        f"Real {w}b, {w}t;",
    ]
    m.equations += [
        f"{j[0]!r}*der({w}a) = tanh({e.text}) - {ratio!r}*{w}t;",
        f"{j[1]!r}*der({w}b) = {w}t - 0.3*{w}b;",
        f"{w}b = {ratio!r}*{w}a;",
    ]
    whole = j[0] + ratio**2 * j[1]

    def rate(v: Values) -> float:
        return (math.tanh(e.value(v)) - ratio * 0.3 * ratio * v[f"{w}a"]) / whole

    m.state(f"{w}a", start, rate)
    m.define(f"{w}b", lambda v: ratio * v[f"{w}a"])
    m.define(f"{w}t", lambda v: j[1] * ratio * rate(v) + 0.3 * ratio * v[f"{w}a"])
    m.show(f"{w}b")
    m.show(f"{w}t")


def steady_start(m: Model) -> None:
    """Initial equations: a steady state, one found from another, and a parameter that is sought."""
    x, p, k, c = m.name("x"), m.name("p"), m.number(0.5, 3), m.number()
    usable = [e for e in m.known if e.text in m.parameters]
    e = m.rng.choice(usable) if usable else literal(m.number())
    m.declarations += [
        f"Real {x}, {x}b(start = 0.3);",
        f"parameter Real {p}(fixed = false, start = 1);",
    ]
    m.equations += [
        f"der({x}) = {c!r} + {e.text} - {k!r}*{x} + {p}*(if time > 0.5 then 1 else 0);",
        f"der({x}b) = {x} - {x}b;",
    ]
    m.initial += [f"der({x}) = 0;", f"{x}b = 2*{x} + 1;", f"{p}^3 + {p} = 10 + {k!r};"]
    e0 = e.value(m.parameters)
    sought = float(brentq(lambda s: s**3 + s - 10 - k, 0, 10, xtol=1e-14))
    start = (c + e0) / k
    m.parameters[p] = sought
    m.compared.append(p)
    m.state(x, start, lambda v: c + e0 - k * v[x] + sought * (v["time"] > 0.5))
    m.state(f"{x}b", 2 * start + 1, lambda v: v[x] - v[f"{x}b"])


def delayed(m: Model) -> None:
    y, late, w = m.name("y"), m.number(0.05, 0.6), m.number(0.5, 4)
    m.declarations.append(f"Real {y};")
    m.equations.append(f"{y} = delay(sin({w!r}*time) + 2*time, {late!r});")

    def value(v: Values) -> float:
        then = max(v["time"] - late, 0.0)
        return math.sin(w * then) + 2 * then

    m.define(y, value)
    m.compared.append(y)


def environment(m: Model) -> None:
    """inner and outer, an enumeration, nested packages, imports, a short class."""
    p, s, e, k = m.name("P"), m.name("s"), drawn(m, 2, True), m.number()
    law = m.rng.choice(["off", "line", "square"])
    m.classes.append(
        f'package {p}\n  package Kinds\n    type Law = enumeration(off "none", line, square);\n'
        f"    constant Real big = 2*scale;\n  end Kinds;\n  constant Real scale = {k!r};\n"
        f'  type Length = Real(unit = "m", min = -1e9);\n'
        f"  model World\n    parameter Real g = 1;\n    Real now = g*time;\n  end World;\n"
        f"  model Part\n    import K = {p}.Kinds;\n"
        f"    import {p}.Kinds.Law;\n    outer World {s}w;\n"
        f"    parameter Law law = Law.off;\n    Length y;\n    input Real u;\n  equation\n"
        f"    y = {s}w.now + K.big + (if law == Law.off"
        f" then 0 elseif law == Law.line then u else u^2)\n"
        f"      + Integer(law);\n  end Part;\nend {p};"
    )
    m.declarations += [
        f"inner {p}.World {s}w(g = 3);",
        f"{p}.Part {s}(law = {p}.Kinds.Law.{law}, u = tanh({e.text}));",
    ]
    place = ["off", "line", "square"].index(law)

    def value(v: Values) -> float:
        u = math.tanh(e.value(v))
        return 3 * v["time"] + 2 * k + (0.0, u, u * u)[place] + place + 1

    m.define(f"{s}.y", value)
    m.show(f"{s}.y", e.jumps)


def logic(m: Model) -> None:
    a, b, y = drawn(m, 2, True), drawn(m, 2, True), m.name("b")
    m.declarations += [f"Boolean {y}, {y}n;", f"Integer {y}i;"]
    m.equations += [
        f"{y} = {a.text} > {b.text} or not time > 0.8;",
        f"{y}n = not {y} and ({a.text} <= 0.5 or {y}i == 2) or {y}i <> 1 and {y};",
        f"{y}i = if {y} then 1 else 2;",
    ]
    m.define(y, lambda v: float(a.value(v) > b.value(v) or not v["time"] > 0.8))
    m.define(f"{y}i", lambda v: 1.0 if v[y] else 2.0)
    m.define(
        f"{y}n",
        lambda v: float(
            (not v[y] and (a.value(v) <= 0.5 or v[f"{y}i"] == 2))
            or (v[f"{y}i"] != 1 and bool(v[y]))
        ),
    )
    for name in (y, f"{y}n", f"{y}i"):
        m.compared.append(name)
    m.known.append(Expr(f"{y}i", lambda v: v[f"{y}i"], True))


def trigger(m: Model) -> None:
    """A loop under noEvent() whose solution ends: an amplifier fed back to its positive input."""
    y, v, e, gain = m.name("y"), m.name("v"), drawn(m, 2), m.number(8, 40)
    back = m.number(0.3, 0.8)
    d, end = f"{gain!r}*({back!r}*{y} - {v})", back - 1 / gain
    m.declarations += [f"Real {y}(start = 1);", f"Real {v}(start = 0, fixed = true);"]
    m.equations += [
        f"{y} = noEvent(if {d} > 1 then 1 else if {d} < -1 then -1 else {d});",
        f"der({v}) = 5*({y} - {v}) + 0.5*tanh({e.text});",
    ]
    m.discretes[y] = 1.0

    def over(side: float) -> Crossing:
        return Crossing(
            lambda now: side * now[v] - end if now[y] == side else -1.0, lambda _: {y: -side}
        )

    m.crossings += [over(1.0), over(-1.0)]
    m.state(v, 0.0, lambda now: 5 * (now[y] - now[v]) + 0.5 * math.tanh(e.value(now)))
    m.show(y, jumps=True)


FEATURES: dict[str, Callable[[Model], None]] = {
    f.__name__: f
    for f in (
        algebraic, state, second_order, parameters, arrays, matrices, linear_loop, nonlinear_loop,
        if_equation, algorithm, function, record, components, circuit, sampled, once, sawtooth,
        coupled, steady_start, delayed, environment, logic, trigger,
    )
}  # fmt: skip


def model_of(rng: random.Random, pieces: Sequence[str]) -> Model:
    """A model of these features, drawn."""
    model = Model(rng)
    for name in pieces:
        model.features.append(name)
        FEATURES[name](model)
    return model
