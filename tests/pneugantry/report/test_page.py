"""The page: self-contained, the same words as the terminal, and right in a browser."""

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
import pytest
from jsonschema import Draft202012Validator
from matplotlib.image import imread
from numpy.typing import NDArray

from pneugantry.engine.answer.confirm import Replay
from pneugantry.engine.answer.decide import Decision
from pneugantry.engine.answer.result import to_json
from pneugantry.engine.hypotheses.catalogue import Form
from pneugantry.engine.rules import Rules
from pneugantry.engine.run import Found
from pneugantry.report.headline import (
    chance,
    confirmed,
    headline,
    interval,
    number,
    percent,
    verdict_word,
)
from pneugantry.report.page import Extras, write_page
from pneugantry.report.pictures import SAMPLES, Curves, Shown, gap_svg, packed, ticks
from pneugantry.report.visibility import visibility
from pneugantry.report.words import next_steps, parameter_rows

Array = NDArray[np.float64]
PERIOD, ROWS = 4e-3, 800  # of the records in conftest.py
RULES = Rules(band=125.0, thinning=1)  # as there
CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
browser = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium on PATH (apt-get install chromium)"
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

EXTRAS = Extras(
    drawing='<svg viewBox="0 0 880 340" role="img"><rect width="880" height="340"/></svg>',
    closed_loop={"nominal": 3.1, "augmented": 0.4, "floor": 0.3, "shrink": 0.98},
    phases={"other": [("start", 0.0, 1.0), ("<rest>", 1.0, 3.2)]},
    setups={"sweep": {"loop": "open"}},
    source="cart.toml",
)
SECTIONS = (
    "Where",
    "Which",
    "How far",
    "Signals",
    "What the answer leaves",
    "Tolerance",
    "Limits of these logs",
    "Next experiment",
    "Logs",
)


def page(found: Found, folder: Path, extras: Extras = EXTRAS) -> str:
    return write_page(found, folder / "page.html", extras).read_text(encoding="utf-8")


def words(text: str) -> str:
    """What a reader sees, tags and data taken out."""
    bare = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", text, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", bare)).split()).replace(" ,", ",")


def other(found: Found, **change: Any) -> Found:
    """The same with another diagnosis or decision: verdicts that the small plant does not give."""
    own = {k: v for k, v in change.items() if k in Decision.__dataclass_fields__}
    told = {k: v for k, v in change.items() if k not in ("answers", "chosen", "none", "unknown")}
    diagnosis = replace(found.diagnosis, **told)
    gap = change.get("gap", found.gap)
    return replace(found, decision=replace(found.decision, **own), diagnosis=diagnosis, gap=gap)


class Balanced(HTMLParser):
    """Tags that are opened are closed."""

    VOID = ("meta", "br", "input", "link", "img", "hr")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


# ---------------------------------------------------------------- the page


