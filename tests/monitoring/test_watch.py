"""Many records of one turbine: a season is no alarm, damage is one, a failing sensor is no failing tower."""

import json
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.stats import norm
from validation.years import Site, simulate_blocks

from windsysid import ConfigurationError, cli
from windsysid._types import Array
from windsysid.identification.identify import identify
from windsysid.identification.planning.plan import plan
from windsysid.monitoring.changes import Watch
from windsysid.monitoring.levels.jumps import threshold
from windsysid.monitoring.series import DAY, RecordBlocks, gather, read_blocks
from windsysid.monitoring.watch import NOISE, SENSOR, STRUCTURE, percent_of, watch
from windsysid.results.posterior import Posterior
from windsysid.simulation.record import simulate_record
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

pytestmark = pytest.mark.usefixtures("without_effects")


PLACE = Site("none", ("k_x", "c_x", "k_beta_1"), np.array([0.003, 0.4, 0.0012]), 10.0)


def quiet(names: tuple[str, ...], count: int = 3000, *, seed: int = 0, sigma: float = 0.004) -> RecordBlocks:
    """Logarithmic series at zero, no covariates."""
    rng = np.random.default_rng(seed)
    n = len(names)
    return RecordBlocks(
        names, np.asarray(600.0 * np.arange(count)), sigma * rng.standard_normal((count, n)),
        np.full((count, n), sigma), (True,) * n, (1.0,) * n,
        np.empty((count, 0)), kinds=tuple(name.partition("_")[0] for name in names),
    )  # fmt: skip


def stepped(blocks: RecordBlocks, name: str, size: float, at: int) -> RecordBlocks:
    theta = blocks.theta.copy()
    theta[at:, blocks.names.index(name)] += size
    return replace(blocks, theta=theta)


@pytest.mark.parametrize(("count", "at"), [(40, 12), (200, 50), (200, 90), (1000, 400)])
def test_a_jump_among_the_records_to_learn_from_is_found(count: int, at: int):
    """It was said that nothing jumped, where the picture shows a step of 4 %."""
    found = watch(stepped(quiet(("k_x", "c_x"), count, seed=5), "k_x", 0.04, at))
    assert [change.name for change in found.changes] == ["k_x"]
    change = found.changes[0]
    assert change.earliest <= found.blocks.time[at] <= change.latest
    assert change.low <= 100.0 * math.expm1(0.04) <= change.high
    assert "no jump" not in found.sentence


@pytest.mark.parametrize(
    ("wander", "count"),
    [*(pytest.param(one, 100, marks=pytest.mark.slow) for one in (0.0, 0.0004, 0.004)), (0.004, 20)],
)
def test_records_to_learn_from_whose_level_wanders_have_no_jump(wander: float, count: int):
    """Odds of 100 : 1 for each series: five or more false ones of 100, two or more of 20 are improbable."""
    jumps = 0
    for seed in range(count):
        blocks, rng = quiet(("k_x",), 60, seed=seed), np.random.default_rng(1000 + seed)
        drift = np.cumsum(wander * rng.standard_normal((60, 1)), axis=0)
        found = watch(replace(blocks, theta=blocks.theta + drift))
        jumps += sum(change.found < blocks.time[found.begins] for change in found.changes)
    assert jumps <= 1 + 3 * (count == 100)


@pytest.mark.slow
def test_a_season_is_no_alarm_and_its_effects_are_found():
    found = watch(simulate_blocks(PLACE, days=365.0, seed=1))
    assert found.changes == ()
    slopes = {s.name: s.slopes for s in found.series}
    for name, covariate, truth in (("k_x", "temperature", -0.03), ("k_beta_1", "temperature", -0.1)):
        value, low, high = slopes[name][covariate]
        assert low <= truth <= high
        assert value == pytest.approx(truth, abs=0.005)
    assert all(s.scatter == pytest.approx(1.2, abs=0.12) for s in found.series)
    assert "no jump" in found.sentence


