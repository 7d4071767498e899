"""A level that wanders and may jump: equal to Kalman filters and regressions of others, false alarms as stated."""

import math

import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from windsysid.monitoring.levels import jumps as glr
from windsysid.monitoring.levels import learning
from windsysid.monitoring.levels.jumps import LevelBelief, Observations, Rates, shared_error, threshold, track
from windsysid.monitoring.levels.learning import learn_growth, learn_rates


def series(count: int, *, slopes: tuple[float, ...] = (), wander: float = 0.0, seed: int = 0):
    """Blocks y, variances r, covariates x of a level at 1."""
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((count, len(slopes)))
    r = rng.uniform(0.5, 2.0, count)
    level = 1.0 + np.cumsum(math.sqrt(wander) * rng.standard_normal(count))
    return level + x @ np.array(slopes) + np.sqrt(r) * rng.standard_normal(count), r, x


def unclipped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(glr, "INNOVATION_LIMIT_SIGMAS", 1e9)
    monkeypatch.setattr(glr, "PULL_LIMIT_SIGMAS", 1e9)


def vague(d: int, variance: float = 4.0) -> LevelBelief:
    return LevelBelief(np.zeros(d), variance * np.eye(d))


def test_tracking_is_the_gaussian_conditional_of_the_whole_series(monkeypatch: pytest.MonkeyPatch):
    # Level, slopes and blocks are jointly Gaussian: the filter's end is the conditional mean, its likelihood the joint
    # density (SciPy).
    unclipped(monkeypatch)
    count, q, s2 = 40, 0.3, 1.7
    y, r, x = series(count, slopes=(0.8, -0.5), wander=q)
    y[7:11] = np.nan
    done = track(Observations.of(y, r, x), vague(3), Rates(q, s2), test=False)
    there = np.isfinite(y)
    h = np.column_stack([np.ones(count), x])
    steps = np.minimum.outer(np.arange(1, count + 1), np.arange(1, count + 1)) * q  # of a random walk
    S = (4.0 * h @ h.T + steps + np.diag(s2 * r))[np.ix_(there, there)]
    cross = np.vstack([4.0 * np.ones(count) + steps[-1], 4.0 * x.T])[:, there]
    np.testing.assert_allclose(done.belief.mean, cross @ np.linalg.solve(S, y[there]), rtol=1e-9)
    own = 4.0 * np.eye(3)
    own[0, 0] += q * count
    np.testing.assert_allclose(done.belief.cov, own - cross @ np.linalg.solve(S, cross.T), rtol=1e-8, atol=1e-12)
    density = scipy.stats.multivariate_normal(cov=S).logpdf(y[there])
    assert done.log_likelihood + 0.5 * there.sum() * -math.log(2.0 * math.pi) == pytest.approx(density, rel=1e-12)


def test_the_statistic_is_the_likelihood_ratio_of_a_regression(monkeypatch: pytest.MonkeyPatch):
    # Without wander a jump before block k is one more column: the drop of the sum of squares by generalised least
    # squares is ℓ.
    unclipped(monkeypatch)
    monkeypatch.setattr(glr, "CANDIDATE_SPACING", 0.0)
    y, r, x = series(60, slopes=(0.5,))
    y[35:] += 2.0
    done = track(Observations.of(y, r, x), vague(2, 1e8), Rates(0.0, 1.0))

    def squares(*columns: np.ndarray) -> float:
        A = np.column_stack([np.ones(60), x, *columns]) / np.sqrt(r)[:, None]
        b = y / np.sqrt(r)
        return float(np.sum((b - A @ np.linalg.lstsq(A, b)[0]) ** 2))

    drops = [squares() - squares((np.arange(60) >= k).astype(float)) for k in range(1, 60)]
    assert done.statistic[-1] == pytest.approx(max(drops), rel=1e-5)
    assert done.since[-1] == 1 + int(np.argmax(drops))


