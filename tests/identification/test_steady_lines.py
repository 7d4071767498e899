"""Steady lines are left out of the readings, or taken into account as forces; narrow-band loads are not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammaincc
from validation.adversary.loads import plus_narrow_band
from validation.adversary.machine import Machine
from validation.adversary.scenarios import SCENARIOS, Scenario, record

from tests.findings import codes, notes, only, reasons
from validation import towers
from windsysid.checks.limits import SCREENING_PROBABILITY
from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification import pipeline
from windsysid.identification.effects import sinusoid as steady_lines
from windsysid.identification.effects.lines import harmonics_of_spectra
from windsysid.identification.effects.sinusoid import Sine, find_sine, find_turning, one_turn, turned, without_sines
from windsysid.identification.effects.sinusoidal_force import SineForce, find_forces, with_forces
from windsysid.identification.formulations import estimate
from windsysid.identification.identify import identify
from windsysid.identification.job import Job
from windsysid.identification.model.fit import PART_OF, known_loads
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

ONE_P = Machine().speed / (2.0 * math.pi)


def worst(found: Identification, true: dict[str, float]) -> float:
    """The largest error, in standard deviations."""
    errors = [(e.estimate - true[e.name]) / e.std for e in found.estimates if e.name in true]
    return float(np.max(np.abs(errors)))


def test_a_line_beside_a_tower_mode_is_left_out():
    """The verdict was "no", and stiffness far off."""
    made, true = towers.simulate("line 5 % from fore-aft", 500001)
    found = identify(made, "tower", prior=DrawnPrior(seed=500001), formulation="spectral")
    assert found.diagnosis.trusted
    assert worst(found, true) < 3.0
    assert only(found.findings, "tone_removed").data["frequency"] == pytest.approx(0.34, abs=0.0005)


@pytest.mark.slow
def test_a_line_beside_a_mode_of_a_support_is_a_force_on_it():
    found = identify(
        record("line 5 % from a mode", 502), "verne555", prior=DrawnPrior(seed=502), formulation="joint",
        loads="broadband",
    )  # fmt: skip
    assert found.diagnosis.trusted
    assert worst(found, Machine().truth) < 3.0
    force = only(found.findings, "sinusoidal_force").data
    assert (force["load"], force["order"]) == ("load_x", 0)
    assert force["amplitude"] == pytest.approx(4.6, abs=2.0 * force["std"])
    assert force["frequency"] == pytest.approx(1.64, abs=0.005)


@pytest.mark.parametrize(("bins", "is_one"), [(0.0, False), (2.0, False), (12.0, True)])
def test_a_sinusoid_at_1p_is_the_rotors_and_one_beside_it_is_not(verne555: Turbine, bins: float, is_one: bool):
    made = simulate_record(verne555, duration=100.0, rate=25.0, seed=2)
    frequency = abs(verne555.rotor_speed) / (2.0 * math.pi) + bins / made.duration
    name = "tower_x_acceleration"
    line = 2.0 * np.std(made[name]) * np.sin(2.0 * math.pi * frequency * made.time)
    pushed = made.with_channels({name: (made[name] + line, made.unit(name))})
    assert (find_sine(pushed, verne555, verne555.sensors, name, frequency) is not None) is is_one


def is_sine(kind: str, seed: int, low: float, high: float) -> bool:
    """Whether what is loudest in a band [Hz] of a tower's fore-aft readings is told a sine."""
    made, tower = towers.record(kind, seed), load_turbine("tower")
    channel = "tower_z_acceleration"
    power = np.abs(np.fft.rfft(np.hanning(made.samples) * made[channel])) ** 2
    frequency = np.fft.rfftfreq(made.samples, 1.0 / made.rate)
    near = (frequency > low) & (frequency < high)
    loudest = float(frequency[near][np.argmax(power[near])])
    return find_sine(made, tower, tower.sensors, channel, loudest) is not None