@pytest.mark.parametrize(("name", "factor"), [("k_x", 0.98), ("k_beta_1", 0.8), ("c_x", 2.0)])
def test_damage_is_found_where_when_and_how_much(name: str, factor: float):
    found = watch(simulate_blocks(PLACE, days=45.0, seed=8, change=(name, factor)))
    assert [c.name for c in found.changes] == [name]
    change = found.changes[0]
    assert change.cause == STRUCTURE
    assert change.earliest <= 30.0 * DAY <= change.latest
    assert 30.0 * DAY < change.found < 31.0 * DAY
    assert change.low <= 100.0 * (factor - 1.0) <= change.high


@pytest.mark.slow
def test_bands_of_when_and_how_much_hold_the_truth_as_often_as_they_say():
    # 60 jumps of a random size; bands of 95.45 % miss more than eight with a probability of 0.2 %.
    rng = np.random.default_rng(3)
    sizes, when, size = rng.uniform(0.02, 0.1, 60), 0, 0
    for seed, jump in enumerate(sizes):
        change = watch(stepped(quiet(("k_x",), 800, seed=seed, sigma=0.02), "k_x", jump, 600)).changes
        if change:
            when += change[0].earliest <= 600 * 600.0 <= change[0].latest
            size += change[0].low <= 100.0 * np.expm1(jump) <= change[0].high
        else:
            when, size = when + 1, size + 1
    assert when >= 52
    assert size >= 52


def test_the_same_moves_in_a_failing_tower_and_with_a_failing_sensor():
    names = ("k_x", "k_y", "noise_tower_x")
    tower = stepped(quiet(names), "k_x", -0.05, 2000)
    assert [(c.name, c.cause) for c in watch(tower).changes] == [("k_x", STRUCTURE)]
    both = stepped(tower, "noise_tower_x", 1.0, 2000)
    assert {c.name: c.cause for c in watch(both).changes} == {"k_x": SENSOR, "noise_tower_x": NOISE}
    sensor = stepped(quiet(names), "noise_tower_x", 1.0, 2000)
    assert [(c.name, c.cause) for c in watch(sensor).changes] == [("noise_tower_x", NOISE)]
    theta = tower.theta.copy()
    theta[2000:, 0] = np.where(np.arange(1000) % 5 == 0, theta[2000:, 0], np.nan)  # four of five are of grade C then
    change = watch(replace(tower, theta=theta)).changes[0]
    assert (change.name, change.cause) == ("k_x", SENSOR)
    assert "does not explain" in change.sentence


def test_false_alarms_of_a_year_are_shared_out_among_the_series():
    for names in (("k_x",), ("k_x", "k_y", "c_x")):
        found = watch(quiet(names, 300), alarms_per_year=0.2)
        each = 0.2 * 600.0 / (365.25 * DAY) / len(names)
        assert [s.limit for s in found.series] == pytest.approx([threshold(each)] * len(names))


def test_the_smallest_jump_passes_the_test_nine_times_in_ten():
    # The filter and the trace of a unit jump, settled by repetition; the statistic's root is then normal about √energy
    # times the jump.
    found = watch(quiet(("k_x",), 300))
    (series,) = found.series
    within, sigma = 144, 0.004 * series.scatter
    q = (series.wander / 100.0) ** 2 / within  # [%] of the level, in a day
    spread = 1.0
    for _ in range(5000):
        spread = q + spread * sigma**2 / (spread + sigma**2)
    left, energy = 1.0, 0.0
    for _ in range(within):
        energy += left**2 / (spread + sigma**2)
        left *= sigma**2 / (spread + sigma**2)
    jump = 0.005 + (math.sqrt(series.limit) + norm.ppf(0.9)) / math.sqrt(energy)
    assert math.log1p(series.smallest / 100.0) == pytest.approx(jump, rel=2e-3)


def test_two_jumps_are_two_alarms():
    twice = stepped(stepped(quiet(("k_x",)), "k_x", -0.03, 1500), "k_x", 0.05, 2200)
    changes = watch(twice).changes
    assert [round(c.percent) for c in changes] == [-3, 5]


