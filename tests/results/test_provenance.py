"""Where results come from: what they say of their record, turbine and options, and that nobody changed them since."""

import json
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import cache
from itertools import islice
from pathlib import Path

import h5py  # type: ignore[import-untyped,unused-ignore]
import numpy as np
import pytest

from windsysid import ConfigurationError, __version__, cli
from windsysid.identification.identify import identify
from windsysid.monitoring import series as blocks_module
from windsysid.monitoring.series import MIN_BLOCKS, read_blocks
from windsysid.records import formats
from windsysid.records.formats import iterate_record, read_record, write_record
from windsysid.records.formats.netcdf import sealed
from windsysid.records.record import Record
from windsysid.reports.html import report_page
from windsysid.reports.identification import provenance_section
from windsysid.results.identification import Identification
from windsysid.results.posterior import load_posterior
from windsysid.results.provenance import RecordHash, record_hash
from windsysid.simulation.record import simulate_record
from windsysid.turbine.turbine import Turbine

pytestmark = pytest.mark.usefixtures("without_effects")


START = "2026-03-01T12:00:00+01:00"


@pytest.fixture(scope="module")
def record(verne555: Turbine) -> Record:
    return replace(simulate_record(verne555, duration=20.0, rate=50.0, seed=1), start=START)


@pytest.fixture(scope="module")
def found(record: Record, verne555: Turbine) -> Identification:
    return identify(record, verne555, section=(2.0, 20.0))


