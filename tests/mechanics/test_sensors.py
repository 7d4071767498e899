"""Readings against positions differentiated numerically, against gravity at rest, and bad sensor lists."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import sympy as sp

from windsysid.errors import ConfigurationError
from windsysid.mechanics import RotorModel, compile_model, read_sensors
from windsysid.mechanics.sensor_lists import as_sensor
from windsysid.mechanics.sensors import Accelerometer, PlacedSensor
from windsysid.simulation.integrate import integrate
from windsysid.turbine.turbine import Turbine

ROLLING = RotorModel(3, roll="free")
RATE = 2000.0
KAPPA = -0.3

TOWER = Accelerometer(channel="tower", point="tower", axis="x", noise=1.0)
BLADE = Accelerometer(
    channel="blade", point="blade_2", axis="tangential", frame="blade", position=(2.0, 0.15), noise=1.0
)  # fmt: skip


def variants(sensor: PlacedSensor, *changes: dict[str, Any]) -> list[PlacedSensor]:
    found = [as_sensor(sensor.model_dump() | change) for change in changes]
    assert all(isinstance(one, PlacedSensor) for one in found)
    return [one for one in found if isinstance(one, PlacedSensor)]


ACCELEROMETERS = [
    *variants(
        TOWER,
        {},
        {"axis": "y"},
        {"axis": "y", "position": (0.4, 0.7)},
        {"axis": "x", "position": (0.4, 0.7), "frame": "tower_top", "feels_gravity": True},
        {"axis": "y", "position": (-0.4, 0.7), "frame": "tower_top", "feels_gravity": True, "gain": 0.1},
    ),
    *variants(
        BLADE,
        {},
        {"axis": "span"},
        {"feels_gravity": True},
        {"axis": "span", "feels_gravity": True, "slope": 1.6, "deflection": 2.3},
        {"deflection": 1.2, "slope": 0.7},
        {"axis": "x", "frame": "fixed", "feels_gravity": True},
        {"axis": "y", "frame": "tower_top", "point": "blade_3"},
    ),
]


class Motion(NamedTuple):
    """A simulated motion on a fine grid, with loads that ramp and a speed that changes."""

    states: np.ndarray
    rates: np.ndarray
    inputs: np.ndarray
    gravity: float
    hinge_offset: float

    def of(self, name: str, end: str = "") -> np.ndarray:
        lean = KAPPA * self.of("x", end) if name == "roll" else 0.0
        return np.asarray(self.states[:, ROLLING.states.index(name + end)] + lean)


@pytest.fixture(scope="module")
def values(verne555: Turbine) -> dict[str, float]:
    return {**verne555.values, "roll_inertia": 3.0, "k_roll": 9000.0, "c_roll": 5.0, "kappa": KAPPA}


def simulated(values: dict[str, float], sensors: list[PlacedSensor]) -> tuple[Motion, np.ndarray]:
    model = compile_model(ROLLING, sensors)
    time = np.arange(2001) / RATE
    speed = 7.0 + 0.5 * time
    turning = np.column_stack([7.0 * time + 0.25 * time**2, speed, np.full_like(time, 0.5)])
    loads = 1.0 + np.outer(time, [30.0, -20.0, 15.0, 25.0, -10.0, 20.0]) + 20.0
    inputs = np.column_stack([turning, loads])
    start = np.concatenate([[0.01, -0.02, 0.01, 0.02, -0.015, 0.01], [0.1, 0.2, -0.1, 0.3, -0.2, 0.1]])
    p = [values[name] for name in model.parameters]
    response = integrate(model, p, inputs, rate=RATE, start=start, substeps=2)
    motion = Motion(response.states, response.rates, inputs, values["gravity"], values["hinge_offset"])
    return motion, response.readings


def position(sensor: PlacedSensor, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Where the sensor is, in the fixed frame, and the angle of its own frame: built without SymPy."""
    roll, azimuth = motion.of("roll"), motion.inputs[:, 0]
    along, across = sensor.position
    if not sensor.blade:
        r = np.stack([
            motion.of("x") + along * np.cos(roll) - across * np.sin(roll),
            motion.of("y") + along * np.sin(roll) + across * np.cos(roll),
        ])  # fmt: skip
        return r, roll if sensor.frame == "tower_top" else np.zeros_like(roll)
    beta = motion.of(f"beta_{sensor.blade}")
    link = azimuth + roll + 2.0 * np.pi * (sensor.blade - 1) / 3.0
    lever = sensor.deflection or along
    inboard = motion.hinge_offset + along - lever  # where a blade that bends seems to hinge
    r = np.stack([
        motion.of("x") + inboard * np.cos(link) + lever * np.cos(link + beta) - across * np.sin(link + beta),
        motion.of("y") + inboard * np.sin(link) + lever * np.sin(link + beta) + across * np.cos(link + beta),
    ])  # fmt: skip
    frames = {"fixed": np.zeros_like(roll), "tower_top": roll, "blade": link + sensor.slope * beta}
    return r, frames[sensor.frame]


