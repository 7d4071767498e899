"""Planning a measurement: closed forms, singular directions of real machines, and what identified values really
scatter."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from tests.identification.fits import identify_without_effects, std_of_model
from windsysid.errors import ConfigurationError
from windsysid.identification.estimate.scoring import information
from windsysid.identification.identify import identify
from windsysid.identification.model.prior import Prior, identifiable
from windsysid.identification.model.turbine_problem import pose
from windsysid.identification.planning import formulations as planned_ways
from windsysid.identification.planning.formulations import Planned
from windsysid.identification.planning.plan import Plan, plan
from windsysid.mechanics import RotorModel
from windsysid.output.progress import unheard
from windsysid.simulation.record import simulate_record
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine
from windsysid.units import spell


def one_mode(*, damping_ratio: float = 0.037, noise: float = 0.005, time_constant: float = 1.0) -> Turbine:
    """verne555 with everything locked but x: one mass on a spring and a damper, one accelerometer."""
    whole = load_turbine("verne555").exact()
    turbine = whole.with_model(RotorModel(3, y="locked", lag="locked"))
    critical = 2.0 * turbine.inertia("x") * turbine.natural_frequency("x")
    return replace(
        turbine.with_values({"c_x": damping_ratio * critical, "eccentricity": 0.0}),
        loads=(GaussMarkov("load_x", 15.0, time_constant),),
        sensors=(whole.sensors[0].model_copy(update={"noise": noise}),),
    )


# closed forms


@pytest.mark.parametrize(
    ("options", "rate"),
    [
        ({"time_constant": 0.01}, 100.0),  # a white load
        ({"time_constant": 10.0, "noise": 0.0005}, 50.0),  # a load whose corner lies far below the mode
        ({"time_constant": 0.2}, 400.0),  # more samples than the simulation needs
        pytest.param({"damping_ratio": 0.01}, 50.0, marks=pytest.mark.slow),
    ],
)
def test_one_mode_under_broadband_load_is_seen_as_well_as_the_closed_form_says(monkeypatch, options, rate):
    # σ_k/k = 2 √(ζ/ωT), σ_c/c = 1/√(ζωT). The simulated record renews its energy 400 times: σ is known to 2.5 %, bound
    # at three of them and 2 % for noise and the unknown load.
    monkeypatch.setattr(planned_ways, "SIMULATED_RELAXATIONS", 400.0)
    monkeypatch.setattr(planned_ways, "MAX_SIMULATED_SAMPLES", 400_000)
    turbine = one_mode(**options)
    found = plan(turbine, duration=600.0, rate=rate, seed=1)
    zeta, omega = options.get("damping_ratio", 0.037), turbine.natural_frequency("x")
    assert found.band("k_x") == pytest.approx(2.0 * 2.0 * math.sqrt(zeta / (omega * 600.0)), rel=0.095)
    assert found.band("c_x") == pytest.approx(2.0 / math.sqrt(zeta * omega * 600.0), rel=0.095)
    assert 0.02 < found.accuracy < 0.06


def test_a_short_record_holds_what_extrapolation_says(monkeypatch):
    # The information of 25 records of 20 s, each taken whole. The energy of one is renewed 8 times, so that their mean
    # scatters by 1/√200 = 7 %, the plan's own by 1/√400 = 5 %: bound at three times both together.
    monkeypatch.setattr(planned_ways, "SIMULATED_RELAXATIONS", 400.0)
    turbine = one_mode()
    found = plan(turbine, duration=20.0, rate=50.0)
    direct = []
    for seed in range(100, 125):
        problem = pose(simulate_record(turbine, duration=20.0, rate=50.0, seed=seed), turbine, turbine.sensors, Prior())
        at = problem.prior[0]
        fisher = information(problem.build, problem.inputs, problem.readings, at, np.full(len(at), 1e-4))[1]
        direct.append(np.diag(fisher)[:2] * [1.0, at[1] ** 2])  # the damper's coordinate is proportional
    np.testing.assert_allclose(np.diag(found.information(20.0))[:2], np.mean(direct, axis=0), rtol=0.26)


def test_the_band_falls_with_the_root_of_time_and_the_wish_is_met_when_it_says():
    found = plan(one_mode(), duration=120.0, rate=50.0, within=0.1)
    needed = found.needed("c_x")
    assert found.band("c_x", needed) == pytest.approx(0.1, rel=1e-6)
    assert found.band("c_x", 100.0 * needed) == pytest.approx(0.01, rel=0.01)
    assert found.verdict.startswith("no: not known within ±10 % (95 % interval) in 2 min: c_x (")
    row = found.to_dataframe().set_index("name").loc["c_x"]
    assert (row["band"], row["needed"]) == (found.band("c_x"), found.needed("c_x"))
    assert f"±10 % after {spell(needed, 2)}" in found.answer("c_x")
    assert found.answer("k_x").startswith("k_x: yes, ±")


def test_a_seed_repeats_a_plan_and_another_one_differs_as_much_as_is_said():
    turbine = one_mode()
    first, again, other = (plan(turbine, rate=50.0, seed=seed) for seed in (0, 0, 1))
    assert first.to_json() == again.to_json()
    assert first.band("c_x") != other.band("c_x")
    assert other.band("c_x") == pytest.approx(first.band("c_x"), rel=4.0 * math.sqrt(2.0) * first.accuracy)


# singular directions


def test_stiffness_and_mass_are_seen_only_up_to_a_common_factor():
    light = one_mode()
    light = light.with_values({f"blade_mass_{i}": 1e-9 for i in (1, 2, 3)} | {"hub_mass_x": light.inertia("x")})
    found = plan(light, rate=50.0, parameters=["k_x", "hub_mass_x"])
    assert found.directions == (
        "k_x, c_x, hub_mass_x and load_rms_x: only the proportion between them (not their common factor) is determined",
    )
    for name in ("k_x", "c_x", "hub_mass_x"):
        assert found.band(name) == found.needed(name) == math.inf
    assert found.answer("k_x") == "k_x: never; these sensors cannot observe it"
    assert found.verdict == "no: not known within ±20 % (95 % interval) in 10 min: k_x (never), hub_mass_x (never)"
    assert "nan" not in str(found)


def test_a_mass_beside_known_masses_moves_with_the_stiffness_in_its_own_proportion():
    # Blades of 7.5 kg move with a hub of 7 kg: 10 % of the hub is 4.8 % of what the spring carries.
    (sentence,) = plan(one_mode(), rate=50.0, parameters=["hub_mass_x"]).directions
    names = "k_x +4.8 %, c_x +4.8 %, hub_mass_x +10 % and load_rms_x +4.8 %"
    assert sentence == f"{names} together: no effect on the readings"


def test_a_damper_that_is_hardly_seen_is_mixed_up_with_the_mass_too():
    # In units of what is seen, the damper's share of the common factor is small where damping is small.
    found = plan(load_turbine("tower"), rate=10.0, parameters=["mass_side_side"])
    sentence, aerodynamic = found.directions
    assert aerodynamic.startswith("k_fore_aft and aerodynamics of k_fore_aft are correlated")
    assert sentence.startswith("k_side_side, c_side_side, mass_side_side")
    assert "only the proportion between them" in sentence
    assert found.band("c_side_side") == math.inf
    assert found.band("c_fore_aft") < 0.5


def test_what_does_not_move_a_sensor_is_never_seen():
    found = plan(one_mode(), rate=50.0, parameters=["c_x", "gravity"])
    assert found.directions == ("gravity is not determined by the data at all",)
    assert found.needed("gravity") == math.inf
    assert found.band("c_x") < 0.3


@pytest.fixture(scope="module")
def verne(verne555: Turbine) -> Plan:
    return plan(verne555, duration=100.0)


@pytest.mark.slow
def test_what_is_seen_while_the_filter_still_finds_the_state_is_said_to_be_seen_before(verne):
    assert verne.needed("k_beta_1") == verne.start_seconds
    assert verne.answer("k_beta_1").endswith(f"±20 % before {spell(verne.start_seconds, 2)}")
    assert str(verne).count("< ") == 5  # every stiffness


@pytest.mark.slow
def test_blades_without_a_sensor_are_seen_worse_through_the_hub(verne555, verne):
    fewer = plan(verne555, duration=100.0, sensors=verne555.sensors[:3])
    for i in (2, 3):
        assert 1.1 < fewer.band(f"c_beta_{i}") / verne.band(f"c_beta_{i}") < 3.0
    assert fewer.band("c_beta_1") == pytest.approx(verne.band("c_beta_1"), rel=0.3)


def test_a_degree_of_freedom_without_a_sensor_is_never_seen_and_the_plan_says_why(verne555):
    found = plan(verne555, sensors=verne555.sensors[:2], parameters=["c_x", "c_beta_1"])
    assert found.answer("c_beta_1") == "c_beta_1: never; no sensor responds to this degree of freedom"
    assert "c_beta_1 (never)" in found.verdict
    assert any("the blades are locked" in note for note in found.notes)
    assert found.band("c_x") < 0.2


@pytest.mark.slow
def test_the_scale_model_is_known_after_100_s_as_well_as_calibration_finds(verne):
    # README, 100 runs of 100 s: rms error 1.1 % in k_x and k_y, 0.48 to 0.51 % in k_β, 10.8 to 12.9 % in c, with priors
    # of 30 %, each of them known to 7 %; the plan to 6 %. Bounds: 25 % = 2.7 times both together.
    measured = {"k_x": 1.11, "k_y": 1.16, "k_beta_1": 0.50, "k_beta_2": 0.50, "k_beta_3": 0.50}
    for name, error in measured.items():
        assert 50.0 * verne.band(name) == pytest.approx(error, rel=0.25)
    for name in ("c_x", "c_y", "c_beta_1", "c_beta_2", "c_beta_3"):
        with_prior = 1.0 / math.sqrt((verne.band(name) / 2.0) ** -2 + 0.3**-2)
        assert 100.0 * with_prior == pytest.approx(11.8, rel=0.25)


def test_a_thinned_record_has_noise_of_the_same_spectral_density():
    # σ²/rate per hertz: a quarter of the samples, each with half the noise.
    turbine = one_mode()
    planned = Planned(turbine, ("k_x", "c_x"), 100.0, 20.0, 1.0, 5.0, 4, 0, unheard)
    problem = planned_ways._simulated(planned, 20.0)
    assert [s.noise**2 / 25.0 for s in problem.sensors] == pytest.approx([s.noise**2 / 100.0 for s in turbine.sensors])


@pytest.mark.slow
def test_a_plan_for_a_tower_holds_the_bands_that_spectra_will_have():
    """`auto` takes spectra of a tower, and filters' bands are narrower than theirs, by 30 % fore and aft. What data and
    rival explanations add is not planned."""
    tower = load_turbine("tower").exact()
    found = plan(tower, duration=600.0, rate=20.0, seed=50)
    records = [simulate_record(tower, duration=600.0, rate=20.0, seed=seed) for seed in range(60, 63)]
    results = [identify_without_effects(record, tower, formulation="spectral") for record in records]
    for name in ("k_side_side", "k_fore_aft"):
        bands = [2.0 * std_of_model(result, name) / result[name].estimate for result in results]
        assert found.band(name) == pytest.approx(float(np.median(bands)), rel=0.25)
    filters = plan(tower, duration=600.0, rate=20.0, seed=50, formulation="joint")
    assert filters.band("k_fore_aft") < 0.85 * found.band("k_fore_aft")
    assert "by spectra" in " ".join(found.notes)
    assert "by filters" in " ".join(filters.notes)


@pytest.mark.slow
def test_a_plan_for_a_rotor_in_wind_knows_what_bands_leave_out():
    """Filters would tell the roll's stiffness ten times better than bands do."""
    turbine = load_turbine("nrel5mw_full").exact()
    record = simulate_record(turbine, duration=540.0, rate=25.0, seed=7, loads="rotor-wind")
    result = identify(record, turbine, formulation="spectral")
    found = plan(turbine, duration=540.0, rate=25.0, formulation="spectral")
    for name in ("k_x", "k_roll", "k_beta_1"):
        assert found.band(name) == pytest.approx(2.0 * result[name].std / result[name].estimate, rel=0.4)
    assert found.band("k_roll") > 0.03


