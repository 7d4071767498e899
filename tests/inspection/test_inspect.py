"""Each fault, put in at a known place, is found there and nowhere else; healthy records raise no alarm."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import windsysid as ws
from windsysid.errors import ConfigurationError
from windsysid.inspection import inspect_record
from windsysid.records.formats import read_record
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
TOWER, BLADE = "tower_x_acceleration", "blade_2_lag_acceleration"

needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="the shared records are not beside the checkout")


@pytest.fixture(scope="module")
def healthy(verne555: Turbine) -> Record:
    return simulate_record(verne555, duration=240.0, rate=50.0, seed=3)


def changed(record: Record, channel: str, values) -> Record:
    return record.with_channels({channel: (values, record.unit(channel))})


def alarms(inspection):
    return [f for f in inspection.findings if f.severity != "note"]


def only_alarm(record: Record, kind: str, channel: str, turbine=None):
    found = alarms(inspect_record(record, turbine))
    assert [(f.kind, f.channel) for f in found] == [(kind, channel)], [f.text for f in found]
    return found[0]


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3, 4))])
@pytest.mark.parametrize("rate", [30.0, 200.0])
def test_a_healthy_simulated_record_raises_no_alarm(verne555, seed, rate):
    inspection = inspect_record(simulate_record(verne555, duration=120.0, rate=rate, seed=seed), verne555)
    assert alarms(inspection) == []
    assert inspection.proposals[0].good


def test_spikes_are_found_where_they_are_and_nowhere_else(healthy):
    values = healthy[TOWER]
    places = {500: 1, 3000: 2, 3050: 1, 9000: 3}
    for i, (start, width) in enumerate(places.items()):
        values[start : start + width] += (-1.0) ** i * 12.0 * values.std()
    found = only_alarm(changed(healthy, TOWER, values), "spikes", TOWER)
    expected = [(healthy.time[k], healthy.time[k + n - 1]) for k, n in places.items()]
    np.testing.assert_allclose(found.spans, expected)
    assert found.count == sum(places.values())


def test_a_spike_of_the_azimuth_is_not_taken_for_its_wrapping(healthy):
    values = healthy["rotor_azimuth"]
    values[4000] = np.mod(values[4000] + 2.0, 2.0 * np.pi)
    found = only_alarm(changed(healthy, "rotor_azimuth", values), "spikes", "rotor_azimuth")
    np.testing.assert_allclose(found.spans, [[healthy.time[4000]] * 2])


def test_two_per_cent_of_spikes_do_not_hide_one_another(healthy):
    values, rng = healthy[TOWER], np.random.default_rng(0)
    places = np.sort(rng.choice(np.arange(10, 11990, 10), 240, replace=False))
    values[places] += 15.0 * values.std()
    found = only_alarm(changed(healthy, TOWER, values), "spikes", TOWER)
    assert found.count == 240


def test_a_strong_once_per_turn_signal_has_no_spikes(verne555):
    """What fools a Hampel filter: at a few samples per turn, every crest stands out from its neighbours' median."""
    time = np.arange(6000) / 20.0
    for per_turn in (5.3, 9.7, 40.0, 400.0):
        swing = 9.81 * np.cos(2.0 * np.pi * 20.0 / per_turn * time) + 0.01 * np.random.default_rng(1).standard_normal(
            6000
        )
        record = Record(time, swing[:, None], ("blade_1_tip_lag_acceleration",), ("m/s^2",))
        assert alarms(inspect_record(record)) == []


def test_a_frozen_stretch_is_found_to_the_sample(healthy):
    values = healthy[BLADE]
    values[2000:2100] = values[2000]
    found = only_alarm(changed(healthy, BLADE, values), "frozen", BLADE)
    np.testing.assert_allclose(found.spans, [[healthy.time[2000], healthy.time[2099]]])


