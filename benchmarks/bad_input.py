"""Bad input and special files: `python -m benchmarks.bad_input [--json FILE]`.

Each case is a command in a folder of its own. It must end by itself, with the exit code that the
documents say, tell what is wrong in one line, and leave everything that stood in the folder, and
the system's devices, as it was; a result goes through a link, a pipe and a device.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOTOR = ROOT / "examples" / "motor"
SECONDS = 120.0  # longest time of a case; one that waits for ever is a failure
COLUMNS = "time,u_x,u_z,x,z,v_x,v_z,f_x,f_z,f_ax,f_az"
PROGRESS = re.compile(r"\w+: (.*\(\d+ s so far|building the FMU )")  # of a command that takes time
DEVICES = ("/dev/full", "/dev/null", "/dev/zero")

__all__ = ["CASES", "Case", "Outcome", "main", "tried"]

Make = Callable[[Path], object]


def rows(change: Callable[[str], str] = str) -> str:
    """A log of 50 rows at rest as CSV, its lines changed."""
    lines = [COLUMNS, *(f"{k / 1000},0,0,0.5,0.05,0,0,0,0,0,0" for k in range(50))]
    return "".join(change(line) + "\n" for line in lines)


def put(name: str, content: str | bytes) -> Make:
    data = content.encode() if isinstance(content, str) else content
    return lambda folder: (folder / name).write_bytes(data)


def link(name: str, target: str) -> Make:
    return lambda folder: (folder / name).symlink_to(target)


def pipe(name: str) -> Make:
    return lambda folder: os.mkfifo(folder / name)


def motor(log: str, change: Callable[[list[str]], list[str]]) -> Make:
    """The described motor of the examples, the cells of one of its logs changed row by row."""

    def make(folder: Path) -> None:
        shutil.copytree(MOTOR, folder, dirs_exist_ok=True)
        file = folder / "data" / f"{log}.csv"
        lines = file.read_text(encoding="utf-8").splitlines()
        file.write_text(
            "".join(",".join(change(line.split(","))) + "\n" for line in lines), encoding="utf-8"
        )

    return make


@dataclass(frozen=True)
class Case:
    """A command that meets something unusable or special.

    words: after `pneugantry`; made: what stands in the folder before; says: part of its one line on
    standard error, "" where the command succeeds; code: exit code; shell: what the command's
    output is sent to; changes: the files that it makes or rewrites, nothing else.
    """

    kind: str
    words: str
    made: tuple[Make, ...] = ()
    says: str = ""
    code: int = 2
    shell: str = ""
    changes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What a case did; `wrong`: what it should not have, "" where all is right."""

    kind: str
    command: str
    code: int
    said: str
    seconds: float
    wrong: str


OLD = put("old.json", "kept\n")
LIST = "list workpieces --json"  # succeeds, and is over soon


def written(
    place: str, path: str, made: tuple[Make, ...] = (), changes: str = "", shell: str = ""
) -> Case:
    """A result that is written to something special and says nothing."""
    files = (changes,) if changes else ()
    return Case(f"result: {place}", f"{LIST} {path}", made, "", 0, shell, files)


