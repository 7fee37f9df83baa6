"""A network learns unless a clipped command would be driven further out."""

import pytest

from controllers.learning import learns


@pytest.mark.parametrize(
    ("u_z", "e_fn", "yes"),
    [
        (5.0, 1.0, False),
        (5.0, -1.0, True),
        (0.0, -1.0, False),
        (0.0, 1.0, True),
        (1.0, 1.0, True),
        (1.0, -1.0, True),
    ],
)
def test_learns_from_errors_that_bring_the_command_back(u_z, e_fn, yes):
    assert learns(u_z, e_fn) is yes
