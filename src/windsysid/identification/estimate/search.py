"""One way from samples to an estimate, for whole records, records in pieces, and equations of one's own.

A `windsysid.identification.model.problem.Problem` has the unknowns; samples come in blocks
(`windsysid.identification.condition.samples`). `solve` takes them in as they would be on line
(`windsysid.identification.estimate.online`), finds the mode of the posterior of all of them from where that ends
(`windsysid.identification.estimate.scoring`), leaves outliers out, and filters once more at the mode: those innovations
judge the result.

Maximum likelihood needs a fixed set of readings. So the mode is found with all of them, the outliers there are left
out, and the mode is found anew; the set is judged again from all readings, until it stays.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.checks.dispersion import PartScores
from windsysid.checks.innovation_sums import Stretch, measure_stretch
from windsysid.checks.limits import OUTLIER_SIGMAS
from windsysid.checks.whiteness import Whiteness, judge_stretches
from windsysid.errors import WindsysidError
from windsysid.filters import EKF, Info
from windsysid.identification.condition.samples import Samples, split_evenly
from windsysid.identification.estimate.clock_lag import Lateness, add_clocks, shifted
from windsysid.identification.estimate.online import History, Online, advance, finish, join_histories
from windsysid.identification.estimate.outlier import Outliers, find_spikes
from windsysid.identification.estimate.scoring import MAX_REPEATED_ELEMENTS, InnovationMode, find_innovation_mode
from windsysid.identification.model.fit import check_finite, diverged
from windsysid.identification.model.problem import Problem
from windsysid.output.progress import expect
from windsysid.results.estimate import Loads
from windsysid.results.finding import Finding
from windsysid.statespace.acting_loads import acting_loads
from windsysid.statespace.compose import StateSpace

__all__ = ["Solution", "expect_search", "solve"]

MAX_GATED_SEARCHES = 4
"""Setting: searches for the mode until the set of outliers stays."""

MAX_CONTINUATIONS = 2
"""Setting: how often a search that has not converged goes on."""

MAX_SHIFTS = 3
"""Setting: how often readings are shifted by the lags of their clocks, and the search goes on."""

MAX_UNSEEN_STEP = 4.0
"""Numerical: squared length [σ] of a shift's step of the other unknowns, below which it is taken unseen."""

COVARIANCE_CHUNK_SAMPLES = 1024
"""Setting: samples whose covariances are held at once."""

EXPECTED_PASSES, LAST_PASS_SHARE = 3.0, 0.25
"""Setting: for progress only: how often a search goes through all samples, and what is left of it until it ends."""


class Solution(NamedTuple):
    """Information of samples on a problem's unknowns.

    Attributes
    ----------
    history
        The estimates on line, after those that the search began with; None without a recursion, or where it lost its
        way.
    mean, cov
        The mode of the posterior of all unknowns, the clocks last (n,), and the inverse of its information (n, n).
    iterations, settled, exhausted
        Steps of the last search, whether its last one was small enough, and whether it ended since more would have been
        too expensive.
    log_likelihood
        Of the readings at the mode.
    info, inputs, loads
        What the filter said at the mode, and what went in, and the loads that were states: of the last block.
    whiteness
        The innovations at the mode against white noise, all of them.
    scores
        Of parts of the samples, to the unknowns but the clocks.
    outliers
        The readings that were left out.
    read
        How many readings of each channel there were (m,).
    samples, mean_inputs
        How many samples there were, and the mean of what went in (n_u + n_w,).
    updated
        Elements of covariances that the evaluations of all searches updated.
    """

    history: History | None
    mean: Array
    cov: Array
    iterations: int
    settled: bool
    exhausted: bool
    log_likelihood: float
    info: Info
    inputs: Array
    loads: Loads
    whiteness: Whiteness
    scores: PartScores
    outliers: Outliers
    read: NDArray[np.int64]
    samples: int
    mean_inputs: Array
    updated: int

    @property
    def notes(self) -> tuple[Finding, ...]:
        """Readings that were left out."""
        counts = self.outliers.counts(len(self.read))
        return tuple(
            Finding(
                "outliers", "note", {"channel": channel.name, "count": count, "read": read, "sigmas": OUTLIER_SIGMAS}
            )
            for channel, count, read in zip(self.whiteness.channels, counts, self.read, strict=True)
            if count
        )


def expect_search(samples: int, before: float = 0.0) -> None:
    """Report the number of samples of a search, and of those before it."""
    expect(before + EXPECTED_PASSES * samples, LAST_PASS_SHARE * samples)


