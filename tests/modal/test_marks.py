"""Modes that are added and removed by hand."""

import pytest
from validation.decays import CASES, records_of

import windsysid as ws
from tests.spectral.test_oma import RATE, record_of, two_modes
from windsysid.errors import ConfigurationError


def test_a_file_gives_ranges_and_frequencies(tmp_path):
    (tmp_path / "modes.toml").write_text("# by hand\nadd = [[0.9, 1.1], [2, 3]]\nremove = [1.5]\n")
    marks = ws.results.read_mode_marks(tmp_path / "modes.toml")
    assert marks == ws.results.ModeMarks(add=((0.9, 1.1), (2.0, 3.0)), remove=(1.5,))


@pytest.mark.parametrize(
    ("text", "got"),
    [
        ("add = [[2, 1]]", "two rising frequencies"),
        ("add = [1, 2]", "add.1"),
        ("drop = [1.0]", "drop"),
        ("remove = ['x']", "remove.1"),
        ("add = [[", "is not a file with add"),
    ],
)
def test_a_wrong_file_ends_in_one_line(tmp_path, text, got):
    (tmp_path / "modes.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=r"modes\.toml.*") as error:
        ws.results.read_mode_marks(tmp_path / "modes.toml")
    assert got in str(error.value)
    assert "\n" not in str(error.value)


def test_marks_change_the_modes_of_a_record_and_nothing_else():
    record = record_of(two_modes(0, samples=3000), RATE)
    free = ws.oma(record)
    first, second = free.modes[:2]
    found = ws.oma(record, bands=ws.results.ModeMarks(remove=(first.frequency.estimate,)))
    assert [m.frequency.estimate for m in found.modes] == [m.frequency.estimate for m in free.modes[1:]]
    assert any("removed by hand" in note for note in found.notes)
    f = second.frequency.estimate
    marks = ws.results.ModeMarks(add=((0.85 * f, 1.15 * f),), remove=(50.0,))
    again = ws.oma(record, bands=marks)
    assert len(again.modes) == len(free.modes)
    assert again.modes[1].frequency.estimate == pytest.approx(f, abs=2.0 * second.frequency.std)
    assert again.modes[1].band != second.band
    assert any("no mode is near 50 Hz" in note for note in again.notes)


def test_decays_take_removed_modes_only():
    record = records_of(CASES[1], 5)[0]
    assert len(ws.free_decay(record, marks=ws.results.ModeMarks(remove=(0.8,))).modes) == 2
    with pytest.raises(ConfigurationError, match="frequencies to remove only"):
        ws.free_decay(record, marks=ws.results.ModeMarks(add=((1.0, 2.0),)))