@pytest.mark.slow
def test_what_is_known_in_time_is_not_said_to_be_known_never(monkeypatch):
    """Tolerances limit stiffness for ever; after ten years their directions were rounded away, bands infinite."""
    monkeypatch.setattr(planned_ways, "MAX_SIMULATED_SAMPLES", 10_000)
    found = plan("nrel5mw_full", duration=540.0, rate=25.0, formulation="joint")
    for name in found.asked:
        assert (found.band(name) <= found.within) == (found.needed(name) <= found.duration)


@pytest.mark.slow
def test_a_record_too_short_for_spectra_is_planned_for_filters_and_a_longer_one_is_not_doubted():
    short = plan("tower", duration=60.0, rate=20.0)
    assert "by filters" in " ".join(short.notes)
    spectra = plan("tower", duration=200.0, rate=20.0, formulation="spectral")
    assert "would not be trusted" not in " ".join(spectra.notes)


@pytest.mark.slow
def test_identified_values_scatter_as_planned(verne555):
    # 20 records × 10 coefficients, priors too wide to matter. The scatter of 20 values is known to 16 %, pooled over
    # ten nearly independent coefficients to 5 %, the plan to 6 %: bounds at three standard errors.
    predicted = plan(verne555, duration=60.0, seed=1000)
    names = identifiable(verne555)
    errors = []
    for seed in range(20):
        found = identify(
            simulate_record(verne555, duration=60.0, rate=100.0, seed=seed), verne555, prior=Prior(spread=1.0)
        )
        errors.append([found[name].estimate / verne555.values[name] - 1.0 for name in names])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / [predicted.band(name) / 2.0 for name in names]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.24)
    np.testing.assert_allclose(ratio, 1.0, atol=0.55)


