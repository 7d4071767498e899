"""Operating states and SCADA beside a record."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.fleet.scada import Scada, read_scada
from windsysid.turbine.operation import operation_of

USUAL = 1.27


@pytest.mark.parametrize(
    ("speed", "power", "state"),
    [
        (np.full(100, 0.01), None, "parked"),
        (np.full(100, 0.3 * USUAL), None, "idling"),
        (np.full(100, 0.9 * USUAL), None, "running"),
        (np.full(100, 0.3 * USUAL), 2e5, "running"),
        (np.full(100, 0.9 * USUAL), -1e3, "idling"),
        (np.linspace(0.0, USUAL, 100), 1e6, "transient"),
        (np.linspace(0.6 * USUAL, USUAL, 100), 1e6, "transient"),
        (USUAL * (0.8 + 0.1 * np.sin(np.arange(100))), 1e6, "running"),
        (-np.full(100, 0.9 * USUAL), None, "running"),
        (None, 1e6, "unknown"),
        (np.full(100, np.nan), None, "unknown"),
    ],
)
def test_states_are_told_apart(speed: np.ndarray | None, power: float | None, state: str):
    assert operation_of(speed, USUAL, power).state == state


def test_bin_of_the_rotor_speed_is_its_lower_edge():
    assert operation_of(np.array([0.87 * USUAL]), USUAL).speed_bin == pytest.approx(0.8)
    assert operation_of(np.array([USUAL]), USUAL).speed_bin == pytest.approx(1.0)


BEGIN = datetime(2026, 3, 1, tzinfo=UTC)


def scada(**columns: list[float]) -> Scada:
    arrays = {name: np.array(values) for name, values in columns.items()}
    return Scada(BEGIN, np.arange(0.0, 2400.0, 600.0), 600.0, arrays)


def test_a_record_has_the_mean_of_the_lines_that_it_overlaps():
    found = scada(wind_speed=[4.0, 6.0, 8.0, 10.0], state=[1.0, 1.0, 2.0, 2.0]).during(
        BEGIN + timedelta(seconds=900), 600.0
    )
    assert found == {"wind_speed": pytest.approx(7.0), "state": 1.0}
    found = scada(wind_speed=[4.0, 6.0, 8.0, 10.0]).during(BEGIN + timedelta(seconds=600), 600.0)
    assert found == {"wind_speed": 6.0}


def test_yaw_is_averaged_on_the_circle():
    found = scada(yaw=[0.1, 2.0 * np.pi - 0.1, 0.0, 0.0]).during(BEGIN, 1200.0)
    assert np.cos(found["yaw"]) == pytest.approx(1.0)


def test_too_little_scada_says_nothing():
    known = scada(wind_speed=[4.0, np.nan, 8.0, 10.0])
    assert known.during(BEGIN + timedelta(seconds=400), 600.0) == {}  # a third of it
    assert known.during(BEGIN - timedelta(days=1), 600.0) == {}
    assert known.during(BEGIN + timedelta(days=1), 600.0) == {}


def test_zones_must_agree():
    with pytest.raises(ConfigurationError, match=r"SCADA says its zone and the record does not|the record"):
        scada(wind_speed=[4.0] * 4).during(datetime(2026, 3, 1), 600.0)


def test_scada_is_read_as_records_are(tmp_path: Path):
    path = tmp_path / "scada.csv"
    path.write_text("time,WTUR_W [kW],wind_speed [m/s]\n2026-03-01T00:00:00Z,1500,8\n2026-03-01T00:10:00Z,1600,9\n")
    rules = tmp_path / "mapping.toml"
    rules.write_text('[channels."WTUR_W"]\nname = "power"\nunit = "kW"\n')
    found = read_scada(path, rules)
    assert found.period == 600.0
    assert found.columns["power"].tolist() == pytest.approx([1.5e6, 1.6e6])
    path.write_text("time,oil [degC]\n2026-03-01T00:00:00Z,1500\n2026-03-01T00:10:00Z,1600\n")
    with pytest.raises(ConfigurationError, match="expected one of wind_speed, power"):
        read_scada(path)
    path.write_text("time [s],power [kW]\n0,1500\n600,1600\n")
    with pytest.raises(ConfigurationError, match="no dates"):
        read_scada(path)
