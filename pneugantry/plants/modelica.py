"""A model extended with what was fitted, as a Modelica file and as the FMU built from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from modelica_fmu.errors import InputError
from modelica_fmu.files import write_atomically
from pyfmi_runner.build import build_fmu

__all__ = ["Extension", "nested", "write_extension"]


@dataclass(frozen=True)
class Extension:
    """`model NAME "TITLE"`: what extends a base class. modifiers: expressions of Modelica by path;
    remarks: lines of comment.
    """

    name: str
    title: str
    base: str
    modifiers: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def text(self, bare: bool = False) -> str:
        """As Modelica; bare: without the modifiers."""
        comments = "".join(f"  // {line}\n" for line in self.remarks)
        modifiers = "" if bare else _modifiers(nested(self.modifiers), 4)
        return (
            f'model {self.name} "{self.title}"\n{comments}  extends {self.base}{modifiers};\n'
            f"end {self.name};\n"
        )


def write_extension(
    folder: Path, extension: Extension, model: Path, starts: Mapping[str, float]
) -> tuple[Path, Path]:
    """Writes NAME.mo and its FMU into a folder; returns both paths. The FMU gets the values as
    start values, so that they stay parameters; model: the file of the base class. Raises InputError
    where the folder cannot be written.
    """
    path = folder / f"{extension.name}.mo"
    text = extension.text()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    except OSError as error:
        hint = "name a folder that can"
        raise InputError(f"cannot be written ({error.strerror})", file=folder, hint=hint) from None
    with TemporaryDirectory() as temporary:
        whole = Path(temporary) / path.name  # the compiler takes one file
        base = model.read_text(encoding="utf-8")
        whole.write_text(f"{base}\n{extension.text(bare=True)}", encoding="utf-8")
        return path, build_fmu(extension.name, whole, out=folder, starts=starts).path


def nested(values: Mapping[str, str]) -> dict[str, object]:
    """Values of dotted paths by the components that they lie in, as Modelica writes them."""
    tree: dict[str, object] = {}
    for path, value in values.items():
        *parents, leaf = path.split(".")
        node = tree
        for parent in parents:
            node = node.setdefault(parent, {})  # type: ignore[assignment]
        node[leaf] = value
    return tree


def _modifiers(tree: Mapping[str, object], indent: int) -> str:
    if not tree:
        return ""
    texts = {
        name: _modifiers(sub, indent + 2) if isinstance(sub, Mapping) else f" = {sub}"
        for name, sub in tree.items()
    }
    entries = [f"{' ' * indent}{name}{text}" for name, text in texts.items()]
    return "(\n" + ",\n".join(entries) + ")"