def frosty(seed: int, *, loss: float) -> RecordBlocks:
    """Three days of a record every two hours: after 42 hours it is 8 K colder for 18, and stiffness falls meanwhile."""
    rng = np.random.default_rng(seed)
    hours: Array = np.arange(0.0, 72.0, 2.0)
    cold = (hours >= 42.0) & (hours < 60.0)
    temperature: Array = np.where(cold, -4.0, 4.0) + 3.0 * np.sin(2.0 * np.pi * hours / 24.0)
    theta = -0.0003 * temperature + math.log1p(loss) * cold + 0.0053 * rng.standard_normal(len(hours))
    return RecordBlocks(
        ("k_x",), 3600.0 * hours, theta[:, None], np.full((len(hours), 1), 0.0053), (True,), (1.0,),
        temperature[:, None], ("temperature",),
    )  # fmt: skip


def test_what_comes_and_goes_with_the_frost_is_two_jumps_whose_bands_hold_the_truth():
    loss = -0.04
    told = 0
    for seed in range(100, 120):
        changes = watch(frosty(seed, loss=loss), alarms_per_year=0.01).changes
        assert len(changes) == 2
        for change, truth, hour in zip(changes, (100.0 * loss, -100.0 * loss / (1.0 + loss)), (42, 60), strict=True):
            assert math.copysign(1.0, change.low) == math.copysign(1.0, change.high) == math.copysign(1.0, truth)
            assert change.earliest <= 3600.0 * hour <= change.latest
            told += change.low <= truth <= change.high
    assert told >= 36  # of 40 bands of ±2σ: 38.2 are to be expected


def test_frost_alone_is_no_jump():
    for seed in range(100, 120):
        assert watch(frosty(seed, loss=0.0), alarms_per_year=0.01).changes == ()


def test_a_covariate_that_rounding_alone_moves_is_left_out():
    blocks = quiet(("k_x",))
    speed = 1.267 * (1.0 + 1e-15 * np.array([[i % 3] for i in range(len(blocks.time))], dtype=np.float64))
    found = watch(replace(blocks, covariates=speed, covariate_names=("rotor_speed",)))
    assert found.series[0].slopes == {}
    assert "rotor_speed was constant while learning and was left out" in found.notes


def test_blocks_without_covariate_are_left_out_and_said():
    blocks = simulate_blocks(PLACE, days=30.0, seed=2)
    x = blocks.covariates.copy()
    x[2000:2100, 0] = np.nan
    found = watch(replace(blocks, covariates=x))
    assert np.isnan(found.series[0].whitened[2000:2100]).all()
    assert any("100 of 4320 records lack a covariate" in note for note in found.notes)


def test_posteriors_give_what_their_records_say_without_the_prior(verne555: Turbine):
    # Prior N(0, 0.3²) and likelihood N(said, cov) are multiplied by hand; gather must find the likelihood again.
    cov = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
    names = ("k_x", "k_y")
    parameters = tuple(Parameter(name, verne555.values[name], 0.3) for name in names)
    inverse = np.asarray(np.linalg.inv(np.linalg.inv(cov) + np.eye(2) / 0.09), dtype=np.float64)
    said = np.random.default_rng(0).normal(0.1, 0.02, (14, 2))
    posteriors = [
        Posterior(verne555, parameters, np.asarray(inverse @ np.linalg.solve(cov, one)), inverse, "r",
        True) for one in said
    ]  # fmt: skip
    blocks = gather(posteriors, noise=[{"noise_a": (2.0, 0.1)}] * 14)
    np.testing.assert_allclose(blocks.theta[:, :2], said, rtol=1e-5)
    np.testing.assert_allclose(blocks.std[:, :2], np.sqrt(np.diag(cov)) * np.ones((14, 1)), rtol=1e-5)
    assert blocks.names == ("k_x", "k_y", "noise_a")
    np.testing.assert_allclose(blocks.theta[:, 2], np.log(2.0))


