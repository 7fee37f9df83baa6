"""The report: one page for every verdict, self-contained, and right in a browser. Diagnoses are
made by hand here, none is run.
"""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from jsonschema import Draft202012Validator
from matplotlib.image import imread
from numpy.typing import NDArray

from pneugantry.commands.diagnose import print_diagnosis
from pneugantry.diagnosis.bench import Choice, Outcome
from pneugantry.diagnosis.confirm import GapResult
from pneugantry.diagnosis.decide import Decision, Hypothesis
from pneugantry.diagnosis.diagnose import Diagnosis, report_json
from pneugantry.diagnosis.evidence import Search, Trial
from pneugantry.diagnosis.excitation import not_excited
from pneugantry.diagnosis.fit import Fit, tolerance_coordinate
from pneugantry.diagnosis.report import write_report
from pneugantry.diagnosis.report_pictures import SAMPLES, gap_svg, packed, plant_svg, ticks
from pneugantry.engine.catalogue import Effect, read_catalogue
from pneugantry.report.headline import (
    confirmed,
    headline,
    interval,
    number,
    percent,
    verdict_word,
)
from pyfmi_runner.build import build_fmu
from pyfmi_runner.campaign import Campaign, LoggedRun, LogSetup
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import MEASURED, PERIOD, SIGMA, Log

Array = NDArray[np.float64]
CATALOGUE: dict[str, Effect] = read_catalogue()
VERDICTS = ("identified", "two", "ambiguous", "unknown", "none", "no_gap", "single", "bare")
CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--virtual-time-budget=4000",
)
PROBE = """<script>
addEventListener("load", function () {
  const blank = [...document.querySelectorAll("canvas")].filter(function (c) {
    const pixels = c.width ? c.getContext("2d").getImageData(0, 0, c.width, c.height).data : [];
    return !pixels.some(function (v, i) { return i % 4 < 3 && v < 120; });
  }).length;
  const hidden = [...document.querySelectorAll("svg.picture:not([hidden])")].filter(function (s) {
    return s.getBoundingClientRect().width < 50 || s.getBoundingClientRect().height < 50;
  }).length;
  const wide = document.documentElement.scrollWidth > innerWidth;
  const count = function (what) { return document.querySelectorAll(what).length; };
  const seen = { canvases: count("canvas"), svgs: count("svg.picture"), blank, hidden, wide };
  const tell = function () { console.log("PROBE" + JSON.stringify(seen)); };
  const c = document.querySelector("canvas"), root = document.documentElement;
  const w = function () { return root.dataset.window.split(" ").map(Number); };
  if (!c) { tell(); return; }
  const at = function (type, x, more) {
    const box = c.getBoundingClientRect();
    const place = { clientX: box.left + x * box.width, clientY: box.top + 40,
                    bubbles: true, cancelable: true, button: 0 };
    const Kind = type === "wheel" ? WheelEvent : PointerEvent;
    c.dispatchEvent(new Kind(type, { ...place, ...more }));
  };
  const steps = [
    function () { seen.whole = w();
      at("wheel", 0.5, { deltaY: -400 }); at("wheel", 0.5, { deltaY: -400 }); },
    function () { seen.zoomed = w();
      at("pointerdown", 0.5); at("pointermove", 0.4); at("pointerup", 0.4); },
    function () { seen.panned = w(); document.getElementById("difference").click(); },
    function () { document.getElementById("difference").click(); at("dblclick", 0.5); },
    function () { seen.reset = w(); tell(); }
  ];
  const next = function () {
    const step = steps.shift();
    if (step) { step(); setTimeout(next, 150); }
  };
  next();
});
</script>"""


# ---------------------------------------------------------------- diagnoses by hand


def logged(name: str, setup: LogSetup, seconds: float = 3.0, seed: int = 0) -> LoggedRun:
    time = np.arange(round(seconds / PERIOD), dtype=np.float64) * PERIOD
    clean = shapes(time)
    noise = np.random.default_rng(seed).standard_normal(clean.shape) * [SIGMA[c] for c in MEASURED]
    table = pd.DataFrame(
        {"time": time, "u_x": 1.0 + 0.3 * np.sin(time), "u_z": 2.0 + 0.5 * np.sin(3 * time)}
    )
    return LoggedRun(
        setup, Log(table.join(pd.DataFrame(clean + noise, columns=list(MEASURED))), name)
    )


