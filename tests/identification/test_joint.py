"""The joint formulation: coefficients from accelerometers alone, with the loads as states or known."""

from dataclasses import replace

import numpy as np
import pytest

from tests.findings import codes, notes, only, reasons
from tests.identification.fits import identify_without_effects as identify
from tests.identification.fits import rotor_from, rotor_record
from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.identification import identify as front
from windsysid.identification.model.fit import check_finite, known_loads
from windsysid.identification.model.prior import Prior, identifiable
from windsysid.mechanics import RotorModel, compile_model
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.identification import Identification
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.record import simulate_record
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

RATE = 100.0


@pytest.fixture(scope="module")
def driven() -> Record:
    return rotor_record()


def free_decay(turbine: Turbine, duration: float, *, loads_recorded: bool) -> Record:
    """Released from a displaced state, no load at all; the turbine's usual sensors with their noise."""
    model = compile_model(turbine.model, turbine.sensors)
    p = np.array([turbine.values[name] for name in model.parameters])
    n = len(turbine.model.coordinates)
    turning = constant_speed_inputs(turbine.rotor_speed, duration, RATE)
    start = np.concatenate([[0.05, 0.04, 0.03, -0.02, 0.01], np.zeros(n)])
    response = integrate(model, p, np.hstack([turning, np.zeros((len(turning), n))]), rate=RATE, start=start)
    noise = np.array([sensor.noise for sensor in turbine.sensors])
    read = response.readings + noise * np.random.default_rng(1).standard_normal(response.readings.shape)
    channels = {"rotor_azimuth": (np.mod(turning[:, 0], 2 * np.pi), "rad")}
    channels |= {sensor.channel: (read[:, i], sensor.unit) for i, sensor in enumerate(turbine.sensors)}
    if loads_recorded:
        units = ["N" if name in ("x", "y") else "N*m" for name in turbine.model.coordinates]
        channels |= {
            load: (np.zeros(len(turning)), unit) for load, unit in zip(turbine.model.loads, units, strict=True)
        }
    time = np.arange(len(turning)) / RATE
    return Record(time, np.empty((len(time), 0)), (), (), name="free decay").with_channels(channels)


def off(identification: Identification, name: str) -> float:
    """Distance from the reference in standard deviations."""
    e = identification[name]
    assert e.reference is not None
    return abs(e.estimate - e.reference) / e.std


from_either_side = pytest.mark.parametrize("scale", [0.7, pytest.param(1.3, marks=pytest.mark.slow)])
"""Priors 30 % off."""


@from_either_side
def test_ten_coefficients_come_from_accelerometers_and_priors_30_percent_off(scale):
    result = rotor_from(scale)
    assert len(result.estimates) == 10
    for e in result.estimates:
        assert e.reference is not None
        assert off(result, e.name) < 4.0, f"{e.name}: {off(result, e.name)} σ"
        if e.kind == "stiffness":
            assert e.estimate == pytest.approx(e.reference, rel=0.05)
            assert e.informed_by_data > 0.99
        else:  # 40 s of a randomly driven structure know damping to about 18 %
            assert 0.12 < e.std / e.reference < 0.26  # an interval may be wider where parts of the record contradict
            assert 0.5 < e.informed_by_data < 0.95


@pytest.mark.slow
def test_where_the_prior_started_does_not_matter():
    # Stiffness within 0.6 of a standard deviation (damping, which differs, pulls it a little). A damping known to
    # s = 18 % holds (s/0.3)² of its information in the prior, and 1.3 - 0.7 of it moves the answer by 0.6 s/0.3² = 1.2
    # standard deviations.
    for e in rotor_from(0.7).estimates:
        other = rotor_from(1.3)[e.name]
        difference = abs(e.estimate - other.estimate) / e.std
        assert difference < (0.6 if e.kind == "stiffness" else 1.2), f"{e.name}: {difference} σ"


@from_either_side
def test_on_line_ends_where_the_whole_record_does(scale):
    result = rotor_from(scale)
    std = np.sqrt(np.diag(result.cov))
    pairs = zip(result.parameters, result.estimates, strict=True)
    mode = [np.log(e.estimate / q.reference) if q.logarithmic else e.estimate / q.reference for q, e in pairs]
    assert np.all(np.abs(result.mean[-1] - mode) < 0.3 * std)
    wider = std / result.std[-1]  # as parts of the record contradict each other, which no recursion knows
    assert np.all((wider > 0.9) & (wider < 1.4))
    assert np.median(wider) < 1.1


