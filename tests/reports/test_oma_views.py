"""Plots and tables of operational modes."""

import dataclasses
import json

import numpy as np
import pytest
from validation.decays import CASES, records_of

import windsysid as ws
from tests.spectral.test_oma import RATE, record_of, two_modes
from windsysid.reports.figures import oma_views
from windsysid.spectral.oma.result import OperationalModes
from windsysid.spectral.oma.sensors import read_modal_sensors


@pytest.fixture(scope="module")
def found() -> OperationalModes:
    return ws.oma(record_of(two_modes(0), RATE))


@pytest.fixture(scope="module")
def decays() -> OperationalModes:
    record = records_of(CASES[1], 5)[0]
    return ws.free_decay([record.select(record.channels[:3]), record.select(record.channels[1:])])


def test_modes_stand_on_peaks_of_the_first_singular_value(found: OperationalModes):
    plot = oma_views.singular_value_plot(found)
    values, frequency = np.asarray(plot.curves[0].values), np.asarray(plot.x)
    for mark in plot.marks:
        near = np.abs(frequency - mark.at) < 0.15
        assert abs(frequency[near][np.argmax(values[near])] - mark.at) < 0.06
        assert values[near].max() > np.median(values) + 10.0


def test_the_modes_that_were_kept_are_stable_poles(found: OperationalModes):
    orders, damping = oma_views.poles_plots(found)
    stable = np.asarray(orders.x)[np.isfinite(orders.curves[0].values)]
    assert np.nanmax(damping.curves[0].values) < 100.0
    for mode in found.modes:
        assert np.min(np.abs(stable / mode.frequency.estimate - 1.0)) < 0.01


def test_modes_in_segments_scatter_about_the_whole(found: OperationalModes):
    assert [plot.title.split()[0] for plot in oma_views.segment_plots(found)] == ["Frequency", "Damping"]
    for mode in found.modes:
        assert mode.segments is not None
        scatter = np.std(mode.segments[:, 1]) / np.sqrt(len(mode.segments))
        assert 0.2 < scatter / mode.frequency.std < 3.0
        assert np.mean(mode.segments[:, 1]) == pytest.approx(mode.frequency.estimate, abs=2.0 * mode.frequency.std)


def test_tables_have_the_measures_of_the_result(found: OperationalModes):
    table = oma_views.assurance_table(found)
    assert [row[i + 1] for i, row in enumerate(table.rows)] == ["1.00"] * len(found.modes)
    assert oma_views.shape_table(found).rows[0][2] == f"{found.modes[0].mpc:.3f}"


def test_setups_are_listed_with_their_common_channels(decays: OperationalModes):
    assert [row[1] for row in oma_views.setup_table(decays).rows] == ["3, 2 in common"] * 2
    assert float(oma_views.setup_table(decays).rows[0][2]) > 0.99


def test_pages_have_the_plots(found: OperationalModes, decays: OperationalModes):
    page, other = (one.files()["report.html"].decode() for one in (found, decays))
    for title in ("Singular values of the spectral matrix", "Modes over the model order", "complex plane", "MPC"):
        assert title in page
    for title in ("Modes from free decays", "Free decays", "Setups"):
        assert title in other


def test_a_result_without_modes_has_a_page(found: OperationalModes):
    assert b"Spectra" in dataclasses.replace(found, modes=(), bands=()).files()["report.html"]


def test_shapes_move_where_positions_are_known(found: OperationalModes, tmp_path):
    tables = ['lines = [["base", "top"], ["top", "corner"]]', "[[node]]\nname = 'base'\nposition = [0, 0, 0]",
        "[[node]]\nname = 'top'\nposition = [0, 0, 9]",
        "[[node]]\nname = 'corner'\nposition = [3, 0, 9]\nfollows = 'top'",
        "[[sensor]]\nchannel = 'floor_3_displacement'\nnode = 'top'\ndirection = [1, 0, 0]"]  # fmt: skip
    (tmp_path / "sensors.toml").write_text("\n".join(tables))
    placed = ws.oma(record_of(two_modes(0), RATE), sensors=read_modal_sensors(tmp_path / "sensors.toml"))
    page = placed.files()["report.html"].decode()
    spec = json.loads(page.split('<figure class="moving">')[1].split('application/json">')[1].split("</script>")[0])
    assert spec["points"] == [[0, 0, 0], [0, 0, 9], [3, 0, 9]]
    assert spec["lines"] == [[0, 1], [1, 2]]
    assert spec["measured"] == [False, True, False]
    motion = spec["modes"][0]["motion"]
    assert motion[0] == [[0, 0], [0, 0], [0, 0]]
    assert motion[1] == motion[2]
    assert np.array(motion[1]) == pytest.approx(np.array([[1, 0], [0, 0], [0, 0]]))
    assert '<figure class="moving">' not in found.files()["report.html"].decode()
    placed.save(tmp_path / "out")
    again = ws.load_result(tmp_path / "out")
    assert isinstance(again, OperationalModes)
    assert (again.nodes, again.lines_drawn) == (placed.nodes, placed.lines_drawn)


def test_modes_are_marked_in_the_page(found: OperationalModes):
    page = found.files()["report.html"].decode()
    assert page.count('type="checkbox"') == len(found.modes)
    assert "modes.toml" in page
