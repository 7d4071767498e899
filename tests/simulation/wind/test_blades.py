"""From wind to loads: spectra at multiples of the rotor frequency, power, direction, damping and its feedback."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from windsysid.errors import ConfigurationError
from windsysid.mechanics import RotorModel, compile_model
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.wind import (
    BladeAerodynamics,
    Direction,
    DirectionChange,
    blade_loads,
    packaged_wind,
    wind_loads,
)
from windsysid.simulation.wind.feedback import integrate_with_feedback
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

RATE = 50.0
CONDITIONS, BLADE = packaged_wind("verne555")
STEADY = replace(CONDITIONS, turbulence_intensity=0.0)
CALM = replace(STEADY, shear_exponent=0.0, tower_radius=0.0)


@pytest.fixture(scope="module")
def rotor(verne555: Turbine) -> np.ndarray:
    return constant_speed_inputs(verne555.rotor_speed, 600.0, RATE)


@pytest.fixture(scope="module")
def wind(verne555: Turbine, rotor: np.ndarray):
    return wind_loads(verne555, CONDITIONS, BLADE, rotor, rate=RATE, seed=5)


def _peaks(values: np.ndarray, once: float) -> list[float]:
    """Spectrum at 1P, 2P, 3P over its median within ±0.45P."""
    f, spectrum = welch(values, RATE, nperseg=4096, axis=0)
    spectrum = spectrum.mean(axis=1)
    away = [np.abs(f / once - multiple) for multiple in (1, 2, 3)]
    return [float(spectrum[a < 0.05].max() / np.median(spectrum[(a > 0.1) & (a < 0.45)])) for a in away]


def test_blades_feel_1p_2p_3p_and_the_hub_of_a_symmetric_rotor_3p_only(verne555: Turbine, wind):
    once = verne555.rotor_speed / (2.0 * np.pi)
    blade, hub = _peaks(wind.loads[:, 2:], once), _peaks(wind.loads[:, :2], once)
    # Measured over ten seeds: blades 45–76, 4.4–7.2, 2.4–4.0; hub 0.9–1.7, 0.9–1.6, 5.0–7.1.
    assert blade[0] > 20.0
    assert blade[1] > 3.0
    assert blade[2] > 1.8
    assert hub[0] < 2.0
    assert hub[1] < 2.0
    assert hub[2] > 4.0


def test_steady_shear_and_shadow_make_3p_and_6p_alone_on_the_hub(verne555: Turbine):
    psi = 2.0 * np.pi * np.arange(720) / 720
    rotor = np.column_stack([psi, np.full(720, verne555.rotor_speed)])
    loads = wind_loads(verne555, STEADY, BLADE, rotor, rate=RATE).loads
    hub, blade = (np.abs(np.fft.rfft(values)) / 360.0 for values in (loads[:, 0], loads[:, 2]))
    assert hub[3] > 0.05
    assert hub[6] > 0.05
    np.testing.assert_allclose(hub[[1, 2, 4, 5, 7, 8]], 0.0, atol=1e-9)
    assert blade[1] > 1.0


def test_loads_have_the_size_of_the_reference_scenario(verne555: Turbine, wind):
    rms = wind.loads.std(axis=0)
    assert np.all((rms[:2] > 5.0) & (rms[:2] < 20.0)), rms  # 15 N
    assert np.all((rms[2:] > 8.0) & (rms[2:] < 25.0)), rms  # 15 N·m
    np.testing.assert_allclose(wind.hub_speed.mean(), CONDITIONS.speed, rtol=0.1)


def test_torque_of_the_nrel_machine_is_what_is_published():
    # NREL/TP-500-38060: 5.297 MW of rotor power at 12.1 rpm. One polar, four stations: 10 %.
    turbine = load_turbine("nrel5mw")
    conditions, blade = packaged_wind("nrel5mw")
    still = replace(conditions, turbulence_intensity=0.0, shear_exponent=0.0, tower_radius=0.0)
    torque = wind_loads(turbine, still, blade, constant_speed_inputs(turbine.rotor_speed, 1.0, 10.0), rate=10.0).torque
    np.testing.assert_allclose(torque, 5.2966e6 / turbine.rotor_speed, rtol=0.1)


def test_the_shadow_passes_when_the_blade_points_down(verne555: Turbine):
    shadowed = replace(CALM, tower_radius=0.06, tower_distance=0.4)
    psi = np.linspace(0.0, 2.0 * np.pi, 3601)
    rotor = np.column_stack([psi, np.full_like(psi, verne555.rotor_speed)])
    loads = wind_loads(verne555, shadowed, BLADE, rotor, rate=RATE).loads
    for blade in range(3):
        theta = np.rad2deg(psi[np.argmin(loads[:, 2 + blade])]) + 120.0 * blade
        assert np.mod(theta, 360.0) == pytest.approx(270.0, abs=0.2)


def test_a_change_of_direction_is_seen_in_the_loads_and_nowhere_else(verne555: Turbine, rotor: np.ndarray, wind):
    changes = (DirectionChange(520.0, 42.0), DirectionChange(534.0, -42.0))
    turned = wind_loads(verne555, CONDITIONS, BLADE, rotor, rate=RATE, direction=Direction(changes=changes), seed=5)
    time = np.arange(len(rotor)) / RATE
    np.testing.assert_array_equal(turned.blade_speed, wind.blade_speed)
    difference = turned.loads - wind.loads
    np.testing.assert_allclose(difference[(time < 520.0) | (time > 540.0)], 0.0, atol=1e-9)
    inside = (time > 526.0) & (time < 534.0)
    assert turned.loads[inside, 2].mean() < 0.7 * wind.loads[inside, 2].mean()  # less wind through the rotor
    assert difference[inside].std(axis=0).min() > 1.0


def test_wind_from_the_side_is_a_hub_that_moves_against_it(verne555: Turbine):
    """δ > 0 blows towards +x: blades feel what a hub moving towards −x feels, in wind weaker across the rotor."""
    psi, delta = np.linspace(0.0, 6.0, 40), np.deg2rad(20.0)
    rotor, wind = np.column_stack([psi, np.full(40, verne555.rotor_speed)]), np.full((40, 3, 3), CALM.speed)
    velocity = np.zeros((40, 5))
    velocity[:, 0] = -CALM.speed * np.sin(delta)
    side = blade_loads(verne555, BLADE, wind, rotor, delta, mean_speed=CALM.speed)
    straight = blade_loads(verne555, BLADE, wind * np.cos(delta), rotor, mean_speed=CALM.speed, velocity=velocity)
    np.testing.assert_allclose(side.loads, straight.loads, rtol=1e-10, atol=1e-10)
    assert np.ptp(side.loads[:, 2]) > 0.5  # once per turn


@pytest.mark.parametrize("name", ["verne555", "nrel5mw"])
def test_damping_is_the_slope_of_the_loads_and_symmetric(name):
    turbine = load_turbine(name)
    conditions, blade = packaged_wind(name)
    n = len(turbine.model.coordinates)
    rotor = constant_speed_inputs(turbine.rotor_speed, 20.0, 10.0)
    wind = wind_loads(turbine, conditions, blade, rotor, rate=10.0, seed=1)
    delta = np.full(len(rotor), 0.1)
    args = (turbine, blade, wind.blade_speed, rotor, delta)
    rest = blade_loads(*args, mean_speed=conditions.speed)
    np.testing.assert_allclose(rest.damping, rest.damping.transpose(0, 2, 1))
    for j in range(n):
        step = 1e-4
        velocity = np.zeros((len(rotor), n))
        velocity[:, j] = step
        ahead = blade_loads(*args, mean_speed=conditions.speed, velocity=velocity).loads
        behind = blade_loads(*args, mean_speed=conditions.speed, velocity=-velocity).loads
        slope = -(ahead - behind) / (2.0 * step)
        np.testing.assert_allclose(slope, rest.damping[:, :, j], rtol=1e-5, atol=1e-5 * np.abs(rest.damping).max())


@pytest.mark.parametrize("name", ["verne555", "nrel5mw"])
def test_aerodynamic_damping_is_positive_in_normal_operation(name):
    turbine = load_turbine(name)
    conditions, blade = packaged_wind(name)
    rotor = constant_speed_inputs(turbine.rotor_speed, 100.0, 10.0)
    damping = wind_loads(turbine, conditions, blade, rotor, rate=10.0, seed=1).damping
    assert np.linalg.eigvalsh(damping.mean(axis=0)).min() > 0.0


def test_a_motion_with_feedback_decays_faster_by_the_linearised_amount(verne555: Turbine):
    """Blades locked: one degree of freedom, ζ' = (c_x + C_xx) / (2 √(k M)); C_xx does not depend on azimuth."""
    turbine = verne555.with_model(RotorModel(y="locked", lag="locked"))
    rate = 200.0
    rotor = constant_speed_inputs(turbine.rotor_speed, 6.0, rate)
    wind = wind_loads(turbine, CALM, BLADE, rotor, rate=rate)
    np.testing.assert_allclose(wind.damping[:, 0, 0], wind.damping[0, 0, 0], rtol=1e-9)
    model = compile_model(turbine.model)
    p = np.array([turbine.values[name] for name in model.parameters])
    motion = {}
    for label, damping in (("still", 0.0 * wind.damping), ("wind", wind.damping)):
        runs = [
            integrate_with_feedback(model, p, np.hstack([rotor, wind.loads]), damping, rate=rate, start=[x, 0.0])
            for x in (0.0, 0.01)
        ]
        motion[label] = runs[1].response.states - runs[0].response.states  # the rest is the same in both
    mass = turbine.inertia("x")
    k, c, extra = turbine.values["k_x"], turbine.values["c_x"], float(wind.damping[0, 0, 0])
    assert extra > 2.0
    time = np.arange(len(rotor)) / rate
    for label, damper in (("still", c), ("wind", c + extra)):
        decay, omega = damper / (2.0 * mass), np.sqrt(k / mass - (damper / (2.0 * mass)) ** 2)
        exact = 0.01 * np.exp(-decay * time) * (np.cos(omega * time) + decay / omega * np.sin(omega * time))
        np.testing.assert_allclose(motion[label][:, 0], exact, atol=1e-6)