CASES = (
    Case("log: absent", "replay rig.csv", says="rig.csv: no such file"),
    Case("log: empty", "replay rig.csv", (put("rig.csv", ""),), "the file is empty"),
    Case("log: a folder", "log check .", says="name a single log file"),
    Case("log: noise", "replay a.parquet", (put("a.parquet", b"PAR1\0\xff" * 40),), "a.parquet: "),
    Case(
        "log: a column missing",
        "replay rig.csv",
        (put("rig.csv", rows(lambda line: line.rsplit(",", 1)[0])),),
        "f_az: column is missing; add it [N]",
    ),
    Case(
        "log: words for numbers",
        "replay rig.csv",
        (put("rig.csv", rows(lambda line: line.replace("0.05,", "open,"))),),
        "z: row 0 is 'open', not a number",
    ),
    Case(
        "log: millimetres",
        "replay rig.csv",
        (put("rig.csv", rows(lambda line: line.replace("0.5,", "500,"))),),
        "looks like mm; divide column x by 1000",
    ),
    Case("log: 50 rows at rest", "replay rig.csv", (put("rig.csv", rows()),), code=0),
    Case("log: a pipe", "replay p.csv", (pipe("p.csv"),), "p.csv: is a pipe, expected a file"),
    Case("log: endless", "replay z.csv", (link("z.csv", "/dev/zero"),), "z.csv: is a device"),
    Case(
        "log: 50 rows, to identify",
        "identify rig.csv",
        (put("rig.csv", rows()),),
        "an identification needs at least 500",
    ),
    Case(
        "plant: a log without its measured column",
        "diagnose plant.toml",
        (motor("steps", lambda cells: cells[:2]),),
        "log.steps: has no column of a measured signal (w); correct column",
    ),
    Case(
        "plant: a log that never moves",
        "diagnose plant.toml",
        (motor("sines", lambda cells: [*cells[:2], cells[2] if cells[2] == "w" else "0"]),),
        "log: nothing can be judged: no signal moves",
    ),
    Case("plant: none", "calibrate .", says="is no description of a plant"),
    Case("campaign: absent log", "replay .", (put("campaign.toml", "[log.a]\n"),), "a"),
    Case("scenario: no TOML", "run a.toml", (put("a.toml", "seed = ["),), "not valid TOML"),
    Case("scenario: endless", "run z.toml", (link("z.toml", "/dev/zero"),), "is a device"),
    Case("scenario: unknown key", "run a.toml", (put("a.toml", "sed = 1"),), "did you mean seed?"),
    Case("edge: endless", "run --workpiece z.csv", (link("z.csv", "/dev/zero"),), "is a device"),
    Case("FMU: cut off", "run --fmu a.fmu", (put("a.fmu", b"PK\3\4" * 9),), "not a zip archive"),
    Case("parameter: unknown", "run --set contact.Kc=1", says="did you mean contact.K_c"),
    Case("controller: unknown", "run --controller pi_fw", says="nearest is 'pi_fv'"),
    Case("controller: no Python", "run --controller a.py", (put("a.py", "def"),), "a.py: "),
    Case("controller: endless", "run --controller z.py", (link("z.py", "/dev/zero"),), "a device"),
    Case("study: unknown key", "sweep a.toml", (put("a.toml", "[gird]\nseed = [1]\n"),), "a.toml"),
    Case(
        "model: no Modelica",
        "build --model A.mo --class A",
        (put("A.mo", "model A\n  Real x = ;\nend A;\n"),),
        "A.mo:2",
    ),
    Case("point: no JSON", "linearize --at a.json", (put("a.json", "{"),), "a.json: is no JSON"),
    written("a link", "l", (OLD, link("l", "old.json")), "old.json"),
    written("a link to nothing", "l", (link("l", "new.json"),), "new.json"),
    written("/dev/null", "/dev/null"),
    written("/dev/stdout", "/dev/stdout", (), "out.json", "> out.json"),
    written("a pipe", "p", (pipe("p"),), "out.json", "& cat p > out.json; wait $!"),
    Case("result: a ring of links", f"{LIST} l", (link("l", "l"),), "l: cannot be written"),
    Case("result: /dev/full", f"{LIST} /dev/full", says="/dev/full: cannot be written"),
    Case("result: a link to /dev/full", f"{LIST} l", (link("l", "/dev/full"),), "l: cannot be"),
    Case("result: a folder", f"{LIST} .", says=".: is a folder"),
    Case("result: below a file", f"{LIST} old.json/a", (OLD,), "old.json/a: cannot be written"),
    Case("result: no place for files", f"{LIST} /proc/a.json", says="/proc/a.json: cannot be"),
    Case("report: no place for files", "diagnose . --html /proc/a.html", says="/proc/a.html: c"),
    Case("picture: no place for files", "run --plot /proc/a.png", says="/proc/a.png: cannot be"),
    Case(
        "result: over what is read",
        "run a.toml --json a.toml",
        (put("a.toml", "seed = 1\n"),),
        "would replace the file that is read",
    ),
    Case("result: its reader leaves", f"{LIST} -", code=1, shell="| true; exit ${PIPESTATUS[0]}"),
)


