"""Many runs of a part over one record in one call."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_cut import CART, MEASURED

from modelica_fmu import batch
from modelica_fmu.batch import (
    Array,
    Correction,
    Course,
    Drive,
    Part,
    Subsystem,
    build_part,
    part_key,
    read_part,
)
from modelica_fmu.compiled import CompiledModel
from modelica_fmu.cut import cut
from modelica_fmu.errors import InputError
from modelica_fmu.lanes import asserted_once
from modelica_fmu.toolchain import PLATFORMS, Compiler, host_platform, own_processor
from pyfmi_runner.build import build_fmu, cache_folder, default_model
from pyfmi_runner.campaign import LogSetup
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.plant import CLAMPS, DEFAULT_CLASS, MANUAL, PROFILE, plant_parameters
from pyfmi_runner.replay import Replayer

PERIOD = 1e-3  # s


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> Part:
    folder = tmp_path_factory.mktemp("cart")
    (folder / "Toy.mo").write_text(CART, encoding="utf-8")
    return build_part(cut(folder / "Toy.mo", "Toy.Cart", ["f", "v", "s"]), folder, "cart")


@pytest.fixture(scope="module")
def cart(part: Part) -> Subsystem:
    return Subsystem(part)


def test_runs_follow_the_closed_form(cart: Subsystem) -> None:
    n, tau = 500, np.array([0.1, 0.02])
    found = cart.run(
        ["tau", "K"], np.column_stack([tau, [2.0, 3.0]]), Drive({"u": np.ones(n)}), ["f"], PERIOD
    )
    time = PERIOD * np.arange(n)
    expected = np.array([[2.0], [3.0]]) * (1 - np.exp(-time / tau[:, None]))
    np.testing.assert_allclose(found[:, :, 0], expected, atol=2e-6)


def test_inputs_at_the_rows_differ_from_those_behind_them(cart: Subsystem) -> None:
    """A state sees what acts over the periods."""
    held, zero = np.ones(200), np.zeros(200)
    pair = cart.run(["K"], np.array([[2.0]]), Drive({"u": (zero, held)}), ["f"], PERIOD)
    same = cart.run(["K"], np.array([[2.0]]), Drive({"u": held}), ["f"], PERIOD)
    np.testing.assert_allclose(pair, same, atol=1e-9)


LATE = """package Toy
  model Lag
    parameter Real d(max = 0.2) = 0;
    input Real u;
    Real f(start = 0, fixed = true);
  equation
    0.05*der(f) = (if d > 0 and time < d then 0
      else noEvent(if d > 0 then delay(u, if d > 0 then d else 1e-3, 0.2) else u)) - f;
  end Lag;
end Toy;
"""


def late_lag(u: Array, late: float) -> Array:
    """f of `LATE` at the rows, u held over each: sum of the steps' answers, as the closed form."""
    time = PERIOD * np.arange(len(u))
    since = np.maximum(time[:, None] - (PERIOD * np.arange(len(u)) + late), 0.0)
    steps = np.diff(u, prepend=0.0)
    return np.asarray((1 - np.exp(-since / 0.05)) @ steps)


def test_a_late_input_s_jumps_lie_where_they_are(tmp_path: Path) -> None:
    """Between rows, at them, and right beside them; and over a long record, for rows' times are
    rounded: where one ends is not to the last bit where the next one begins.
    """
    (tmp_path / "Toy.mo").write_text(LATE, encoding="utf-8")
    lag = Subsystem(build_part(cut(tmp_path / "Toy.mo", "Toy.Lag", ["f"]), tmp_path, "lag"))
    u = np.random.default_rng(1).standard_normal(2000)
    late = np.array([0.0, 0.0035, 0.004, 0.004 + 1e-9, 0.0047, 0.02])
    found = lag.run(["d"], late[:, None], Drive({"u": u}), ["f"], PERIOD)[:, :, 0]
    for own, d in zip(found, late, strict=True):
        np.testing.assert_allclose(own, late_lag(u, d), atol=1e-7)


