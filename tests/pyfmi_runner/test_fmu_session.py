"""FMU files read with suspicion, and sessions that keep the legal order."""

import pickle
import stat
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numba import njit, types
from numba.extending import intrinsic

from modelica_fmu.errors import InputError, RunError
from pyfmi_runner import fmu_file
from pyfmi_runner.fmu import LEGAL, FmuFile, FmuSession

sys.path.insert(0, str(Path(__file__).parents[1] / "modelica_fmu" / "stub"))
from stub_model import stub_fmu


@pytest.fixture(params=["2.0", "3.0"])
def path(request) -> Path:
    return stub_fmu(request.param)


@pytest.fixture
def file(path) -> FmuFile:
    return FmuFile.read(path)


@pytest.fixture(autouse=True)
def cache(tmp_path_factory, monkeypatch) -> Path:
    folder = tmp_path_factory.getbasetemp() / "cache"
    monkeypatch.setenv("PNEUGANTRY_CACHE", str(folder))
    return folder


# ---- files ----


def test_the_description_is_read(file):
    d = file.description
    assert (d.model, d.states, d.outputs) == (
        "Stub.Ball",
        ("ball.h", "ball.v"),
        ("y", "a", "bounces"),
    )
    assert (d.derivatives, d.n_indicators, d.default_stop) == (
        ("der(ball.h)", "der(ball.v)"),
        1,
        3.0,
    )
    mass, medium, force = (file.variables[name] for name in ("m", "medium", "f"))
    assert (mass.unit, mass.min, mass.max, mass.start, mass.description) == (
        "kg",
        0.1,
        100.0,
        1.0,
        "Mass",
    )
    assert (mass.causality, mass.variability, mass.is_real) == ("parameter", "fixed", True)
    assert dict(medium.literals) == {"vacuum": 1, "air": 2}
    assert (force.causality, force.min, force.max, force.unit) == ("input", -50.0, 50.0, "N")
    assert "canGetAndSetFMUstate" in d.capabilities["cs"]


def test_it_is_unpacked_once_to_a_folder_named_by_its_content(file, cache):
    folder = file.unpack()
    assert folder == cache / "fmu" / file.sha256
    before = folder.stat().st_mtime_ns
    assert FmuFile.read(file.path).unpack().stat().st_mtime_ns == before
    assert [p.name for p in folder.parent.iterdir() if p.name.startswith("unpack-")] == []


def test_it_is_unpacked_to_the_cache_that_all_else_is_in(file, tmp_path, monkeypatch):
    monkeypatch.delenv("PNEUGANTRY_CACHE")
    monkeypatch.setattr("pyfmi_runner.cache.user_cache_path", lambda name: tmp_path / name)
    assert file.unpack() == tmp_path / "pneugantry" / "fmu" / file.sha256


def archive_with(
    path: Path, target: Path, changes: dict[str, bytes | None], **infos: zipfile.ZipInfo
) -> Path:
    """A copy of an FMU with members added, replaced or (None) left out."""
    with (
        zipfile.ZipFile(path) as source,
        zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as copy,
    ):
        for name in source.namelist():
            if name not in changes:
                copy.writestr(name, source.read(name))
        for name, data in changes.items():
            if data is not None:
                copy.writestr(infos.get(name, name), data)
    return target


def described(path: Path, target: Path, old: str, new: str) -> Path:
    with zipfile.ZipFile(path) as archive:
        text = archive.read("modelDescription.xml").decode()
    assert old in text
    return archive_with(path, target, {"modelDescription.xml": text.replace(old, new).encode()})


