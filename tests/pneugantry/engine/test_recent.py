"""What was used last is kept."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from pneugantry.engine.recent import Recent


def test_what_was_used_last_is_kept_and_the_rest_made_again() -> None:
    made: list[str] = []

    def use(recent: Recent[str], key: str) -> str:
        return recent.of(key, lambda: made.append(key) or key.upper())

    recent: Recent[str] = Recent(2)
    assert [use(recent, k) for k in "abacaab"] == list("ABACAAB")
    assert made == list("abcb")


def test_threads_get_what_is_made_for_their_key() -> None:

    recent: Recent[int] = Recent(3)
    with ThreadPoolExecutor(4) as pool:
        keys = [k % 7 for k in range(2000)]
        assert list(pool.map(lambda k: recent.of(k, lambda: k * k), keys)) == [k * k for k in keys]