def shapes(time: Array, off: float = 0.0) -> Array:
    a, b = 0.3 + 0.02 * off, 3.0
    x, z = 0.6 - a * np.sin(0.5 * time), 0.04 + 0.02 * np.sin(b * time - 0.3 * off)
    v_x, v_z = -0.5 * a * np.cos(0.5 * time), 0.06 * np.cos(b * time - 0.3 * off)
    f_z = 30 + 4 * np.sin(b * time) + off * 3 * np.sign(np.cos(b * time))
    return np.column_stack(
        [
            x,
            z,
            v_x,
            v_z,
            0.1 * f_z,
            f_z,
            -20 + 8 * np.sin(time - 0.1 * off),
            60 + 12 * np.sin(b * time - 0.2 * off),
        ]
    )


def campaign(single: bool = False) -> Campaign:
    steps = LogSetup(clamped=("x", "z"))
    phases = {"approach": (0.0, 0.5), "contact": (0.5, 1.0), "contour": (1.0, 3.0)}
    contour = LogSetup(
        "closed",
        ("x until contour",),
        workpiece="curved",
        phases=phases,
        controller="pi_fv",
        f_nd=30.0,
        v_td=-0.06,
    )
    setups = (
        {"contour_curved": contour}
        if single
        else {"valve_steps": steps, "free_motion": LogSetup(), "contour_curved": contour}
    )
    logs = {name: logged(name, setup, seed=i) for i, (name, setup) in enumerate(setups.items())}
    return Campaign("rig <7> & co", Path("rig"), logs, ["contact_steps left out: f_z: clipped"])


def fitted(
    *choices: tuple[str, int], rms: float = 1.02, views: tuple[str, ...] = ("friction_z",)
) -> Outcome:
    choice = Choice(tuple((CATALOGUE[key], CATALOGUE[key].forms[form]) for key, form in choices))
    coordinates = (
        tolerance_coordinate("axis_z.friction.C", 45.0, 0.02),
        tolerance_coordinate("valve_z.tau", 0.11, 0.02),
    )
    n = 4000
    fit = Fit(coordinates, np.array([1.2, -4.0]), np.diag([0.1, 0.1]), n * rms**2, {})
    return Outcome(
        choice,
        fit,
        dict.fromkeys(views, n * rms**2),
        dict.fromkeys(views, n),
        dict.fromkeys(views, 3.0),
        views,
    )


def searched(troubled: set[str]) -> Search:
    views = ("valve_x", "valve_z", "friction_x", "friction_z", "contact", "sensors", "timing")
    return Search(
        {view: fitted(rms=2.4 if view in troubled else 1.0, views=(view,)) for view in views},
        troubled,
    )


def gap_result(run: LoggedRun, before: float = 1.0, after: float = 0.05) -> GapResult:
    measured = run.log.measured()
    curves = {"nominal": shapes(run.log.time, before), "augmented": shapes(run.log.time, after)}
    sigmas = np.array([SIGMA[c] for c in MEASURED])
    rms = {
        name: np.sqrt((((measured - curve) / sigmas) ** 2).mean(axis=0))
        for name, curve in curves.items()
    }
    channels = {
        c: (float(rms["nominal"][i]), float(rms["augmented"][i])) for i, c in enumerate(MEASURED)
    }
    nominal, augmented = (float(np.sqrt((r**2).mean())) for r in (rms["nominal"], rms["augmented"]))
    shrink = 1 - (augmented**2 - 1) / max(nominal**2 - 1, 1e-9)
    return GapResult(
        nominal, augmented, 1.0, shrink, (shrink - 0.02, min(shrink + 0.01, 1.0)), channels, curves
    )


