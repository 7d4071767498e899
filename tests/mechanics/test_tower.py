"""The tower under a rigid rotor against closed forms, a pendulum's constancy, and the signals that turn axes."""

import math

import numpy as np
import pytest
import sympy as sp

from windsysid.errors import ConfigurationError
from windsysid.mechanics import Sensor, TowerModel, compile_model
from windsysid.mechanics.sensor_lists import as_sensor
from windsysid.mechanics.sensors import Accelerometer
from windsysid.signals import to_nacelle
from windsysid.simulation.integrate import integrate

VALUES = {
    "mass_side_side": 400.0, "k_side_side": 1600.0, "c_side_side": 8.0,
    "mass_fore_aft": 500.0, "k_fore_aft": 1500.0, "c_fore_aft": 90.0, "tilt": 0.02, "gravity": 9.8,
}  # fmt: skip
INPUTS = ("rotor_azimuth", "rotor_speed", "nacelle_yaw", "yaw_rate", "yaw_acceleration")


def sensor(axis: str, quantity: str = "acceleration", **more) -> Sensor:
    frame = "tower" if axis == "bearing" else "nacelle"
    channel = f"{axis}_{quantity}_{more.get('bearing_deg', '')}"
    return as_sensor(
        {"channel": channel, "quantity": quantity, "point": "tower", "axis": axis, "frame": frame, "noise": 1.0, **more}
    )


def real(name: str) -> sp.Symbol:
    return sp.Symbol(name, real=True)


def test_a_nacelle_that_does_not_yaw_is_two_oscillators():
    equations = TowerModel().equations()
    still = {real("yaw_rate"): 0, real("yaw_acceleration"): 0}
    assert equations.mass == sp.diag(real("mass_side_side"), real("mass_fore_aft"))
    for force, name in zip(equations.force, ("side_side", "fore_aft"), strict=True):
        expected = real(f"load_{name}") - real(f"k_{name}") * real(name) - real(f"c_{name}") * real(f"{name}_rate")
        assert sp.expand(force.subs(still) - expected) == 0


def test_the_azimuth_and_the_yaw_itself_are_in_no_equation():
    equations = TowerModel().equations()
    assert [s.name for s in equations.inputs] == list(INPUTS)
    used = {s.name for s in equations.force.free_symbols}
    assert used & set(INPUTS) == {"yaw_rate", "yaw_acceleration"}


def test_a_free_vibration_keeps_its_plane_while_the_nacelle_turns_under_it():
    # A round tower with equal masses and no damping does not know where the nacelle points: A cos ωt along one bearing
    # for ever.
    omega, amplitude, rate, bearing = 2.0, 0.3, 100.0, math.radians(25.0)
    values = VALUES | {"mass_fore_aft": 400.0, "k_fore_aft": 1600.0, "c_side_side": 0.0, "c_fore_aft": 0.0, "tilt": 0.0}
    along, across = (sensor("bearing", "displacement", bearing_deg=b) for b in (25.0, 115.0))
    shaking = sensor("bearing", "acceleration", bearing_deg=25.0)
    model = compile_model(TowerModel(), [along, across, shaking])
    time = np.arange(0.0, 60.0, 1.0 / rate)
    yaw_rate = math.radians(1.5)
    yaw = 0.4 + yaw_rate * time
    inputs = np.zeros((len(time), 7))
    inputs[:, 2], inputs[:, 3] = yaw, yaw_rate
    turn = bearing - yaw[0]  # u = A (sin turn, −cos turn) in nacelle axes; they turn away from under it
    x, z = amplitude * math.sin(turn), -amplitude * math.cos(turn)
    start = [x, z, yaw_rate * z, -yaw_rate * x]
    p = [values[name] for name in model.parameters]
    read = integrate(model, p, inputs, rate=rate, start=start, substeps=4).readings
    np.testing.assert_allclose(read[:, 0], amplitude * np.cos(omega * time), atol=1e-7)
    np.testing.assert_allclose(read[:, 1], 0.0, atol=1e-7)
    np.testing.assert_allclose(read[:, 2], -amplitude * omega**2 * np.cos(omega * time), atol=1e-6)


