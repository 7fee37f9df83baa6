"""The FMUs outside: binaries for four platforms, the glibc they need, their sources, other tools,
and what docs/tutorials/fmu-in-other-tools.md says.
"""

from __future__ import annotations

import json
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy.build
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from stub_model import STUB

from modelica_fmu import toolchain
from modelica_fmu.package import package_fmu
from pyfmi_runner.build import build_controller_fmu, build_fmu
from pyfmi_runner.fmu import FmuFile, FmuSession

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "tutorials" / "fmu-in-other-tools.md"
TEXT = PAGE.read_text(encoding="utf-8")
FOUR = ("x86_64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin")
ZIG = toolchain.importlib.util.find_spec("ziglang") is not None


def kind(binary: bytes) -> str:
    """What `file` would say: format and processor."""
    if binary[:4] == b"\x7fELF":
        return f"ELF {struct.unpack_from('<H', binary, 18)[0]}"  # 62: x86-64
    if binary[:2] == b"MZ":
        (header,) = struct.unpack_from("<I", binary, 60)
        return f"PE {struct.unpack_from('<H', binary, header + 4)[0]:#x}"  # 0x8664: x86-64
    return (
        f"Mach-O {struct.unpack_from('<II', binary)[1]:#x}"  # 0x1000007: x86-64, 0x100000c: arm64
    )


@pytest.mark.skipif(not ZIG, reason="ziglang is not installed")
def test_one_fmu_holds_four_platforms_and_the_linux_one_needs_no_newer_glibc_than_2_17(
    tmp_path: Path,
) -> None:
    path = package_fmu(STUB, "2.0", tmp_path / "Stub.fmu", FOUR)
    with zipfile.ZipFile(path) as archive:
        found = {n: archive.read(n) for n in archive.namelist() if n.startswith("binaries/")}
    assert {name: kind(binary) for name, binary in found.items()} == {
        "binaries/linux64/Stub_Ball.so": "ELF 62",
        "binaries/win64/Stub_Ball.dll": "PE 0x8664",
        "binaries/darwin64/Stub_Ball.dylib": "Mach-O 0x1000007",
        "binaries/aarch64-darwin/Stub_Ball.dylib": "Mach-O 0x100000c",
    }
    needed = toolchain.glibc_needed(found["binaries/linux64/Stub_Ball.so"])
    assert needed is not None
    assert tuple(map(int, needed.split("."))) <= (2, 17)
    assert (
        json.loads(path.with_suffix(".manifest.json").read_text())["compilers"]["linux64"]["glibc"]
        == needed
    )
    for name, binary in found.items():
        if shutil.which("file"):
            (tmp_path / "binary").write_bytes(binary)
            said = subprocess.run(
                ["file", "-b", tmp_path / "binary"], capture_output=True, text=True, check=True
            ).stdout
            assert re.match(
                {"so": "ELF 64-bit.*x86-64", "dll": "PE32.*x86-64", "dylib": "Mach-O 64-bit"}[
                    name.split(".")[-1]
                ],
                said,
            )


def test_the_glibc_that_a_binary_needs_is_that_of_its_symbols() -> None:
    fmu = build_fmu()
    needed = toolchain.glibc_needed(FmuFile.read(fmu.path).library("cs").read_bytes())
    if toolchain.host_platform().fmi3.endswith("linux") and shutil.which("objdump"):
        library = FmuFile.read(fmu.path).library("cs")
        said = subprocess.run(
            ["objdump", "-T", library], capture_output=True, text=True, check=True
        ).stdout
        versions = [tuple(map(int, v.split("."))) for v in re.findall(r"GLIBC_([0-9.]+)", said)]
        assert needed == ".".join(map(str, max(versions)))
    assert toolchain.glibc_needed(b"no symbols") is None


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.skipif(not shutil.which("cmake"), reason="cmake is not installed")
def test_the_sources_compile_without_a_warning_with_the_flags_of_fmpy(
    fmi: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = build_fmu(fmi=fmi).path  # type: ignore[arg-type]
    folder = Path(fmpy.extract(str(path), str(tmp_path / "fmu")))
    (binary,) = folder.glob("binaries/*/*")
    binary.unlink()
    fmpy.build.build_platform_binary(
        folder, configuration="Debug", all_warnings=True
    )  # -O0: the compiler takes seconds, not a minute
    said = "".join(capfd.readouterr())
    assert "warning:" not in said
    (rebuilt,) = [p for p in folder.glob("binaries/*/*") if p.suffix == binary.suffix]
    result = fmpy.simulate_fmu(
        str(folder), stop_time=0.3, output_interval=1e-3, start_values={"u_z": 1.05}, output=["z"]
    )
    assert rebuilt.is_file()
    assert result["z"][-1] > 1e-3


def test_fmu_manipulation_toolbox_opens_and_packs_it_again(tmp_path: Path) -> None:
    operations = pytest.importorskip("fmu_manipulation_toolbox.operations")
    path = build_fmu().path
    with operations.FMU(str(path)) as fmu:
        fmu.apply_operation(operations.OperationRemoveSources())
        fmu.repack(str(tmp_path / path.name))
    assert validate_fmu(str(tmp_path / path.name)) == []
    ends = []
    for file in (path, tmp_path / path.name):
        with FmuSession(file) as session:
            for k in range(300):
                session.set("u_z", 1.05)
                session.step(1e-3, time=k * 1e-3)
            ends.append(session.get("z"))
    assert ends[0] == ends[1]


@pytest.fixture(scope="module")
def snippets() -> list[str]:
    build_fmu(out=ROOT / "fmus")
    build_controller_fmu("pi_fv", out=ROOT / "fmus")
    found = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    return [text for text in found if "pi_fv" in text or "casadi" in text]  # beyond one FMU in fmpy


@pytest.mark.parametrize(
    ("number", "library"), [(0, "fmpy"), (1, "libcosimpy"), (2, "ecospy"), (3, "casadi")]
)
def test_a_snippet_of_the_portability_page_runs(
    number: int, library: str, snippets: list[str]
) -> None:
    assert library in snippets[number]
    done = subprocess.run(
        [sys.executable, "-c", snippets[number]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if "ModuleNotFoundError" in done.stderr or "ImportError" in done.stderr:
        pytest.skip(f"{library} is not installed")
    assert done.returncode == 0, done.stderr
    if library == "casadi":
        assert re.search(r"-3\.33333", done.stdout)
        return
    (f_n, z) = map(float, re.search(r"(\S+) N at (\S+) mm", done.stdout).groups())  # type: ignore[union-attr]
    expected = (
        (29.67, 42.967) if library == "fmpy" else (29.613, 42.9606)
    )  # the masters that step all at once are a sample late
    assert (f_n, z) == pytest.approx(expected, rel=1e-3)


def test_the_masters_that_step_all_at_once_agree_to_the_last_digit(snippets: list[str]) -> None:
    said = []
    for snippet in snippets[1:3]:
        done = subprocess.run(
            [sys.executable, "-c", snippet.replace(":.6f", "")],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            pytest.skip("libcosimpy or ecospy is not installed")
        said.append([float(v) for v in re.search(r"(\S+) N at (\S+) mm", done.stdout).groups()])  # type: ignore[union-attr]
    assert np.array(said[0]) == pytest.approx(said[1], rel=1e-12)