def test_clipping_is_found_at_both_ends(healthy):
    values = healthy[TOWER]
    level = 1.5 * values.std()
    found = only_alarm(changed(healthy, TOWER, np.clip(values, -level, level)), "clipping", TOWER)
    assert found.count == np.sum(np.abs(values) >= level)
    assert found.severity == "unusable"


def test_a_quantised_sinusoid_is_not_clipped(healthy):
    for levels in (10, 100, 1000):
        values = np.round(levels * np.sin(0.37 * healthy.time * 2.0 * np.pi)) / levels
        assert alarms(inspect_record(changed(healthy, TOWER, values))) == []


def test_missing_samples_are_counted_in_their_places(healthy):
    values = healthy[BLADE]
    values[1000:1200] = np.nan
    values[5000] = np.nan
    found = only_alarm(changed(healthy, BLADE, values), "missing", BLADE)
    assert found.count == 201
    np.testing.assert_allclose(found.spans, healthy.time[[[1000, 1199], [5000, 5000]]])


def test_a_mostly_missing_and_a_dead_channel_are_unusable(healthy):
    values = healthy[BLADE]
    values[:8000] = np.nan
    assert only_alarm(changed(healthy, BLADE, values), "missing", BLADE).severity == "unusable"
    assert only_alarm(changed(healthy, BLADE, np.full(12000, 0.3)), "constant", BLADE).severity == "unusable"
    assert only_alarm(changed(healthy, BLADE, np.full(12000, np.nan)), "missing", BLADE).severity == "unusable"


def test_a_slower_logger_is_not_called_missing(healthy):
    values = np.where(np.arange(12000) % 10 == 0, healthy[BLADE], np.nan)
    inspection = inspect_record(changed(healthy, BLADE, values))
    assert alarms(inspection) == []
    assert [f.kind for f in inspection.of(BLADE)] == ["slower rate"]


def test_gaps_are_found_with_what_they_lost(healthy):
    keep = np.ones(12000, dtype=bool)
    keep[3000:3050] = keep[7000] = False
    record = replace(healthy, time=healthy.time[keep], values=healthy.values[keep])
    found = only_alarm(record, "gaps", "")
    assert found.count == 51
    np.testing.assert_allclose(found.spans, healthy.time[[[2999, 3050], [6999, 7001]]])


def test_irregular_steps_are_a_warning_and_rounded_stamps_are_not(healthy):
    rng = np.random.default_rng(2)
    jittered = replace(healthy, time=healthy.time + rng.uniform(-0.006, 0.006, 12000))
    found = only_alarm(jittered, "irregular sampling", "")
    assert found.count > 1000
    assert "smoother on a regular grid" in found.text
    assert alarms(inspect_record(replace(healthy, time=np.round(healthy.time, 3)))) == []


def test_rows_written_twice_are_found(healthy):
    values = healthy.values.copy()
    values[[400, 8000]] = values[[399, 7999]]
    found = only_alarm(replace(healthy, values=values), "repeated rows", "")
    np.testing.assert_allclose(found.spans[:, 0], healthy.time[[400, 8000]])


def test_a_converter_that_sees_no_motion_is_told(healthy):
    values = healthy[TOWER]
    step = values.std() / 1.2
    assert only_alarm(changed(healthy, TOWER, step * np.round(values / step)), "coarse steps", TOWER)
    fine = values.std() / 100.0
    assert alarms(inspect_record(changed(healthy, TOWER, fine * np.round(values / fine)))) == []


