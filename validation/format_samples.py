"""One record in every format, written by a library that is not windsysid's, or by hand where there is none; Parquet by
windsysid, too, whose files have a seal.

`SAMPLES` names for each format the ending, how its file is written, and what of the record it keeps.
`validation.formats` reads them back and damages them; so do the tests.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from windsysid.records.formats import write_record
from windsysid.records.formats.contents.mapping import ChannelRule, Mapping, TimeRule
from windsysid.records.record import Array, Record
from windsysid.units import si_unit, to_si

__all__ = ["SAMPLES", "START", "Sample", "files_of", "truth"]

START = "2021-07-07T12:00:00.250Z"
_MOMENT = datetime(2021, 7, 7, 12, 0, 0, 250_000, tzinfo=UTC)
NAMES, UNITS = ("tower_x_acceleration", "rotor_speed"), ("g", "rpm")
RATE, SAMPLES_A_RECORD = 50.0, 400


@dataclass(frozen=True)
class Sample:
    """Writer of the record in one format.

    Attributes
    ----------
    ending : str
    write : callable
        ``write(path, time, values)`` writes times (T,) [s] and values (T, 2) in `UNITS`.
    writer : str
        What writes it.
    package : str
        The package to import first, empty where none is needed.
    mapping : Mapping
        Arguments of the reader.
    start : str or None
        The moment of time 0 that the file keeps.
    kept : callable
        ``kept(values)`` is what the file keeps of values (T, 2): every bit, or so many digits.
    names, units : tuple of str
        What the channels are called, and the units of their values in the file.
    files : tuple of str
        Endings of the files that are written, where there are two; the one with the numbers first.
    begin : float
        Time of the first sample [s].
    scaled : bool
        Whether values are scaled on reading, so that their last bit is the reader's.
    counted : bool
        Whether the file says how many samples it holds, so that a loss shows.
    spared : callable
        ``spared(whole)`` is how many bytes at the beginning damage leaves alone.
    """

    ending: str
    write: Callable[[Path, Array, Array], None]
    writer: str
    package: str = ""
    mapping: Mapping = field(default_factory=Mapping)
    start: str | None = None
    kept: Callable[[Array], Array] = field(default=lambda values: values)
    names: tuple[str, str] = NAMES
    units: tuple[str, str] = UNITS
    files: tuple[str, ...] = ()
    begin: float = 0.0
    scaled: bool = False
    counted: bool = True
    spared: Callable[[bytes], int] = field(default=lambda whole: 0)


def files_of(sample: Sample, path: Path) -> list[Path]:
    """The files that hold a record, the one with the numbers first."""
    return [path.with_suffix(ending) for ending in sample.files] or [path]


def truth(sample: Sample, seed: int = 0) -> tuple[Array, Array]:
    """Times (T,) [s] and values (T, 2) that a file keeps without another rounding."""
    values = np.random.default_rng(seed).normal((0.0, 12.0), 1.0, (SAMPLES_A_RECORD, 2))
    return np.arange(SAMPLES_A_RECORD) / RATE, sample.kept(values)


def _digits(count: int) -> Callable[[Array], Array]:
    return np.vectorize(lambda x: float(f"{x:.{count - 1}E}"))


def _decimals(count: int) -> Callable[[Array], Array]:
    return np.vectorize(lambda x: float(f"{x:.{count}f}"))


def _single(values: Array) -> Array:
    return values.astype(np.float32).astype(np.float64)


def _scales(values: Array) -> Array:
    """Scales of HAWC2's packed numbers, as its list writes them."""
    return np.array([float(f"{top / 32000.0:.5E}") for top in np.max(np.abs(values), axis=0)])


def _packed(values: Array) -> Array:
    return np.rint(values / _scales(values)) * _scales(values)


def _csv(path: Path, time: Array, values: Array) -> None:
    import pandas as pd

    pd.DataFrame(np.column_stack([time, values]), columns=["time [s]", *_headed()]).to_csv(path, index=False)


def _headed() -> list[str]:
    return [f"{name} [{unit}]" for name, unit in zip(NAMES, UNITS, strict=True)]


def _parquet(path: Path, time: Array, values: Array) -> None:
    import pandas as pd

    pd.DataFrame(values, columns=_headed(), index=pd.Index(time, name="time [s]")).to_parquet(path)


def _parquet_own(path: Path, time: Array, values: Array) -> None:
    si = values * [to_si(1.0, unit) for unit in UNITS]
    write_record(Record(time, si, NAMES, tuple(map(si_unit, UNITS)), start=START), path)


def _footer(whole: bytes) -> int:
    return len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")


def _netcdf(path: Path, time: Array, values: Array) -> None:
    import xarray as xr

    columns = {n: ("time", values[:, i], {"units": u}) for i, (n, u) in enumerate(zip(NAMES, UNITS, strict=True))}
    stamp = {"units": f"seconds since {START}"}
    xr.Dataset(columns, coords={"time": ("time", time, stamp)}).to_netcdf(path, engine="h5netcdf")


