"""Effects as TOML, and read back."""

from __future__ import annotations

from pathlib import Path

from pneugantry.engine.hypotheses.catalogue import Effect, Form, Parameter, read_catalogue
from pneugantry.learn.answer.export import effects_toml


def test_a_written_effect_is_read_as_it_was(tmp_path: Path) -> None:
    """With every field of a parameter that a catalogue may set; a step excludes the two others."""
    late = Parameter("delay", 0.01, 0.02, -0.5, 0.5, "s", starts=(0.1, 0.2), step=0.001)
    share = Parameter("gain", 1.0, 0.1, 0.5, 2.0, "1", relative=True, positive=True)
    plain = Parameter("plain", 0.0, 1.0, -1.0, 1.0)
    form = Form("both", (late, share, plain), {"law": 3.0})
    effects = [
        Effect("slow", "x", "valve", "acts late", (form,), ("lag",)),
        Effect("b", "", "c", "d", (form,)),
    ]
    (tmp_path / "effects.toml").write_text(effects_toml(effects), encoding="utf-8")
    assert read_catalogue(tmp_path / "effects.toml") == {e.key: e for e in effects}
