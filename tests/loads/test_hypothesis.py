"""The family of load models: what each takes the loads for."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.optimize import least_squares

from windsysid.errors import ConfigurationError
from windsysid.loads.family import candidates, hypothesis
from windsysid.loads.hypothesis import HYPOTHESES, SupposedLoads
from windsysid.mechanics import RotorModel
from windsysid.simulation.wind import BladeAerodynamics, coherence, kaimal_spectrum, packaged_wind
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.process import PlacedProcess
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

Array = np.ndarray


def given(model: SupposedLoads, **values: float) -> Sequence[LoadModel]:
    """The blocks at given values, some of them changed."""
    return model.blocks({s.name: s.given for s in model.statistics} | values)


def output(block: LoadModel, name: str, psi: float) -> Array:
    """H(ψ) of one load (n,)."""
    if name not in block.outputs:
        return np.zeros(len(block.states))
    rows = block.outputs[name]
    k = np.arange(1, (len(rows) + 1) // 2)
    return np.asarray(rows[0] + np.cos(k * psi) @ rows[1::2] + np.sin(k * psi) @ rows[2::2])


def covariance(blocks: Sequence[LoadModel], names: Sequence[str], psi: float) -> Array:
    """Covariance of the loads at an azimuth."""
    total = np.zeros((len(names),) * 2)
    for block in blocks:
        H = np.array([output(block, name, psi) for name in names])
        total += H @ block.cov @ H.T
    return total


def test_broadband_is_the_turbine_file(verne555: Turbine):
    model = hypothesis("broadband", verne555, verne555.loads)
    assert given(model) == verne555.loads
    assert model.turbine is verne555
    levels = [f"load_rms_{name}" for name in ("x", "y", "beta_1", "beta_2", "beta_3")]
    assert [s.name for s in model.statistics] == [*levels, "load_time_constant"]


def test_second_order_loads_are_as_loud_as_the_file_says(verne555: Turbine):
    model = hypothesis("second-order", verne555, verne555.loads)
    for psi in (0.0, 1.0):
        cov = covariance(given(model, load_frequency=3.0), verne555.model.loads, psi)
        np.testing.assert_allclose(cov, 225.0 * np.eye(5), rtol=1e-12)


def test_wind_is_the_same_for_every_blade_at_every_azimuth_and_isotropic_on_the_hub(verne555: Turbine):
    model = hypothesis("rotor-wind", verne555, verne555.loads)
    covs = [covariance(given(model), verne555.model.loads, psi) for psi in (0.0, 0.5, 2.2)]
    expected = 15.0**2 + 4.5**2  # harmonics and eddies
    for cov in covs:
        np.testing.assert_allclose(np.diag(cov)[2:], expected, rtol=1e-12)
        np.testing.assert_allclose(cov[2:, 2:], covs[0][2:, 2:], rtol=1e-12)
        np.testing.assert_allclose(cov[0, 0], cov[1, 1], rtol=1e-12)
        assert cov[0, 1] == pytest.approx(0.0, abs=1e-12 * cov[0, 0])
    correlation = covs[0][2, 3] / expected
    assert 0.1 < correlation < 0.9  # one gust is wider than a blade


def test_hub_forces_are_the_blades_moments_over_the_lever(verne555: Turbine):
    # Without what the hub feels alone, both hub loads follow from the three moments, term by term.
    model = hypothesis("rotor-wind", verne555, verne555.loads)
    whole = given(model, load_rms_hub=1e-9, load_hub_share=1e-9, load_lever=1.6)
    for m, psi in product((0, 1, 2, 5, 7), (0.3, 1.9)):
        blocks = [block for block in whole if block.states[0].startswith(f"wind_{m}P")]
        cov = covariance(blocks, verne555.model.loads, psi)
        theta = psi + 2.0 * np.pi * np.arange(3) / 3.0
        to_hub = np.array([-np.sin(theta), np.cos(theta)]) / (1.6 * LEVERS[m])
        np.testing.assert_allclose(cov[:2, 2:], to_hub @ cov[2:, 2:], atol=1e-6 * np.abs(cov).max())
        np.testing.assert_allclose(cov[:2, :2], to_hub @ cov[2:, 2:] @ to_hub.T, atol=1e-6 * np.abs(cov).max())


LEVERS = {0: 0.88, 1: 0.94, 2: 1.0, 4: 1.08, 5: 1.11, 7: 1.14}
"""ℓ_m / ℓ."""


def test_the_smaller_the_eddies_the_further_out_they_push(verne555: Turbine):
    # Single eddies push where the last term does.
    model = hypothesis("rotor-wind", verne555, verne555.loads)
    blocks = {block.states[0]: block for block in given(model, load_lever=1.6)}
    levers = {m: 1.6 * LEVERS[m] for m in (1, 2, 4, 5, 7)}
    for psi in (0.3, 1.9):
        theta = psi + 2.0 * np.pi * np.arange(3) / 3.0
        tangents = np.array([-np.sin(theta), np.cos(theta)])
        for m, lever in levers.items():
            value = blocks[f"wind_{m}P_0"].process.value  # type: ignore[attr-defined]
            forces = np.array([np.cos(m * theta), np.sin(m * theta)]) / lever
            for block, c in ((blocks[f"wind_{m}P_0"], value), (blocks[f"hub_{m}P"], 1.0)):
                hub = np.array([output(block, name, psi) for name in ("load_x", "load_y")])
                np.testing.assert_allclose(hub, np.kron(tangents @ forces.T, c), atol=1e-6)
        for i in (1, 2, 3):
            block = blocks[f"eddies_{i}_0"]
            moment = output(block, f"load_beta_{i}", psi)
            hub = np.array([output(block, name, psi) for name in ("load_x", "load_y")])
            np.testing.assert_allclose(hub, np.outer(tangents[:, i - 1], moment) / levers[7], rtol=1e-6)


def blade_spectra(name: str, frequency: Array) -> tuple[Array, Array, Array]:
    """Spectra of the terms m = 0 … 7 of a blade's moment, of the force beside it and of the force that it tells, by
    quadrature.

    The wind is Kaimal's with the IEC's coherence.
    """
    turbine = load_turbine(name)
    wind, blade = packaged_wind(name)
    radii = np.array(blade.radii)
    levers = radii - turbine.values["hinge_offset"] if blade.levers is None else np.array(blade.levers)
    along, across, gust = turbine.rotor_speed * radii, (1.0 - blade.induction) * wind.speed, 1e-3
    faster, slower = (blade_force_per_metre(blade, across + step, along) for step in (gust, -gust))
    force = (faster - slower) / (2.0 * gust) * np.array(blade.widths)
    angle = (np.arange(512) + 0.5) * np.pi / 512
    product = radii[:, None, None] * radii[None, :, None]
    apart = np.sqrt((radii[:, None, None] - radii[None, :, None]) ** 2 + 4.0 * product * np.sin(0.5 * angle) ** 2)
    moment, rest, told = np.empty((3, 8, len(frequency)))
    for k, f in enumerate(frequency):
        together = coherence(f, apart, wind) * kaimal_spectrum(f, wind)
        for m in range(8):
            share = np.mean(together * np.cos(m * angle), axis=2)
            of_moment, cross, of_force = (a @ share @ b for a, b in
                                          ((force * levers, force * levers), (force * levers, force),
                                          (force, force)))  # fmt: skip
            told[m, k] = cross**2 / of_moment
            moment[m, k], rest[m, k] = of_moment, of_force - told[m, k]
    for spectrum in (moment, rest, told):
        spectrum[1:] *= 2.0
    return moment, rest, told


def blade_force_per_metre(blade: BladeAerodynamics, across: float, along: Array) -> Array:
    """Quasi-steady, in the plane of the rotor, linear lift (docs/wind.md)."""
    twist = np.deg2rad(np.array(blade.twists_deg) + blade.pitch_deg + blade.zero_lift_deg)
    lift = blade.lift_slope * (np.arctan2(across, along) - twist)
    drag = blade.drag + blade.drag_factor * lift**2
    pressure = 0.5 * blade.density * np.array(blade.chords) * np.hypot(across, along)
    return np.asarray(pressure * (lift * across - drag * along))


@pytest.mark.parametrize("name", ["verne555", "nrel5mw"])
def test_one_corner_and_one_level_describe_the_forces_of_a_whole_blade(name: str):
    # Three and four stations from root to tip, thirty times apart in size: the same shape serves. The spectra fall by
    # a factor of 40 to 4000 between 0.08 and 3 P.
    turbine = load_turbine(name)
    turn = turbine.rotor_speed / (2.0 * np.pi)
    frequency = np.geomspace(0.08, 3.0, 15) * turn
    moment, rest, told = blade_spectra(name, frequency)
    assert np.all(moment[:, 0] / moment[:, -1] > 40.0)
    model = hypothesis("rotor-wind", turbine, turbine.loads)

    def ours(corner: float) -> tuple[Array, Array]:
        blocks = given(model, load_corner=turn * np.exp(corner))
        of = {
            block.states[0].removesuffix("_0"): block.process.spectrum(frequency)
            for block in blocks
            if isinstance(block, PlacedProcess)
        }
        return np.array([of[f"wind_{m}P"] for m in range(8)]), np.array([of[f"hub_{m}P"] for m in (1, 2, 4, 5, 7)])

    def log_ratio(x: Array) -> Array:
        return np.asarray((x[0] + np.log(ours(x[1])[0] / moment)).ravel())

    size, corner = least_squares(log_ratio, [np.log(moment[1, 0] / ours(-2.4)[0][1, 0]), -2.4]).x
    assert np.sqrt(np.mean(log_ratio(np.array([size, corner])) ** 2)) < 0.12
    which = np.array([1, 2, 4, 5, 7])
    levers = np.sqrt(moment[which] / told[which])
    beside = size + np.log(ours(corner)[1] / (rest[which] * levers**2))
    assert np.std(beside) < 0.25


def test_air_couples_hub_and_blades_and_its_coefficient_is_identified(verne555: Turbine):
    model = hypothesis("rotor-wind", verne555, verne555.loads)
    assert model.turbine.rotor.air_couples
    assert model.turbine.values["c_hub_blade"] == 0.0
    coefficient, angle = model.parameters
    assert (coefficient.name, coefficient.centre, coefficient.logarithmic) == ("c_hub_blade", 0.0, False)
    assert coefficient.spread == pytest.approx(0.5 * np.sqrt(12.0 * 6.0))
    assert model.turbine.rotor.leads
    assert model.turbine.values["mean_lag_angle"] == 0.0
    assert (angle.name, angle.centre, angle.spread, angle.logarithmic) == ("mean_lag_angle", 0.0, 0.01, False)


def test_a_measured_load_is_not_modelled(verne555: Turbine):
    rest = [load for load in verne555.loads if load.load != "load_y"]
    for name in ("broadband", "second-order", "rotor-wind"):
        blocks = given(hypothesis(name, verne555, rest))
        assert not any("load_y" in block.outputs for block in blocks)
        assert any("load_x" in block.outputs for block in blocks)


def test_without_blades_wind_is_lines_on_the_hub(verne555: Turbine):
    stiff = replace(verne555.with_model(RotorModel(3, lag="locked")), loads=verne555.loads[:2])
    model = hypothesis("rotor-wind", stiff, stiff.loads)
    assert not model.parameters
    assert not model.turbine.rotor.air_couples
    assert not any("lever" in s.name or "eddies" in s.name or "share" in s.name for s in model.statistics)
    states = {state for block in given(model) for state in block.states}
    assert {"wind_1P_0", "wind_2P_0", "wind_4P_0", "load_x", "load_y"} <= states
    assert "wind_3P_0" not in states  # which the hub of three blades does not feel


def test_what_there_is_to_choose_from(verne555: Turbine):
    assert candidates(verne555, verne555.loads) == ("broadband", "rotor-wind")
    assert candidates(verne555, []) == ("broadband",)
    tower = load_turbine("tower")
    assert candidates(tower, tower.loads) == ("broadband", "second-order")
    with pytest.raises(
        ConfigurationError,
        match="load model: expected auto, broadband, second-order, narrow-band, rotor-wind; got 'gusts'",
    ):
        hypothesis("gusts", verne555, verne555.loads)
    with pytest.raises(ConfigurationError, match="load model rotor-wind: expected a rotor with blades of its own"):
        hypothesis("rotor-wind", tower, tower.loads)


def test_a_hypothesis_starts_as_loud_as_the_simplest_found_its_loads(verne555: Turbine):
    louder = {"load_rms_x": 2.0, "load_rms_y": 1.5, "load_rms_beta_1": 3.0, "load_rms_beta_2": 0.5}
    second, wind = (hypothesis(name, verne555, verne555.loads).statistics for name in ("second-order", "rotor-wind"))
    found = HYPOTHESES["second-order"].start_from(louder, second)
    assert found == {s.name: s.given * louder.get(s.name, 3.0) for s in second if s.name.startswith("load_rms")}
    found = HYPOTHESES["rotor-wind"].start_from(louder, wind)
    factors = {s.name: found[s.name] / s.given for s in wind if s.name in found}
    assert factors == pytest.approx({"load_rms_wind": 3.0, "load_rms_eddies": 3.0, "load_rms_hub": 2.0})
    found = HYPOTHESES["rotor-wind"].start_from({"load_rms_beta_1": 3.0}, wind)
    assert found["load_rms_hub"] == pytest.approx(3.0 * next(s.given for s in wind if s.name == "load_rms_hub"))


def test_only_the_hypothesis_that_was_tested_on_wind_warns_of_its_bands():
    cautious = {name for name in ("broadband", "second-order", "rotor-wind") if HYPOTHESES[name].caution}
    assert cautious == {"rotor-wind"}
