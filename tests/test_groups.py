"""On several workers a file's tests stay together, so that what they share is made once."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CONFTEST = """
import runpy
pytest_xdist_make_scheduler = runpy.run_path({path!r})["pytest_xdist_make_scheduler"]
"""
TESTS = """
import os
import pytest

@pytest.mark.parametrize("number", range(6))
def test_of_a_file(number):
    with open("workers.txt", "a") as seen:
        seen.write(f"{os.path.basename(__file__)} {os.environ['PYTEST_XDIST_WORKER']}\\n")
"""


def test_a_file_is_dealt_out_whole(tmp_path: Path) -> None:
    pytest.importorskip("xdist")
    hook = CONFTEST.format(path=str(ROOT / "tests" / "conftest.py"))  # and none of its fixtures
    (tmp_path / "conftest.py").write_text(hook, encoding="utf-8")
    files = [f"test_{letter}.py" for letter in "abcd"]
    for name in files:
        (tmp_path / name).write_text(TESTS, encoding="utf-8")
    words = ["-m", "pytest", "-q", "--numprocesses", "2", "--dist", "loadgroup"]
    words += ["-p", "no:cacheprovider", "--rootdir", str(tmp_path)]
    own = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
    own["PYTHONPATH"] = str(ROOT)
    done = subprocess.run(
        [sys.executable, *words, "."],
        cwd=tmp_path,
        env=own,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    seen = [line.split() for line in (tmp_path / "workers.txt").read_text().splitlines()]
    assert len(seen) == 24
    workers = {name: {worker for n, worker in seen if n == name} for name in files}
    assert all(len(found) == 1 for found in workers.values()), workers
    assert len(set().union(*workers.values())) == 2