@pytest.mark.parametrize("kind", ["found", "sound"])
def test_a_page_is_whole_and_asks_for_nothing(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    text = page(request.getfixturevalue(kind), tmp_path)
    assert not re.search(r"""(src|href)=["']|url\((?!#)|https?://|@import""", text)
    for section in SECTIONS:
        assert f"<h2>{section}</h2>" in text
    assert not re.search(r"\b(nan|None|np\.float64|inf)\b(?! is)", words(text))
    parser = Balanced()
    parser.feed(text)
    assert parser.open == []
    assert [p.name for p in tmp_path.iterdir()] == ["page.html"]


def test_a_page_says_what_was_found(found: Found, tmp_path: Path) -> None:
    text = page(found, tmp_path)
    said, facts = words(text), to_json(found.diagnosis)
    assert found.diagnosis.verdict == "identified"
    assert headline(facts, {"spring": "a spring <that> pulls back"}) in said
    size = found.diagnosis.causes[0].parameters["spring"]
    value, low, high = interval(size.value, size.low, size.high)
    assert f"spring spring {value} {low} to {high} N/m linear" in said
    assert "Sim-to-real gap of cart <7> & co" in said
    assert said.count("a note with <b>") == 1
    assert "nominal 3.1, augmented 0.4, floor 0.3, shrink 0.98" in said
    assert "pneugantry diagnose cart.toml --augmented" in said
    assert "<rest>" not in text
    assert re.search(r"Made 20\d\d-\d\d-\d\d .* by pneugantry .*, Toy.mo sha256 [0-9a-f]{16}", said)


def test_the_causes_probability_is_the_only_one_that_is_claimed(
    found: Found, tmp_path: Path
) -> None:
    unsure = replace(found.diagnosis.causes[0], probability=0.87)
    said = words(page(other(found, causes=(unsure,)), tmp_path))
    assert "probability 87 %, explains the fitted logs" in said
    assert "spring 87 % a spring" in said


def test_every_record_is_in_the_page_with_its_signals(found: Found, tmp_path: Path) -> None:
    text = page(found, tmp_path)
    names = ["other", "sweep", "slow"]  # the one that no fit saw is shown first
    assert re.findall(r'class="data" data-log="(\w+)"', text) == names
    assert re.findall(r'class="of-log" data-log="(\w+)"', text) == names
    assert text.count('<svg class="strip"') == 3
    for name in names:
        data = re.search(rf'data-log="{name}">(\{{.*?\}})</script>', text)
        assert data
        channels = json.loads(data[1])["channels"]
        assert [c["name"] for c in channels] == ["force", "speed"]
        assert [c["unit"] for c in channels] == ["N", "mm/s"]


def finer(r: Replay) -> Replay:
    """Every row twice, at half the period."""
    twice = {k: np.repeat(getattr(r, k), 2, axis=0) for k in ("measured", "simulated", "residuals")}
    return replace(r, period=r.period / 2, **twice)


@pytest.mark.parametrize("twice", [False, True])
def test_the_page_shows_the_replays_of_the_gap(found: Found, tmp_path: Path, twice: bool) -> None:
    """Its residuals, decoded as a browser does, are those that the gap was taken from; at the rate
    of the replays, too, which is finer than that of the fits for a gantry: rows of two rates once
    stood beside each other, and a gap of 1 was drawn as thousands.
    """
    assert found.gap is not None
    assert found.nominal is not None
    assert found.augmented is not None
    if twice:
        found = replace(found, nominal=finer(found.nominal), augmented=finer(found.augmented))
    text = page(found, tmp_path)
    data = json.loads(re.search(r'data-log="other">(\{.*?\})</script>', text)[1])  # type: ignore[index]
    assert data["dt"] == PERIOD / (1 + twice)
    for channel in data["channels"]:
        curve = {n: decoded(channel, text) for n, text in channel["data"].items()}
        assert {len(v) for v in curve.values()} == {ROWS * (1 + twice)}
        for i, model in enumerate(("nominal", "augmented")):
            left = (curve["measured"] - curve[model]) / channel["sigma"]
            expected = found.gap.by_signal[channel["name"]][i]
            assert np.sqrt(np.mean(left**2)) == pytest.approx(expected, rel=1e-2)


def decoded(channel: dict[str, Any], text: str) -> Array:
    raw = np.frombuffer(base64.b64decode(text), dtype="<u2")
    return np.where(raw == 65535, np.nan, channel["low"] + channel["scale"] * raw)


def test_curves_of_two_rates_are_refused() -> None:
    shown = (Shown.of("s", "m", 1e-3),)
    with pytest.raises(ValueError, match="need one shape"):
        Curves(shown, 1e-3, {"measured": np.zeros((4, 1)), "nominal": np.zeros((8, 1))})


def test_a_cause_of_one_campaign_alone_is_marked_as_chosen() -> None:
    size = {"value": 0.02, "ci95": [0.019, 0.021], "unit": "s"}
    both = {"effect": "valve_delay", "axis": "z", "parameters": {"delay": size}}
    alone = {**both, "campaign": "after"}
    rows = parameter_rows([both, alone], ["valve_delay/z@after"])
    assert [r["effect"] for r in rows] == ["valve_delay/z", "valve_delay/z@after"]
    assert [r["chosen"] for r in rows] == [False, True]


def test_what_may_be_there_as_well_is_told_beside_an_identified_effect(found: Found) -> None:
    facts = to_json(other(found, answer_set=(("spring",), ("spring", "drag"), ("drag",))).diagnosis)
    drag = {"effect": "drag", "axis": "", "probability": 0.3, "parameters": {}}
    facts["causes"] = [facts["causes"][0], drag]
    assert "There may be drag (probability 30 %) as well." in headline(facts)
    facts["causes"] = [facts["causes"][0], {**drag, "probability": 0.02}]
    assert "as well" not in headline(facts)


def test_the_sentence_fits_the_verdict(found: Found, sound: Found) -> None:
    assert sound.diagnosis.verdict == "none"
    assert "Nothing beyond tolerance and noise" in headline(to_json(sound.diagnosis))
    unknown = other(
        found,
        verdict="unknown",
        probabilities={"unknown": 0.88},
        answer_set=(("spring", "unknown"),),
    )
    said = headline(to_json(unknown.diagnosis))
    assert "that no entry of the catalogue explains (probability 88 %); beside it spring," in said
    both = other(found, verdict="ambiguous", answer_set=(("spring",), ("drag", "unknown")))
    said = headline(to_json(both.diagnosis))
    assert "spring, or drag + something that the catalogue lacks; with the first one" in said
    assert found.gap is not None
    rest = replace(
        found.gap,
        nominal=1126.0,
        augmented=49.3 * found.gap.floor,
        shrink=0.998,
        ci95=(0.997, 0.999),
    )
    said = headline(to_json(other(found, gap=rest).diagnosis))
    assert "What is left of it is 49.3 times the floor: its replay carries an error of" in said
    assert said.endswith("is not all; in the fitted logs no more than noise is left.")
    assert "not all" not in headline(to_json(found.diagnosis))
    facts = to_json(other(found, gap=rest, verdict="unknown").diagnosis)
    assert headline({**facts, "learned": {"accepted": True}}).endswith("the term is not all.")
    assert "not all" not in headline(facts)
    look = "Look in the strip and the signals below where and when the residual is large."
    assert look in next_steps(to_json(other(found, gap=rest).diagnosis), None, "")
    assert look not in next_steps(to_json(found.diagnosis), None, "")
    bare = other(found, gap=None)
    none_proposed = {**facts, "verdict": "ambiguous", "next_experiment": None}
    assert next_steps(none_proposed, None, "x.toml")[0].startswith("pneugantry plan x.toml tells")
    assert (
        "below" in next_steps({**none_proposed, "next_experiment": {"what": "steps"}}, None, "")[0]
    )
    assert "could not be replayed" in headline(to_json(bare.diagnosis))


def test_an_effect_that_makes_an_unseen_log_worse_is_not_called_identified(
    found: Found, tmp_path: Path
) -> None:
    assert found.gap is not None
    worse = replace(found.gap, nominal=4.0, augmented=8.0, shrink=-3.2, ci95=(-4.0, -2.0))
    doubted = other(found, gap=worse)
    facts = to_json(doubted.diagnosis)
    assert confirmed(facts) is False
    assert verdict_word(facts) == "not confirmed"
    said = words(page(doubted, tmp_path))
    assert "grows from 4 to 8" in said
    assert "does not bear that out: do not act on it" in said


def test_what_stands_out_is_marked(found: Found, tmp_path: Path) -> None:
    """A nuisance far off, and a signal with far more left than noise."""
    point = found.decision.best.point
    theta = point.theta.copy()
    theta[0] = 4.8 * point.coordinates[0].spread
    fit = replace(found.decision.best, point=point.moved(theta))
    channel = next(iter(found.excess.whole))
    whole = {**found.excess.whole, channel: 3.0 * found.excess.level}
    odd = replace(
        found,
        decision=replace(found.decision, best=fit),
        excess=replace(found.excess, whole=whole),
    )
    said = words(page(odd, tmp_path))
    assert said.count("unusual") == 1
    assert said.count("stands out") == 2  # the mark, and the sentence below the table


def test_what_the_logs_can_tell_stands_folded(found: Found, tmp_path: Path) -> None:
    """An effect, one like it under another name, one too small to be seen, one of no view."""
    known = found.task.catalogue
    drag, spring = known["drag"].forms[0].parameters[0], known["spring"].forms[0].parameters[0]
    more = {
        "brake": replace(drag, scale=0.31),
        "feather": replace(spring, name="spring", scale=1e-9),
        "ghost": replace(spring, name="no_such_parameter"),
    }
    made = {k: replace(known["drag"], name=k, forms=(Form("f", (p,)),)) for k, p in more.items()}
    task = replace(found.task, catalogue={**known, **made})
    seen = visibility(task, RULES)
    by = {row.effect: row for row in seen.rows}
    assert {k: r.mark for k, r in by.items()} == {
        "spring": "",  # the feather cannot grow to it
        "drag": "not told apart",
        "brake": "not told apart",
        "feather": "not seen",
    }
    assert (by["drag"].rival, by["brake"].rival) == ("brake", "drag")
    assert seen.unseen == ("ghost",)
    assert dict(seen.adds).keys() == {"sweep", "slow"}
    plain = visibility(found.task, RULES)
    assert [r.mark for r in plain.rows] == ["", ""]
    assert plain.told == 2.0
    text = page(replace(found, task=task), tmp_path)
    folded = text[text.index('<details id="seen">') :]
    told = words(folded[: folded.index("</details>")])
    assert f"tell apart: {seen.told:.1f} of 5 effects of the catalogue" in told
    assert "No measured signal shows: ghost." in told
    assert told.count("not told apart") == 2
    assert "pneugantry plan says which further experiment" in told


def test_a_plant_that_could_not_be_replayed_has_a_page(found: Found, tmp_path: Path) -> None:
    data = replace(found.task.data, fitted=(), held_out=None)
    task = replace(found.task, data=data)
    bare = replace(other(found, gap=None), task=task, nominal=None, augmented=None)
    text = page(bare, tmp_path, Extras())
    assert "Not known: the held-out log could not be replayed" in words(text)
    assert "<canvas" not in text
    assert 'id="panels"' not in text


LEARNED = {
    "accepted": True,
    "why": "the gap of other falls",
    "sentence": "missing term (learnt): 2*v*abs(v) in cart",
    "screen": [],
    "gap": {
        "nominal": 9.0,
        "without": 4.0,
        "with": 1.02,
        "floor": 1.0,
        "shrink": 1,
        "log": "other",
    },
}
TERM = {
    "block": "cart",
    "component": "",
    "equation": "m*der(v) = f - c*v <b>",
    "regressor": "v",
    "form": "quadratic",
    "formula": "2*v*abs(v)",
    "beside": [],
    "cost": 1.0,
}


def test_a_learnt_term_is_drawn_with_its_band_and_its_rivals(found: Found, tmp_path: Path) -> None:
    at = [-1.0, 0.0, 1.0]
    curve = {
        "at": at,
        "value": [-2.0, 0.0, 2.0],
        "low": [-3.0, -1.0, 1.0],
        "high": [-1.0, 1.0, 3.0],
    }
    units = {"regressor": "m/s", "term": ""}
    term = {**TERM, "parameters": {}, "range": [-1.0, 1.0], "units": units, "curve": curve}
    rival = {**TERM, "regressor": "s", "formula": "k*s"}
    own = {**LEARNED, "term": term, "answer_set": [TERM, rival]}
    text = page(found, tmp_path, Extras(learned=own))
    said = words(text)
    assert "--augmented out/ writes the plant with the learnt term" in said
    assert "Missing term" in said
    assert "missing term (learnt): 2*v*abs(v) in cart" in said
    assert "4 without the term, 1.02 with it (floor 1)" in said
    assert "k*s" in said
    assert "<b>" not in text.split("Missing term")[1].split("Tolerance")[0]  # escaped
    assert "v [m/s]" in text
    assert "added []" not in text  # a balance: what it adds has no unit of its own
    band = re.search(r'<polygon points="([^"]*)"', text)
    assert band
    assert len(band[1].split()) == 2 * len(at)


def test_a_term_that_was_not_found_says_why(found: Found, tmp_path: Path) -> None:
    none = {**LEARNED, "sentence": "missing term: none found; too few rows", "term": None}
    said = words(page(found, tmp_path, Extras(learned={**none, "answer_set": []})))
    assert "missing term: none found; too few rows" in said
    assert "Missing term" not in words(page(found, tmp_path))


def test_the_next_experiment_is_shown(found: Found, tmp_path: Path) -> None:
    experiment = {
        "what": "Slow triangle of u",
        "scenario": 'name = "triangle"\n',
        "separates": [["spring"], ["drag"]],
        "separation": 41.0,
    }
    said = words(page(found, tmp_path, Extras(next_experiment=experiment)))
    assert (
        "Slow triangle of u It separates spring from drag (separation 41). "
        'name = "triangle"' in said
    )


def test_the_result_keeps_to_its_published_schema(found: Found, sound: Found) -> None:
    schema = Path(__file__).parents[3] / "docs" / "reference" / "schemas" / "gap.json"
    validator = Draft202012Validator(json.loads(schema.read_text(encoding="utf-8")))
    for each in (found, sound):
        validator.validate(json.loads(json.dumps(to_json(each.diagnosis))))


# ---------------------------------------------------------------- its parts


def test_a_gap_that_grows_or_is_not_known_is_drawn() -> None:
    rows = [("x", 1.0, 40.0), ("z", float("nan"), 2.0), ("a_long_name", 0.0, 0.0)]
    picture = gap_svg(rows, 1.0, "augmented")
    assert "not known" in picture
    assert "nan" not in picture


def test_round_ticks() -> None:
    assert ticks(0.0, 3.0, 6) == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    assert ticks(1.0, 1.0) == [1.0]


@pytest.mark.parametrize("n", [1500, 3 * SAMPLES + 7])
def test_the_packed_signals_are_the_signals(n: int) -> None:
    time = np.arange(n) * 1e-3
    signal = np.column_stack([np.sin(3 * time), 30 + 4 * np.cos(time)])
    signal[5, 1] = np.nan
    shown = (Shown.of("s", "m", 1e-3), Shown.of("f", "N", 0.05))
    data = packed(Curves(shown, 1e-3, {"measured": signal, "nominal": 1.01 * signal}), [])
    assert data["full"] == (n <= SAMPLES)
    for i, (channel, factor) in enumerate(zip(data["channels"], (1e3, 1.0), strict=True)):
        values = decoded(channel, channel["data"]["measured"])
        assert len(values) <= SAMPLES + 2
        assert channel["scale"] < 0.1 * channel["sigma"]
        for end in (np.nanmin, np.nanmax):
            expected = factor * end(signal[:, i])
            assert end(values) == pytest.approx(expected, abs=channel["scale"])
        if data["full"]:
            np.testing.assert_allclose(values, factor * signal[:, i], atol=channel["scale"])
        else:
            assert data["dt"] * len(values) == pytest.approx(n * 1e-3, rel=0.01)
            off = channel["difference"]["nominal"]
            largest = np.nanmax(-0.01 * factor * signal[:, i] / channel["sigma"])
            assert np.nanmax(decoded(off, off["data"])) == pytest.approx(largest, rel=1e-3)


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
    assert [chance(p) for p in (0.0, 0.5, 1.0)] == ["< 1 %", "50 %", "> 99 %"]


@pytest.mark.parametrize(
    ("entry", "shown"),
    [
        ((0.022, 0.02199, 0.02201), ("0.02200", "0.02199", "0.02201")),
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


@browser
@pytest.mark.parametrize("kind", ["found", "sound"])
def test_a_browser_shows_it_without_errors(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    text = page(request.getfixturevalue(kind), tmp_path, Extras())
    html = tmp_path / "page.html"
    html.write_text(text.replace("</body>", PROBE + "</body>"), encoding="utf-8")
    log, picture = opened(html, tmp_path)
    console = [line for line in log.splitlines() if "CONSOLE" in line]
    assert len(console) == 1, console  # the probe's, no error, no refused request
    seen = json.loads(
        re.sub(r'", source:.*$', "", console[0].split("PROBE", 1)[1]).replace('\\"', '"')
    )
    assert (seen["blank"], seen["hidden"], seen["wide"]) == (0, 0, False)
    assert (seen["canvases"], seen["svgs"]) == (2, 3)
    assert (picture.min(axis=2) < 0.5).mean() > 0.005  # ink
    (a, b), (c, d), (e, f) = seen["whole"], seen["zoomed"], seen["panned"]
    assert d - c < 0.5 * (b - a)
    assert a < c < d < b
    assert f - e == pytest.approx(d - c)
    assert e > c
    assert seen["reset"] == seen["whole"]


LOOK = f"<script>{(Path(__file__).parent / 'look.js').read_text(encoding='utf-8')}</script>"


@browser
@pytest.mark.parametrize(("width", "dark"), [(1200, False), (480, False), (1200, True)])
def test_width_contrast_keyboard_and_the_choice_of_a_log(
    found: Found, width: int, dark: bool, tmp_path: Path
) -> None:
    text = page(found, tmp_path)
    html = tmp_path / "page.html"
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
    assert seen["title"].startswith("Signals of sweep")
    assert seen["strips"] == 1
    assert seen["unfolded"]
    start, end = map(float, seen["after"].split())
    assert end - start < 0.8 * 3.2  # s: "+" has zoomed in


@browser
def test_it_is_a_static_picture_without_javascript(found: Found, tmp_path: Path) -> None:
    text = page(found, tmp_path)
    # without the page's script; headless mode itself needs scripts on
    text = re.sub(r'<script>\n"use strict".*?</script>', "", text, flags=re.DOTALL)
    html = tmp_path / "page.html"
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
    assert orange.sum() > 100
    assert blue.sum() > 100
