"""What the page shows of the gantry alone: its block diagram, how each log was taken."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from pneugantry.engine.run import Found
from pneugantry.report.headline import percent
from pneugantry.report.page import Extras
from pneugantry.report.svg import LINE, svg, text
from pyfmi_runner.campaign import Campaign, LoggedRun

__all__ = ["extras_of", "plant_svg"]

DARK = "#1c2430"  # on a block's own light fill


class Box(NamedTuple):
    """Where a block of the plant stands."""

    x: float
    y: float
    width: float
    height: float
    captions: tuple[str, str]


BLOCKS = {
    "timing": Box(196, 272, 128, 54, ("timing", "delay of the loop")),
    "valve_x": Box(196, 34, 128, 54, ("valve_x", "u → f_a")),
    "valve_z": Box(196, 142, 128, 54, ("valve_z", "u → f_a")),
    "friction_x": Box(430, 34, 150, 54, ("friction_x", "friction, mass, cable")),
    "friction_z": Box(430, 142, 150, 54, ("friction_z", "friction, mass, cable")),
    "contact": Box(724, 34, 130, 162, ("contact", "and workpiece")),
    "sensors": Box(360, 272, 494, 54, ("sensors", "noise, scale, offset, lag")),
}


def extras_of(campaign: Campaign, found: Found) -> Extras:
    """The gantry's share of a page."""
    d = found.diagnosis
    return Extras(
        drawing=plant_svg({p.block: p.share for p in d.where}),
        closed_loop=d.closed_loop,
        next_experiment=d.next_experiment,
        phases={
            name: [(phase, start, end) for phase, (start, end) in run.setup.phases.items()]
            for name, run in campaign.logs.items()
        },
        setups={name: _setup(run) for name, run in campaign.logs.items()},
        source=str(campaign.path),
    )


def _setup(run: LoggedRun) -> dict[str, str]:
    setup = run.setup
    loop = f"closed, {setup.controller}" if setup.controller else setup.loop
    workpiece = setup.workpiece
    if workpiece != "none":
        workpiece += f", {1e3 * setup.z_0:.3g} mm away"
    return {"loop": loop, "clamped": ", ".join(setup.clamped) or "-", "workpiece": workpiece}


def plant_svg(shares: Mapping[str, float]) -> str:
    """The plant's signal flow; each block filled, framed and lettered by its share. Blocks that the
    gantry does not have stand below.
    """
    others = [block for block in shares if block not in BLOCKS]
    body = [
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto">'
        f'<path d="M0 0L8 4L0 8z" fill="{LINE}"/></marker></defs>'
    ]
    body += _wires()
    body.append(
        f'<rect x="20" y="34" width="104" height="162" rx="6" fill="var(--soft)" '
        f'stroke="{LINE}" stroke-dasharray="4 3"/>'
    )
    body += [text((72, 112), "controller"), text((72, 128), "(not judged)", size=10.5, fill=LINE)]
    places = {
        **BLOCKS,
        **{name: Box(20 + 190 * i, 352, 170, 54, (name, "")) for i, name in enumerate(others)},
    }
    for name, box in places.items():
        body += _block(box, shares.get(name))
    label = (
        ", ".join(f"{name} {percent(share)}" for name, share in shares.items() if share >= 0.005)
        or "no block carries a share"
    )
    size = (max(880, 20 + 190 * len(others)), 420 if others else 340)
    return svg(size, body, f"Blocks of the plant by share of the gap: {label}", "picture plant")


def _block(box: Box, claimed: float | None) -> list[str]:
    """One block; claimed: its share, None where none is known."""
    share = claimed or 0.0
    share = min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0
    middle, centre = box.x + box.width / 2, box.y + box.height / 2
    shade = tuple(round(255 + share * (full - 255)) for full in (240, 140, 40))
    value = "–" if claimed is None else percent(claimed)
    weight, size = ("700", 13) if share >= 0.1 else ("400", 11)
    return [
        f'<rect x="{box.x}" y="{box.y}" width="{box.width}" height="{box.height}" rx="6" '
        f'fill="rgb{shade}" stroke="{LINE}" stroke-width="{1 + 3 * share:.1f}"/>',
        text((middle, centre - 9), box.captions[0], weight="600", fill=DARK),
        text((middle, centre + 4), box.captions[1], size=10.5, fill=DARK),
        text((middle, centre + 20), value, size=size, weight=weight, fill=DARK),
    ]


def _wires() -> list[str]:
    def wire(
        points: str, label: str = "", at: tuple[float, float] = (0, 0), tip: bool = True
    ) -> str:
        mark = ' marker-end="url(#tip)"' if tip else ""
        line = f'<polyline points="{points}" fill="none" stroke="{LINE}" stroke-width="1.5"{mark}/>'
        return line + (text(at, label, size=11) if label else "")

    def dot(x: float, y: float) -> str:
        return f'<circle cx="{x}" cy="{y}" r="3" fill="{LINE}"/>'

    result = []
    for axis, y in (("x", 61), ("z", 169)):
        position = "x" if axis == "x" else "z"
        result += [
            wire(f"124,{y} 194,{y}", f"u_{axis}", (159, y - 6)),
            wire(f"324,{y} 428,{y}", f"f_a{axis}", (354, y - 6)),
            dot(382, y),
        ]
        result += [
            wire(f"580,{y - 10} 722,{y - 10}", f"{position}, v_{axis}", (620, y - 16)),
            dot(664, y - 10),
        ]
        result.append(wire(f"724,{y + 14} 582,{y + 14}", f"f_{axis}", (694, y + 28)))
    result += [
        wire("382,61 382,270", "f_a", (397, 256)),
        wire("664,51 664,270", "s, v", (683, 256)),
        wire("789,196 789,270", "f", (799, 256)),
    ]
    result += [
        wire("360,299 326,299"),
        wire("196,299 72,299 72,198", "measured signals", (134, 316)),
    ]
    return result
