"""Gain tables as printed, and what is refused."""

import pytest

from controllers.gains import TABLE_5_1, TABLES, FvGains, PidGains, gains_named

PRINTED = {  # v_x, f_z, f_x, v_z: K_p and K_i
    "table_3_5": (0.2, 4.0, 0.08, 0.1, 0.02, 0.03, 0.25, 6.0),
    "table_3_6": (0.05, 1.0, 0.02, 0.04, 0.01, 0.06, 0.5, 3.0),
    "table_3_7": (1.0, 4.0, 0.02, 0.04, 0.01, 0.03, 0.5, 5.0),
    "table_3_11": (1.0, 4.0, 0.02, 0.08, 0.01, 0.03, 0.5, 2.0),
    "table_4_6": (1.0, 4.0, 0.02, 0.08, 0.01, 0.03, 0.5, 2.0),
    "table_5_1_set_1": (0.5, 2.0, 0.02, 0.08, 0.025, 0.12, 0.1, 2.0),
    "table_5_1_set_2": (0.5, 2.0, 0.01, 0.08, 0.05, 0.06, 0.4, 2.0),
    "table_5_1_set_3": (1.0, 4.0, 0.02, 0.08, 0.01, 0.03, 0.8, 2.0),
    "table_5_1_set_4": (2.0, 16.0, 0.04, 0.32, 0.025, 0.01, 1.0, 0.5),
}


@pytest.mark.parametrize("name", PRINTED)
def test_table_is_as_printed(name):
    assert tuple(k for pid in gains_named(name) for k in (pid.k_p, pid.k_i)) == PRINTED[name]


def test_every_table_is_checked_and_only_v_z_of_table_3_5_has_a_derivative():
    assert set(TABLES) == set(PRINTED)
    derivative = [
        (name, loop)
        for name in TABLES
        for loop, k in TABLES[name]._asdict().items()
        if k.k_d != 0.0
    ]
    assert derivative == [("table_3_5", "v_z")]
    assert TABLES["table_3_5"].v_z.k_d == 0.05
    assert len(TABLE_5_1) == 4


@pytest.mark.parametrize(
    ("gains", "message"),
    [
        ("table_3_8", r"gains must name a table, got 'table_3_8'; nearest is"),
        ({"Kp_vy": 1.0}, "unknown gain 'Kp_vy'; nearest is 'Kp_v"),
        ({"Kp_vx": 1.0}, "missing Ki_vx, Kp_fz"),
        (
            FvGains(PidGains(-1.0, 0.0), *[PidGains(0.0, 0.0)] * 3),
            r"v_x\.k_p must be finite and >= 0, got -1\.0",
        ),
        (
            FvGains(PidGains(0.0, float("nan")), *[PidGains(0.0, 0.0)] * 3),
            r"v_x\.k_i must be finite",
        ),
    ],
)
def test_unusable_gains_are_refused_by_name(gains, message):
    with pytest.raises(ValueError, match=message):
        gains_named(gains)