def cause(
    key: str, probability: float, **parameters: tuple[float, float, float, str]
) -> dict[str, Any]:
    effect = CATALOGUE[key]
    entries = {
        n: {"value": v, "ci95": [low, high], "unit": unit, "form": effect.forms[0].name}
        for n, (v, low, high, unit) in parameters.items()
    }
    return {
        "effect": effect.name,
        "axis": effect.axis,
        "probability": probability,
        "parameters": entries,
    }


def diagnosis(kind: str) -> Diagnosis:
    measured = campaign(single=kind == "single")
    run = measured.logs["contour_curved"]
    best = Trial(Choice(), fitted(("presliding/z", 0)), 412.0)
    best.choice = best.outcome.choice
    rival = Trial(Choice(), fitted(("stribeck/z", 0), rms=1.31), 287.0)
    rival.choice = rival.outcome.choice
    pair = Trial(
        Choice(),
        fitted(("presliding/z", 0), ("valve_delay/x", 0), views=("friction_z", "valve_x")),
        640.0,
    )
    pair.choice = pair.outcome.choice
    presliding = cause(
        "presliding/z",
        0.94,
        **{
            "axis_z.friction.sigma": (9.7e4, 8.9e4, 1.06e5, "N/m"),
            "axis_z.friction.beta": (15.2, 2.0, 40.0, "N"),
        },
    )
    where: list[dict[str, Any]] = [
        {
            "block": "friction_z",
            "share": 0.83,
            "logs": ["free_motion"],
            "regime": "reversals of v_z",
        },
        {"block": "valve_x", "share": 0.17, "logs": [], "regime": ""},
    ]
    ranked = [
        Hypothesis(("presliding/z",), 0.94, best),
        Hypothesis(("stribeck/z",), 0.04, rival),
        Hypothesis((), 0.0, None),
    ]
    decision = Decision("identified", ranked, best, 0.02, 0.01, "friction_z", [["presliding/z"]])
    closed = {"nominal": 3.1, "augmented": 0.4, "floor": 0.3, "shrink": 0.98}
    values, stages = (
        {"axis_z.friction.C": 46.1, "valve_z.tau": 0.1},
        {"search": 18.0, "confirmation": 3.4},
    )
    d = Diagnosis(
        measured,
        decision,
        searched({"friction_z"}),
        values,
        where,
        [presliding, cause("stribeck/z", 0.04)],
        gap_result(run),
        "contour_curved",
        closed,
        ["a note with <b>"],
        21.4,
        stages,
    )
    if kind == "two":
        hypotheses = [
            Hypothesis(pair.choice.keys, 0.91, pair),
            Hypothesis(("presliding/z",), 0.07, best),
        ]
        d.decision = replace(
            decision,
            hypotheses=hypotheses,
            best=pair,
            answer_set=[["presliding/z", "valve_delay/x"]],
        )
        d.causes = [
            presliding,
            cause("valve_delay/x", 0.93, **{"valve_x.delay_time": (0.0042, 0.0040, 0.0044, "s")}),
        ]
    if kind == "ambiguous":
        hypotheses = [
            Hypothesis(("presliding/z",), 0.55, best),
            Hypothesis(("stribeck/z",), 0.42, rival),
        ]
        d.decision = replace(
            decision,
            verdict="ambiguous",
            hypotheses=hypotheses,
            answer_set=[["presliding/z"], ["stribeck/z"]],
        )
    if kind == "unknown":
        hypotheses = [Hypothesis(h.keys, 0.12 * h.probability, h.trial) for h in ranked]
        d.decision = replace(
            decision,
            verdict="unknown",
            hypotheses=hypotheses,
            unexplained=0.61,
            unknown=0.88,
            answer_set=[["unknown"]],
        )
        d.gap = gap_result(run, 1.0, 0.7)
    if kind in ("none", "bare"):
        d.decision = Decision("none", [Hypothesis((), 0.99, None)], None, 0.0, 0.01, "", [[]])
        d.found, d.where, d.causes = searched(set()), [], []
        d.gap = gap_result(run, 0.0, 0.0)
    if kind in ("no_gap", "bare"):
        d.gap, d.closed = None, None
    if kind == "bare":
        d.notes, d.stages, d.values = [], {}, {}
    return d


