import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, sosfiltfilt

import windsysid as ws
from windsysid.simulation.record import simulate_record
from windsysid.spectral.modal_bands.peak_bands import Peak
from windsysid.spectral.oma.condition import prepare_readings, transforms
from windsysid.spectral.oma.search import RecordSpectrum, fit_between, search_again
from windsysid.spectral.oma.sensors import choose_sensors
from windsysid.spectral.transforms.harmonics import find_lines
from windsysid.spectral.transforms.multiblade import multiblade

from .oscillators import modal_responses

RATE = 10.0
SHAPES = np.array([[1.0, 0.9], [0.7, -0.4], [0.3, -1.0]])


def record_of(values, rate, names=None, start=0.0, unit="m"):
    names = names or tuple(f"floor_{i}_displacement" for i in range(1, values.shape[1] + 1))
    return ws.Record(
        start + np.arange(len(values)) / rate, values, tuple(names), (unit,) * values.shape[1], name="made up"
    )


def two_modes(seed, samples=6000, rate=RATE, noise=0.05):
    rng = np.random.default_rng(seed)
    q, _ = modal_responses([1.1, 2.7], [0.012, 0.008], rate, samples, rng)
    y = (q / q.std(axis=0)) @ SHAPES.T
    return y + noise * rng.normal(size=y.shape)


def test_two_modes_are_found_with_shapes_and_trusted():
    found = ws.oma(record_of(two_modes(0), RATE))
    assert [round(mode.frequency.estimate, 1) for mode in found.modes] == [1.1, 2.7]
    assert found.trusted, found.reasons
    for mode, f, z, shape in zip(found.modes, (1.1, 2.7), (0.012, 0.008), SHAPES.T, strict=True):
        assert abs(mode.frequency.estimate - f) < 3.0 * mode.frequency.std
        assert abs(np.log(mode.damping_ratio.estimate / z)) < 3.0 * mode.damping_ratio.relative_std
        scaled = shape / shape[np.argmax(np.abs(mode.shape))]
        assert np.all(np.abs(mode.shape.real - scaled) < 4.0 * mode.shape_std + 1e-9)
        assert mode.complexity < 0.01


def test_uncertainty_follows_the_laws_of_au():
    # Au, Operational Modal Analysis, Springer 2017: c_f² = ζ/(2π N_c B_f), c_ζ² = 1/(2π ζ N_c B_ζ) for a band of f (1 ±
    # κζ), where the load is known to be white; with an unknown slope of its spectrum σ is larger, by a third at most
    rng = np.random.default_rng(5)
    f, z, rate, samples, kappa = 1.0, 0.01, 8.0, 16_000, 10.0
    q, _ = modal_responses([f], [z], rate, samples, rng)
    y = q / q.std() * np.array([1.0, 0.6]) + 0.01 * rng.normal(size=(samples, 2))
    found = ws.oma(record_of(y, rate), bands=[(f * (1 - kappa * z), f * (1 + kappa * z))]).modes[0]
    cycles = f * samples / rate
    b_f = 2 / np.pi * (np.arctan(kappa) - kappa / (kappa**2 + 1))
    b_z = 2 / np.pi * (np.arctan(kappa) + kappa / (kappa**2 + 1) - 2 * np.arctan(kappa) ** 2 / kappa)
    law_f = np.sqrt(found.damping_ratio.estimate / (2 * np.pi * cycles * b_f))
    law_z = 1 / np.sqrt(2 * np.pi * found.damping_ratio.estimate * cycles * b_z)
    assert law_f < found.frequency.relative_std / found.widening[0] < 4 / 3 * law_f
    assert law_z < found.damping_ratio.relative_std / found.widening[1] < 4 / 3 * law_z