def standing(folder: Path) -> dict[str, str]:
    """What stands in a folder, and the devices: name -> its kind, and its content or target."""
    found = {}
    for path in sorted([*folder.rglob("*"), *map(Path, DEVICES)]):
        mode = path.lstat().st_mode
        if stat.S_ISLNK(mode):
            said = f"link to {os.readlink(path)}"
        elif stat.S_ISREG(mode):
            said = f"file {hashlib.sha256(path.read_bytes()).hexdigest()}"
        else:
            said = f"kind {stat.S_IFMT(mode):o}"
        found[str(path.relative_to(folder) if path.is_relative_to(folder) else path)] = said
    return found


def tried(case: Case, folder: Path, seconds: float = SECONDS) -> Outcome:
    """One case in an empty folder, ended after `seconds`."""
    for make in case.made:
        make(folder)
    before, began = standing(folder), time.perf_counter()
    command = f"pneugantry {case.words} {case.shell}".strip()
    script = f'pneugantry() {{ "{sys.executable}" -m pneugantry "$@"; }}\n{command}\n'
    own = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}
    with subprocess.Popen(
        ["bash", "-c", script],
        cwd=folder,
        env=own,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            _, said = process.communicate(timeout=seconds)
            code = process.returncode
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            code, said = -1, f"did not end within {seconds:g} s"
    took = time.perf_counter() - began
    wrong = faults(case, code, said, (before, standing(folder)))
    for name in case.changes:
        wrong += [] if is_result(folder / name) else [f"{name} holds no result"]
    said = said.replace(f"{folder}{os.sep}", "").strip()
    return Outcome(case.kind, command, code, said, took, "; ".join(wrong))


def is_result(path: Path) -> bool:
    """Whether a file holds one whole JSON result."""
    try:
        return bool(json.loads(path.read_text(encoding="utf-8"))["schema"])
    except (OSError, ValueError, KeyError):
        return False


def faults(
    case: Case, code: int, said: str, stood: tuple[dict[str, str], dict[str, str]]
) -> list[str]:
    """What a case did that it should not have. stood: before and after."""
    if code < 0:
        return [said]
    found = [] if code == case.code else [f"exit code {code}, expected {case.code}"]
    lines = [line for line in said.splitlines() if not PROGRESS.match(line)]
    if case.says and len(lines) != 1:
        found.append(f"{len(lines)} lines, expected one")
    if "Traceback" in said:
        found.append("a traceback")
    if case.says not in said:
        found.append(f"does not say {case.says!r}")
    before, after = stood
    changed = {name for name in before | after if before.get(name) != after.get(name)}
    if changed != set(case.changes):
        found.append(f"changed {sorted(changed) or 'nothing'}, expected {sorted(case.changes)}")
    return found


def row(outcome: Outcome) -> str:
    """A line of the table."""
    said = " ".join(outcome.said.removeprefix("pneugantry: ").split()) if outcome.code else ""
    judged = f"**{outcome.wrong}**" if outcome.wrong else "right"
    cells = (outcome.kind, f"`{outcome.command}`", str(outcome.code), said, judged)
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.bad_input", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose kind holds this")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, metavar="S", help="longest time of a case"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table as JSON")
    options = parser.parse_args(arguments)
    outcomes = []
    print("| what | command | exit code | said | |\n|---|---|---|---|---|")
    for case in CASES:
        if options.only in case.kind:
            with tempfile.TemporaryDirectory(prefix="bad-input-") as folder:
                outcome = tried(case, Path(folder), options.seconds)
            outcomes.append(outcome)
            print(row(outcome), flush=True)
    wrong = sum(bool(o.wrong) for o in outcomes)
    print(f"\n{len(outcomes)} cases, {wrong} not right")
    if options.json:
        found = {"schema": "bad_input/1", "cases": [asdict(o) for o in outcomes]}
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