# ---------------------------------------------------------------- the page


class Shape(HTMLParser):
    """Every tag that is opened is closed, and every address that is named."""

    VOID = ("meta", "br", "input", "img")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.pictures = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "action", "data")]
        self.pictures += tag == "svg" and "picture" in (dict(attrs).get("class") or "")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def page(kind: str, folder: Path) -> str:
    return write_report(diagnosis(kind), folder / f"{kind}.html").read_text(encoding="utf-8")


def words(text: str) -> str:
    return unescape(
        re.sub(
            r"\s+",
            " ",
            re.sub(r"<[^>]+>", " ", re.sub(r"<(script|style).*?</\1>", "", text, flags=re.DOTALL)),
        )
    )


@pytest.mark.parametrize("kind", VERDICTS)
def test_a_page_is_whole_small_and_asks_for_nothing(kind: str, tmp_path: Path) -> None:
    text = page(kind, tmp_path)
    shape = Shape()
    shape.feed(text)
    assert shape.open == []
    assert shape.addresses == []
    assert "//" not in re.sub(
        r'<script type="application/json".*?</script>', "", text, flags=re.DOTALL
    ).replace("url(#", "")
    assert len(text) < 2_000_000
    has_gap = kind not in ("no_gap", "bare")
    assert shape.pictures == (1 + 1 + len(MEASURED) if has_gap else 1)
    said = words(text)
    assert "rig <7> & co" in said
    assert "nan" not in re.findall(r"\w+", said)
    assert not re.findall(r"\b(None|np\.float64|inf)\b(?! is)", said)
    for section in (
        "Where",
        "Which",
        "How far",
        "Fitted parameters",
        "Limits of these logs",
        "Next experiment",
        "Logs",
    ):
        assert f"<h2>{section}</h2>" in text


def test_a_page_says_what_was_found(tmp_path: Path) -> None:
    said = words(page("identified", tmp_path))
    assert (
        "presliding/z (displacement-dependent friction instead of a stick band), sigma 97000 N/m "
        "(89000 to 106000), beta 15.2 N (2 to 40), probability 94 % explains the fitted logs; "
        "the gap of contour_curved falls from" in said
    )
    assert "Runner-up: stribeck/z, probability 4 %." in said
    assert (
        "is 287 against 412, 125 less. In friction_z it leaves a residual of 1.31 RMS, "
        "the first 1.02 (floor" in said
    )
    assert "axis_z.friction.sigma 97000 89000 to 106000 N/m" in said
    assert said.count("poorly determined") == 1
    assert "reversals of v_z" in said
    assert "a note with <b>" in said
    assert "nominal 3.1, augmented 0.4, floor 0.3, shrink 0.98" in said
    assert said.count("unusual") == 1  # valve_z.tau, 4.8 standard deviations off


def test_the_sentence_fits_the_verdict(tmp_path: Path) -> None:
    said = {kind: words(page(kind, tmp_path)) for kind in VERDICTS}
    assert (
        "and valve_delay/x (pure transport delay), delay_time 0.0042 s (0.004 to 0.0044), "
        "probability 93 % explains" in said["two"]
    )
    assert (
        "do not settle which effect it is in friction_z: presliding/z, or stribeck/z; with the "
        "first one, the gap" in said["ambiguous"]
    )
    assert (
        "A real effect in friction_z that no entry of the catalogue explains (probability 88 %)"
        in said["unknown"]
    )
    assert "Nothing beyond tolerance and noise" in said["none"]
    assert "at the floor, nothing to shrink" in said["none"]
    assert "tolerance fitted" in said["none"]
    assert "could not be replayed" in said["no_gap"]
    assert "One log only" in said["single"]


