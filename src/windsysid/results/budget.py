"""The uncertainty budget: how much narrower each band would be if something were known exactly."""

import math
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.conditioning import hold
from windsysid.output.table import Table
from windsysid.results.tolerance import Tolerance

__all__ = ["CAUSES", "Budget", "Share", "budget_of"]

CAUSES = ("load statistics", "gain", "alignment", "clock", "masses")
"""What may widen a band beside the record's length and the prior: loads and noise that must be learned, and what is
known of instruments and masses within tolerances only."""


class Share(NamedTuple):
    """One row.

    Attributes
    ----------
    name
        A coefficient, or a mode's frequency or damping ratio.
    two_sigma
        Half-width of its band: relative for a stiffness, in its own unit (N·s/m, Hz, 1 …) otherwise.
    relative
        Whether it is.
    alone
        Share of the variance that would be left if all causes were known exactly: the data's own, with the prior.
    causes
        For each of `Budget.causes`, by what share the variance would fall if that alone were known exactly.
    """

    name: str
    two_sigma: float
    relative: bool
    alone: float
    causes: tuple[float, ...]


class Budget(NamedTuple):
    """What widens the bands.

    Attributes
    ----------
    causes
        Those of `CAUSES` that there are.
    rows
        Of coefficients, then of modes.
    """

    causes: tuple[str, ...] = ()
    rows: tuple[Share, ...] = ()

    def summary(self) -> dict[str, Any]:
        """As plain values, for ``summary.json``."""
        return {
            row.name: {
                "two_sigma": row.two_sigma, "relative": row.relative, "data and prior": row.alone,
                **dict(zip(self.causes, row.causes, strict=True)),
            }
            for row in self.rows
        }  # fmt: skip

    def table(self, leave_out: Collection[str] = ()) -> Table:
        """As a table, without the rows of some names."""
        rows = []
        for row in (row for row in self.rows if row.name not in leave_out):
            width = f"{100.0 * row.two_sigma:.2g} %" if row.relative else f"{row.two_sigma:.3g}"
            shares = (f"{100.0 * share:.0f} %" for share in (row.alone, *row.causes))
            rows.append((row.name, width, *shares))
        title = (
            "Uncertainty budget: the share of each variance that data and prior would leave if all else were known, "
            "and by how much it falls if one thing is known"
        )
        return Table(("band", "±2σ", "data and prior", *self.causes), rows, title)


def budget_of(
    rows: Sequence[tuple[str, Array, bool]], cov: Array, statistics: slice, tolerances: Sequence[Tolerance]
) -> Budget:
    """The budget of quantities that the unknowns (n,) make up linearly.

    Parameters
    ----------
    rows
        Name, derivatives to the unknowns (n,), and whether the quantity is relative.
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
    everything = sorted(at for cause in causes for at in places[cause])
    zero = np.zeros(len(cov))
    held = {cause: hold(zero, cov, places[cause])[1] for cause in causes}
    alone = hold(zero, cov, everything)[1]
    found = []
    for name, slope, relative in rows:
        whole = float(slope @ cov @ slope)
        if not whole > 0.0:
            continue
        shares = [max(0.0, 1.0 - float(slope @ held[cause] @ slope) / whole) for cause in causes]
        left = min(max(float(slope @ alone @ slope) / whole, 0.0), 1.0)
        found.append(Share(name, 2.0 * math.sqrt(whole), relative, left, tuple(shares)))
    return Budget(causes, tuple(found))
