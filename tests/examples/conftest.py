"""What all tests of the examples share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager

import pytest


@pytest.fixture(scope="module", autouse=True)
def small_plants(
    quickly_compiled: Callable[[], AbstractContextManager[None]],
) -> Iterator[None]:
    """Small plants are fitted here: much of their time is the C compiler's."""
    with quickly_compiled():
        yield