def test_the_next_experiment_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = {
        "what": "Slow triangle of u_z",
        "scenario": 'name = "triangle"\n',
        "separates": [["presliding/z"], ["stribeck/z"]],
        "separation": 41.0,
    }
    monkeypatch.setattr(
        "pneugantry.diagnosis.report.report_json",
        lambda d: report_json(d) | {"next_experiment": experiment},
    )
    said = words(page("ambiguous", tmp_path))
    assert (
        "Slow triangle of u_z It separates presliding/z from stribeck/z (separation 41). "
        'name = "triangle"' in said.replace("  ", " ")
    )


# ---------------------------------------------------------------- its parts


def test_blocks_of_another_plant_are_drawn_too() -> None:
    picture = plant_svg({"friction_x": 0.7, "gearbox": 0.3})
    assert "gearbox" in picture
    assert "70 %" in picture
    assert "30 %" in picture


def test_a_gap_that_grows_or_is_not_known_is_drawn() -> None:
    picture = gap_svg(
        [("x", 1.0, 40.0), ("z", float("nan"), 2.0), ("f_x", 0.0, 0.0)], 1.0, "augmented"
    )
    assert "not known" in picture
    assert "nan" not in picture


def test_round_ticks() -> None:
    assert ticks(0.0, 3.0, 6) == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    assert ticks(1.0, 1.0) == [1.0]


@pytest.mark.parametrize("n", [1500, 3 * SAMPLES + 7])
def test_the_packed_signals_are_the_signals(n: int) -> None:
    time = np.arange(n, dtype=np.float64) * PERIOD
    signal = shapes(time)
    signal[5, 3] = np.nan
    data = packed(time, {"measured": signal}, [])
    assert data["full"] == (n <= SAMPLES)
    for i, channel in enumerate(data["channels"]):
        raw = np.frombuffer(base64.b64decode(channel["data"]["measured"]), dtype="<u2")
        assert len(raw) <= SAMPLES + 2
        values = np.where(raw == 65535, np.nan, channel["low"] + channel["scale"] * raw)
        factor = 1e3 if i < 4 else 1.0
        assert np.nanmax(values) == pytest.approx(
            factor * np.nanmax(signal[:, i]), abs=channel["scale"]
        )
        assert np.nanmin(values) == pytest.approx(
            factor * np.nanmin(signal[:, i]), abs=channel["scale"]
        )
        assert channel["scale"] < 0.1 * channel["sigma"]
        if data["full"]:
            np.testing.assert_allclose(values, factor * signal[:, i], atol=channel["scale"])
        else:
            assert data["dt"] * len(raw) == pytest.approx(n * PERIOD, rel=0.01)


def fitted_logs(d: Diagnosis) -> list[LoggedRun]:
    return [run for name, run in d.campaign.logs.items() if name != d.held_out]


def test_what_the_logs_do_not_excite_is_said() -> None:
    d = diagnosis("identified")
    said = not_excited(fitted_logs(d))
    assert any("closed loop" in text for text in said)  # the only closed loop is held out
    single = not_excited(diagnosis("single").campaign)
    assert not any("closed loop" in text for text in single)
    assert any("one workpiece only (curved)" in text for text in single)
    d.campaign.logs["free_motion"] = LoggedRun(
        LogSetup(clamped=("x", "z")), d.campaign.logs["free_motion"].log
    )
    assert any("nothing can be said of friction_z" in text for text in not_excited(fitted_logs(d)))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (9.7e4, "97000"),
        (0.00042, "0.00042"),
        (1.2e-7, "1.2·10^-7"),
        (float("nan"), "–"),
        (None, "–"),
        (1.0, "1"),
    ],
)
def test_numbers_are_legible(value: float | None, text: str) -> None:
    assert number(value) == text


def test_a_probability_that_is_not_certain_does_not_read_as_certain() -> None:
    assert [percent(p) for p in (0.0, 0.004, 0.94, 0.996, 1.0)] == [
        "0 %",
        "< 1 %",
        "94 %",
        "> 99 %",
        "100 %",
    ]


@pytest.mark.parametrize("kind", VERDICTS)
def test_the_result_keeps_to_its_published_schema(kind: str) -> None:
    schema = Path(__file__).parents[3] / "docs" / "reference" / "schemas" / "gap.json"
    found = json.loads(json.dumps(report_json(diagnosis(kind)), default=float))
    Draft202012Validator(json.loads(schema.read_text(encoding="utf-8"))).validate(found)