@pytest.mark.slow
def test_close_modes_are_told_apart():
    rng = np.random.default_rng(6)
    q, _ = modal_responses([0.98, 1.0, 1.02], [0.008, 0.01, 0.012], 8.0, 24_000, rng)
    shapes = np.array([[1.0, 1.0, 1.0], [0.3, -1.0, 0.8], [-1.0, 0.2, 0.9], [0.5, 0.7, -1.0]])
    y = (q / q.std(axis=0)) @ shapes.T + 0.05 * rng.normal(size=(24_000, 4))
    found = ws.oma(record_of(y, 8.0))
    assert len(found.modes) == 3
    for mode, f in zip(found.modes, (0.98, 1.0, 1.02), strict=True):
        assert abs(mode.frequency.estimate - f) < 3.5 * mode.frequency.std


def test_a_quiet_mode_beside_a_loud_ones_flank_is_looked_for_again():
    """A search for one mode in a band of two finds the loud one; the peak of the other is not forgotten."""
    rng = np.random.default_rng(4)
    q, _ = modal_responses([0.89, 1.04], [0.012, 0.008], 8.0, 4320, rng)
    q /= q.std(axis=0)
    y = np.column_stack([q[:, 1], 0.4 * q[:, 1] + 0.15 * q[:, 0]]) + 0.02 * rng.normal(size=q.shape)
    readings = prepare_readings(record_of(y, 8.0), None)
    spectrum = RecordSpectrum(readings, *transforms(readings))
    first = fit_between(spectrum, (0.75, 1.07), 1, 1)
    assert first is not None
    assert first.fit.modes.frequency == pytest.approx([1.04], abs=0.01)
    again = search_again(spectrum, [first], [Peak(0.89, 0.015, 6.0)], keep=False)
    found = sorted(float(f) for one in again for f in one.fit.modes.frequency)
    assert found == pytest.approx([0.89, 1.04], abs=0.01)


def test_one_sensor_will_do_and_its_kind_does_not_matter():
    rng = np.random.default_rng(7)
    q, v = modal_responses([1.1], [0.012], RATE, 6000, rng)
    sway = ws.oma(record_of(q, RATE, ("crane_displacement",)), bands=[(0.9, 1.3)]).modes[0]
    speed = ws.oma(record_of(v, RATE, ("crane_velocity",), unit="m/s"), bands=[(0.9, 1.3)]).modes[0]
    assert abs(sway.frequency.estimate - 1.1) < 3.0 * sway.frequency.std
    assert speed.frequency.estimate == pytest.approx(sway.frequency.estimate, rel=2e-4)
    assert speed.damping_ratio.estimate == pytest.approx(sway.damping_ratio.estimate, rel=0.02)


def test_a_band_without_a_mode_says_so_and_is_not_trusted():
    found = ws.oma(record_of(two_modes(8), RATE), bands=[(3.9, 4.6)])
    assert not found.modes
    assert not found.trusted
    assert "no mode stands out between 3.9 and 4.6 Hz" in found.reasons


def test_copies_are_refused_where_they_were_asked_for_and_left_out_elsewhere():
    y = two_modes(9)
    record = record_of(np.column_stack([y, -2.5 * y[:, 0]]), RATE)
    with pytest.raises(ws.RecordError, match="'floor_4_displacement' is a copy of 'floor_1_displacement': leave one"):
        ws.oma(record, sensors=list(record.channels))
    found = ws.oma(record)
    assert "floor_4_displacement is a copy of floor_1_displacement and is left out" in found.notes
    assert len(found.channels) == 3


def test_a_machines_line_is_taken_out_and_said():
    y = two_modes(10)
    time = np.arange(len(y)) / RATE
    y = y + 0.5 * np.sin(2.0 * np.pi * 4.1237 * time + 0.3)[:, None]
    found = ws.oma(record_of(y, RATE))
    assert [round(f, 3) for _, f in found.lines] == [4.124]
    assert [round(mode.frequency.estimate, 1) for mode in found.modes] == [1.1, 2.7]