@pytest.mark.parametrize(("decides", "switching"), [("time", ()), ("f", ("f",)), ("u", ("f",))])
def test_what_the_clock_alone_decides_makes_no_state_switching(
    tmp_path: Path, decides: str, switching: tuple[str, ...]
) -> None:
    text = LATE.replace("time < d", f"{decides} < d")
    (tmp_path / "Toy.mo").write_text(text, encoding="utf-8")
    assert cut(tmp_path / "Toy.mo", "Toy.Lag", ["f"]).switching == switching


def test_inputs_may_change_within_rows(cart: Subsystem) -> None:
    """A pulse of half a row is what rows of half the period hold."""
    fine = np.zeros(200)
    fine[31], fine[120:] = 5.0, 1.0
    expected = cart.run(["K"], np.array([[2.0]]), Drive({"u": fine}), ["f", "v"], PERIOD)[0, ::2]
    parts = fine.reshape(100, 2)
    drive = Drive({"u": (parts[:, 0], parts)})
    found = cart.run(["K"], np.array([[2.0]]), drive, ["f", "v"], 2 * PERIOD)[0]
    np.testing.assert_allclose(found, expected, atol=1e-7)
    mean = Drive({"u": parts.mean(axis=1)})
    averaged = cart.run(["K"], np.array([[2.0]]), mean, ["f"], 2 * PERIOD)[0]
    assert np.abs(averaged[:, 0] - expected[:, 0]).max() > 1e-4


def test_code_for_this_processor_is_kept_apart_from_another_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder that machines share may hold parts of each."""
    (tmp_path / "Toy.mo").write_text(CART, encoding="utf-8")
    here = part_key(tmp_path / "Toy.mo", "cart")
    assert here == part_key(tmp_path / "Toy.mo", "cart")
    monkeypatch.setattr("modelica_fmu.batch.processor", lambda: "flags: fpu")
    assert here != part_key(tmp_path / "Toy.mo", "cart")


def test_code_for_others_is_for_any_processor() -> None:
    own, zig = host_platform(), Compiler(("zig", "cc"), "", zig=True)
    abroad = next(p for p in PLATFORMS if p != own)
    assert own_processor(zig, own) == ()
    here = own_processor(replace(zig, zig=False), own)
    assert ("-march=native" in here) == (own.fmi3 == "x86_64-linux")
    assert own_processor(replace(zig, zig=False), abroad) == ()


def test_a_large_part_that_seldom_runs_is_compiled_quickly_and_gives_the_same_bits(
    cart: Subsystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flags: list[str] = []
    own = batch.compile_library

    def watched(*given: Any) -> Path:
        flags.extend(given[-1])
        return own(*given)

    monkeypatch.setattr(batch, "compile_library", watched)
    monkeypatch.setattr(batch, "LARGE", 0)
    (tmp_path / "Toy.mo").write_text(CART, encoding="utf-8")
    model = cut(tmp_path / "Toy.mo", "Toy.Cart", ["f", "v", "s"])
    Subsystem(build_part(model, tmp_path, "often"))
    assert "-O1" not in flags
    quick = Subsystem(build_part(model, tmp_path, "quick"), often=False)
    assert "-O1" in flags
    u = np.random.default_rng(3).normal(size=400)
    runs = [
        c.run(["tau", "K"], np.array([[0.1, 2.0], [0.02, 3.0]]), Drive({"u": u}), ["v"], PERIOD)
        for c in (cart, quick)
    ]
    assert np.array_equal(*runs)


def test_an_input_that_the_part_lacks_is_refused(cart: Subsystem) -> None:
    with pytest.raises(InputError, match="no input of this part"):
        cart.run(["K"], np.array([[2.0]]), Drive({"w": np.zeros(9)}), ["f"], PERIOD)


def test_a_corrected_state_closes_in_by_its_share_each_row(cart: Subsystem) -> None:
    n, share = 40, 0.2
    correction = Correction(("s",), np.full((n, 1), 1.0), (share,))
    drive = Drive({"u": np.zeros(n)}, correction)
    still = cart.run(["s_start"], np.zeros((1, 1)), drive, ["s"], PERIOD)
    np.testing.assert_allclose(still[0, :, 0], 1 - (1 - share) ** np.arange(n), atol=1e-12)
    blind = Correction(("s",), np.full((n, 1), np.nan), (share,))
    drive = Drive({"u": np.zeros(n)}, blind)
    found = cart.run(["s_start"], np.zeros((1, 1)), drive, ["s"], PERIOD)
    assert not found.any()


def test_a_run_that_fails_gives_nan_and_spoils_no_other(cart: Subsystem) -> None:
    drive = Drive({"u": np.ones(50)})
    found = cart.run(["m"], np.array([[1.0], [0.0], [1.0]]), drive, ["v"], PERIOD)
    assert np.isnan(found[1, -1, 0])
    assert np.isfinite(found[[0, 2]]).all()
    np.testing.assert_array_equal(found[0], found[2])


def test_several_threads_give_the_same_bits(cart: Subsystem) -> None:
    values = np.linspace(0.5, 2.0, 30)[:, None]
    drive = Drive({"u": np.sin(np.arange(400) / 30)})

    def run(rows: slice) -> np.ndarray:
        return cart.run(["m"], values[rows], drive, ["v", "s"], PERIOD)

    with ThreadPoolExecutor(3) as pool:
        parts = list(pool.map(run, [slice(i, i + 5) for i in range(0, 30, 5)]))
    np.testing.assert_array_equal(np.concatenate(parts), run(slice(0, 30)))


SLED = """package Toy
  model Sled "Coulomb friction by modes, an end stop, and a clamp"
    parameter Real m = 1.0;
    parameter Real F = 0.5 "N";
    parameter Real wall = 0.02 "m";
    input Real u;
    input Boolean clamp;
    output Real s(start = 0, fixed = true);
    output Real v(start = 0, fixed = true);
    output Real pushed;
  equation
    der(s) = v;
    pushed = u - (if v > 1e-3 then F elseif v < -1e-3 then -F else max(-F, min(F, u)));
    m * der(v) = if clamp then 0 else pushed;
    when s > wall then
      reinit(v, -0.5 * pre(v));
    end when;
    when clamp then
      reinit(v, 0);
    end when;
  end Sled;
