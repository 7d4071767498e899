"""What counts as a tolerance, and where it acts."""

import math
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from windsysid.identification.identify import identify
from windsysid.identification.model.tolerances import learned_tolerances, seconds_late, tolerances_of, with_tolerances
from windsysid.mechanics import RotorModel, TowerModel
from windsysid.mechanics.sensors import Accelerometer, AngularRateSensor, MomentSensor, instrument_parameters
from windsysid.monitoring.comparison import compare
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine, write_turbine
from windsysid.turbine.tower_file import AERODYNAMIC_STIFFNESS_DISCREPANCY


def test_a_turbine_of_a_file_has_tolerances_and_an_exact_one_has_none(tmp_path):
    turbine = load_turbine("verne555")
    found = tolerances_of(turbine, turbine.sensors, [])
    groups = [one.group for one in found]
    assert [groups.count(group) for group in ("gain", "alignment", "masses", "clock")] == [5, 2, 5, 1]
    assert groups[-1] == "clock"  # lag angles have no axis; blades share a logger, the tower's is the record's
    assert {one.group: one.spread for one in found} == pytest.approx(
        {"gain": 0.01, "alignment": math.radians(2.0), "masses": 0.02 / math.sqrt(2.0), "clock": 1e-3}
    )
    assert tolerances_of(turbine.exact(), turbine.exact().sensors, []) == ()
    write_turbine(replace(turbine, mass_tolerance=0.05).exact(), tmp_path / "exact.toml")
    again = load_turbine(tmp_path / "exact.toml")
    assert tolerances_of(again, again.sensors, []) == ()


def test_what_is_identified_is_no_tolerance():
    tower = load_turbine("tower")
    masses = [one.of for one in tolerances_of(tower, tower.sensors, []) if one.group == "masses"]
    assert masses == ["top"]
    both = ["mass_side_side", "mass_fore_aft"]
    assert not [one for one in tolerances_of(tower, tower.sensors, both) if one.group == "masses"]


def test_an_operating_rotor_makes_the_fore_aft_stiffness_uncertain(tmp_path):
    """Air stiffened OpenFAST's towers fore-aft by 3 to 5 % of the frequency, and intervals left it out."""

    def aerodynamic(turbine):
        return [one for one in tolerances_of(turbine, turbine.sensors, []) if one.group == "aerodynamics"]

    tower = load_turbine("tower")
    (one,) = aerodynamic(tower)
    assert (one.of, one.spread) == ("k_fore_aft", AERODYNAMIC_STIFFNESS_DISCREPANCY)
    names = [*tower.values]
    p = np.array([tower.values[name] for name in names])
    moved = with_tolerances(p, names, [one], np.array([1.0]), tower, tower.sensors, ["k_fore_aft"]) / p
    at = names.index("k_fore_aft")
    assert moved[at] == pytest.approx(1.0 + one.spread)
    assert (np.delete(moved, at) == 1.0).all()
    write_turbine(replace(tower, aerodynamic_tolerance=0.03), tmp_path / "stiff.toml")
    (one,) = aerodynamic(load_turbine(tmp_path / "stiff.toml"))
    assert one.spread == 0.03
    locked = tower.with_model(TowerModel(fore_aft="locked"))
    for other in (tower.in_state("parked"), tower.exact(), locked, load_turbine("verne555")):
        assert not aerodynamic(other)


def test_aerodynamics_widen_the_fore_aft_mode_only_and_are_shared():
    tower = load_turbine("tower")
    record = simulate_record(tower, duration=270.0, rate=4.0, seed=3)
    with_air, without = (
        identify(record, turbine, formulation="spectral")
        for turbine in (tower, replace(tower, aerodynamic_tolerance=0.0))
    )
    side, fore = ((a.frequency.high - a.frequency.low) / (b.frequency.high - b.frequency.low)
                  for a, b in zip(with_air.modes, without.modes, strict=True))  # fmt: skip
    assert side == pytest.approx(1.0, abs=0.02)
    assert fore > 1.5
    assert with_air["k_fore_aft"].std > AERODYNAMIC_STIFFNESS_DISCREPANCY * with_air["k_fore_aft"].estimate
    share = dict(zip(with_air.budget.causes, with_air.budget.rows[2].causes, strict=True))
    assert with_air.budget.rows[2].name == "k_fore_aft"
    assert share["aerodynamics"] > 0.5
    at = [q.name for q in with_air.posterior.parameters].index("k_fore_aft")
    stds = [math.sqrt(one.posterior.given().cov[at, at]) for one in (with_air, without)]
    assert stds[0] == pytest.approx(stds[1], rel=0.05)