def test_a_line_exactly_on_a_mode_is_never_trusted():
    y = two_modes(11)
    time = np.arange(len(y)) / RATE
    y = y + 2.0 * np.sin(2.0 * np.pi * 2.7 * time)[:, None] * SHAPES[:, 1]
    found = ws.oma(record_of(y, RATE))
    doubted = [mode for mode in found.modes if abs(mode.frequency.estimate - 2.7) < 0.1]
    assert doubted
    assert not any(mode.trusted for mode in doubted)
    assert any("a steady line at 2.7 Hz stands on it" in reason for reason in found.reasons)


def test_random_vibration_has_no_lines():
    assert find_lines(two_modes(12), RATE, 0.1, 9.0) == []


def test_a_free_decay_is_a_transient_and_not_trusted():
    rng = np.random.default_rng(13)
    time = np.arange(3000) / RATE
    decay = np.exp(-0.012 * 2 * np.pi * 1.1 * time) * np.cos(2 * np.pi * 1.1 * time)
    y = decay[:, None] * np.array([1.0, 0.7]) + 1e-3 * rng.normal(size=(3000, 2))
    found = ws.oma(record_of(y, RATE))
    assert not found.trusted
    assert any("transient" in reason for reason in found.reasons)


def test_clipped_channels_are_said_and_not_trusted():
    y = two_modes(14)
    y[:, 0] = np.clip(y[:, 0], -1.0, 1.0)
    found = ws.oma(record_of(y, RATE))
    assert not found.trusted
    assert any("clipping" in reason for reason in found.reasons)
    assert not any(mode.trusted for mode in found.modes)
    assert not any(mode["trusted"] for mode in found.summary()["modes"])


def test_a_short_record_is_not_trusted_or_refused():
    y = two_modes(15)
    found = ws.oma(record_of(y[:300], RATE), bands=[(0.7, 1.6)])  # 33 cycles of the first mode
    assert not found.trusted
    with pytest.raises(ws.RecordError, match="200 samples are too few"):
        ws.oma(record_of(y[:200], RATE))


def test_missing_samples_are_bridged_or_avoided():
    y = two_modes(16, samples=4000)
    y[2500:2506] = np.nan
    assert any("filled from the readings around" in note for note in prepare_readings(record_of(y, RATE), None).notes)
    y[2500:2520] = np.nan
    assert any("bridged" in note for note in ws.oma(record_of(y, RATE)).notes)
    y[1500:2500, 0] = np.nan
    assert any("without gaps" in note for note in ws.oma(record_of(y, RATE)).notes)


@pytest.mark.parametrize("how", ["random", pytest.param("periodic", marks=pytest.mark.slow)])
def test_one_sample_in_ten_lost_at_known_times_changes_no_mode(how):
    y = two_modes(17)
    whole = record_of(y, RATE)
    rng = np.random.default_rng(3)
    kept = {"random": rng.random(len(y)) > 0.1, "periodic": np.arange(len(y)) % 10 != 7}[how]
    lost = replace(whole, time=whole.time[kept], values=whole.values[kept])
    found, expected = (ws.oma(one, bands=[(0.7, 1.6)]) for one in (lost, whole))
    assert any("missing in short gaps" in note for note in found.notes)
    for mode, other in zip(found.modes, expected.modes, strict=True):
        assert mode.frequency.estimate == pytest.approx(other.frequency.estimate, rel=1e-3)
        assert mode.damping_ratio.estimate == pytest.approx(other.damping_ratio.estimate, rel=0.1)


@pytest.mark.parametrize("measured", [True, False])
def test_an_acceleration_without_gravity_is_taken_where_the_measured_one_is_not_there(measured):
    y = two_modes(18)[:, :2]
    names = ("nacelle_x_acceleration_kinematic", "nacelle_x_acceleration" if measured else "nacelle_z_acceleration")
    record = ws.Record(np.arange(len(y)) / RATE, y, names, ("m/s^2",) * 2)
    chosen = [sensor.channel for sensor in choose_sensors(record, None)[0]]
    assert chosen == ([names[1]] if measured else list(names))