def test_rates_are_those_of_scipys_likelihood(monkeypatch: pytest.MonkeyPatch):
    # Scatter at the maximum of SciPy's joint density, wander its mean over that density at this scatter.
    unclipped(monkeypatch)
    monkeypatch.setattr(learning, "LOG_RANDOM_WALK_PRIOR", (0.0, 1e3))  # flat priors
    monkeypatch.setattr(learning, "LOG_SCATTER_STD", 1e3)
    count = 80
    y, r, x = series(count, wander=0.2, seed=3)
    found = learn_rates(Observations.of(y, r, x), vague(1))
    steps = np.minimum.outer(np.arange(1, count + 1), np.arange(1, count + 1))

    def cost(logs: np.ndarray) -> float:
        q, s2 = np.exp(logs)
        return -float(scipy.stats.multivariate_normal(cov=4.0 + q * steps + np.diag(s2 * r)).logpdf(y))

    best = scipy.optimize.minimize(
        cost, np.log([0.2, 1.0]), method="Nelder-Mead", options={"xatol": 0.02, "maxfev": 60}
    ).x
    assert found.scatter == pytest.approx(np.exp(best[1]), rel=0.05)
    logs = np.linspace(best[0] - 5.0, best[0] + 5.0, 40)
    weight = np.exp(cost(best) - np.array([cost(np.array([log, np.log(found.scatter)])) for log in logs]))
    assert found.wander == pytest.approx(weight @ np.exp(logs) / weight.sum(), rel=0.05)


@pytest.mark.parametrize(
    ("clip", "lowest", "highest"),
    [pytest.param(1e9, 0.8, 1.1, marks=pytest.mark.slow), (glr.INNOVATION_LIMIT_SIGMAS, 0.45, 0.9)],
)
def test_false_alarms_come_as_often_as_stated_or_less(
    monkeypatch: pytest.MonkeyPatch, clip: float, lowest: float, highest: float
):
    # 600 alarms are expected, so that their count is known to 4 %; thinning and clipping take some away.
    monkeypatch.setattr(glr, "INNOVATION_LIMIT_SIGMAS", clip)
    rate, count = 1e-3, 2_000
    alarms, blocks = 0, 0
    rng = np.random.default_rng(5)
    for _ in range(300):
        y, at = rng.standard_normal(count), 0
        while at < count:
            left = Observations.of(y[at:], np.ones(count - at), np.empty((count - at, 0)))
            done = track(left, vague(1, 100.0), Rates(0.0, 1.0), limit=threshold(rate))
            at += done.stopped + 1 if done.stopped >= 0 else count
            alarms += done.stopped >= 0
        blocks += count
    assert lowest < alarms / blocks / rate < highest


def test_run_lengths_are_those_of_a_monte_carlo_over_every_block():
    # All windows of up to 300 white blocks, 400 runs: their mean is known to 5 %, the formula is asymptotic.
    rng = np.random.default_rng(1)
    limit, runs, longest = threshold(1e-2), 400, 600
    sums = np.cumsum(rng.standard_normal((runs, longest)), axis=1)
    sums = np.hstack([np.zeros((runs, 1)), sums])
    length = np.full(runs, longest)
    for n in range(longest, 0, -1):
        k = np.arange(max(0, n - 300), n)
        length[((sums[:, [n]] - sums[:, k]) ** 2 / (n - k) > limit).any(axis=1)] = n
    alarms = (length < longest).sum()
    assert length.sum() / alarms == pytest.approx(100.0, rel=0.2)


def test_bad_blocks_are_no_alarm_and_a_real_jump_is_one():
    limit = threshold(1e-7)
    y, r, x = series(500, seed=2)
    alone = y.copy()
    alone[[100, 200, 300, 301, 400]] += [50.0, -80.0, 60.0, 60.0, 1000.0]
    alone[350:360] = np.nan
    assert track(Observations.of(alone, r, x), vague(1), Rates(0.0, 1.0), limit=limit).stopped == -1
    jumped = y + 20.0 * (np.arange(500) >= 250)
    done = track(Observations.of(jumped, r, x), vague(1), Rates(0.0, 1.0), limit=limit)
    assert 252 <= done.stopped <= 256
    assert done.since[done.stopped] == 250


