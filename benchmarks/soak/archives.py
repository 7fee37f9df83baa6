"""Damaged and hostile FMU files: each is refused with an InputError or read; nothing is written
outside, expanded or believed.
"""

from __future__ import annotations

import io
import os
import random
import re
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from modelica_fmu.errors import InputError, RunError
from pyfmi_runner.fmu import FmuFile, FmuSession

__all__ = ["KINDS", "fuzz_archives"]

Members = dict[str, bytes]


def fuzz_archives(path: Path, count: int, seed: int = 1) -> dict[str, Any]:
    """`count` changed copies of an FMU read, unpacked and, where its binary is the original, opened
    and stepped once.

    Counts by kind: refused, read, and whatever else an exception was, as "crash: ..." (none is
    expected); "escaped": files that appeared outside the cache (none is expected).
    """
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    rng, found = random.Random(seed), {kind: Counter[str]() for kind in KINDS}
    kept = os.environ.get("PNEUGANTRY_CACHE")
    with tempfile.TemporaryDirectory(prefix="soak-archives-") as temporary:
        folder = Path(temporary)
        os.environ["PNEUGANTRY_CACHE"] = str(folder / "deep" / "in" / "cache")
        try:
            for k in range(count):
                kind = list(KINDS)[k % len(KINDS)]
                target = folder / "it.fmu"
                target.write_bytes(KINDS[kind](rng, dict(members)))
                found[kind][_outcome(target)] += 1
            outside = [
                p
                for p in folder.rglob("*")
                if p.is_file() and "cache" not in p.parts and p.name != "it.fmu"
            ]
        finally:
            os.environ.pop("PNEUGANTRY_CACHE")
            if kept is not None:
                os.environ["PNEUGANTRY_CACHE"] = kept
    return {
        "tried": count,
        "escaped": len(outside),
        "kinds": {kind: dict(counts) for kind, counts in found.items()},
    }


def _outcome(path: Path) -> str:
    try:
        file = FmuFile.read(path)
        file.unpack()
        with FmuSession(file) as fmu:
            fmu.step(1e-3)
    except (InputError, RunError):
        return "refused"
    except Exception as error:
        return f"crash: {type(error).__name__}: {error}"
    return "read"


def _packed(members: Members, extra: list[tuple[str, bytes]] | None = None) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in [*members.items(), *(extra or [])]:
            archive.writestr(name, data)
    return buffer.getvalue()


def _flipped(rng: random.Random, members: Members) -> bytes:
    """Up to eight bytes of the archive changed, the binary's among them: then its checksum no
    longer fits.
    """
    data = bytearray(_packed(members))
    for _ in range(rng.randint(1, 8)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def _cut(rng: random.Random, members: Members) -> bytes:
    """Truncated, or a piece of it twice or left out."""
    data = _packed(members)
    a, b = sorted(rng.randrange(len(data)) for _ in range(2))
    return rng.choice([data[:a], data[:a] + data[b:], data[:b] + data[a:]])


def _slip(rng: random.Random, members: Members) -> bytes:
    """A member that would land elsewhere."""
    up = rng.choice(
        ["../", "..\\", "/", "C:/", "a/../../", "./../", "//host/", "binaries/../../../", "..//"]
    ) * rng.randint(1, 4)
    return _packed(members, [(up + rng.choice(["evil", "etc/cron", "x.so"]), b"evil")])


def _bomb(rng: random.Random, members: Members) -> bytes:
    """Much out of little: zeros, or very many members."""
    if rng.random() < 0.5:
        return _packed(members, [("resources/zeros", bytes(rng.randint(2, 16) * 2**20))])
    return _packed(members, [(f"resources/{k}", b"") for k in range(rng.randint(10_001, 12_000))])


def _entities(rng: random.Random, members: Members) -> bytes:
    """A document type with entities: nested, external, of a parameter."""
    depth = rng.randint(2, 12)
    nested = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * rng.randint(2, 12)}">' for k in range(depth))
    outer = rng.choice(
        [
            '<!ENTITY x SYSTEM "file:///etc/passwd">',
            '<!ENTITY % p SYSTEM "http://127.0.0.1:9/x"> %p;',
            '<!ENTITY x "y">',
            "",
        ]
    )
    text = members["modelDescription.xml"].decode()
    text = text.replace(
        "<fmiModelDescription",
        f'<!DOCTYPE d [<!ENTITY e0 "ha">{nested}{outer}]><fmiModelDescription',
        1,
    )
    return _packed(
        members
        | {
            "modelDescription.xml": text.replace(
                "<LogCategories>", f"<LogCategories>&e{depth};", 1
            ).encode()
        }
    )


def _described(rng: random.Random, members: Members) -> bytes:
    """A description with attributes removed, doubled, or of odd values; elements cut, doubled,
    nested deep; odd bytes.
    """
    text = members["modelDescription.xml"].decode()
    for _ in range(rng.randint(1, 4)):
        found = list(re.finditer(r' (\w+)="([^"]*)"', text))
        at = rng.choice(found)
        odd = [
            "",
            "-1",
            "1e999",
            "nan",
            "4294967296",
            "9" * 400,
            "true",
            "../../x",
            "\u202e",
            "&#10;",
            "ä" * 2000,
            "0x10",
            " 1",
            "1,5",
            "--",
        ]
        change = rng.randrange(7)
        if change == 0:
            text = text[: at.start()] + text[at.end() :]
        elif change == 1:
            text = text[: at.end()] + at.group(0) + text[at.end() :]
        elif change in (2, 3, 4):
            text = text[: at.start()] + f' {at.group(1)}="{rng.choice(odd)}"' + text[at.end() :]
        elif change == 5:
            lines = text.split("\n")
            a = rng.randrange(len(lines))
            b = min(len(lines), a + rng.randint(1, 20))
            text = "\n".join(rng.choice([lines[:a] + lines[b:], lines[:b] + lines[a:]]))
        else:
            text = text[: at.start()] + "<a>" * rng.randint(1, 5000) + text[at.start() :]
    data = text.encode()
    if rng.random() < 0.2:
        k = rng.randrange(len(data))
        data = data[:k] + bytes([rng.randrange(256)]) + data[k:]
    return _packed(members | {"modelDescription.xml": data})


KINDS: dict[str, Callable[[random.Random, Members], bytes]] = {
    "bytes changed": _flipped,
    "cut or doubled": _cut,
    "path outside": _slip,
    "bomb": _bomb,
    "entities": _entities,
    "description": _described,
}