def test_a_record_counts_for_the_coefficients_that_it_determines(verne555: Turbine):
    parameters = tuple(Parameter(name, verne555.values[name], 0.3) for name in ("k_x", "k_y"))
    rng, cov = np.random.default_rng(5), np.asarray(np.diag([4e-4, 9e-4]))
    good = [
        Posterior(verne555, parameters, np.asarray(0.02 * rng.standard_normal(2)), cov, f"r{i}", True)
        for i in range(40)
    ]  # fmt: skip
    # Every third record is C along x; a jump along y from the 30th on is in all of them.
    some = [
        one._replace(
            theta=one.theta - np.array([0.0, 0.5 * (i >= 30)]), trusted=i % 3 > 0,
            unusable={} if i % 3 else {"k_x": "prior_conflict" if i else "burst"},
        )
        for i, one in enumerate(good)
    ]  # fmt: skip
    blocks = gather(some)
    np.testing.assert_array_equal(np.isnan(blocks.theta[:, 0]), np.arange(40) % 3 == 0)
    assert np.isfinite(blocks.theta[:, 1]).all()
    kept = np.arange(40) % 3 > 0
    np.testing.assert_array_equal(blocks.std[kept], gather(good).std[kept])
    np.testing.assert_array_equal(blocks.theta[kept, 0], gather(good).theta[kept, 0])
    assert blocks.left_out == {"k_x": {"prior_conflict": 13, "burst": 1}}
    found = watch(blocks)
    assert [(change.name, change.cause) for change in found.changes] == [("k_y", STRUCTURE)]
    assert found.summary()["left_out"] == blocks.left_out
    assert ("k_x", "14", "13 prior conflict, 1 burst") in found.tables()[-1].rows


def test_what_is_c_in_nearly_all_records_is_not_followed_and_said():
    blocks = quiet(("k_x", "c_x"), 100)
    theta = blocks.theta.copy()
    theta[4:, 1] = np.nan
    found = watch(replace(blocks, theta=theta, left_out={"c_x": {"burst": 96}}))
    assert [one.name for one in found.series] == ["k_x"]
    assert any(note.endswith("not followed: c_x") for note in found.notes)
    with pytest.raises(ConfigurationError, match="of grade A or B to learn from"):
        watch(replace(blocks, theta=np.full_like(theta, np.nan)))


@pytest.mark.parametrize("name", [pytest.param("nrel5mw", marks=pytest.mark.slow), "tower"])
def test_what_coefficients_share_adds_less_than_a_hundredth_to_the_information_on_one(name: str):
    # The reason to test them one by one. Loads and noise are unknown; of a precision matrix, 1/Σ_ii is what one knows,
    # (Σ⁻¹)_ii what it would with all others given.
    planned = plan(load_turbine(name).exact(), duration=600.0)
    cov = np.linalg.inv(planned.information(600.0))[: planned.unknown, : planned.unknown]
    assert (np.diag(cov) * np.diag(np.linalg.inv(cov)) < 1.01).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.zeros(3000)}, "put the records in order"),
        ({"std": np.zeros((3000, 1))}, "positive standard deviations"),
        ({"theta": np.zeros((3000, 2))}, "expected theta of shape"),
        ({"covariate_names": ("wind",)}, "expected covariates of shape"),
    ],
)
def test_blocks_that_do_not_fit_are_refused(changes: dict[str, Any], message: str):
    with pytest.raises(ConfigurationError, match=message):
        replace(quiet(("k_x",)), **changes)


def test_a_rate_out_of_range_is_refused():
    with pytest.raises(ConfigurationError, match="alarms per year"):
        watch(quiet(("k_x",)), alarms_per_year=0.0)


