"""Interactive plots: the JSON, the static SVG and the page that holds both."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure

import windsysid as ws
from windsysid.inspection.spectra import ExpectedLine, SpectralPeak, Spectrum
from windsysid.monitoring.change import Comparison, QuantityChange
from windsysid.output.table import Table
from windsysid.reports import comparison
from windsysid.reports.figures.plots import ESTIMATE
from windsysid.reports.html import Section, report_page
from windsysid.reports.identification import identification_report
from windsysid.reports.interactive.identification import history_plots, spectra_plots
from windsysid.reports.interactive.inspection import highest_drawn
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve, ShadedRange, thinned, to_json
from windsysid.reports.interactive.svg import static_svg


def plot(**changes: Any) -> Plot:
    x = np.linspace(0.0, 2.0, 5000)
    values = 1.0 + np.square(x)
    values[7] = np.nan
    given: dict[str, Any] = {
        "title": "tower <top> & \"nacelle\"", "x": x, "x_axis": Axis("frequency [Hz]"), "y_axis": Axis("PSD", log=True),
        "curves": [PlotCurve("model", values, 0.5 * values, 2.0 * values), PlotCurve("measured", values, look="dots")],
        "marks": [Mark(0.5, "mode 1", group="modes"), Mark(1.0, across=True)],
        "spans": [ShadedRange(0.2, 0.3, "left out")],
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
        {"x": [0, 1], "curves": [PlotCurve("a", [1, 2], look="dots")], "x_axis": Axis("", names=("k", "c"))},
        {"curves": [PlotCurve("nothing", np.full(5000, np.nan))]},
        {"curves": [PlotCurve("envelope", np.full(5000, np.nan), np.zeros(5000), np.ones(5000), look="area")]},
    ],
)
def test_the_static_picture_is_well_formed_and_small(changes: dict[str, Any]):
    text = static_svg(plot(**changes), "p")
    assert ElementTree.fromstring(text).get("role") == "img"
    assert len(text) < 400_000
    assert "nan" not in text.replace("nacelle", "")


def test_points_have_a_size_as_printers_leave_out_lines_without_a_length():
    text = static_svg(plot(curves=[PlotCurve("measured", np.ones(5000), look="dots")]), "p")
    assert not re.search(r"h0\D", text)
    assert text.count("z") >= 5000
    named = static_svg(plot(curves=[PlotCurve("k_a", np.ones(5000))], end_names=True, y_axis=Axis("", log=True)), "p")
    assert ">k_a</text>" in named


def test_ticks_of_a_logarithmic_axis_are_powers_of_ten():
    text = static_svg(plot(curves=[PlotCurve("a", np.geomspace(1e-7, 1.0, 5000))]), "p")
    assert ">10⁻⁵</text>" in text
    assert not re.search(r"\de-\d", text)


def test_tables_wider_than_a_phone_are_cards_there_and_values_are_not_broken():
    narrow, wide = Table(("a", "b"), [("x", "1.5 ± 0.2 %")]), Table(("a", *["column"] * 6), [("x", *["1.23456"] * 6)])
    page = report_page("A", "b", [Section("c", tables=[narrow, wide])]).decode()
    assert page.count('class="wide"') == 1
    assert "1.5\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}0.2\N{NO-BREAK SPACE}%" in page


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
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page)
    assert page.count('<svg class="static"') == 2
    assert len(set(re.findall(r'clipPath id="([^"]+)"', page))) == 2
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page
    assert "<script" not in report_page("A", "b", [Section("c", text=["d"])]).decode()


def test_a_figure_has_the_colours_of_the_page_in_the_dark_too():
    figure = Figure(figsize=(3, 2))
    ax = figure.subplots()
    ax.plot([0, 1], [0, 1], color=ESTIMATE)
    ax.set_title("a <b>")
    page = report_page("A", "b", [Section("c", figures=[(figure, 'drawn "here"')])]).decode()
    drawn = page[page.index('<svg class="drawn"') : page.index("</svg>") + 6]
    assert ElementTree.fromstring(drawn).get("aria-label") == 'drawn "here"'
    assert "var(--estimate)" in drawn
    assert "#000000" not in drawn
    assert "<metadata" not in drawn


def test_odds_are_shown_as_far_as_calibration_goes():
    changes = [QuantityChange("k_x", "N/m", 2.0, 1.9, -6.0, -7.0, -5.0, odds, 0.0, "stiffness") for odds in (6.0, 69.0)]
    found = Comparison(("a", "b"), tuple(changes), (), (), False, (), ())
    assert [row[-1] for row in found.rows] == ["403:1", ">1000:1"]
    assert "10^" not in found.sentence
    page = comparison.files(found)["report.html"].decode()
    assert "-5.00" in page
    assert "-6.00" in page
    assert "Priors removed" in page


def test_a_spectrum_is_drawn_up_to_the_highest_peak_that_is_listed():
    frequency = np.linspace(0.0, 10.0, 1001)
    lines = (ExpectedLine("1P", 0.2, 0.01, mode=False, number=1),)
    peaks = (SpectralPeak(7.0, 20.0, 0.1, ()), SpectralPeak(0.3, 20.0, 0.1, ()))
    spectrum = Spectrum("a", "m/s^2", frequency, np.ones(1001), 0.01, peaks, lines)
    assert highest_drawn(spectrum, 3) == pytest.approx(7.7)
    assert highest_drawn(replace(spectrum, peaks=()), 3) == pytest.approx(0.27)


def test_inspect_names_3p_by_the_speed_of_the_turbine_file():
    turbine = ws.load_turbine("tower")
    record = ws.simulate(turbine, duration=120.0, rate=4.0, seed=1)
    without = record.select([name for name in record.channels if not name.startswith("rotor")])
    found = ws.inspect(without, turbine)
    at = {line.name: line.frequency for line in found.spectra[0].lines}
    assert at["3P"] == pytest.approx(3.0 * turbine.rotor_speed / (2.0 * np.pi))
    assert any("turbine file's 12.1 rpm" in note for note in found.notes)
    assert not any(line.name == "3P" for line in ws.inspect(without).spectra[0].lines)


def test_the_page_of_an_identification_has_its_spectra_and_stays_small():
    turbine = ws.load_turbine("tower")
    record = ws.simulate(turbine, duration=300.0, rate=4.0, seed=1)
    found = ws.identify(record, turbine, formulation="spectral")
    plots = spectra_plots(found, record)
    assert [plot.title for plot in plots] == ["tower x acceleration, side-side", "tower z acceleration, fore-aft"]
    for plot in plots:
        measured, model = plot.curves
        assert [measured.name, model.name] == ["measured", "model"]
        inside = np.isfinite(np.asarray(model.values))
        ratio = np.asarray(measured.values)[inside] / np.asarray(model.values)[inside]
        assert 0.5 < np.median(ratio) < 2.0
        assert {mark.group for mark in plot.marks} == {"modes", "rotor harmonics"}
        assert {span.group for span in plot.spans} == {"not used by the fit"}
    page = identification_report(found, record)
    assert len(page) < 1_500_000
    assert not re.findall(rb'(?:src|href)="(?!data:|#)', page)


def test_histories_of_coefficients_are_in_engineering_units():
    e = SimpleNamespace(name="k_x", unit="N/m", estimate=1.8e6, low=1.7e6, high=1.9e6, reference=2.0e6)
    histories = np.array([1.5e6, 1.8e6]), np.array([1.2e6, 1.7e6]), np.array([1.8e6, 1.9e6])
    found: Any = SimpleNamespace(time=np.array([0.0, 1.0]), estimates=[e], history=lambda name: histories)
    (plot,) = history_plots(found)
    assert plot.y_axis.label == "[MN/m]"
    online, result = plot.curves
    np.testing.assert_allclose(np.asarray(online.values)[:2], [1.5, 1.8])
    assert (np.asarray(result.low)[-1], np.asarray(result.values)[-1]) == (1.7, 1.8)
    assert [mark.at for mark in plot.marks] == [2.0]
    assert plot.y_axis.limits == pytest.approx((1.2 - 0.16, 2.0 + 0.16))
