"""The thesis study, short: a few runs, every table and conclusion that they feed."""

import math

import numpy as np
import pytest

from pneugantry.analysis.metrics import task_frame
from pneugantry.thesis.conclusions import Conclusion
from pneugantry.thesis.conditions import CHOICE, NO_LAG, SOFT, Run, scenario_of
from pneugantry.thesis.edge import edge_file, ladder_runs, steepest_pushed, uphill_errors
from pneugantry.thesis.lag_readings import READINGS, factor_effect, readings_conclusion
from pneugantry.thesis.leaderboard import NEW, PARAMETERS, SPREAD, drawn_runs, step_times
from pneugantry.thesis.plant_tests import (
    friction_conclusion,
    hysteresis,
    identified_lags,
    locus_conclusion,
)
from pneugantry.thesis.printed import WORKPIECES, printed_rows
from pneugantry.thesis.random_finish import BOUND, edge_with_finish, random_angle
from pneugantry.thesis.runner import Results, Workers, batches, run_one
from pneugantry.thesis.scores import score_log
from pneugantry.thesis.settings import FITTED, Setting, settings
from pneugantry.thesis.tables import (
    Cell,
    ablation_run,
    cells,
    met_share,
    run_of,
    table_runs,
    tracked_rows,
    unique_cells,
)
from pneugantry.thesis.verdicts import verdict, wilson
from pyfmi_runner.build import build_fmu
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import PHASES
from pyfmi_runner.workpiece import read_profile, workpiece

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


def test_plant_conclusions_hold_with_both_contacts(fmu):
    for choice in (CHOICE, SOFT):
        ddfm, vdfm = hysteresis(fmu, 3.0, choice), hysteresis(fmu, 2.0, choice)
        for conclusion in (friction_conclusion(ddfm, vdfm), locus_conclusion(fmu, choice)):
            assert conclusion.holds, conclusion


def test_a_friction_of_the_wrong_size_fails_conclusion_9(fmu):
    wide = {"axis_z.friction.beta": 18.0}
    pair = (hysteresis(fmu, law, CHOICE, **wide) for law in (3.0, 2.0))
    assert not friction_conclusion(*pair).holds


def test_identified_lags_follow_the_position(fmu):
    lags = identified_lags(fmu)
    assert lags["tau_x at 0 m, filling"] > 3.0 * lags["tau_x at 1 m, filling"]
    assert lags["tau_z at 0 m, filling"] == pytest.approx(lags["tau_z at 0.1 m, filling"], abs=2e-3)


def test_printed_readings_decide_conclusion_15(monkeypatch):
    assert readings_conclusion().holds
    even = {0.1: ((0.15, 0.15, 0.14),) * 2, 0.0: ((0.30, 0.31, 0.30),) * 2}
    monkeypatch.setitem(READINGS, "z", even)
    assert factor_effect("z", "position").p < 1e-6
    assert not readings_conclusion().holds


def test_a_verdict_needs_every_unfitted_group_and_carries_an_interval():
    def judged(*held):
        return [
            (group, Conclusion(4, "lag", ok, {"cut": 0.1 * k}))
            for k, (group, ok) in enumerate(held)
        ]

    mixed = judged(("fitted", True), ("a", True), ("a", True), ("b", False), ("b", True))
    found = verdict(mixed, ["a", "b"])
    assert (found.holds, found.fitted, found.groups["b"].held) == (False, True, 1)
    assert found.numbers["cut"].low == pytest.approx(0.1)  # the fitted setting counts in no number
    assert "K_p" in found.reason
    assert verdict(mixed, ["a"]).holds
    assert wilson(8, 8)[0] == pytest.approx(0.6756, abs=1e-4)  # closed form: 1 / (1 + z^2 / n)
    assert wilson(0, 8) == pytest.approx((0.0, 1.0 - 0.6756), abs=1e-4)


def test_a_random_finish_stays_within_the_bound_and_differs_by_draw():
    x = np.linspace(0.3, 0.95, 2000)
    first, second = random_angle(x, 0), random_angle(x, 1)
    assert np.abs(first).max() <= BOUND
    assert np.std(first) > 0.3 * BOUND
    assert np.abs(first - second).max() > 0.5 * BOUND
    assert np.array_equal(first, random_angle(x, 0))


def test_a_random_finish_adds_its_angle_to_the_edges_own():
    x = np.linspace(0.4, 0.94, 500)
    straight, curved = (
        read_profile(edge_with_finish(piece, 3)) for piece in ("straight", "curved")
    )
    own = np.arctan(workpiece("curved").slope(x))
    added = np.arctan(curved.slope(x)) - own
    held = np.abs(np.gradient(random_angle(x, 3))) < 1e-9
    assert np.abs(added - random_angle(x, 3))[held].max() < np.radians(
        0.3
    )  # the spline rings at corners
    assert straight.height(0.95) == pytest.approx(0.0, abs=1e-6)


def test_a_setting_replaces_finish_and_contact_but_leaves_a_bare_edge_bare():
    random = next(s for s in settings(2) if s.group == "random angle, K_c 1e4")
    run = random.applied(Run("curved", finish="modelled"))
    assert (run.finish, run.choice) == ("random", SOFT)
    assert random.applied(Run("curved")).draw != run.draw  # a rig's own finish is another draw
    assert random.applied(Run("curved", finish="none")).finish == "none"
    assert FITTED.applied(Run("curved")) == Run("curved")
    assert len(set(settings(2))) == 10


