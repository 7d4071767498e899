"""What figures show: limits, colours, labels and captions."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from windsysid.monitoring.change import Comparison, QuantityChange
from windsysid.output.table import Table
from windsysid.reports import comparison, fleet, inspection, watch
from windsysid.reports.figures import plots
from windsysid.reports.figures.drawing import drawn
from windsysid.reports.figures.plots import ERROR, ESTIMATE, MEASURED
from windsysid.reports.html import Section, reasons_against, report_page
from windsysid.reports.interactive import inspection as inspection_plots
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve, ShadedRange
from windsysid.reports.interactive.svg import static_svg


def change(name: str, percent: float, log_odds: float) -> QuantityChange:
    return QuantityChange(name, "N/m", 1.0, 1.0, percent, percent - 1.0, percent + 1.0, log_odds, 0.5, "stiffness")


def test_a_coefficient_that_changed_is_orange_and_a_mode_is_grey():
    moved, steady, mode = change("k_a", -5.0, 10.0), change("k_b", 0.1, -1.0), change("bending", -2.5, np.nan)
    found = Comparison(("a", "b"), (moved, steady), (mode,), (), False, (), ())
    (ax,) = comparison.figure(found).axes
    assert [line.get_color() for line in ax.lines if line.get_marker() == "o"] == [ERROR, ESTIMATE, MEASURED]
    low, high = ax.get_ylim()
    assert low < -6.0
    assert high > 1.1
    nothing = Comparison(("a", "b"), (), (), (), False, (), ())
    assert comparison.figure(nothing).texts[0].get_text() == "The records determine no change."


def described(**changes: Any) -> Plot:
    x = np.linspace(0.1, 2.0, 50)
    given: dict[str, Any] = {
        "title": "$cost$", "x": x, "x_axis": Axis("x", log=True), "y_axis": Axis("y", log=True),
        "curves": [PlotCurve("k_a", x, 0.5 * x, 2.0 * x), PlotCurve("b", x, 0.5 * x, 2.0 * x, "bars", "measured")],
        "marks": [Mark(0.5, "mode"), Mark(0.51, "too near"), Mark(1.0, "limit", across=True)],
        "spans": [ShadedRange(0.2, 0.3)],
    }  # fmt: skip
    return Plot(**{**given, **changes})


def test_a_description_is_drawn_with_names_that_have_room():
    (ax,) = drawn([described()]).axes
    assert {text.get_text() for text in ax.texts} == {"mode", "limit"}
    assert ax.get_yscale() == "log"
    assert [ax.get_visible() for ax in drawn([described()] * 3).axes] == [True, True, True, False]
    own = Figure().subplots()
    assert drawn([described(x_axis=Axis("", dates=True), marks=[], spans=[])], own) is own.figure
    named = described(
        x=[0, 1], curves=[PlotCurve("c", [1, 2], look="dots")], x_axis=Axis("", names=("a", "b")), marks=[]
    )
    assert [tick.get_text() for tick in drawn([named]).axes[0].get_xticklabels()] == ["a", "b"]


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


def test_names_at_the_ends_of_curves_neither_overlap_nor_leave_the_picture():
    x = np.array([1.0, 5.0, 10.0])
    curves = [PlotCurve(f"c_{i}", np.full(3, 1.0 + 1e-3 * i)) for i in range(9)]
    curves.append(PlotCurve("6P", [1.0, 50.0, np.nan]))
    picture = static_svg(described(x=x, curves=curves, marks=[], spans=[], end_names=True), "0")
    places = sorted(float(y) for y in re.findall(r'y="([\d.]+)"[^>]*>c_\d<', picture))
    assert np.diff(places).min() > 11.0
    assert places[-1] < 260.0
    assert ">6P<" in picture


def test_curves_that_end_together_share_a_name():
    x = np.array([1.0, 10.0])
    curves = [PlotCurve("k_a", x), PlotCurve("k_b", 1.01 * x), PlotCurve("c_a", 1.02 * x, colour="error")]
    (ax,) = drawn([described(x=x, curves=curves, marks=[], spans=[], end_names=True)]).axes
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
    assert len(inspection_plots.some(spans)) <= inspection_plots.MAX_MARKS
    assert inspection_plots.some(np.empty((0, 2))).shape == (0, 2)


def test_a_page_states_the_verdict_once_and_marks_every_reason():
    """The verdict stood before each reason, and the page of oma did not mark a transient."""
    page = report_page("Modes", "", [Section("Result", text=[*reasons_against(["a", "b"]), "and more"])]).decode()
    assert '<p class="warning">trust: NO, because a</p>' in page
    assert '<p class="warning">and because b</p>' in page
    assert "<p>and more</p>" in page