@pytest.mark.parametrize(
    ("channel", "wrong", "kind", "on", "said"),
    [
        (TOWER, lambda r: 1.0 + r[TOWER] / 98.0665, "unit", TOWER, "g marked as m/s²"),
        (TOWER, lambda r: 1000.0 * r[TOWER], "unit", TOWER, "raw counts"),
        ("rotor_speed", lambda r: r["rotor_speed"] * 30.0 / np.pi, "contradiction", "rotor_azimuth",
        "rpm marked as rad/s"),
        ("rotor_speed", lambda r: r["rotor_speed"] * 1.1, "contradiction", "rotor_azimuth", "1.1 times as fast"),
        ("rotor_azimuth", lambda r: np.degrees(r["rotor_azimuth"]), "unit", "rotor_azimuth", "degrees marked as rad"),
        ("rotor_azimuth", lambda r: r["rotor_azimuth"] / (2.0 * np.pi), "unit", "rotor_azimuth", "turns marked as rad"),
        ("rotor_azimuth", lambda r: 2.0 * np.pi - r["rotor_azimuth"], "contradiction", "rotor_azimuth",
        "runs backwards"),
    ],
)  # fmt: skip
def test_a_unit_that_cannot_be_right_is_named(healthy, verne555, channel, wrong, kind, on, said):
    assert said in only_alarm(changed(healthy, channel, wrong(healthy)), kind, on, verne555).text


def test_rpm_marked_as_rad_is_seen_from_the_turbine_alone(healthy, verne555):
    record = changed(healthy, "rotor_speed", healthy["rotor_speed"] * 30.0 / np.pi)
    record = record.select([name for name in record.channels if name != "rotor_azimuth"])
    assert "rpm marked as rad/s" in only_alarm(record, "unit", "rotor_speed", verne555).text
    assert inspect_record(record, verne555).verdict.endswith("; correct units first, then use all of it")


def test_a_direction_in_degrees_is_named(healthy):
    direction = np.mod(350.0 + 15.0 * np.sin(0.05 * healthy.time), 360.0)
    record = healthy.with_channels({"wind_direction": (direction, "rad")})
    assert "degrees" in only_alarm(record, "unit", "wind_direction").text
    record = healthy.with_channels({"wind_direction": (direction, "deg")})
    assert alarms(inspect_record(record)) == []


def test_a_slipped_encoder_is_found_where_it_slipped(healthy):
    psi = healthy["rotor_azimuth"]
    psi[6000:] = np.mod(psi[6000:] + 0.8, 2.0 * np.pi)
    found = only_alarm(changed(healthy, "rotor_azimuth", psi), "azimuth jumps", "rotor_azimuth")
    np.testing.assert_allclose(found.spans, healthy.time[[[5999, 6000]]])


def test_a_code_for_no_reading_is_no_reading(healthy):
    values = healthy[TOWER]
    values[500:508] = values[9000:9006] = -999.0
    found = only_alarm(changed(healthy, TOWER, values), "frozen", TOWER)
    np.testing.assert_allclose(found.spans[:, 0], healthy.time[[500, 9000]])
    assert found.count == 14


@pytest.mark.parametrize("at", [0, -1])
def test_a_spike_at_an_end_is_found(healthy, at):
    values = healthy[TOWER]
    values[at] += 15.0 * values.std()
    np.testing.assert_allclose(
        only_alarm(changed(healthy, TOWER, values), "spikes", TOWER).spans, [[healthy.time[at]] * 2]
    )


def test_an_azimuth_that_scatters_is_told_by_how_much(healthy):
    noise = np.radians(2.0) * np.random.default_rng(5).standard_normal(12000)
    psi = np.mod(healthy["rotor_azimuth"] + noise, 2.0 * np.pi)
    assert (
        "scatters by 2°" in only_alarm(changed(healthy, "rotor_azimuth", psi), "azimuth scatter", "rotor_azimuth").text
    )


