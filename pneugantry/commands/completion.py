"""`pneugantry completion`."""

from __future__ import annotations

import argparse
from typing import Any

from pneugantry.completion import SHELLS, completion_script

HELP = """Print the completion script of a shell: commands, options and their choices.

  source <(pneugantry completion bash)
  pneugantry completion zsh > ~/.zfunc/_pneugantry
  pneugantry completion fish > ~/.config/fish/completions/pneugantry.fish"""


def add_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("shell", choices=tuple(SHELLS))


def execute(options: argparse.Namespace) -> tuple[dict[str, Any], int]:
    from pneugantry.cli import parser  # which imports this module

    script = completion_script(parser(), options.shell)
    print(script, end="")
    return {"schema": "completion/1", "shell": options.shell, "script": script}, 0
