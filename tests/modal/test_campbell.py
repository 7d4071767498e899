"""The Campbell diagram against closed forms: margins, crossings, bands, ranges of instability, ground resonance."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from windsysid.errors import ConfigurationError
from windsysid.identification.identify import identify
from windsysid.mechanics import RotorModel, compile_model
from windsysid.modal.analysis import analyse, analyse_unlocked, directions_of, modes_with_slopes
from windsysid.modal.campbell import Campbell, Margin
from windsysid.modal.stability import meeting_speed, unstable_ranges
from windsysid.modal.sweep import find_modes
from windsysid.results.posterior import Posterior, load_posterior
from windsysid.simulation.record import simulate_record
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

pytestmark = pytest.mark.usefixtures("without_effects")


RPM = 30.0 / math.pi


def uncertain(turbine: Turbine, **relative: float) -> Posterior:
    """A turbine whose coefficients are known to some relative standard deviations."""
    names = list(relative)
    parameters = tuple(
        (
            Parameter(n, turbine.values[n], 0.3)
            if n.startswith("k_")
            else Parameter(n, turbine.values[n], 0.3, False, turbine.values[n])
        )
        for n in names
    )
    theta = np.array([q.coordinate(turbine.values[q.name]) for q in parameters])
    return Posterior(turbine, parameters, theta, np.diag([relative[n] ** 2 for n in names]), "a record", True)


@pytest.fixture(scope="module")
def tower(verne555: Turbine) -> Turbine:
    """One mass on one spring: f = √(k/m) / 2π whatever the rotor speed."""
    alone = RotorModel(3, y="locked", lag="locked")
    return verne555.with_model(alone).with_values(
        {"eccentricity": 0.0, "k_x": 14.5 * (2 * math.pi) ** 2, "c_x": 2.0}
    )  # 1 Hz


def margin(found: Campbell, order: int) -> Margin:
    (one,) = [m for m in found.margins if m.order == order]
    return one


def test_the_distance_from_a_harmonic_is_least_at_the_end_of_the_range_and_its_band_is_the_frequencys(tower: Turbine):
    found = find_modes(uncertain(tower, k_x=0.02), operating=(30 / RPM, 45 / RPM))
    near = margin(found, 1)  # 1P is 0.5 … 0.75 Hz, the mode 1 Hz ± 2 · 1 %
    assert near.distance == pytest.approx((1 / 0.75 - 1, 0.98 / 0.75 - 1, 1.02 / 0.75 - 1), rel=1e-6)
    assert near.speed[0] == pytest.approx(45 / RPM)
    assert near.certain
    assert not near.crosses
    assert margin(found, 3).distance[0] == pytest.approx(1 / 1.5 - 1)
    assert found.sentences[0] == (
        "No mode crosses 1P, 3P or 6P from 30 to 45 rpm: the nearest is tower x, 33.3 ± 1.3 % below 3P at 30 rpm."
        if abs(margin(found, 3).distance[0]) < abs(near.distance[0])
        else "No mode crosses 1P, 3P or 6P from 30 to 45 rpm: the nearest is tower x, 33.3 ± 2.7 % above 1P at 45 rpm."
    )


def test_a_crossing_is_found_where_the_harmonic_meets_the_mode_with_the_band_of_its_speed(tower: Turbine):
    found = find_modes(uncertain(tower, k_x=0.02), operating=(50 / RPM, 71 / RPM))
    met = margin(found, 1)
    assert met.crosses
    assert tuple(value * RPM for value in met.speed) == pytest.approx((60.0, 58.8, 61.2), rel=1e-6)
    assert found.sentences[0] == "Resonance from 50 to 71 rpm: tower x meets 1P at 60.0 ± 1.2 rpm."
    assert not margin(find_modes(uncertain(tower, k_x=0.02), operating=(40 / RPM, 59.5 / RPM)), 1).certain


@pytest.mark.slow
def test_bands_are_the_scatter_of_the_modes_over_the_posterior(verne555: Turbine):
    # Floquet's theory in both: the delta method against modes of turbines drawn from the posterior.
    posterior = uncertain(verne555, k_x=0.01, c_x=0.1, k_beta_1=0.01, k_beta_2=0.01, c_beta_3=0.2)
    found = find_modes(posterior, speeds=(verne555.rotor_speed, verne555.rotor_speed), operating=(7.0, 7.5))
    model = compile_model(verne555.model)
    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(100):
        theta = posterior.theta + np.sqrt(np.diag(posterior.cov)) * rng.normal(size=5)
        values = {q.name: float(q.physical(t)) for q, t in zip(posterior.parameters, theta, strict=True)}
        turbine = verne555.with_values(values)
        s = analyse(
            verne555.model, model, np.array([turbine.values[n] for n in model.parameters]), verne555.rotor_speed
        )
        drawn.append([s.frequency, s.damping])
    i = found.usual
    for row, key in enumerate(("frequency_std", "damping_std")):
        ours = np.array([getattr(curve, key)[i] for curve in found.curves])
        # the standard deviation of 100 draws scatters by 7 %: three of that
        np.testing.assert_allclose(ours, np.std(drawn, axis=0)[row], rtol=0.21)


def test_curves_stay_with_their_mode_where_others_cross_them(verne555: Turbine):
    # On a stiff support: collective f, whirling f ∓ Ω, of one colour each; 2Ω > f from 180 rpm on, where orders change.
    stiff = verne555.with_model(RotorModel(3, x="locked", y="locked")).with_values(
        {"gravity": 0.0, "eccentricity": 0.0}
    )
    found = find_modes(stiff, speeds=(0.0, 200 / RPM))
    collective, backward, forward = (
        next(c for c in found.curves if c.name == f"lag {name}") for name in ("collective", "backward", "forward")
    )
    alone = np.array([replace(stiff, rotor_speed=s).natural_frequency("beta_1") for s in found.speeds])
    decay = stiff.values["c_beta_1"] / (2 * stiff.values["blade_inertia_1"])
    for curve, shift in ((collective, 0.0), (backward, -1.0), (forward, 1.0)):
        turned = np.hypot(np.sqrt(alone**2 - decay**2) + shift * found.speeds, decay) / (2 * math.pi)
        np.testing.assert_allclose(curve.frequency, turned, rtol=1e-9)


def test_unstable_ranges_are_found_to_the_resolution_even_between_the_speeds():
    def growth(speed: float) -> float:
        return max((speed - 3.0) * (7.0 - speed), 1e-3 - (speed - 11.5) ** 2, -5.0)

    wide, narrow = unstable_ranges(growth, np.arange(0.0, 15.0), resolution=1e-4)
    assert (wide.low, wide.high, wide.worst) == pytest.approx((3.0, 7.0, 5.0), abs=1e-3)
    assert wide.growth == pytest.approx(4.0, abs=1e-6)
    assert (narrow.low, narrow.high) == pytest.approx((11.5 - math.sqrt(1e-3), 11.5 + math.sqrt(1e-3)), abs=1e-3)
    assert unstable_ranges(lambda speed: -1.0 - speed, np.arange(5.0)) == []
    assert unstable_ranges(lambda speed: 0.0, np.arange(5.0)) == []  # neither grows nor decays


@pytest.mark.parametrize("name", ["verne555", "hammond", "nrel5mw"])
def test_lag_and_support_meet_where_the_uncoupled_frequencies_do(name: str):
    turbine = load_turbine(name)

    def apart(speed: float) -> float:
        turning = replace(turbine, rotor_speed=speed)
        return speed - turning.natural_frequency("beta_1") - turning.natural_frequency("x")

    assert meeting_speed(turbine, "x") == pytest.approx(brentq(apart, 0.0, 500.0), rel=1e-9)


def test_ground_resonance_is_told_with_its_distance_and_band(verne555: Turbine):
    found = find_modes(uncertain(verne555, k_x=0.02, k_beta_1=0.02))
    x, y = found.ground_resonance
    assert (x.support, y.support) == ("x", "y")
    assert x.growing
    assert x.margin[0] == pytest.approx(x.speed[0] / found.operating[1] - 1.0)
    # Ω = ω_s + ω_β(Ω), ω_s by half of k_x's 2 %, ω_β by a sixth of k_β1's (a third of the mean, half of it as a root),
    # Ω′ being 1/(1 − ν²Ω/ω_β)
    v, Omega = verne555.values, x.speed[0]
    lag = replace(verne555, rotor_speed=Omega).natural_frequency("beta_1")
    steeper = 1.0 - v["blade_first_moment_1"] * v["hinge_offset"] * Omega / (v["blade_inertia_1"] * lag)
    parts = (0.5 * verne555.natural_frequency("x"), 0.5 / 3.0 * v["k_beta_1"] / (v["blade_inertia_1"] * lag))
    expected = 0.02 * math.hypot(*parts) / steeper
    assert (x.speed[2] - x.speed[0]) / 2.0 == pytest.approx(expected, rel=1e-4)


def test_an_unstable_range_is_told(verne555: Turbine):
    found = find_modes(verne555, speeds=(300 / RPM, 420 / RPM), operating=(300 / RPM, 420 / RPM))
    (range_,) = found.unstable
    assert found.sentences[1].startswith(
        f"Unstable between 300 and 420 rpm: {range_.low * RPM:.1f} … {range_.high * RPM:.1f} rpm"
    )
    assert found.ground_resonance[0].margin == (0.0, 0.0, 0.0)


@pytest.mark.slow
def test_a_saved_result_gives_the_bands_of_the_one_in_memory(tmp_path: Path, verne555: Turbine):
    made = simulate_record(verne555, duration=20.0, rate=60.0, seed=2)
    result = identify(made, verne555, formulation="joint", loads="broadband")
    result.save(tmp_path)
    loaded = load_posterior(tmp_path)
    assert loaded.turbine.rotor_speed == pytest.approx(verne555.rotor_speed)
    kept = result.posterior
    assert loaded.turbine.values == pytest.approx(kept.turbine.values, rel=1e-12)
    assert [q.physical(t) for q, t in zip(loaded.parameters, loaded.theta, strict=True)] == pytest.approx(
        [e.estimate for e in result.estimates]
    )
    np.testing.assert_array_equal(loaded.cov, kept.cov)
    found = find_modes(loaded, speeds=(7.1, 7.4), operating=(7.2, 7.3))
    assert len(found.curves) == len(result.modes)
    for curve, mode in zip(found.curves, result.modes, strict=True):
        # (seed 2 has tower x within a hair of 1.5P, where Floquet's theory holds it: both step aside)
        assert curve.name == mode.name
        for (_, ours), (_, theirs) in zip(curve.at(found.usual).quantities, mode.quantities, strict=True):
            assert ours.estimate == pytest.approx(theirs.estimate, rel=1e-6)
            # a mode's interval is widened by what contradicts the mode, a posterior's by what contradicts coefficients
            assert ours.std == pytest.approx(theirs.std, rel=0.1)


@pytest.mark.parametrize(("name", "values"), [("verne555", {}), ("nrel5mw", {}), ("nrel5mw", {"k_beta_2": 1.01})])
def test_an_identification_and_the_diagram_give_one_answer_however_narrow_the_bands(
    name: str, values: dict[str, float]
):
    # Posteriors as narrow as a free decay's: stiffness to 1e-5, damping to 1e-3. At every speed the diagram has
    # Floquet's theory, which test_modal.py holds against SciPy's integrator.
    turbine = load_turbine(name)
    turbine = turbine.with_values({key: factor * turbine.values[key] for key, factor in values.items()})
    names = [n for n in turbine.model.coefficients if turbine.values[n] != 0.0]
    posterior = uncertain(turbine, **{n: 1e-5 if n.startswith("k_") else 1e-3 for n in names})
    model, cov = compile_model(turbine.model), posterior.cov
    p = np.array([turbine.values[n] for n in model.parameters])
    known = (turbine.rotor_speed, posterior.parameters, posterior.theta, cov)
    printed, _ = modes_with_slopes(turbine.model, model, p, *known)
    along = directions_of(model, posterior.parameters, posterior.theta)
    floquet = analyse(turbine.model, model, p, turbine.rotor_speed, along, method="Floquet")
    assert floquet.names == tuple(mode.name for mode in printed)
    values_of = (floquet.frequency, floquet.damping)
    for which, slopes in enumerate(floquet.frequency_and_damping_slopes()):
        sigma = np.sqrt(np.einsum("mi,ij,mj->m", slopes, cov, slopes))
        assert np.all(sigma < 2e-3 * values_of[which])
        ours = [mode.quantities[which][1] for mode in printed]
        np.testing.assert_allclose(([one.estimate for one in ours] - values_of[which]) / sigma, 0.0, atol=0.1)
        np.testing.assert_allclose([one.std for one in ours] / sigma, 1.0, atol=0.01)


def test_a_turn_too_slow_for_floquet_still_has_modes_in_an_identification(verne555: Turbine):
    # An idling rotor, 0.001 rpm: the diagram leaves it out at once, and the average over a turn is a standing rotor's
    # but for gravity.
    posterior = uncertain(verne555, k_x=1e-2)
    model = compile_model(verne555.model)
    p = np.array([verne555.values[n] for n in model.parameters])
    known = (posterior.parameters, posterior.theta, posterior.cov)
    idling, standing = (modes_with_slopes(verne555.model, model, p, speed, *known)[0] for speed in (1e-3 / RPM, 0.0))
    assert [mode.name for mode in idling if mode.name.startswith("tower")] == ["tower y", "tower x"]
    assert idling[0].frequency.estimate == pytest.approx(standing[0].frequency.estimate, rel=1e-4)
    with pytest.raises(ConfigurationError, match="too slow a turn for Floquet's theory"):
        analyse(verne555.model, model, p, 1e-3 / RPM)


def test_stepping_aside_from_a_lock_does_not_move_the_other_modes():
    # One mode of verne555 is put on 1.5P by its spring, where it is held. A whirl goes with the speed, so that stepping
    # to one side by 1e-3 would move it by 1e-3 Ω; the others hardly know of the mode that is held.
    turbine = load_turbine("verne555").with_values({"c_x": 0.01})
    model = compile_model(turbine.model)

    def at(k_x: float) -> np.ndarray:
        values = dict(turbine.values) | {"k_x": k_x}
        return np.array([values[n] for n in model.parameters])

    speed = turbine.rotor_speed

    def off(k_x: float) -> float:
        found = analyse(turbine.model, model, at(k_x), speed, method="Coleman")
        return float(found.exponents[found.names.index("tower x")].imag) / speed - 1.5

    k = brentq(off, 0.9 * turbine.values["k_x"], 1.2 * turbine.values["k_x"])
    candidates = k * (1.0 + np.linspace(-2e-5, 2e-5, 41))
    held = next((value for value in candidates if analyse(turbine.model, model, at(value), speed).locked), None)
    assert held is not None
    beside = analyse_unlocked(turbine.model, model, at(held), speed)
    softer, stiffer = (analyse(turbine.model, model, at(held * factor), speed) for factor in (0.998, 1.002))
    assert not any(s.locked for s in (beside, softer, stiffer))
    for name in ("lag backward", "lag collective", "lag forward"):
        a, low, high = (float(s.frequency[s.names.index(name)]) for s in (beside, softer, stiffer))
        assert a == pytest.approx(0.5 * (low + high), rel=1e-5), name


@pytest.mark.slow
def test_speeds_too_slow_for_a_mode_are_left_out_and_said():
    hammond = load_turbine("hammond").with_values({"c_beta_1": 0.0})
    found = find_modes(hammond, speeds=(2 / RPM, 80 / RPM), operating=(60 / RPM, 80 / RPM))
    assert found.speeds[0] * RPM > 5.0
    assert any(re.match(r"left out, \d+ speeds up to .* rpm: a vibration dies out", note) for note in found.notes)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (
            {"speeds": (2.0, 1.0)},
            r"speeds: expected two rotor speeds from 0 on, the lower first, got 19.1 and 9.549 rpm",
        ),
        ({"operating": (-1.0, 1.0)}, "operating range: expected two rotor speeds"),
        ({"operating": (0.0, math.nan)}, "operating range: expected two rotor speeds"),
    ],
)
def test_what_is_no_range_of_speeds_is_refused(
    verne555: Turbine, options: dict[str, tuple[float, float]], complaint: str
):
    with pytest.raises(ConfigurationError, match=complaint):
        find_modes(verne555, **options)  # type: ignore[arg-type]


# the command line


def test_the_command_answers_and_writes_its_report(run, tmp_path):
    options = ("--speeds", "5 rpm", "20 rpm", "--operating", "9 rpm", "12.1 rpm")
    code, out, err = run("modes", "--turbine", "nrel5mw", *options, "--output", tmp_path / "modes")
    assert (code, err) == (0, [])
    for words in (
        "Resonance from 9 to 12.1 rpm: lag backward meets 6P at",
        "Every mode is damped",
        "Ground resonance",
        "results: ",
    ):
        assert words in out, words
    assert sorted(path.name for path in (tmp_path / "modes").glob("[!.]*")) == [
        "answer.json",
        "modes.csv",
        "report.html",
        "summary.json",
    ]
    summary = json.loads((tmp_path / "modes" / "summary.json").read_text(encoding="utf-8"))
    assert summary["operating_range_rpm"] == pytest.approx([9.0, 12.1])
    assert summary["modes"]["tower x"]["frequency"]["estimate"] == pytest.approx(0.3155, rel=2e-4)
    page = (tmp_path / "modes" / "report.html").read_text(encoding="utf-8")
    assert "data:image" not in page
    assert page.count('<figure class="plot"><figcaption>') == 2
    code, _, (line,) = run("modes", "--turbine", "nrel5mw", "--output", tmp_path / "modes")
    assert code == 2
    assert "already there" in line


def test_the_summary_as_json_is_all_that_is_printed(run):
    code, out, err = run("modes", "--turbine", "tower", "--json")
    assert (code, err) == (0, [])
    assert json.loads(out)["method"] == "constant"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("nowhere",),
         "nowhere: no such folder, expected a result of windsysid identify; check the name and the folder"),
        (("--turbine", "verne555", "--speeds", "2", "3 rpm"),
         "--speeds: the unit is missing: write it behind the number, such as \"2 rpm\"; got '2'"),
        (("--turbine", "verne555", "--operating", "2 rpm", "3 kg"),
         "--operating: expected a unit of the same quantity as rad/s; got '3 kg'"),
        (("--turbine", "verne555", "--speeds", "3 rpm", "2 rpm"),
         "speeds: expected two rotor speeds from 0 on, the lower first, got 3 and 2 rpm"),
        (("src",), "src: expected a result of windsysid identify, got no result in it: check"),
    ],
)  # fmt: skip
def test_a_bad_option_is_refused_in_one_line(run, arguments, complaint, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "src").mkdir()
    code, out, lines = run("modes", *arguments)
    assert (code, out, len(lines)) == (2, "", 1)
    assert complaint in lines[0]