def differentiated(signal: np.ndarray, order: int) -> np.ndarray:
    """First or second derivative by eighth-order central differences; four samples are lost at either end."""
    first = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    second = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
    stencil = (first * RATE, second * RATE**2)[order - 1]
    return np.asarray(np.lib.stride_tricks.sliding_window_view(signal, 9, axis=-1) @ stencil)


def projected(vector: np.ndarray, angle: np.ndarray, axis: str) -> np.ndarray:
    along = np.cos(angle) * vector[0] + np.sin(angle) * vector[1]
    across = -np.sin(angle) * vector[0] + np.cos(angle) * vector[1]
    return np.asarray(along if axis in ("x", "span") else across)


def test_an_accelerometer_reads_the_second_derivative_of_its_position(values: dict[str, float]):
    motion, readings = simulated(values, ACCELEROMETERS)
    for column, sensor in enumerate(ACCELEROMETERS):
        r, angle = position(sensor, motion)
        acceleration = differentiated(r, 2)
        if sensor.feels_gravity:
            acceleration[1] += motion.gravity
        expected = sensor.gain * projected(acceleration, angle[4:-4], sensor.axis)
        error = np.abs(readings[4:-4, column] - expected).max()
        assert error < 1e-6 * np.abs(expected).max(), f"{sensor}: {error}"


def test_velocity_and_displacement_are_those_of_the_same_point(values: dict[str, float]):
    sensors = [
        sensor
        for s in (ACCELEROMETERS[3], ACCELEROMETERS[8], ACCELEROMETERS[10])
        for quantity in ("velocity", "displacement")
        for sensor in variants(s, {"quantity": quantity, "feels_gravity": False})
    ]
    motion, readings = simulated(values, sensors)
    for column, sensor in enumerate(sensors):
        r, angle = position(sensor, motion)
        if not sensor.blade:  # the tower's displacement is counted from where the sensor sits at rest
            r = r - np.array(sensor.position)[:, None]
        vector, part = (r[:, 4:-4], 0) if sensor.quantity == "displacement" else (differentiated(r, 1), 1)
        expected = projected(vector, angle[4:-4], sensor.axis)
        assert np.abs(readings[4:-4, column] - expected).max() < 1e-8 * max(1.0, np.abs(expected).max()), (sensor, part)


def test_lag_rate_moment_and_strain_read_what_they_say(values: dict[str, float]):
    def made(quantity: str, point: str = "blade_1", axis: str = "lag", gain: float = 1.0) -> PlacedSensor:
        return variants(TOWER, {"quantity": quantity, "point": point, "axis": axis, "gain": gain})[0]

    sensors = [
        made("displacement"), made("velocity"), made("acceleration"), made("angular_rate"),
        made("angular_rate", "tower", "x"),
        made("moment"), made("strain", gain=2e-6), made("moment", "tower", "y", gain=17.0),
    ]  # fmt: skip
    motion, readings = simulated(values, sensors)
    beta, rate = motion.of("beta_1"), motion.of("beta_1", "_rate")
    root = values["k_beta_1"] * beta + values["c_beta_1"] * rate
    expected = [
        beta, rate, motion.rates[:, ROLLING.states.index("beta_1_rate")],
        motion.inputs[:, 1] + motion.of("roll", "_rate") + rate, motion.of("roll", "_rate"),
        root, 2e-6 * root, 17.0 * (values["k_y"] * motion.of("y") + values["c_y"] * motion.of("y", "_rate")),
    ]  # fmt: skip
    for column, signal in enumerate(expected):
        np.testing.assert_allclose(readings[:, column], signal, rtol=1e-12, atol=1e-12 * np.abs(signal).max())


