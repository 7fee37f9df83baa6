"""What the thesis prints, as data: one `Printed` row per line of a table. Source:
docs/reference/thesis-results.md, table numbers as there.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = [
    "ABLATION",
    "COLUMNS",
    "JATTA_SET_POINTS",
    "PRINTED_NOTES",
    "SPEEDS",
    "WORKPIECES",
    "Printed",
    "printed_rows",
]

WORKPIECES = ("straight", "incline_7", "incline_16", "curved")
COLUMNS = ("ME f_n", "ME v_t", "RMSE f_n", "RMSE v_t")  # N, m/s, N, m/s
SPEEDS = (0.03, 0.06, 0.09)  # m/s
CASES = ("all on", "no signal noise", "no lag", "no surface finish", "no Coulomb friction")


class Printed(NamedTuple):
    """A printed line; None where the thesis prints nothing."""

    table: str
    row: str
    workpiece: str
    kind: str  # "simulation" or "experiment"
    values: tuple[float | None, float | None, float | None, float | None]  # in the order of COLUMNS


# Tables 3.12 (experiment), 4.7 and 4.8 (simulation), PI FV
_BENCHMARK = {
    "3.12": (
        (12.4, 0.118, 3.0, 0.039),
        (9.6, 0.135, 1.2, 0.041),
        (5.6, 0.192, 1.0, 0.047),
        (16.8, 0.170, 2.6, 0.047),
    ),
    "4.7": (
        (17.8, 0.119, 4.4, 0.042),
        (10.4, 0.113, 1.4, 0.042),
        (10.2, 0.118, 1.6, 0.045),
        (16.4, 0.154, 3.2, 0.053),
    ),
    "4.8": (
        (11.8, 0.121, 3.0, 0.042),
        (9.4, 0.116, 1.2, 0.043),
        (7.0, 0.118, 1.2, 0.045),
        (14.8, 0.282, 2.6, 0.062),
    ),
}
# RMSE f_n, RMSE v_t at 0.03, 0.06, 0.09 m/s
_SPEED = {
    "3.9": ("curved", ((2.4, 0.053), (3.0, 0.060), (3.6, 0.069))),
    "3.10": ("straight", ((2.6, 0.015), (3.2, 0.018), (3.4, 0.019))),
    "4.9": ("curved", ((3.0, 0.046), (3.2, 0.053), (3.8, 0.066))),
    "4.10": ("straight", ((3.8, 0.040), (4.4, 0.042), (4.8, 0.051))),
}
# Tables 4.11-4.14: RMSE f_n, RMSE v_t, ME f_n, ME v_t of the five cases; Table 4.15 repeats their
# RMSE
ABLATION = {
    "straight": (
        "4.11",
        (
            (4.4, 0.042, 17.8, 0.119),
            (4.2, 0.042, 17.0, 0.119),
            (3.4, 0.037, 10.4, 0.061),
            (0.4, 0.042, 1.0, 0.121),
            (0.6, 0.031, 5.6, 0.061),
        ),
    ),
    "incline_7": (
        "4.12",
        (
            (1.4, 0.042, 10.4, 0.113),
            (1.4, 0.042, 10.4, 0.105),
            (1.2, 0.038, 6.4, 0.062),
            (1.4, 0.042, 10.4, 0.113),
            (0.6, 0.009, 5.2, 0.061),
        ),
    ),
    "incline_16": (
        "4.13",
        (
            (1.6, 0.045, 10.2, 0.118),
            (1.6, 0.045, 10.2, 0.117),
            (1.4, 0.040, 6.4, 0.062),
            (1.6, 0.045, 10.2, 0.118),
            (0.8, 0.010, 8.8, 0.061),
        ),
    ),
    "curved": (
        "4.14",
        (
            (3.2, 0.053, 16.4, 0.154),
            (3.0, 0.053, 21.4, 0.160),
            (2.6, 0.038, 19.6, 0.061),
            (1.8, 0.053, 21.6, 0.161),
            (1.0, 0.034, 20.4, 0.074),
        ),
    ),
}
# Tables 3.14 (experiment), 5.2 and 5.5 (simulation): controller, printed line
_CONTROLLERS = (
    ("3.14", "straight", "pi_fv", (12.4, 0.118, 3.0, 0.039)),
    ("3.14", "straight", "pi_fv_vdfm", (17.4, 0.160, 3.2, 0.028)),
    ("5.2", "curved", "pi_fv", (14.8, 0.282, 2.6, 0.062)),
    ("5.2", "curved", "pi_fv_scheduled", (28.0, 0.282, 3.4, 0.063)),
    ("5.5", "straight", "pi_fv", (11.8, 0.121, 3.0, 0.042)),
    ("5.5", "straight", "pi_fv_ebpa_zero", (13.6, 0.122, 4.0, 0.025)),
    ("5.5", "straight", "pi_fv_ebpa", (9.6, 0.122, 1.4, 0.025)),
    ("5.5", "straight", "pi_fv_mbpm", (7.6, 0.123, 1.2, 0.025)),
    ("5.5", "straight", "pi_fv_mbpm_5", (7.0, 0.122, 0.8, 0.025)),
    ("5.5", "curved", "pi_fv", (14.8, 0.282, 2.6, 0.062)),
    ("5.5", "curved", "pi_fv_mbpm", (6.6, 0.159, 0.8, 0.048)),
    ("5.5", "curved", "pi_fv_mbpm_5", (7.4, 0.159, 1.0, 0.048)),
)
# Table 6.1 repeats Tables 3.4, 3.12, 4.8 and 5.5; Jatta's electric robot (DFV) ran at set points of
# its own: f_nd [N], v_td [m/s]
_JATTA = (("straight", (13.11, None, 2.95, None)), ("curved", (16.56, None, 4.02, None)))
JATTA_SET_POINTS = {"straight": (30.0, -0.02), "curved": (20.0, -0.01)}  # Table 3.4
# What the print says that a reader of the tables alone would miss: name, text, numbers
PRINTED_NOTES: tuple[tuple[str, str, tuple[tuple[str, float], ...]], ...] = (
    (
        "Jatta's conditions",
        "Table 6.1 sets Jatta's robot beside 30 N and 0.06 m/s; Table 3.4 ran it slower, on the "
        "curved edge with a smaller force too, so that it is no comparison at equal task.",
        (
            ("straight: f_nd [N]", 30.0),
            ("straight: v_td [m/s]", 0.02),
            ("curved: f_nd [N]", 20.0),
            ("curved: v_td [m/s]", 0.01),
        ),
    ),
    (
        "Momentum of Table 5.3",
        "Table 5.3 lists the momentum with an initial value of 0 and a final one of 0.1.",
        (("initial", 0.0), ("final", 0.1)),
    ),
)


def printed_rows() -> list[Printed]:
    """Every printed line, tables in the order of the thesis."""
    rows = []
    for table, (workpiece, values) in _SPEED.items():
        kind = "experiment" if table.startswith("3") else "simulation"
        rows += [
            Printed(table, f"{v:g} m/s", workpiece, kind, (None, None, f, w))
            for v, (f, w) in zip(SPEEDS, values, strict=True)
        ]
    for table, lines in _BENCHMARK.items():
        kind = "experiment" if table.startswith("3") else "simulation"
        rows += [
            Printed(table, piece, piece, kind, line)
            for piece, line in zip(WORKPIECES, lines, strict=True)
        ]
    for piece, (table, cases) in ABLATION.items():
        for case, (rf, rv, mf, mv) in zip(CASES, cases, strict=True):
            rows.append(Printed(table, case, piece, "simulation", (mf, mv, rf, rv)))
        for case, (rf, rv, _, _) in zip(CASES, cases, strict=True):
            rows.append(
                Printed("4.15", f"{case}, {piece}", piece, "simulation", (None, None, rf, rv))
            )
    for table, piece, controller, line in _CONTROLLERS:
        rows.append(
            Printed(
                table, controller, piece, "experiment" if table == "3.14" else "simulation", line
            )
        )
    rows += _table_6_1()
    return sorted(rows, key=lambda row: [int(part) for part in row.table.split(".")])


def _table_6_1() -> list[Printed]:
    rows = [
        Printed(table, f"Jatta DFV, {piece}", piece, "experiment", line)
        for table in ("3.4", "6.1")
        for piece, line in _JATTA
    ]
    for table, kind in (("3.12", "experiment"), ("4.8", "simulation")):
        rows += [
            Printed("6.1", f"{kind} PI FV, {p}", p, kind, line)
            for p, line in zip(WORKPIECES, _BENCHMARK[table], strict=True)
        ]
    for table, piece, controller, line in _CONTROLLERS:
        if table == "5.5" and controller != "pi_fv":
            rows.append(Printed("6.1", f"{controller}, {piece}", piece, "simulation", line))
    return rows
