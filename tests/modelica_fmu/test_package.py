"""The FMU file: reproducible, complete, and read by other tools."""

import ctypes
import hashlib
import json
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import fmpy
import fmpy.build
import numpy as np
import pytest
from stub_model import STUB, stub_fmu

from modelica_fmu import package, toolchain
from modelica_fmu.errors import InputError
from modelica_fmu.package import package_fmu
from pyfmi_runner.fmu import FmuFile, FmuSession

INPUTS = {"Stub.Ball": "f", "PneuGantry.Gantry": "u_x"}


def trajectory(path: Path, steps: int = 500) -> dict[str, float]:
    """Real outputs after `steps` ms with one input at 2."""
    with FmuSession(path, parameters={}) as fmu:
        outputs = [n for n in fmu.file.description.outputs if fmu.file.variables[n].is_real]
        for k in range(steps):
            fmu.set(INPUTS[fmu.file.description.model], 2.0)
            fmu.step(1e-3, time=k * 1e-3)
        return dict(zip(outputs, fmu.get(outputs), strict=True))


def test_identical_builds_are_identical_bytes(fmi, tmp_path):
    first = package_fmu(STUB, fmi, tmp_path / "a" / "Stub.fmu")
    second = package_fmu(STUB, fmi, tmp_path / "b" / "Stub.fmu")
    assert first.read_bytes() == second.read_bytes()
    assert (
        first.with_suffix(".manifest.json").read_bytes()
        == second.with_suffix(".manifest.json").read_bytes()
    )


def test_another_model_has_another_token(fmi, tmp_path):
    changed = replace(STUB, sources=STUB.sources | {"model.c": STUB.sources["model.c"] + "\n"})
    described = replace(STUB, description="Another")
    tokens = {
        json.loads(
            package_fmu(model, fmi, tmp_path / "x.fmu").with_suffix(".manifest.json").read_text()
        )["token"]
        for model in (STUB, changed, described)
    }
    assert len(tokens) == 3


def test_the_archive_holds_description_binary_and_sources(stub, fmi):
    with zipfile.ZipFile(stub) as archive:
        names = archive.namelist()
        assert archive.testzip() is None
    target = toolchain.host_platform()
    assert names[0] == "modelDescription.xml"
    assert f"binaries/{target.folder(fmi)}/Stub_Ball{target.extension}" in names
    assert {
        "sources/core.h",
        "sources/model.c",
        f"sources/fmi{fmi[0]}.c",
        "documentation/index.html",
    } <= set(names)
    assert f"sources/fmi{5 - int(fmi[0])}.c" not in names


def test_the_manifest_says_what_it_was_made_of(stub, fmi):
    manifest = json.loads(stub.with_suffix(".manifest.json").read_text())
    with zipfile.ZipFile(stub) as archive:
        assert manifest["sha256"] == {
            n: hashlib.sha256(archive.read(n)).hexdigest() for n in archive.namelist()
        }
    assert manifest["fmi"] == fmi
    assert manifest["token"] == FmuFile.read(stub).description.token
    (compiler,) = manifest["compilers"].values()
    assert "-ffp-contract=off" in compiler["flags"]
    assert not any("fast-math" in flag for flag in compiler["flags"])


def test_a_failed_build_leaves_the_old_file(tmp_path):
    path = package_fmu(STUB, "2.0", tmp_path / "Stub.fmu")
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"could not compile the model.*no_such_thing"):
        package_fmu(
            replace(STUB, sources=STUB.sources | {"model.c": "int x = no_such_thing;"}), "2.0", path
        )
    assert path.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["Stub.fmu", "Stub.manifest.json"]


def test_a_build_that_is_killed_between_its_files_leaves_no_manifest_of_the_old_one(
    tmp_path, monkeypatch
):
    path = package_fmu(STUB, "2.0", tmp_path / "Stub.fmu")
    write = package._write

    def killed(target, data):
        if target.suffix == ".json":
            raise KeyboardInterrupt
        write(target, data)

    monkeypatch.setattr(package, "_write", killed)
    with pytest.raises(KeyboardInterrupt):
        package_fmu(replace(STUB, description="Another"), "2.0", path)
    assert FmuFile.read(path).description.model == "Stub.Ball"
    assert not path.with_suffix(
        ".manifest.json"
    ).exists()  # so that the next build does not take the new FMU for the old one