def whirling(seed, once=0.2, samples=6000):
    """Readings on three blades of waves that turn with the rotor or against it, 1.3 and 0.9 Hz in the fixed frame, what
    the tower feels of them, the azimuth, and both waves."""
    from scipy.signal import hilbert

    rng = np.random.default_rng(seed)
    q, _ = modal_responses([1.3, 0.9], [0.01, 0.01], RATE, samples, rng)
    q /= q.std(axis=0)
    psi = 2.0 * np.pi * once * np.arange(samples) / RATE + 0.4
    forward, backward = hilbert(q[:, 0]), hilbert(q[:, 1]).conj()
    blades = np.column_stack(
        [(0.5 * (forward + backward) * np.exp(-1j * (psi + 2 * np.pi * b / 3))).real for b in range(3)]
    )  # z = 2/3 Σ y_b e^{iψ_b}
    tower = q.sum(axis=1) + 0.05 * rng.normal(size=samples)
    return blades + 0.02 * rng.normal(size=blades.shape), tower, psi, 0.5 * (forward + backward)


LAG = tuple(f"blade_{b}_tip_lag_acceleration" for b in (1, 2, 3))


def turning(columns):
    """A record of named accelerations, and of the rotor's azimuth and speed."""
    units = tuple({"rotor_azimuth": "rad", "rotor_speed": "rad/s"}.get(name, "m/s^2") for name in columns)
    values = np.column_stack(list(columns.values()))
    return ws.Record(np.arange(len(values)) / RATE, values, tuple(columns), units, name="rotor")


def test_whirls_are_named_and_signed():
    blades, _, psi, wave = whirling(17)
    found = ws.oma(turning({**dict(zip(LAG, blades.T, strict=True)), "rotor_azimuth": np.mod(psi, 2 * np.pi)}))
    assert [(mode.name, round(mode.frequency.estimate, 1)) for mode in found.modes] == [
        ("lag backward", 0.9),
        ("lag forward", 1.3),
    ]
    clean = np.column_stack([(wave * np.exp(-1j * (psi + 2 * np.pi * b / 3))).real for b in range(3)])
    a0, z = multiblade(clean, np.asarray(psi, dtype=np.float64))
    np.testing.assert_allclose(a0, 0.0, atol=1e-12)
    np.testing.assert_allclose(z, wave, atol=1e-9)


@pytest.mark.slow
def test_blades_without_azimuth_or_without_one_of_them_are_left_out():
    blades, tower, psi, _ = whirling(40)
    of_blades = dict(zip(LAG, blades.T, strict=True))
    azimuth, speed = np.mod(psi, 2 * np.pi), np.full(len(psi), 0.4 * np.pi)
    for columns, why in (
        ({**of_blades, "tower_x_acceleration": tower, "rotor_speed": speed}, "rotor_azimuth is missing"),
        (
            {name: of_blades[name] for name in LAG[:2]} | {"tower_x_acceleration": tower, "rotor_azimuth": azimuth},
            "left out",
        ),
    ):
        found = ws.oma(turning(columns))
        assert found.channels == ("tower_x_acceleration",)
        assert any(why in note for note in found.notes)
        assert [round(mode.frequency.estimate, 1) for mode in found.modes] == [0.9, 1.3]
        del columns["tower_x_acceleration"]
        with pytest.raises(ws.RecordError, match="no channel is left"):
            ws.oma(turning(columns))


def test_a_harmonic_exactly_on_a_mode_is_never_trusted():
    y = two_modes(41)
    speed = np.full(len(y), 2.0 * np.pi * 0.9)
    columns = {f"tower_{way}_acceleration": y[:, i] for i, way in enumerate("xyz")}
    for rotor in ({"rotor_speed": speed}, {"rotor_azimuth": np.mod(speed[0] * np.arange(len(y)) / RATE, 2 * np.pi)}):
        found = ws.oma(turning({**columns, **rotor}))
        at = [mode for mode in found.modes if abs(mode.frequency.estimate - 2.7) < 0.05]
        assert at
        assert not any(mode.trusted for mode in at)
        assert "3P at 2.7 Hz stands on it" in at[0].doubts


