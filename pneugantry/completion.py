"""Completion scripts for bash, zsh and fish, from the command line's own parser: commands, options,
their choices, else file names.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import NamedTuple

__all__ = ["SHELLS", "completion_script"]


class Option(NamedTuple):
    names: tuple[str, ...]
    help: str
    choices: tuple[str, ...]
    takes_value: bool


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script for one of SHELLS. Raises KeyError for another."""
    return SHELLS[shell](
        parser.prog,
        {name: (about, list(_options(command))) for name, about, command in _commands(parser)},
    )


def _commands(
    parser: argparse.ArgumentParser,
) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            about = {choice.dest: choice.help or "" for choice in action._choices_actions}
            for name, text in about.items():  # aliases are not offered
                yield name, _plain(text), action.choices[name]


def _options(command: argparse.ArgumentParser) -> Iterator[Option]:
    for action in command._actions:
        choices = tuple(str(c) for c in action.choices or ())
        if action.option_strings or choices:
            yield Option(
                tuple(action.option_strings), _plain(action.help or ""), choices, action.nargs != 0
            )


def _plain(text: str) -> str:
    """One line without what a shell's quotes would trip over."""
    words = " ".join(
        text.replace("%%", "%").replace("%(default)s", "...").replace(": ", ", ").split()
    )
    return "".join(c for c in words if c not in "'\"`$\\[]:")


Commands = dict[str, tuple[str, list[Option]]]


def _bash(prog: str, commands: Commands) -> str:
    cases, values = [], []
    for name, (_, options) in commands.items():
        words = [n for o in options for n in o.names] + [
            c for o in options if not o.names for c in o.choices
        ]
        cases.append(f"        {name}) words='{' '.join(words)}' ;;")
        values += [
            f"        {name}:{n}) words='{' '.join(o.choices)}' ;;"
            for o in options
            if o.choices
            for n in o.names
        ]
    return f"""# bash completion of {prog}: put it where your completions are, or
# `source <({prog} completion bash)`
_{prog}() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}}
    local command=${{COMP_WORDS[1]}} words=
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W '{" ".join(commands)}' -- "$word"))
        return
    fi
    case "$command:$before" in
{chr(10).join(values)}
    esac
    if [ -z "$words" ]; then
        case "$command" in
{chr(10).join(cases)}
        esac
        case "$word" in
        -*) ;;
        *) COMPREPLY=($(compgen -f -- "$word")) ;;
        esac
    fi
    COMPREPLY+=($(compgen -W "$words" -- "$word"))
}}
complete -o filenames -F _{prog} {prog}
"""


def _zsh(prog: str, commands: Commands) -> str:
    listed = "\n".join(f"        '{name}:{about}'" for name, (about, _) in commands.items())
    cases = []
    for name, (_, options) in commands.items():
        arguments = [f"'{n}[{o.help}]{_zsh_value(o)}'" for o in options for n in o.names]
        arguments += [f"'1: :({' '.join(o.choices)})'" for o in options if not o.names] or [
            "'*: :_files'"
        ]
        cases.append(f"    {name}) _arguments {' '.join(arguments)} ;;")
    return f"""#compdef {prog}
# zsh completion of {prog}: save it as _{prog} in a folder of $fpath
_{prog}() {{
    local -a commands=(
{listed}
    )
    if (( CURRENT == 2 )); then
        _describe command commands
        return
    fi
    local command=$words[2]
    shift words
    (( CURRENT-- ))
    case $command in
{chr(10).join(cases)}
    esac
}}
compdef _{prog} {prog}
"""


def _zsh_value(option: Option) -> str:
    if not option.takes_value:
        return ""
    return f": :({' '.join(option.choices)})" if option.choices else ": :_files"


def _fish(prog: str, commands: Commands) -> str:
    lines = [f"# fish completion of {prog}: save it as ~/.config/fish/completions/{prog}.fish"]
    for name, (about, options) in commands.items():
        lines.append(f"complete -c {prog} -n __fish_use_subcommand -f -a {name} -d '{about}'")
        when = f"complete -c {prog} -n '__fish_seen_subcommand_from {name}'"
        for o in options:
            names = " ".join(
                f"-l {n[2:]}" if n.startswith("--") else f"-s {n[1:]}" for n in o.names
            )
            chosen = (
                f" -x -a '{' '.join(o.choices)}'" if o.choices else " -r" if o.takes_value else ""
            )
            lines.append(
                f"{when} {names}{chosen} -d '{o.help}'"
                if names
                else f"{when} -f -a '{' '.join(o.choices)}'"
            )
    return "\n".join(lines) + "\n"


SHELLS = {"bash": _bash, "zsh": _zsh, "fish": _fish}