def refusal(path: Path) -> str:
    """The one line an unusable file is refused with; it names the file and a hint."""
    with pytest.raises(InputError) as caught:
        FmuFile.read(path).unpack()
    assert str(caught.value).startswith(f"{path}: ")
    assert caught.value.hint
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_missing_truncated_or_foreign_file_is_refused(path, tmp_path):
    assert "no such file" in refusal(tmp_path / "none.fmu")
    (tmp_path / "empty.fmu").write_bytes(b"")
    assert "not a zip archive" in refusal(tmp_path / "empty.fmu")
    data = path.read_bytes()
    for size in (100, len(data) // 2, len(data) - 1):
        (tmp_path / "cut.fmu").write_bytes(data[:size])
        assert "not a zip archive, or a truncated one" in refusal(tmp_path / "cut.fmu")
    assert "modelDescription.xml is missing" in refusal(
        archive_with(path, tmp_path / "x.fmu", {"modelDescription.xml": None})
    )


def test_flipped_bytes_are_refused_or_harmless(path, tmp_path):
    data = path.read_bytes()
    rng = np.random.default_rng(1)
    said = []
    for k in rng.integers(0, len(data), 200):
        damaged = bytearray(data)
        damaged[k] ^= 0x55
        target = tmp_path / "damaged.fmu"
        target.write_bytes(damaged)
        try:
            FmuFile.read(target).unpack()
        except InputError as error:
            said.append(str(error))
    assert all(line.startswith(f"{target}: ") for line in said)
    assert len(said) > 100  # most bytes are of compressed members with a checksum


@pytest.mark.parametrize(
    "name", ["../evil", "/etc/evil", "a/../../evil", "..\\evil", "C:/evil", "binaries/../../evil"]
)
def test_a_member_outside_the_folder_is_refused(path, tmp_path, name):
    bad = archive_with(path, tmp_path / "slip.fmu", {name: b"evil"})
    assert f"{name}: this path leaves the folder" in refusal(bad)
    assert not list(tmp_path.rglob("evil"))


def test_links_duplicates_and_bombs_are_refused(path, tmp_path, monkeypatch):
    link = zipfile.ZipInfo("link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    assert "symbolic links" in refusal(
        archive_with(path, tmp_path / "link.fmu", {"link": b"/etc/passwd"}, link=link)
    )
    twice = tmp_path / "twice.fmu"
    with zipfile.ZipFile(twice, "w") as archive:
        archive.writestr("a", b"1")
        with pytest.warns(UserWarning, match=r"Duplicate"):
            archive.writestr("a", b"2")
    assert "occurs twice" in refusal(twice)
    bomb = archive_with(path, tmp_path / "bomb.fmu", {"zeros": bytes(2**24)})
    assert "16777216 bytes packed into" in refusal(bomb)
    monkeypatch.setattr(fmu_file, "MAX_BYTES", 1000)
    assert "at most 10000 and 1000 are read" in refusal(path)


def test_hostile_xml_is_refused_and_not_expanded(path, tmp_path):
    lol = "".join(f'<!ENTITY l{k + 1} "{f"&l{k};" * 10}">' for k in range(9))
    doctype = f'<!DOCTYPE x [<!ENTITY l0 "lol">{lol}<!ENTITY f SYSTEM "file:///etc/passwd">]>'
    for entity in ("&l9;", "&f;", ""):
        bad = described(
            path, tmp_path / "x.fmu", "<fmiModelDescription", f"{doctype}<fmiModelDescription"
        )
        bad = described(bad, tmp_path / "y.fmu", "<LogCategories>", f"<LogCategories>{entity}")
        assert "modelDescription.xml: " in refusal(bad)


def test_a_wrong_description_names_what_is_wrong(path, tmp_path):
    target = tmp_path / "x.fmu"
    assert "not well-formed XML" in refusal(described(path, target, "</fmiModelDescription>", ""))
    assert "fmiVersion: FMI version '1.0'" in refusal(
        described(path, target, "fmiVersion=", 'fmiVersion="1.0" x=')
    )
    assert "m: line" in refusal(described(path, target, 'min="0.1"', 'min="low"'))
    assert "modelIdentifier: '../../x' is no C identifier" in refusal(
        described(path, target, '"Stub_Ball"', '"../../x"')
    )
    assert "ModelVariables: two variables have the same name" in refusal(
        described(path, target, 'name="e"', 'name="k"')
    )
    assert "lacks the attribute modelName" in refusal(
        described(path, target, "modelName=", "model=")
    )


def test_an_fmu_without_a_binary_for_this_machine_says_what_it_has(path, tmp_path):
    file = FmuFile.read(path)
    with zipfile.ZipFile(path) as archive:
        (binary,) = (name for name in archive.namelist() if name.startswith("binaries/"))
    other = archive_with(
        path, tmp_path / "x.fmu", {binary: None, "binaries/amiga/Stub_Ball.so": b"x"}
    )
    with pytest.raises(
        InputError, match=r"no binary for this machine.*the FMU has amiga; build it with"
    ):
        FmuFile.read(other).library("cs")
    broken = archive_with(path, tmp_path / "y.fmu", {binary: b"no library"})
    with (
        pytest.raises(InputError, match=r"the shared library cannot be loaded"),
        FmuSession(broken),
    ):
        pass
    token = described(path, tmp_path / "z.fmu", file.description.token, "{other}")
    with (
        pytest.raises(InputError, match=r"cannot be instantiated: .*token {other} does not match"),
        FmuSession(token),
    ):
        pass


def test_a_file_that_changed_since_it_was_read_is_refused(path, tmp_path):
    target = archive_with(path, tmp_path / "x.fmu", {"extra/note": b"1"})
    file = FmuFile.read(target)
    archive_with(path, target, {"extra/note": b"2"})
    with pytest.raises(InputError, match=r"has changed since it was read"):
        file.unpack()


def test_a_file_pickles(file):
    assert pickle.loads(pickle.dumps(file)) == file


# ---- sessions ----


def test_a_session_steps_and_reads_every_type(file):
    with FmuSession(
        file, parameters={"m": 2.0, "medium": "vacuum", "n": 2, "on": True, "f": 5.0}
    ) as fmu:
        assert fmu.get("weight") == 19.62
        assert (fmu.get("medium"), fmu.get("n"), fmu.get("on")) == (1, 2, True)
        assert isinstance(fmu.get("on"), bool)
        fmu.step(0.2)
        h = 1.0 + 0.5 * (2 * 5.0 / 2.0 - 9.81) * 0.2**2
        assert fmu.get(["ball.h", "bounces", "time", "on"]) == pytest.approx([h, 0.0, 0.2, 1.0])
        assert fmu.time == 0.2
        fmu.set(["f", "on", "n"], [1.0, False, 3])
        fmu.set({"k": 0.1, "f": 2.0})
        assert fmu.get(("f", "on", "n", "k")).tolist() == [2.0, 0.0, 3.0, 0.1]


def test_a_session_starts_at_its_start_time(path):
    with FmuSession(path, start_time=2.0) as fmu:
        assert fmu.get("time") == fmu.time == 2.0
        fmu.step(0.1)
        fmu.step(0.1, time=2.1)
        assert fmu.get("time") == pytest.approx(2.2)


def test_the_table_of_legal_calls_is_kept(file):
    arguments = {
        "set": ("f", 1.0),
        "get": ("y",),
        "step": (1e-3,),
        "directional": (["y"], ["f"], [1.0]),
        "set_time": (0.0,),
        "set_states": ([1.0, 0.0],),
        "load_state": (object(),),
        "deserialise": (b"",),
    }
    methods = frozenset().union(*LEGAL.values())
    for phase, legal in LEGAL.items():
        for method in sorted(methods - legal):
            fmu = FmuSession(file, kind="cs" if phase in ("ready", "failed") else "me")
            if phase == "closed":
                check_illegal(fmu, method, phase, arguments)
                continue
            with fmu:
                if phase == "continuous":
                    fmu.update_discrete()
                    fmu.enter_continuous()
                if phase == "failed":
                    with pytest.raises(RunError):
                        fmu.step(-1.0)
                check_illegal(fmu, method, phase, arguments)


def check_illegal(fmu: FmuSession, method: str, phase: str, arguments: dict) -> None:
    with pytest.raises(
        RunError, match=f"^{method} is not possible while the FMU session is {phase}; possible: "
    ):
        getattr(fmu, method)(*arguments.get(method, ()))


def test_a_session_is_opened_once_at_a_time_and_can_be_reopened(file):
    fmu = FmuSession(file)
    with fmu:
        with pytest.raises(RunError, match=r"already open"):
            fmu.__enter__()
        fmu.step(0.5)
    fmu.close()
    with fmu:
        assert fmu.get("ball.h") == 1.0


def test_names_are_checked_and_the_nearest_is_offered(file):
    with (
        pytest.raises(InputError, match=r"Stub.fmu: ball.H: no such variable; did you mean ball.h"),
        FmuSession(file, parameters={"ball.H": 1.0}),
    ):
        pass
    with (
        pytest.raises(InputError, match=r"y: a variable of causality output cannot be set"),
        FmuSession(file, parameters={"y": 1.0}),
    ):
        pass
    with FmuSession(file) as fmu:
        with pytest.raises(InputError, match=r"wieght: no such variable; did you mean weight"):
            fmu.get("wieght")
        with pytest.raises(
            InputError, match=r"m: cannot be set while the FMU runs; give it to reset\(parameters="
        ):
            fmu.set("m", 1.0)
        fmu.step(1e-3)  # none of this reached the FMU


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("k", -1.0, "k = -1 is refused: .* choose a finite value within 0..10 N.s/m"),
        ("f", float("nan"), "f = -?nan is refused"),
        ("f", float("inf"), "f = inf is refused"),
        ("f", "strong", "'strong' is no value of type"),
        ("f", None, "None is no value of type"),
        ("n", 1.5, "1.5 is no value of type"),
        ("n", 7, "n = 7 is refused"),
        ("on", 2, "2 is no value of type Boolean"),
    ],
)
def test_a_value_that_cannot_be_is_refused_and_the_session_goes_on(file, name, value, message):
    with FmuSession(file) as fmu:
        before = fmu.get(name)
        with pytest.raises(InputError, match=f"Stub.fmu: {name}: .*{message}"):
            fmu.set(name, value)
        assert fmu.get(name) == before
        fmu.step(1e-3)
    with pytest.raises(InputError, match=message), FmuSession(file, parameters={name: value}):
        pass