def test_slid_waves_are_the_same_edge_further_on():
    finish = CHOICE.modelled
    moved, d, x = finish.slid(0.01), 0.01, 0.6
    for before, after, length in zip(finish.phase, moved.phase, finish.length, strict=True):
        here = np.sin(2 * np.pi * x / length + after)
        assert here == pytest.approx(np.sin(2 * np.pi * (x + d) / length + before))


def test_lag_matters_less_on_a_random_finish_than_on_the_fitted_waves(fmu):
    cuts = {}
    for setting in (FITTED, Setting("random angle, K_c 1e4", SOFT, "random", 0)):
        run = setting.applied(Run("straight", finish="modelled"))
        with_lag, without = run_one(run, fmu), run_one(run.changed(plant=NO_LAG), fmu)
        cuts[setting.finish] = 1.0 - without.scores.rmse_fn / with_lag.scores.rmse_fn
    assert cuts["random"] < 0.30 < cuts["waves"]


def test_uphill_edge_needs_a_pull_only_where_it_is_steep(fmu):
    results = Results()
    for angle in (-10.0, -25.0):
        for run in ladder_runs(CHOICE, 0)[angle]:
            results.done[run] = run_one(run, fmu, trace=True)
    for angle, least, most in ((-10.0, -0.05, 0.05), (-25.0, 0.30, 1.0)):
        one, both = (
            uphill_errors(results.trace(run), run, angle) for run in ladder_runs(CHOICE, 0)[angle]
        )
        assert least <= 1.0 - both[0] / one[0] <= most


def test_x_valve_pushes_down_to_the_angle_where_the_forces_balance():
    run = ladder_runs(CHOICE, 0)[-10.0][0]
    angle = steepest_pushed(run)
    balance = 30.0 * math.sin(math.radians(-angle)) + CHOICE.cable_x
    assert balance == pytest.approx(11.0 + 74.0 * 0.06)  # F_d + C v, Tables C.1 and 3.13
    assert steepest_pushed(run.changed(plant=(("axis_x.F_w", 10.5),))) > -10.0 > angle


def test_met_share_counts_each_printed_number_once():
    one = Cell("4.7", "straight", "RMSE f_n", "simulation", 4.0, 4.9)
    repeat = Cell("4.15", "", "RMSE f_n", "simulation", 1.0, 9.0, "4.7")
    experiment = Cell("3.12", "", "RMSE f_n", "experiment", 1.0, 9.0)
    assert met_share([one, repeat, experiment]) == 1.0
    rounded = Cell("4.11", "", "RMSE f_n", "simulation", 0.4, 0.55)  # 0.2 N is the print's step
    assert met_share([one, rounded]) == 0.5
    assert met_share([one, rounded], in_print=True) == 1.0


def test_cells_hold_ours_beside_the_printed(pi_fv):
    class Everything(Results):
        def __getitem__(self, run):
            return pi_fv[Run("straight")]

    found = cells(Everything())
    assert len(found) == sum(v is not None for row in tracked_rows() for v in row.values)
    scores = pi_fv[Run("straight")]._asdict()
    names = {"ME f_n": "me_fn", "ME v_t": "me_vt", "RMSE f_n": "rmse_fn", "RMSE v_t": "rmse_vt"}
    assert {cell.column for cell in found} == set(names)
    assert all(cell.ours == scores[names[cell.column]] for cell in found)
    assert len(unique_cells(found)) == 132
    assert {c.repeat_of for c in found if c.table == "5.2" and "scheduled" not in c.row} == {"4.8"}


def test_edge_of_fig_4_30_turns_from_plus_to_minus():
    slope = read_profile(edge_file()).slope(np.array([0.70, 0.78, 0.88, 0.95]))
    assert np.degrees(np.arctan(slope)) == pytest.approx([-25.0, -25.0, 15.0, 15.0], abs=0.3)


def test_workers_in_this_process_give_the_same_results(fmu, pi_fv):
    with Workers(fmu.path, count=1) as pool:
        results = pool.collect(pool.start_runs([Run("straight")]))
    assert results[Run("straight")] == pi_fv[Run("straight")]


def test_step_times_are_named_and_a_learning_network_costs_more_than_a_pi():
    found = step_times(["pi_fv", "pi_fv_mbpm"])
    assert list(found) == ["pi_fv", "pi_fv_mbpm"]
    assert 0.0 < found["pi_fv"] < found["pi_fv_mbpm"]


def test_score_log_is_the_window_of_the_log(fmu):
    from pyfmi_runner.run import run_scenario

    log = run_scenario(scenario_of(Run("incline_16")), fmu).log
    scores = score_log(log, quiet=0.0, v_td=-0.06, f_nd=30.0)
    rows = log["phase"] == PHASES.index("contour")
    task = task_frame(log)
    e_f, e_v = 30.0 - task.f_n[rows], -0.06 - task.v_t[rows]
    assert scores.me_fn == pytest.approx(np.abs(e_f).max())
    assert scores.me_vt == pytest.approx(np.abs(e_v).max())
    assert scores.rmse_fn == pytest.approx(np.sqrt(np.mean(e_f**2)))
    assert scores.rmse_vt == pytest.approx(np.sqrt(np.mean(e_v**2)))
    assert score_log(log, quiet=1.0, v_td=-0.06, f_nd=30.0) != scores