def test_only_fmi_functions_are_exported(stub, fmi, tmp_path):
    library = FmuFile.read(stub).library("cs")
    symbols = subprocess.run(
        ["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True
    ).stdout
    names = {line.split()[-1] for line in symbols.splitlines()}
    assert names
    assert all(name.startswith(f"fmi{fmi[0]}") for name in names)


def test_no_compiler_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    find_spec = toolchain.importlib.util.find_spec
    monkeypatch.setattr(
        toolchain.importlib.util, "find_spec", lambda n: None if n == "ziglang" else find_spec(n)
    )
    with pytest.raises(
        InputError, match=r"no C compiler for .*pip install ziglang, or install gcc"
    ):
        package_fmu(STUB, "2.0", tmp_path / "Stub.fmu")


def test_a_wrong_cc_variable_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("CC", "no-such-cc")
    with pytest.raises(InputError, match=r"CC: no compiler 'no-such-cc'"):
        package_fmu(STUB, "2.0", tmp_path / "Stub.fmu")


def test_an_unknown_platform_or_version_is_refused(tmp_path):
    with pytest.raises(
        InputError, match=r"--platform: unknown platform 'amiga'; use one of x86_64-linux"
    ):
        package_fmu(STUB, "2.0", tmp_path / "Stub.fmu", ["amiga"])
    with pytest.raises(InputError, match=r"--fmi: unknown FMI version '1.0'"):
        package_fmu(STUB, "1.0", tmp_path / "Stub.fmu")


@pytest.mark.skipif(
    not toolchain.importlib.util.find_spec("ziglang"), reason="ziglang is not installed"
)
@pytest.mark.parametrize("name", ["x86_64-windows", "x86_64-darwin", "aarch64-darwin"])
def test_zig_builds_for_other_platforms(name, fmi, tmp_path):
    target = toolchain.find_platform(name)
    path = package_fmu(STUB, fmi, tmp_path / "Stub.fmu", [name])
    with zipfile.ZipFile(path) as archive:
        binary = archive.read(f"binaries/{target.folder(fmi)}/Stub_Ball{target.extension}")
    assert binary[:4] in (b"MZ\x90\x00", b"MZ\x78\x00", b"\xcf\xfa\xed\xfe")


# ---- other importers ----


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_fmpy_simulates_it(fmu, kind):
    file = FmuFile.read(fmu)
    outputs = [n for n in file.description.outputs if file.variables[n].is_real]
    result = fmpy.simulate_fmu(
        str(fmu),
        fmi_type=kind,
        stop_time=0.5,
        step_size=1e-3 if kind == "CoSimulation" else None,
        output_interval=1e-3,
        relative_tolerance=1e-9,
        start_values={INPUTS[file.description.model]: 2.0},
        output=outputs,
    )
    expected = trajectory(fmu)
    assert result["time"][-1] == pytest.approx(0.5)
    for name in outputs:
        values = np.asarray(result[name])
        assert values[-1] == pytest.approx(
            expected[name], abs=1e-3 * max(1.0, abs(values).max())
        ), name


def test_fmpy_builds_and_simulates_it_from_its_sources(fmi, tmp_path):
    folder = fmpy.extract(str(stub_fmu(fmi)), str(tmp_path / "fmu"))
    for library in Path(folder).glob("binaries/*/*"):
        library.unlink()
    fmpy.build.build_platform_binary(folder)
    result = fmpy.simulate_fmu(
        str(folder), fmi_type="CoSimulation", stop_time=0.5, step_size=1e-3, output=["y"]
    )
    assert result["y"][-1] != 1.0


def test_libcosim_runs_the_co_simulation(fmu2):
    pytest.importorskip("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    expected = trajectory(fmu2)
    file = FmuFile.read(fmu2)
    execution = CosimExecution.from_step_size(1_000_000)
    index = execution.add_local_slave(CosimLocalSlave(str(fmu2), "it"))
    override, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    assert execution.add_manipulator(override)
    assert execution.add_observer(observer)
    override.slave_real_values(
        index, [file.variables[INPUTS[file.description.model]].reference], [2.0]
    )
    assert execution.step(500)
    got = observer.last_real_values(index, [file.variables[n].reference for n in expected])
    assert got == pytest.approx(list(expected.values()), rel=1e-9, abs=1e-9)


def test_ecos_runs_the_co_simulation(fmu2):
    tbb = Path(sys.prefix) / "lib" / "libtbb.so.12"
    if tbb.is_file():  # where the wheel of tbb puts it, which the loader does not search
        ctypes.CDLL(str(tbb), ctypes.RTLD_GLOBAL)
    ecospy = pytest.importorskip("ecospy", exc_type=(ImportError, OSError))
    expected = trajectory(fmu2)
    structure = ecospy.EcosSimulationStructure()
    structure.add_model("it", str(fmu2))
    with ecospy.EcosSimulation(structure=structure, step_size=1e-3) as simulation:
        simulation.init()
        simulation.set_real(f"it::{INPUTS[FmuFile.read(fmu2).description.model]}", 2.0)
        simulation.step(500)
        got = [simulation.get_real(f"it::{name}") for name in expected]
        simulation.terminate()
    assert got == pytest.approx(list(expected.values()), rel=1e-9, abs=1e-9)


def test_casadi_imports_the_model_exchange_and_its_jacobian(fmu):
    casadi = pytest.importorskip("casadi")
    builder = casadi.DaeBuilder("it", str(fmu))
    function = builder.create("f", ["x", "u"], ["ode"])
    with FmuSession(fmu, kind="me") as session:
        session.update_discrete()
        session.enter_continuous()
        description, x, dx = session.file.description, session.states(), session.derivatives()
        u = [session.get(name) for name in builder.u()]
        expected = session.jacobian(description.derivatives, description.states)
    assert tuple(builder.x()) == description.states
    assert np.array(function(x, u)).ravel() == pytest.approx(dx)
    xs, us = casadi.MX.sym("x", len(x)), casadi.MX.sym("u", len(u))
    jacobian = casadi.Function("J", [xs, us], [casadi.jacobian(function(xs, us), xs)])
    assert np.array(jacobian(x, u)) == pytest.approx(expected)
