"""Every table and figure of the thesis: where ours is, or why there is none. A line a figure, so
that nothing is left out unsaid.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from pneugantry.thesis.pictured import SPEEDS

__all__ = ["KINDS", "Entry", "contents", "contents_lines", "contents_report"]

STUDY, FIGURE = "pneugantry thesis", "out/thesis/"
PHOTO = "a photograph or drawing of the rig or of a part"
TASK = "a photograph of the task in industry"
PRINCIPLE = "a principle from the literature, nothing to reproduce"
CITED = "another group's result or controller, cited; its plant is not described"
SHEET = "a maker's data sheet"
CALIBRATION = "a calibration of the rig's sensors; its line gives the 12-bit converter's steps"
MASS = "the rig's mass from acceleration; m_x, m_z are parameters of the plant, put in as printed"
PROGRAM = "a picture of the SIMULINK program; ours is this code"
SCREEN = "a screen capture of inputs, whose values the text does not hold; Tables 5.3, 5.4 are in"
INPUT = "an input: put in as printed"
TESTED = "numbers of the plant: ours is the thesis' test done on the FMU"
SET_POINT = "the thesis' gains; the set point is not printed and lies within the figure's axis"
WALL = "of 90 and 92 degrees, where no edge z_w(x) stands, the model's steepest: 86"
MATERIAL = "the profile is not printed: the fitted finish at the height that Table 3.8's RMSE asks"
SAMPLES = "the rig's samples are not printed: ours alone is drawn"


class Entry(NamedTuple):
    """A table or figure. Exactly one of `ours` and `why_not` is given, or both where ours is a
    part.
    """

    name: str  # "Table 4.7", "Fig. 5.6"
    ours: str  # command, file or module that gives it; "" where there is none
    why_not: str

    @property
    def kind(self) -> str:
        """What ours is: a picture, a run whose numbers stand beside the printed ones, or a part of
        the model or of a controller.
        """
        if not self.ours:
            return "none"
        if self.ours.startswith(FIGURE):
            return "picture"
        return "part" if self.ours.endswith((".py", ".mo")) else "numbers"


def _range(chapter: str, first: int, last: int) -> list[str]:
    return [f"Fig. {chapter}.{k}" for k in range(first, last + 1)]


def _tables() -> Iterator[Entry]:
    yield Entry("Table 2.1", "", "a survey of the literature")
    yield Entry("Table 3.1", "pyfmi_runner/log.py", "")
    yield Entry("Table 3.2", "pneugantry/thesis/structures.py", "its response times are structures")
    yield Entry("Table 3.3", STUDY, "the sensors at rest, ideal and behind the 12-bit converter")
    yield Entry(
        "Table 3.4",
        STUDY,
        "Jatta's robot is not described: his controller and set points on our plant; the circular "
        "and the rectangular edge are not described either",
    )
    for name in ("3.5", "3.6", "3.7", "3.11", "4.6", "5.1"):
        yield Entry(f"Table {name}", "controllers/gains.py", INPUT)
    yield Entry(
        "Table 3.8", STUDY, "by the finish's height: the materials' profiles are not printed"
    )
    for name in ("3.9", "3.10", "3.12"):
        yield Entry(f"Table {name}", f"{STUDY} --gap", "")
    yield Entry("Table 3.13", STUDY, f"{TESTED}; F_d of z is printed 10 N, its tests give 15")
    yield Entry("Table 3.14", STUDY, "")
    for k in range(1, 6):
        yield Entry(f"Table 4.{k}", STUDY, f"{TESTED}; means of the printed readings")
    for k in range(7, 16):
        yield Entry(f"Table 4.{k}", STUDY, "")
    yield Entry("Table 5.2", STUDY, "")
    yield Entry("Table 5.3", "controllers/ebpa.py", INPUT)
    yield Entry("Table 5.4", "controllers/mbpm.py", INPUT)
    yield Entry("Table 5.5", STUDY, "")
    yield Entry("Table 6.1", STUDY, "")
    yield Entry("Table C.1", STUDY, f"{TESTED}; its scatter is ranked by --gap")
    yield Entry("Table C.2", STUDY, f"{TESTED}; its scatter is ranked by --gap")


def _chapters_1_to_3() -> Iterator[Entry]:
    for name in _range("1", 1, 2):
        yield Entry(name, "", TASK)
    cited = (5, 6, 7, 8, 9, 19, 24)  # curves of others; the rest of chapter 2 shows principles
    for k in range(1, 25):
        yield Entry(f"Fig. 2.{k}", "", CITED if k in cited else PRINCIPLE)
    for k in (1, 2, 4):
        yield Entry(f"Fig. 3.{k}", "", PHOTO)
    yield Entry(
        "Fig. 3.3",
        "pyfmi_runner/workpiece.py",
        "the curved edge, shaped after the angle in Figs. 3.33 and 4.36",
    )
    yield Entry("Fig. 3.5", f"{FIGURE}fig_3_5_4_6_noise", SAMPLES)
    yield Entry("Fig. 3.6", "controllers/dfv.py", "")
    for k in (7, 9):
        yield Entry(f"Fig. 3.{k}", "", "Jatta's rectangular and circular edges are not described")
    yield Entry("Fig. 3.8", STUDY, "Jatta's curved edge: scores of Table 3.4, on our curved edge")
    yield Entry("Fig. 3.10", "", CITED)
    yield Entry("Fig. 3.11", "controllers/vdfm_comp.py", "")
    yield Entry("Fig. 3.12", "controllers/task_frame.py", "")
    yield Entry("Fig. 3.13", "controllers/pi_fv.py", "")
    yield Entry("Fig. 3.14", f"{FIGURE}fig_3_14_v_x_tuning", SET_POINT)
    yield Entry("Fig. 3.15", f"{FIGURE}fig_3_15_tuning", MATERIAL)
    yield Entry("Fig. 3.16", f"{FIGURE}fig_3_16_tuning", WALL)
    for name in ("Fig. 3.17", "Fig. 3.19"):
        yield Entry(name, f"{FIGURE}fig_3_17_3_19_tuning", MATERIAL)
    yield Entry("Fig. 3.18", "", PRINCIPLE)
    for k in (20, 21, 22, 23, 24, 25):
        yield Entry(f"Fig. 3.{k}", f"{FIGURE}fig_3_{k}_tuning", WALL if k == 24 else MATERIAL)
    for picture in SPEEDS:
        yield Entry(f"Fig. 3.{picture.split('_')[2]}", f"{FIGURE}{picture}", SAMPLES)
    names = ("30_4_26_4_27_straight", "31_incline_7", "32_incline_16", "33_4_28_4_29_curved")
    for k, name in enumerate(names, start=30):
        yield Entry(f"Fig. 3.{k}", f"{FIGURE}fig_3_{name}", SAMPLES)
    yield Entry("Fig. 3.34", f"{FIGURE}fig_3_34_vdfm", SAMPLES)


def _chapter_4() -> Iterator[Entry]:
    yield Entry("Fig. 4.1", "", MASS)
    yield Entry("Fig. 4.2", "models/PneuGantry.mo", "")
    for name in _range("4", 3, 4):
        yield Entry(name, f"{FIGURE}fig_4_3_4_4_C_9_C_13_lag_steps", SAMPLES)
    for name in ("Fig. 4.5", "Fig. 4.7"):
        yield Entry(name, f"{FIGURE}fig_4_5_4_7_finish", "the draw is not printed: draws of ours")
    yield Entry("Fig. 4.6", f"{FIGURE}fig_3_5_4_6_noise", "")
    for name in _range("4", 8, 9):
        yield Entry(name, f"{FIGURE}fig_4_8_4_9_v_x_tuning", SET_POINT)
    yield Entry("Fig. 4.10", f"{FIGURE}fig_4_10_4_18_friction_models", "")
    yield Entry("Fig. 4.11", f"{FIGURE}fig_4_10_4_18_friction_models", SAMPLES)
    yield Entry("Fig. 4.12", "models/PneuGantry.mo", "Dahl's law is the DDFM's; the model's own")
    for number in ("4.13", "4.14", "4.16", "4.17"):
        yield Entry(f"Fig. {number}", f"{FIGURE}fig_4_14_4_17_hysteresis", SAMPLES)
    yield Entry("Fig. 4.15", f"{FIGURE}fig_4_15_without_cable", SAMPLES)
    yield Entry("Fig. 4.18", f"{FIGURE}fig_4_10_4_18_friction_models", "")
    yield Entry("Fig. 4.19", "controllers/anfis.py", "")
    yield Entry("Fig. 4.20", f"{FIGURE}fig_4_20_anfis", "")
    yield Entry("Fig. 4.21", "pneugantry run", "")
    pieces = ("straight", "incline_7", "incline_16", "curved")
    for k, piece in zip(range(22, 26), pieces, strict=True):
        yield Entry(f"Fig. 4.{k}", f"{FIGURE}fig_4_{k}_{piece}", "")
    measured = "the measured angle is not printed: the fitted waves stand for it"
    for k in (26, 27):
        yield Entry(f"Fig. 4.{k}", f"{FIGURE}fig_3_30_4_26_4_27_straight", measured)
    for k in (28, 29):
        yield Entry(f"Fig. 4.{k}", f"{FIGURE}fig_3_33_4_28_4_29_curved", measured)
    yield Entry("Fig. 4.30", f"{FIGURE}fig_4_30_valves", "")
    yield Entry("Fig. 4.31", f"{FIGURE}fig_4_31_angle_error", "")
    for k, piece in zip((32, 34, 35, 36), pieces, strict=True):
        number = "4_32_4_33" if k == 32 else f"4_{k}"
        for name in ("Fig. 4.32", "Fig. 4.33") if k == 32 else (f"Fig. 4.{k}",):
            yield Entry(name, f"{FIGURE}fig_{number}_reversals_{piece}", "")


def _chapter_5_and_appendices() -> Iterator[Entry]:
    for name in _range("5", 1, 3):
        yield Entry(name, f"{FIGURE}fig_5_1_5_3_scheduler", "")
    yield Entry("Fig. 5.4", "controllers/perfect_friction.py", "")
    yield Entry("Fig. 5.5", f"{FIGURE}fig_5_5_perfect_compensator", "")
    yield Entry("Fig. 5.6", "pneugantry rootlocus --lag x", "")
    yield Entry("Fig. 5.7", "pneugantry rootlocus --lag none", "")
    yield Entry("Fig. 5.8", "controllers/smith.py", "")
    yield Entry(
        "Fig. 5.9",
        "",
        "another group's, cited and rejected (§5.3): a block diagram without its fuzzy rules, "
        "scalings, network or training; ours is the plain predictor, controllers/smith.py",
    )
    yield Entry("Fig. 5.10", "", CITED)
    yield Entry("Fig. 5.11", "controllers/mbpm_comp.py", "")
    yield Entry("Fig. 5.12", "controllers/nn_inputs.py", "")
    names = ("5_13_5_14_ebpa_zero", "5_15_5_16_ebpa", "5_17_5_18_mbpm", "5_19_5_20_mbpm_curved")
    for k, name in zip(range(13, 21, 2), names, strict=True):
        for number in (k, k + 1):
            yield Entry(f"Fig. 5.{number}", f"{FIGURE}fig_{name}", "")
    yield Entry("Fig. 5.21", "controllers/nn_inputs.py", "")
    for name in _range("A", 1, 11):
        yield Entry(name, "", SHEET)
    yield Entry("Fig. B.1", "", PHOTO)
    for name in _range("B", 2, 13):
        yield Entry(name, "pyfmi_runner/sensors.py", CALIBRATION)
    for name in _range("C", 1, 2):
        yield Entry(name, "pneugantry/thesis/rig_tests.py", PROGRAM)
    for name in _range("C", 3, 8):
        yield Entry(name, f"{FIGURE}fig_C_3_C_8_saw_tooth", SAMPLES)
    for name in _range("C", 9, 13):
        yield Entry(name, f"{FIGURE}fig_4_3_4_4_C_9_C_13_lag_steps", SAMPLES)
    programs = {4: "ebpa_comp", 3: "mbpm_comp", 8: "mbpm_comp"} | dict.fromkeys(
        (1, 2, 7), "nn_inputs"
    )
    for k in range(1, 10):
        if k in programs:
            yield Entry(f"Fig. D.{k}", f"controllers/{programs[k]}.py", PROGRAM)
        else:
            yield Entry(f"Fig. D.{k}", "", SCREEN)
    loops = {2: "v_x", 4: "f_z", 5: "f_z", 7: "f_x", 8: "f_x", 9: "f_x"}
    for k in range(1, 14):
        if k in (1, 3, 6, 10):  # block diagrams of a loop
            yield Entry(f"Fig. E.{k}", "pneugantry/thesis/axis_loops.py", "")
        else:
            name = f"{FIGURE}fig_E_{k}_{loops.get(k, 'v_z')}_tuning"
            yield Entry(f"Fig. E.{k}", name, SET_POINT)


def contents() -> list[Entry]:
    """Tables, then figures, in the order of the thesis."""
    figures = [*_chapters_1_to_3(), *_chapter_4(), *_chapter_5_and_appendices()]
    return [*sorted(_tables(), key=_place), *sorted(figures, key=_place)]


def _place(entry: Entry) -> tuple[str, int]:
    """Chapters before appendices."""
    chapter, number = entry.name.split()[1].split(".")
    return chapter, int(number)


KINDS = {
    "numbers": "have numbers of ours beside the printed",
    "picture": "have a picture of ours",
    "part": "are a part of the model, of a controller or of a test, or an input put in as printed",
    "none": "have nothing of ours, and say why",
}


def contents_report() -> dict[str, Any]:
    """The JSON, `thesis_list/1`."""
    entries = contents()
    return {
        "schema": "thesis_list/1",
        "entries": [{**entry._asdict(), "kind": entry.kind} for entry in entries],
        "ours": sum(bool(entry.ours) for entry in entries),
        "kinds": {kind: sum(entry.kind == kind for entry in entries) for kind in KINDS},
    }


def contents_lines() -> Iterator[str]:
    found = contents_report()
    for entry in found["entries"]:
        yield f"{entry['name']:<12}{entry['ours'] or '-':<58}{entry['why_not']}"
    said = "; ".join(f"{found['kinds'][kind]} {text}" for kind, text in KINDS.items())
    yield f"{found['ours']} of {len(found['entries'])} tables and figures have ours: {said}"
