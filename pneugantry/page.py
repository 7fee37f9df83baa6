"""A self-contained HTML page of titled sections: text, table, picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import jinja2

from pyfmi_runner.log import write_atomically

TEMPLATE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{{ title }}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body { font: 15px/1.5 system-ui, sans-serif; max-width: 68rem; margin: 2rem auto; padding: 0 1rem; color: #1c2430; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; border-bottom: 1px solid #d5dbe3; padding-bottom: .2rem; }
table { border-collapse: collapse; margin: .8rem 0; } th, td { padding: .25rem .8rem; text-align: right; border-bottom: 1px solid #e6eaef; }
th:first-child, td:first-child { text-align: left; } th { font-weight: 600; background: #f5f7fa; }
img { max-width: 100%; height: auto; } .scroll { overflow-x: auto; }
</style></head><body>
<h1>{{ title }}</h1>
{% for s in sections %}
<h2>{{ s.title }}</h2>
{% if s.text %}<p>{{ s.text }}</p>{% endif %}
{% if s.table %}<div class="scroll"><table><tr>{% for h in s.table[0] %}<th>{{ h }}</th>{% endfor %}</tr>
{% for row in s.table[1] %}<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>{% endfor %}</table></div>{% endif %}
{% if s.figure %}<img alt="{{ s.title }}" src="{{ s.figure }}">{% endif %}
{% endfor %}
</body></html>
"""


@dataclass(frozen=True)
class Section:
    title: str
    text: str = ""
    table: tuple[list[str], list[list[str]]] | None = None  # head, rows
    figure: str = ""  # data URI


def write_page(path: Path, title: str, sections: list[Section]) -> Path:
    """Writes the page, whole or not at all; returns its path."""
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    text = environment.from_string(TEMPLATE).render(title=title, sections=sections)
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return path
