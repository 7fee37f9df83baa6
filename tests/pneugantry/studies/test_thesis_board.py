"""The leaderboard over structures, the gap and the list, short."""

import importlib.util
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controllers.catalogue import make_controller
from modelica_fmu.errors import InputError
from pneugantry.analysis.plots_thesis import panels_figure
from pneugantry.thesis import (
    figures,
    figures_rig,
    gap,
    pictured,
    structure_board,
    tuning_report,
)
from pneugantry.thesis.board_report import board_lines, board_report
from pneugantry.thesis.conditions import Run
from pneugantry.thesis.contents import contents, contents_report
from pneugantry.thesis.entrants import Entrant, entrants
from pneugantry.thesis.figures_rig import speed_drawings, tracked_drawings
from pneugantry.thesis.gap import (
    DRAWS,
    Combination,
    GapCell,
    chosen_windows,
    likelihood,
    measured_cells,
    predicted_cells,
    print_gaps,
)
from pneugantry.thesis.gap_report import gap_figure
from pneugantry.thesis.loop_limits import FoundMargins, cosimulated_margins, linear_margins
from pneugantry.thesis.peers import PEERS
from pneugantry.thesis.pictured import picture_runs
from pneugantry.thesis.printed import WORKPIECES
from pneugantry.thesis.robust_design import design_plants, distances, needed
from pneugantry.thesis.run_store import RunStore
from pneugantry.thesis.runner import Done, Results, run_one
from pneugantry.thesis.scores import Effort, Scores, Trace
from pneugantry.thesis.structure_board import (
    LIMIT,
    NOMINAL_LIMIT,
    BoardRow,
    Outcome,
    StructureBoard,
    Wanted,
    entrant_runs,
    run_board,
)
from pneugantry.thesis.structures import NOMINAL, catalogue_structures, pairs, structures
from pneugantry.thesis.tuned import TUNED
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.scenario import scenario_from
from pyfmi_runner.sensors import converter_steps

ROOT = Path(__file__).resolve().parents[3]
ROBUST = Entrant("robust_fv", "robust_fv")


@pytest.fixture(scope="module")
def fmu() -> FmuFile:
    return FmuFile.read(build_fmu().path)


def test_structures_hold_what_the_board_promises(fmu):
    chosen = [*structures(), *pairs(), *catalogue_structures(fmu)]
    names = [s.name for s in chosen]
    assert len(set(names)) == len(names) > 100
    for wanted in ("VDFM on z", "LuGre on z", "Stribeck on both", "dead time 20 ms", "noise x 3"):
        assert wanted in names
    assert {"second lag 40 ms", "supply droop 20%", "stiffness x 0.5", "stiffness x 2"} <= {*names}
    moved = {s.name: s for s in chosen}
    assert dict(moved["valve_delay/z +"].plant) == {"valve_z.delay_time": pytest.approx(0.01)}
    assert dict(moved["contact_stiffness -"].plant) == {"contact.K_c": pytest.approx(3.5e4)}


@pytest.mark.parametrize("name", ["nominal", "dead time 20 ms", "second lag 40 ms", "LuGre on z"])
def test_robust_controller_meets_its_limit_where_it_is_hardest(fmu, name):
    structure = next(s for s in structures() if s.name == name)
    limit = NOMINAL_LIMIT if structure is NOMINAL else LIMIT
    runs = entrant_runs(ROBUST, [structure])[name]
    assert runs
    for run in runs:
        done = run_one(run, fmu)
        assert done.scores.rmse_fn <= limit
        assert done.effort.noise_z < 0.2  # V
        assert done.effort.limits_z < 0.05


def test_robust_controller_bears_finishes_that_nothing_was_tuned_to(fmu):
    run = NOMINAL.run("straight", "robust_fv", finish="random", draw=77)
    ours, pi = run_one(run, fmu), run_one(run.changed(controller="pi_fv"), fmu)
    assert ours.scores.rmse_fn < 0.5 * pi.scores.rmse_fn


