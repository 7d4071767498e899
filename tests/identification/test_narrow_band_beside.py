"""The question of a narrow-band load, asked with instruments and masses where a search has put them."""

from dataclasses import replace

import numpy as np
import pytest
from validation.adversary.scenarios import SCENARIOS, record

import windsysid.identification.estimate.spectral.narrow_band_alternative as beside
from windsysid.identification.estimate.time_domain import identify_jointly
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.tolerances import ALL_BODIES
from windsysid.records.record import Record
from windsysid.spectral.rotor.problem import RotorQuestion
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine


@pytest.fixture(scope="module")
def rotor() -> Turbine:
    """With the tolerances that a file has by default."""
    return load_turbine("verne555")


@pytest.fixture(scope="module")
def turned() -> Record:
    """40 s of a rotor whose support has an accelerometer five degrees off its axis."""
    whole = record("5 degrees off", 7100)
    return whole.section(0.0, 40.0)


@pytest.fixture(scope="module")
def found(turned: Record, rotor: Turbine) -> Outcome:
    return identify_jointly(turned, rotor, rotor.sensors, Prior(), loads="broadband")


def asked_of(found: Outcome, made: Record, turbine: Turbine, monkeypatch: pytest.MonkeyPatch) -> list[RotorQuestion]:
    """The questions that were asked beside what was found."""
    questions = list[RotorQuestion]()
    monkeypatch.setattr(beside, "fit_narrow_band", lambda question, posed, broad: questions.append(question))
    beside.narrow_band_beside(found, made, turbine, turbine.sensors)
    return questions


def test_an_axis_is_where_the_search_has_put_it(
    found: Outcome, turned: Record, rotor: Turbine, monkeypatch: pytest.MonkeyPatch
):
    """And so are masses. A late clock is no number of the model: readings are put on time instead."""
    (question,) = asked_of(found, turned, rotor, monkeypatch)
    angle = next(one for one in found.tolerances if one.name == "alignment of tower_x_acceleration")
    assert abs(np.degrees(angle.estimate) - SCENARIOS["5 degrees off"].instruments.angle[0]) < 2.0
    moved = {name: value for name, value in question.turbine.values.items() if name not in rotor.values}
    assert sum(abs(value - angle.estimate) < 1e-12 for value in moved.values()) == 1
    heavier = sum(one.estimate for one in found.tolerances if one.group == "masses" and one.of in ("hub", ALL_BODIES))
    hub = rotor.values["hub_mass_x"] * (1.0 + heavier)
    assert question.turbine.values["hub_mass_x"] == pytest.approx(hub, rel=1e-9)


@pytest.mark.slow
def test_blades_that_are_late_are_no_loads_of_another_kind(rotor: Turbine):
    """Spectra took what two milliseconds do to phases for a narrow-band load; half of such records were condemned."""
    made = record("blades 2 ms late", 81004)
    near = identify_jointly(made, rotor, rotor.sensors, DrawnPrior(seed=81004), loads="broadband")
    found = beside.narrow_band_beside(near, made, rotor, rotor.sensors)
    assert found is not None
    assert not found.is_needed
    at_once = [replace(one, estimate=0.0) if one.group == "clock" else one for one in near.tolerances]
    unheard = beside.narrow_band_beside(near._replace(tolerances=tuple(at_once)), made, rotor, rotor.sensors)
    assert unheard is not None
    assert unheard.is_needed


def test_clocks_of_a_record_that_was_put_on_time_are_late_by_both(found: Outcome):
    moved = [replace(one, estimate=one.estimate + 1e-3) for one in found.tolerances]
    both = beside.told_before(found, found._replace(tolerances=tuple(moved)))
    assert "clock" in {one.group for one in found.tolerances}
    for one, before, after in zip(both.tolerances, found.tolerances, moved, strict=True):
        assert one.estimate == before.estimate + (after.estimate if one.group == "clock" else 0.0)


def test_nothing_is_asked_beside_damping_that_is_negative(
    found: Outcome, turned: Record, rotor: Turbine, monkeypatch: pytest.MonkeyPatch
):
    place = [q.kind for q in found.model.parameters].index("damping")
    undamped = found._replace(theta=np.where(np.arange(len(found.theta)) == place, -0.1, found.theta))
    assert asked_of(undamped, turned, rotor, monkeypatch) == []


def test_nothing_is_asked_beside_masses_that_cannot_be(
    found: Outcome, turned: Record, rotor: Turbine, monkeypatch: pytest.MonkeyPatch
):
    """A sensor that is mounted the wrong way round drives the search to negative masses: it ended in a traceback."""
    impossible = [replace(one, estimate=-60.0 * one.spread) for one in found.tolerances]
    wrong = found._replace(tolerances=tuple(impossible))
    assert asked_of(wrong, turned, rotor, monkeypatch) == []