def test_a_load_reaches_the_accelerometer_at_once(verne555: Turbine):
    # 10 N on a hub whose blades are locked: 10 N / 14.5 kg, in the same sample.
    model = compile_model(RotorModel(3, lag="locked"), (TOWER,))
    p = np.array([verne555.values[name] for name in model.parameters])
    quiet, pushed = np.empty(1), np.empty(1)
    for load, out in ((0.0, quiet), (10.0, pushed)):
        model.reading(np.zeros(4), np.array([0.0, 0.0, 0.0]), p, np.array([load, 0.0]), out)
    assert pushed[0] - quiet[0] == pytest.approx(10.0 / 14.5, rel=1e-12)


@pytest.mark.parametrize(
    ("sensor", "azimuth", "expected"),
    [
        (variants(TOWER, {"axis": "y", "feels_gravity": True})[0], 0.3, 9.80665),
        (variants(TOWER, {"axis": "x", "feels_gravity": True})[0], 0.3, 0.0),
        (variants(TOWER, {"axis": "y"})[0], 0.3, 0.0),
        (variants(BLADE, {"point": "blade_1", "feels_gravity": True})[0], 0.0, 9.80665),  # blade level, rising
        (variants(BLADE, {"point": "blade_1", "axis": "span", "feels_gravity": True})[0], np.pi / 2, 9.80665),  # up
        (variants(BLADE, {"point": "blade_1", "axis": "span", "feels_gravity": True})[0], -np.pi / 2, -9.80665),
        (variants(BLADE, {"point": "blade_1", "feels_gravity": True})[0], np.pi, -9.80665),
    ],
)
def test_at_rest_an_accelerometer_reads_gravity_on_a_vertical_axis(
    verne555: Turbine, sensor: PlacedSensor, azimuth: float, expected: float
):
    model = compile_model(RotorModel(3, lag="locked"), (sensor,))
    p = np.array([verne555.values[name] for name in model.parameters])
    out = np.empty(1)
    model.reading(np.zeros(4), np.array([azimuth, 0.0, 0.0]), p, np.zeros(2), out)
    assert out[0] == pytest.approx(expected, abs=1e-12)


GOOD = """
[[sensor]]
channel = "a"
quantity = "acceleration"
point = "tower"
axis = "x"
noise = 0.05
"""