# options


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"duration": 0.1}, "duration: expected one revolution .* to ten years, got 0.1 s"),
        ({"duration": math.nan}, "duration: expected"),
        ({"rate": 5.0}, "rate: expected at least .* samples per second"),
        ({"rate": -1.0}, "rate: expected a positive number"),
        ({"within": 0.0}, "within: expected a positive number"),
        ({"load_scale": math.inf}, "load scale: expected a positive number"),
        ({"rotor_speed": -1.0}, "rotor speed: expected a number from 0"),
        ({"sensors": ()}, "the sensor list is empty: expected at least one"),
        ({"parameters": ["k_z"]}, "parameter 'k_z' cannot be identified here: expected some of"),
        ({"parameters": ["k_beta_1"]}, "parameter 'k_beta_1' cannot be identified here"),
        ({"parameters": []}, "parameters: expected at least one name"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(options, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        plan(one_mode(), **options)


def test_loads_and_rotor_speed_are_as_planned():
    turbine = one_mode(noise=2.0)
    usual, louder = (plan(turbine, rate=50.0, load_scale=scale) for scale in (1.0, 10.0))
    assert louder.band("c_x") < 0.8 * usual.band("c_x")  # the louder, the less the noise matters
    assert plan(turbine, rate=50.0, rotor_speed=3.0).rotor_speed == 3.0
    parked = plan(load_turbine("tower"), rate=4.0, duration=600.0, rotor_speed=0.0, formulation="spectral")
    assert not [one for one in parked.tolerances if one.group == "aerodynamics"]  # air stiffens under a rotor


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (2.9449, "2.94 s"),
        (100.0, "100 s"),
        (600.0, "10 min"),
        (9000.0, "2.5 h"),
        (864000.0, "10 d"),
        (math.inf, "never"),
    ],
)
def test_durations_are_spelt_out(seconds, words):
    assert spell(seconds) == words