def test_tolerances_act_on_their_own_numbers_only():
    turbine = load_turbine("verne555")
    sensors = turbine.sensors
    names = [*turbine.values, *(name for i in range(len(sensors)) for name in instrument_parameters(i))]
    p = np.array([turbine.values.get(name, 0.0) for name in names])
    found = tolerances_of(turbine, sensors, ["blade_mass_2"])
    tau = np.arange(1.0, len(found) + 1.0)
    off = dict(zip(names, with_tolerances(p, names, found, tau, turbine, sensors, ["blade_mass_2"]) - p, strict=True))
    at = {one.name: value * one.spread for one, value in zip(found, tau, strict=True)}
    assert off["sensor_2_gain"] == pytest.approx(at["gain of tower_y_acceleration"])
    assert off["sensor_2_turn"] == pytest.approx(at["alignment of tower_y_acceleration"])
    assert off["sensor_3_turn"] == 0.0
    for name, body in (("hub_mass_y", "hub"), ("blade_inertia_2", "blade_2")):
        heavier = (1.0 + at[f"masses of {body}"]) * (1.0 + at["masses of all bodies"])
        assert off[name] == pytest.approx((heavier - 1.0) * turbine.values[name])
    assert off["blade_mass_2"] == off["k_x"] == off["hinge_offset"] == 0.0
    assert seconds_late(found, tau, sensors) == pytest.approx([0.0, 0.0, *[at["clock of rotor"]] * 3])
    learned = learned_tolerances(found, tau, np.eye(len(found)))
    assert learned[1].estimate == pytest.approx(0.02)
    assert learned[1].std == pytest.approx(0.01)


def test_the_least_exact_sensor_speaks_for_its_logger():
    sensors = (
        Accelerometer(channel="a", point="blade_1", axis="lag", noise=0.1, clock_tolerance=2e-3, logger="hub"),
        Accelerometer(channel="b", point="blade_2", axis="lag", noise=0.1, clock_tolerance=5e-4, logger="hub"),
        Accelerometer(channel="c", point="blade_3", axis="lag", noise=0.1, logger="tower"),
    )
    turbine = load_turbine("verne555").exact()
    clocks = [one for one in tolerances_of(turbine, sensors, []) if one.group == "clock"]
    assert [(one.of, one.spread) for one in clocks] == [("hub", 2e-3)]


@pytest.mark.parametrize("degrees", [5.0, -40.0])
def test_a_turned_axis_reads_what_a_sensor_along_it_would(degrees):
    # A sensor fixed to the tower may point along any bearing; its reading at b + φ is y_b cos φ + y_{b+90°} sin φ.
    tower, turn = TowerModel(), math.radians(degrees)
    at = Accelerometer(
        channel="a", point="tower", axis="bearing", frame="tower", bearing_deg=30.0, noise=0.1, feels_gravity=True
    )
    (reading,), (across,) = tower.readings([at]), tower.readings_across([at])
    assert across is not None
    (turned,) = tower.readings([at.model_copy(update={"bearing_deg": 30.0 + degrees})])
    difference = reading * math.cos(turn) + across * math.sin(turn) - turned
    symbols = sorted(difference.free_symbols, key=str)
    values = dict(zip(symbols, np.random.default_rng(1).standard_normal(len(symbols)), strict=True))
    assert abs(float(difference.subs(values))) < 1e-12


