"""What stands at the path of a result stays what it is: links, pipes, devices, folders."""

from __future__ import annotations

import os
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from modelica_fmu.errors import InputError
from modelica_fmu.files import check_folder, check_source, check_target, write_atomically

needs_posix = pytest.mark.skipif(os.name != "posix", reason="links, pipes and devices of POSIX")


def put(path: Path, text: str = "whole\n") -> None:
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def test_a_file_and_its_folders_are_made(tmp_path: Path) -> None:
    put(tmp_path / "a" / "b" / "c.txt")
    assert (tmp_path / "a" / "b" / "c.txt").read_text(encoding="utf-8") == "whole\n"
    assert [p.name for p in (tmp_path / "a" / "b").iterdir()] == ["c.txt"]


def test_a_failing_writer_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "c.txt"
    put(path, "old")

    def fail(temporary: Path) -> None:
        temporary.write_text("half", encoding="utf-8")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, fail)
    assert path.read_text(encoding="utf-8") == "old"
    assert len(list(tmp_path.iterdir())) == 1


@needs_posix
@pytest.mark.parametrize("there", [True, False])
def test_a_link_is_followed_and_stays_a_link(tmp_path: Path, there: bool) -> None:
    real, link = tmp_path / "folder" / "real.txt", tmp_path / "link.txt"
    real.parent.mkdir()
    if there:
        put(real, "old")
    link.symlink_to(real)
    check_target(link)
    put(link)
    assert link.is_symlink()
    assert real.read_text(encoding="utf-8") == "whole\n"


@needs_posix
def test_the_old_file_s_permissions_stay(tmp_path: Path) -> None:
    path = tmp_path / "private.txt"
    put(path, "old")
    path.chmod(0o600)
    put(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


@needs_posix
def test_a_pipe_is_written_through(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    check_target(pipe)
    got: list[str] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_text(encoding="utf-8")))
    reader.start()
    put(pipe)
    reader.join(timeout=10)
    assert got == ["whole\n"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_device_stays_a_device() -> None:
    put(Path("/dev/null"))
    with pytest.raises(InputError, match="/dev/full: cannot be written"):
        put(Path("/dev/full"))
    for device in ("/dev/null", "/dev/full"):
        assert stat.S_ISCHR(os.stat(device).st_mode)


@pytest.mark.skipif(not Path("/dev/stdout").exists(), reason="no /dev/stdout here")
def test_standard_output_goes_on_where_it_was(tmp_path: Path) -> None:
    """Replacing /dev/stdout that is sent to a file would cut the file off what is printed later."""
    script = (
        "from modelica_fmu.files import write_atomically\n"
        "print('before')\n"
        "write_atomically('/dev/stdout', lambda p: p.write_text('result\\n'))\n"
        "print('after')\n"
    )
    out = tmp_path / "out.txt"
    with out.open("wb") as stream:
        subprocess.run([sys.executable, "-c", script], stdout=stream, check=True)
    assert out.read_text(encoding="utf-8") == "before\nresult\nafter\n"


@needs_posix
def test_a_socket_and_a_folder_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # a socket's path must be short
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("s")
        for ask in (put, check_target):
            with pytest.raises(InputError, match="is a socket"):
                ask(Path("s"))
    for ask in (put, check_target):
        with pytest.raises(InputError, match="is a folder"):
            ask(tmp_path)


@needs_posix
@pytest.mark.parametrize("path", ["file/x.html", "file/below/x.html", "a\0b"])
def test_a_place_that_cannot_be_written_is_known_beforehand(tmp_path: Path, path: str) -> None:
    (tmp_path / "file").touch()
    for ask in (put, check_target):
        with pytest.raises(InputError, match="cannot be written"):
            ask(tmp_path / path)


def test_asking_leaves_nothing_behind(tmp_path: Path) -> None:
    check_target(tmp_path / "new" / "page.html")
    check_folder(tmp_path / "new")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="no file can be written there"):
        check_folder(tmp_path / "file")


@needs_posix
def test_a_source_that_has_no_end_is_refused(tmp_path: Path) -> None:
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    with pytest.raises(InputError, match=r"zero\.csv: is a device, expected a file"):
        check_source(tmp_path / "zero.csv")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe: is a pipe, expected a file"):
        check_source(tmp_path / "pipe")


@needs_posix
def test_a_source_that_ends_is_not_refused(tmp_path: Path) -> None:
    """Nor what is absent or a folder: whoever reads it says more."""
    (tmp_path / "a").touch()
    os.mkfifo(tmp_path / "pipe")
    check_source(tmp_path / "pipe", pipes=True)
    for path in (tmp_path / "a", tmp_path / "absent", tmp_path, "a\0b"):
        check_source(path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "pipe"]