# the command line


def test_the_command_answers_and_writes_its_report(run, tmp_path, monkeypatch):
    monkeypatch.setattr(planned_ways, "MAX_SIMULATED_SAMPLES", 4_000)
    options = (
        "--duration",
        "100 s",
        "--parameters",
        "c_x,k_x",
        "--rate",
        "50",
        "--rotor-speed",
        "60 rpm",
        "--load-scale",
        "2",
    )
    code, out, err = run("plan", "--turbine", "verne555", *options, "--output", tmp_path / "plan")
    assert (code, err) == (0, [])
    for words in (
        "No: not known within ±20 % (95 % interval) in 100 s: c_x (",
        "c_x: no, ±",
        "k_x: yes, ±",
        "c_beta_3",
        "results: ",
    ):
        assert words in out, words
    assert sorted(path.name for path in (tmp_path / "plan").glob("[!.]*")) == [
        "answer.json",
        "plan.png",
        "report.html",
        "summary.json",
    ]
    summary = json.loads((tmp_path / "plan" / "summary.json").read_text(encoding="utf-8"))
    assert summary["rotor_speed_rad_s"] == pytest.approx(2.0 * math.pi)
    assert 15.0 < summary["parameters"]["c_x"]["two_sigma_percent"] < 35.0
    html = (tmp_path / "plan" / "report.html").read_text(encoding="utf-8")
    assert 'class="plot"' in html
    code, _, (line,) = run("plan", "--turbine", "verne555", *options, "--output", tmp_path / "plan")
    assert code == 2
    assert "already there" in line