def test_across_a_level_axis_lies_gravity():
    rotor = RotorModel()
    side = Accelerometer(channel="a", point="tower", axis="x", noise=0.1, feels_gravity=True)
    (across,) = rotor.readings_across([side])
    assert across is not None
    at_rest = across.subs({symbol: 0 for symbol in across.free_symbols if str(symbol) != "gravity"})
    assert sp.simplify(at_rest - sp.Symbol("gravity", real=True)) == 0
    along = Accelerometer(
        channel="b", point="blade_1", axis="tangential", frame="blade", noise=0.1, position=(1.0, 0.0)
    )
    (inward,) = rotor.readings_across([along])  # turned from tangential towards the hub: centripetal acceleration
    assert inward is not None
    spinning = {"rotor_speed": 2.0, "hinge_offset": 0.2}
    value = inward.subs({symbol: spinning.get(str(symbol), 0.0) for symbol in inward.free_symbols})
    assert float(value) == pytest.approx(2.0**2 * 1.2)


def test_what_has_no_axis_is_not_turned():
    rotor = RotorModel()
    lag = Accelerometer(channel="a", point="blade_1", axis="lag", noise=0.1)
    gyroscope = AngularRateSensor(channel="b", point="tower", axis="x", noise=0.1)
    root = MomentSensor(channel="c", point="blade_1", axis="tangential", frame="blade", noise=0.1)
    assert rotor.readings_across([lag, gyroscope, root]) == [None, None, None]
    assert [sensor.alignment for sensor in (lag, gyroscope, root)] == [0.0, 0.0, 0.0]


def test_a_parked_tower_does_not_share_the_aerodynamics_of_an_operating_one():
    """A healthy tower was said to be softer when parked: both results were taken without what air adds."""
    tower = load_turbine("tower")
    states = (tower.in_state("parked"), tower)
    parked, operating = (
        identify(simulate_record(one, duration=600.0, rate=4.0, seed=3), one, formulation="spectral") for one in states
    )
    for pair in ((parked, operating), (operating, parked)):
        change = next(one for one in compare(*pair).coefficients if one.name == "k_fore_aft")
        assert math.log1p(0.01 * change.high) - math.log1p(0.01 * change.low) > 4.0 * AERODYNAMIC_STIFFNESS_DISCREPANCY
        # Damping of a healthy tower "fell" when it was parked: by that of its rotor in the air.
        assert [one.name for one in compare(*pair).coefficients] == ["k_side_side", "k_fore_aft"]
        assert "windsysid damping" in compare(*pair).notes[0]
    exact = identify(simulate_record(tower, duration=600.0, rate=4.0, seed=4), tower.exact(), formulation="spectral")
    found = compare(operating, exact)  # a file without tolerances was taken for that of a parked tower
    assert "c_side_side" in [one.name for one in found.coefficients]
    assert not any("operating rotor" in note for note in found.notes)
    assert [one.name for one in compare(parked, exact).coefficients] == ["k_side_side", "k_fore_aft"]
    same = next(one for one in compare(operating, operating).coefficients if one.name == "k_fore_aft")
    assert math.log1p(0.01 * same.high) - math.log1p(0.01 * same.low) < 4.0 * AERODYNAMIC_STIFFNESS_DISCREPANCY


def test_rivals_widen_what_aerodynamics_leave():
    """Comparisons took the fore-aft stiffness as known a quarter better than without the tolerance."""
    tower = load_turbine("tower")
    record = simulate_record(tower, duration=600.0, rate=4.0, seed=5)
    stds = []
    for turbine in (tower, replace(tower, aerodynamic_tolerance=0.0)):
        found = identify(record, turbine, formulation="spectral")
        assert "wider_intervals" in [one.code for one in found.findings]
        at = [q.name for q in found.posterior.parameters].index("k_fore_aft")
        stds.append(math.sqrt(found.posterior.given().cov[at, at]))
        assert all(row.alone + sum(row.causes) == pytest.approx(1.0) for row in found.budget.rows)
        mode = found.modes[1].frequency
        (row,) = (one for one in found.budget.rows if one.name == "tower fore-aft: frequency")
        assert row.two_sigma == pytest.approx(0.5 * (mode.high - mode.low) / mode.estimate, rel=1e-6)
    assert stds[0] == pytest.approx(stds[1], rel=0.05)