def test_modes_near_those_of_the_turbine_file_have_their_names():
    from windsysid.inspection.spectra import expected_modes

    turbine = ws.load_turbine("nrel5mw")
    name, f, _ = expected_modes(turbine, 0.0)[0]
    rng = np.random.default_rng(45)
    q, _ = modal_responses([1.02 * f], [0.01], RATE, 6000, rng)
    tower = q[:, 0] / q.std() + 0.02 * rng.normal(size=6000)
    found = ws.oma(turning({"tower_x_acceleration": tower}), turbine=turbine)
    assert [mode.name for mode in found.modes] == [name]
    assert found.modes[0].frequency.reference is not None
    assert "reference [Hz]" in found.headings


def test_an_azimuth_that_jumps_is_refused():
    y = two_modes(18)
    psi = np.mod(2.0 * np.pi * 0.2 * np.arange(len(y)) / RATE, 2.0 * np.pi)
    psi[3000:] = np.mod(psi[3000:] + 2.5, 2.0 * np.pi)
    record = ws.Record(
        np.arange(len(y)) / RATE,
        np.column_stack([y, psi]),
        ("tower_x_displacement", "tower_y_displacement", "nacelle_x_displacement", "rotor_azimuth"),
        ("m",) * 3 + ("rad",),
    )
    with pytest.raises(ws.RecordError, match="rotor_azimuth jumps"):
        ws.oma(record)


@pytest.mark.parametrize(
    ("band", "message"),
    [
        ((1.2, 1.0), "two rising frequencies"),
        ((1.0, 1.001), "Hz of width at least"),
        ((4.0, 30.0), "half the sampling rate"),
    ],
)
def test_bands_that_cannot_be_are_refused(band, message):
    with pytest.raises(ws.ConfigurationError, match=message):
        ws.oma(record_of(two_modes(19, samples=1500), RATE), bands=[band])