end Toy;
"""


@pytest.mark.parametrize("outputs", [["s", "v"], ["v", "pushed"]])
def test_a_run_does_not_depend_on_what_runs_beside_it(
    tmp_path: Path, outputs: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Events, a stop, a clamp, drives of their own and of their own length, corrections and one
    failure: the same bits as alone, and as without lanes.
    """
    (tmp_path / "Toy.mo").write_text(SLED, encoding="utf-8")
    compiled = cut(tmp_path / "Toy.mo", "Toy.Sled", outputs)
    assert asserted_once(compiled.sources["model.c"])  # nothing of them is watched
    sled = Subsystem(build_part(compiled, tmp_path, f"sled {outputs[0]}"))
    monkeypatch.setattr(batch, "PART_FLAGS", (*batch.PART_FLAGS, "-DLANED=0"))
    plain = Subsystem(build_part(compiled, tmp_path, f"plain sled {outputs[0]}"))
    rng = np.random.default_rng(4)
    drives = []
    for k, n in enumerate((1300, 1500, 1)):
        time = PERIOD * np.arange(n)
        clamp = ((time > 0.9) & (time < 1.1)).astype(float)
        push = (1 + 0.1 * k) * np.sin(9 * time) + 0.6 + 0.01 * rng.standard_normal(n)
        seen = np.where(rng.random((n, 1)) < 0.5, rng.normal(0, 2e-3, (n, 1)), np.nan)
        drives.append(Drive({"u": push, "clamp": clamp}, Correction(("v",), seen, (0.05,))))
    values = np.column_stack([rng.uniform(0.5, 2, 13), rng.uniform(0.2, 0.8, 13)])
    values[5, 0], which = 0.0, [k % 3 for k in range(13)]
    found = sled.runs(["m", "F"], values, drives, outputs, PERIOD, which)
    for k, run in enumerate(found):
        alone = sled.run(["m", "F"], values[k : k + 1], drives[which[k]], outputs, PERIOD)[0]
        np.testing.assert_array_equal(run, alone)
        other = plain.run(["m", "F"], values[k : k + 1], drives[which[k]], outputs, PERIOD)[0]
        np.testing.assert_array_equal(run, other)
        assert np.isnan(run[-1]).all() if k == 5 else np.isfinite(run).all()
    assert [len(run) for run in found[:3]] == [1300, 1500, 1]
    assert np.ptp(found[0][:, 0]) > 0.01