def listed(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "sensors.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_sensor_list_is_read(tmp_path: Path):
    text = GOOD + GOOD.replace('"a"', '"b"').replace('"x"', '"y"') + "bias = 0.1\nposition = [0.5, -1.0]\n"
    first, second = read_sensors(listed(tmp_path, text))
    assert isinstance(first, PlacedSensor)
    assert isinstance(second, PlacedSensor)
    assert (first.channel, first.axis, first.noise, first.bias, first.unit) == ("a", "x", 0.05, 0.0, "m/s^2")
    assert (second.channel, second.bias, second.position, second.blade) == ("b", 0.1, (0.5, -1.0), 0)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (GOOD + "nosie = 1.0\n", "sensor 1: unknown key 'nosie'"),
        (GOOD.replace('"x"', '"span"'), "on the tower the frame 'fixed' has the axes x, y, got 'span'"),
        (GOOD.replace('"x"', '"lag"'), "on the tower the frame 'fixed' has the axes x, y, got 'lag'"),
        (GOOD.replace('"x"', '"w"'), r"axis: .*'x', 'y', 'z', 'span', 'tangential', 'lag' or 'bearing', got 'w'"),
        (GOOD.replace('"x"', '"z"'), "the axes x, y, got 'z': that axis belongs to the frame nacelle"),
        (GOOD.replace('"x"', '"bearing"'), "the axes x, y, got 'bearing': that axis belongs to the frame tower"),
        (
            GOOD.replace('"x"', '"y"') + 'frame = "nacelle"\n',
            "the frame 'nacelle' has the axes x, z, got 'y': that axis belongs to the frame fixed or tower_top",
        ),
        (GOOD + 'frame = "tower"\n', "the frame 'tower' has the axes bearing, got 'x'"),
        (
            GOOD.replace('"tower"', '"blade_1"') + 'frame = "nacelle"\n',
            "the frame 'nacelle' belongs to a sensor on the tower, got point 'blade_1'",
        ),
        (GOOD + 'frame = "blade"\n', "the frame 'blade' belongs to a sensor on a blade, got point 'tower'"),
        (
            GOOD.replace('"acceleration"', '"velocity"') + "feels_gravity = true\n",
            "'feels_gravity' describes an accelerometer",
        ),
        (
            GOOD.replace('"acceleration"', '"speed"'),
            "quantity: expected one of acceleration, velocity, .*, got 'speed'",
        ),
        (GOOD.replace('"acceleration"', "[1]"), r"quantity: expected one of acceleration, .*, got \[1\]"),
        ('sensor = ["a"]\n', "sensor 1: expected a table, got 'a'"),
        (GOOD + "deflection = 2.0\n", "'deflection' and 'slope' describe a bending blade"),
        (GOOD.replace('"tower"', '"nacelle"'), "point: .* got 'nacelle'"),
        (GOOD.replace('"tower"', '"blade_0"'), "point: .* got 'blade_0'"),
        (GOOD + GOOD, "channel 'a' is listed 2 times: list it once"),
        (GOOD.replace("noise = 0.05", ""), "sensor 1: 'noise' is missing: add it"),
        (GOOD.replace("0.05", "0.0"), "noise: .*greater than 0, got 0.0"),
        (GOOD.replace("0.05", "-1.0"), "noise: .*greater than 0, got -1.0"),
        (GOOD.replace("0.05", "nan"), "noise: .*"),
        (GOOD.replace("0.05", "inf"), "noise: .* got inf"),
        (GOOD + "gain = inf\n", "gain: .*"),
        (GOOD + "gain = nan\n", "gain: .*"),
        (GOOD + "position = [nan, 0.0]\n", "position"),
        (GOOD + "bias = -0.1\n", "bias: .* got -0.1"),
        (GOOD.replace('"a"', '""'), "channel: .*"),
        ("sensor = 3\n", "expected .*sensor.* tables"),
        ("[sensor]\nchannel = 'a'\n", "expected .*sensor.* tables"),
        (GOOD + "[other]\n", "expected .*sensor.* tables and nothing else, got other, sensor"),
        ("", "an empty file"),
        ("this is no TOML", "is not a TOML file"),
        ("\x00\x01", "is not a TOML file"),
    ],
)
def test_a_bad_sensor_list_is_one_clear_line(tmp_path: Path, text: str, complaint: str):
    path = listed(tmp_path, text)
    with pytest.raises(ConfigurationError, match=complaint) as caught:
        read_sensors(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_sensor_list_that_cannot_be_read_is_one_clear_line(tmp_path: Path):
    binary = tmp_path / "binary.toml"
    binary.write_bytes(bytes(range(128, 256)))
    for path in (tmp_path, tmp_path / "nowhere.toml", binary):
        with pytest.raises(ConfigurationError, match="a TOML file with") as caught:
            read_sensors(path)
        assert "\n" not in str(caught.value)


def test_sensors_of_different_classes_never_share_a_compiled_reading():
    """Not even where a copy was given the other's quantity."""
    (velocity,) = variants(TOWER, {"quantity": "velocity"})
    assert TOWER.model_copy(update={"quantity": "velocity"}).structure != velocity.structure


def test_a_sensor_on_a_blade_that_is_not_there_is_refused():
    with pytest.raises(ConfigurationError, match="'blade' sits on blade 7, but the turbine has 3 blades"):
        compile_model(RotorModel(3), variants(BLADE, {"point": "blade_7"}))


def test_a_rotor_in_its_own_plane_refuses_what_yaws():
    yawing = Accelerometer(channel="a", point="tower", axis="z", frame="nacelle", noise=1.0)
    with pytest.raises(
        ConfigurationError, match="sensor 'a' is in the frame 'nacelle', which a rotor in its own plane"
    ):
        RotorModel(3).readings([yawing])


def test_sensors_on_blades_that_lead_read_where_the_blades_are():
    quantities = ("displacement", "angular_rate", "moment")
    others = variants(TOWER, *({"quantity": one, "point": "blade_1", "axis": "lag"} for one in quantities))
    sensors = [ACCELEROMETERS[5], ACCELEROMETERS[8], *others]
    plain, leading = RotorModel(3, roll="tied"), RotorModel(3, roll="tied", leads=True)
    ours, theirs = leading.readings(sensors), plain.readings(sensors)
    names = sorted({str(s) for row in (*ours, *theirs) for s in row.free_symbols})
    rng = np.random.default_rng(12)
    values = dict(zip(names, rng.uniform(0.5, 1.5, len(names)).tolist(), strict=True))
    turned = values | {f"beta_{i}": values.get(f"beta_{i}", 0.0) + values["mean_lag_angle"] for i in (1, 2, 3)}

    def read(rows: list[sp.Expr], at: dict[str, float]) -> np.ndarray:
        return np.array(sp.lambdify([sp.symbols(names, real=True)], rows, "numpy")([at[name] for name in names]))

    np.testing.assert_allclose(read(ours, values), read(theirs, turned), rtol=1e-12)
