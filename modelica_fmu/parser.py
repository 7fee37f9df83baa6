"""rumoca in a process of its own: `python parser.py CLASS SECONDS < FILE.mo` prints the flat model,
or the error, as JSON.

A parser that overflows its stack, panics or runs away takes no more with it than this process.
"""

from __future__ import annotations

import contextlib
import json
import re
import sys

import rumoca

MEMORY = (
    8 * 2**30
)  # bytes of address space: a model that asks for more is refused, where the system has such limits


def parsed(text: str, class_name: str) -> str:
    """JSON: {"flat": ...}, or {"error": message, "line": that of a syntax error}."""
    try:
        return json.dumps({"flat": rumoca.Session().loads(text, model=class_name).to_dict("flat")})
    except rumoca.RumocaError as error:
        return json.dumps({"error": str(error), "line": _syntax_line(text)})
    except RecursionError:
        return json.dumps(
            {"error": "an expression is nested too deeply, or has too many terms", "line": None}
        )


def _syntax_line(text: str) -> int | None:
    """rumoca puts the position of a syntax error into the text of its diagnostics only."""
    found = [re.search(r"input\.mo:(\d+):\d+\]", d.message) for d in rumoca.validate_source(text)]
    return next((int(match.group(1)) for match in found if match), None)


if __name__ == "__main__":
    with contextlib.suppress(ImportError):
        import resource

        for what, limit in ((resource.RLIMIT_AS, MEMORY), (resource.RLIMIT_CPU, int(sys.argv[2]))):
            resource.setrlimit(what, (limit, resource.getrlimit(what)[1]))
    sys.stdout.write(parsed(sys.stdin.buffer.read().decode(), sys.argv[1]))