def test_robust_design_keeps_the_distance_that_it_demands(fmu):
    plants = design_plants(fmu)
    found = distances(make_controller("robust_fv"), plants)
    assert all(found[plant.label] >= 0.95 * needed(plant) for plant in plants)
    slack = {plant.label for plant in plants if needed(plant) == -math.inf}
    assert slack == {"dead time 10 ms, z stuck", "dead time 20 ms, z stuck"}
    old = distances(make_controller("observer_fv"), plants)
    assert old["dead time 10 ms, z"] < 0.0  # what the design was for


def test_margins_from_co_simulation_are_those_of_the_linear_loop(fmu):
    linear, found = linear_margins(ROBUST, fmu), cosimulated_margins(ROBUST, fmu)
    assert linear is not None
    assert found.delay == pytest.approx(linear.delay, rel=0.15)
    assert linear_margins(Entrant("mbpm", "pi_fv_mbpm"), fmu) is None


def test_every_entrant_has_margins_or_a_state_of_arrays(fmu):
    found = {e.name: linear_margins(e, fmu) for e in entrants()}
    assert found["pi_fv_scheduled"] == found["pi_fv"]  # Table 5.1 from 0 degrees has its f_z gains
    without = {name for name, margins in found.items() if margins is None}
    assert all("mbpm" in name or "ebpa" in name or name == "pi_fv_anfis" for name in without)


def test_entrants_are_the_catalogue_and_its_tuned_peers():
    names = [e.name for e in entrants()]
    assert {"pi_fv", "observer_fv", "robust_fv"} <= {*names}
    assert set(TUNED) <= set(PEERS) - {"robust_fv"}
    for entrant in entrants():
        make_controller(entrant.controller, **dict(entrant.options))


def row(name: str, **rmse: float) -> BoardRow:
    outcomes = {key: Outcome(value, 0.1, 0.0) for key, value in rmse.items()}
    return BoardRow(name, outcomes, [], None, FoundMargins(math.inf, 0.04))


def test_a_board_is_met_only_where_every_asked_structure_is():
    late, stiff = structures()[10], structures()[-1]
    chosen = [NOMINAL, late, stiff]
    pi = row("pi_fv", **{NOMINAL.name: 3.0, late.name: 3.9, stiff.name: 4.1})
    good = row("robust_fv", **{NOMINAL.name: 0.9, late.name: 1.4, stiff.name: 9.0})
    board = StructureBoard([good, pi], chosen)
    assert board.met
    assert set(board.asked()) == {NOMINAL.name, late.name}  # the PI is lost on the third itself
    bad = row("robust_fv", **{NOMINAL.name: 0.9, late.name: 1.6, stiff.name: 0.5})
    report = board_report(StructureBoard([bad, pi], chosen))
    assert report["met"] is False
    assert report["missed"] == {late.name: 1.6}
    assert report["rows"][0]["margins_cosimulated"]["gain"] is None  # JSON has no infinity
    assert any("MISSED" in line for line in board_lines(StructureBoard([bad, pi], chosen)))


def test_a_board_runs_from_end_to_end_and_nothing_twice(fmu, tmp_path, monkeypatch):
    for name, found in (("structures", [NOMINAL]), ("pairs", [])):
        monkeypatch.setattr(structure_board, name, lambda found=found: found)
    monkeypatch.setattr(structure_board, "catalogue_structures", lambda _: [])
    store = RunStore(tmp_path / "runs.sqlite", fmu.sha256)
    wanted = Wanted(0, ("pi_fv", "robust_fv"), margins=False)
    first, again = (run_board(fmu.path, wanted, workers=1, store=store) for _ in range(2))
    store.close()
    assert [r.name for r in first.rows] == ["robust_fv", "pi_fv"]  # best median first
    assert first.met
    assert first.rows == again.rows
    assert store.taken == 4


