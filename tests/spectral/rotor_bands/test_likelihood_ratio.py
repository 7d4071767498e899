"""Likelihood ratios of halves of a record, and of classes of the blades."""

from pathlib import Path
from types import SimpleNamespace as Namespace
from typing import Any

import numpy as np
import pytest

from windsysid.identification.identify import identify
from windsysid.records.formats import read_record
from windsysid.spectral.rotor_bands.likelihood_ratio import _of_two_values, _rows_of_classes
from windsysid.turbine.file import load_turbine

FOLDER = Path(__file__).parents[4] / "shared" / "data" / "openfast"
C2 = FOLDER / "c2_turb12_full.outb"


def reasons(file: str, first: float, last: float) -> tuple[set[str], set[str]]:
    pytest.importorskip("openfast_io.FAST_output_reader", reason="the extra windsysid[openfast] is not installed")
    found = identify(read_record(C2), load_turbine(file), section=(first, last))
    grades = {mode.frequency.grade for mode in found.modes if mode.name != "tower roll"}
    return grades, {one.code for one in found.findings if one.severity == "reason"}


@pytest.mark.parametrize(("depth", "expected"), [(0.0, 1 / 11), (50.0, 1.0), (2000.0, 1.0)])
def test_two_values_are_the_more_probable_the_less_the_halves_have_in_common(depth, expected):
    """The product of both likelihoods was 0 at every step for long records: the probability was NaN, and no reason."""
    steps = np.linspace(-0.2, 0.2, 41)
    values = np.full((2, 41), depth)
    values[0, 30], values[1, 2] = 0.0, 0.0
    far, chance = _of_two_values(steps, values)
    assert chance == pytest.approx(expected)
    assert far == pytest.approx(steps[2] if depth else 0.0)


@pytest.mark.skipif(not C2.exists(), reason="OpenFAST's records are not in this checkout")
@pytest.mark.slow
def test_halves_of_a_steady_record_are_no_reason_where_their_likelihoods_agree():
    """The difference of their estimates is far longer than its covariance lets expect; refits are not quadratic."""
    grades, codes = reasons("nrel5mw_full", 60.0, 330.0)
    assert (grades <= {"A", "B"}, codes) == (True, set())


@pytest.mark.skipif(not C2.exists(), reason="OpenFAST's records are not in this checkout")
@pytest.mark.slow
@pytest.mark.parametrize("first", [60.0, 240.0])
def test_three_minutes_of_a_rotor_are_usable(first):
    grades, codes = reasons("nrel5mw_full", first, first + 180.0)
    assert (grades <= {"A", "B"}, codes) == (True, set())


@pytest.mark.skipif(not C2.exists(), reason="OpenFAST's records are not in this checkout")
@pytest.mark.parametrize("first", [60.0, pytest.param(75.0, marks=pytest.mark.slow)])
def test_a_collective_mode_that_the_file_puts_elsewhere_is_a_reason(first):
    grades, codes = reasons("nrel5mw", first, first + 270.0)
    assert grades == {"C"}
    assert "class_disagrees_in_bands" in codes


def test_rows_of_a_class_have_its_mode():
    rows = [Namespace(combination=i) for i in (2, 0, 1)]
    posed: Any = Namespace(
        model=Namespace(bands=[Namespace(rows=rows)]),
        combined=[Namespace(shape=None), Namespace(shape=0), Namespace(shape=1)],
        places=[Namespace(name="tower x", shape=None), Namespace(name="lag collective", shape=0)],
    )
    assert [(i, place.name) for i, place in _rows_of_classes(posed)] == [(2, "lag collective")]