def test_a_tolerated_jump_is_no_alarm_however_sure():
    y, r, x = series(4000, seed=4)
    y += 0.4 * (np.arange(4000) >= 1000)
    limit, rates = threshold(1e-6), Rates(0.0, 1.0)
    assert track(Observations.of(y, r, x), vague(1), rates, limit=limit, first=500).stopped > 1000
    assert track(Observations.of(y, r, x), vague(1), rates, limit=limit, first=500, tolerated=0.5).stopped == -1


def brute_force(y: np.ndarray, r: np.ndarray, x: np.ndarray, n: int, window: int) -> tuple[float, int]:
    """The highest drop of the sum of squares, by NumPy, for a jump in the last 1 … `window` of n blocks."""
    weight = 1.0 / np.sqrt(r[:n])
    b = y[:n] * weight

    def squares(*columns: np.ndarray) -> float:
        A = np.column_stack([np.ones(n), x[:n], *columns]) * weight[:, None]
        return float(np.sum((b - A @ np.linalg.lstsq(A, b)[0]) ** 2))

    starts = range(max(1, n - window), n)
    drops = [squares() - squares((np.arange(n) >= k).astype(float)) for k in starts]
    return max(drops), starts[int(np.argmax(drops))]


@pytest.mark.parametrize("window", [1, 2, 25])
def test_a_jump_is_looked_for_in_windows_of_every_length_up_to_the_longest(
    monkeypatch: pytest.MonkeyPatch, window: int
):
    unclipped(monkeypatch)
    monkeypatch.setattr(glr, "CANDIDATE_SPACING", 0.0)
    monkeypatch.setattr(glr, "MAX_JUMP_AGE_BLOCKS", window)
    y, r, x = series(70, slopes=(0.5,), seed=7)
    y[30:] += 3.0
    done = track(Observations.of(y, r, x), vague(2, 1e8), Rates(0.0, 1.0))
    for n in (20, 30, 31, 32, 30 + window, 31 + window, 70):
        highest, k = brute_force(y, r, x, n, window)
        assert done.statistic[n - 1] == pytest.approx(highest, rel=1e-4), n
        assert done.since[n - 1] == k