def test_the_notes_say_how_it_was_done():
    taken, choice = notes(rotor_from(0.7))
    assert taken.code == "loads_are_states"
    assert (choice.code, choice.data) == ("load_model_chosen", {"model": "broadband", "reason": "explains"})


@from_either_side
def test_innovations_are_as_large_as_the_filter_expects(scale):
    # Mean square of T = 4000 whitened samples: 1 ± 4 √(2/T).
    squares = np.mean(rotor_from(scale).whitened ** 2, axis=0)
    np.testing.assert_allclose(squares, 1.0, atol=4 * np.sqrt(2 / 4000) + 0.02)


@pytest.fixture(scope="module")
def decay(verne555: Turbine) -> Record:
    return free_decay(verne555, 30.0, loads_recorded=True)


@pytest.mark.parametrize("scale", [0.7, pytest.param(1.3, marks=pytest.mark.slow)])
def test_a_free_decay_without_load_is_identified_within_percents(verne555, decay, scale):
    # The loads are recorded, and zero: then they are known. Stiffness within 1 %, damping within 5 %.
    result = identify(decay, verne555, prior=Prior(scale, scale))
    for e in result.estimates:
        assert e.reference is not None
        assert e.estimate == pytest.approx(e.reference, rel=0.01 if e.kind == "stiffness" else 0.05), e.name
        assert off(result, e.name) < 4.0
    assert "loads_known" in codes(result.findings)


@pytest.mark.slow
def test_a_free_decay_is_identified_with_small_loads_as_states_too(verne555):
    # The turbine file's loads, 15 N rms, would not be believed: the file must say how little there is.
    calm = replace(
        verne555, loads=tuple(GaussMarkov(load.load, load.rms / 100.0, load.time_constant) for load in verne555.loads)
    )
    result = identify(free_decay(verne555, 30.0, loads_recorded=False), calm, prior=Prior(0.7, 0.7))
    for e in result.estimates:
        assert e.reference is not None
        assert e.estimate == pytest.approx(e.reference, rel=0.01 if e.kind == "stiffness" else 0.05), e.name


@pytest.mark.slow
def test_loads_that_are_not_there_are_learned_to_be_none(verne555, decay):
    # The turbine file says 15 N and 15 N·m rms. Learned, they hardly cost anything against knowing that there are none.
    known = identify(decay.section(0.0, 8.0), verne555)
    as_states = identify(free_decay(verne555, 8.0, loads_recorded=False), verne555, loads="broadband")
    learned = {s.name: s.estimate for s in as_states.statistics}
    assert all(value < 0.5 for name, value in learned.items() if name.startswith("load_rms"))
    for e in known.estimates:
        assert 0.98 * e.std <= as_states[e.name].std < 2.0 * e.std
        assert off(as_states, e.name) < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0 / 3.0, 3.0])
def test_wrong_statistics_in_the_files_are_put_right(verne555, driven, factor):
    # Three times off in load and noise: the answer is the same as from the right files.
    wrong = replace(
        verne555,
        loads=tuple(GaussMarkov(load.load, load.rms * factor, load.time_constant) for load in verne555.loads),
        sensors=tuple(s.model_copy(update={"noise": s.noise / factor}) for s in verne555.sensors),
    )
    result = identify(driven, wrong, prior=Prior(1.3, 1.3))
    for e in result.estimates:
        right = rotor_from(1.3)[e.name]
        assert abs(e.estimate - right.estimate) < 0.2 * right.std, e.name
        assert e.std == pytest.approx(right.std, rel=0.1)
    for s in result.statistics:  # ±4σ: the bands are ±2σ
        truth = s.given / factor if s.name.startswith("load_rms") else s.given * factor
        truth = s.given if s.name == "load_time_constant" else truth
        assert s.estimate * (s.low / s.estimate) ** 2 < truth < s.estimate * (s.high / s.estimate) ** 2, s.name


@pytest.mark.slow
def test_loads_that_are_louder_on_one_degree_of_freedom_than_on_its_like_bias_no_damping(verne555):
    # One level for all blades and one for the support left damping four standard deviations off here.
    louder = {"load_x": 2.0, "load_beta_2": 1.5, "load_beta_3": 2.0}
    loads = tuple(replace(load, rms=load.rms * louder.get(load.load, 1.0)) for load in verne555.loads)
    record = simulate_record(replace(verne555, loads=loads), duration=30.0, rate=50.0, seed=0)
    result = identify(record, verne555, loads="broadband")
    for e in result.estimates:
        assert e.reference is not None
        assert abs(e.estimate - e.reference) < 3.5 * e.std, e.name
    for s in result.statistics:
        if s.name in (f"load_rms_{name}" for name in ("x", "y", "beta_1", "beta_2", "beta_3")):
            truth = s.given * louder.get(s.name.replace("_rms", ""), 1.0)
            assert s.estimate * (s.low / s.estimate) ** 2 < truth < s.estimate * (s.high / s.estimate) ** 2, s.name