def test_peaks_are_named_after_harmonics_and_modes(healthy, verne555):
    time, once = healthy.time, healthy["rotor_speed"].mean() / (2.0 * np.pi)
    inspection = inspect_record(healthy, verne555)
    mode = inspection.modes[0][1]
    rng = np.random.default_rng(4)
    sum_of_three = (
        np.sin(2.0 * np.pi * 3.0 * once * time) + np.sin(2.0 * np.pi * mode * time)
        + np.sin(2.0 * np.pi * 9.3 * time) + 0.1 * rng.standard_normal(time.size)
    )  # fmt: skip
    spectrum = next(
        s for s in inspect_record(changed(healthy, TOWER, sum_of_three), verne555).spectra if s.channel == TOWER
    )
    peaks = sorted(spectrum.peaks, key=lambda peak: peak.frequency)
    assert len(peaks) == 3  # a wrong threshold finds peaks in the noise
    for peak, frequency in zip(peaks, sorted((3.0 * once, mode, 9.3)), strict=True):
        assert abs(peak.frequency - frequency) < spectrum.resolution / 2.0
        assert peak.rms == pytest.approx(np.sqrt(0.5), rel=0.05)
        expected = {3.0 * once: "3P", mode: inspection.modes[0][0]}.get(frequency)
        assert expected in peak.matches if expected else peak.matches == ()


def test_a_well_damped_mode_is_found_though_its_peak_is_broad(healthy, verne555):
    spectrum = next(s for s in inspect_record(healthy, verne555).spectra if s.channel == TOWER)
    found = [peak.matches[0].split(" ")[0:2] for peak in spectrum.peaks if peak.matches]
    assert ["tower", "x"] in found
    assert ["lag", "forward"] in found


def test_white_noise_has_no_peaks(healthy, verne555):
    for seed in range(3):
        noise = np.random.default_rng(seed).standard_normal(12000)
        inspection = inspect_record(changed(healthy, TOWER, noise), verne555)
        assert next(s for s in inspection.spectra if s.channel == TOWER).peaks == ()


def test_a_blade_sees_whirling_modes_shifted_by_one_turn(healthy, verne555):
    inspection = inspect_record(healthy, verne555)
    once = verne555.rotor_speed / (2.0 * np.pi)
    modes = {name: frequency for name, frequency, _ in inspection.modes}
    blade = {line.name: line.frequency for line in inspection.spectra[-1].lines if line.mode}
    tower = {line.name: line.frequency for line in inspection.spectra[0].lines if line.mode}
    assert tower == pytest.approx(modes)
    assert blade["lag backward"] == pytest.approx(modes["lag backward"] + once)
    assert blade["lag forward"] == pytest.approx(abs(modes["lag forward"] - once))
    # Free blades on a stiff support have one frequency, whichever way they whirl.
    assert blade["lag collective"] == pytest.approx(modes["lag collective"])


def test_the_steady_fault_free_and_lively_part_is_proposed(healthy):
    time = healthy.time
    speed = healthy["rotor_speed"] * (1.0 + np.where(time < 60.0, 0.2 * np.sin(0.3 * time), 0.002 * np.sin(time)))
    values = np.where(time > 190.0, 0.02, 1.0) * healthy[TOWER]
    values[6000:6400] = values[6000]  # 120 to 128 s
    record = changed(changed(healthy, "rotor_speed", speed), TOWER, values)
    record = record.select(["rotor_speed", TOWER])
    inspection = inspect_record(record, section_length=50.0)
    best = inspection.proposals[0]
    assert best.good
    assert (best.start >= 60.0 and best.end <= 121.0) or (best.start >= 127.0 and best.end <= 192.0)
    assert "no gaps or faults" in best.reasons
    for a, b in zip(*(sorted(inspection.proposals, key=lambda p: p.start)[k:] for k in (0, 1)), strict=False):
        assert a.end <= b.start + 1e-9


@pytest.mark.slow
def test_a_record_that_oma_calls_a_transient_is_proposed_without_its_start():
    record = ws.simulate("tower", duration=400.0, rate=10.0, seed=4)
    for channel in ("tower_x_acceleration", "tower_z_acceleration"):
        start = np.exp(-record.time / 2.0) * np.sin(12.0 * record.time) * 60.0 * np.std(record[channel])
        record = changed(record, channel, record[channel] + start)
    found = inspect_record(record)
    assert any("an eighth of it has" in doubt for doubt in ws.oma(record).doubts)
    best = found.proposals[0]
    assert best.good
    assert best.start >= 5.0
    assert best.end - best.start >= 300.0
    assert not any("an eighth of it has" in doubt for doubt in ws.oma(record.section(best.start, best.end)).doubts)


