"""The file map: one line a module, its docstring's first sentence. `python docs/file_map.py` prints
it; the documentation site holds it.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("modelica_fmu", "controllers", "pyfmi_runner", "pneugantry", "benchmarks", "examples")
OTHERS = {  # what holds no docstring
    "models/PneuGantry.mo": "The plant, one block per component; `Validation`: a model with a "
    "known answer per component",
    "models/EMPS.mo": "A measured axis in its position loop; every effect of "
    "`examples/emps/effects` a parameter with a neutral value",
    "notebooks/*.ipynb": "Root locus and lag, step by step; run by the tests",
    "docs/*.md": "Design decisions; how the thesis' runs were set up",
}


def first_sentence(text: str) -> str:
    """Up to the first full stop that ends a sentence, on one line."""
    paragraph = " ".join(text.strip().split("\n\n")[0].split())
    return re.split(r"(?<!Eq)(?<!Fig)(?<! al)\.(?= [A-Z`|\[(]|$)", paragraph)[0].strip()


def summary(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        # a command says there what it does
        helped = re.search(r'^HELP = """(.*?)"""', text, re.MULTILINE | re.DOTALL)
        return first_sentence(helped[1] if helped else ast.get_docstring(ast.parse(text)) or "")
    comment = re.match(r"\s*/\*(.*?)\*/", text, re.DOTALL)
    return first_sentence(re.sub(r"\n\s*\*", "\n", comment[1])) if comment else ""


def file_map() -> str:
    """The map as Markdown: a list per folder; files without a summary (empty `__init__.py`) are
    left out.
    """
    lines = [f"- `{name}`: {text}" for name, text in OTHERS.items()]
    for package in PACKAGES:
        files = sorted(p for p in (ROOT / package).rglob("*") if p.suffix in (".py", ".c", ".h"))
        for folder in sorted({p.parent for p in files}):
            lines += ["", f"**{folder.relative_to(ROOT).as_posix()}/**", ""]
            entries = ((p.name, summary(p)) for p in files if p.parent == folder)
            lines += [f"- `{name}`: {text}" for name, text in entries if text]
            effects = sorted(folder.glob("effects/*.toml"))
            lines += (
                [f"- `effects/*.toml`: {len(effects)} effects of the catalogue, one file each"]
                if effects
                else []
            )
    return "\n".join(lines)


if __name__ == "__main__":
    print(file_map())