@pytest.mark.parametrize("kind", ["narrow band, 0.34 Hz", "all but a line, 0.31 Hz"])
@pytest.mark.parametrize("seed", [700, 704])
def test_a_narrow_band_is_no_sine(kind: str, seed: int):
    assert not is_sine(kind, seed, 0.3, 0.35)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "at", "least", "most"), [("line 5 % from fore-aft", 0.34, 28, 30), ("all but a line, 0.31 Hz", 0.31, 0, 4)]
)
def test_nearly_all_sines_are_told_from_narrow_bands(kind: str, at: float, least: int, most: int):
    """26 of these 30 sines were told; what is all but a line lasts a third of the record."""
    found = sum(is_sine(kind, seed, at - 0.01, at + 0.01) for seed in range(780_000, 780_030))
    assert least <= found <= most


@pytest.mark.parametrize("seed", [pytest.param(500, marks=pytest.mark.slow), 502])
def test_how_strongly_a_sine_pushes(verne555: Turbine, seed: int):
    """3 N on either direction of the support."""
    made, exact = record("3P on the support", seed), verne555.exact()
    problem = pose(made, exact, exact.sensors, Prior())
    sine = Sine(3.0 * ONE_P, on_blades=False, order=3)
    forces = find_forces(problem, problem.wide_prior[0], made, [sine])
    assert {one.load for one in forces} == {"load_x", "load_y"}
    for one in forces:
        assert one.amplitude == pytest.approx(15.0 * math.sqrt(0.04), abs=4.0 * one.std)
        assert one.std < 0.3


def test_what_turns_and_its_image_on_the_blades_are_one_force(verne555: Turbine):
    """3P on the support is 4P on the blades: two forces took each other's part, and masses came out 18 % too large."""
    made, exact = record("3P on the support", 500), verne555.exact()
    problem = pose(made, exact, exact.sensors, Prior())
    sines = [Sine(4.0 * ONE_P - 1e-3, on_blades=True), Sine(3.0 * ONE_P, on_blades=False, order=3)]
    forces = find_forces(problem, problem.wide_prior[0], made, sines)
    assert [(one.sine.order, one.load) for one in forces] == [(3, "load_x"), (3, "load_y")]


def test_harmonics_of_spectra_are_found_by_one_filter():
    """Filters took minutes over this record, and said no: their search begins with the force."""
    made, rotor, prior = record("3P on the support", 110004), load_turbine("verne555"), DrawnPrior(seed=110004)
    job = Job(made, made, rotor, None, prior, None, None, "broadband")
    found = harmonics_of_spectra(job.by("joint"), estimate(job.by("spectral")))
    assert found is not None
    assert [one.order for one in found.sines] == [3]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed", "order", "hz"),
    [("3P on the support", 110004, 3, 3.0 * ONE_P), ("line amid the modes", 110004, 0, 2.6)],
)
def test_lines_are_heard_before_filters_search(kind: str, seed: int, order: int, hz: float):
    """Filters took minutes over the first, and said no; the second was told a narrow-band load, and no."""
    found = identify(record(kind, seed), "verne555", prior=DrawnPrior(seed=seed))
    assert found.diagnosis.trusted
    assert worst(found, Machine().truth) < 3.0
    forces = [one.data for one in found.findings if one.code == "sinusoidal_force"]
    assert (order, pytest.approx(hz, rel=0.01)) in [(one["order"], one["frequency"]) for one in forces]


def test_a_sine_that_was_seen_on_the_support_may_push_a_blade(verne555: Turbine):
    made = record("line 3 % from blades", 600)
    problem = pose(made, verne555, verne555.sensors, Prior())
    seen = Sine(4.15 - ONE_P, on_blades=False)
    forces = find_forces(problem, problem.wide_prior[0], made, [seen])
    first = max(forces, key=lambda one: one.amplitude)
    assert first.load == "load_beta_1"
    assert first.sine.frequency == pytest.approx(4.15)
    assert first.amplitude == pytest.approx(3.0, abs=4.0 * first.std)
    assert not any(one.matters for one in forces if one is not first)


@pytest.mark.slow
def test_what_turns_with_the_rotor_is_felt_by_innovations(verne555: Turbine):
    made = record("1P on the support", 503).section(0.0, 15.0)
    found = identify(made, verne555, prior=DrawnPrior(seed=503), formulation="joint", loads="broadband")
    assert found.diagnosis.trusted
    assert worst(found, Machine().truth) < 3.0
    assert 1 in [one.data["order"] for one in found.findings if one.code == "sinusoidal_force"]
    assert find_turning(found.whitened, made, verne555, verne555.sensors) == []