def test_the_longest_steady_part_is_proposed_and_a_steady_record_is_used_whole(healthy):
    whole = inspect_record(healthy)
    assert whole.verdict.endswith("; use all of it")
    assert len(whole.proposals) == 1
    time = healthy.time
    wander = np.where(time < 60.0, 0.2 * np.sin(0.3 * time), 0.002 * np.sin(time))
    speed = healthy["rotor_speed"] * (1.0 + wander)
    best = inspect_record(changed(healthy, "rotor_speed", speed).select(["rotor_speed", TOWER])).proposals[0]
    assert best.good
    assert best.start >= 55.0
    assert best.end - best.start == pytest.approx(180.0, abs=0.1)


def test_a_wind_that_turns_is_avoided_and_said(healthy):
    time = healthy.time
    direction = np.where((time > 100.0) & (time < 160.0), 40.0 * np.sin(0.1 * time), 2.0 * np.sin(0.05 * time))
    wind = 8.0 + 0.5 * np.sin(0.7 * time)
    record = healthy.with_channels({"wind_direction": (direction, "deg"), "wind_speed": (wind, "m/s")})
    best = inspect_record(record, section_length=80.0).proposals[0]
    assert best.end <= 101.0 or best.start >= 158.0
    assert any("wind 8" in reason for reason in best.reasons)


def test_no_section_is_good_where_the_rotor_never_settles(healthy):
    speed = healthy["rotor_speed"] * (1.0 + 0.3 * np.sin(0.1 * healthy.time))
    record = changed(healthy, "rotor_speed", speed).select(["rotor_speed", TOWER])
    inspection = inspect_record(record)
    assert not any(p.good for p in inspection.proposals)
    assert "no section is good" in inspection.verdict
    assert "rotor speed" in inspection.proposals[0].against[0]
    assert inspection.spectrograms[0].against == "rotor speed"


