"""Identifiability: singular directions and correlations of an information matrix, in words.

In relative coordinates (∂ ln p) and scaled to unit diagonal, an eigenvector of the Fisher information with eigenvalue
zero is a combination of parameters that may change without any reading changing: k, m and the level of an unknown load
by a common factor, for instance. One with a condition index √(λ_max / λ) above 30 is a combination that is hardly seen,
and the parameters of whose variance it makes up more than half are distinguished badly. After an identification the
same test compares the posterior with the prior: of the directions in which the data hold less information
than the prior, the intervals are the prior's.

Source: Belsley, Kuh & Welsch, Regression Diagnostics (Wiley 1980), ch. 3, https://doi.org/10.1002/0471725153, for
indices and shares of variance; Rothenberg, Econometrica 39(3), 1971, https://doi.org/10.2307/1913267, for
identifiability as a regular information matrix.
"""

from collections.abc import Collection, Iterator, Sequence
from fractions import Fraction

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import MIN_CONDITION_INDEX, MIN_NAMED_CORRELATION, NEGLIGIBLE_SHARE
from windsysid.inspection.sentences import joined
from windsysid.results.finding import Finding

__all__ = ["describe_directions", "describe_information", "standard_deviations"]


MIN_SEEN_EIGENVALUE = 1e-9
"""Numerical: smallest eigenvalue of the scaled information (1 on average) that is not zero; rounding leaves some
1e-15."""

MIN_SEEN_INFORMATION = 1e-8
"""Numerical: smallest information on ln p, σ = 10⁴, that is not zero."""

ZERO_ENTRY_UNSEEN = 1e-4
"""Numerical: entry of an unseen direction, over the largest, that counts as zero."""


def standard_deviations(information: Array) -> Array:
    """σ of every coordinate (n,) from the information (n, n): the Cramér–Rao bound, infinite without information."""
    scale, values, vectors = _scaled(information)
    seen = values > MIN_SEEN_EIGENVALUE
    variance = np.square(vectors[:, seen]) @ (1.0 / values[seen])
    hidden = np.abs(vectors[:, ~seen]).max(axis=1, initial=0.0) > ZERO_ENTRY_UNSEEN
    return np.asarray(np.where(hidden, np.inf, np.sqrt(variance) / scale), dtype=np.float64)


def describe_information(names: Sequence[str], information: Array, aside: Collection[str] = ()) -> list[Finding]:
    """Remarks on what a Fisher information does not determine, alone or in combination; empty where all is well.

    Parameters
    ----------
    names
        Of the n parameters.
    information
        (n, n), in relative coordinates: the derivatives are to ln p.
    aside
        Names of which nothing is said unless they are mixed up with others: nuisances such as load and noise.
    """
    scale, values, vectors = _scaled(information)
    unseen = values <= MIN_SEEN_EIGENVALUE
    found = []
    unseen_rules = (vectors[:, unseen] / scale[:, None]).T
    for who, left, moved, _ in _describe_rules(names, unseen_rules, scale, ZERO_ENTRY_UNSEEN, np.ones(len(names))):
        if not set(who) <= set(aside):
            code = "unseen" if len(who) == 1 else "unseen_combination" if left else "unseen_direction"
            found.append(Finding(code, "remark", {"seen": left, "direction": moved}, tuple(who)))
    covariance = (vectors[:, ~unseen] / values[~unseen]) @ vectors[:, ~unseen].T / np.outer(scale, scale)
    hidden = np.isinf(standard_deviations(information))
    told = list[set[int]]()
    for weak in np.flatnonzero(~unseen & (values * MIN_CONDITION_INDEX**2 < values.max())):
        share = np.square(vectors[:, weak]) / values[weak] / np.maximum(np.diag(covariance) * scale**2, 1e-300)
        members: list[int] = np.flatnonzero((share > 0.5) & ~hidden).tolist()
        who = [names[i] for i in members]
        if len(members) > 1 and not set(who) <= set(aside):
            told.append(set(members))
            row, cov = (vectors[:, weak] / scale)[members], covariance[np.ix_(members, members)]
            found.append(_badly(tuple(who), row, cov))
    return found + _new_correlations(names, covariance, told, hidden, aside)