def solve(
    problem: Problem, samples: Samples, online: Online | None, *, rate: float,
    start: tuple[Array, Array] | None = None,
) -> Solution:  # fmt: skip
    """Find the mode of the posterior of all samples.

    Parameters
    ----------
    samples
        All of them, from the first on.
    online
        What is known on line after some of them, none perhaps (`windsysid.identification.estimate.online.begin`). With
        None there is no recursion and no history, and `start` is needed.
    rate
        Samples per second [Hz].
    start
        Where the search for the mode begins, and how uncertain that is (n,), (n, n), the tolerances left out or not:
        where the recursion ends by default, or where it was before it lost its way: that costs the history only.

    Raises
    ------
    WindsysidError
        If the filter diverges.
    """
    history: History | None = None
    spikes = find_spikes(samples)
    if online is not None:
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # of a recursion that loses its way
                taken, known = _take_in(problem, spikes.left_out_of(samples), online)
            check_finite(taken.theta, taken.precision)
            online, history = taken, known
            start = start or (online.theta, online.cov)
        except (WindsysidError, np.linalg.LinAlgError):
            if start is None and not online.samples:
                raise
            start = start or (online.theta, online.cov)
    if start is None:
        raise ValueError("a search begins where the recursion ends, or at a start")
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused
            mode, outliers, seen, updated = _search(problem, samples, start, rate, spikes)
    except np.linalg.LinAlgError:
        raise diverged() from None
    return Solution(
        history=history, mean=mode.mean, cov=mode.cov, iterations=mode.iterations, settled=mode.settled,
        exhausted=mode.ended and not mode.settled, log_likelihood=seen.log_likelihood, info=seen.info,
        inputs=seen.inputs, loads=seen.loads,
        whiteness=judge_stretches(
            seen.stretch, names=problem.build(mode.mean).readings, frequencies=problem.frequencies(mode.mean)
        ),
        scores=_scores(problem, mode, rate), outliers=outliers, read=seen.read, samples=seen.stretch.samples,
        mean_inputs=seen.total_inputs / seen.stretch.samples, updated=updated,
    )  # fmt: skip


def _take_in(problem: Problem, samples: Samples, online: Online) -> tuple[Online, History]:
    """Go on with the recursion from the sample that it has reached to the last."""
    histories, first = [], 0
    for inputs, readings in samples:
        new = slice(max(online.reached - first, 0), None)
        first += len(readings)
        if first > online.reached:
            online, history = advance(problem.build, online, inputs[new], readings[new], problem.start)
            histories.append(history)
    online, last = finish(problem.build, online, problem.start)
    return online, join_histories([*histories, last])


def _search(
    problem: Problem, samples: Samples, start: tuple[Array, Array], rate: float, spikes: Outliers
) -> "tuple[InnovationMode, Outliers, _Seen, int]":
    """Mode of the posterior without the outliers there, these outliers, the filter at the mode, and elements updated.
    The first search leaves the spikes out, and another one begins while that is not too expensive."""
    searched, late = problem.unknowns.but("clocks"), problem.unknowns.of("clocks")
    outliers, clocks, kept, updated = spikes, np.zeros(len(problem.clocks)), spikes.left_out_of(samples), 0
    for searches in range(1, MAX_GATED_SEARCHES + 1):
        mode = _climb(problem, kept, start, clocks)
        updated += (mode.iterations + 1) * mode.look.bank.samples * mode.look.bank.cov.size
        start, clocks = (mode.mean[searched], mode.cov[np.ix_(searched, searched)]), mode.mean[late]
        model, frequencies = problem.build(start[0]), problem.frequencies(mode.mean)
        gated = replace(model, blocks=model.blocks._replace(gate=np.array([OUTLIER_SIGMAS])))
        seen = _filter(gated, shifted(problem, samples, clocks), rate, frequencies)
        found = seen.gated.that_matter(seen.gated_power, seen.read, seen.stretch.samples)
        if found.same_as(outliers) or (not mode.settled and (mode.ended or searches > 1)):  # no set settles
            break
        if updated > MAX_REPEATED_ELEMENTS:
            mode = mode._replace(settled=False, ended=True)
            break
        outliers, kept = found, found.left_out_of(samples)
    if seen.gated.counts(len(seen.read)).any():  # what a filter without a gate says
        seen = _filter(model, shifted(problem, samples, clocks), rate, frequencies, outliers)
    return mode, outliers, seen, updated