@pytest.mark.slow
def test_what_turns_and_nobody_took_away_speaks_against_a_result(verne555: Turbine, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(pipeline, "MAX_EXTENSIONS", 0)
    made = record("1P on the support", 502).section(0.0, 15.0)
    found = identify(made, verne555, prior=DrawnPrior(seed=502), formulation="joint", loads="broadband")
    assert 1 in [one.data["order"] for one in reasons(found) if one.code == "rotor_harmonic_left"]


@pytest.mark.slow
def test_an_imbalance_is_no_mass_of_a_blade(monkeypatch: pytest.MonkeyPatch):
    """Blades were 5 % too heavy and 4 % too light, and trusted; 18.6 N turned."""
    unbalanced = Scenario("machine", machine=Machine(eccentricity=0.06), duration=60.0)
    monkeypatch.setitem(SCENARIOS, "imbalance", unbalanced)
    found = identify(
        record("imbalance", 610001), "verne555", prior=DrawnPrior(seed=610001), formulation="joint", loads="broadband"
    )  # fmt: skip
    assert found.diagnosis.trusted
    assert worst(found, Machine().truth) < 3.0
    off = [one.data for one in found.findings if one.code == "tolerance_off"]
    assert not [one for one in off if one["group"] == "masses" and one["of"].startswith("blade")]
    forces = [one.data for one in notes(found) if one.code == "sinusoidal_force"]
    assert [(one["order"], one["load"]) for one in forces] == [(1, "load_x"), (1, "load_y")]
    assert all(one["amplitude"] == pytest.approx(18.6, abs=2.0 * one["std"]) for one in forces)


@pytest.mark.slow
def test_what_is_left_beside_a_sine_that_was_none_is_a_doubt(monkeypatch: pytest.MonkeyPatch):
    """A narrow-band load that passes for a sine: the damping was 5 standard deviations off, and trusted."""
    monkeypatch.setitem(SCENARIOS, "nb1", Scenario("loads", plus_narrow_band(1.64, 0.001, 0.2, (0, 1))))
    found = identify(
        record("nb1", 610004), "verne555", prior=DrawnPrior(seed=610004), formulation="spectral", loads="broadband"
    )  # fmt: skip
    assert "tone_removed" in codes(found.findings)
    of_a_band = {"tone_influence", "narrow_band_load_preferred", "narrow_band_load_ambiguous"}
    assert of_a_band.union({"narrow_band_load_possible"}).intersection(codes(reasons(found)))


@pytest.mark.parametrize(("order", "code"), [(1, "rotor_harmonic_left"), (0, "tone_left")])
def test_a_sine_that_is_left_is_called_a_harmonic_where_it_turns_with_the_rotor(order: int, code: str):
    left = Sine(2.0, on_blades=False, order=order).doubt
    assert (left.code, left.severity, left.data) == (code, "reason", {"frequency": 2.0, "order": order})


def test_parts_of_loads_add_to_what_is_not_known(verne555: Turbine):
    made = record("reference", 1)
    sine = Sine(2.0, on_blades=False)
    force = SineForce(sine, "load_x", "N", 3.0, 4.0, 0.1)
    pushed = with_forces(made, [force], turned(made, verne555, verne555.sensors))
    known, states = known_loads(pushed, verne555)
    assert PART_OF + "load_x" in pushed
    assert len(states) == len(known_loads(made, verne555)[1])
    assert np.max(known[:, verne555.model.loads.index("load_x")]) == pytest.approx(5.0, rel=1e-2)


def test_a_force_adds_to_the_part_of_a_load_that_was_measured(verne555: Turbine):
    """It took its place, and a shaker that was measured was forgotten."""
    made = record("reference", 1)
    made = made.with_channels({"part_of_load_x": (np.full(made.samples, 2.0), "N")})
    force = SineForce(Sine(2.0, on_blades=False), "load_x", "N", 3.0, 0.0, 0.1)
    pushed = with_forces(made, [force], turned(made, verne555, verne555.sensors))["part_of_load_x"]
    assert pushed[0] == pytest.approx(5.0)
    assert pushed.mean() == pytest.approx(2.0, abs=0.01)


def test_a_load_that_was_measured_is_not_pushed_beside(verne555: Turbine):
    made = record("reference", 1)
    made = made.with_channels({"load_x": (np.zeros(made.samples), "N")})
    problem = pose(made, verne555, verne555.sensors, Prior())
    sine = Sine(2.0, on_blades=False)
    forces = find_forces(problem, problem.wide_prior[0], made, [sine])
    assert "load_x" not in {one.load for one in forces}


def test_a_part_of_a_load_has_the_unit_of_the_load_and_is_no_matter_of_spectra(verne555: Turbine):
    made = record("reference", 1)
    push = 5.0 * np.sin(12.0 * made.time)
    with pytest.raises(RecordError, match="'part_of_load_x': expected N, got m"):
        identify(made.with_channels({"part_of_load_x": (push, "m")}), verne555)
    with pytest.raises(ConfigurationError, match="takes no measured loads"):
        identify(made.with_channels({"part_of_load_x": (push, "N")}), verne555, formulation="spectral")


def test_a_rotor_that_stands_has_no_turn(verne555: Turbine):
    made = record("reference", 1)
    assert one_turn(made, verne555, verne555.sensors) == Sine(pytest.approx(ONE_P), on_blades=False, order=1)  # type: ignore[arg-type]
    parked = made.with_channels(
        {"rotor_azimuth": (np.zeros(made.samples), "rad"), "rotor_speed": (np.zeros(made.samples), "rad/s")}
    )
    assert one_turn(parked, replace(verne555, rotor_speed=0.0), verne555.sensors) is None


def test_gravity_stays_where_sines_are_left_out(verne555: Turbine):
    """At 1P in the readings of blades the model has a force of its own."""
    made = record("reference", 2)
    left = without_sines(made, verne555, verne555.sensors, [Sine(2.0 * ONE_P, on_blades=False, order=2)])

    def at(one: Record, channel: str, order: int) -> float:
        window = np.hanning(one.samples)
        return float(
            abs(2.0 * np.sum(window * one[channel] * np.exp(-1j * order * one["rotor_azimuth"])) / window.sum())
        )

    assert at(left, "blade_1_lag_acceleration", 1) == pytest.approx(at(made, "blade_1_lag_acceleration", 1), rel=1e-6)
    assert at(left, "tower_x_acceleration", 2) < 1e-3 * at(made, "tower_x_acceleration", 2)
    assert at(left, "blade_1_lag_acceleration", 3) < 1e-3 * at(made, "blade_1_lag_acceleration", 3)


def test_one_steady_sine_in_a_hundred_scatters_by_more_than_its_bound():
    """Four parts about their mean have three complex degrees of freedom: half a χ² of six."""
    rng, samples, count = np.random.default_rng(3), 400, 1000
    waves = (rng.standard_normal((count, samples)) + 1j * rng.standard_normal((count, samples))) / math.sqrt(2.0)
    scatters = np.array([steady_lines._scatter(wave, 1.0) for wave in waves])
    chances = gammaincc(steady_lines.SEGMENT_COUNT - 1, scatters)
    assert np.mean(chances < SCREENING_PROBABILITY) == pytest.approx(0.01, abs=2.0 * math.sqrt(0.01 / count))


@pytest.mark.parametrize(("growth", "least", "most", "steady"), [(0.6, 7.8, 8.4, True), (0.65, 8.4, 9.0, False)])
def test_a_sine_has_one_amplitude_in_all_parts_of_a_record(growth: float, least: float, most: float, steady: bool):
    tower, time = load_turbine("tower"), np.arange(6000) / 10.0
    wave = 0.4 * (1.0 + growth * (time / time[-1] - 0.5)) * np.cos(2.0 * math.pi * 0.4 * time)
    noise = np.random.default_rng(11).standard_normal((time.size, 2))
    channel = "tower_x_acceleration"
    made = Record(
        time, noise + np.column_stack([wave, np.zeros_like(wave)]), (channel, "tower_z_acceleration"), ("m/s^2",) * 2
    )
    seen = steady_lines._SeenLine.of(made, channel, 0.4)
    assert seen is not None
    assert least < seen.scatter < most
    assert (find_sine(made, tower, tower.sensors, channel, 0.4) is not None) is steady
