"""The front door: records as they come, priors that are off, noise on demand, and a record from another program."""

import json
import math
from dataclasses import replace
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tests.findings import codes, notes, only, reasons
from tests.identification.fits import identify_without_effects as identify
from tests.identification.fits import rotor_from, rotor_record, std_of_model
from windsysid.errors import ConfigurationError, NumericalError, RecordError
from windsysid.identification import formulations as ways
from windsysid.identification import identify as identify_module
from windsysid.identification.condition.readings import (
    add_noise,
    choose_rate,
    resample_for_model,
    usable_sensors,
    with_noise,
)
from windsysid.identification.estimate.spectral.frequency_domain import identify_by_spectrum
from windsysid.identification.estimate.time_domain import identify_jointly_from
from windsysid.identification.limits import MAX_RADIANS_PER_READING
from windsysid.identification.model.prior import Prior
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.mechanics import Sensor
from windsysid.mechanics.sensors import Accelerometer
from windsysid.modal.sweep import find_modes
from windsysid.monitoring.comparison import compare
from windsysid.records.formats import read_record
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.identification import Identification, coefficient_errors
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

DECAY = Path(__file__).parents[3] / "shared" / "data" / "openfast" / "a2_rot12_decay_min.outb"
needs_decay = pytest.mark.skipif(not DECAY.is_file(), reason="the OpenFAST records are not beside this checkout")

COEFFICIENTS = [f"{kind}_{of}" for of in ("x", "y", "beta_1", "beta_2", "beta_3") for kind in "kc"]


@pytest.fixture(scope="module")
def record() -> Record:
    return rotor_record()


@pytest.fixture(scope="module")
def found() -> Identification:
    return rotor_from(0.7)


def without(record: Record, *channels: str) -> Record:
    return record.select([name for name in record.channels if name not in channels])


# results


def test_the_summary_has_every_key_with_finite_numbers(found, record):
    summary = found.summary()
    assert {"method", "formulation", "record", "turbine", "sensors", "samples", "elapsed_s"} <= set(summary)
    assert summary["method"] == "posterior mode, extended Kalman filter"
    assert summary["formulation"] == "joint"
    assert summary["turbine"] == "verne555"
    assert summary["samples"] == record.samples
    assert summary["elapsed_s"] > 0.0
    assert list(summary["parameters"]) == COEFFICIENTS
    for name, values in summary["parameters"].items():
        assert values["kind"] == ("stiffness" if name[0] == "k" else "damping")
        angular = "beta" in name
        units = {"stiffness": ("N/m", "N*m/rad"), "damping": ("N*s/m", "N*m*s/rad")}
        assert values["unit"] == units[values["kind"]][angular]
        numbers = ("estimate", "low", "high", "std", "informed_by_data", "reference", "average_error_percent", "prior")
        assert all(math.isfinite(values[key]) for key in numbers), name
        assert values["low"] < values["estimate"] < values["high"]
        assert 0.0 <= values["informed_by_data"] <= 1.0
        assert values["prior"] == pytest.approx(0.7 * values["reference"])
    assert len(summary["modes"]) == 5
    for mode in summary["modes"]:
        for quantity in ("frequency", "damping_ratio"):
            assert mode[quantity]["low"] < mode[quantity]["estimate"] < mode[quantity]["high"]
            assert math.isfinite(mode[quantity]["reference"])


def test_the_summary_is_json_and_has_no_nan(found):
    assert json.loads(found.to_json()) == json.loads(json.dumps(found.summary()))
    assert "NaN" not in found.to_json()


