"""Spectra of windows: stored once an hour, served with the model, and as a waterfall of a channel."""

import json

import numpy as np
import pytest

pytest.importorskip("fastapi", reason="the page needs the extra live")

from fastapi.testclient import TestClient

import windsysid
from tests.live.streaming import NOON
from windsysid.fleet.members import Member
from windsysid.live.page.app import app
from windsysid.live.page.spectra import waterfall_of
from windsysid.live.store import Keep, open_store
from windsysid.live.store.contents import Commit
from windsysid.live.windows.estimate import Here
from windsysid.live.windows.timeline import Gathered
from windsysid.reports.interactive.identification import MAX_KEPT_BINS, compact_spectra, spectra_plots

from . import sample

pytestmark = pytest.mark.usefixtures("without_effects")

OWN = "http://localhost"
HOUR = 6 * sample.WINDOW

TITLES = ["tower x acceleration, side-side", "tower z acceleration, fore-aft"]


@pytest.fixture(scope="module")
def record():
    return windsysid.simulate("tower", duration=300.0, rate=10.0, seed=1)


def test_a_window_gives_spectra_with_the_model_in_few_bins(record):
    found = Here().take(Gathered(record, 10.0), "T01 now", Member("T01", "tower"), "spectral", "sha256:0")
    plots = [json.loads(plot) for plot in found.spectra]
    assert [plot["title"] for plot in plots] == TITLES
    for plot in plots:
        measured, model = plot["curves"]
        assert len(plot["x"]) <= MAX_KEPT_BINS
        assert (measured["name"], model["name"]) == ("measured", "model")
        assert None not in measured["values"]
        assert sum(value is not None for value in model["low"]) > 50


def test_compact_spectra_keep_the_power(record):
    found = windsysid.identify(record, "tower", formulation="spectral")
    for whole, few in zip(spectra_plots(found, record), compact_spectra(found, record), strict=True):
        for plot in (whole, few):
            assert np.all(np.diff(plot.x) > 0)
        power = [np.trapezoid(np.asarray(plot.curves[0].values), np.asarray(plot.x)) for plot in (whole, few)]
        assert power[1] == pytest.approx(power[0], rel=0.1)


def test_a_store_keeps_the_last_spectrum_of_each_hour_for_its_time():
    store = open_store(":memory:", Keep(spectra="1 day"))
    last = sample.fill(store, now=NOON, days=1.25)
    windows = [window for window, _ in store.spectra("T01")]
    assert windows[-1] == last
    hours = [window // HOUR for window in windows]
    assert len(hours) == len(set(hours)) <= 49
    assert len(store.spectra("T01", most=10)) <= 10
    store.thin(now=NOON)
    assert min(window for window, _ in store.spectra("T01")) >= NOON - 24 * HOUR
    store.close()


def test_a_window_that_comes_again_leaves_its_spectra_as_they_are():
    store = open_store(":memory:")
    sample.fill(store, now=NOON, days=0.1)
    [(window, plots)] = store.spectra("T01", most=1)
    [result] = store.results("T01", newest=1)
    store.submit(Commit(results=[result._replace(spectra=['{"title":"other"}'])])).result(60)
    assert store.spectra("T01", most=1) == [(window, plots)]
    store.close()


def test_the_page_serves_the_newest_spectra_and_earlier_ones(store):
    client = TestClient(app(store), base_url=OWN)
    newest = client.get("/api/turbines/T02/spectrum").json()
    assert [plot["title"] for plot in newest["plots"]] == TITLES
    earlier = client.get("/api/turbines/T02/spectrum", params={"until": newest["window"]}).json()
    assert 0 < newest["window"] - earlier["window"] <= 3_600_000
    assert client.get("/api/turbines/T02/spectrum", params={"until": 0}).json() == {"window": None, "plots": []}
    assert client.get("/api/turbines/none/spectrum").status_code == 404


def test_a_waterfall_has_one_spectrum_an_hour_at_common_frequencies(store):
    client = TestClient(app(store), base_url=OWN)
    first = client.get("/api/turbines/T02/waterfall").json()
    assert first["channel"] == first["channels"][0] == TITLES[0]
    assert 12 <= len(first["windows"]) == len(first["density"]) <= 14
    assert {len(column) for column in first["density"]} == {len(first["frequencies"])}
    assert {len(mode) for mode in first["modes"].values()} == {len(first["windows"])}
    assert first["modes"]["tower fore-aft"][-1] == pytest.approx(0.31, abs=0.02)
    seen = client.get("/api/turbines/T03/waterfall").json()["modes"]  # from a blade
    assert {"tower x + 1P", "tower x − 1P"} <= seen.keys()
    other = client.get("/api/turbines/T02/waterfall", params={"channel": "tower z acceleration", "most": 4}).json()
    assert other["channel"] == TITLES[1]
    assert 2 <= len(other["windows"]) <= 4
    none = client.get("/api/turbines/T02/waterfall", params={"channel": "none"}).json()
    assert none["windows"] == none["frequencies"] == none["density"] == []


def test_results_have_the_means_of_channels(store):
    found = TestClient(app(store), base_url=OWN).get("/api/turbines/T01/results").json()
    [speed] = [one for one in found["conditions"] if one["name"] == "rotor_speed"]
    assert (speed["title"], speed["unit"], len(speed["mean"])) == ("rotor speed", "rad/s", len(found["windows"]))


def test_a_window_without_frequencies_is_left_out_of_the_waterfall():
    """The page answered with an internal error."""
    plot = {"title": "a", "x": [1.0, 2.0], "y_axis": {"label": "m"}, "marks": []}
    measured = [{"name": "measured", "values": [1.0, 100.0]}]
    empty = plot | {"x": [], "curves": [{"name": "measured", "values": []}]}
    found = waterfall_of([(0, [plot | {"curves": measured}]), (HOUR, [empty])], None)
    assert found.density == [[0.0, 2.0]]
    assert len(found.windows) == 1
