"""Modes from linearisation files: sets of files, sweeps, OpenFAST's own machines, the command."""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

import windsysid as ws
from tests.modal.linearisation.whirling_rotor import Rotor
from windsysid.modal.linearisation.result import LinearisedModes
from windsysid.modal.matching.match import on_diagram
from windsysid.spectral.oma.known_modes import KnownMode, KnownModes

SHARED = Path(__file__).parents[4] / "shared" / "data"
DECKS = SHARED / "decks"
needs_shared = pytest.mark.skipif(
    not DECKS.is_dir(), reason="the reference linearisations are not beside this checkout"
)


def sweep(folder: Path, speeds: tuple[float, ...] = (0.5, 0.8, 1.1)) -> LinearisedModes:
    files = [path for i, speed in enumerate(speeds) for path in Rotor(speed=speed).write(folder, f"point{i}")]
    return ws.read_linearisation(list(reversed(files)))


def test_sets_of_files_are_operating_points_whose_modes_are_linked(tmp_path: Path):
    found = sweep(tmp_path)
    assert [len(point.files) for point in found.points] == [4, 4, 4]
    np.testing.assert_allclose(found.speeds, [0.5, 0.8, 1.1])
    curves = {curve.name: 2.0 * math.pi * curve.frequency for curve in found.curves}
    for i, speed in enumerate(found.speeds):
        whirls = Rotor(speed=speed).whirls()
        assert curves["edge forward"][i] == pytest.approx(whirls.max(), rel=1e-7)
        assert curves["edge collective"][i] == pytest.approx(math.sqrt(25.0 - speed**2), rel=1e-7)
    assert found.orders == (1, 3, 6)
    assert not found.banded
    assert {m.name for m in found.modes} == {m.name for m in found.points[2].modes}


def test_a_diagram_takes_measured_modes(tmp_path: Path):
    forward = Rotor(speed=0.8).whirls().max() / (2.0 * math.pi)
    mode = KnownMode("mode 3", math.log(1.01 * forward), 0.001, math.log(0.01), 0.1, {}, True)
    known = KnownModes("year1", None, None, None, (mode,), True, 0.8)
    (placed,) = on_diagram(known, sweep(tmp_path))
    assert placed.candidate == "edge forward"
    assert placed.expected == pytest.approx(forward, rel=1e-6)


def test_a_saved_answer_comes_back_with_its_table_and_pictures(tmp_path: Path):
    found = sweep(tmp_path)
    found.save(tmp_path / "out")
    names = {"answer.json", "modes.csv", "report.html", "summary.json"}
    assert names <= {path.name for path in (tmp_path / "out").iterdir()}
    back = ws.load_result(tmp_path / "out")
    assert isinstance(back, LinearisedModes)
    assert str(back) == str(found)
    frame = back.to_dataframe()
    assert len(frame) == 15
    assert frame["in edge forward"].max() > 0.9


def test_a_mode_that_grows_is_said(tmp_path: Path):
    found = ws.read_linearisation(Rotor(damping=-0.1).write(tmp_path))
    assert any(sentence.startswith("Unstable between") for sentence in found.sentences)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "expected one or more .lin files, got none"),
        (("a.1.txt",), "expected a linearisation file ending in .lin, got '.txt'"),
        (("a.1.lin", "a.2.lin"), "expected the rotor speed of a.1.lin, 9.549 rpm, got 11.46 rpm"),
        (("a.1.lin", "b.1.lin"), "expected another rotor speed than a.1.lin, got 9.549 rpm in both"),
    ],
)
def test_files_that_do_not_belong_together_are_refused(tmp_path: Path, names: tuple[str, ...], message: str):
    Rotor(speed=1.0).write(tmp_path, "a", azimuths=1)
    Rotor(speed=1.0).write(tmp_path, "b", azimuths=1)
    (tmp_path / "a.2.lin").write_text(Rotor(speed=1.2).write(tmp_path, "c", azimuths=1)[0].read_text())
    with pytest.raises(ws.ConfigurationError, match=message):
        ws.read_linearisation([tmp_path / name for name in names])


def test_uneven_azimuths_have_a_note(tmp_path: Path):
    files = Rotor().write(tmp_path)
    assert not any("evenly" in note for note in ws.read_linearisation(files).notes)
    assert any("rotor.1.lin: azimuths do not cover a turn evenly" in n for n in ws.read_linearisation(files[:3]).notes)


def test_the_command_prints_the_modes_and_saves_them(run, tmp_path: Path):
    files = Rotor().write(tmp_path, number="{:12.3E}", azimuths=1)
    ended = run("modes", *files, "--output", tmp_path / "out")
    assert ended.code == 0, ended.err
    assert "edge forward" in ended.out
    assert ended.out.startswith("Warning: rotor.1.lin has 4 digits: rounding moves")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["operating_points"][0]["rotor_speed"] == pytest.approx(1.2)
    assert (tmp_path / "out" / "modes.csv").read_text().startswith("speed,wind_speed,mode,frequency")
    refused = run("modes", *files, "--speeds", "1 rpm", "2 rpm")
    assert refused.code == 2
    assert refused.err == ["windsysid: --speeds: the rotor speeds are those of the .lin files: leave it out"]