def test_saved_results_read_back(found, tmp_path):
    found.save(tmp_path)
    assert sorted(path.name for path in tmp_path.glob("[!.]*")) == ["identification.nc", "summary.json"]
    assert json.loads((tmp_path / "summary.json").read_text())["parameters"]["k_x"]["estimate"] == found["k_x"].estimate
    with xr.open_dataset(tmp_path / "identification.nc", engine="h5netcdf") as dataset:
        assert list(dataset["parameter"].values) == COEFFICIENTS
        history = dataset["estimate"].sel(parameter="c_beta_2").to_numpy()
        np.testing.assert_array_equal(history, found.history("c_beta_2")[0])
        assert float(dataset["final_estimate"].sel(parameter="k_y")) == found["k_y"].estimate
        np.testing.assert_array_equal(dataset["cov"], found.cov)
        assert dataset["whitened"].shape == (found.samples, 5)
        assert dataset.attrs["turbine"] == "verne555"
        xr.testing.assert_identical(dataset.load(), found.to_xarray())


def test_bands_are_two_standard_deviations_in_filter_coordinates(found):
    std = np.sqrt(np.diag(found.cov))
    for i, e in enumerate(found.estimates):
        if e.kind == "stiffness":  # logarithmic: the band is a factor to either side
            assert e.high / e.estimate == pytest.approx(math.exp(2 * std[i]))
            assert e.estimate / e.low == pytest.approx(math.exp(2 * std[i]))
        else:
            assert e.high - e.estimate == pytest.approx(2 * e.std)
            assert e.estimate - e.low == pytest.approx(2 * e.std)


def test_the_error_is_eq_24_point_by_point_averaged():
    np.testing.assert_allclose(coefficient_errors(np.array([90.0, 100.0, 120.0]), 100.0), [10.0, 0.0, 20.0])
    np.testing.assert_allclose(coefficient_errors(np.array([-90.0]), -100.0), [10.0])


def test_the_average_error_belongs_to_the_history(found):
    e = found["k_beta_3"]
    history = found.history("k_beta_3")[0]
    assert e.average_error_percent == pytest.approx(np.mean(np.abs(history - 4150.0)) / 41.5)
    assert abs(history[0] / (0.7 * 4150.0) - 1.0) < 0.2  # it starts near the prior


def test_a_result_prints_as_tables_and_knows_its_names(found):
    text = str(found)
    for words in ("k_beta_3", "N·m/rad", "95 % interval", "tower x", "learned from the record"):
        assert words in text
    with pytest.raises(KeyError, match="'k_z' was not identified: expected one of k_x"):
        found["k_z"]


def test_a_result_says_first_what_was_asked(found):
    lines = str(found).splitlines()
    places = [
        next(i for i, line in enumerate(lines) if words in line) for words in ("tower x", "trust:", "k_x", "load_rms_x")
    ]
    assert places == sorted(places)
    (row,) = (line for line in lines if "lag backward" in line)
    frequency, speed = (
        next(m for m in found.modes if m.name == "lag backward").frequency.estimate,
        found.machine.rotor_speed,
    )
    assert f"3P {100.0 * (frequency / (3.0 * speed / (2.0 * math.pi)) - 1.0):+.2g} %" in row


def test_progress_of_a_search_never_falls_and_is_not_whole_before_the_end(verne555, record):
    told: list[tuple[str, float | None]] = []
    part = record.section(0.0, 10.0)
    identify(part, verne555, prior=Prior(0.7, 0.7), progress=lambda doing, share: told.append((doing, share)))
    shares = [share for _, share in told if share is not None]
    assert {doing for doing, _ in told} == {"joint formulation, 1000 samples"}
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert 0.5 < shares[-1] < 1.0


@pytest.mark.slow
def test_a_notebook_shows_what_the_terminal_shows(found, record):
    html = found._repr_html_()
    assert "<script" not in html
    for words in (found.turbine, "tower x", "k_beta_3", str(found.diagnosis)):
        assert words in html
    assert "tower_x_acceleration" in record._repr_html_()


def test_a_result_is_a_data_frame(found):
    frame = found.to_dataframe().set_index(["name", "quantity"])
    assert list(frame.columns) == ["unit", "estimate", "low", "high", "grade", "in_file"]
    row = frame.loc[("k_x", "coefficient")]
    assert (row.unit, row.estimate, row.low, row.in_file) == ("N/m", found["k_x"].estimate, found["k_x"].low, 1800.0)
    assert frame.loc[("tower x", "damping ratio"), "high"] == found.modes[1].damping_ratio.high
    assert (frame.low <= frame.high).all()