def test_readings_are_the_derivatives_of_the_position_over_ground():
    # Position in fixed axes (east, north), differentiated by SymPy as a function of time: nothing of the model's own
    # kinematics.
    t = sp.Symbol("t")
    x, z = sp.Rational(3, 10) * sp.sin(2 * t + 1), sp.cos(3 * t) / 5
    yaw = sp.Rational(7, 10) + t / 50 + sp.sin(t) / 30

    def e(bearing):
        return sp.Matrix([sp.sin(bearing), sp.cos(bearing)])

    position = x * e(yaw + sp.pi / 2) - z * e(yaw)
    axes = {"x": e(yaw + sp.pi / 2), "z": -e(yaw), "bearing": e(sp.rad(200))}
    state = {"side_side": x, "fore_aft": z}
    at = {f"{name}{end}": sp.diff(q, t, n) for name, q in state.items() for n, end in enumerate(("", "_rate", "_acc"))}
    at |= {name: sp.diff(yaw, t, n) for n, name in enumerate(INPUTS[2:])} | {k: sp.Float(v) for k, v in VALUES.items()}
    for order, quantity in enumerate(("displacement", "velocity", "acceleration")):
        for axis, unit_vector in axes.items():
            one = sensor(axis, quantity, gain=2.0, **({"bearing_deg": 200.0} if axis == "bearing" else {}))
            (expression,) = TowerModel().readings([one])
            expected = 2 * sp.diff(position, t, order).dot(unit_vector)
            ours = expression.subs({real(name): value for name, value in at.items()})
            for moment in (0.3, 4.1):
                assert float((ours - expected).subs(t, moment)) == pytest.approx(0.0, abs=1e-12)


def test_sensors_fixed_to_the_tower_are_what_the_yaw_signal_turns_back():
    # `signals.to_nacelle` takes a pair along b and a quarter turn counter-clockwise from it: the two must be each
    # other's inverse.
    x, z, yaw = 0.3, -1.7, 0.9
    pair = [sensor("bearing", "displacement", bearing_deg=b) for b in (40.0, -50.0)]
    numbers = {real("side_side"): x, real("fore_aft"): z, real("nacelle_yaw"): yaw}
    first, second = (float(e.subs(numbers)) for e in TowerModel().readings(pair))
    back = to_nacelle([first], [second], [yaw], bearing=math.radians(40.0))
    np.testing.assert_allclose(np.ravel(back), [x, z], rtol=1e-12)


def test_a_leaning_top_tips_its_accelerometers():
    feels = TowerModel().readings([sensor("x", feels_gravity=True), sensor("z", feels_gravity=True)])
    blind = TowerModel().readings([sensor("x"), sensor("z")])
    for f, b, name in zip(feels, blind, ("side_side", "fore_aft"), strict=True):
        assert sp.expand(f - b + real("gravity") * real("tilt") * real(name)) == 0


def test_strain_at_the_foot_is_the_tower_s_spring_alone():
    # What air damps does not bend the tower where it stands: c is in the loads there.
    (strain,) = TowerModel().readings([sensor("z", "strain", gain=3.0)])
    assert strain == 3.0 * real("k_fore_aft") * real("fore_aft")


def test_one_direction_alone_is_an_oscillator():
    model = TowerModel(fore_aft="locked")
    assert model.coordinates == ("side_side",)
    assert model.coefficients == ("k_side_side", "c_side_side")
    assert model.states == ("side_side", "side_side_rate")
    assert model.equations().mass.shape == (1, 1)


def test_what_this_tower_does_not_know_is_refused():
    with pytest.raises(ConfigurationError, match="both directions of the tower are locked"):
        TowerModel(side_side="locked", fore_aft="locked")
    with pytest.raises(ConfigurationError, match="expected 1 or more, got 0"):
        TowerModel(blades=0)
    lag = Accelerometer(channel="lag", point="blade_1", axis="lag", noise=1.0)
    turning = sensor("x", "angular_rate")
    for wrong in (lag, turning, Accelerometer(channel="y", point="tower", axis="y", noise=1.0)):
        with pytest.raises(
            ConfigurationError, match=f"sensor '{wrong.channel}': this turbine is a tower under a rigid"
        ):
            TowerModel().readings([wrong])
