"""Joint modes of several records: common sensors, start values, tests of scatter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import windsysid as ws
from windsysid.results.estimate import IntervalEstimate
from windsysid.spectral.modal_bands.model_order import fit_band
from windsysid.spectral.oma.multi_setup import _chi2_probability, _sensor_key, _start_of, _union
from windsysid.spectral.oma.sensors import ModalSensor

from ..oscillators import modal_responses
from .modes import mode


def test_the_test_of_scatter_is_chi_squared():
    assert _chi2_probability(9.2, 3) == pytest.approx(float(chi2.sf(9.2, 3)))


def test_the_start_is_the_weighted_mean_of_frequencies_and_the_median_of_damping():
    modes = [
        replace(mode(f, z), frequency=IntervalEstimate.normal(f, std, "Hz"))
        for f, z, std in ((1.0, 0.01, 0.1), (1.1, 0.02, 0.2), (1.05, 0.05, 0.1))
    ]
    assert _start_of(modes) == pytest.approx(((100 * 1.0 + 25 * 1.1 + 100 * 1.05) / 225, 0.02))


def test_sensors_are_the_same_by_position_and_direction_or_else_by_channel():
    placed = ModalSensor(channel="a", position=(0.0, 0.0, 1.0), direction=(1.0, 0.0, 0.0))
    assert _sensor_key("a", placed) == _sensor_key("b", placed)
    assert _sensor_key("a", ModalSensor(channel="a", position=(0.0, 0.0, 1.0))) == "a"
    assert _sensor_key("blades collective", None) == "blades collective"


def test_a_union_keeps_the_order_and_each_element_once():
    assert _union([["b", "a"], ["a", "c"], []]) == ("b", "a", "c")


@pytest.fixture(scope="module")
def setups() -> list[ws.Record]:
    """Two records of three floors, with sensors on two of them each."""
    rng, records = np.random.default_rng(3), []
    for floors in ([0, 1], [0, 2]):
        q, _ = modal_responses([1.1], [0.015], 5.0, 3000, rng)
        values = (q / q.std()) @ np.array([[0.4, 0.8, 1.0]])[:, floors] + 0.05 * rng.normal(size=(3000, 2))
        names = tuple(f"floor_{floor}_displacement" for floor in floors)
        records.append(ws.Record(np.arange(3000) / 5.0, values, names, ("m",) * 2, name=f"setup {floors[1]}"))
    return records


def test_two_setups_give_one_mode_with_a_shape_in_all_sensors(setups: list[ws.Record]):
    found = ws.oma(setups, bands=[(0.8, 1.4)])
    (joint,) = found.modes
    assert found.channels == ("floor_0_displacement", "floor_1_displacement", "floor_2_displacement")
    assert abs(joint.frequency.estimate - 1.1) < 3.0 * joint.frequency.std
    assert np.all(np.abs(joint.shape.real - [0.4, 0.8, 1.0]) < 4.0 * joint.shape_std + 1e-9)
    assert [part.record for part in found.parts] == ["setup 1", "setup 2"]


def test_a_mode_of_a_band_that_is_crowded_in_one_record_is_not_usable(
    setups: list[ws.Record], monkeypatch: pytest.MonkeyPatch
):
    """Of one record such a mode had grade C, and of two records A."""
    monkeypatch.setattr(
        "windsysid.spectral.oma.search.fit_band", lambda *given: fit_band(*given)._replace(crowded=True)
    )
    (joint,) = ws.oma(setups, bands=[(0.8, 1.4)]).modes
    assert (joint.frequency.grade, joint.doubted_for("search")) == ("C", True)


def test_records_without_a_common_sensor_cannot_be_joined(setups: list[ws.Record]):
    moved = ws.Record(setups[1].time, setups[1].values, ("roof_a_displacement", "roof_b_displacement"), ("m", "m"))
    with pytest.raises(ws.ConfigurationError, match="no sensor in common"):
        ws.oma([setups[0], moved], bands=[(0.8, 1.4)])