def test_results_are_saved_whole(healthy, verne555, tmp_path):
    values = healthy[TOWER]
    values[500] += 50.0
    inspection = inspect_record(changed(healthy, TOWER, values), verne555)
    inspection.save(tmp_path)
    assert {p.name for p in tmp_path.glob("[!.]*")} == {"inspection.json", "report.html"}
    summary = json.loads((tmp_path / "inspection.json").read_text(encoding="utf-8"))
    assert summary["findings"][0]["spans_s"] == [[10.0, 10.0]]
    assert summary["sections"][0]["good"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count('<figure class="plot">') > 2
    assert '"cells":{' in page
    assert "spike" in page
    assert "spike" in str(inspection)


@pytest.mark.parametrize("samples", [2, 3, 10, 40])
def test_the_shortest_records_are_told_about_not_stumbled_over(healthy, tmp_path, samples):
    record = replace(healthy, time=healthy.time[:samples], values=healthy.values[:samples])
    inspection = inspect_record(record)
    inspection.save(tmp_path)
    assert str(inspection)


def test_a_record_of_nothing_but_nan_is_told_about(healthy, tmp_path):
    inspection = inspect_record(replace(healthy, values=np.full_like(healthy.values, np.nan)))
    assert {f.severity for f in inspection.findings} == {"unusable"}
    inspection.save(tmp_path)


def test_a_section_needs_a_length(healthy):
    with pytest.raises(ConfigurationError, match="section_length: expected a positive time"):
        inspect_record(healthy, section_length=0.0)


@pytest.mark.slow
@needs_shared
@pytest.mark.parametrize("name", ["c2_turb12_full", "d1_turb12_full_KSS090"])
def test_an_independent_turbulent_simulation_raises_no_alarm(name):
    pytest.importorskip("openfast_io", reason="reading OpenFAST files needs openfast_io")
    inspection = inspect_record(read_record(SHARED / "openfast" / f"{name}.outb"), load_turbine("nrel5mw"))
    assert alarms(inspection) == []
    peaks = inspection.spectra[0].peaks
    frequency = {"c2_turb12_full": 0.3153, "d1_turb12_full_KSS090": 0.2986}[name]
    assert abs(peaks[0].frequency - frequency) < 0.003


@needs_shared
@pytest.mark.slow
def test_a_locked_motion_of_the_simulator_is_the_only_complaint():
    pytest.importorskip("openfast_io", reason="reading OpenFAST files needs openfast_io")
    inspection = inspect_record(read_record(SHARED / "openfast" / "a2_rot12_decay_min.outb"), load_turbine("nrel5mw"))
    assert {(f.kind, f.channel) for f in alarms(inspection)} == {
        ("constant", f"tower_z_{name}")
        for name in ("displacement", "velocity", "acceleration_kinematic", "acceleration")
    }


@needs_shared
def test_measured_records_raise_no_alarm():
    operation = inspect_record(read_record(SHARED / "bjorko" / "operation_20210707_20Hz.csv"))
    assert alarms(operation) == []
    assert not operation.proposals[0].good  # nothing in it vibrates
    assert operation.spectrograms[0].against == "rotor speed"
    release = inspect_record(read_record(SHARED / "bjorko" / "pull_release_10Hz.csv"))
    assert alarms(release) == []
    assert abs(release.spectra[0].peaks[0].frequency - 0.835) < 0.02


@pytest.mark.parametrize("samples", [2, 3, 6, 19])
def test_a_record_of_a_few_samples_is_said_to_be_too_short_and_has_no_good_section(samples):
    values = np.random.default_rng(samples).standard_normal((samples, 1))
    found = inspect_record(Record(0.05 * np.arange(samples), values, ("tower_x_acceleration",), ("m/s^2",)))
    assert found.findings[0].text.startswith(f"has {samples} samples: identify needs at least 20, oma 256")
    assert (found.findings[0].severity, found.proposals) == ("unusable", ())
    assert "no section is good" in found.verdict


def with_lost_samples(how, seed=0):
    """600 s at 20 Hz of two modes of a tower, of which one sample in ten was lost, and the times say so."""
    rng = np.random.default_rng(seed)
    time = 0.05 * np.arange(12_000)
    kernel = np.exp(-0.02 * 2.0 * time[:2000]) * np.sin(2.0 * time[:2000])
    values = np.convolve(rng.standard_normal(14_000), kernel, "same")[1000:13_000]
    kept = {"random": rng.random(time.size) > 0.1, "periodic": np.arange(time.size) % 10 != 7}[how]
    channels = ("rotor_speed", "tower_x_acceleration")
    table = np.column_stack(
        [1.26 + 0.001 * rng.standard_normal(time.size), values + 0.1 * rng.standard_normal(time.size)]
    )
    return Record(time[kept], table[kept], channels, ("rad/s", "m/s^2"))


@pytest.mark.parametrize("how", ["random", "periodic"])
def test_short_gaps_everywhere_leave_a_record_usable_and_are_said(how):
    found = inspect_record(with_lost_samples(how))
    (gaps,) = [finding for finding in found.findings if finding.kind == "short gaps"]
    assert "(10 %)" in gaps.text
    assert gaps.severity == "warning"
    assert found.verdict.endswith("use all of it")


def test_a_long_gap_among_short_ones_is_named_with_its_place():
    record = with_lost_samples("random")
    keep = (record.time < 100.0) | (record.time > 107.0)
    found = inspect_record(replace(record, time=record.time[keep], values=record.values[keep]))
    (gap,) = [finding for finding in found.findings if finding.kind == "gaps"]
    assert gap.text.startswith("1 gap in the time, the longest 7")
