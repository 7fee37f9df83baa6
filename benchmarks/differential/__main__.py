"""Differential fuzz: random models of the whole language, compiled and run against an interpreter.

    python -m benchmarks.differential [--count N] [--seed N] [--keep FOLDER] [--json FILE]

Each model is drawn as Modelica text and, piece by piece, as functions; the functions are integrated
by scipy. They share no line with the compiler. Counted: right, wrong (a silent error), refused (in
one line), stopped (the run ended with a message), crash. --keep: texts of all that is not right.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from benchmarks.differential import interpreter, runner
from benchmarks.differential.features import FEATURES, model_of
from benchmarks.differential.model import Model
from modelica_fmu.errors import InputError

STOP, POINTS = 2.0, 17  # s
BESIDE = 1e-5  # s: a value that jumps may do so that much earlier or later
TOLERANCE = 2e-4  # of 1 + |value|
MOST = 7  # pieces of a model


class Outcome(NamedTuple):
    seed: int
    state: str
    features: list[str]
    said: str


def points() -> np.ndarray:
    """Output times in threes, s; nothing happens at them by design."""
    middle = (np.arange(1, POINTS + 1) - 0.4142135623) * STOP / POINTS
    return np.sort(np.concatenate([middle - BESIDE, middle, middle + BESIDE]))


def drawn_model(seed: int) -> Model:
    rng = random.Random(seed)
    pieces = [rng.choice(list(FEATURES)) for _ in range(rng.randint(2, MOST))]
    return model_of(rng, pieces)


def differing(found: dict[str, np.ndarray], wanted: dict[str, np.ndarray]) -> str:
    """The variable that is furthest from the interpreter's, or nothing."""
    worst, told = 0.0, ""
    for name, values in wanted.items():
        threes = values.reshape(-1, 3)
        middle = found[name].reshape(-1, 3)[:, 1:2]
        error = np.min(np.abs(threes - middle), axis=1) / (1 + np.abs(threes[:, 1]))
        error = np.where(np.isnan(middle[:, 0]), np.inf, error)
        k = int(np.argmax(error))
        if error[k] > max(worst, TOLERANCE):
            worst = float(error[k])
            time = points()[3 * k + 1]
            told = f"{name} = {middle[k, 0]:.9g} at {time:.4f} s, not {threes[k, 1]:.9g}"
    return told


def checked(model: Model, text: str) -> tuple[str, str]:
    """State and message of a text that should mean what `model` does."""
    times = points()
    try:
        with TemporaryDirectory(prefix="differential-") as folder:
            found = runner.run(text, model.compared, times, Path(folder))
        told = differing(found, interpreter.run(model, times))
    except InputError as error:
        return "refused", str(error).split("/m.mo:")[-1]
    except runner.Stopped as error:
        return "stopped", str(error)
    except Exception as error:  # a crash is a result, too
        return "crash", f"{type(error).__name__}: {error}"[:300]
    return ("wrong", told) if told else ("right", "")


def tried(seed: int, keep: Path | None = None) -> Outcome:
    model = drawn_model(seed)
    text = model.text()
    state, told = checked(model, text)
    if keep is not None and state != "right":
        keep.mkdir(parents=True, exist_ok=True)
        (keep / f"{seed}.mo").write_text(f"// {state}: {told}\n{text}", encoding="utf-8")
    return Outcome(seed, state, model.features, told)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=1000, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    parser.add_argument("--keep", type=Path, metavar="FOLDER")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    outcomes = []
    for seed in range(options.seed, options.seed + options.count):
        made = tried(seed, options.keep)
        outcomes.append(made)
        if made.state != "right":
            print(f"{made.state:8} {made.seed}  {made.said}", flush=True)
    counts = Counter(o.state for o in outcomes)
    used = Counter(name for o in outcomes for name in o.features)
    print(f"{len(outcomes)} models: " + ", ".join(f"{n} {s}" for s, n in counts.items()))
    print("pieces: " + ", ".join(f"{n} {name}" for name, n in used.most_common()))
    if options.json is not None:
        found = {
            "models": len(outcomes),
            "counts": dict(counts),
            "pieces": dict(used),
            "others": [o._asdict() for o in outcomes if o.state != "right"],
        }
        options.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 1 if counts["wrong"] + counts["crash"] else 0


if __name__ == "__main__":
    sys.exit(main())