def _new_correlations(
    names: Sequence[str], covariance: Array, told: Sequence[set[int]], hidden: Array, aside: Collection[str]
) -> list[Finding]:
    """Remarks on correlated parameters that are seen, not both `aside`, and not reported together before."""
    return [
        _correlation(names[i], names[j], value)
        for i, j, value in _correlated(covariance)
        if not (hidden[i] or hidden[j] or {names[i], names[j]} <= set(aside))
        and not any({i, j} <= members for members in told)
    ]


def describe_directions(
    names: Sequence[str], cov: Array, prior_cov: Array, logarithmic: Sequence[bool], theta: Array | None = None
) -> list[Finding]:
    """Remarks on a posterior that is dominated by the prior, and on strong correlations.

    Parameters
    ----------
    names
        Of the n parameters.
    cov, prior_cov
        Posterior and prior covariance in filter coordinates (n, n).
    logarithmic
        Whether a coordinate is the logarithm of its parameter, or proportional to it.
    theta
        The estimate in filter coordinates (n,): a step of a proportional coordinate counts relative to it, or to the
        prior's spread where it is left out.
    """
    root = np.linalg.cholesky(prior_cov)
    whitened = np.linalg.solve(root, np.linalg.solve(root, cov).T)
    values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
    prior_rules = (root @ vectors[:, values > 0.5]).T
    spread = np.sqrt(np.diag(prior_cov))
    size = np.where(logarithmic, 1.0, spread if theta is None else np.where(theta == 0.0, spread, theta))
    before, after = np.linalg.inv(prior_cov), np.linalg.inv(cov)
    found = []
    for who, left, moved, rows in _describe_rules(names, prior_rules, 1.0 / spread, NEGLIGIBLE_SHARE, 1.0 / size):
        left_of_prior = np.trace(np.linalg.solve(rows @ after @ rows.T, rows @ before @ rows.T)) / len(rows)
        data = {"share": 1.0 - left_of_prior, "seen": left, "direction": moved}
        found.append(Finding("prior_dominates", "remark", data, tuple(who)))
    return found + [_correlation(names[i], names[j], value) for i, j, value in _correlated(cov)]


def _correlation(one: str, other: str, value: float) -> Finding:
    return Finding("correlated_estimates", "remark", {"correlation": value}, (one, other))


def _correlated(cov: Array) -> list[tuple[int, int, float]]:
    """Pairs whose correlation exceeds `MIN_NAMED_CORRELATION` in size, strongest first."""
    std = np.sqrt(np.maximum(np.diag(cov), 1e-300))
    correlation = cov / np.outer(std, std)
    pairs = [(i, j, float(correlation[i, j])) for j in range(len(cov)) for i in range(j)]
    return sorted((pair for pair in pairs if abs(pair[2]) > MIN_NAMED_CORRELATION), key=lambda pair: -abs(pair[2]))


def _scaled(information: Array) -> tuple[Array, Array, Array]:
    """Scale (n,), eigenvalues (n,) and eigenvectors (n, n) of the information with unit diagonal; zero rows stay."""
    diagonal = np.diag(information)
    seen = diagonal > MIN_SEEN_INFORMATION
    scale = np.where(seen, np.sqrt(np.maximum(diagonal, MIN_SEEN_INFORMATION)), 1.0)
    scaled = np.where(np.outer(seen, seen), information / np.outer(scale, scale), 0.0)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    return scale, values, vectors


def _describe_rules(
    names: Sequence[str], space: Array, scale: Array, tolerance: float, relative: Array
) -> Iterator[tuple[list[str], str, str, Array]]:
    """Decompose the directions of a space (d, n): which coordinates change, what stays constant, the changes in
    percent, and a basis.

    Entries small in units of `scale` (n,) count as zero; `relative` (n,) turns entries into relative changes.
    """
    basis = _reduced(space)
    sizes = np.abs(basis * scale)
    rows = np.where(sizes < tolerance * sizes.max(axis=1, keepdims=True, initial=0.0), 0.0, basis * relative)
    for members, which in _groups(rows):
        who = [names[i] for i in members]
        left = _left(who, rows[np.ix_(which, members)])
        parts = [which] if left else [[i] for i in which]
        for part in parts:
            moving = [int(i) for i in np.flatnonzero(rows[part].any(axis=0))]
            yield [names[i] for i in moving], left, _describe_direction(names, rows[part[0]]), basis[part]