@pytest.mark.parametrize("kind", VERDICTS)
def test_page_and_terminal_say_the_same(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    d = diagnosis(kind)
    print_diagnosis(report_json(d))
    printed, shown = capsys.readouterr().out, words(page(kind, tmp_path))
    for cause in report_json(d)["causes"]:
        assert f"probability {percent(cause['probability'])}" in printed
    for share in re.findall(r"probability ([<>]? ?\d+ %)", headline(report_json(d))):
        assert f"probability {share}" in shown
        assert f"probability {share}" in printed


def test_an_effect_that_makes_an_unseen_log_worse_is_not_called_identified(tmp_path: Path) -> None:
    d = diagnosis("identified")
    d.gap = gap_result(d.campaign.logs["contour_curved"], 0.5, 1.0)
    found = report_json(d)
    assert found["gap"]["shrink"] < 0
    assert confirmed(found) is False
    assert verdict_word(found) == "not confirmed"
    said = headline(found)
    assert "grows from" in said
    assert "does not bear that out: do not act on it" in said
    assert "shrink -" not in said
    text = words(write_report(d, tmp_path / "page.html").read_text(encoding="utf-8"))
    assert "not confirmed" in text
    assert said.split("; ")[-1] in text


@pytest.mark.parametrize(
    ("entry", "shown"),
    [
        ((0.022, 0.02199, 0.02201), ("0.022", "0.02199", "0.02201")),
        ((0.0219964, 0.0219951, 0.0219977), ("0.0219964", "0.0219951", "0.0219977")),
        ((9.7e4, 8.9e4, 1.06e5), ("97000", "89000", "106000")),
        ((1.0, 1.0, 1.0), ("1", "1", "1")),
        ((1.0, float("-inf"), float("inf")), ("1", "–", "–")),
    ],
)
def test_the_ends_of_an_interval_can_be_told_apart(
    entry: tuple[float, float, float], shown: tuple[str, str, str]
) -> None:
    assert interval(*entry) == shown


@pytest.mark.parametrize("kind", VERDICTS)
def test_the_command_prints_it(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    d = diagnosis(kind)
    print_diagnosis(report_json(d))
    out = capsys.readouterr().out
    assert f"verdict: {d.decision.verdict}" in out
    assert out.endswith("seconds: 21.4\n")


# ---------------------------------------------------------------- in a browser


def opened(
    html: Path, folder: Path, size: str = "1200,3200", more: tuple[str, ...] = ()
) -> tuple[str, Array]:
    """Standard error and screenshot of Chromium showing a page."""
    assert CHROMIUM is not None
    shot = folder / "shot.png"
    command = [
        CHROMIUM,
        *FLAGS,
        *more,
        f"--user-data-dir={folder / 'profile'}",
        f"--screenshot={shot}",
        f"--window-size={size}",
        html.resolve().as_uri(),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    assert shot.is_file(), done.stderr[-2000:]
    return done.stderr, np.asarray(imread(shot))[:, :, :3]


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on PATH (apt-get install chromium)")
@pytest.mark.parametrize("kind", ["identified", "unknown", "none", "bare"])
def test_a_browser_shows_it_without_errors(kind: str, tmp_path: Path) -> None:
    html = write_report(diagnosis(kind), tmp_path / "report.html")
    html.write_text(
        html.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>"), encoding="utf-8"
    )
    log, picture = opened(html, tmp_path)
    console = [line for line in log.splitlines() if "CONSOLE" in line]
    assert len(console) == 1, console  # the probe's, no error, no refused request
    seen = json.loads(
        re.sub(r'", source:.*$', "", console[0].split("PROBE", 1)[1]).replace('\\"', '"')
    )
    has_gap = kind != "bare"
    assert (seen["blank"], seen["hidden"], seen["wide"]) == (0, 0, False)
    assert (seen["canvases"], seen["svgs"]) == ((8, 10) if has_gap else (0, 1))
    assert (picture.min(axis=2) < 0.5).mean() > 0.005  # ink
    if has_gap:
        (a, b), (c, d), (e, f) = seen["whole"], seen["zoomed"], seen["panned"]
        assert d - c < 0.5 * (b - a)
        assert a < c < d < b
        assert f - e == pytest.approx(d - c)
        assert e > c
        assert seen["reset"] == seen["whole"]


def replayed_page(folder: Path) -> Path:
    """A page with every log, its diagnosis made by hand and its logs replayed on the FMU."""
    d = diagnosis("identified")
    d.values = {"axis_z.C": 46.1, "valve_z.tau": 0.14}
    return write_report(d, folder / "report.html", FmuFile.read(build_fmu().path))


def test_every_log_is_in_the_page_with_its_blocks_over_time(tmp_path: Path) -> None:
    text = replayed_page(tmp_path).read_text(encoding="utf-8")
    logs = list(campaign().logs)
    assert sorted(re.findall(r'class="data" data-log="(\w+)"', text)) == sorted(logs)
    assert sorted(re.findall(r'class="of-log" data-log="(\w+)"', text)) == sorted(logs)
    assert text.count('<svg class="strip"') == len(logs)
    said = words(text)
    assert re.search(
        r"Made 20\d\d-\d\d-\d\d .* by pneugantry .*, nominal FMU sha256 [0-9a-f]{16}", said
    )
    assert "What to do next." in said
    found = re.search(r'data-log="free_motion">(\{.*?\})</script>', text)
    assert found
    data = json.loads(found[1])
    assert len(data["channels"]) == len(MEASURED)


LOOK = f"<script>{(Path(__file__).parent / 'look.js').read_text(encoding='utf-8')}</script>"


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on PATH (apt-get install chromium)")
@pytest.mark.parametrize(("width", "dark"), [(1200, False), (480, False), (1200, True)])
def test_width_contrast_keyboard_and_the_choice_of_a_log(
    width: int, dark: bool, tmp_path: Path
) -> None:
    html = replayed_page(tmp_path)
    text = html.read_text(encoding="utf-8")
    html.write_text(text.replace("</body>", LOOK + "</body>"), encoding="utf-8")
    more = ("--blink-settings=preferredColorScheme=0",) if dark else ()
    log, picture = opened(html, tmp_path, f"{width},4000", more)
    console = [line for line in log.splitlines() if "CONSOLE" in line]
    assert len(console) == 1, console
    told = re.sub(r'", source:.*$', "", console[0].split("PROBE", 1)[1]).replace('\\"', '"')
    seen = json.loads(told)
    assert seen["words"] >= 4.5  # WCAG AA for text
    assert seen["curves"] >= 3.0  # and for graphics
    assert seen["dark"] == dark
    assert (float(picture.mean()) < 0.5) == dark
    assert not seen["wide"]
    assert seen["focus"]
    assert seen["title"].startswith("Signals of free_motion")
    assert seen["strips"] == 1
    start, end = map(float, seen["after"].split())
    assert end - start < 0.8 * 3.0  # s: "+" has zoomed in


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on PATH (apt-get install chromium)")
def test_it_is_a_static_picture_without_javascript(tmp_path: Path) -> None:
    html = write_report(diagnosis("identified"), tmp_path / "report.html")
    text = html.read_text(
        encoding="utf-8"
    )  # without the page's script; headless mode itself needs scripts on
    text = re.sub(r'<script>\n"use strict".*?</script>', "", text, flags=re.DOTALL)
    html.write_text(
        text.replace("</head>", "<style>body > :not(#panels) { display: none; }</style></head>"),
        encoding="utf-8",
    )
    log, picture = opened(html, tmp_path)
    assert "CONSOLE" not in log
    orange, blue = (
        np.abs(picture - np.array(colour) / 255).max(axis=2) < 0.1
        for colour in ((196, 78, 0), (0, 100, 168))
    )
    assert orange.sum() > 500
    assert blue.sum() > 500