def test_the_summary_as_json_is_all_that_is_printed(run, tmp_path, monkeypatch):
    monkeypatch.setattr(planned_ways, "MAX_SIMULATED_SAMPLES", 4_000)
    sensor = '[[sensor]]\nchannel="a"\nquantity="acceleration"\npoint="tower"\naxis="x"\nnoise=0.05\n'
    (tmp_path / "sensors.toml").write_text(sensor)
    code, out, err = run(
        "plan", "--turbine", "verne555", "--sensors", tmp_path / "sensors.toml", "--rate", "50", "--json"
    )
    assert (code, err) == (0, [])
    summary = json.loads(out)
    assert list(summary["parameters"]) == [
        "k_x",
        "c_x",
        "k_y",
        "c_y",
        *(f"{k}_beta_{i}" for i in (1, 2, 3) for k in "kc"),
    ]
    assert summary["parameters"]["c_beta_1"]["needed_s"] is None
    assert summary["sensors"] == ["a"]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (
            ("--duration", "10"),
            "--duration: the unit is missing: write it behind the number, such as \"10 s\"; got '10'",
        ),
        (("--duration", "ten min"), "--duration: expected a number and a unit"),
        (("--duration", "10 kg"), "--duration: expected a unit of the same quantity as s; got '10 kg'"),
        (("--duration", "inf s"), "--duration: expected a finite number"),
        (("--duration", "0.1 s"), "duration: expected one revolution"),
        (("--rotor-speed", "12"), '--rotor-speed: the unit is missing: write it behind the number, such as "12 rpm"'),
        (("--parameters", "k_z"), "parameter 'k_z' cannot be identified here"),
        (("--parameters", ""), "parameter '' cannot be identified here"),
        (("--within", "nan"), "within: expected a percentage above 0"),
        (("--rate", "1"), "rate: expected at least"),
        (("--sensors", "nowhere.toml"), "nowhere.toml: no such file, expected a TOML file"),
    ],
)
def test_a_bad_option_is_refused_in_one_line(run, options, complaint):
    code, out, lines = run("plan", "--turbine", "verne555", *options)
    assert (code, out, len(lines)) == (2, "", 1)
    assert re.search(complaint, lines[0]), lines[0]


def test_an_empty_sensor_list_is_refused_in_one_line(run, tmp_path):
    (tmp_path / "none.toml").write_text("sensor = []\n")
    code, out, (line,) = run("plan", "--turbine", "verne555", "--sensors", tmp_path / "none.toml")
    assert (code, out) == (2, "")
    assert "the sensor list is empty: expected at least one sensor" in line