def test_recorded_loads_are_inputs_and_the_others_states(verne555, driven):
    some = driven.with_channels({"load_y": (np.full(driven.samples, 3.0), "N")})
    known, states = known_loads(some, verne555)
    np.testing.assert_array_equal(known, np.outer(np.ones(driven.samples), [0.0, 3.0, 0.0, 0.0, 0.0]))
    assert [load.load for load in states] == ["load_x", "load_beta_1", "load_beta_2", "load_beta_3"]


def test_without_blade_channels_the_blades_are_locked(verne555, driven):
    support = driven.select(["rotor_azimuth", "rotor_speed", "tower_x_acceleration", "tower_y_acceleration"])
    result = identify(support.section(0.0, 15.0), verne555, loads="broadband")
    assert [e.name for e in result.estimates] == ["k_x", "c_x", "k_y", "c_y"]
    assert only(result.findings, "coordinate_locked").data == {"coordinate": "lag"}
    assert sorted(mode.name for mode in result.modes) == ["tower x", "tower y"]
    # This machine's blades are half its moving mass and do move: a load model rich enough hides it from innovations.
    assert "blades_locked_unseen" in codes(reasons(result))


@pytest.mark.slow
def test_locked_blades_are_right_for_a_turbine_whose_blades_are_locked(verne555):
    stiff = replace(
        verne555.with_model(RotorModel(3, lag="locked")), loads=verne555.loads[:2], sensors=verne555.sensors[:2]
    )
    record = simulate_record(stiff, duration=60.0, rate=RATE, seed=1)
    results = identify(record, stiff), identify(record, replace(verne555, sensors=verne555.sensors[:2]))
    for result in results:
        assert len(result.estimates) == 4
        assert all(off(result, e.name) < 4.0 for e in result.estimates)
    sure, unsure = results
    assert sure.diagnosis.trusted, sure.diagnosis.reasons
    assert not unsure.diagnosis.trusted  # nobody knows that these blades do not move


@pytest.mark.slow
def test_an_axis_without_a_channel_is_found_through_the_blades(verne555, driven):
    fewer = driven.select([name for name in driven.channels if name != "tower_y_acceleration"])
    result = identify(fewer.section(0.0, 20.0), verne555, loads="broadband")
    assert len(result.estimates) == 10
    for e in result.estimates:
        assert off(result, e.name) < 4.0, e.name


def test_an_axis_that_nothing_sees_is_locked(verne555, driven):
    result = identify(
        driven.select(["rotor_azimuth", "rotor_speed", "tower_x_acceleration"]).section(0.0, 10.0), verne555
    )
    assert Finding("coordinate_locked", "note", {"coordinate": "y"}) in result.findings
    assert [e.name for e in result.estimates] == ["k_x", "c_x"]


@pytest.mark.slow
@pytest.mark.parametrize("unseen", [(2,), (2, 3)])
def test_a_blade_without_a_channel_is_found_through_the_hub(verne555, driven, unseen):
    hidden = tuple(f"blade_{i}" for i in unseen)
    result = identify(driven.select([name for name in driven.channels if not name.startswith(hidden)]), verne555)
    assert len(result.estimates) == 10
    for i in unseen:
        assert off(result, f"k_beta_{i}") < 4.0
        assert result[f"k_beta_{i}"].estimate == pytest.approx(4150.0, rel=0.05)
        assert result[f"k_beta_{i}"].std > 1.1 * result["k_beta_1"].std


@pytest.mark.slow
def test_a_tilted_prior_far_away_still_finds_the_stiffness(verne555, decay):
    result = identify(decay, verne555, prior=Prior(stiffness=2.0, damping=0.5))
    for e in result.estimates:
        assert e.reference is not None
        assert e.estimate == pytest.approx(e.reference, rel=0.01 if e.kind == "stiffness" else 0.05), e.name