def test_a_result_plots_itself(found):
    figure = found.plot()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert len(figure.axes) == 2 * len(found.estimates)  # each with its error below
    assert sum("[N/m]" in label for label in labels) == 2


# records as they come


def close_to(one: Identification, other: Identification, sigmas: float) -> None:
    for e in one.estimates:
        assert abs(e.estimate - other[e.name].estimate) < sigmas * e.std, e.name


@pytest.mark.slow
def test_the_recorded_speed_is_not_needed(verne555, record, found):
    close_to(identify(without(record, "rotor_speed"), verne555, prior=Prior(0.7, 0.7)), found, 0.05)


def test_a_section_is_what_is_identified(verne555, record):
    result = identify(record, verne555, section=(5.0, 8.0), loads="broadband")
    assert result.samples == 300
    assert result.section == pytest.approx((5.0, 7.99))
    assert result.time[0] == 5.0


@pytest.mark.slow
def test_missing_values_are_no_trouble(verne555, record, found):
    values = record.values.copy()
    values[:20] = values[1000:1100] = np.nan  # azimuth and speed too
    values[2000:2010, 3] = np.nan
    holed = Record(record.time, values, record.channels, record.units, name="holed")
    close_to(identify(holed, verne555, prior=Prior(0.7, 0.7)), found, 3.0)


@pytest.mark.slow
def test_missing_rows_become_missing_values(verne555, record, found):
    kept = np.ones(record.samples, dtype=bool)
    kept[1000:1100] = kept[3000:3200] = False  # two to three turns
    holed = Record(record.time[kept], record.values[kept], record.channels, record.units)
    result = identify(holed, verne555, prior=Prior(0.7, 0.7))
    assert result.samples == record.samples
    assert np.isnan(result.innovation[1000:1100]).all()
    close_to(result, found, 3.0)


def test_a_silent_channel_is_refused_and_a_faint_one_is_no_trouble(verne555, record):
    def heard(factor):
        return record.with_channels({"tower_x_acceleration": (factor * record["tower_x_acceleration"] + 0.0, "m/s^2")})

    with pytest.raises(RecordError, match="'tower_x_acceleration' is 0 m/s² from the first sample to the last"):
        identify(heard(0.0), verne555, section=(0.0, 5.0))
    faint = identify(heard(1e-9), verne555, section=(0.0, 3.0), sensors=verne555.sensors[:2], loads="broadband")
    assert np.isfinite([e.estimate for e in faint.estimates]).all()


@pytest.mark.parametrize("formulation", ["joint", "force-balance"])
def test_a_channel_that_is_all_nan_is_named(verne555, record, formulation):
    bad = record.with_channels({"tower_y_acceleration": (np.full(record.samples, np.nan), "m/s^2")})
    with pytest.raises(RecordError, match="channel 'tower_y_acceleration' holds no numbers"):
        identify(bad, verne555, formulation=formulation)


@pytest.mark.parametrize("formulation", ["joint", "force-balance"])
def test_a_unit_of_another_quantity_is_named(verne555, record, formulation):
    bad = record.with_channels({"blade_1_lag_acceleration": (record["blade_1_lag_acceleration"], "m/s^2")})
    with pytest.raises(RecordError, match=r"'blade_1_lag_acceleration': expected rad/s\^2.* got m/s\^2"):
        identify(bad, verne555, formulation=formulation)


