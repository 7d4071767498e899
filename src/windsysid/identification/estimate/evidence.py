"""Ranking of rival explanations of the same data by their evidence.

The evidence p(y | explanation) = ∫ p(y | u) p(u) du comes from Laplace's approximation at the mode of the posterior
(`windsysid.scoring.laplace_evidence`); differences of its logarithm are log odds. Unlike Schwarz's criterion, its limit
for long records, it does not assume that each unknown was informed by every sample. Source: Kass & Raftery, J. Am.
Stat. Assoc. 90, 1995, https://doi.org/10.1080/01621459.1995.10476572.
"""

from collections.abc import Callable, Iterable
from typing import Generic, NamedTuple, TypeVar

__all__ = ["Ranking", "rank"]

Explanation = TypeVar("Explanation")


class Ranking(NamedTuple, Generic[Explanation]):
    """Explanations of the same data, the best first.

    Attributes
    ----------
    order
        All of them.
    margins
        Log odds of the best against each (0 for the best).
    """

    order: tuple[Explanation, ...]
    margins: tuple[float, ...]

    @property
    def best(self) -> Explanation:
        """The explanation of the greatest evidence."""
        return self.order[0]

    def within(self, log_odds: float) -> tuple[Explanation, ...]:
        """Those against which the best has less than these log odds."""
        return tuple(one for one, margin in zip(self.order, self.margins, strict=True) if margin < log_odds)

    def rivals(self, name: Callable[[Explanation], str] = str) -> dict[str, float]:
        """The margins over all but the best, by their names."""
        return {name(one): margin for one, margin in zip(self.order[1:], self.margins[1:], strict=True)}


def rank(explanations: Iterable[Explanation], log_evidence: Callable[[Explanation], float]) -> Ranking[Explanation]:
    """Rank explanations of the same data by their log evidence; equals keep their order.

    Raises
    ------
    ValueError
        If there are none.
    """
    order = sorted(explanations, key=lambda one: -log_evidence(one))
    if not order:
        raise ValueError("explanations: expected at least one, got none")
    return Ranking(tuple(order), tuple(log_evidence(order[0]) - log_evidence(one) for one in order))
