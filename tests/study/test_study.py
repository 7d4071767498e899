"""The study, reduced to one seed, two sections and two starts; wind, methods side by side and the report are slow."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from validation.wind_study import main, summary

from windsysid.filters import FILTERS
from windsysid.identification.estimate.force_balance import analysis_band
from windsysid.output.folders import claim
from windsysid.study import methods, report, run
from windsysid.study.methods import Method, gather, method_table
from windsysid.study.published import PUBLISHED
from windsysid.study.report import error_table, study_files, withheld_table
from windsysid.study.run import Study, average_errors, run_study
from windsysid.study.scenario import NOISE, RATE, SECTION, simulate_reference
from windsysid.study.wind import (
    ARMS,
    DirectionChangeStudy,
    direction_change_figure,
    load_spectra_figure,
)

FIVE = ("k_x", "k_y", "k_beta_1", "c_x", "c_y")
"""The coefficients whose published errors are to be beaten; c_beta_1's 0.01 % cannot be with the published noise."""

KNOWN, OLD, WITHHELD = ARMS


@pytest.fixture(scope="module")
def told() -> list[str]:
    return []


@pytest.fixture(scope="module")
def study(without_effects: None) -> Study:
    """Without the wind and the methods, which take more than half of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "SEEDS", 1)
        patch.setattr(run, "STARTS", (0.0, 500.0))
        patch.setattr(run, "FACTORS", (0.3, 3.0))
        patch.setattr(run, "COMPARED", 0)
        patch.setattr(run, "direction_change_study", lambda _: None)
        return run_study(0)


@pytest.fixture(scope="module")
def whole(told: list[str], without_effects: None) -> Study:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "SEEDS", 2)
        patch.setattr(run, "STARTS", (0.0, 500.0))
        patch.setattr(run, "FACTORS", (0.3, 3.0))
        patch.setattr(run, "COMPARED", 1)
        patch.setattr(methods, "FILTERS", FILTERS[:1])
        return run_study(0, lambda doing, share: told.append(doing))


@pytest.fixture(scope="module")
def saved(whole: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    with claim(folder) as write:
        write(study_files(whole))
    return folder


def column(study: Study, name: str) -> int:
    return [e.name for e in study.arm_a.estimates].index(name)


def by_name(study: Study) -> dict[str, Method]:
    """The methods side by side, by name and what each is told."""
    return {f"{m.name}, {m.told}": m for m in study.methods}


@pytest.fixture(scope="module")
def wind(whole: Study) -> DirectionChangeStudy:
    return whole.wind


def numbers(value: object) -> list[float]:
    """Every number in a nest of mappings and lists."""
    if isinstance(value, dict):
        return [x for item in value.values() for x in numbers(item)]
    if isinstance(value, list | tuple):
        return [x for item in value for x in numbers(item)]
    return [float(value)] if isinstance(value, int | float) else []


# the scenario


def test_the_reference_scenario_is_the_one_that_was_described(study):
    # PAPER_NOTES: hub 14 mm, 0.11 m/s, 1.5 m/s² rms; lag 8 mrad, 0.11 rad/s, 2.6 rad/s². 15 N and 15 N·m rms, 1 s. An
    # rms over 600 s of such a load has a standard error of 3 %, a displacement's of twice that.
    response, inputs = study.reference.response, study.reference.inputs
    rms = lambda values: np.sqrt(np.mean(values**2, axis=0))  # noqa: E731
    np.testing.assert_allclose(rms(inputs[:, 3:]), 15.0, rtol=0.1)
    for columns, displacement, velocity, acceleration in (
        (slice(0, 1), 14e-3, 0.11, 1.5),
        (slice(2, 5), 8e-3, 0.11, 2.6),
    ):
        n = 5
        assert rms(response.states[:, :n])[columns] == pytest.approx(displacement, rel=0.15)
        assert rms(response.states[:, n:])[columns] == pytest.approx(velocity, rel=0.15)
        assert rms(response.rates[:, n:])[columns] == pytest.approx(acceleration, rel=0.15)


def test_the_record_has_the_published_noise(study):
    record, response = study.reference.record, study.reference.response
    assert record.samples == 60_000
    assert record.rate == pytest.approx(RATE)
    for channel, exact, noise in (
        ("tower_y_acceleration", response.rates[:, 6], NOISE["tower_acceleration"]),
        ("blade_1_lag_displacement", response.states[:, 2], 1e-5),
        ("blade_2_lag_velocity", response.states[:, 8], 0.01),
        ("blade_3_lag_acceleration", response.rates[:, 9], 0.1),
    ):
        # relative standard error of an rms of 60 000 samples: 1/√120000
        assert np.std(record[channel] - exact) == pytest.approx(noise, rel=4 / math.sqrt(120_000))
    assert not any("displacement" in c or "velocity" in c for c in record.channels if c.startswith("tower"))


def test_a_seed_repeats_the_scenario(study):
    again = simulate_reference(study.turbine, 0)
    np.testing.assert_array_equal(again.record.values, study.reference.record.values)
    assert not np.array_equal(simulate_reference(study.turbine, 1).record.values, again.record.values)


# the results


@pytest.mark.parametrize("window", [0, 1])
@pytest.mark.parametrize("name", FIVE)
def test_average_errors_are_below_the_published_ones(study, name, window):
    assert study.errors.shape == (1, 2, 10)
    assert np.all(study.errors[:, window, column(study, name)] < PUBLISHED[name])


def test_the_windows_are_the_whole_section_and_from_30_s_on(study):
    errors = np.abs(study.arm_a.history("c_x")[0] / 12.0 - 1.0) * 100.0
    assert len(errors) == 10_000
    both = average_errors(study.arm_a)[:, column(study, "c_x")]
    assert both == pytest.approx([errors.mean(), errors[3000:].mean()])
    np.testing.assert_allclose(study.errors[0], average_errors(study.arm_a))  # seed 0 is the study's own


def test_the_filter_starts_30_percent_off(study):
    for e in study.arm_a.estimates:
        assert e.reference is not None
        assert e.prior == pytest.approx((1.3 if e.kind == "stiffness" else 0.7) * e.reference)
        assert study.arm_a.history(e.name)[0][0] == pytest.approx(e.prior, rel=0.35)


def test_withheld_loads_lose_the_damping(study):
    for e in study.arm_b.estimates:
        assert e.reference is not None
        if e.kind == "damping":
            assert e.estimate < 0.5 * e.reference, e.name
            assert study.arm_a[e.name].estimate == pytest.approx(e.reference, rel=0.05)
    assert study.arm_b["c_x"].high < 12.0  # the bands are narrow and wrong


def test_it_does_not_matter_where_it_starts(study):
    assert set(study.histories) == {0.3, 3.0}
    for low, high, name in zip(study.histories[0.3], study.histories[3.0], PUBLISHED, strict=True):
        assert low[-1] == pytest.approx(high[-1], rel=0.03), name
    apart = [abs(high[0] - low[0]) for low, high in zip(study.histories[0.3], study.histories[3.0], strict=True)]
    assert max(apart) > 0.2  # after the first sample they still are
    assert set(study.sections) == {0.0, 500.0}
    for estimates in study.sections.values():
        for name, (value, half) in estimates.items():
            assert value == pytest.approx(1.0, abs=0.01 if name[0] == "k" else 0.06), name
            assert 0.0 < half < 0.1


def test_centesimal_differences_and_exact_jacobians_agree(study):
    assert study.difference < 1e-8


def test_the_identified_model_answers_like_the_reference(study):
    truth = study.reference.response.states[study.window]
    for j in range(10):
        difference = study.model_response.states[:, j] - truth[:, j]
        assert np.std(difference) < 0.05 * np.std(truth[:, j])


def test_blade_velocity_noise_shrinks_c_beta_by_what_the_band_lets_in(study):
    # Errors in variables: -σ² share / var(velocity), with the share of white noise inside the band.
    low, high = analysis_band(study.turbine)
    share = (high - low) / (RATE / 2.0)
    shrinks = (0.01**2) * share / np.var(study.reference.response.states[:, 7])
    assert shrinks < 0.005
    assert study.arm_a["c_beta_1"].average_error_percent is not None
    assert study.arm_a["c_beta_1"].average_error_percent > PUBLISHED["c_beta_1"]


# the wind that changes direction


@pytest.mark.parametrize(("name", "factor"), [("k_x", 4.0), ("c_x", 3.0), ("k_y", 3.0), ("c_y", 2.0)])
@pytest.mark.slow
def test_estimates_scatter_at_the_change_where_the_filter_holds_the_old_direction(wind, name, factor):
    # Seeds 0 to 3: k_x 3 to 8 times the wander without a change, c_x 3 to 6.
    assert wind.wander(OLD, name) > factor * wind.wander(OLD, name, changed=False)
    assert wind.wander(KNOWN, name) < 1.5 * wind.wander(KNOWN, name, changed=False)


@pytest.mark.slow
def test_nothing_differs_before_the_wind_turns(wind):
    before = slice(0, 1700)  # the balance's filter looks ahead by about two seconds
    for name in ("k_x", "c_x"):
        pair = [wind.arms[arm].history(name)[0][before][500:] for arm in (KNOWN, OLD)]
        np.testing.assert_allclose(pair[0], pair[1], rtol=0.02)


@pytest.mark.slow
def test_known_loads_give_the_references_and_withheld_loads_do_not(wind):
    for name in ("k_x", "k_y", "k_beta_1"):
        assert wind.arms[KNOWN][name].estimate == pytest.approx(wind.turbine.values[name], rel=0.005)
    for name in ("c_x", "c_y", "c_beta_1"):
        assert wind.arms[KNOWN][name].estimate == pytest.approx(wind.turbine.values[name], rel=0.05)
    assert abs(wind.arms[WITHHELD]["k_x"].estimate / wind.turbine.values["k_x"] - 1.0) > 0.02


@pytest.mark.slow
def test_damping_is_structure_and_aerodynamics_where_only_loads_at_rest_are_known(wind):
    own = wind.under.wind.damping[:, 2, 2].mean()
    total = wind.loads_at_rest["c_beta_1"].estimate
    assert total == pytest.approx(wind.turbine.values["c_beta_1"] + own, rel=0.05)


@pytest.mark.slow
def test_the_change_of_direction_has_figures_and_text(wind):
    assert len(direction_change_figure(wind).axes) == 6
    assert len(load_spectra_figure(wind).axes) == 3
    assert "loads of the old direction" in summary(wind)


# the methods side by side


@pytest.mark.slow
def test_withheld_loads_ruin_the_balance_and_wrong_statistics_the_joint_filter(whole):
    by = {name: (m.rms_error("k_"), m.rms_error("c_"), m.covered) for name, m in by_name(whole).items()}
    told = "motion of every degree of freedom"
    balance, withheld = by[f"force balance, EKF, arm A, {told}, loads"], by[f"force balance, EKF, arm B, {told}"]
    assert balance[1] < 0.03 < 0.5 < withheld[1]
    mode = by["joint, posterior mode, nothing"]
    wrong = by["joint, extended Kalman filter, the same, loads 3 × too large"]
    assert mode[0] < 0.03 < wrong[0]
    assert mode[2] >= 0.8


def two_methods() -> list[Method]:
    """Results of two methods on one record, by hand."""
    names = tuple(f"{kind}_{i}" for kind in "kc" for i in range(5))
    errors = np.linspace(-0.1, 0.2, 20).reshape(2, 1, 10)
    return [Method(f"method {i}", "loads", names, errors[i], errors[i] / 0.05, np.array([0.5 + i])) for i in range(2)]


def test_runs_are_gathered_by_method():
    runs = two_methods()
    both = gather(runs + [run._replace(error=-run.error, seconds=3.0 * run.seconds) for run in runs])
    assert [m.name for m in both] == [m.name for m in runs]
    assert both[0].error.shape == (2, 10)
    assert both[0].rms_error("k_") == pytest.approx(runs[0].rms_error("k_"))
    assert both[0].summary()["seconds"] == pytest.approx(2.0 * float(np.median(runs[0].seconds)))
    table = method_table(both)
    assert len(table.rows) == len(runs)
    assert "2 records, 10 coefficients" in table.caption


# what is written


def test_an_output_of_the_change_of_direction_that_is_a_file_is_one_line(tmp_path, capsys):
    taken = tmp_path / "taken"
    taken.write_text("")
    assert main(["--output", str(taken)]) == 2
    assert capsys.readouterr().err.startswith("error: ")


@pytest.mark.parametrize("of", [pytest.param("whole", marks=pytest.mark.slow), "study"])
def test_three_files_are_written(of, request, tmp_path, monkeypatch):
    study = request.getfixturevalue(of)
    if study.wind is None:
        study = replace(study, methods=two_methods())
        monkeypatch.setattr(report, "study_report", lambda _: b"page")  # whose figures take seconds
    with claim(tmp_path) as write:
        write(study_files(study))
    written = sorted(path.name for path in tmp_path.glob("[!.]*"))
    assert written == ["identification.nc", "report.html", "summary.json"]
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["parameters"]["c_x"]["estimate"] == study.arm_a["c_x"].estimate
    assert summary["loads_withheld"]["c_x"]["estimate"] == study.arm_b["c_x"].estimate
    worst = summary["average_error_percent"]["from_30_s"]["k_y"]["worst"]
    assert worst == pytest.approx(study.errors[:, 1, column(study, "k_y")].max())
    assert study.arm_b["c_x"].estimate < 0.5 * study.arm_a["c_x"].estimate


@pytest.mark.slow
def test_the_summary_has_both_arms_and_the_published_errors(saved, whole):
    summary = json.loads((saved / "summary.json").read_text())
    assert len(summary["parameters"]) == len(summary["loads_withheld"]) == 10
    published = {
        name: values["published_error_percent"]
        for name, values in summary["parameters"].items()
        if "published_error_percent" in values
    }
    assert published == {"k_x": 0.23, "k_y": 0.66, "k_beta_1": 1.60, "c_x": 5.41, "c_y": 4.53, "c_beta_1": 0.01}
    assert summary["formulation"] == "force-balance"
    assert summary["samples"] == 10_000
    assert summary["section"][0] == SECTION[0]
    assert summary["parameters"]["c_x"]["estimate"] == whole.arm_a["c_x"].estimate
    assert summary["loads_withheld"]["c_x"]["estimate"] == whole.arm_b["c_x"].estimate
    for window, row in (("whole_section", 0), ("from_30_s", 1)):
        worst = summary["average_error_percent"][window]["k_y"]["worst"]
        assert worst == pytest.approx(whole.errors[:, row, column(whole, "k_y")].max())
    found = numbers(summary)
    assert len(found) > 200
    assert np.isfinite(found).all()


@pytest.mark.slow
def test_the_report_is_one_file_that_needs_nobody(saved):
    html = (saved / "report.html").read_text(encoding="utf-8").replace("\xa0", " ")
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", html)
    assert not re.search(r"https?://", html)
    assert not re.search(r"@import|url\((?!#)", html)
    assert html.count('<svg class="drawn"') >= 8
    assert len(html) < 8_000_000
    for words in (
        "Loads withheld",
        "E[f v] = c E[v²]",
        "joint formulation",
        "0.23 %",
        "published",
        "c_β1 cannot be reached",
    ):
        assert words in html, words


@pytest.mark.slow
def test_the_dataset_holds_the_histories(saved, whole):
    with xr.open_dataset(saved / "identification.nc", engine="h5netcdf") as dataset:
        history = dataset["estimate"].sel(parameter="k_y").to_numpy()
        np.testing.assert_array_equal(history, whole.arm_a.history("k_y")[0])
        assert float(dataset["time"][0]) == SECTION[0]


def test_tables_set_ours_beside_the_published(study):
    table = error_table(study)
    assert [row[:2] for row in table.rows] == [[name, f"{error:g} %"] for name, error in PUBLISHED.items()]
    assert all(len(row) == len(table.headings) for row in table.rows)
    withheld = withheld_table(study)
    assert float(withheld.rows[list(PUBLISHED).index("c_x")][3]) < 0.5


@pytest.mark.slow
def test_progress_is_told(told, whole):
    assert told[0].startswith("simulating")
    assert "seed 2 of 2" in told
    assert any("loads withheld" in text for text in told)


@pytest.mark.slow
def test_over_twenty_seeds_even_the_worst_is_below_the_published():
    study = run_study(0)
    assert study.errors.shape == (20, 2, 10)
    for name in FIVE:
        worst = study.errors[:, :, column(study, name)].max()
        assert worst < PUBLISHED[name], f"{name}: {worst} %"
    # ±2σ holds 95.45 % of a normal distribution; the ten coefficients of one record count as about one.
    assert study.covered > 0.9
