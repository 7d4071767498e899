"""What figures show: limits, colours, labels and captions."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from windsysid.monitoring.change import Comparison, QuantityChange
from windsysid.output.table import Table
from windsysid.reports import campbell, comparison, fleet, inspection, plan, watch
from windsysid.reports.figures import bands, plots
from windsysid.reports.figures.plots import ERROR, ESTIMATE, MEASURED
from windsysid.reports.interactive import inspection as inspection_pictures


def change(name: str, percent: float, log_odds: float) -> QuantityChange:
    return QuantityChange(name, "N/m", 1.0, 1.0, percent, percent - 1.0, percent + 1.0, log_odds, 0.5, "stiffness")


def test_a_coefficient_that_moved_is_orange_and_a_mode_is_grey():
    moved, steady, mode = change("k_a", -5.0, 10.0), change("k_b", 0.1, -1.0), change("bending", -2.5, np.nan)
    found = Comparison(("a", "b"), (moved, steady), (mode,), (), False, (), ())
    (ax,) = comparison.figure(found).axes
    assert [line.get_color() for line in ax.lines if line.get_marker() == "o"] == [ERROR, ESTIMATE, MEASURED]
    low, high = ax.get_xlim()
    assert low < -6.0
    assert high > 1.1


def test_an_axis_shows_all_but_the_farthest_values():
    values = np.append(np.linspace(0.0, 1.0, 999), 1e6)
    low, high = watch._limits(values)
    assert low < 0.0
    assert 1.0 < high < 2.0
    assert watch._limits(np.full(5, 2.0)) == pytest.approx((1.98, 2.02))
    np.testing.assert_array_equal(watch._highest(np.array([1.0, 3.0, 2.0]), 2), [3.0, 2.0])


@pytest.mark.parametrize(
    ("name", "shown"),
    [("k_beta_1", r"$k_{\beta 1}$"), ("k_side_side", "$k$ side-side"), ("noise", "noise"), ("c_x", "$c_{x}$")],
)
def test_a_name_is_written_as_formulas_have_it(name: str, shown: str):
    assert plots.symbol(name) == shown


def test_names_at_the_end_of_curves_do_not_overlap():
    figure = Figure(figsize=(5, 4))
    ax = figure.subplots()
    ax.set_ylim(0.0, 10.0)
    campbell._label_ends(ax, [(5.0, "a", "k"), (5.01, "b", "k"), (5.02, "c", "k")])
    places = [text.get_position()[1] for text in ax.texts]
    assert np.diff(places).min() > 0.2


def test_curves_that_end_together_share_a_label():
    ax = Figure().subplots()
    time = np.array([1.0, 10.0])
    kinds = {"k_a": "stiffness", "k_b": "stiffness", "c_a": "damping"}
    plan._draw_bands(ax, time, {"k_a": time, "k_b": 1.01 * time, "c_a": 1.02 * time}, kinds)
    assert sorted(text.get_text().count(",") for text in ax.texts) == [0, 1]


def test_a_section_without_rows_says_so():
    assert fleet._listed("Jumps", "Nothing jumped.", Table(("a",), [])).text == ["Nothing jumped."]
    assert fleet._listed("Jumps", "Nothing jumped.", Table(("a",), [("x",)])).text == ()


def test_a_record_without_a_good_section_is_warned_of():
    class Proposal(SimpleNamespace):
        def __str__(self) -> str:
            return "short"

    poor: Any = SimpleNamespace(proposals=[Proposal(start=0.0, end=10.0, good=False)])
    assert inspection._proposals(poor) == [
        "WARNING: no section of this record is good.", "1. 0–10 s, poor: short.",
    ]  # fmt: skip


def test_many_faults_are_thinned_and_none_is_kept():
    spans = np.column_stack([np.arange(1000.0), np.arange(1000.0) + 0.5])
    assert len(inspection_pictures.some(spans)) <= inspection_pictures.MAX_MARKS
    assert inspection_pictures.some(np.empty((0, 2))).shape == (0, 2)


def test_a_band_about_the_result_is_marked():
    estimate: Any = SimpleNamespace(
        name="k_a", kind="stiffness", unit="N/m", estimate=2.0, low=1.0, high=3.0, reference=None
    )
    ax = Figure().subplots()
    assert bands._draw_row(ax, 0, estimate, [1.0, 3.0]) == (-50.0, 50.0)
