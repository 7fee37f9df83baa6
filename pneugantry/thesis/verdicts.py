"""A conclusion judged under many settings: how often it holds, and where its numbers lie.

A conclusion holds where it holds in more than half of the settings of every group that nothing was
fitted to. The share carries its 95 % interval (Wilson), so that eight draws do not pass for proof.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pneugantry.thesis.conclusions import Conclusion, reason_for

__all__ = ["Range", "Share", "Verdict", "spread", "verdict", "wilson"]

Z_95 = 1.959964


@dataclass(frozen=True)
class Share:
    """In how many settings of a group a conclusion holds."""

    held: int
    of: int

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share."""
        return wilson(self.held, self.of)


@dataclass(frozen=True)
class Range:
    """A number over the settings."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class Verdict:
    """A conclusion over the settings; `fitted` is None where no setting was fitted."""

    id: int
    text: str
    check: str
    holds: bool
    fitted: bool | None
    groups: dict[str, Share]
    numbers: dict[str, Range]  # over the groups that nothing was fitted to

    @property
    def reason(self) -> str:
        return "" if self.holds else reason_for(self.id)


def wilson(held: int, of: int) -> tuple[float, float]:
    """95 % interval of a share."""
    if of == 0:
        return 0.0, 1.0
    share, z2 = held / of, Z_95**2 / of
    middle = (share + 0.5 * z2) / (1.0 + z2)
    half = Z_95 * math.sqrt(share * (1.0 - share) / of + 0.25 * z2 / of) / (1.0 + z2)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def spread(values: Sequence[float]) -> Range:
    return Range(sum(values) / len(values), min(values), max(values))


def verdict(judged: Sequence[tuple[str, Conclusion]], unfitted: Sequence[str]) -> Verdict:
    """From (group, conclusion) pairs; the group "fitted" stands apart, and `unfitted` groups
    decide.
    """
    first = judged[0][1]
    groups: dict[str, list[Conclusion]] = {}
    for group, conclusion in judged:
        groups.setdefault(group, []).append(conclusion)
    fitted = groups.pop("fitted", None)
    shares = {
        group: Share(sum(c.holds for c in found), len(found)) for group, found in groups.items()
    }
    deciding = [group for group in unfitted if group in shares]
    free = [c for group in deciding for c in groups[group]]
    return Verdict(
        first.id,
        first.text,
        first.check,
        all(2 * shares[group].held > shares[group].of for group in deciding),
        fitted[0].holds if fitted else None,
        shares,
        {name: spread([c.numbers[name] for c in free]) for name in free[0].numbers},
    )