def _reduced(rows: Array) -> Array:
    """A basis of the same space with as many zeros as elimination gives."""
    rows = rows.copy()
    free = np.ones(rows.shape[1], dtype=bool)
    for i in range(len(rows)):
        rest = np.abs(rows[i:]) * free
        best, column = (int(k) for k in np.unravel_index(int(np.argmax(rest)), rest.shape))
        rows[[i, i + best]] = rows[[i + best, i]]
        free[column] = False
        rows[i] /= rows[i, column]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, column], rows[i])
    return rows


def _groups(rows: Array) -> list[tuple[list[int], list[int]]]:
    """Columns and rows of the blocks of which the rows consist."""
    groups: list[tuple[set[int], list[int]]] = []
    for i, row in enumerate(rows):
        columns, members = {int(c) for c in np.flatnonzero(row)}, [i]
        for other in [group for group in groups if group[0] & columns]:
            groups.remove(other)
            columns, members = columns | other[0], other[1] + members
        groups.append((columns, members))
    return sorted((sorted(columns), sorted(members)) for columns, members in groups)


def _left(who: Sequence[str], rows: Array) -> str:
    """Name what stays constant along all rows: a ratio, product, sum or proportions; empty without a short name."""
    if len(who) == 1:
        return ""
    if len(rows) == 1 and len(who) > 2:
        common = np.allclose(rows[0], rows[0, 0], rtol=0.01)
        return "the proportion between them (not their common factor)" if common else ""
    kept = _small_integers(np.linalg.svd(rows)[2][-1]) if len(rows) == len(who) - 1 else None
    return "" if kept is None else _product(who, kept)


def _product(who: Sequence[str], powers: Sequence[int]) -> str:
    """A product of powers, in words if they are equal."""
    if len(set(powers)) == 1:
        alike = len({name.rstrip("0123456789") for name in who}) == 1
        return "their sum" if alike else "their product " + "·".join(who)
    return _fraction(who, [-power for power in powers] if powers[0] < 0 else powers)


def _fraction(who: Sequence[str], powers: Sequence[int]) -> str:
    """A product of powers as a fraction."""
    over, under = (
        "·".join(name + _SUPERSCRIPTS[abs(p)] for name, p in zip(who, powers, strict=True) if p * sign > 0)
        for sign in (1, -1)
    )
    if not under:
        return over
    text = f"{over}/({under})" if "·" in under else f"{over}/{under}"
    return f"their ratio {text}" if sorted(powers) == [-1, 1] else text


_SUPERSCRIPTS = ("", "", "²", "³", "⁴")


def _describe_direction(names: Sequence[str], row: Array) -> str:
    """A direction as steps in percent, the largest 10 %."""
    steps = 10.0 * row / np.abs(row).max() * np.sign(row[np.flatnonzero(row)[0]])
    return joined(
        [f"{name} {float(f'{step:.2g}'):+g} %" for name, step in zip(names, steps, strict=True) if step != 0.0]
    )


def _badly(who: tuple[str, ...], row: Array, cov: Array) -> Finding:
    """Remark on a poorly determined direction: the combination that is determined instead, and its accuracy."""
    std = np.sqrt(np.diag(cov))
    data = {"low": std.min(), "high": std.max(), "direction": _describe_direction(who, row)}
    rounded = _small_integers(row, 0.1)
    left = _left(who, np.array([rounded], dtype=np.float64)) if rounded is not None and len(who) == 2 else ""
    if not left:
        return Finding("direction_hardly_seen", "remark", data, who)
    seen = np.array([row[1], -row[0]]) / np.abs(row).max()
    return Finding("hard_to_tell_apart", "remark", data | {"seen": left, "std": np.sqrt(seen @ cov @ seen)}, who)


def _small_integers(row: Array, tolerance: float = 0.005) -> list[int] | None:
    """The integers up to 4 in size that a row is proportional to, or none."""
    scaled = row / np.abs(row).max()
    denominators = [Fraction(float(x)).limit_denominator(4).denominator for x in scaled]
    factor = int(np.lcm.reduce(denominators))
    integers = [round(float(x) * factor) for x in scaled]
    close = all(abs(x * factor - i) <= tolerance * factor for x, i in zip(scaled, integers, strict=True))
    return integers if close and max(map(abs, integers)) <= 4 else None