def test_the_summary_has_modes_as_identify_has_them_and_shapes(tmp_path):
    found = ws.oma(record_of(two_modes(20), RATE))
    found.save(tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    mode = summary["modes"][0]
    assert mode["frequency"]["low"] < mode["frequency"]["estimate"] < mode["frequency"]["high"]
    assert mode["damping_ratio"]["low"] > 0.0
    assert mode["shape"]["sensors"] == list(found.channels)
    assert len(mode["shape"]["real"]) == 3
    assert mode["trusted"] is True
    assert summary["trusted"] is True
    assert b"mode 1" in (tmp_path / "out" / "report.html").read_bytes()
    assert "floor_1_displacement" in str(found)


def setup_of(seed, columns, frequencies=(1.1, 2.7), level=1.0):
    """A record of two modes in some of six places."""
    rng = np.random.default_rng(seed)
    q, _ = modal_responses(list(frequencies), [0.012, 0.008], RATE, 6000, rng)
    y = level * (q / q.std(axis=0)) @ PLACES[columns].T + 0.05 * rng.normal(size=(6000, len(columns)))
    names = tuple(f"place_{c}_displacement" for c in columns)
    return ws.Record(np.arange(6000) / RATE, 0.1 * y, names, ("m",) * len(columns), name=f"record {seed}")


PLACES = np.array([[0.3, 0.8], [0.5, 1.0], [0.7, 0.6], [0.85, -0.1], [0.95, -0.6], [1.0, -0.9]])


def test_setups_that_share_sensors_give_one_shape_and_one_frequency():
    setups = [setup_of(31, [0, 1, 2, 3]), setup_of(32, [0, 1, 4, 5], level=3.0)]
    found = ws.oma(setups)
    assert found.trusted, found.reasons
    assert [round(mode.frequency.estimate, 1) for mode in found.modes] == [1.1, 2.7]
    assert len(found.channels) == 6
    for k, (mode, f, shape) in enumerate(zip(found.modes, (1.1, 2.7), PLACES.T, strict=True)):
        assert abs(mode.frequency.estimate - f) < 3.0 * mode.frequency.std
        true = shape / shape[np.argmax(np.abs(mode.shape))]
        assert np.all(np.abs(mode.shape.real - true) < 4.0 * mode.shape_std + 1e-9)
        alone = [one.frequency.std for part in found.parts if (one := part.modes[k]) is not None]
        assert mode.frequency.std == pytest.approx(1.0 / np.sqrt(np.sum(np.array(alone) ** -2.0)), rel=0.2)


def test_records_of_two_states_are_not_trusted_together():
    found = ws.oma([setup_of(33, [0, 1, 2]), setup_of(34, [0, 1, 2], frequencies=(1.15, 2.7))])
    first, second = found.modes
    assert any("the records disagree in frequency" in doubt for doubt in first.doubts)
    assert second.trusted


def test_records_without_a_common_sensor_are_refused():
    with pytest.raises(ws.ConfigurationError, match="no sensor in common"):
        ws.oma([setup_of(35, [0, 1, 2]), setup_of(36, [3, 4, 5])])


def test_a_few_spikes_are_bridged_and_cost_no_trust():
    y = two_modes(37)
    y[[700, 2600, 4400], 1] += 25.0
    found = ws.oma(record_of(y, RATE))
    assert found.trusted, found.reasons
    assert any("samples of spikes among 6000 were bridged" in note for note in found.notes)


def test_modes_are_sought_in_a_range_only():
    found = ws.oma(record_of(two_modes(38), RATE), limits=(2.0, 4.0))
    assert [round(mode.frequency.estimate, 1) for mode in found.modes] == [2.7]
    with pytest.raises(ws.ConfigurationError, match=r"--range 6 4 Hz \(limits\): expected two rising"):
        ws.oma(record_of(two_modes(38), RATE), limits=(6.0, 4.0))
    for low in (0.5, 0.49 * RATE):  # a range that ends beyond the record's is refused, wherever it begins
        with pytest.raises(ws.ConfigurationError, match=r"an upper end of at most .* Hz, 0.42 times the sampling rate"):
            ws.oma(record_of(two_modes(38), RATE), limits=(low, 900.0))
    with pytest.raises(ws.ConfigurationError, match="ax: expected axes of Matplotlib, got str"):
        found.plot("x")  # type: ignore[arg-type]


@pytest.mark.parametrize("wander", [0.03, pytest.param(0.1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("seed", [30, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (39, 44, 48))])
def test_a_machines_line_that_wanders_is_no_mode_to_trust(seed, wander):
    rng = np.random.default_rng(seed)
    y = two_modes(seed)
    phase = 2.0 * np.pi * 3.6 * np.arange(len(y)) / RATE + np.cumsum(rng.normal(size=len(y)) * wander)
    found = ws.oma(record_of(y + 0.7 * np.sin(phase)[:, None], RATE))
    narrow = [mode for mode in found.modes if abs(mode.frequency.estimate - 3.6) < 0.05]
    assert not any(mode.trusted for mode in narrow)
    assert all(mode.trusted for mode in found.modes if mode not in narrow)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [6, 12, 25, 32, 43])
def test_every_clear_mode_of_a_frame_is_found_and_no_other(seed):
    """Few bins tell a peak's half height badly: bands came out too narrow to tell a mode from what is around it."""
    modes = ((0.8, 0.008), (1.9, 0.010), (3.1, 0.012), (4.6, 0.015))
    shapes = ((1.0, 0.9, 0.6, 0.3), (1.0, 0.1, -0.9, -0.7), (1.0, -0.9, -0.2, 0.9), (0.8, -1.0, 1.0, -0.5))
    rng, count, step = np.random.default_rng(seed), 30_000, 0.02
    y = 0.002 * rng.normal(size=(count, 4))
    for (f, z), shape in zip(modes, shapes, strict=True):
        radius, angle = np.exp(-z * 2.0 * np.pi * f * step), 2.0 * np.pi * f * np.sqrt(1.0 - z * z) * step
        push = lfilter([1.0], [1.0, -np.exp(-step / 0.05)], rng.normal(size=count))
        y += np.outer(lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * radius * np.cos(angle), radius**2], push), shape)
    found = ws.oma(record_of(y, 50.0, [f"floor_{i}_acceleration" for i in range(4)], unit="m/s^2"))
    assert found.trusted, found.reasons
    assert [round(mode.frequency.estimate, 1) for mode in found.modes] == [0.8, 1.9, 3.1, 4.6]


