"""The two ways in which a command ends badly: unusable input (exit 2) and a run that could not
finish (exit 1).
"""

from __future__ import annotations

import os

__all__ = ["InputError", "RunError"]


def _one_line(text: object) -> str:
    return " ".join(str(text).split())


class InputError(Exception):
    """Unusable input; `str()` is one line `file: field: message; hint`, parts that are not known
    left out.

    message: what is wrong, with the value that was got; file: path of the file at fault; field:
    column or key in it; hint: what the user does about it, in the imperative.
    """

    def __init__(
        self,
        message: str,
        *,
        file: str | os.PathLike[str] | None = None,
        field: str | None = None,
        hint: str | None = None,
    ) -> None:
        super().__init__(message)
        self.message = _one_line(message)
        self.file = None if file is None else os.fspath(file)
        self.field = field
        self.hint = hint

    def __str__(self) -> str:
        where = "".join(f"{_one_line(part)}: " for part in (self.file, self.field) if part)
        return where + self.message + (f"; {_one_line(self.hint)}" if self.hint else "")


class Undecided(InputError):
    """What must be known while compiling depends on parameters: on those of `names`, scalars that
    can be fixed.
    """

    def __init__(self, told: InputError, names: frozenset[str]) -> None:
        super().__init__(told.message, file=told.file, field=told.field, hint=told.hint)
        self.names = names


class RunError(Exception):
    """A run that could not finish; `str()` is one line that says why."""

    def __str__(self) -> str:
        return _one_line(super().__str__())
