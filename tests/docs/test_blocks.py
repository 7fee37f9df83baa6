"""Every code block of the documents runs, on a tree that holds what is committed and nothing else.

A page's blocks run in their order in one folder. A comment before a block says otherwise:
`<!-- test: slow -->` runs with the slow tests only, `<!-- test: skip, REASON -->` never,
`<!-- test: same as FILE -->` is compared with a file. A block with a title is written to that file.
Commands of blocks that do not run are parsed all the same.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from pneugantry.cli import parser

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/index.md", *(f"docs/{kind}" for kind in (
    "tutorials", "how-to", "reference", "explanation", "results", "decisions")))  # fmt: skip
BLOCK = re.compile(
    r"(?:<!-- test: (?P<mark>[^>]*?) -->\n)?^```(?P<kind>\w+)(?: title=\"(?P<title>[^\"]+)\")?\n"
    r"(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
RUN = ("bash", "python")
CHECKED = ("toml", "json", "modelica")
LIBRARIES = ("libcosimpy", "ecospy", "gymnasium")  # extras; a page that lacks one skips


@dataclass(frozen=True)
class Block:
    """One fenced block of a page."""

    kind: str
    text: str
    title: str
    mark: str  # "", "slow", "skip, ...", "same as FILE"


def pages() -> list[Path]:
    found: list[Path] = []
    for name in PAGES:
        path = ROOT / name
        found += sorted(path.glob("*.md")) if path.is_dir() else [path]
    return [path for path in found if blocks(path)]


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [
        Block(m["kind"], m["text"], m["title"] or "", m["mark"] or "")
        for m in BLOCK.finditer(text)
        if m["kind"] != "text"
    ]


def commands(text: str) -> list[list[str]]:
    """The words of every `pneugantry` command of a block."""
    lines = text.replace("\\\n", " ").splitlines()
    return [shlex.split(line, comments=True) for line in lines if line.startswith("pneugantry ")]


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What git holds, copied: no FMU, no output, no cache of this checkout."""
    folder = tmp_path_factory.mktemp("fresh") / "tree"
    words = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(words, cwd=ROOT, capture_output=True, check=True).stdout
    for name in listed.decode().split("\0"):
        if name and (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, folder / name)
    # once: with PYTHONDONTWRITEBYTECODE each block would compile them anew
    subprocess.run([sys.executable, "-m", "compileall", "-q", str(folder)], check=False)
    program = folder / ".bin" / "pneugantry"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m pneugantry "$@"\n')
    program.chmod(0o755)
    return folder


def run(block: Block, tree: Path) -> subprocess.CompletedProcess[str]:
    own = os.environ | {
        "PYTHONPATH": str(tree),
        "PATH": os.pathsep.join([str(tree / ".bin"), str(Path(sys.executable).parent)])
        + os.pathsep
        + os.environ["PATH"],
        "MPLBACKEND": "agg",
    }
    words = ["bash", "-e", "-c"] if block.kind == "bash" else [sys.executable, "-c"]
    return subprocess.run(
        [*words, block.text], cwd=tree, env=own, capture_output=True, text=True, check=False
    )


def check(block: Block, tree: Path) -> None:
    """What a block that is data holds."""
    if block.mark.startswith("same as "):
        same = (ROOT / block.mark.removeprefix("same as ")).read_text(encoding="utf-8")
        assert block.text == same
    if block.kind == "toml":
        tomllib.loads(block.text)
    if block.kind == "json":
        json.loads(block.text)
    if block.title:
        (tree / block.title).parent.mkdir(parents=True, exist_ok=True)
        (tree / block.title).write_text(block.text, encoding="utf-8")


def run_page(page: Path, tree: Path, slow: bool) -> int:
    """Runs a page's blocks in order; returns how many ran."""
    count = 0
    for number, block in enumerate(blocks(page), start=1):
        where = f"{page.relative_to(ROOT)}, block {number}"
        if block.kind == "bash":
            for words in commands(block.text):
                parser(only=words[1]).parse_args(words[1:])
        check(block, tree)
        if block.kind not in RUN or block.mark.startswith("skip"):
            continue
        if block.mark == "slow" and not slow:
            continue
        done = run(block, tree)
        missing = [name for name in LIBRARIES if f"No module named '{name}" in done.stderr]
        if missing:
            pytest.skip(f"{where}: {missing[0]} is not installed")
        assert done.returncode == 0, f"{where}: {done.stdout[-500:]}\n{done.stderr[-2000:]}"
        count += 1
    return count


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.stem)
def test_the_blocks_of_a_page_run(page: Path, tree: Path) -> None:
    wanted = sum(b.kind in RUN and b.mark == "" for b in blocks(page))
    assert run_page(page, tree, slow=False) == wanted


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [p for p in pages() if any(b.mark == "slow" for b in blocks(p))], ids=lambda p: p.stem
)
def test_the_long_blocks_of_a_page_run(page: Path, tree: Path) -> None:
    assert run_page(page, tree, slow=True) > 0


def test_every_block_has_a_kind_that_is_tested_and_a_mark_that_is_known() -> None:
    counts = {"run": 0, "slow": 0, "skip": 0, "checked": 0}
    for page in pages():
        for block in blocks(page):
            assert block.kind in (*RUN, *CHECKED), (page, block.kind)
            known = block.mark in ("", "slow") or re.match(r"skip, .+|same as .+", block.mark)
            assert known, (page, block.mark)
            if block.kind in CHECKED:
                counts["checked"] += 1
            else:
                counts[block.mark.split(",")[0] or "run"] += 1
    print(counts)
    assert counts["run"] >= 15
    assert counts["run"] + counts["slow"] >= 35
    assert counts["skip"] <= 8


def test_no_fence_escapes_the_tests() -> None:
    for page in pages():
        text = page.read_text(encoding="utf-8")
        fences = re.findall(r"^```(\w*)", text, re.MULTILINE)
        opened = [kind for kind in fences if kind]
        assert len(fences) == 2 * len(opened), page
        assert len(opened) - opened.count("text") == len(blocks(page)), page