def test_a_board_without_margins_has_its_scores():
    rows = [replace(row(n, **{NOMINAL.name: 0.9}), found=None) for n in ("robust_fv", "pi_fv")]
    board = StructureBoard(rows, [NOMINAL])
    report = board_report(board)
    assert [r["margins_cosimulated"] for r in report["rows"]] == [None, None]
    assert report["rows"][0]["nominal"] == 0.9
    assert not any("Margins" in line for line in board_lines(board))


def test_printed_gap_of_rmse_closes_with_the_measured_edge():
    gaps = {p.column: p for p in print_gaps()}
    assert gaps["RMSE f_n"].explained > 0.95
    assert gaps["ME v_t"].explained < 0.0
    assert gaps["RMSE f_n"].modelled == pytest.approx(
        math.sqrt((1.4**2 + 0.2**2 + 0.6**2 + 0.6**2) / 4)
    )


def test_measured_cells_are_those_of_three_tables():
    cells = measured_cells()
    assert len(cells) == 16 + 6 + 6
    assert {c.table for c in cells} == {"3.9", "3.10", "3.12"}
    assert cells[0].half_step in (0.1, 0.0005)


def test_a_likelihood_prefers_the_truth_and_allows_for_the_print():
    cells = [GapCell("3.12", "a", "a", "RMSE f_n", value) for value in (3.0, 1.2)]
    right, wrong = np.array([[3.05, 1.15], [2.95, 1.25]]), np.array([[4.0, 2.0], [4.1, 1.9]])
    assert likelihood(cells, right)[0] > likelihood(cells, wrong)[0] + 3.0
    exact = likelihood(cells, np.array([[3.0, 1.2]]))
    assert exact[2][1] == pytest.approx(math.hypot(0.1 / math.sqrt(3.0), 0.12))


def test_gap_windows_are_chosen_table_by_table(fmu, monkeypatch):
    monkeypatch.setattr(
        gap, "measured_rows", lambda: [r for r in gap.printed_rows() if r.table == "3.12"][:1]
    )
    drawn = predicted_cells(str(fmu.path), "random angle", "K_c 1e4", NOMINAL, draws=2)
    assert drawn is not None
    assert {name: d.shape for name, d in drawn.items()} == dict.fromkeys(gap.WINDOWS, (2, 4))
    steady = drawn["steady motion"]
    assert (steady[:, 3] < drawn["motion"][:, 3]).all()  # the start's v_t error is left out
    cells = [c for c in measured_cells() if c.table == "3.12"][:4]
    c = Combination("random angle", "K_c 1e4", ("motion", "motion", "steady motion"))
    assert np.array_equal(chosen_windows(cells, drawn, c), steady)
    assert DRAWS >= 2


def test_every_table_and_figure_is_listed_once_with_ours_or_a_reason():
    entries = contents()
    names = [entry.name for entry in entries]
    assert len(set(names)) == len(names)
    assert all(entry.ours or entry.why_not for entry in entries)
    drawn = {path.stem for path in tuning_report.picture_paths(Path())}
    for module in (figures, figures_rig, pictured):
        drawn |= set(re.findall(r"fig_\w+", Path(module.__file__).read_text("utf-8")))
    drawn |= {"fig_" + stem for stem in fitted_stems()}
    for entry in entries:
        if entry.kind == "part":
            assert (ROOT / entry.ours).exists(), entry
        elif entry.kind == "picture":
            assert entry.ours.removeprefix("out/thesis/") in drawn, entry


def fitted_stems() -> list[str]:
    """Of the pictures whose names `figures` puts together."""
    first, last = ("4_22", "4_23", "4_24", "4_25"), ("4_32_4_33", "4_34", "4_35", "4_36")
    tracked = [f"{n}_{piece}" for n, piece in zip(first, WORKPIECES, strict=True)]
    turned = [f"{n}_reversals_{piece}" for n, piece in zip(last, WORKPIECES, strict=True)]
    return tracked + turned