def test_an_enumeration_takes_its_literals(file):
    message = "medium: 'water' is no value of type Enumeration; use one of vacuum, air"
    with pytest.raises(InputError, match=message), FmuSession(file, parameters={"medium": "water"}):
        pass
    with FmuSession(file, parameters={"medium": 1}) as fmu:
        assert fmu.get("medium") == 1


def test_an_error_of_the_fmu_is_a_run_error_with_its_message_and_reset_mends_it(file):
    with (
        pytest.raises(RunError, match=r"Stub.fmu at t = 0 s: ball.h must be >= 0 at the start"),
        FmuSession(file, parameters={"ball.h": -1.0}),
    ):
        pass
    with FmuSession(file, stop_time=1.0) as fmu:
        fmu.step(0.5)
        saved = fmu.save_state()
        with pytest.raises(
            RunError,
            match=r"Stub.fmu at t = 0.5 s: fmi\dDoStep: a step to 1.5 s passes the stop time",
        ):
            fmu.step(1.0)
        assert fmu.get("time") == 0.5
        fmu.load_state(saved)
        fmu.step(0.5)
        with pytest.raises(RunError):
            fmu.step(0.5)
        fmu.reset()
        fmu.step(0.5)


def test_reset_replays_bit_for_bit_and_takes_new_parameters(file):
    def run(fmu: FmuSession) -> bytes:
        heights = []
        for k in range(200):
            fmu.set("f", np.sin(k))
            fmu.step(0.01, time=k * 0.01)
            heights.append(fmu.get("ball.h"))
        return np.array(heights).tobytes()

    with FmuSession(file, parameters={"k": 1.0}) as fmu:
        first = run(fmu)
        fmu.reset()
        assert run(fmu) == first
        fmu.reset({"k": 2.0})
        assert fmu.get("k") == 2.0
        assert run(fmu) != first
        with pytest.raises(InputError):
            fmu.reset({"k": -1.0})
        fmu.reset()  # the last good parameters
        assert fmu.get("k") == 2.0
        fmu.reset({})
        assert fmu.get("k") == 0.5