def test_without_damping_feedback_is_the_plain_integrator_and_loads_are_those_given(verne555: Turbine, wind, rotor):
    model = compile_model(verne555.model, verne555.sensors)
    p = np.array([verne555.values[name] for name in model.parameters])
    inputs = np.hstack([rotor, wind.loads])[:2000]
    start = np.full(10, 0.01)
    plain = integrate(model, p, inputs, rate=RATE, start=start)
    same, loads = integrate_with_feedback(model, p, inputs, 0.0 * wind.damping[:2000], rate=RATE, start=start)
    np.testing.assert_allclose(same.states, plain.states, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(same.readings, plain.readings, rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(loads, wind.loads[:2000])


def test_linearised_feedback_is_the_full_expression_within_one_percent(verne555: Turbine, wind, rotor):
    model = compile_model(verne555.model)
    p = np.array([verne555.values[name] for name in model.parameters])
    response, loads = integrate_with_feedback(
        model, p, np.hstack([rotor, wind.loads]), wind.damping, rate=RATE, start=np.zeros(10)
    )
    full = blade_loads(
        verne555, BLADE, wind.blade_speed, rotor, wind.misalignment, mean_speed=CONDITIONS.speed,
        velocity=response.states[:, 5:],
    ).loads  # fmt: skip
    np.testing.assert_array_less((full - loads).std(axis=0), 0.01 * loads.std(axis=0))
    np.testing.assert_array_less(0.02 * loads.std(axis=0), (loads - wind.loads).std(axis=0))


def test_a_tied_roll_takes_its_share_of_the_torque():
    turbine = load_turbine("nrel5mw")
    conditions, blade = packaged_wind("nrel5mw")
    still = replace(conditions, turbulence_intensity=0.0, shear_exponent=0.0, tower_radius=0.0)
    wind = wind_loads(turbine, still, blade, constant_speed_inputs(turbine.rotor_speed, 5.0, 10.0), rate=10.0)
    np.testing.assert_allclose(wind.loads[:, 0], turbine.values["kappa"] * wind.torque, rtol=1e-6)


def test_loads_are_reproducible_and_speed_does_not_depend_on_direction(verne555: Turbine, rotor, wind):
    again = wind_loads(verne555, CONDITIONS, BLADE, rotor, rate=RATE, seed=5)
    np.testing.assert_array_equal(again.loads, wind.loads)
    turned = wind_loads(verne555, CONDITIONS, BLADE, rotor[:50], rate=RATE, seed=5, direction=Direction(std_deg=5.0))
    still = wind_loads(verne555, CONDITIONS, BLADE, rotor[:50], rate=RATE, seed=5)
    np.testing.assert_array_equal(turned.hub_speed, still.hub_speed)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"chords": (0.2, 0.2)}, "expected 3 chords"),
        ({"levers": (0.2, 0.2)}, "expected 3 levers"),
        ({"chords": (0.2, 0.2, -0.2)}, "blade chords: expected positive"),
        ({"density": 0.0}, "blade density: expected positive"),
        ({"lift_slope": -1.0}, "blade lift_slope"),
        ({"induction": 0.6}, "induction: expected 0 to 0.5"),
        ({"pitch_deg": float("nan")}, "finite"),
    ],
)
def test_impossible_blades_are_refused_by_name(change, message):
    with pytest.raises(ConfigurationError, match=message):
        replace(BLADE, **change)


