"""Modes from free decays, and records that are none."""

import numpy as np
import pytest
from validation.decays import CASES, ambient, judge, main, records_of

import windsysid as ws
from windsysid.errors import RecordError


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name, marks=[pytest.mark.slow] if k in (1, 4) else [])
        for k, case in enumerate(CASES[:6])
    ],
)
def test_modes_of_a_decay_are_usable_and_within_four_sigma(case):
    judged = judge(case, 11)
    assert (judged.found, judged.usable, judged.spurious) == (judged.true, judged.true, 0)
    assert np.abs(judged.errors).max() < 4.0


def test_ambient_vibration_has_no_usable_mode():
    assert ambient(0, 60.0) == 0


def test_noise_is_refused_in_one_line():
    t = np.arange(0.0, 60.0, 0.02)
    record = ws.Record(t, np.random.default_rng(0).normal(size=(len(t), 2)), ("a_acceleration", "b_acceleration"),
        ("m/s^2",) * 2)  # fmt: skip
    with pytest.raises(RecordError, match="expected a free decay, got none"):
        ws.free_decay(record)


def test_shapes_of_setups_are_put_together():
    case = CASES[1]
    first, second = (records_of(case._replace(noise=0.01), 5)[0] for _ in range(2))
    found = ws.free_decay([first.select(first.channels[:3]), second.select(second.channels[1:])])
    assert len(found.channels) == 4
    whole = ws.free_decay(first)
    assert np.diag(whole.mac(found)) == pytest.approx([1.0, 1.0, 1.0], abs=2e-3)
    assert [part.channels for part in found.parts] == [first.channels[:3], second.channels[1:]]
    for mode in found.modes:
        assert np.all(np.abs(mode.shape.imag) < 5.0 * mode.shape_std + 1e-9)


@pytest.mark.slow
def test_a_mode_that_is_removed_by_hand_is_removed_from_each_record():
    """The table of records held the shapes of the modes that are left against those of others."""
    records = records_of(CASES[1]._replace(noise=0.01), 5)[0]
    both = [records, records.select(records.channels[:3])]
    whole = ws.free_decay(both)
    found = ws.free_decay(both, marks=ws.results.ModeMarks(remove=(whole.modes[0].frequency.estimate,)))
    assert len(found.modes) == len(found.bands) == len(whole.modes) - 1
    for part in found.parts:
        for own, mode in zip(part.modes, found.modes, strict=True):
            assert own is not None
            assert own.frequency.estimate == pytest.approx(mode.frequency.estimate, rel=0.01)


def test_a_machine_among_decays_condemns_them():
    t = np.arange(0.0, 60.0, 0.02)
    decay = np.exp(-0.06 * t) * np.cos(6.0 * t) + 0.6 * np.cos(14.0 * t)
    noisy = decay + 0.01 * np.random.default_rng(0).normal(size=len(t))
    found = ws.free_decay(ws.Record(t, noisy[:, None], ("a_acceleration",), ("m/s^2",)))
    assert not any(mode.trusted for mode in found.modes)


def test_a_combination_of_two_modes_is_not_one_more():
    t = np.arange(0.0, 80.0, 0.02)
    x = sum(np.exp(-0.05 * t) * np.cos(2.0 * np.pi * f * t + f) for f in (0.8, 2.1))
    noisy = x + 0.03 * x**2 + 1e-4 * np.random.default_rng(0).normal(size=len(t))
    found = ws.free_decay(ws.Record(t, noisy[:, None], ("a_acceleration",), ("m/s^2",)))
    usable = [mode.frequency.estimate for mode in found.modes if mode.trusted]
    assert usable == pytest.approx([0.8, 2.1], rel=1e-3)
    assert len(found.modes) > 3


def test_a_saved_result_comes_back_with_its_histories(tmp_path):
    found = ws.free_decay(records_of(CASES[0], 3)[0])
    found.save(tmp_path / "out")
    again = ws.load_result(tmp_path / "out")
    assert isinstance(again, ws.results.OperationalModes)
    assert again.method == "free decays"
    np.testing.assert_array_equal(again.decays[0].fitted, found.decays[0].fitted)
    assert again.summary()["modes"][0]["frequency"] == found.summary()["modes"][0]["frequency"]


@pytest.mark.slow
def test_intervals_hold_the_truth(capsys):
    errors = np.vstack([judge(case, 300 + seed).errors for case in CASES[:4] for seed in range(12)])
    assert np.all(np.mean(np.abs(errors) < 2.0, axis=0) > 0.9)  # 108 modes: 95 % less 2.4 standard deviations
    main(["--runs", "1"])
    assert "one mode" in capsys.readouterr().out


@pytest.mark.parametrize("known", [True, False], ids=["rotor speed", "line in the fit"])
def test_a_sideband_of_the_rotor_is_no_mode(known):
    """Periodic coefficients make of a mode at f one at f ± nP that decays as it; such a line was of grade A."""
    t = np.arange(0.0, 120.0, 0.02)
    decay = np.exp(-0.05 * t)
    swing = decay * (np.cos(2.0 * np.pi * 0.9 * t) + 0.04 * np.cos(2.0 * np.pi * 1.5 * t + 1.0))
    line = 0.0 if known else 0.01 * np.sin(2.0 * np.pi * 0.6 * t)
    noise = 0.001 * np.random.default_rng(0).normal(size=(2, len(t)))
    values = [swing + line + noise[0], 0.5 * swing + line + noise[1]]
    names, units = ["tower_x_acceleration", "tower_z_acceleration"], ["m/s^2"] * 2
    if known:
        values, names, units = [*values, np.full(len(t), 0.4 * np.pi)], [*names, "Drehzahl"], [*units, "rad/s"]
    found = ws.free_decay(ws.Record(t, np.column_stack(values), tuple(names), tuple(units)))
    usable = {round(mode.frequency.estimate, 1): mode.trusted for mode in found.modes}
    assert (usable[0.9], usable[1.5]) == (True, False)


def test_a_true_mode_at_such_a_distance_that_decays_otherwise_stays():
    t = np.arange(0.0, 120.0, 0.02)
    swing = np.exp(-0.05 * t) * np.cos(2.0 * np.pi * 0.9 * t)
    swing += 0.04 * np.exp(-0.1 * t) * np.cos(2.0 * np.pi * 1.5 * t + 1.0)
    values = [swing + 0.001 * np.random.default_rng(0).normal(size=len(t)), np.full(len(t), 0.4 * np.pi)]
    record = ws.Record(t, np.column_stack(values), ("tower_x_acceleration", "rotor_speed"), ("m/s^2", "rad/s"))
    assert [mode.trusted for mode in ws.free_decay(record).modes] == [True, True]


def test_a_decay_at_a_high_rate_costs_no_more_than_its_vibration_needs():
    """Ten minutes at 100 Hz of a tower took 15 to 185 seconds of processor time."""
    t = np.arange(0.0, 300.0, 0.005)
    swing = np.exp(-0.01 * t) * np.cos(2.0 * t)
    record = ws.Record(t, swing[:, None], ("tower_x_acceleration",), ("m/s^2",))
    found = ws.free_decay(record)
    assert found.elapsed < 5.0
    assert found.modes[0].damping_ratio.estimate == pytest.approx(0.005, rel=1e-3)
    assert found.samples > 50000
