"""The uncertainty budget: shares of the variance of each interval, which add up to it.

Known exactly, a cause would lower the variance by an amount that depends on what else is known. Its share is the mean
over all orders in which causes become known (Shapley effects). Sources: Owen, SIAM/ASA J. Uncertainty Quantification 2,
2014, https://doi.org/10.1137/130936233; Song, Nelson & Staum, same journal 4, 2016, https://doi.org/10.1137/15M1048070.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import chain, combinations, permutations
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.conditioning import hold
from windsysid.output.table import Table
from windsysid.results.tolerance import Tolerance

__all__ = ["CAUSES", "Budget", "Share", "budget_of"]

CAUSES = ("load statistics", "gain", "alignment", "clock", "masses", "aerodynamics")
"""Sources of width in addition to the record's length and the prior: loads and noise that must be learned, and
instruments and masses within tolerances."""

WIDENED = ("dispersion", "rival explanations")
"""Causes of intervals wider than those of the model: contradictions among segments or frequencies, and rival
explanations."""


class Share(NamedTuple):
    """One row.

    Attributes
    ----------
    name
        A coefficient, or a mode's frequency or damping ratio.
    two_sigma
        Half-width of its interval, relative to the estimate unless `relative` is False (results of version 0.2).
    alone
        Share of the variance that would be left if all causes were known exactly: the data's own, with the prior.
    causes
        Share of each of `Budget.causes`; with `alone` they add up to one.
    """

    name: str
    two_sigma: float
    alone: float
    causes: tuple[float, ...]
    relative: bool = True


class Budget(NamedTuple):
    """Sources of the width of the intervals.

    Attributes
    ----------
    causes
        Those of `CAUSES` that there are; of an identification also those of `WIDENED`.
    rows
        Of coefficients, then of modes.
    """

    causes: tuple[str, ...] = ()
    rows: tuple[Share, ...] = ()

    def widened(self, added: Mapping[str, Sequence[float]]) -> "Budget":
        """Budget with the causes `WIDENED`, given their shares for each row, relative to its variance before."""
        rows = []
        for row in self.rows:
            more = added.get(row.name, (0.0, 0.0))
            whole = 1.0 + sum(more)
            shares = tuple(share / whole for share in (*row.causes, *more))
            two_sigma = math.sqrt(whole) * row.two_sigma
            rows.append(row._replace(two_sigma=two_sigma, alone=row.alone / whole, causes=shares))
        return Budget((*self.causes, *WIDENED), tuple(rows))

    def summary(self) -> dict[str, Any]:
        """As plain values, for ``summary.json``."""
        return {
            row.name: {
                "two_sigma": row.two_sigma, "data and prior": row.alone,
                **dict(zip(self.causes, row.causes, strict=True)),
            }
            for row in self.rows
        }  # fmt: skip

    def table(self, *, modes: bool = True) -> Table:
        """As a table, with or without modes; without causes that have no share."""
        rows = [row for row in self.rows if modes or ":" not in row.name]
        shares = np.array([(row.alone, *row.causes) for row in rows]).reshape(len(rows), 1 + len(self.causes))
        shown = [0, *(i for i in range(1, shares.shape[1]) if shares[:, i].max(initial=0.0) >= 0.005)]
        cells = []
        for row, own in zip(rows, shares, strict=True):
            width = f"{float(f'{100.0 * row.two_sigma:.2g}'):g} %" if row.relative else f"{row.two_sigma:.3g}"
            cells.append((row.name, width, *(f"{100.0 * share:.0f} %" for share in own[shown])))
        names = np.array(["data and prior", *self.causes])[shown].tolist()
        return Table(("quantity", "± 95 %", *names), cells, "Uncertainty budget: shares of each interval's variance")


def budget_of(
    rows: Sequence[tuple[str, Array]], cov: Array, statistics: slice, tolerances: Sequence[Tolerance]
) -> Budget:
    """The budget of quantities that the unknowns (n,) make up linearly.

    Parameters
    ----------
    rows
        Name and relative derivatives to the unknowns (n,).
    cov
        Of all unknowns (n, n), those of tolerances last.
    statistics
        Where the statistics of loads and noise are among them.
    tolerances
        What the last unknowns stand for.
    """
    first = len(cov) - len(tolerances)
    places: dict[str, list[int]] = {"load statistics": list(range(len(cov))[statistics])}
    for at, one in enumerate(tolerances):
        places.setdefault(one.group, []).append(first + at)
    causes = tuple(cause for cause in CAUSES if places.get(cause))
    given, found = _given({cause: places[cause] for cause in causes}, cov), []
    for name, slope in rows:
        left = {known: max(float(slope @ rest @ slope), 0.0) for known, rest in given.items()}
        whole = left[frozenset()]
        if whole > 0.0:
            shares = tuple(_shapley(cause, causes, left) / whole for cause in causes)
            found.append(Share(name, 2.0 * math.sqrt(whole), left[frozenset(causes)] / whole, shares))
    return Budget(causes, tuple(found))


def _given(places: Mapping[str, Sequence[int]], cov: Array) -> dict[frozenset[str], Array]:
    """Covariance (n, n) given each set of causes, whose unknowns have these places."""
    zero, sets = np.zeros(len(cov)), chain.from_iterable(combinations(places, k) for k in range(len(places) + 1))
    return {frozenset(known): hold(zero, cov, [at for one in known for at in places[one]])[1] for known in sets}


def _shapley(cause: str, causes: Sequence[str], left: Mapping[frozenset[str], float]) -> float:
    """Mean fall of a variance as a cause becomes known, over all orders of the causes, from the rest `left` for each
    set of known ones."""
    falls = []
    for order in permutations(causes):
        known = frozenset(order[: order.index(cause)])
        falls.append(left[known] - left[known | {cause}])
    return max(math.fsum(falls) / len(falls), 0.0)
