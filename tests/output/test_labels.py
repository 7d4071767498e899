"""Names of channels, turbines and units are shown in figures as text, whatever they hold, without a warning."""

import json
import warnings
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure

from windsysid import Record, RecordError
from windsysid.inspection import inspect_record
from windsysid.models import Equations, Parameter, Reading, fit
from windsysid.records.record import AS_WRITTEN
from windsysid.reports import figure as figure_of
from windsysid.reports import files
from windsysid.reports.figures.canvas import label
from windsysid.reports.figures.plots import record_overview, symbol
from windsysid.reports.html import png
from windsysid.reports.interactive.identification import innovation_plots, whiteness_plots
from windsysid.reports.interactive.plot import to_json
from windsysid.reports.interactive.svg import static_svg
from windsysid.spectral.oma.analyse import analyse_vibration

HOSTILE = [
    "a$b$c", "$", "$x_{$", r"\frac$\alpha", "k_$x$_y",
    "acc\n1\x07\x1b[31m", "加速度 塔", "\ud800$", "x" * 5000, " ", "_",
    "k__x", "a^b_c%&#{}", "[red]x[/]", "<script>alert(1)</script>",
]  # fmt: skip


@pytest.fixture(autouse=True)
def _no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        yield


@pytest.mark.parametrize("name", HOSTILE)
def test_a_name_is_drawn_as_text(name: str):
    figure = Figure(figsize=(12.0, 4.0), layout="constrained")
    ax = figure.subplots()
    ax.set_title(label(name))
    ax.set_ylabel(f"{symbol('k_beta_1')} [{label(name, 16)}]")
    ax.set_xticks([0, 1], [symbol(name), label(name)])
    assert png(figure).startswith(b"\x89PNG")


def test_a_dollar_stays_a_dollar_and_formulas_stay_formulas():
    assert label("a$b$c") == r"a\$b\$c"
    assert symbol("k_beta_1") == r"$k_{\beta 1}$"
    assert len(label("x" * 5000)) <= 60


def shaken(names: tuple[str, ...], unit: str = "m/s^2") -> Record:
    rng = np.random.default_rng(0)
    pole = 0.97 * np.exp(1j * 2.0 * np.pi * 0.1)
    drive = rng.standard_normal((4000, len(names)))
    response = np.zeros_like(drive)
    for i in range(2, len(drive)):
        response[i] = 2.0 * pole.real * response[i - 1] - abs(pole) ** 2 * response[i - 2] + drive[i]
    return Record(np.arange(4000) / 20.0, response, names, (unit,) * len(names), name="$a$<b>")


@pytest.mark.parametrize("count", [3, pytest.param(8, marks=pytest.mark.slow)])
def test_every_figure_of_an_inspection_takes_any_name(count: int):
    inspection = inspect_record(shaken((*HOSTILE[:5], HOSTILE[6], "\x07\x1b[31m", "x" * 200)[-count:]))
    assert "report.html" in files(replace(inspection, turbine="$T_{$"))
    assert png(figure_of(inspection))


def test_an_overview_takes_any_unit():
    assert png(record_overview(shaken(("acceleration",), AS_WRITTEN + "$m$/s²加"), ["acceleration"]))


@pytest.mark.slow
def test_every_figure_of_modes_takes_any_name():
    modes = analyse_vibration(shaken(tuple(HOSTILE[:3])))
    assert "report.html" in files(modes)
    assert png(figure_of(modes))


def test_every_figure_of_a_fit_takes_any_name_of_a_reading():
    q, v, force, c, k = sp.symbols("q v force c k")
    spring = Equations("spring", (q, v), (), (c, k), (force,), (v, force - c * v - k * q))
    rng = np.random.default_rng(1)
    driven = np.convolve(rng.standard_normal(600), np.ones(5), "same")
    names = tuple(HOSTILE[:4])
    values = np.column_stack([driven, *[0.01 * driven + 0.01 * rng.standard_normal(600) for _ in names]])
    record = Record(np.arange(600) / 20.0, values, ("force", *names), ("N", *["m"] * len(names)), name="spring")
    found = fit(
        spring, record, parameters=(Parameter("c", 0.4, 1.0), Parameter("k", 20.0, 1.5)),
        sensors=tuple(Reading(name, q, 0.01) for name in names), cov=1e-12 * np.eye(2),
    )  # fmt: skip
    assert png(figure_of(found))
    plots = [*innovation_plots(found), *whiteness_plots(found)]
    assert plots
    for number, plot in enumerate(plots):
        assert json.loads(to_json(plot))["title"] == plot.title
        ElementTree.fromstring(static_svg(plot, str(number)))


def test_pages_show_markup_as_text():
    page = files(inspect_record(shaken(("<script>alert(1)</script>", "[red]x[/]"))))["report.html"].decode()
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert" in page
    assert "[red]x[/]" in page


def test_a_name_that_no_file_can_hold_is_no_name_of_a_channel():
    with pytest.raises(RecordError, match=r"'\\ud800' is not a channel name: expected characters that UTF-8 can hold"):
        shaken(("\ud800",))