@pytest.fixture(scope="module")
def saved(found: Identification, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A whole ``identification.nc``."""
    folder = tmp_path_factory.mktemp("saved")
    found.save(folder)
    return (folder / "identification.nc").read_bytes()


def test_the_hash_of_a_record_is_that_of_its_values_however_it_is_cut_and_stored(record: Record, tmp_path: Path):
    whole = record_hash(record)
    assert re.fullmatch("sha256:[0-9a-f]{64}", whole)
    parts = RecordHash()
    for part in (record.section(0.0, 3.0), record.section(3.0, 20.0)):
        parts.take(part)
    assert str(parts) == whole
    for name in ("x.csv", "x.nc"):
        write_record(record, tmp_path / name)
        assert record_hash(read_record(tmp_path / name)) == whole
    values = record.values.copy()
    values[-1, -1] = np.nextafter(values[-1, -1], 1.0)
    assert record_hash(replace(record, values=values)) != whole
    assert record_hash(replace(record, channels=(*record.channels[:-1], "other"))) != whole


def test_a_result_says_where_it_comes_from(found: Identification, record: Record, verne555: Turbine):
    said = found.summary()
    assert (said["start"], said["section"]) == (START, [2.0, 19.98])
    about = said["provenance"]
    assert about["windsysid"] == __version__
    assert datetime.now(UTC) - datetime.fromisoformat(about["identified"]) < timedelta(hours=1)
    assert about["record_hash"] == record_hash(record)
    assert about["options"] == {
        "formulation": "auto", "section": [2.0, 20.0], "prior": None, "parameters": None, "rate": None,
        "loads": "auto",
        "site": "onshore",
        "state": "auto",
    }  # fmt: skip
    assert [sensor["channel"] for sensor in about["sensors"]] == [sensor.channel for sensor in verne555.sensors]
    other = replace(record, values=record.values * 1.0, start=None)
    softer = verne555.with_values({"k_y": 1700.0})
    changed = identify(other, softer, section=(2.0, 8.0), formulation="joint", loads="broadband")
    assert changed.summary()["provenance"]["turbine_hash"] != about["turbine_hash"]


def test_a_posterior_knows_its_start_and_its_record(found: Identification, record: Record, tmp_path: Path):
    found.save(tmp_path)
    for posterior in (found.posterior, load_posterior(tmp_path)):
        assert (posterior.start, posterior.record_hash) == (START, record_hash(record))
        assert posterior.section == found.section
        assert posterior.statistics == found.statistics
    with h5py.File(tmp_path / "identification.nc") as file:
        assert json.loads(file.attrs["provenance"]) == found.summary()["provenance"]


def test_a_changed_byte_of_a_result_is_found(saved: bytes, tmp_path: Path):
    rng = np.random.default_rng(0)
    for at in (0, len(saved) - 1, len(saved) - 12, len(saved) - 25, *rng.integers(0, len(saved), 60)):
        changed = bytearray(saved)
        changed[at] ^= 1 << int(rng.integers(8))
        (tmp_path / "identification.nc").write_bytes(changed)
        with pytest.raises(ConfigurationError) as caught:
            load_posterior(tmp_path)
        assert "\n" not in str(caught.value)
    for cut in (saved[:-1], saved[: len(saved) // 2], saved[:-25], b""):
        (tmp_path / "identification.nc").write_bytes(cut)
        with pytest.raises(ConfigurationError):
            load_posterior(tmp_path)


@pytest.mark.parametrize("command", ["modes", "compare", "monitor", "damping"])
def test_a_number_changed_by_hand_is_refused_by_every_command(
    saved: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
):
    path = tmp_path / "identification.nc"
    path.write_bytes(saved)
    assert load_posterior(tmp_path).trusted
    with h5py.File(path, "r+") as file:
        file["final_estimate"][0] *= 1.1
    monkeypatch.setattr(sys, "argv", ["windsysid", command, *[str(tmp_path)] * (2 if command == "compare" else 1)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    (line,) = capsys.readouterr().err.splitlines()
    assert ended.value.code == 2
    assert "identification.nc was damaged or changed after windsysid wrote it" in line


def test_a_result_of_version_010_which_has_no_checksum_is_read(saved: bytes, tmp_path: Path):
    path = tmp_path / "identification.nc"
    path.write_bytes(saved[:-25])  # without the seal
    with h5py.File(path, "r+") as file:
        for name in ("windsysid_version", "provenance", "record_hash", "record_start", "statistics"):
            del file.attrs[name]
    posterior = load_posterior(tmp_path)
    assert (posterior.start, posterior.record_hash, posterior.statistics) == (None, None, ())
    assert posterior.section == (2.0, 19.98)
    blocks = read_blocks([tmp_path] * MIN_BLOCKS)
    assert blocks.notes[0].startswith("12 results of an older version do not hold the noise of their sensors")


Make = Callable[..., list[Path]]


@pytest.fixture
def make(saved: bytes, tmp_path: Path) -> Make:
    """Folders ``res-1`` … of one result, each with its start; k_x of record i is i + 1 thousandths more."""

    def make(starts: list[str | None]) -> list[Path]:
        folders = []
        for i, start in enumerate(starts):
            folders.append(tmp_path / f"res-{i + 1}")
            folders[-1].mkdir()
            path = folders[-1] / "identification.nc"
            path.write_bytes(saved)
            with h5py.File(path, "r+") as file:
                file["final_estimate"][0] *= 1.001 ** (i + 1)
                file.attrs["record"] = f"r{i + 1}"
                del file.attrs["record_start"]
                if start is not None:
                    file.attrs["record_start"] = start
            path.write_bytes(sealed(path.read_bytes()))
        return folders

    return make


def hourly(count: int = MIN_BLOCKS, zone: str = "Z") -> list[str | None]:
    return [f"2026-03-01T{hour:02d}:00:00{zone}" for hour in range(count)]


def numbers(records: tuple[str, ...]) -> list[int]:
    return [int(name.split(",")[0].removeprefix("r")) for name in records]


@pytest.mark.parametrize("zone", ["", *(pytest.param(zone, marks=pytest.mark.slow) for zone in ("Z", "+02:00"))])
def test_records_are_put_in_order_of_time(make: Make, zone: str):
    folders = make(hourly(zone=zone))
    blocks = read_blocks(sorted(folders, key=str))  # res-1, res-10, res-11, res-12, res-2 …
    assert numbers(blocks.records) == list(range(1, MIN_BLOCKS + 1))
    np.testing.assert_allclose(blocks.time, 3600.0 * np.arange(MIN_BLOCKS))
    assert (np.diff(blocks.theta[:, 0]) > 0.0).all()
    assert blocks.begin is not None
    assert blocks.begin.isoformat().startswith("2026-03-01T00:00:02")  # where the section begins
    assert blocks.notes == ()
    assert any(name.startswith("noise_") for name in blocks.names)


def test_records_of_several_zones_are_put_in_order_of_the_moment(make: Make):
    starts = hourly()
    starts[5] = "2026-03-01T06:00:00+01:00"  # 05:00 UTC
    assert numbers(read_blocks(list(reversed(make(starts)))).records) == list(range(1, MIN_BLOCKS + 1))


def test_without_times_the_order_is_the_natural_one_or_as_given_and_that_is_said(make: Make):
    folders = make([None] * MIN_BLOCKS)
    blocks = read_blocks(sorted(folders, key=str))
    assert numbers(blocks.records) == list(range(1, MIN_BLOCKS + 1))
    assert any("natural order, res-1 … res-12" in note for note in blocks.notes)
    backwards = read_blocks(list(reversed(folders)))
    assert numbers(backwards.records) == list(range(MIN_BLOCKS, 0, -1))
    assert any("12 of 12 records do not say when they began" in note for note in backwards.notes)


def test_records_that_cannot_be_put_in_order_are_refused(make: Make):
    mixed = hourly()
    mixed[3] = "2026-03-01T03:00:00"
    with pytest.raises(ConfigurationError, match=r"with a zone \('r1, .*without \('r4, .*\[time\] zone"):
        read_blocks(make(mixed))


def test_records_that_begin_together_are_refused_and_overlaps_are_said(make: Make, tmp_path: Path):
    starts = hourly()
    starts[4] = "2026-03-01T03:00:10Z"
    folders = make(starts)
    (note,) = read_blocks(folders).notes
    assert re.match(r"'r4, .*' and 'r5, .*' overlap by 7.98 s: the common samples count twice", note)
    with pytest.raises(
        ConfigurationError, match=r"'r1, .*' and 'r1, .*' begin at the same time.*leave one of them out"
    ):
        read_blocks([folders[0], *folders])


def covariates(folder: Path, lines: list[str]) -> Path:
    path = folder / "weather.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_lines_of_covariates_go_with_their_records(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(blocks_module, "load_posterior", cache(load_posterior))
    folders = make(hourly())
    given = sorted(folders, key=str)
    wind = np.arange(1.0, MIN_BLOCKS + 1.0)

    by_time = [f"2026-03-01T{i:02d}:00Z,{i + 1}" for i in range(MIN_BLOCKS)]
    blocks = read_blocks(given, covariates(tmp_path, ["time,wind", *by_time]))
    np.testing.assert_array_equal(blocks.covariates[:, 0], wind)

    by_name = [f"{folder.name},{folder.name.removeprefix('res-')}" for folder in reversed(folders)]
    blocks = read_blocks(given, covariates(tmp_path, ["folder,wind", *by_name]))
    np.testing.assert_array_equal(blocks.covariates[:, 0], wind)

    in_order = [f"{600 * i},{i + 1}" for i in range(MIN_BLOCKS)]  # says nothing of which folder is meant
    with pytest.raises(ConfigurationError, match=r"contradicts when the records began: add a column 'folder'"):
        read_blocks(given, covariates(tmp_path, ["time,wind", *in_order]))
    blocks = read_blocks(folders, covariates(tmp_path, ["time,wind", *in_order]))
    np.testing.assert_allclose(blocks.time, 3600.0 * np.arange(MIN_BLOCKS))  # the records' own

    wrong = [line.replace("T07:00", "T07:30") for line in by_time]
    with pytest.raises(ConfigurationError, match=r"no line has the time of 'res-8', 2026-03-01T07:00:02\+00:00"):
        read_blocks(given, covariates(tmp_path, ["time,wind", *wrong]))
    with pytest.raises(ConfigurationError, match="expected one line of folder 'res-11', got 2"):
        read_blocks(given, covariates(tmp_path, ["folder,wind", by_name[1], *by_name[1:]]))


def test_a_table_says_the_times_of_records_that_do_not(make: Make, tmp_path: Path):
    folders = make([None] * MIN_BLOCKS)
    lines = [f"res-{i + 1},{600 * i},{i + 1}" for i in range(MIN_BLOCKS)]
    blocks = read_blocks(list(reversed(folders)), covariates(tmp_path, ["folder,time,wind", *reversed(lines)]))
    assert numbers(blocks.records) == list(range(1, MIN_BLOCKS + 1))
    np.testing.assert_array_equal(blocks.covariates[:, 0], np.arange(1.0, MIN_BLOCKS + 1.0))
    np.testing.assert_array_equal(blocks.time, 600.0 * np.arange(MIN_BLOCKS))


@pytest.mark.slow
def test_a_summary_changed_by_hand_changes_no_computation(make: Make):
    folders = make(hourly())
    before = read_blocks(folders)
    for folder in folders:
        (folder / "summary.json").write_text("{}")
    after = read_blocks(folders)
    np.testing.assert_array_equal(after.theta, before.theta)
    assert after.names == before.names


def test_the_command_keeps_mapping_options_and_start_and_refuses_a_checkpoint_of_another_call(
    verne555: Turbine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    data = simulate_record(verne555, duration=24.0, rate=50.0, seed=4)
    write_record(data, tmp_path / "mast.csv")
    rules = tmp_path / "mast.toml"
    rules.write_text('[time]\nstart = "2026-03-01T12:00:00"\nzone = "Europe/Berlin"\n')
    output = tmp_path / "result"
    command = [
        "identify",
        tmp_path / "mast.csv",
        "--turbine",
        "verne555",
        "--output",
        output,
        "--in-pieces",
        "8 s",
        "--no-report",
        "--mapping",
        rules,
    ]

    def run(*more: object) -> tuple[int, list[str]]:
        monkeypatch.setattr(sys, "argv", ["windsysid", *map(str, command), *map(str, more)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return int(ended.value.code or 0), capsys.readouterr().err.splitlines()

    with monkeypatch.context() as patched:
        patched.setattr(formats, "iterate_record", lambda *a, **k: stopping(iterate_record(*a, **k)))
        assert run()[0] == 130
    checkpoint = tmp_path / ".result.checkpoint.npz"
    left = checkpoint.read_bytes()
    code, (line,) = run("--prior-scale", "1.2")
    assert code == 2
    assert line.endswith(
        "was left by another call, which differs in prior: repeat that call, choose another output, or delete the"
        " checkpoint to begin anew"
    )
    assert checkpoint.read_bytes() == left
    assert run()[0] == 0
    assert not checkpoint.exists()
    said = json.loads((output / "summary.json").read_text())
    assert said["start"] == START
    about = said["provenance"]
    assert about["record_hash"] == record_hash(data)
    assert about["options"]["file"].endswith("mast.csv")
    assert about["options"]["in_pieces_s"] == 8.0
    assert about["options"]["mapping"]["time"] == {"start": "2026-03-01T12:00:00", "zone": "Europe/Berlin"}


def test_the_report_ends_with_where_the_result_comes_from(found: Identification):
    assert found.provenance is not None
    report = report_page("", "", [provenance_section(found, found.provenance)]).decode()
    assert "<details><summary>Provenance</summary>" in report
    for words in (START, found.provenance.record_hash, "[[sensor]]", "2026-03-01T12:00:19.980+01:00"):
        assert words in report


def stopping(pieces: Iterator[Record]) -> Iterator[Record]:
    """Two pieces, and then somebody presses Ctrl-C."""
    yield from islice(pieces, 2)
    raise KeyboardInterrupt
