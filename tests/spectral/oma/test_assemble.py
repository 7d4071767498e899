"""Units and spectra of the result."""

from typing import Any

import pytest

import windsysid as ws
from tests.findings import codes, only
from windsysid.spectral.oma.assemble import acceleration_unit
from windsysid.spectral.oma.result import OperationalModes


@pytest.mark.parametrize(
    ("unit", "order", "expected"),
    [("m/s^2", 2, "m/s^2"), ("m/s", 1, "m/s^2"), ("m", 0, "m/s^2"), ("N m", 0, "N m/s^2"), ("1", 0, "1/s^2")],
)
def test_shapes_have_the_units_of_accelerations(unit: str, order: int, expected: str):
    assert acceleration_unit(unit, order) == expected


def tower_modes(seed: int, **options: Any) -> OperationalModes:
    return ws.oma(ws.simulate("tower", duration=600.0, rate=5.0, seed=seed), **options)


def test_a_peak_that_no_mode_explains_is_a_remark():
    found = tower_modes(1, turbine="tower")
    assert [mode.name for mode in found.modes] == ["tower side-side"]
    remark = only(found.findings, "unlisted_vibration")
    assert remark.channels == ("tower_z_acceleration",)
    assert remark.data["frequency"] == pytest.approx(0.324, rel=0.1)
    assert remark.severity == "remark"
    assert list(only(found.findings, "modes_not_found").data["modes"]) == ["tower fore-aft"]
    assert found.trusted
    for text in (str(found), found.files()["report.html"].decode()):
        assert str(remark).split(":")[0] + ": most of its vibration" in text
    assert [one["code"] for one in found.summary()["findings"]] == ["unlisted_vibration", "modes_not_found"]


def test_nothing_is_remarked_where_the_modes_explain_the_peaks():
    record = ws.simulate("nrel5mw", duration=600.0, rate=5.0, seed=1)
    assert "unlisted_vibration" not in codes(ws.oma(record).findings)


def test_modes_of_a_turbine_outside_the_searched_range_are_not_missed():
    found = tower_modes(1, turbine="tower", bands=[(0.29, 0.32)])
    assert "modes_not_found" not in codes(found.findings)


def test_a_channel_of_several_records_is_remarked_once():
    found = ws.oma([ws.simulate("tower", duration=600.0, rate=5.0, seed=seed) for seed in (1, 2)])
    assert [one.channels for one in found.findings] == [("tower_z_acceleration",)]