def test_what_is_tolerated_is_drift_and_no_alarm():
    small = stepped(quiet(("k_x",)), "k_x", -0.004, 1500)
    found = watch(small)
    assert found.changes == ()
    assert found.series[0].drift[2] < 0.0
    assert len(watch(small, tolerated={"k": 0.0, "c": 0.0, "noise": 0.0}).changes) == 1


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """One result in 14 folders, k_side_side of the last six half as large."""
    record = simulate_record("tower", duration=200.0, rate=5.0, seed=1)
    result = identify(record, "tower", formulation="spectral")
    base = tmp_path_factory.mktemp("results")
    made = []
    for i in range(14):
        estimates = tuple(
            replace(e, estimate=e.estimate * (0.5 if e.name == "k_side_side" and i >= 8 else 1.0))
            for e in result.estimates
        )
        folder = base / f"{i:02d}"
        folder.mkdir()
        replace(result, estimates=estimates, record=f"r{i}").save(folder)
        made.append(folder)
    return made


class Ended(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Ended]:
    """Run the command in this process, as the console script would."""

    def run(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["windsysid", "monitor", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return Ended(int(ended.value.code or 0), *capsys.readouterr())

    return run


def test_the_command_answers_with_a_sentence_a_table_a_figure_and_a_summary(run, folders: list[Path], tmp_path: Path):
    lines = ["time,temperature", *(f"2026-03-{1 + i:02d}T06:00,{i % 5}" for i in range(14))]
    table = tmp_path / "covariates.csv"
    table.write_text("\n".join(lines) + "\n")
    output = tmp_path / "watched"
    done = run(*folders, "--covariates", table, "--output", output)
    assert done.code == 0, done.err
    assert done.out.startswith("k_side_side fell by")  # the answer first
    assert "2026-03-" in done.out
    assert {path.name for path in output.glob("[!.]*")} == {
        "answer.json",
        "report.html",
        "monitor.png",
        "summary.json",
    }
    summary = json.loads((output / "summary.json").read_text())
    assert [c["name"] for c in summary["changes"]] == ["k_side_side"]
    assert "noise_tower_acceleration" in summary["series"]


def test_a_file_of_covariates_that_does_not_fit_is_one_line(run, folders: list[Path], tmp_path: Path):
    folders, table = folders[:12], tmp_path / "covariates.csv"
    table.write_text("time,wind\n0,5\n")
    done = run(*folders, "--covariates", table)
    assert done.code == 2
    assert "expected 12 lines, one for each record, got 1" in done.err
    assert run(*folders[:3]).code == 2
    table.write_text("time,site\n" + "".join(f"{i},north\n" for i in range(12)))
    with pytest.raises(ConfigurationError, match="expected numbers in column 'site'"):
        read_blocks(folders, table)
    table.write_text("time,wind\n" + "".join(f"2026-01-{i + 1:02d},5\n" for i in range(12)))
    assert read_blocks(folders, table).begin == datetime(2026, 1, 1)


def test_a_band_without_an_end_in_logarithms_is_a_number_in_percent():
    with np.errstate(over="raise"):
        change, low, high = percent_of(0.1, 500.0, 1.0, logarithmic=True)
    assert change == pytest.approx(100.0 * math.expm1(0.1))
    assert low == pytest.approx(-100.0)
    assert math.isfinite(high)
    assert high > 1e100


def test_records_far_apart_find_a_jump_within_one_record():
    blocks = quiet(("k_x",), 40, seed=1)
    assert "within a day" in watch(blocks).sentence
    assert "within one record (10 days)" in watch(replace(blocks, time=1440.0 * blocks.time)).sentence


def test_a_level_has_the_digits_of_its_interval():
    steady = {"drift": (0.0, 0.0, 0.0), "wander": 0.1, "scatter": 1.0, "smallest": 1.0}
    series: Any = [
        SimpleNamespace(name=name, unit=unit, level=[level], low=[level - half], high=[level + half], **steady)
        for name, unit, level, half in (
            ("bending", "Hz", 0.315494, 0.000123), ("k_x", "N/m", 1784123.0, 20000.0), ("exact", "Hz", 0.3, 0.0),
        )
    ]  # fmt: skip
    rows = Watch.rows.fget(SimpleNamespace(series=series))  # type: ignore[attr-defined]
    assert [row[1:3] for row in rows] == [("Hz", "0.31549 ± 0.00012"), ("MN/m", "1.784 ± 0.02"), ("Hz", "0.3 ± 0")]