@pytest.mark.parametrize("way", ["held", pytest.param("interpolated", marks=pytest.mark.slow)])
def test_images_of_a_slow_logger_are_no_modes(way):
    """Readings that are held, or filled in by straight lines, mirror every mode at the rate they were read at."""
    slow = two_modes(40)
    fine = np.arange(5 * len(slow) - 4) / 5.0
    columns = [np.interp(fine, np.arange(len(slow)), column) for column in slow.T]
    filled = np.repeat(slow, 5, axis=0) if way == "held" else np.column_stack(columns)
    found = ws.oma(record_of(np.round(filled, 5), 5.0 * RATE))
    assert [round(mode.frequency.estimate, 1) for mode in found.modes] == [1.1, 2.7]
    assert any("was read 10 times a second" in note for note in found.notes)


@pytest.mark.slow
def test_a_band_of_a_short_record_does_not_reach_frequency_zero():
    # Where a mode is too narrow to tell, its band is widened; in 33 s that reached bin 0, which has no logarithm.
    record = simulate_record("nrel5mw_full", duration=60.0, rate=50.0, seed=5, loads="wind").section(0.0, 33.0)
    with np.errstate(all="raise"):
        found = ws.oma(record, turbine="nrel5mw_full")
    assert all(mode.frequency.estimate > 2.0 / 33.0 for mode in found.modes)


def frame(seed, loads, storeys=5, zeta=0.02, noise=0.1):
    """Velocities of a shear frame under white loads (N, s) on its storeys, its natural frequencies up to 12 Hz."""
    stiffness = 2.0 * np.eye(storeys) - np.eye(storeys, k=1) - np.eye(storeys, k=-1)
    stiffness[-1, -1] = 1.0
    squares, shapes = np.linalg.eigh(stiffness)
    frequencies, rng = 12.0 * np.sqrt(squares / squares[-1]), np.random.default_rng(seed)
    _, q = modal_responses(frequencies, [zeta] * storeys, 50.0, 30_000, rng, shapes.T @ loads)
    y = q @ shapes.T
    return frequencies, y + noise * y.std(axis=0) * rng.normal(size=y.shape)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_mode_is_trusted_and_wrong_where_one_load_drives_all(seed):
    """The neighbours' response to the load of a mode is coherent with its own, and moved a damping by five sigma.

    The next test finds the same on one band of three storeys.
    """
    true, y = frame(seed, np.ones((5, 1)))
    for mode in ws.oma(record_of(y, 50.0, unit="m/s")).modes:
        if mode.trusted:
            assert np.min(np.abs(mode.frequency.estimate - true)) < 3.0 * mode.frequency.std
            assert abs(np.log(mode.damping_ratio.estimate / 0.02)) < 3.0 * mode.damping_ratio.relative_std


def test_a_load_that_drives_neighbours_is_told_from_one_that_does_not():
    def fit_of(loads):
        true, y = frame(2, loads, storeys=3, zeta=0.01, noise=0.01)
        readings = prepare_readings(record_of(y, 50.0, unit="m/s"), None)
        return true[1], fit_between(RecordSpectrum(readings, *transforms(readings)), (7.5, 9.1), 1, 2)

    _, own = fit_of(np.eye(3))
    true, shared = fit_of(np.ones((3, 1)))
    assert own.plain is None
    assert own.fit.modes.drift is None
    assert shared.plain is not None
    assert abs(np.log(shared.fit.modes.frequency[0] / true)) < 2.0 * shared.fit.std(0)[0]


