"""The family of load models: what each takes the loads for."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from windsysid.errors import ConfigurationError
from windsysid.loads.family import candidates, hypothesis
from windsysid.loads.hypothesis import HYPOTHESES, SupposedLoads
from windsysid.mechanics import RotorModel
from windsysid.simulation.wind import BladeAerodynamics, WindConditions, coherence, kaimal_spectrum, packaged_wind
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
    # Without what the hub feels alone, both hub loads follow from the three moments.
    model = hypothesis("rotor-wind", verne555, verne555.loads)
    blocks = given(model, load_rms_hub=1e-9, load_hub_share=1e-9, load_lever_rise=1e-9, load_lever=1.6)
    for psi in (0.3, 1.9):
        cov = covariance(blocks, verne555.model.loads, psi)
        theta = psi + 2.0 * np.pi * np.arange(3) / 3.0
        to_hub = np.array([-np.sin(theta), np.cos(theta)]) / 1.6
        np.testing.assert_allclose(cov[:2, 2:], to_hub @ cov[2:, 2:], atol=1e-6 * np.abs(cov).max())
        np.testing.assert_allclose(cov[:2, :2], to_hub @ cov[2:, 2:] @ to_hub.T, atol=1e-6 * np.abs(cov).max())


@pytest.mark.parametrize(("rise", "levers"), [
    (0.5, {1: 1.28, 2: 1.371429, 4: 1.454545, 5: 1.476923, 7: 1.505882}),
    (3.0, {1: 0.64, 2: 0.8, 4: 1.0, 5: 1.066667, 7: 1.163636}),
])  # fmt: skip
def test_the_smaller_the_eddies_the_further_out_they_push(verne555: Turbine, rise: float, levers: dict[int, float]):
    # ℓ (m+1)/(m+1+ρ) for ℓ = 1.6 m, worked out by hand; single eddies push where the last term does.
    model = hypothesis("rotor-wind", verne555, verne555.loads)
    blocks = {block.states[0]: block for block in given(model, load_lever=1.6, load_lever_rise=rise)}
    for psi in (0.3, 1.9):
        theta = psi + 2.0 * np.pi * np.arange(3) / 3.0
        tangents = np.array([-np.sin(theta), np.cos(theta)])
        for m, lever in levers.items():
            value = blocks.get(f"wind_{m}P", blocks.get(f"wind_{m}P_0")).process.value  # type: ignore[union-attr]
            forces = np.array([np.cos(m * theta), np.sin(m * theta)]) / lever
            for block, c in ((blocks.get(f"wind_{m}P", blocks.get(f"wind_{m}P_0")), value), (blocks[f"hub_{m}P"], 1.0)):
                assert block is not None
                hub = np.array([output(block, name, psi) for name in ("load_x", "load_y")])
                np.testing.assert_allclose(hub, np.kron(tangents @ forces.T, c), atol=1e-6)
        for i in (1, 2, 3):
            block = blocks[f"eddies_{i}_0"]
            moment = output(block, f"load_beta_{i}", psi)
            hub = np.array([output(block, name, psi) for name in ("load_x", "load_y")])
            np.testing.assert_allclose(hub, np.outer(tangents[:, i - 1], moment) / levers[7], rtol=1e-6)


def ring_spectrum(m: int, radius: float, frequency: Array, wind: WindConditions) -> Array:
    """Spectrum of the m-th term in azimuth of the wind on a ring: a Fourier coefficient of its coherence."""
    angle = (np.arange(4096) + 0.5) * np.pi / 4096
    separation = 2.0 * radius * np.sin(0.5 * angle)
    share = np.array([np.mean(coherence(f, separation, wind) * np.cos(m * angle)) for f in frequency])
    return (2.0 if m else 1.0) * share * kaimal_spectrum(frequency, wind)


def test_spectra_of_the_terms_have_the_shape_that_turbulence_gives_them(verne555: Turbine):
    # Kaimal's spectrum and the IEC's coherence on the ring of the scale model's outer station; one level, corner, fall
    # and knee for all terms but the slowest. The spectra fall by a factor of 25 to 700 between 0.1 and 2.5 Hz.
    wind, blade = packaged_wind("verne555")
    model = hypothesis("rotor-wind", verne555, verne555.loads)
    blocks = {
        block.states[0].removesuffix("_0"): block
        for block in given(model, load_corner=0.134, load_fall=1.05, load_knee=6.0)
    }
    frequency = np.geomspace(0.1, 2.5, 12)
    true = np.array([ring_spectrum(m, blade.radii[-1], frequency, wind) for m in range(1, 8)])
    ours = np.array([blocks[f"wind_{m}P"].process.spectrum(frequency) for m in range(1, 8)])  # type: ignore[attr-defined]
    assert np.all(true[:, 0] / true[:, -1] > 20.0)
    off = np.log(ours / true) - np.mean(np.log(ours / true))
    assert np.sqrt(np.mean(off**2)) < 0.12
    assert np.abs(off).max() < np.log(1.5)


def blade_spectra(name: str, frequency: Array) -> tuple[Array, Array]:
    """Spectra of the terms m = 0 … 7 of a blade's moment, and of the force beside it, by quadrature.

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
    moment, rest = np.empty((8, len(frequency))), np.empty((8, len(frequency)))
    for k, f in enumerate(frequency):
        together = coherence(f, apart, wind) * kaimal_spectrum(f, wind)
        for m in range(8):
            share = np.mean(together * np.cos(m * angle), axis=2)
            of_moment, cross, of_force = (a @ share @ b for a, b in
                                          ((force * levers, force * levers), (force * levers, force),
                                          (force, force)))  # fmt: skip
            moment[m, k], rest[m, k] = of_moment, of_force - cross**2 / of_moment
    moment[1:] *= 2.0
    return moment, 2.0 * rest


