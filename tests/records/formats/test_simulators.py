"""What is particular to HAWC2 and Bladed."""

import warnings

import numpy as np
import pytest
from validation.format_samples import SAMPLES, truth

from tests.records.formats.helpers import refused, write
from windsysid.records.formats import read_record

T = 40
VALUES = np.random.default_rng(9).standard_normal((T, 3, 2)).astype("<f4")


def hawc2(folder, name="HAWC2 text"):
    path = folder / "x.sel"
    SAMPLES[name].write(path, *truth(SAMPLES[name]))
    return path


def test_hawc2_is_read_by_either_of_its_files(tmp_path):
    path = hawc2(tmp_path)
    assert read_record(path).values.tobytes() == read_record(path.with_suffix(".dat")).values.tobytes()
    path.with_suffix(".dat").unlink()
    refused(path, r"has no x\.dat next to it")


def test_a_dat_file_without_a_list_beside_it_is_text(tmp_path):
    assert read_record(write(tmp_path, "time [s],a [m]\n0,1\n1,2\n", "mast.dat")).channels == ("a",)


def test_hawc2_times_are_the_grid_although_they_are_written_coarsely(tmp_path):
    path = hawc2(tmp_path)
    data = path.with_suffix(".dat")
    rows = [line.split() for line in data.read_text().splitlines()]
    later = [[f"{float(row[0]) + 1000.0:.5E}", *row[1:]] for row in rows]  # to 0.01 s, half of a step
    data.write_text("".join(" ".join(row) + "\n" for row in later))
    record = read_record(path)
    np.testing.assert_allclose(record.time, 1000.02 + 0.02 * np.arange(400), atol=1e-9)
    data.write_text("".join(" ".join(row) + "\n" for row in [*later[1:], later[0]]))
    refused(path, "the channel Time is not the grid")


def test_hawc2_channels_of_one_name_are_told_apart_and_unknown_units_kept(tmp_path):
    path = hawc2(tmp_path)
    text = path.read_text().replace("rotor_speed         ", "tower_x_acceleration").replace("rpm ", "kNx ")
    path.write_text(text)
    record = read_record(path)
    assert record.channels == ("tower_x_acceleration Tower top", "tower_x_acceleration Shaft")
    assert record.units == ("m/s^2", "as written: kNx")


def bladed(folder, **changes):
    lines = {
        "FILE": "x.$41", "ACCESS": "D", "FORM": "U", "RECL": "4", "FORMAT": "R*4", "NDIMENS": "3",
        "DIMENS": f"2\t3\t{T}", "GENLAB": "'Blade 1 Loads'", "VARIAB": "'Blade 1 Mx' 'Blade 1 Fx'", "VARUNIT": "FL F",
        "AXISLAB": "'Distance along blade'\nAXIUNIT\tL\nAXIMETH\t3\nAXIVAL\t0.0 12.5 25.0\nAXISLAB\t'Time'",
        "MIN": "1.0000000E+001", "STEP": "9.9999998E-003", **changes,
    }  # fmt: skip
    write(folder, "".join(f"{key}\t{text}\n" for key, text in lines.items() if text), "x.%41")
    return write(folder, VALUES.tobytes(), "x.$41")


def test_bladed_stations_are_channels_of_their_own(tmp_path):
    path = bladed(tmp_path)
    record = read_record(path)
    assert record.channels[:3] == ("Blade 1 Mx at 0", "Blade 1 Fx at 0", "Blade 1 Mx at 12.5")
    assert record.units == ("N*m", "N") * 3
    np.testing.assert_array_equal(record.values, VALUES.reshape(T, 6).astype(float))
    np.testing.assert_array_equal(record.time, 10.0 + 0.01 * np.arange(T))
    assert read_record(tmp_path / "x.%41").values.tobytes() == record.values.tobytes()


@pytest.mark.parametrize(
    ("written", "names"),
    [
        ("'Blade 1 Mx' Power", ("Blade 1 Mx", "Power")),
        ("Power 'Blade 1 Mx'", ("Power", "Blade 1 Mx")),
        ("Mx Fx", ("Mx", "Fx")),
        ("'Blade 1 Mx' Blade 1 Fx", ("Blade 1 Mx", "Blade 1 Fx")),
        ("'Blade 1 Mx'\n 'Blade 1 Fx'", ("Blade 1 Mx", "Blade 1 Fx")),
        ("'Blade 1 Mx'\nPOWER", ("Blade 1 Mx", "POWER")),
        ("'Blade 1\n Mx' 'Blade 1 Fx'", ("Blade 1 Mx", "Blade 1 Fx")),
        ("\n'Blade 1 Mx'\n'Blade 1 Fx'", ("Blade 1 Mx", "Blade 1 Fx")),
    ],
)
def test_bladed_names_are_quoted_or_bare_and_go_on_in_the_next_line(tmp_path, written, names):
    record = read_record(bladed(tmp_path, VARIAB=written))
    assert record.channels[:2] == tuple(f"{name} at 0" for name in names)
    np.testing.assert_array_equal(record.values, VALUES.reshape(T, 6).astype(float))


def test_other_lists_of_a_bladed_header_go_on_in_the_next_line(tmp_path):
    axis = "'Distance along blade'\nAXIUNIT\tL\nAXIMETH\t3\nAXIVAL\t0.0\n 12.5\n 25.0\nAXISLAB\t'Time'"
    record = read_record(bladed(tmp_path, VARUNIT="FL\n F", AXISLAB=axis))
    assert record.units == ("N*m", "N") * 3
    assert record.channels[-1] == "Blade 1 Fx at 25"


def test_bladed_headers_that_do_not_fit_their_numbers_are_refused(tmp_path):
    refused(bladed(tmp_path, DIMENS=f"2\t3\t{T - 1}"), "is cut off or damaged: 39 times of 6 numbers")
    refused(bladed(tmp_path, VARUNIT="FL"), "names 2 variables with 1 units")
    refused(bladed(tmp_path, STEP=""), "no numbers MIN and STEP")
    refused(bladed(tmp_path, FORMAT="R*9"), r"FORMAT R\*9, expected")
    refused(bladed(tmp_path, AXISLAB="'Wind speed'"), "names 0 stations|expected a last axis 'Time'")
    path = bladed(tmp_path)
    (tmp_path / "x.%41").unlink()
    refused(path, r"has no x\.%41 next to it")


def test_a_damaged_single_that_is_a_signalling_nan_is_missing(tmp_path):
    path = bladed(tmp_path)
    bits = np.frombuffer(path.read_bytes(), "<u4").copy()
    bits[7] = 0x7FA00000
    path.write_bytes(bits.tobytes())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        record = read_record(path)
    assert np.isnan(record.values).sum() == 1