def test_a_channel_of_the_users_own_list_must_be_there(verne555, record):
    with pytest.raises(RecordError, match="no channel 'tower_y_acceleration': did you mean tower_x_acceleration"):
        identify(without(record, "tower_y_acceleration"), verne555, sensors=verne555.sensors)
    with pytest.raises(ConfigurationError, match="the sensor list is empty"):
        identify(record, verne555, sensors=())
    far = Accelerometer(channel="blade_1_lag_acceleration", point="blade_4", axis="lag", noise=0.1)
    with pytest.raises(ConfigurationError, match="sits on blade 4, but the turbine has 3 blades"):
        identify(record, verne555, sensors=(far,))


def test_of_the_usual_sensors_those_are_used_that_are_recorded(verne555, record):
    fewer = without(record, "blade_2_lag_acceleration")
    assert [s.channel for s in usable_sensors(fewer, verne555, None)] == [
        "tower_x_acceleration", "tower_y_acceleration", "blade_1_lag_acceleration", "blade_3_lag_acceleration"
    ]  # fmt: skip
    with pytest.raises(RecordError, match=r"expected one of the channels tower_x_acceleration, .* got rotor_azimuth"):
        identify(record.select(["rotor_azimuth"]), verne555)


def test_without_azimuth_there_is_nothing_to_be_said(verne555, record):
    with pytest.raises(RecordError, match="no channel 'rotor_azimuth'"):
        identify(without(record, "rotor_azimuth"), verne555)


def test_less_than_a_revolution_is_too_short(verne555, record):
    with pytest.raises(RecordError, match=r"at least one revolution \(0\.862 s at 69\.6 rpm\), got 0\.8 s"):
        identify(record.section(0.0, 0.81), verne555)
    assert len(identify(record.section(0.0, 1.0), verne555).estimates) == 10


def test_a_section_must_leave_something_to_the_force_balance(verne555, record):
    with pytest.raises(RecordError, match=r"force balance: no sample is left: .* a section further inside"):
        identify(record, verne555, formulation="force-balance", section=(0.0, 1.5))


@pytest.mark.parametrize(("rate", "left"), [(0.1, 4), (1e-6, 1), (4.0, 160)])
def test_a_rate_that_leaves_no_motion_is_refused_at_once(verne555, record, rate, left, monkeypatch):
    # verne555's slowest mode stands at 1.67 Hz: 40 s hold 67 periods of it, and 2.5 rad a sample are 4.3 Hz.
    monkeypatch.setattr(
        "windsysid.identification.formulations.identify_jointly", lambda *_, **__: pytest.fail("went on")
    )
    slowest = verne555.natural_frequency("y") / (2.0 * np.pi)
    with pytest.raises(ConfigurationError, match=rf"rate: {rate:g} Hz would leave {left} samples of 6\d") as error:
        identify(record, verne555, rate=rate)
    assert float(str(error.value).split()[-2]) == pytest.approx(
        2.0 * np.pi * slowest / MAX_RADIANS_PER_READING, rel=5e-3
    )
    assert len(str(error.value)) <= 160
    with pytest.raises(
        ConfigurationError, match=r"would leave 9 samples of 3\.\d+ periods"
    ):  # fewer than twenty readings
        identify(record, verne555, section=(0.0, 1.8), rate=5.0)


def test_no_parameters_are_refused(verne555, record):
    with pytest.raises(ConfigurationError, match="parameters: expected at least one name"):
        identify(record, verne555, parameters=[])
    with pytest.raises(ConfigurationError, match="parameters: expected at least one name"):
        identify_pieces([record], verne555, parameters=[])


def test_a_sampling_rate_that_is_too_low_is_refused(verne555, record):
    # Two and a half readings for each period of 4.02 Hz; spectra take five.
    slow = Record(record.time[::10], record.values[::10], record.channels, record.units, name="slow")
    with pytest.raises(RecordError, match=r"slow: expected at least 10\.1 samples per second .* got 10"):
        identify(slow, verne555)
    with pytest.raises(RecordError, match=r"slow: expected at least 19\.4 samples per second .* got 10"):
        identify(slow, verne555, formulation="spectral")


