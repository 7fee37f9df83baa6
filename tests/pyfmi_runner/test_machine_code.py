"""Machine code kept on disk: used again, never with a source that has changed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from numba.core import config
from numba.extending import register_jitable

from pyfmi_runner import machine_code
from pyfmi_runner.machine_code import kept, source_stamp


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty cache, and a copy of the sources in place of the packages."""
    monkeypatch.setenv("PNEUGANTRY_CACHE", str(tmp_path / "cache"))
    for name in machine_code.PACKAGES:
        (tmp_path / name).mkdir()
        (tmp_path / name / "part.py").write_text("GAIN = 2.0\n")
    monkeypatch.setattr(machine_code, "HERE", tmp_path)
    source_stamp.cache_clear()
    yield tmp_path
    source_stamp.cache_clear()


@register_jitable
def twice(x):  # type: ignore[no-untyped-def]
    return 2.0 * x


def hits(part=twice) -> int:  # type: ignore[no-untyped-def]
    """How often a freshly made function found its machine code."""

    def call(x):  # type: ignore[no-untyped-def]
        return part(x) + 1.0

    compiled = kept(call, part)
    assert compiled(3.0) == 7.0
    return sum(compiled.stats.cache_hits.values())  # type: ignore[attr-defined]


def own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(twice, "__module__", "controllers.twice")


def test_machine_code_is_made_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own(monkeypatch)
    assert (hits(), hits()) == (0, 1)
    assert list((folder / "cache" / "machine_code").rglob("*.nbc"))


def test_each_part_has_an_index_of_its_own(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two processes that write to one index at once may mix up what they keep."""

    @register_jitable
    def doubled(x):  # type: ignore[no-untyped-def]
        return x + x

    own(monkeypatch)
    monkeypatch.setattr(doubled, "__module__", "controllers.doubled")
    assert (hits(), hits(doubled), hits(), hits(doubled)) == (0, 0, 1, 1)
    assert len(list(folder.rglob("*.nbi"))) == 2


@pytest.mark.parametrize("change", ["text", "name", "more"])
def test_a_source_that_changes_makes_it_anew(
    change: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own(monkeypatch)
    hits()
    part = folder / "controllers" / "part.py"
    if change == "text":
        part.write_text("GAIN = 3.0\n")
    elif change == "name":
        part.rename(part.with_name("other.py"))
    else:
        part.with_name("other.py").write_text("")
    source_stamp.cache_clear()
    assert (hits(), hits()) == (0, 1)


def test_nothing_is_kept_with_a_part_from_elsewhere(folder: Path) -> None:
    assert (hits(), hits()) == (0, 0)
    assert not list(folder.rglob("*.nbc"))


def test_a_cache_that_cannot_be_written_is_done_without(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own(monkeypatch)
    (folder / "cache").write_text("a file")
    assert (hits(), hits()) == (0, 0)


def test_numba_keeps_its_own_ways_for_others(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own(monkeypatch)
    before = config.CACHE_LOCATOR_CLASSES
    hits()
    assert before == config.CACHE_LOCATOR_CLASSES