def blade_force_per_metre(blade: BladeAerodynamics, across: float, along: Array) -> Array:
    """Quasi-steady, in the plane of the rotor, linear lift (docs/wind.md)."""
    twist = np.deg2rad(np.array(blade.twists_deg) + blade.pitch_deg + blade.zero_lift_deg)
    lift = blade.lift_slope * (np.arctan2(across, along) - twist)
    drag = blade.drag + blade.drag_factor * lift**2
    pressure = 0.5 * blade.density * np.array(blade.chords) * np.hypot(across, along)
    return np.asarray(pressure * (lift * across - drag * along))


@pytest.mark.parametrize(("name", "off"), [("verne555", 0.15), ("nrel5mw", 0.2)])
def test_one_corner_knee_and_fall_describe_the_moments_of_a_whole_blade(name: str, off: float):
    # Three and four stations from root to tip, thirty times apart in size: the same constants serve, and what the force
    # has beside the moment falls later.
    turbine = load_turbine(name)
    turn = turbine.rotor_speed / (2.0 * np.pi)
    frequency = np.geomspace(0.03, 2.0, 15) * turn
    moment, rest = blade_spectra(name, frequency)
    model = hypothesis("rotor-wind", turbine, turbine.loads)

    def ours(corner: float, fall: float, knee: float) -> tuple[Array, Array]:
        blocks = given(model, load_corner=turn * np.exp(corner), load_fall=fall, load_knee=np.exp(knee))
        of = {
            block.states[0].removesuffix("_0"): block.process.spectrum(frequency)
            for block in blocks
            if isinstance(block, PlacedProcess)
        }
        return np.array([of[f"wind_{m}P"] for m in range(8)]), np.array([of[f"hub_{m}P"] for m in (1, 2, 4, 5, 7)])

    def log_ratio(x: Array) -> Array:
        return np.asarray((x[0] + np.log(ours(*x[1:])[0] / moment)).ravel())

    size, *shape = least_squares(log_ratio, [np.log(moment[1, 0] / ours(-2.5, 1.2, 1.8)[0][1, 0]), -2.5, 1.2, 1.8]).x
    assert np.sqrt(np.mean(log_ratio(np.array([size, *shape])) ** 2)) < off
    beside = np.log(ours(*shape)[1] / rest[[1, 2, 4, 5, 7]])
    assert np.std(beside) < 0.25


def test_air_couples_hub_and_blades_and_its_coefficient_is_identified(verne555: Turbine):
    model = hypothesis("rotor-wind", verne555, verne555.loads)
    assert model.turbine.rotor.air_couples
    assert model.turbine.values["c_hub_blade"] == 0.0
    (coefficient,) = model.parameters
    assert (coefficient.name, coefficient.centre, coefficient.logarithmic) == ("c_hub_blade", 0.0, False)
    assert coefficient.spread == pytest.approx(0.5 * np.sqrt(12.0 * 6.0))


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
    assert {"wind_1P_0", "wind_2P_0", "wind_4P", "load_x", "load_y"} <= states
    assert "wind_3P" not in states  # which the hub of three blades does not feel


def test_what_there_is_to_choose_from(verne555: Turbine):
    assert candidates(verne555, verne555.loads) == ("broadband", "rotor-wind")
    assert candidates(verne555, []) == ("broadband",)
    tower = load_turbine("tower")
    assert candidates(tower, tower.loads) == ("broadband", "second-order")
    with pytest.raises(
        ConfigurationError, match="load model: expected auto, broadband, second-order, rotor-wind; got 'gusts'"
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