def _matlab(path: Path, time: Array, values: Array) -> None:
    from scipy.io import savemat

    content = {"time": time, "a_g": values[:, 0], "rotor": {"speed_rpm": values[:, 1]}}
    savemat(path, content, do_compression=True)


def _matlab_73(path: Path, time: Array, values: Array) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, column in (("time", time), ("a_g", values[:, 0]), ("rotor/speed_rpm", values[:, 1])):
            file[name] = column[np.newaxis]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def _hdf5(path: Path, time: Array, values: Array) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("daq/raw", data=values.T, fletcher32=True, chunks=(1, 100))
        file["daq/raw"].attrs["units"] = "g"
        file["daq/clock"] = 1000.0 * time
        file.attrs["start_time"] = START


def _tdms(path: Path, time: Array, values: Array) -> None:
    from nptdms import ChannelObject, RootObject, TdmsWriter

    about: dict[str, Any] = {
        "wf_increment": 1.0 / RATE,
        "wf_start_offset": 0.0,
        "wf_start_time": np.datetime64(START[:-1]),
    }
    with TdmsWriter(path) as file:
        for low in range(0, time.size, 100):
            part = [
                ChannelObject("daq", name, values[low : low + 100, i], {**about, "unit_string": unit})
                for i, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
            ]
            file.write_segment([RootObject({"site": "hill"}), *part])


def _uff(path: Path, time: Array, values: Array, *, binary: bool = True) -> None:
    import pyuff

    path.unlink(missing_ok=True)
    for i, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
        one = pyuff.prepare_58(
            binary=int(binary), func_type=1, rsp_node=i + 1, rsp_dir=1, ref_node=1, ref_dir=1, data=values[:, i],
            x=time, id1=name, rsp_ent_name="tower", ref_ent_name="NONE", abscissa_spacing=1, abscissa_spec_data_type=17,
            ordinate_spec_data_type=12, ordinate_axis_units_lab=unit, orddenom_spec_data_type=0,
        )  # fmt: skip
        pyuff.UFF(str(path))._write_set(one, "add")  # in its mode overwrite, binary sets have 7 bytes


def _mdf(path: Path, time: Array, values: Array) -> None:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        columns = enumerate(zip(NAMES, UNITS, strict=True))
        file.append([Signal(values[:, i], time, unit=unit, name=name) for i, (name, unit) in columns])
        file.append([Signal(np.arange(8.0), np.arange(8.0), unit="m/s", name="wind_speed")])
        file.header.start_time = _MOMENT
        file.save(path, overwrite=True, compression=2)


def _lvm(path: Path, time: Array, values: Array) -> None:
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "Multi_Headings\tYes\nX_Columns\tOne\nTime_Pref\tAbsolute\nOperator\tme\nDate\t2021/07/07\n"
        "Time\t12:00:00.2500000\n***End_of_Header***\t\n\t\n"
    )
    text = head
    for low in range(0, time.size, 100):
        rows = range(low, low + 100)
        text += (
            "Channels\t2\t\t\t\nSamples\t100\t100\t\t\nDate\t2021/07/07\t2021/07/07\t\t\n"
            "Time\t12:00:00.25\t12:00:00.25\t\t\n"
            f"Y_Unit_Label\t{UNITS[0]}\t{UNITS[1]}\t\t\nX_Dimension\tTime\tTime\t\t\nX0\t0.0E+0\t0.0E+0\t\t\n"
            f"Delta_X\t0.02\t0.02\t\t\n***End_of_Header***\t\t\t\t\nX_Value\t{NAMES[0]}\t{NAMES[1]}\tComment\n"
        )
        text += "".join(f"{time[k]:.6f}\t{values[k, 0]:.6f}\t{values[k, 1]:.6f}\t\n" for k in rows) + "\n"
    path.write_bytes(text.replace("\n", "\r\n").encode())


def _hawc2(path: Path, time: Array, values: Array, *, binary: bool = False) -> None:
    rule, step = "_" * 120, time[1] - time[0]
    table = np.column_stack([time + step, values])  # HAWC2 writes the end of each step
    scales = _scales(table)
    rows = [(1, "Time", "s", "Time"), (2, NAMES[0], UNITS[0], "Tower top"), (3, NAMES[1], UNITS[1], "Shaft")]
    lines = [
        rule, "  Version ID : HAWC2MB 12.8", f"{'':60}Time : 14:23:28", f"{'':60}Date : 22:11.2020", rule,
        f"  Result file : ./{path.stem}.dat", rule, "   Scans    Channels    Time [sec]      Format",
        f"   {time.size:8d}    {3:3d}       {time.size * step:8.3f}       {'BINARY' if binary else 'ASCII'}", "",
        "  Channel   Variable Description               ", "",
        *(f"  {k:4d}      {name:<30} {unit:<10} {about}" for k, name, unit, about in rows), rule,
    ]  # fmt: skip
    if binary:
        lines += ["Scale factors:", *(f"  {scale:.5E}" for scale in scales)]
        path.with_suffix(".dat").write_bytes(np.rint(table / scales).astype("<i2").T.tobytes())
    else:
        text = "".join(" ".join(f"{x:13.5E}" for x in row) + "\n" for row in table)
        path.with_suffix(".dat").write_text(text, encoding="ascii")
    path.with_suffix(".sel").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _bladed(path: Path, time: Array, values: Array, *, binary: bool = True) -> None:
    header = (
        f"FILE\t{path.stem}.$04\nACCESS\t{'D' if binary else 'S'}\nFORM\t{'U' if binary else 'F'}\nRECL\t4\n"
        f"FORMAT\tR*4\nCONTENT\t'POWPROD'\nCONFIG\t'STATIONARY'\nNDIMENS\t2\nDIMENS\t2\t{time.size}\n"
        "GENLAB\t'Drive train variables'\nVARIAB\t'Nacelle fore-aft acceleration' 'Rotor speed'\n"
        "VARUNIT\tL/TT A/T\nAXISLAB\t'Time'\nAXIUNIT\tT\n"
        f"AXIMETH\t2\nMIN \t0.0000000E+000\nSTEP\t{np.float32(1.0 / RATE):.7E}\nNVARS\t0\n"
        "ULOADS   7.1592855E+006   7.5046815E+006\n   7.0032420E+006   7.3428640E+006\n"
    )
    path.with_suffix(".%04").write_text(header, encoding="ascii")
    if binary:
        path.write_bytes(values.astype("<f4").tobytes())
    else:
        path.write_text("".join(f" {a: .7E} {b: .7E}\n" for a, b in values), encoding="ascii")