def test_pictures_of_the_rigs_runs_are_those_that_the_list_names():
    time = np.arange(17.5, 28.5, 0.01)
    trace = Trace(time, *(np.full_like(time, level) for level in (0.9, 0.04, 30.0, 0, 0, 1, 1, 40)))
    results = Results()
    for run in [*picture_runs(), *(Run(piece) for piece in WORKPIECES)]:
        results.done[run] = Done(Scores(0, 0, 0, 0), Effort(0, 0, 0, 0, 0, 0), trace)
    drawn = speed_drawings(results) | tracked_drawings(results)
    listed = {e.ours.removeprefix("out/thesis/") for e in contents() if e.kind == "picture"}
    assert len(drawn) == 9
    assert set(drawn) <= listed
    for name, (panels, title, columns) in drawn.items():
        assert title.startswith(f"Fig. {'.'.join(name.split('_')[1:3])}:")
        assert all(panel.curves for panel in panels)
        assert panels_figure(panels, title, columns).axes
    close = drawn["fig_3_33_4_28_4_29_curved"][0][-1]
    assert close.x_range == (25.0, 28.5)
    assert close.curves["PI FV"][0][0] == pytest.approx(25.0)


def test_the_gaps_picture_shows_every_cell_and_rival():
    recorded = json.loads((ROOT / "docs/results/data/thesis_gap.json").read_text("utf-8"))["result"]
    factors, effects, tests, cells = gap_figure(recorded).axes
    assert len(factors.patches) == len(recorded["factors"])
    assert len(effects.patches) == 12
    assert len(tests.patches) == len(recorded["tests"])
    assert [bar.get_width() for bar in cells.patches] == [c["stray"] for c in recorded["cells"]]


def test_the_list_says_of_what_kind_ours_is():
    found = contents_report()
    assert sum(found["kinds"].values()) == len(found["entries"])
    assert found["ours"] == len(found["entries"]) - found["kinds"]["none"]
    kinds = {e["name"]: e["kind"] for e in found["entries"]}
    assert kinds["Table 4.7"] == "numbers"
    assert kinds["Fig. 3.30"] == "picture"
    assert kinds["Table 3.5"] == kinds["Fig. 5.4"] == "part"
    assert kinds["Fig. 5.9"] == "none"


def test_the_list_names_what_the_thesis_lists():
    text = sorted((ROOT.parent / "shared" / "thesis").glob("*.txt"))
    if not text:
        pytest.skip("the thesis' text is not beside the checkout")
    said = text[0].read_text(encoding="utf-8")
    wanted = {f"Fig. {n}" for n in re.findall(r"Figure ([1-6A-E]\.\d+):", said)}
    wanted |= {f"Table {n}" for n in re.findall(r"Table ([1-6A-E]\.\d+):", said)}
    assert len(wanted) > 200
    missing = wanted - {entry.name for entry in contents()}
    assert not missing


def test_converter_steps_are_the_rigs():
    steps = converter_steps()
    assert steps[4] == pytest.approx(0.083, abs=5e-4)  # N
    assert steps[2] == pytest.approx(1.6e-3, abs=5e-5)  # m/s
    assert converter_steps(13)[4] == pytest.approx(0.5 * steps[4])
    with pytest.raises(ValueError, match=r"1\.\.24"):
        converter_steps(0)


def test_the_results_page_holds_what_was_recorded():
    spec = importlib.util.spec_from_file_location("thesis_page", ROOT / "docs" / "thesis_page.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = module.PAGE.read_text(encoding="utf-8")
    assert set(re.findall(r"<!-- thesis: (\w+) -->", text)) == set(module.PARTS)
    assert module.page(text) == text  # python docs/thesis_page.py


def test_a_scenario_takes_the_rigs_converter():
    given = scenario_from({"sensors": {"converter_bits": 12}})
    assert given.sensors.quantum == converter_steps(12)
    assert scenario_from({}).sensors.quantum == (0.0,) * 8
    with pytest.raises(InputError, match=r"converter_bits.*1\.\.24|1\.\.24"):
        scenario_from({"sensors": {"converter_bits": 40}})