@pytest.mark.slow
def test_a_record_read_rarely_is_not_made_softer_by_the_steps_of_the_equations(verne555):
    # Twenty readings a second leave (ωh)⁴/60 = 0.04 of the blades' stiffness to the Runge–Kutta method in one step.
    fine = simulate_record(verne555, duration=30.0, rate=400.0, seed=2)
    found = identify(replace(fine, time=fine.time[::20], values=fine.values[::20]), verne555, loads="broadband")
    assert found.rate == pytest.approx(20.0)
    assert only(found.findings, "steps_of_equations").data == {"steps": 5}
    assert len(found.time) == len(found.innovation) == found.samples == 600
    for e in found.estimates:
        assert e.reference is not None
        assert abs(e.estimate - e.reference) < 3.5 * e.std
        assert e.kind != "stiffness" or e.std < 0.03 * e.estimate


@pytest.mark.slow
def test_readings_may_be_fewer_than_the_steps_of_the_equations(verne555):
    # Twenty readings a second of blades that vibrate at 4 Hz are too few for Runge–Kutta, and enough for what the
    # record knows.
    record = simulate_record(verne555, duration=20.0, rate=100.0, seed=2)
    full, found = (identify(record, verne555, rate=rate, loads="broadband") for rate in (None, 20.0))
    assert found.rate == pytest.approx(20.0)
    assert found.loads is not None
    assert found.samples == len(found.time) == len(found.innovation) == len(found.loads.mean) == 400
    assert np.isfinite(found.innovation).all()
    assert notes(found)[0].data["steps"] == 5
    for few, many in zip(found.estimates, full.estimates, strict=True):
        assert abs(few.estimate - many.estimate) < many.std
        assert few.std < 1.3 * many.std


def test_a_mode_that_resampling_takes_out_is_named(verne555, record):
    _, _, (note,) = resample_for_model(record, verne555, 6.0, verne555.sensors)
    assert (note.code, note.data["lost_mode"]) == ("resampled", pytest.approx(4.02, abs=0.005))


def test_a_section_outside_the_record_is_refused(verne555, record):
    with pytest.raises(RecordError, match=r"the section 30 to 50 s reaches outside the record: .* 0 to 39\.99 s"):
        identify(record, verne555, section=(30.0, 50.0))


def test_options_that_do_not_belong_together_are_refused(verne555, record):
    with pytest.raises(ConfigurationError, match="the force balance takes no sensor list"):
        identify(record, verne555, formulation="force-balance", sensors=verne555.sensors)
    with pytest.raises(ConfigurationError, match="expected auto, joint, spectral, force-balance; got 'both'"):
        identify(record, verne555, formulation="both")


def test_the_force_balance_says_that_loads_are_missing(verne555, record):
    result = identify(record, verne555, formulation="force-balance")
    assert [e.name for e in result.estimates] == COEFFICIENTS
    assert only(result.findings, "loads_withheld").data["loads"][:2] == ["load_x", "load_y"]
    assert result["c_x"].estimate < 0.5 * 12.0


# noise on demand


def test_added_noise_is_reproducible_and_leaves_other_channels_alone(record):
    chosen = ["tower_x_acceleration", "blade_2_lag_acceleration"]
    noisy, added = add_noise(record, chosen, 5.0, seed=7)
    again, _ = add_noise(record, chosen, 5.0, seed=7)
    other, _ = add_noise(record, chosen, 5.0, seed=8)
    np.testing.assert_array_equal(noisy.values, again.values)
    for channel in record.channels:
        if channel in chosen:
            difference = noisy[channel] - record[channel]
            assert added[channel] == pytest.approx(0.05 * np.std(record[channel]))
            # 4000 samples: relative standard error of an rms 1/√8000
            assert np.std(difference) == pytest.approx(added[channel], rel=4 / math.sqrt(8000))
            assert abs(np.corrcoef(difference[1:], difference[:-1])[0, 1]) < 4 / math.sqrt(4000)
            assert not np.array_equal(noisy[channel], other[channel])
        else:
            np.testing.assert_array_equal(noisy[channel], record[channel])
    assert noisy.units == record.units