def _climb(problem: Problem, samples: Samples, start: tuple[Array, Array], clocks: Array) -> InnovationMode:
    """The mode of the posterior of all unknowns; of its `look`, the clocks are no part."""
    prior, searched, late = problem.wide_prior, problem.unknowns.but("clocks"), problem.unknowns.of("clocks")
    mean, cov = prior[0].copy(), prior[1].copy()
    whole = len(start[0]) == len(mean)
    given = slice(None) if whole else problem.unknowns.of("parameters", "statistics")
    mean[given], cov[given, given] = start
    for _ in range(MAX_SHIFTS):
        moved = shifted(problem, samples, clocks)
        for _ in range(MAX_CONTINUATIONS):
            mode = find_innovation_mode(
                problem.build, moved, prior=prior, start=(mean, cov),
                changes=Lateness(moved, problem.clocks) if problem.clocks else None,
            )  # fmt: skip
            mean, cov = mode.mean, mode.cov
            if mode.ended:
                break
        check_finite(mode.mean, mode.cov)
        if not problem.clocks:
            break
        wide = add_clocks(problem, moved, mode.look, clocks)
        check_finite(wide.mean, wide.cov)
        mode = mode._replace(mean=wide.mean, cov=wide.cov)
        mean, clocks = wide.mean[searched], wide.mean[late]
        if wide.moved < MAX_UNSEEN_STEP or not mode.settled:
            break
    else:
        mode = mode._replace(settled=mode.settled and not problem.clocks)
    return mode


def _scores(problem: Problem, mode: InnovationMode, rate: float) -> PartScores:
    """Of parts of the samples, where a search has looked last."""
    samples, gradients, information = zip(*mode.look.found.parts, strict=True)
    mean, cov = problem.wide_prior
    precision = np.asarray(np.linalg.inv(cov))
    places, pull = (np.cumsum(samples) - 0.5 * np.array(samples)) / rate, precision @ (mean - mode.look.theta)
    return PartScores("time", places, np.array(gradients), np.array(information), precision, pull)


class _Seen(NamedTuple):
    """Sums of one pass of a filter over all samples; arrays of the last block."""

    info: Info
    inputs: Array
    loads: Loads
    log_likelihood: float
    stretch: Stretch
    total_inputs: Array
    read: NDArray[np.int64]
    gated: Outliers
    gated_power: Array


def _filter(
    model: StateSpace, samples: Samples, rate: float, frequencies: Sequence[float], outliers: Outliers | None = None
) -> _Seen:
    """Filter all samples with `model`, those marked as outliers left out."""
    belief, m = EKF.init(model), len(model.readings)
    log_likelihood, total_inputs = 0.0, np.zeros(len(model.inputs))
    stretch: Stretch | None = None
    read, power, gated = np.zeros(m, dtype=np.int64), np.zeros(m), []
    for block, (inputs, readings) in enumerate(samples):
        left_out = (outliers or Outliers()).mask(block, readings.shape)
        kept = np.where(left_out, np.nan, readings) if outliers else readings
        parts, loads = [], []
        for first in range(0, len(inputs), COVARIANCE_CHUNK_SAMPLES):
            part = slice(first, first + COVARIANCE_CHUNK_SAMPLES)
            belief, info, covs = EKF.run_with_covariances(model, belief, inputs[part], kept[part])
            parts.append(info)
            loads.append(_acting_loads(model, inputs[part], info, covs))
        info = Info(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
        if outliers:
            info = info._replace(gated=left_out)
        log_likelihood += float(info.log_likelihood.sum())
        total_inputs += inputs.sum(axis=0)
        read += np.isfinite(readings).sum(axis=0)
        power += np.nansum(np.square(np.where(info.gated, info.innovation / info.innovation_std, 0.0)), axis=0)
        gated.append(np.flatnonzero(info.gated))
        for part in split_evenly(len(inputs)):
            stretch = measure_stretch(
                info.whitened[part], rate=rate, frequencies=frequencies, gated=info.gated[part], before=stretch
            )
    if stretch is None:
        raise WindsysidError("no samples: expected at least one, got an empty record")
    names, means, stds = zip(*loads, strict=True)
    acting = Loads(names[0], np.concatenate(means), np.concatenate(stds))
    return _Seen(info, inputs, acting, log_likelihood, stretch, total_inputs, read, Outliers(tuple(gated)), power)


def _acting_loads(model: StateSpace, inputs: Array, info: Info, covs: Array) -> Loads:
    """The loads that are states as the filter knew them after each sample."""
    nx, nz = model.blocks.sizes[:2]
    names, H = acting_loads(model, inputs)
    z, P = info.mean[:, nx : nx + nz], covs[:, nx : nx + nz, nx : nx + nz]
    std = np.sqrt(np.maximum(np.einsum("twz,tzy,twy->tw", H, P, H), 0.0))
    return Loads(names, np.einsum("twz,tz->tw", H, z), std)