@needs_shared
@pytest.mark.parametrize(
    ("pattern", "record"),
    [
        ("iea15_monopile/ls_mono.*.lin", "m1_mono10"),
        ("iea15_monopile/soil70/ls_mono70.*.lin", "m2_mono10_soil70"),
        ("iea15_semi/ls_semi.*.lin", "f1_semi10 (MAP++ moorings, no radiation)"),
    ],
)
def test_openfasts_own_machines_have_their_frequencies_and_damping(pattern: str, record: str):
    truth = json.loads((SHARED / "openfast" / "iea15_lin_truth.json").read_text())[record]
    found = ws.read_linearisation(sorted(DECKS.glob(pattern)))
    ours = found.modes[: len(truth)]
    np.testing.assert_allclose([m.frequency.estimate for m in ours], [one["f_damped_Hz"] for one in truth], atol=1e-5)
    ratios = [100.0 * m.damping_ratio.estimate for m in ours]
    np.testing.assert_allclose(ratios, [one["zeta_percent"] for one in truth], atol=1e-3)
    assert not found.warnings


NAMES = (
    "tower side-side", "tower fore-aft", "flap backward", "flap collective", "edge collective", "edge backward",
    "flap forward", "edge forward", "tower fore-aft 2", "tower side-side 2", "flap backward 2",
)  # fmt: skip
FLOATING = (
    "platform sway", "platform surge", "platform yaw", "platform pitch", "platform roll", "platform heave",
    "flap backward", "tower side-side", "tower fore-aft", "flap collective", "edge backward", "flap forward",
    "edge collective", "edge forward", "flap backward 2",
)  # fmt: skip


@needs_shared
@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("iea15_monopile/ls_mono.*.lin", NAMES),
        ("iea15_monopile/soil70/ls_mono70.*.lin", NAMES),
        ("iea15_semi/ls_semi.*.lin", FLOATING),
    ],
)
def test_openfasts_own_machines_have_the_right_names_below_1_5_hz(pattern: str, names: tuple[str, ...]):
    found = ws.read_linearisation(sorted(DECKS.glob(pattern)))
    assert tuple(mode.name for mode in found.modes if mode.frequency.estimate < 1.5) == names


@needs_shared
def test_four_digits_are_warned_of_and_their_intervals_hold_the_exact_frequencies():
    exact = ws.read_linearisation(sorted((DECKS / "iea15_monopile").glob("*.lin"))).modes[:2]
    errors = []
    for path in sorted((DECKS / "iea15_monopile" / "four_digits").glob("*.lin")):
        found = ws.read_linearisation(path)
        (warning,) = found.warnings
        assert "has 4 digits: rounding moves tower" in warning
        assert all(0.04 < 2.0 * m.frequency.relative_std < 0.07 for m in found.modes[:2])
        pairs = [(m.frequency, e.frequency) for m, e in zip(found.modes, exact, strict=False)]
        errors += [abs(f.estimate - e.estimate) / f.std for f, e in pairs]
    assert max(errors) < 3.0
    assert sum(error > 2.0 for error in errors) <= 1  # of eight


def test_the_command_says_which_measured_mode_is_which(run, tmp_path: Path):
    """A record of oscillators at two frequencies of the model, 1 and 2 % off, at the rotor speed of the files."""
    speed, edge = 0.8, {mode.name: mode.frequency.estimate for mode in sweep(tmp_path).points[1].modes}
    random, time = np.random.default_rng(0), np.arange(0.0, 600.0, 0.1)
    values = 0.02 * random.normal(size=(2, len(time)))
    for i, (name, off) in enumerate((("edge backward", 1.01), ("edge forward", 1.02))):
        exponent = 2.0 * math.pi * edge[name] * off * complex(-0.01, 1.0)
        load = random.normal(size=len(time)) + 1j * random.normal(size=len(time))
        values[i] += 0.1 * lfilter([1.0], [1.0, -np.exp(0.1 * exponent)], load).real
    channels = {"a_acceleration": values[0], "b_acceleration": values[1], "rotor_speed": np.full(len(time), speed)}
    units = ("m/s^2", "m/s^2", "rad/s")
    record = ws.Record(time, np.column_stack(list(channels.values())), tuple(channels), units, name="record")
    ws.oma(record, limits=(0.4, 1.2)).save(tmp_path / "measured")
    files = [str(path) for path in sorted(tmp_path.glob("*.lin"))]
    ended = run("modes", *files, "--measured", tmp_path / "measured", "--output", tmp_path / "out")
    assert ended.code == 0, ended.err
    rows = pd.read_csv(tmp_path / "out" / "measured.csv").set_index("candidate")
    assert {"edge backward", "edge forward"} <= set(rows.index)
    assert (rows.loc[["edge backward", "edge forward"], "probability"] > 0.5).all()
    assert "which mode, odds" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