def test_no_noise_is_no_change_and_missing_stays_missing(record):
    holed = record.with_channels({"tower_x_acceleration": (np.where(record.time < 1.0, np.nan, 1.0), "m/s^2")})
    same, added = add_noise(holed, ["tower_x_acceleration"], 0.0, seed=1)
    np.testing.assert_array_equal(same.values, holed.values)
    assert added == {"tower_x_acceleration": 0.0}
    noisy, _ = add_noise(record, ["tower_x_acceleration"], 10.0, seed=1)
    assert np.isfinite(noisy.values).all()


@pytest.mark.parametrize("percent", [-1.0, float("nan"), float("inf"), 1e4])
def test_absurd_noise_is_refused(record, percent):
    with pytest.raises(ConfigurationError, match="added noise: expected a percentage between 0 and 1000"):
        add_noise(record, ["tower_x_acceleration"], percent, seed=0)


def test_sensors_are_told_of_the_added_noise(verne555):
    told = with_noise(verne555.sensors, {"tower_x_acceleration": 0.12})
    assert told[0].noise == pytest.approx(math.hypot(verne555.sensors[0].noise, 0.12))
    assert told[1:] == verne555.sensors[1:]


# a record that somebody else's program wrote

KNOWN_MODES = {  # ../shared/data/README.md: frequency [Hz] of the minimal model at 12.1 rpm
    "tower x": 0.3155, "lag backward": 0.8955, "lag collective": 1.1112, "lag forward": 1.3052
}  # fmt: skip


@pytest.fixture(scope="module")
def openfast() -> tuple[Turbine, Record, tuple[Sensor, ...]]:
    turbine = load_turbine("nrel5mw").exact()  # the simulation's masses and readings are exact
    record = read_record(DECAY)
    sensors = usable_sensors(record, turbine, None)
    noisy, added = add_noise(record, [sensor.channel for sensor in sensors], 1.0, seed=1)
    return turbine, noisy, with_noise(sensors, added)


@pytest.mark.slow
@needs_decay
@pytest.mark.parametrize(("scale", "section"), [(1.3, (0.0, 100.0)), (0.7, None), (1.3, None)])
def test_openfasts_free_decay_is_identified_from_real_sensors(openfast, scale, section):
    turbine, record, sensors = openfast
    result = identify(record, turbine, sensors=sensors, section=section, prior=Prior(scale, scale))

    assert set(result.sensors) == {"tower_x_acceleration", *(f"blade_{i}_tip_lag_acceleration" for i in (1, 2, 3))}
    for forbidden in ("displacement", "deflection", "kinematic", "Q_", "QD_", "velocity", "moment"):
        assert not any(forbidden in channel for channel in (*result.sensors, *result.readings))

    assert result["k_x"].estimate == pytest.approx(1_773_892.0, rel=0.01)
    assert result["c_x"].estimate == pytest.approx(6283.98, rel=0.10)
    for i in (1, 2, 3):
        k, c = result[f"k_beta_{i}"].tip, result[f"c_beta_{i}"].tip
        assert k is not None
        assert c is not None
        assert k["estimate"] == pytest.approx(66_822.1, rel=0.01)
        assert c["estimate"] == pytest.approx(93.37, rel=0.10)
    frequencies = {mode.name: mode.frequency.estimate for mode in result.modes}
    assert frequencies == pytest.approx(KNOWN_MODES, rel=0.005)
    dampings = {mode.name: 100 * mode.damping_ratio.estimate for mode in result.modes}
    known = {"tower x": 0.349, "lag backward": 0.582, "lag collective": 0.482, "lag forward": 0.404}
    assert dampings == pytest.approx(known, rel=0.10)


@pytest.fixture(scope="module")
def minute(verne555: Turbine) -> Record:
    return simulate_record(verne555, duration=60.0, rate=100.0, seed=8)