def test_states_are_saved_loaded_and_serialised(file):
    with FmuSession(file) as fmu, FmuSession(file) as other:
        fmu.step(0.6)
        state, data = fmu.save_state(), fmu.serialise()
        fmu.step(0.6)
        after = fmu.get(["ball.h", "ball.v", "bounces"]).tolist()
        fmu.load_state(state)
        assert fmu.time == fmu.get("time") == 0.6
        fmu.step(0.6)
        assert fmu.get(["ball.h", "ball.v", "bounces"]).tolist() == after
        other.load_state(other.deserialise(data))
        other.step(0.6)
        assert other.get(["ball.h", "ball.v", "bounces"]).tolist() == after
        assert fmu.save_state(into=state) is state
        with pytest.raises(RunError, match=r"not of this FMU session"):
            other.load_state(state)
        fmu.free_state(state)
        with pytest.raises(RunError, match=r"not of this FMU session"):
            fmu.load_state(state)


def test_bytes_that_are_no_state_are_refused(file):
    with FmuSession(file) as fmu:
        data = fmu.serialise()
        for bad in (b"", data[:10], b"x" + data[1:]):
            with pytest.raises(InputError, match=r"these bytes are no serialised FMU state"):
                fmu.deserialise(bad)
        with pytest.raises(InputError, match=r"damaged"):
            fmu.deserialise(data[:-1] + bytes([data[-1] ^ 1]))
        with pytest.raises(InputError, match=r"truncated"):
            fmu.deserialise(data[:-1])
        fmu.load_state(fmu.deserialise(data))
        fmu.step(0.1)


