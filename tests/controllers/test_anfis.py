"""ANFIS: output, training, the trained friction model and the scheduler."""

import numpy as np
import pytest
from numba import njit

from controllers.anfis import AnfisModel, anfis_output
from controllers.anfis_scheduler import fitted_consequents, scheduled_gains
from controllers.anfis_trained import trained_model
from controllers.anfis_training import anfis_train
from controllers.gains import TABLE_5_1


def output(model: AnfisModel, row: np.ndarray) -> float:
    n, m = model.centre.shape
    return anfis_output(model, row, np.zeros(n), np.zeros((n, m)))


def test_a_linear_map_is_learnt_exactly():
    rng = np.random.default_rng(0)
    x = rng.uniform(-3.0, 5.0, (400, 2))
    model = anfis_train(x, 2.0 * x[:, 0] - x[:, 1] + 0.5, epochs=1).model
    assert output(model, np.array([1.0, 2.0])) == pytest.approx(0.5, abs=1e-2)


def test_backward_epochs_improve_a_curved_map():
    x = np.linspace(-1.0, 1.0, 300)[:, None]
    rmse = anfis_train(x, np.tanh(8.0 * x[:, 0]), epochs=15).rmse
    assert rmse[-1] < 0.8 * rmse[0]


def test_output_is_the_weighted_mean_of_the_rules():
    model = anfis_train(
        np.linspace(0.0, 1.0, 50)[:, None], np.linspace(0.0, 1.0, 50) ** 2, epochs=1
    ).model
    scaled = (0.3 - model.middle[0]) / model.half[0]
    grade = np.exp(-0.5 * ((scaled - model.centre[0]) / model.width[0]) ** 2)
    rules = model.consequent[:, 0] * scaled + model.consequent[:, 1]
    assert output(model, np.array([0.3])) == pytest.approx(
        float(grade @ rules / grade.sum()), rel=1e-12
    )


def test_compiled_output_equals_python_bit_for_bit():
    model = trained_model()
    rows = model.middle + model.half * np.random.default_rng(2).uniform(-2.0, 2.0, (20, 5))

    @njit
    def compiled(model, rows, values):
        for k in range(rows.shape[0]):
            values[k] = anfis_output(model, rows[k], np.zeros(5), np.zeros((5, 3)))

    values = np.empty(20)
    compiled(model, rows, values)
    assert values.tolist() == [output(model, row) for row in rows]


def test_trained_model_has_three_memberships_of_five_inputs():
    model = trained_model()
    assert model.centre.shape == (5, 3)
    assert model.consequent.shape == (243, 6)
    assert all(np.isfinite(part).all() for part in model)


def test_scheduler_meets_table_5_1_at_the_middle_of_its_first_and_last_rows():
    consequent = fitted_consequents()
    for degrees, gains in ((5.0, TABLE_5_1[0]), (58.0, TABLE_5_1[3])):
        found = scheduled_gains(consequent, np.deg2rad(degrees))
        for ours, printed in zip(found, gains, strict=True):
            assert ours.k_p == pytest.approx(
                printed.k_p, abs=0.15 * max(g.k_p for g in (gains.v_x, printed))
            )


@pytest.mark.parametrize("bad", [np.zeros((10, 2)), np.zeros(10)])
def test_unusable_training_data_is_refused(bad):
    with pytest.raises(ValueError, match="input"):
        anfis_train(bad, np.zeros(10))