def test_images_of_splines_are_no_modes():
    """A spline through slow readings leaves faint images of its modes, which nothing else tells from modes."""
    rng = np.random.default_rng(1)
    _, q = modal_responses([3.1, 4.6], [0.012, 0.015], 20.0, 6_000, rng)
    slow = (q / q.std(axis=0)) @ SHAPES.T
    times = np.arange(len(slow)) / 20.0
    values = CubicSpline(times, slow + 0.01 * rng.normal(size=slow.shape))(np.arange(0.0, times[-1], 0.02))
    found = ws.oma(record_of(values, 50.0, unit="m/s"))
    assert [round(mode.frequency.estimate, 1) for mode in found.modes if mode.trusted] == [3.1, 4.6]
    images = [mode.frequency.estimate for mode in found.modes if mode.doubted_for("image")]
    np.testing.assert_allclose(images, [20.0 - 4.6, 20.0 - 3.1], rtol=0.01)


@pytest.mark.slow
def test_a_steep_filter_in_the_band_is_no_error():
    """In its stop band the spectra of channels are singular to rounding."""
    y = two_modes(1)
    sos = butter(8, 2.6, fs=RATE, output="sos")
    found = ws.oma(record_of(sosfiltfilt(sos, y, axis=0), RATE))
    assert [mode.trusted for mode in found.modes if round(mode.frequency.estimate, 1) == 1.1] == [True]


def windows(count, step):
    """Records of 3000 samples that begin `step` samples after each other, of one motion."""
    y = two_modes(60, samples=3000 + step * (count - 1))
    return [record_of(y[i * step : i * step + 3000], RATE) for i in range(count)]


@pytest.mark.parametrize("step", [0, *(pytest.param(step, marks=pytest.mark.slow) for step in (750, 2000))])
def test_records_that_hold_the_same_motion_are_not_trusted_together(step):
    """What happened once counted several times: bands were too narrow by the root of that."""
    rng = np.random.default_rng(3)
    records = windows(3, step)
    if not step:  # written anew: with another gain and a little noise
        records[1] = record_of(2.0 * records[1].values + 1e-3 * rng.normal(size=records[1].values.shape), RATE)
    found = ws.oma(records)
    assert not found.trusted
    assert "contain the same motion" in found.doubts[0]


@pytest.mark.slow
def test_records_one_after_the_other_are_trusted_together():
    assert ws.oma(windows(3, 3000)).trusted


def test_a_frequency_that_goes_up_and_down_again_has_a_wider_interval():
    """Both halves of a day are alike; damping came out larger by four standard deviations."""
    rng, samples = np.random.default_rng(5), 40_000
    q, _ = modal_responses([1.1, 2.7], [0.012, 0.008], 10.0, samples, rng)
    y = (q / q.std(axis=0)) @ SHAPES.T
    times = np.arange(samples) / RATE
    bent = times + 0.01 * times[-1] / (2.0 * np.pi) * np.sin(2.0 * np.pi * times / times[-1])
    moved = CubicSpline(times, y)(np.minimum(bent, times[-1]))
    found = ws.oma(record_of(moved + 0.05 * rng.normal(size=y.shape), RATE))
    for mode, f, zeta in zip(found.modes, (1.1, 2.7), (0.012, 0.008), strict=True):
        assert mode.frequency.grade in "BC"
        assert mode.widening[0] > 2.0
        assert "segments of the record contradict each other" in " ".join(d.text for d in mode.grounds + mode.remarks)
        assert abs(mode.frequency.estimate - f) < 2.0 * mode.frequency.std
        assert abs(np.log(mode.damping_ratio.estimate / zeta)) < 2.0 * mode.damping_ratio.relative_std
    assert ws.oma(record_of(y + 0.05 * rng.normal(size=y.shape), RATE)).trusted


def test_channels_that_stand_still_are_said_to():
    still = record_of(np.zeros((3000, 2)), RATE, ["a_acceleration", "b_acceleration"], unit="m/s^2")
    with pytest.raises(ws.WindsysidError, match="a_acceleration, b_acceleration: constant or empty"):
        ws.oma(still)
