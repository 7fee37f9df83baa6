"""Records results for the documents: `python docs/record.py [NAME ...]` runs the commands below and
keeps what they write with `--json`, beside the command and the version. The site draws its tables
from these files.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "docs" / "results" / "data"
NOMINAL = "../shared/campaigns/nominal"  # another simulator's recording; not in this repository
CAMPAIGNS = " ".join(
    f"../shared/campaigns/{n}"
    for n in (
        "nominal",
        "rig_coulomb_level_x",
        "example_valve_delay_z",
        "example_presliding_z",
    )
)
BOOK = "../ModelicaByExample"  # public sources, not in this repository either
LIBRARY = "../ModelicaStandardLibrary"  # of version 4.1.0
RESULTS = "../MAP-LIB_ReferenceResults"  # of the same version
PUBLIC = "../public_models"  # checkouts of other public sources, each in a folder owner+name
COMMANDS = {  # name: the command, without --json
    "rootlocus_none": "pneugantry rootlocus --axis z --lag none",
    "rootlocus_z": "pneugantry rootlocus --axis z --lag z",
    "rootlocus_x": "pneugantry rootlocus --axis z --lag x",
    "motor": "pneugantry diagnose examples/motor/plant.toml",
    "blind_nuisance": "pneugantry blind --set nuisance --seed 94000 --cases 60 --no-learn",
    "blind_nofa": "pneugantry blind --set nofa --seed 93100 --cases 24 --no-learn",
    "blind_contour": "pneugantry blind --set contour --seed 93000 --cases 30 --no-learn",
    "blind_three": "pneugantry blind --set three --seed 93200 --cases 24 --no-learn",
    "blind_wide": "pneugantry blind --set wide --seed 87872 --cases 16 --no-learn",
    "blind_random": "pneugantry blind --set random --seed 90580 --cases 16 --no-learn",
    "drive_blind": "python -m benchmarks.drive_blind --seed 92420",
    "bam_planted": "python -m examples.bam planted --raw ../shared/real/bam_xl330",
    "replay": f"pneugantry replay {NOMINAL}",
    "diagnosis_time": f"python -m benchmarks.diagnosis_time {CAMPAIGNS}",
    "solver_check": "python -m benchmarks.solver_check",
    "bad_input": "python -m benchmarks.bad_input",
    "clean_install": "python -m benchmarks.clean_install --zig",
    "thesis": "pneugantry thesis --no-figures",
    "thesis_gap": "pneugantry thesis --gap --draws 2 --no-figures",
    "thesis_board": "pneugantry thesis --board",
    "thesis_variants": "pneugantry thesis --variants --draws 8",
    "thesis_board_peers": "pneugantry thesis --board --controllers pi_fv robust_fv pi_fv_pressure "
    "pi_fv_pressure_tuned pi_fv_pressure_nominal",
    "thesis_peers": "python -m pneugantry.thesis.robust_design pi_fv_pressure --nominal --starts 4",
    "thesis_tuning": "pneugantry thesis --tuning --no-figures",
    "benchmark": "pneugantry benchmark --only-paths",
    "stiff": "python -m benchmarks.stiff",
    "compiler_times": "python -m benchmarks.compiler_times --before 6d6764b^",
    "soak_models": "python -m benchmarks.soak --only models --count 1200",
    "cross_check": "python -m benchmarks.cross_check out/cross-check",
    "textbook": f"python -m benchmarks.textbook {BOOK} --also {LIBRARY}",
    "standard_library": f"python -m benchmarks.standard_library {LIBRARY} --references {RESULTS}",
    "math_functions": f"python -m benchmarks.math_functions {LIBRARY}",
    "public_models": f"python -m benchmarks.public_models {PUBLIC} --also {LIBRARY} "
    f"--also {PUBLIC}/ORNL-Modelica+TRANSFORM-Library",
    "differential": "python -m benchmarks.differential --count 500",
}


def record(name: str) -> None:
    """Runs a command and keeps its result. Raises CalledProcessError where it fails."""
    words = COMMANDS[name].split()
    run = [sys.executable, "-m", "pneugantry", *words[1:]]
    if words[0] == "python":
        run = [sys.executable, *words[1:]]
    with tempfile.TemporaryDirectory() as folder:
        found = Path(folder) / "found.json"
        subprocess.run([*run, "--json", str(found)], cwd=ROOT, check=True)
        text = found.read_text(encoding="utf-8").replace(str(ROOT.parent), "..")
        text = text.replace(str(Path.home()), "~")
    result = json.loads(text)
    said = subprocess.run(
        ["git", "log", "-1", "--format=%cs"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    kept = {"command": COMMANDS[name], "version": said.stdout.strip(), "result": result}
    DATA.mkdir(parents=True, exist_ok=True)
    (DATA / f"{name}.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    for chosen in sys.argv[1:] or COMMANDS:
        record(chosen)