def test_what_does_not_fit_is_refused(verne555: Turbine):
    with pytest.raises(ConfigurationError, match="no blade aerodynamics for turbine 'hammond'"):
        packaged_wind("hammond")
    with pytest.raises(ConfigurationError, match="rotor: expected columns"):
        wind_loads(verne555, CONDITIONS, BLADE, np.zeros(5), rate=RATE)
    with pytest.raises(ConfigurationError, match="blade loads: expected wind"):
        blade_loads(verne555, BLADE, np.zeros((5, 2, 3)), np.zeros((5, 2)), mean_speed=5.0)
    model = compile_model(verne555.model)
    p = np.array([verne555.values[name] for name in model.parameters])
    with pytest.raises(ValueError, match="expected p, inputs, damping, start"):
        integrate_with_feedback(model, p, np.zeros((5, 8)), np.zeros((4, 5, 5)), rate=10.0, start=np.zeros(10))


def test_a_blade_that_the_wind_drives_is_not_simulated_to_infinity(verne555: Turbine, rotor):
    model = compile_model(verne555.model)
    p = np.array([verne555.values[name] for name in model.parameters])
    driven = np.broadcast_to(-200.0 * np.eye(5), (len(rotor), 5, 5))
    inputs = np.hstack([rotor, np.ones((len(rotor), 5))])
    with pytest.raises(ConfigurationError, match="grows without bound"):
        integrate_with_feedback(model, p, inputs, driven, rate=RATE, start=np.zeros(10))


def test_stations_and_wind_need_no_packaged_machine(verne555: Turbine):
    one = BladeAerodynamics(radii=(1.5,), widths=(2.0,), chords=(0.1,), twists_deg=(10.0,), density=1.0)
    rotor = constant_speed_inputs(verne555.rotor_speed, 10.0, RATE)
    assert wind_loads(verne555, CONDITIONS, one, rotor, rate=RATE).loads.shape == (500, 5)