def _outb(path: Path, time: Array, values: Array) -> None:
    names = ["Time", "YawBrTAxn", "GenSpeed"]
    units = ["(s)", "(g)", "(rpm)"]
    packed = np.rint(values * 1000.0).astype("<i2")
    head = struct.pack("<hiidd", 2, 2, time.size, 0.0, float(time[1]))
    scale = np.array([1000.0, 1000.0], "<f4").tobytes() + np.zeros(2, "<f4").tobytes()
    about = struct.pack("<i", 4) + b"made"
    path.write_bytes(head + scale + about + "".join(f"{x:<10}" for x in names + units).encode() + packed.tobytes())


_LISTED = {"tower_x_acceleration": ChannelRule(), "rotor_speed": ChannelRule()}
_ARRAYS = Mapping(channels={"a": ChannelRule(name=NAMES[0]), "speed": ChannelRule(name=NAMES[1])})
_DAQ = Mapping(
    time=TimeRule(column="daq/clock", unit="ms"),
    channels={"daq/raw_1": ChannelRule(name=NAMES[0]), "daq/raw_2": ChannelRule(name=NAMES[1], unit="rpm")},
)
_BLADED: dict[str, Any] = {
    "names": ("Nacelle fore-aft acceleration", "Rotor speed"), "units": ("m/s^2", "rad/s"), "files": (".$04", ".%04")
}  # fmt: skip

SAMPLES: dict[str, Sample] = {
    "CSV": Sample(".csv", _csv, "pandas", counted=False),
    "Parquet": Sample(".parquet", _parquet, "pandas, pyarrow", "pyarrow"),
    "Parquet, footer": Sample(".parquet", _parquet, "pandas, pyarrow", "pyarrow", spared=_footer),
    "Parquet, sealed": Sample(".parquet", _parquet_own, "windsysid", "pyarrow", start=START),
    "netCDF-4": Sample(".nc", _netcdf, "xarray, h5netcdf", start=START),
    "MATLAB 5–7": Sample(".mat", _matlab, "scipy", mapping=_ARRAYS),
    "MATLAB 7.3": Sample(".mat", _matlab_73, "h5py", mapping=_ARRAYS),
    "HDF5": Sample(".h5", _hdf5, "h5py", mapping=_DAQ, start=START),
    "NI TDMS": Sample(".tdms", _tdms, "nptdms", "nptdms", start=START),
    "UFF 58": Sample(".uff", lambda p, t, v: _uff(p, t, v, binary=False), "pyuff", "pyuff", kept=_digits(12)),
    "UFF 58b": Sample(".uff", _uff, "pyuff", "pyuff"),
    "MDF 4": Sample(".mf4", _mdf, "asammdf", "asammdf", Mapping(channels=_LISTED, only_listed=True), START),
    "LabVIEW .lvm": Sample(".lvm", _lvm, "by hand", start=START[:-1], kept=_decimals(6)),
    "HAWC2 text": Sample(".sel", _hawc2, "by hand", kept=_digits(6), files=(".dat", ".sel"), begin=1.0 / RATE),
    "HAWC2 binary": Sample(
        ".sel",
        lambda p, t, v: _hawc2(p, t, v, binary=True),
        "by hand",
        kept=_packed,
        files=(".dat", ".sel"),
        begin=1.0 / RATE,
    ),
    "Bladed text": Sample(
        ".$04", lambda p, t, v: _bladed(p, t, v, binary=False), "by hand", kept=_digits(8), **_BLADED
    ),
    "Bladed binary": Sample(".$04", _bladed, "by hand", kept=_single, **_BLADED),
    "OpenFAST .outb": Sample(
        ".outb", _outb, "by hand", "openfast_io", kept=_decimals(3), names=("YawBrTAxn", "GenSpeed"), scaled=True
    ),
}
