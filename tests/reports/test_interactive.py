"""Interactive plots: the JSON, the static SVG and the page that holds both."""

import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from windsysid.reports.html import Section, report_page
from windsysid.reports.interactive.plot import Axis, Curve, Mark, Plot, Span, thinned, to_json
from windsysid.reports.interactive.svg import static_svg


def plot(**changes: object) -> Plot:
    x = np.linspace(0.0, 2.0, 5000)
    values = 1.0 + np.square(x)
    values[7] = np.nan
    given = {
        "title": "tower <top> & \"nacelle\"", "x": x, "x_axis": Axis("frequency [Hz]"), "y_axis": Axis("PSD", log=True),
        "curves": [Curve("model", values, 0.5 * values, 2.0 * values), Curve("measured", values, look="dots")],
        "marks": [Mark(0.5, "mode 1", group="modes"), Mark(1.0, across=True)], "spans": [Span(0.2, 0.3, "left out")],
    }  # fmt: skip
    return Plot(**{**given, **changes})


def test_numbers_are_json_within_a_script_and_missing_ones_are_null():
    text = to_json(plot())
    assert "</" not in text
    found = json.loads(text)
    assert found["title"] == 'tower <top> & "nacelle"'
    assert found["curves"][0]["values"][7] is None
    assert found["curves"][0]["values"][-1] == pytest.approx(5.0, rel=1e-3)
    assert found["x"][1] == pytest.approx(2.0 / 4999, rel=1e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"y_axis": Axis("PSD")},
        {"x_axis": Axis("", dates=True)},
        {"x_axis": Axis("frequency", log=True, limits=(0.1, 1.0))},
        {"x": [0, 1], "curves": [Curve("a", [1, 2], look="dots")], "x_axis": Axis("", names=("k", "c"))},
        {"curves": [Curve("nothing", np.full(5000, np.nan))]},
        {"curves": [Curve("envelope", np.full(5000, np.nan), np.zeros(5000), np.ones(5000), look="area")]},
    ],
)
def test_the_static_picture_is_well_formed_and_small(changes: dict[str, object]):
    text = static_svg(plot(**changes), "p")
    assert ElementTree.fromstring(text).get("role") == "img"
    assert len(text) < 400_000
    assert "nan" not in text.replace("nacelle", "")


def test_a_thinned_curve_keeps_its_spikes():
    x, values = np.arange(10_000.0), np.zeros(10_000)
    values[4321], values[77] = 5.0, np.nan
    at, low, high = thinned(x, values, 100)
    assert len(at) == len(low) == 100
    assert high.max() == 5.0
    assert at[np.argmax(high)] <= 4321.0
    assert np.isfinite(low).all()


def test_a_page_with_plots_needs_no_network_and_one_without_has_no_script():
    page = report_page("A", "b", [Section("c", plots=[plot(), plot()])]).decode()
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert page.count('<svg class="static"') == 2
    assert len(set(re.findall(r'clipPath id="([^"]+)"', page))) == 2
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page
    assert "<script" not in report_page("A", "b", [Section("c", text=["d"])]).decode()
