"""Shell completion: what the scripts offer is what the parser takes."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from pneugantry.cli import COMMANDS, main, parser
from pneugantry.completion import SHELLS, completion_script

SHELLS_HERE = {"bash": ["bash", "-n"], "zsh": ["zsh", "-n"], "fish": ["fish", "--no-execute"]}


def offered(tmp_path: Path, *words: str) -> list[str]:
    """What bash offers for the last of `words`."""
    script = tmp_path / "completion"
    script.write_text(completion_script(parser(), "bash"))
    line = (
        f"source {script}; COMP_WORDS=({' '.join(repr(w) for w in words)}); "
        f"COMP_CWORD={len(words) - 1}; _pneugantry; "
    )
    done = subprocess.run(
        ["bash", "-c", line + 'printf "%s\\n" "${COMPREPLY[@]}"'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.skipif(not shutil.which("bash"), reason="bash is not installed")
def test_bash_completes_commands_options_choices_and_files(tmp_path: Path) -> None:
    assert offered(tmp_path, "pneugantry", "") == list(COMMANDS)
    assert offered(tmp_path, "pneugantry", "ro") == ["rootlocus"]
    assert {"--workpiece", "--controller", "--json"} <= set(
        offered(tmp_path, "pneugantry", "run", "--")
    )
    assert offered(tmp_path, "pneugantry", "build", "--fmi", "") == ["2.0", "3.0"]
    assert offered(tmp_path, "pneugantry", "completion", "f") == ["fish"]
    (tmp_path / "scenario.toml").touch()
    assert offered(tmp_path, "pneugantry", "run", "scen") == ["scenario.toml"]


@pytest.mark.parametrize("shell", SHELLS)
def test_a_script_names_every_command_and_the_shell_takes_it(
    shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(name in script for name in COMMANDS)
    assert script.count("controller") >= 1
    if shutil.which(SHELLS_HERE[shell][0]):
        (tmp_path / "script").write_text(script)
        subprocess.run([*SHELLS_HERE[shell], tmp_path / "script"], check=True)


def test_another_shell_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "csh"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