RATCHET = """package Toy
  model Ratchet "Friction, a push that swings with time, a pawl that counts and takes speed"
    parameter Real m = 1.0;
    parameter Real F = 0.5;
    parameter Real loss = 0.3;
    parameter Real pitch = 0.02;
    input Real u;
    output Real s(start = 0, fixed = true);
    output Real v(start = 0, fixed = true);
    output Real teeth;
    output Real side;
  protected
    discrete Real n(start = 0, fixed = true);
    discrete Real turns(start = 0, fixed = true);
    Real pushed, drag;
  equation
    pushed = u + 0.3 * sin(40 * time);
    der(s) = v;
    drag = if v > 1e-3 then F elseif v < -1e-3 then -F else max(-F, min(F, pushed));
    m * der(v) = pushed - drag;
    when s > pitch * (pre(n) + 1) then
      n = pre(n) + 1;
      reinit(v, (1 - loss) * v);
    end when;
    when v < -0.01 then
      turns = pre(turns) + 1;
    end when;
    teeth = n;
    side = if s > pitch * n then turns else -turns;
  end Ratchet;
end Toy;
"""


@pytest.mark.parametrize("tolerance", [1e-4, 1e-12])
@pytest.mark.parametrize("longest", [PERIOD, 0.4 * PERIOD, 0.6 * PERIOD])
def test_events_within_rows_are_those_of_a_run_without_lanes(
    tmp_path: Path, longest: float, tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Relations that change on the way and when-clauses that they fire, in rows of one step and of
    several, in few lanes or in all, under equations that read the time, and where steps' errors are
    some of the tolerance: the same bits.
    """
    (tmp_path / "Toy.mo").write_text(RATCHET, encoding="utf-8")
    outputs = ["s", "v", "teeth", "side"]
    compiled = cut(tmp_path / "Toy.mo", "Toy.Ratchet", outputs)
    assert asserted_once(compiled.sources["model.c"])  # nothing of them is watched
    ratchet = Subsystem(build_part(compiled, tmp_path, "ratchet"))
    monkeypatch.setattr(batch, "PART_FLAGS", (*batch.PART_FLAGS, "-DLANED=0"))
    plain = Subsystem(build_part(compiled, tmp_path, "plain ratchet"))
    rng = np.random.default_rng(7)
    time = PERIOD * np.arange(1500)
    seen = np.where(rng.random((1500, 1)) < 0.3, rng.normal(0, 5e-3, (1500, 1)), np.nan)
    drives = [
        Drive({"u": np.sin(9 * time) + 0.3 + 0.02 * rng.standard_normal(1500)}),
        Drive({"u": 0.3 + 1.2 * np.sin(31 * time)}, Correction(("v",), seen, (0.2,))),
    ]
    names = ["m", "F", "loss", "pitch", "solver.max_step", "solver.tolerance"]
    low, high = [0.2, 0.1, 0.0, 1e-3], [2.0, 0.8, 0.9, 0.03]
    solver = np.tile([longest, tolerance], (40, 1))
    values = np.hstack([rng.uniform(low, high, (40, 4)), solver])
    for drive in drives:
        found = ratchet.run(names, values, drive, outputs, PERIOD)
        np.testing.assert_array_equal(found, plain.run(names, values, drive, outputs, PERIOD))
        assert np.isfinite(found).all()
        assert np.ptp(found[:, -1, 2:]) > 1  # it has counted


CHAMBER = """package Toy
  model Chamber "Pressure in a volume that a piston changes, and that vanishes some time"
    parameter Real V = 0.5;
    parameter Real last = 1;
    input Real u;
    output Real p(start = 1, fixed = true);
    output Real x(start = 0, fixed = true);
  equation
    (if time > last then 0 else V + x) * der(p) = u - p * der(x);
    der(x) = u;
  end Chamber;
end Toy;
"""


def test_divisors_that_hang_on_states_are_watched_in_lanes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same bits as without lanes, and a run ends where its own vanishes."""
    (tmp_path / "Toy.mo").write_text(CHAMBER, encoding="utf-8")
    compiled = cut(tmp_path / "Toy.mo", "Toy.Chamber", ["p", "x"])
    assert not asserted_once(compiled.sources["model.c"])
    chamber = Subsystem(build_part(compiled, tmp_path, "chamber"))
    monkeypatch.setattr(batch, "PART_FLAGS", (*batch.PART_FLAGS, "-DLANED=0"))
    plain = Subsystem(build_part(compiled, tmp_path, "plain chamber"))
    rng = np.random.default_rng(2)
    drive = Drive({"u": np.cos(np.arange(900) * PERIOD) + 0.05 * rng.standard_normal(900)})
    values = np.column_stack([rng.uniform(0.3, 2.0, 20), np.where(np.arange(20) % 7, 9.0, 0.4001)])
    found = chamber.run(["V", "last"], values, drive, ["p", "x"], PERIOD)
    np.testing.assert_array_equal(
        found, plain.run(["V", "last"], values, drive, ["p", "x"], PERIOD)
    )
    ends = np.isfinite(found[:, :, 1]).sum(axis=1)
    assert (ends[1:7] == 900).all()
    assert set(ends[::7]) == {int(0.4001 / PERIOD)}  # the row that would not end is not told


def test_rows_that_are_steady_are_stepped_as_those_beside_them(cart: Subsystem) -> None:
    """An input that differs within some rows of one drive changes no bit of another's runs."""
    fine = np.sin(np.arange(400) / 15).reshape(200, 2)
    steps = np.repeat(np.round(fine[:, :1], 1), 2, axis=1)
    drives = [Drive({"u": (u[:, 0], u)}) for u in (fine, steps)]
    values = np.linspace(0.5, 2.0, 9)[:, None]
    both = cart.runs(["m"], values, drives, ["v", "s"], 2 * PERIOD, [k % 2 for k in range(9)])
    for k, run in enumerate(both):
        alone = cart.run(["m"], values[k : k + 1], drives[k % 2], ["v", "s"], 2 * PERIOD)[0]
        np.testing.assert_array_equal(run, alone)


CLOCKED = """package Toy
  model Backlash "A lag behind a play that is read by a clock; another one drains it"
    parameter Real play = 0.1;
    parameter Real period = 1e-3 "s";
    parameter Real slack = 1e9 "s, of a clock that lets the play go";
    parameter Real drain = 1e9 "s, of a clock that empties the lag by half";
    parameter Real tau = 0.02 "s";
    input Real u;
    output Real y(start = 0, fixed = true);
    output Real read, count, wide;
  protected
    discrete Real held(start = 0, fixed = true);
    discrete Real turns(start = 0, fixed = true);
    discrete Boolean rising(start = false, fixed = true);
  equation
    when sample(0, period) then
      held = max(min(pre(held), u + play), u - play);
      rising = held > pre(held);
    elsewhen sample(0, slack) then
      held = u;
      rising = false;
    end when;
    when sample(drain, drain) then
      reinit(y, 0.5 * pre(y));
    end when;
    when rising then
      turns = pre(turns) + 1;
    end when;
    read = held;
    count = turns;
    der(y) = (held - y) / tau;
    wide = if y > 0.5 then 2 * y else y;
  end Backlash;
end Toy;
"""
# a when-clause that follows from what a clock has set has no lanes
TOLD = [(["y"], False), (["y", "read", "wide"], False), (["y", "read", "count", "wide"], True)]


@pytest.mark.parametrize(("outputs", "chained"), TOLD)
def test_clocks_tick_in_lanes_as_without_them(
    tmp_path: Path, outputs: list[str], chained: bool
) -> None:
    """Plays that are read every row, more rarely, and within rows; two clocks of one clause, and
    one that sets a state; beside each other, for not all lanes tick at once. The same bits as alone
    and as without lanes; where one clock ticks at each row, as the recursion by hand.
    """
    (tmp_path / "Toy.mo").write_text(CLOCKED, encoding="utf-8")
    compiled = cut(tmp_path / "Toy.mo", "Toy.Backlash", outputs)
    assert f"#define CHAINED {int(chained)}\n" in compiled.sources["model.h"]
    part = Subsystem(build_part(compiled, tmp_path, "clocked"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch, "PART_FLAGS", (*batch.PART_FLAGS, "-DLANED=0"))
        plain = Subsystem(build_part(compiled, tmp_path, "plain clocked"))
    rows = PERIOD * np.arange(700)
    drives = [Drive({"u": np.sin(7 * rows + k) + 0.1 * k}) for k in range(2)]
    names = ["play", "period", "slack", "drain"]
    clocks = [
        [PERIOD, 1e9, 1e9],
        [4 * PERIOD, 2 * PERIOD, 1e9],
        [3 * PERIOD, 1e9, 50 * PERIOD],
        [1.5 * PERIOD, 7 * PERIOD, 33.3 * PERIOD],
    ]
    values = np.column_stack([np.linspace(0.02, 0.4, 12), np.tile(clocks, (3, 1))])
    which = [k % 2 for k in range(12)]
    found = part.runs(names, values, drives, outputs, PERIOD, which)
    for k, run in enumerate(found):
        one = values[k : k + 1], drives[which[k]], outputs, PERIOD
        np.testing.assert_array_equal(run, part.run(names, *one)[0])
        np.testing.assert_array_equal(run, plain.run(names, *one)[0])
    for k in range(0, 12, 4):
        y = held = 0.0
        for n, u in enumerate(drives[which[k]].inputs["u"].at):
            held = max(min(held, u + values[k, 0]), u - values[k, 0])
            told = [y, held][: len(outputs)]
            np.testing.assert_allclose(found[k][n, : len(told)], told, atol=1e-6)
            y = held + (y - held) * np.exp(-PERIOD / 0.02)
    assert np.ptp(found[1][:, 0] - found[0][:, 0]) > 0.01


PAD = """package Toy
  model Pad "Touch on a bumpy pad: relations, but no state"
    parameter Real k = 100.0;
    parameter Real bump = 1e-3 "m";
    input Real s;
    output Real f;
  protected
    Real depth = s - bump * sin(300 * s);
  equation
    f = if depth > 0 then k * depth * (if depth > 0.01 then 1 + depth else 1) else 0;
  end Pad;
end Toy;
"""


def test_runs_of_a_model_without_states_do_not_depend_on_each_other(tmp_path: Path) -> None:
    """Relations and outputs come from one function there: the same bits as alone, and as the
    formula says.
    """
    (tmp_path / "Toy.mo").write_text(PAD, encoding="utf-8")
    pad = Subsystem(build_part(cut(tmp_path / "Toy.mo", "Toy.Pad", ["f"]), tmp_path, "pad"))
    s = 0.02 * np.sin(np.arange(700) / 40)
    values = np.column_stack([np.linspace(50, 200, 11), np.linspace(0, 3e-3, 11)])
    values[4, 0] = np.nan
    found = pad.run(["k", "bump"], values, drive := Drive({"s": s}), ["f"], PERIOD)[:, :, 0]
    alone = [pad.run(["k", "bump"], v, drive, ["f"], PERIOD)[0, :, 0] for v in values[:, None]]
    np.testing.assert_array_equal(found, alone)
    assert np.isnan(found[4, 1:]).all()
    for (k, bump), f in zip(np.delete(values, 4, 0), np.delete(found, 4, 0), strict=True):
        depth = s - bump * np.sin(300 * s)
        true = np.where(depth > 0, k * depth * np.where(depth > 0.01, 1 + depth, 1), 0.0)
        np.testing.assert_allclose(f, true, rtol=1e-12)


def test_drives_may_share_a_course_and_find_out_about_it_once(cart: Subsystem) -> None:
    u = Course.of(np.sin(np.arange(60) / 9))
    two = [Drive({"u": u}), Drive({"u": u}, Correction(("v",), np.zeros((60, 1)), (0.5,)))]
    first, second = (cart.run(["m"], np.ones((1, 1)), d, ["v"], PERIOD) for d in two)
    assert len(u.kinds) == 1
    assert np.abs(second).max() < np.abs(first).max()


def test_inputs_of_a_drive_have_the_same_rows_and_parts() -> None:
    with pytest.raises(ValueError, match="the same rows"):
        Drive({"u": np.zeros(3), "clamp": np.zeros(4)})
    with pytest.raises(ValueError, match="the same parts"):
        Drive({n: (np.zeros(3), np.zeros((3, k))) for n, k in (("u", 2), ("clamp", 3))})


@pytest.mark.usefixtures("unoptimised")
def test_the_whole_gantry_equals_the_fmu_s_co_simulation() -> None:
    """Both valves driven, the tip pressed onto the edge."""
    n, setup = 1500, LogSetup(clamped=("x",), workpiece="straight", standoff=0.004)
    time = PERIOD * np.arange(n)
    commands = np.column_stack([0.3 * np.sin(8 * time), 1.6 + 0.5 * np.sign(np.sin(9 * time))])
    with Replayer(FmuFile.read(build_fmu().path)) as fmu:
        expected = fmu.drive(setup, commands, time)
    folder, key = cache_folder() / "parts", part_key(default_model(), "whole, for the tests")
    part = read_part(folder, key)
    if part is None:
        part = build_part(cut(default_model(), DEFAULT_CLASS, MEASURED), folder, key)
    gantry = Subsystem(part)
    inputs = dict.fromkeys((*CLAMPS, *MANUAL, *PROFILE), np.zeros(n))
    inputs |= {"clamp_x": np.ones(n), "u_x": commands[:, 0], "u_z": commands[:, 1]}
    given = plant_parameters(setup)
    found = gantry.run(
        list(given), np.array([list(given.values())]), Drive(inputs), MEASURED, PERIOD
    )[0]
    assert np.abs(expected[:, MEASURED.index("f_z")]).max() > 5.0  # N, it touches
    scale = np.abs(expected).max(axis=0) + 1e-9
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-6)


def test_a_part_is_read_back_as_it_was_built(part: Part) -> None:
    assert read_part(part.library.parent.parent, "cart") == part
    assert read_part(part.library.parent.parent, "absent") is None
    assert part.of("state") == ["f", "v", "s"]


def test_a_part_that_another_process_wrote_first_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may be at its compilation, in the same folder."""
    (tmp_path / "Toy.mo").write_text(CART, encoding="utf-8")
    compiled = cut(tmp_path / "Toy.mo", "Toy.Cart", ["v"])
    write = batch._write

    def after_another(of: CompiledModel, folder: Path) -> None:
        monkeypatch.setattr(batch, "_write", write)
        build_part(of, tmp_path, "cart")
        (tmp_path / "cart" / "compiling").write_text("", encoding="utf-8")
        write(of, folder)

    monkeypatch.setattr(batch, "_write", after_another)
    assert build_part(compiled, tmp_path, "cart") == read_part(tmp_path, "cart")
    assert (tmp_path / "cart" / "compiling").is_file()


def test_the_key_follows_the_model_and_the_cut(tmp_path: Path) -> None:
    model = tmp_path / "Toy.mo"
    model.write_text(CART, encoding="utf-8")
    first = part_key(model, "v")
    assert part_key(model, "v") == first != part_key(model, "f")
    model.write_text(CART.replace("tau = 0.1", "tau = 0.2"), encoding="utf-8")
    assert part_key(model, "v") != first


def test_names_that_the_part_lacks_are_one_clear_line(cart: Subsystem) -> None:
    n = np.zeros(5)
    with pytest.raises(InputError, match="mass: is no variable of this part"):
        cart.run(["mass"], np.ones((1, 1)), Drive({"u": n}), ["v"], PERIOD)
    wrong = Correction(("K",), np.zeros((5, 1)), (0.5,))
    with pytest.raises(InputError, match="cannot correct K"):
        cart.run(["m"], np.ones((1, 1)), Drive({"u": n}, wrong), ["v"], PERIOD)


def test_a_part_is_compiled_when_it_is_loaded_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "Toy.mo").write_text(CART, encoding="utf-8")
    part = build_part(cut(tmp_path / "Toy.mo", "Toy.Cart", ["v"]), tmp_path, "cart")
    assert part.of("state") == ["f", "v"]
    assert not part.library.exists()
    with ThreadPoolExecutor(2) as pool:  # two processes may be at it
        list(pool.map(Subsystem, [part, part]))
    names = {p.name for p in part.library.parent.iterdir()}
    assert names == {"part.json", part.library.name}
    monkeypatch.setattr("modelica_fmu.batch.compile_library", None)
    Subsystem(part)  # it is there
