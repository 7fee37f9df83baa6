"""The thesis study, short: a few runs, every table and conclusion that they feed."""

import numpy as np
import pytest

from pneugantry.thesis.conclusions import Conclusion, tracking_runs
from pneugantry.thesis.conditions import CHOICE, Run, scenario_of
from pneugantry.thesis.edge import edge_file
from pneugantry.thesis.leaderboard import NEW, PARAMETERS, SPREAD, drawn_runs, step_times
from pneugantry.thesis.plant_tests import (
    friction_conclusion,
    hysteresis,
    lag_conclusion,
    locus_conclusion,
)
from pneugantry.thesis.printed import WORKPIECES, printed_rows
from pneugantry.thesis.runner import Results, Workers, batches, run_one
from pneugantry.thesis.scores import score_log
from pneugantry.thesis.tables import Cell, ablation_run, cells, met_share, run_of, table_runs
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile

PRINTED_SIMULATION = {
    "4.7": 16,
    "4.8": 16,
    "4.9": 6,
    "4.10": 6,
    "4.11": 20,
    "4.12": 20,
    "4.13": 20,
    "4.14": 20,
    "4.15": 40,
    "5.2": 8,
    "5.5": 32,
}


@pytest.fixture(scope="module")
def fmu() -> FmuFile:
    return FmuFile.read(build_fmu().path)


@pytest.fixture(scope="module")
def pi_fv(fmu) -> Results:
    """PI FV on the four edges with the measured finish."""
    results = Results()
    for piece in WORKPIECES:
        run = Run(piece)
        results.done[run] = run_one(run, fmu, trace=True)
    return results


def test_every_printed_cell_has_a_place():
    rows = printed_rows()
    counts = {
        table: sum(v is not None for r in rows if r.table == table for v in r.values)
        for table in PRINTED_SIMULATION
    }
    assert counts == PRINTED_SIMULATION
    assert {r.table for r in rows} >= {"3.9", "3.10", "3.12", "3.14", "6.1"}


def test_tables_share_runs():
    assert run_of(
        next(r for r in printed_rows() if r.table == "4.7" and r.row == "curved")
    ) == ablation_run("curved", "all on")
    assert len(set(table_runs())) < len(printed_rows())


def test_finish_stays_within_three_degrees():
    for finish in (CHOICE.modelled, CHOICE.measured):
        assert finish.largest_angle <= np.deg2rad(3.05)


def test_a_batch_holds_one_controller():
    runs = [Run(piece, name) for piece in WORKPIECES for name in ("pi_fv", NEW)]
    found = batches([*runs, *runs], size=3)
    assert sorted(map(len, found)) == [1, 1, 3, 3]
    assert all(len({run.controller for run in batch}) == 1 for batch in found)


def test_drawn_plants_stay_within_the_spread_and_are_the_same_for_every_controller():
    ours, other = drawn_runs(NEW, 3), drawn_runs("pi_fv", 3)
    assert [r.plant for r in ours] == [r.plant for r in other]
    plant = dict(ours[0].plant)
    assert all(abs(plant[name] / value - 1.0) <= SPREAD for name, value in PARAMETERS.items())
    assert ours[0].plant != ours[2].plant


def test_scores_are_those_of_the_scored_window(fmu, pi_fv):
    trace = pi_fv.trace(Run("straight"))
    window = trace.time >= 22.0 - CHOICE.quiet
    assert pi_fv[Run("straight")].rmse_fn == pytest.approx(
        np.sqrt(np.mean((30.0 - trace.f_n[window]) ** 2)), rel=0.02
    )


def test_straight_edge_is_the_worst_and_the_new_controller_the_best(fmu, pi_fv):
    rmse = {piece: pi_fv[Run(piece)].rmse_fn for piece in WORKPIECES}
    assert max(rmse, key=rmse.__getitem__) == "straight"
    for piece in ("straight", "curved"):
        assert run_one(Run(piece, NEW), fmu).scores.rmse_fn < 0.4 * rmse[piece]


def test_plant_conclusions_hold(fmu):
    ddfm, vdfm = hysteresis(fmu, 3.0, CHOICE), hysteresis(fmu, 2.0, CHOICE)
    for conclusion in (friction_conclusion(ddfm, vdfm), locus_conclusion(fmu), lag_conclusion(fmu)):
        assert conclusion.holds, conclusion


def test_a_conclusion_that_does_not_hold_says_why():
    assert "K_p" in Conclusion(4, "lag", False).reason
    assert Conclusion(4, "lag", True).reason == ""


def test_met_share_counts_simulation_cells_once():
    one = Cell("4.7", "straight", "RMSE f_n", "simulation", 4.0, 4.9)
    repeat, experiment = (
        Cell("4.15", "", "", "simulation", 1.0, 9.0),
        Cell("3.12", "", "", "experiment", 1.0, 9.0),
    )
    assert met_share([one, repeat, experiment]) == 1.0
    assert met_share([one, repeat, experiment], ["4.15"]) == 0.0


def test_cells_hold_ours_beside_the_printed(pi_fv):
    class Everything(Results):
        def __getitem__(self, run):
            return pi_fv[Run("straight")]

    found = cells(Everything())
    assert len(found) == sum(v is not None for row in printed_rows() for v in row.values)
    assert found[0].ours > 0


def test_edge_of_fig_4_30_turns_from_plus_to_minus():
    scenario = scenario_of(Run(edge_file(), finish="none"))
    assert scenario.z_0 > 0.0
    assert any(run.workpiece == edge_file() for run in tracking_runs())


def test_workers_in_this_process_give_the_same_results(fmu, pi_fv):
    with Workers(fmu.path, count=1) as pool:
        results = pool.collect(pool.start_runs([Run("straight")]))
    assert results[Run("straight")] == pi_fv[Run("straight")]


def test_step_time_of_a_controller_is_a_few_microseconds():
    assert 0.0 < step_times(["pi_fv"])["pi_fv"] < 50.0


def test_score_log_is_the_window_of_the_log(fmu):
    from pyfmi_runner.run import run_scenario

    log = run_scenario(scenario_of(Run("incline_16")), fmu).log
    scores = score_log(log, quiet=0.0, v_td=-0.06, f_nd=30.0)
    assert scores.me_fn >= scores.rmse_fn > 0.0
    assert scores.me_vt == pytest.approx(0.06, abs=0.06)