def test_the_jacobian_is_that_of_the_model(file):
    with FmuSession(file, parameters={"on": True, "n": 2, "m": 4.0}) as fmu:
        jacobian = fmu.jacobian(["der(ball.h)", "der(ball.v)", "y"], ["ball.h", "ball.v", "f"])
        assert jacobian == pytest.approx(np.array([[0, 1, 0], [0, -0.125, 0.5], [1, 0, 0.01]]))
        assert fmu.directional(["y"], ["ball.h", "f"], [2.0, 1.0]) == pytest.approx([2.01])


def test_a_model_exchange_session_integrates_with_events(file):
    with FmuSession(file, kind="me", parameters={"medium": "vacuum"}) as fmu:
        assert fmu.update_discrete().again is False
        fmu.enter_continuous()
        assert fmu.nominals().tolist() == [0.5, 1.5]
        x, t, h = fmu.states(), 0.0, 1e-4
        while fmu.indicators()[0] > 0:
            x = x + h * np.array([x[1] - 0.5 * h * 9.81, -9.81])
            t += h
            fmu.set_time(t)
            fmu.set_states(x)
            assert fmu.completed_step() == (False, False)
        assert fmu.derivatives().tolist() == [x[1], -9.81]
        fmu.enter_event()
        info = fmu.update_discrete()
        assert (info.states_changed, info.next_time) == (True, None)
        assert fmu.states() == pytest.approx([0.0, 0.7 * np.sqrt(2 * 9.81)], rel=1e-3)
        assert t == pytest.approx(np.sqrt(2 / 9.81), abs=1e-3)


def test_messages_are_collected_and_events_only_when_asked_for(file):
    with FmuSession(file) as quiet, FmuSession(file, log_events=True) as loud:
        quiet.step(1.0)
        loud.step(1.0)
        assert quiet.messages() == []
        assert ("logEvents", "ball hits the floor") in {m[1:] for m in loud.messages()}
        assert loud.messages() == []


@intrinsic
def _call_do_step(typing_context, address, component, time, step):
    """fmi2DoStep(component, time, step, 0) by its address."""

    def generate(context, builder, signature, arguments):
        from llvmlite import ir

        pointer = ir.IntType(8).as_pointer()
        kinds = [pointer, ir.DoubleType(), ir.DoubleType(), ir.IntType(32)]
        function = builder.inttoptr(
            arguments[0], ir.FunctionType(ir.IntType(32), kinds).as_pointer()
        )
        component_pointer = builder.inttoptr(arguments[1], pointer)
        return builder.call(
            function, [component_pointer, arguments[2], arguments[3], ir.IntType(32)(0)]
        )

    return types.int32(types.int64, types.int64, types.float64, types.float64), generate


def test_compiled_code_steps_the_instance_through_its_addresses():
    @njit
    def run(do_step, component, n):
        for k in range(n):
            if _call_do_step(do_step, component, k * 1e-3, 1e-3) != 0:
                return k
        return n

    with FmuSession(stub_fmu("2.0")) as fmu, FmuSession(stub_fmu("2.0")) as slow:
        raw = fmu.raw()
        assert all(address > 0 for address in raw)
        assert run(raw.do_step, raw.component, 700) == 700
        for k in range(700):
            slow.step(1e-3, time=k * 1e-3)
        assert fmu.get("ball.h") == slow.get("ball.h")
    with (
        FmuSession(stub_fmu("3.0")) as fmu,
        pytest.raises(InputError, match=r"compiled loops need FMI 2.0"),
    ):
        fmu.raw()


CYCLES = """
import gc, resource, sys
from pathlib import Path
from pyfmi_runner.fmu import FmuFile, FmuSession

file = FmuFile.read(Path(sys.argv[1]))

def cycle(n):
    for _ in range(n):
        with FmuSession(file, parameters={"m": 2.0}) as fmu:
            fmu.save_state()
            fmu.step(1e-3)
            fmu.get("y")
    gc.collect()

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

cycle(500)
before = resident()
cycle(3000)
print(resident() - before)
"""


def test_sessions_leave_no_memory_behind(path: Path) -> None:
    """In a process of its own: a worker's heap holds what other tests have left."""
    if not Path("/proc/self/statm").exists():
        pytest.skip("resident memory is read from /proc")
    told = subprocess.run(
        [sys.executable, "-c", CYCLES, str(path)], capture_output=True, text=True, check=True
    )
    assert int(told.stdout) < 2_000_000
