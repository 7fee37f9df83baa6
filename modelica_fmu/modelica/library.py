"""Where classes come from: the file to compile, and folders of packages (section 13)."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from modelica_fmu.errors import InputError
from modelica_fmu.ir import Place
from modelica_fmu.modelica.grammar import parse
from modelica_fmu.modelica.syntax import ClassDef, Import

MODELICAPATH = "MODELICAPATH"
TABLES = Path(__file__).with_name("tables.mo")  # classes that replace ones written in C
REPLACEMENTS = {  # where they stand, and the class that tells of what file
    (("Modelica", "Blocks"), ""): TABLES,
    (("Modelica",), "Math"): Path(__file__).with_name("matrices.mo"),
}


class Library:
    """Classes by name; files are read when a name in them is asked for, each once.

    roots: files, package folders (with a package.mo) or folders of these.
    """

    def __init__(self, roots: Iterable[Path], model: Path | None = None) -> None:
        self.files: list[Path] = []  # all that were read
        self._top: dict[str, ClassDef] = {}
        self._folders: dict[int, Path] = {}  # id of a class -> the folder of its children
        self._missing: dict[tuple[int, str], None] = {}
        self.model_classes: list[tuple[str, ...]] = []  # full names in the file to compile
        self._roots = [*_packages_around(model), *map(Path, roots), *_modelica_path()]
        for root in self._roots:
            if not root.exists():
                raise InputError("no such library", file=root, hint="give a folder or a .mo file")
        if model is not None:
            self._read_model(model)

    def top(self, name: str) -> ClassDef | None:
        """A class that lies in no other."""
        if name not in self._top:
            found = self._find_top(name)
            if found is None:
                return None
            self._top[name] = found
        return self._top[name]

    def top_names(self) -> list[str]:
        return list(self._top)

    def child(self, of: ClassDef, name: str) -> ClassDef | None:
        """A class that lies in a package: in its text, or in its folder."""
        for element in of.elements:
            if isinstance(element, ClassDef) and element.name == name:
                return element
        folder = self._folders.get(id(of))
        if folder is None or (id(of), name) in self._missing:
            return None
        found = self._from_folder(folder, name)
        if found is None:
            self._missing[id(of), name] = None
        else:
            of.elements.append(found)
        return found

    def children(self, of: ClassDef) -> list[str]:
        """Names of all classes in a package, in the order of its text, then of its folder."""
        names = [e.name for e in of.elements if isinstance(e, ClassDef)]
        folder = self._folders.get(id(of))
        if folder is not None:
            listed = folder / "package.order"
            ordered = listed.read_text(encoding="utf-8").split() if listed.is_file() else []
            there = sorted(p.stem for p in folder.iterdir() if p.suffix == ".mo" or _is_package(p))
            names += [n for n in [*ordered, *there] if n not in names and n != "package"]
        return [n for n in dict.fromkeys(names) if self.child(of, n) is not None]

    def _read_model(self, model: Path) -> None:
        within, classes = self._parse(model)
        holder: ClassDef | None = None
        for name in within:
            above = holder
            holder = self.top(name) if above is None else self.child(above, name)
            if holder is None:
                holder = ClassDef(Place(model, 1), "package", name)
                if above is None:
                    self._top[name] = holder
                else:
                    above.elements.append(holder)
        for made in classes:
            self.model_classes.append((*within, made.name))
            if holder is None:
                if made.name in self._top:
                    raise twice(made)
                self._top[made.name] = made
                if model.name == "package.mo":
                    self._folders[id(made)] = model.parent
            elif made.name not in holder.classes:
                holder.elements.append(made)
                if model.name == "package.mo":
                    self._folders[id(made)] = model.parent

    def _find_top(self, name: str) -> ClassDef | None:
        for root in self._roots:
            if root.is_file():
                found = next((c for c in self._parse(root)[1] if c.name == name), None)
            elif _package_name(root) == name:
                found = self._package(root, name)
            elif (root / "package.mo").is_file():
                found = None
            else:
                found = self._from_folder(root, name)
            if found is not None:
                return found
        return None

    def _from_folder(self, folder: Path, name: str) -> ClassDef | None:
        if (folder / f"{name}.mo").is_file():
            classes = self._parse(folder / f"{name}.mo")[1]
            return next((c for c in classes if c.name == name), None)
        inner = next((p for p in (folder / name,) if p.is_dir()), None)
        if inner is None:  # "Modelica 4.0.0" holds Modelica
            versions = [p for p in folder.glob(f"{name} *") if (p / "package.mo").is_file()]
            inner = max(versions, default=None)
        return self._package(inner, name) if inner is not None and _is_package(inner) else None

    def _package(self, folder: Path, name: str) -> ClassDef:
        text = folder / "package.mo"
        if text.is_file():
            made = next((c for c in self._parse(text)[1] if c.name == name), None)
            if made is None:
                raise InputError(
                    f"holds no package {name}", file=text, hint="name it as its folder"
                )
        else:
            made = ClassDef(Place(folder, 1), "package", name)
        self._folders[id(made)] = folder
        return made

    def _parse(self, file: Path) -> tuple[tuple[str, ...], list[ClassDef]]:
        self.files.append(file)
        within, classes = parse(read_text(file), file)
        names = [c.name for c in classes]
        for made in classes:
            if names.count(made.name) > 1:
                raise twice(made)
            _refuse_double_names(made)
        for (place, name), by in REPLACEMENTS.items():
            if tuple(within) == place and name in ("", *names):
                replacements = {c.name: c for c in parse(read_text(by), by)[1]}
                for made in classes:
                    if made.name in replacements:
                        _replace(made, replacements[made.name])
        return within, classes


def _replace(made: ClassDef, by: ClassDef) -> None:
    """Puts the classes of a package in the place of those of the same names in another one."""
    ours = {e.name: e for e in by.elements if isinstance(e, ClassDef)}
    for k, element in enumerate(made.elements):
        if isinstance(element, ClassDef) and element.name in ours:
            other = ours.pop(element.name)
            if other.kind == "package":
                _replace(element, other)
            else:
                made.elements[k] = other
    made.elements += ours.values()


def read_text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(
            "no such Modelica file", file=file, hint="give the path with --model"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"cannot be read as UTF-8 text ({error})", file=file, hint="give a Modelica file"
        ) from None


def twice(made: ClassDef) -> InputError:
    where = f"{made.place.file}:{made.place.line}"
    return InputError(f"there are two classes {made.name}", file=where, hint="rename one")


def _refuse_double_names(made: ClassDef) -> None:
    seen: set[str] = set()
    for element in made.elements:
        if isinstance(element, ClassDef):
            _refuse_double_names(element)
            if element.name in seen and "redeclare" not in element.prefixes:
                raise twice(element)
            seen.add(element.name)
        elif not isinstance(element, Import) and hasattr(element, "name"):
            if element.name in seen:
                where = f"{element.place.file}:{element.place.line}"
                said = f"{element.name} is declared twice"
                raise InputError(said, file=where, hint="rename one")
            seen.add(element.name)


def _package_name(folder: Path) -> str:
    return folder.resolve().name.split(" ")[0] if (folder / "package.mo").is_file() else ""


def _is_package(folder: Path) -> bool:
    return folder.is_dir() and ((folder / "package.mo").is_file() or any(folder.glob("*.mo")))


def _packages_around(model: Path | None) -> list[Path]:
    """The outermost package folder that a file inside a library lies in."""
    if model is None or not model.is_file():
        return []
    folder, outermost = model.resolve().parent, None
    if model.name == "package.mo":
        outermost, folder = folder, folder.parent
    words = read_text(model).split(";", 1)[0].split()
    if "within" not in words:
        return [outermost] if outermost else []
    while (folder / "package.mo").is_file():
        outermost, folder = folder, folder.parent
    return [outermost] if outermost else []


def _modelica_path() -> list[Path]:
    named = os.environ.get(MODELICAPATH, "")
    return [Path(p) for p in named.split(os.pathsep) if p and Path(p).exists()]
