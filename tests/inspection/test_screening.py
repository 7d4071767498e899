"""Every identification checks its record: it refuses what makes numbers wrong, and notes what makes them worse."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import windsysid as ws
from tests.findings import only
from windsysid.errors import RecordError
from windsysid.fleet.rows import empty_row, row_of
from windsysid.identification.condition.readings import screened, usable_sensors
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.inspection import screening
from windsysid.inspection.fault import Fault
from windsysid.inspection.faults import clock
from windsysid.inspection.screening import noted, screen
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record

pytestmark = pytest.mark.usefixtures("without_effects")


SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
TOWER, BLADE = "tower_x_acceleration", "blade_2_lag_acceleration"
G = 9.80665


@pytest.fixture(scope="module")
def healthy(verne555):
    return simulate_record(verne555, duration=60.0, rate=50.0, seed=3)


def changed(record: Record, channel: str, values) -> Record:
    return record.with_channels({channel: (values, record.unit(channel))})


def findings(record, turbine):
    return screened(record, turbine, usable_sensors(record, turbine, None))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
@pytest.mark.parametrize("name", ws.packaged_turbines())
def test_the_simulated_record_of_every_packaged_turbine_passes(name, seed):
    turbine = ws.load_turbine(name)
    assert findings(simulate_record(turbine, duration=60.0, rate=50.0, seed=seed), turbine) == []


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared records are not beside the checkout")
@pytest.mark.parametrize(
    "file",
    [
        "c2_turb12_full",
        *(pytest.param(one, marks=pytest.mark.slow) for one in ("a2_rot12_decay_min", "d1_turb12_full_KSS090")),
    ],
)
def test_an_independent_simulation_passes(file):
    pytest.importorskip("openfast_io.FAST_output_reader", reason="the extra windsysid[openfast] is not installed")
    record = ws.read_record(SHARED / "openfast" / f"{file}.outb")
    for name in ("nrel5mw", "nrel5mw_full", *(("tower",) if file[0] != "a" else ())):  # a2 holds the tower fore and aft
        assert findings(record.section(60.0, 160.0), ws.load_turbine(name)) == [], name


@pytest.mark.parametrize(("step", "refused"), [(50.0, True), (1.0, False), (0.05 / 24.0 / 3600.0, False)])
def test_a_time_that_is_in_no_seconds_is_refused_or_named(healthy, verne555, step, refused):
    odd = Record(step * np.arange(healthy.samples), healthy.values, healthy.channels, healthy.units)
    support = [channel for channel in odd.channels if channel.startswith("tower")]
    if refused:
        with pytest.raises(RecordError, match=r"every 50 s.*write its unit into its heading, as in 'time \[ms\]'"):
            ws.oma(odd.select(support))
    else:
        found = [finding.text for finding in screen(odd, None, support) if finding.channel == "time"]
        assert len(found) == 1
        assert f"write 'time [{'ms' if step == 1.0 else 'h'}]'" in found[0]


# A unit that is evidently wrong: what the file says, how much the values are off, and the turbine whose record it is.
WRONG: dict[str, tuple[str, str, Callable[[Any], Any], str]] = {
    "an upright accelerometer in g": ("verne555", TOWER, lambda x: x / G + 1.0, "g marked as m/s²"),
    "an upright accelerometer in mg": ("verne555", TOWER, lambda x: 1e3 * (x / G + 1.0), "mg marked as m/s²"),
    "m/s² marked as g": ("verne555", TOWER, lambda x: (x + G) * G, "m/s² marked as g"),
    "a blade's accelerometer in g": ("nrel5mw", "blade_1_tip_lag_acceleration", lambda x: x / G, "g marked as m/s²"),
    "a blade's accelerometer in mg": ("nrel5mw", "blade_1_tip_lag_acceleration", lambda x: 1e3 * x / G, "mg marked"),
    "a tower in mg": ("tower", TOWER, lambda x: 200.0 * x / np.std(x), "too large for a support"),
    "azimuth in degrees": ("verne555", "rotor_azimuth", np.rad2deg, "degrees marked as rad"),
    "yaw in degrees": ("tower", "nacelle_yaw", lambda x: 237.0 + x, "degrees marked as rad"),
    "rotor speed in rpm": ("tower", "rotor_speed", lambda x: x * 30.0 / np.pi, "rpm marked as rad/s"),
    "rotor speed in deg/s": ("tower", "rotor_speed", np.rad2deg, "degrees marked as radians"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_unit_that_is_evidently_wrong_is_refused(case):
    name, channel, wrong, message = WRONG[case]
    turbine = ws.load_turbine(name)
    record = simulate_record(turbine, duration=60.0, rate=50.0, seed=1)
    if name == "tower" and channel != TOWER:
        record = record.select([c for c in record.channels if c != "rotor_azimuth"])
    with pytest.raises(RecordError, match=f"'{channel}'.*{message}.*Correct its unit") as caught:
        findings(changed(record, channel, wrong(record[channel])), turbine)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("channel", "code"), [(TOWER, 1e5), (TOWER, 9.96921e36), ("blade_1_lag_acceleration", 1e4)])
def test_one_code_for_no_reading_says_nothing_about_the_unit(verne555, healthy, channel, code):
    values = healthy[channel].copy()
    values[1000] = code
    assert not any(one.kind == "unit" for one in findings(changed(healthy, channel, values), verne555))


def test_a_decay_in_another_unit_is_no_code():
    """Most of the record is quiet, so that its beginning is far from the median."""
    time = np.arange(0.0, 120.0, 0.02)
    noise = np.random.default_rng(5).normal(size=time.size)
    decay = 1000.0 * np.exp(-time / 8.0) * np.sin(4.0 * np.pi * time) + noise  # mg
    with pytest.raises(RecordError, match="too large for a support"):
        screen(Record(time, decay[:, None], (TOWER,), ("m/s^2",)), None, [TOWER])


def test_an_idling_rotor_is_not_taken_for_a_wrong_unit():
    tower = ws.load_turbine("tower")
    record = simulate_record(tower, duration=60.0, rate=50.0, seed=1).select(
        [TOWER, "tower_z_acceleration", "rotor_speed"]
    )
    for share in (0.0, 0.02, 0.1, 0.16, 0.5, 1.3):
        assert findings(changed(record, "rotor_speed", share * record["rotor_speed"]), tower) == []


def test_an_offset_that_the_sensor_announces_is_no_gravity(verne555, healthy):
    tilted = changed(healthy, TOWER, healthy[TOWER] / G + 1.0)
    sensors = usable_sensors(tilted, verne555, None)
    with pytest.raises(RecordError, match="gravity"):
        screened(tilted, verne555, sensors)
    biased = [s.model_copy(update={"bias": 0.5}) if s.channel == TOWER else s for s in sensors]
    assert [f.kind for f in screened(tilted, verne555, biased)] == ["unit"]


@pytest.mark.parametrize("dead", [np.zeros, lambda n: np.full(n, 0.3)])
def test_a_dead_channel_is_refused_by_name(verne555, healthy, dead):
    with pytest.raises(RecordError, match=f"'{BLADE}' is .* from the first sample to the last: disconnected"):
        ws.identify(changed(healthy, BLADE, dead(healthy.samples)), verne555)
    stuck = healthy[BLADE]
    stuck[1000:] = stuck[1000]
    with pytest.raises(RecordError, match=f"'{BLADE}' repeats one value in most of the record"):
        identify_pieces([changed(healthy, BLADE, stuck)], verne555)


@pytest.mark.filterwarnings("error")
def test_values_that_no_instrument_reads_are_refused(verne555, healthy):
    from windsysid.inspection import inspect_record

    values = healthy[TOWER]
    values[5] = -1e300
    huge = changed(healthy, TOWER, values)
    for refuse in (lambda: ws.identify(huge, verne555), lambda: inspect_record(huge)):
        with pytest.raises(RecordError, match=f"'{TOWER}' reaches 1e.300: expected less than 1e.100"):
            refuse()


def faulty(healthy):
    """Spikes, clipping, a stuck stretch and a gap, in three channels."""
    spiked, stuck, clipped = (healthy[c] for c in (TOWER, "blade_1_lag_acceleration", BLADE))
    spiked[[500, 1500]] += 30.0 * spiked.std()
    stuck[2000:2100] = stuck[2000]
    level = 2.2 * clipped.std()
    record = changed(healthy, TOWER, spiked)
    record = changed(record, "blade_1_lag_acceleration", stuck)
    record = changed(record, BLADE, np.clip(clipped, -level, level))
    keep = np.ones(record.samples, dtype=bool)
    keep[700:760] = False
    return replace(record, time=record.time[keep], values=record.values[keep])


EXPECTED = {("", "gaps"), (TOWER, "spikes"), ("blade_1_lag_acceleration", "frozen"), (BLADE, "clipping")}


def test_faults_that_make_a_result_worse_are_noted(verne555, healthy):
    found = findings(faulty(healthy), verne555)
    assert {(f.channel, f.kind) for f in found} == EXPECTED
    notes = noted(found)
    spikes, gaps = only(notes, "spikes"), only(notes, "gaps")
    assert (spikes.channels, spikes.data["count"], spikes.severity) == ((TOWER,), 2, "note")
    assert str(spikes).startswith(f"{TOWER}: 2 spikes")
    assert str(gaps).startswith("record: 1 gap")


def test_the_notes_stand_in_result_terminal_and_report():
    from windsysid.reports.identification import identification_report

    tower = ws.load_turbine("tower")
    record = simulate_record(tower, duration=40.0, rate=10.0, seed=1)
    spiked = record[TOWER]
    spiked[[100, 300]] += 30.0 * spiked.std()
    record = changed(record, TOWER, spiked)
    found = ws.identify(record, tower, loads="broadband")
    assert only(found.findings, "spikes").channels == (TOWER,)
    assert "2 spikes" in str(found)
    assert any("2 spikes" in note for note in found.summary()["notes"])
    assert b"2 spikes" in identification_report(found, record)


def test_pieces_of_a_record_share_a_note():
    time = np.arange(2000.0) * 0.02
    values = np.random.default_rng(0).standard_normal(2000)
    values[[300, 700, 1300]] = 40.0
    record = Record(time, values[:, None], ("a_acceleration",), ("m/s^2",))
    parts = [record.section(a, a + 10.0) for a in (0.0, 10.0, 20.0, 30.0)]
    found = [f for part in parts for f in screen(part, None, ["a_acceleration"], refuse=False)]
    (note,) = noted(found)
    assert (note.code, note.channels, note.data["pieces"]) == ("spikes", ("a_acceleration",), 3)
    assert str(note).startswith("a_acceleration: spikes in 3 pieces; the first: 1 spike ")


def test_a_load_in_another_unit_is_refused(verne555, healthy):
    loaded = healthy.with_channels({"load_x": (np.zeros(healthy.samples), "1")})
    with pytest.raises(RecordError, match="'load_x': expected N, got 1"):
        usable_sensors(loaded, verne555, None)


def test_a_row_of_an_archive_looks_at_its_record_once(monkeypatch):
    looks: list[tuple[str, ...]] = []

    def counted(record: Record) -> list[Fault]:
        looks.append(record.channels)
        return clock.clock_faults(record)

    monkeypatch.setattr(screening, "clock_faults", counted)
    tower = ws.load_turbine("tower")
    record = simulate_record(tower, duration=60.0, rate=20.0, seed=4)
    windy = record.with_channels({"wind_speed": (np.full(record.samples, 8.0), "m/s")})
    row = row_of(empty_row("a.csv", 1, ""), windy, tower, None, "auto")
    assert row["status"] == "ok"
    assert len(looks) == 1
    assert "wind_speed" in looks[0]
    row_of(empty_row("a.csv", 1, ""), replace(windy), tower, None, "auto")
    assert len(looks) == 2