@pytest.mark.slow
def test_auto_goes_by_filters_and_holds_them_against_spectra(verne555, minute):
    record = minute
    found = identify(record, verne555, formulation="auto")
    assert found.formulation == "joint"
    assert found.diagnosis.trusted
    assert "joint_agrees" in codes(found.findings)
    assert only(found.findings, "load_model_chosen").data["reason"] == "explains"
    assert len(found.mean) == 1, "the search began where spectra ended, without estimates on line"
    alone = identify(record, verne555)
    assert len(alone.mean) == record.samples
    for one, other in zip(found.estimates, alone.estimates, strict=True):
        assert abs(one.estimate - other.estimate) < 0.02 * other.std, one.name
        assert std_of_model(found, one.name) == pytest.approx(std_of_model(alone, one.name), rel=0.01), one.name
    assert [len(w) for w in (found.innovation, found.innovation_time)] == [record.samples] * 2


@pytest.mark.slow
def test_auto_takes_the_long_way_where_the_load_model_of_spectra_does_not_explain_the_record(
    verne555, minute, monkeypatch
):
    record = minute.section(0.0, 30.0)
    monkeypatch.setattr("windsysid.identification.estimate.time_domain.is_explained", lambda whiteness: False)
    sensors = verne555.sensors
    near = identify_by_spectrum(record, verne555, sensors, Prior())
    assert identify_jointly_from(near, record, verne555, sensors, Prior()) is None
    assert identify_jointly_from(near._replace(hypothesis="rotor-wind"), record, verne555, sensors, Prior()) is None


def test_auto_says_why_spectra_do_not_apply(verne555, record):
    record = record.section(0.0, 8.0)
    values = record.values.copy()
    values[200:400, record.channels.index("tower_x_acceleration")] = np.nan
    found = identify(replace(record, values=values), verne555, formulation="auto", loads="broadband")
    assert found.formulation == "joint"
    assert "missing or faulty samples" in only(found.findings, "joint_as_spectra_do_not_apply").data["error"]


@pytest.mark.slow
def test_auto_trusts_neither_where_filters_and_spectra_disagree(verne555, minute, monkeypatch):
    by_spectrum = identify_by_spectrum

    def off(*asked, **options):
        found = by_spectrum(*asked, **options)
        return found._replace(theta=found.theta + 4.0 * np.sqrt(np.diag(found.cov)))

    monkeypatch.setattr(ways, "identify_by_spectrum", off)
    found = identify(minute, verne555, formulation="auto")
    assert not found.diagnosis.trusted
    assert "formulations_disagree" in codes(reasons(found))


@pytest.fixture(scope="module")
def windy(verne555: Turbine) -> Record:
    return simulate_record(verne555, duration=100.0, rate=100.0, seed=8003, loads="wind")


def test_auto_goes_by_spectra_in_wind(verne555, windy):
    found = identify(windy, verne555, formulation="auto")
    assert found.formulation == "spectral"
    assert "spectral_under_wind" in codes(found.findings)


@pytest.mark.parametrize("code", ["unexplained_power", pytest.param("nonstationary", marks=pytest.mark.slow)])
def test_a_finding_against_spectra_in_wind_starts_no_filters(verne555, windy, monkeypatch, code):
    """Filters with 50 load states took minutes, and nobody trusted their results."""
    by_spectrum, asked = identify_by_spectrum, []

    def doubted(*given, **options):
        data = {"change": 0.05, "channel": "tower_x_acceleration", "ratio": 9.9, "low": 1.0, "high": 2.0}
        return by_spectrum(*given, **options)._replace(doubts=(Finding(code, "reason", data, ("k_x",)),))

    monkeypatch.setattr(ways, "identify_by_spectrum", doubted)
    monkeypatch.setitem(ways._FORMULATIONS, "joint", lambda *given: asked.append(given))
    found = identify(windy, verne555, formulation="auto")
    assert (found.formulation, asked) == ("spectral", [])
    assert code in codes(reasons(found))
    assert {e.grade for e in found.estimates} == {"C"}