@pytest.mark.slow
def test_a_recursion_that_loses_its_way_costs_the_history_only(verne555, driven, monkeypatch):
    def astray(*_):
        raise WindsysidError("rational spectrum: expected a positive rms, got nan")

    monkeypatch.setattr("windsysid.identification.estimate.search._take_in", astray)
    result = identify(driven, verne555, prior=Prior(1.3, 1.3))
    whole = rotor_from(1.3)
    assert result.diagnosis.trusted
    for one, other in zip(result.estimates, whole.estimates, strict=True):
        assert one.estimate == pytest.approx(other.estimate, abs=0.05 * other.std)
        assert one.std == pytest.approx(other.std, rel=0.02)


@pytest.mark.parametrize(
    ("factor", "trusted"),
    [
        pytest.param(1.0, True, marks=pytest.mark.slow),
        (1.004, True),
        (1.015, False),
        pytest.param(0.985, False, marks=pytest.mark.slow),
    ],
)
def test_time_that_is_counted_wrongly_shows_between_azimuth_and_speed(verne555, driven, factor, trusted):
    part = driven.section(0.0, 10.0)
    result = identify(replace(part, time=part.time * factor), verne555, loads="broadband")
    assert result.diagnosis.trusted == trusted
    if not trusted:
        contradiction = only(reasons(result), "azimuth_contradicts_speed")
        assert contradiction.data["ratio"] == pytest.approx(1.0 / factor, rel=0.002)


def test_readings_in_another_unit_than_they_say_are_one_clear_error(verne555, driven, monkeypatch):
    thousandths = {name: (1e3 * driven[name], "rad/s^2") for name in driven.channels if name.startswith("blade")}
    with pytest.raises(WindsysidError, match="check units"):
        identify(driven.with_channels(thousandths).section(0.0, 20.0), verne555, loads="broadband")

    def singular(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("windsysid.identification.estimate.search._search", singular)
    with pytest.raises(WindsysidError, match="the filter diverged"):
        identify(driven.section(0.0, 20.0), verne555, loads="broadband")


def test_a_diverged_filter_is_one_clear_error():
    with pytest.raises(WindsysidError, match=r"the filter diverged: .* change the priors"):
        check_finite(np.array([1.0, np.nan]), np.eye(2))
    with pytest.raises(WindsysidError, match="the filter diverged"):
        check_finite(np.zeros(1), np.array([[np.inf]]))


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), 1e6, float("inf"), 0.01])
@pytest.mark.parametrize("which", ["stiffness", "damping"])
def test_an_absurd_prior_scale_is_refused(which, factor):
    with pytest.raises(ConfigurationError, match=f"prior scale of {which}: expected a factor between 0.05 and 20, got"):
        Prior(**{which: factor})


@pytest.mark.parametrize("spread", [0.0, -0.3, float("nan"), float("inf")])
def test_an_absurd_prior_spread_is_refused(spread):
    with pytest.raises(ConfigurationError, match="prior spread: expected a positive number"):
        Prior(spread=spread)


def test_a_moved_prior_reaches_back_to_the_reference(verne555):
    # One standard deviation at least, in the coordinates of the filter.
    for scale in (0.1, 0.5, 2.0, 10.0):
        for linear in (False, True):
            for q in Prior(scale, scale).parameters(verne555, identifiable(verne555), linear=linear):
                mean, std = q.prior
                reference = verne555.values[q.name]
                theta = np.log(reference / q.centre) if q.logarithmic else reference / q.scale
                assert q.centre == pytest.approx(scale * reference)
                assert abs(theta - mean) <= std * (1.0 + 1e-9)


def test_what_has_no_reference_is_not_identified():
    # Hammond's blades have no lag spring: nothing to centre a log-normal prior on.
    assert not any(name.startswith("k_beta") for name in identifiable(load_turbine("hammond")))


@pytest.mark.slow
def test_bands_hold_the_truth_as_often_as_they_say(verne555: Turbine):
    # 30 records × 10 coefficients from unbiased priors: rms of (estimate - truth)/σ. Its standard error for one
    # coefficient is 1/√60 = 0.13: bound at three of them.
    z = np.array([
        [(e.estimate - (e.reference or 0.0)) / e.std for e in front.identify(record, verne555, formulation="joint",
        prior=Prior(spread=1.0)).estimates]
        for record in (simulate_record(verne555, duration=60.0, rate=RATE, seed=seed) for seed in range(100, 130))
    ])  # fmt: skip
    assert np.all(np.sqrt(np.mean(z**2, axis=0)) < 1.4)
    assert np.mean(np.abs(z) < 2.0) > 0.92