def test_a_jump_is_looked_for_ninety_days_back_and_no_longer():
    ninety_days = 90 * 24 * 6  # records of 10 minutes
    assert ninety_days == glr.MAX_JUMP_AGE_BLOCKS
    jump, count = 40, ninety_days + 2000
    y = np.random.default_rng(8).standard_normal(count) + 8.0 * (np.arange(count) >= jump)
    done = track(Observations.of(y, np.ones(count), np.empty((count, 0))), vague(1, 1e8), Rates(0.0, 1.0))
    age = np.arange(1, count + 1) - done.since
    assert age[jump:].max() <= ninety_days
    # The blocks k that are kept lie a tenth of their age apart, so that one near the jump is the likeliest until it is
    # too old.
    assert abs(done.since[jump + ninety_days - ninety_days // 5] - jump) < 0.1 * ninety_days
    assert done.since[-1] >= count - ninety_days > jump


@pytest.mark.parametrize("slopes", [(), (0.5,), (0.5, -0.2, 0.1, 0.3)])
def test_blocks_one_by_one_give_bit_for_bit_what_they_give_together(slopes: tuple[float, ...]):
    y, r, x = series(700, slopes=slopes, wander=1e-4, seed=9)
    y[300:] += 1.0
    y[[50, 51, 310]] = np.nan
    freed = np.zeros((700, 1 + len(slopes)))
    freed[450] = 2.0
    rates = Rates(1e-4, 1.1)
    blocks = Observations(y, r, x, freed)
    whole = track(blocks, vague(1 + len(slopes)), rates, tolerated=0.1)
    past: LevelBelief | glr.Progress = vague(1 + len(slopes))
    for t in range(700):
        part = slice(t, t + 1)
        one = track(blocks.part(part), past, rates, tolerated=0.1)
        for name in ("level", "std", "whitened", "statistic", "since"):
            np.testing.assert_array_equal(getattr(one, name)[0], getattr(whole, name)[t])
        past = one.progress
    np.testing.assert_array_equal(one.belief.cov, whole.belief.cov)
    np.testing.assert_array_equal(one.progress.sums, whole.progress.sums)
    assert one.progress.blocks == 700


def test_a_track_that_stopped_at_a_jump_goes_on_from_there():
    y, r, x = series(300, seed=1)
    y[200:] += 8.0
    limit, rates = threshold(1e-6), Rates(0.0, 1.0)
    stopped = track(Observations.of(y, r, x), vague(1), rates, limit=limit)
    assert 200 < stopped.stopped < 210
    rest = slice(stopped.stopped + 1, None)
    further = track(Observations.of(y[rest], r[rest], x[rest]), stopped.progress, rates)
    np.testing.assert_array_equal(further.statistic, track(Observations.of(y, r, x), vague(1), rates).statistic[rest])


@pytest.mark.parametrize("logarithmic", [False, True])
def test_the_level_of_a_damping_is_not_pulled_low_by_estimates_that_are_sure_because_they_are_low(logarithmic: bool):
    # Weighed by what blocks say of themselves, the level is 2.9 σ too low in 144 blocks (too high in logarithms).
    rng, count, sigma, trials = np.random.default_rng(27), 144, 0.3, 30
    x, errors = np.empty((count, 0)), []
    for _ in range(trials):
        value = rng.gamma(sigma**-2, sigma**2, count)
        std = sigma * np.sqrt(value) / (value if logarithmic else 1.0)
        y, truth = (np.log(value), 0.0) if logarithmic else (value, 1.0)
        if logarithmic:
            truth = float(np.log(value).mean())  # the mean of logarithms has a bias of its own
        prior = LevelBelief(np.array([truth]), np.array([[9.0 * sigma**2]]))
        rates = learn_rates(Observations.of(y, std**2, x), prior, kind="c", logarithmic=logarithmic)
        done = track(Observations.of(y, std**2, x), prior, rates._replace(wander=0.0), test=False)
        errors.append((done.level[-1] - truth) / done.std[-1])
    assert abs(np.mean(errors)) < 0.6  # 3 standard errors of a mean of 30
    assert np.mean(np.abs(errors) < 2.0) > 0.8


def test_a_growth_is_learned_where_there_is_one():
    rng = np.random.default_rng(28)
    value = rng.gamma(25.0, 0.04, 400)
    for power in (0.0, 1.0, 1.4, 2.0):
        assert learn_growth(value, 0.04 * value**power, False) == pytest.approx(power, abs=1e-6)
        assert learn_growth(np.log(value), 0.04 * value ** (power - 2.0), True) == pytest.approx(power - 2.0, abs=1e-6)
    assert learn_growth(value, 0.04 * value**-3.0, False) == 0.0
    assert learn_growth(np.full(5, np.nan), np.ones(5), False) == 0.0
    assert learn_growth(np.full(5, -1.0), np.ones(5), False) == 0.0


def test_a_block_that_says_nothing_above_zero_still_has_a_variance():
    # A record may find no damping at all: it is a low block, not an infinite or a nameless one.
    y, r, x = np.array([1.0, 1.1, -0.2, 0.0, 1e-9, 0.9]), np.full(6, 0.04), np.empty((6, 0))
    done = track(
        Observations.of(y, r, x),
        LevelBelief(np.array([1.0]), np.array([[1.0]])),
        Rates(0.0, 1.0, 1.0, False),
        test=False,
    )
    assert np.isfinite(done.level).all()
    assert (np.diff(done.std) < 0.0).all()


def test_what_blocks_are_off_by_together_stays():
    y, r = np.full(1000, 2.0), np.full(1000, 0.36)
    rates = Rates(0.0, 1.0, 1.0, False)
    assert shared_error(2.0, y, r, rates) == pytest.approx(0.18)  # 0.3² of 2
    assert shared_error(0.01, y, r, rates) == pytest.approx(0.6)  # no more than a block is off
    assert shared_error(7.0, np.log(y), np.full(1000, 0.09), Rates(0.0, 1.0)) == pytest.approx(0.09)
    assert shared_error(2.0, np.full(3, np.nan), r[:3], rates) == 0.0