def test_long_records_of_slow_machines_are_read_as_often_as_their_equations_need():
    slow, fast = load_turbine("nrel5mw"), load_turbine("verne555")
    assert choose_rate(100.0, 600.0, slow, None) == pytest.approx(22.5, rel=0.05)
    assert choose_rate(100.0, 60.0, slow, None) is None
    assert choose_rate(100.0, math.inf, slow, None) is None
    assert choose_rate(50.0, 600.0, fast, None) is None


def test_auto_is_the_default():
    assert signature(identify_module.identify).parameters["formulation"].default == "auto"


@pytest.fixture(scope="module")
def tower_record() -> Record:
    return simulate_record("tower", duration=600.0, rate=20.0, seed=96_902)


@pytest.mark.slow
def test_auto_goes_by_spectra_where_nothing_turns(tower_record, tmp_path):
    """A saved result of spectra, which have neither loads nor a history, says all that others say."""
    found = identify(tower_record, "tower", formulation="auto")
    assert found.formulation == "spectral"
    assert found.diagnosis.trusted
    assert "spectral_agrees" in codes(found.findings)
    assert {one.group for one in found.tolerances} == {"aerodynamics", "gain", "alignment", "masses"}
    found.save(tmp_path / "spectral")
    filtered = identify(tower_record.section(0.0, 300.0), "tower", loads="broadband")
    other = compare(tmp_path / "spectral", filtered)
    assert min(change.chance for change in other.coefficients) > 0.01
    assert len(find_modes(tmp_path / "spectral").curves) == 2


def test_auto_goes_by_spectra_where_a_resonance_is_narrower_than_a_bin(tower_record):
    found = identify(tower_record.section(0.0, 120.0), "tower", formulation="auto", loads="broadband")
    assert found.formulation == "spectral"
    assert "spectral_agrees" in codes(found.findings)


def test_auto_goes_by_filters_where_spectra_find_damping_below_zero(tower_record, monkeypatch):
    by_spectrum = identify_by_spectrum

    def mirrored(*asked, **options):
        found = by_spectrum(*asked, **options)
        return found._replace(theta=found.theta * np.where(["c_" in q.name for q in found.model.parameters], -1.0, 1.0))

    monkeypatch.setattr(ways, "identify_by_spectrum", mirrored)
    found = identify(tower_record.section(0.0, 120.0), "tower", formulation="auto", loads="broadband")
    assert found.formulation == "joint"
    because = only(found.findings, "joint_as_spectra_are_doubtful").data["because"]
    assert because["code"] == "coefficient_not_positive"
    assert min(mode.damping_ratio.estimate for mode in found.modes) > 0.0


@pytest.mark.parametrize(
    "error",
    [np.linalg.LinAlgError("Singular matrix"), ZeroDivisionError("float division by zero"),
     OverflowError(34, "Numerical result out of range"), FloatingPointError("underflow"),
     ValueError("math domain\nerror")],
)  # fmt: skip
def test_an_error_of_arithmetic_leaves_identify_as_one_line(
    verne555: Turbine, monkeypatch: pytest.MonkeyPatch, error: Exception
):
    def fail(asked: object) -> None:
        raise error

    monkeypatch.setitem(identify_module._BY_FORMULATION, "joint", fail)
    record = simulate_record(verne555, duration=5.0, rate=50.0)
    with pytest.raises(NumericalError) as refused:
        identify_module.identify(record, verne555, formulation="joint")
    text = str(refused.value)
    assert type(error).__name__ in text
    assert "\n" not in text
    assert refused.value.__cause__ is error


def test_what_is_refused_on_purpose_is_not_called_numerical(verne555: Turbine):
    record = simulate_record(verne555, duration=5.0, rate=50.0)
    with pytest.raises(ConfigurationError, match="formulation: expected"):
        identify_module.identify(record, verne555, formulation="best")  # type: ignore[arg-type]
