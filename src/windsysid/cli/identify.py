"""The command that identifies a record, whole or in pieces."""

import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from windsysid.errors import ConfigurationError
from windsysid.output.console import printable
from windsysid.output.files import path_text
from windsysid.output.folders import is_free

if TYPE_CHECKING:
    from windsysid.identification.model.prior import Prior
    from windsysid.mechanics.sensors import Sensor
    from windsysid.output.progress import Progress, Shown
    from windsysid.records.formats.contents.mapping import Mapping as FileMapping
    from windsysid.records.record import Record
    from windsysid.results.identification import Identification
    from windsysid.turbine.turbine import Turbine

from windsysid.cli.common import (
    HYPOTHESES_HELP,
    Mapping,
    Output,
    Overwrite,
    TurbineOption,
    Verbose,
    app,
    claim_output,
    name_of,
    numbered,
    parse_option,
    print_unsaved,
    show_progress,
)

__all__ = []


@app.command()
def identify(
    context: typer.Context,
    record: Annotated[Path, typer.Argument(help="CSV, Parquet, netCDF, MATLAB, TDMS, OpenFAST … (docs/records.md).")],
    turbine: TurbineOption,
    output: Output = None,
    sensors: Annotated[
        Path | None, typer.Option(help="TOML list of the record's sensors; the turbine's usual ones by default.")
    ] = None,
    formulation: Annotated[
        Literal["joint", "spectral", "force-balance", "auto"],
        typer.Option(
            metavar="NAME",
            help=(
                "auto: chosen from the record. joint: Kalman filter with loads as states. spectral: spectra of a "
                "stationary record. force-balance: as in the published study."
            ),
        ),
    ] = "auto",
    section: Annotated[
        tuple[float, float] | None, typer.Option(metavar="START END", help="Part of the record to use [s].")
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            help="Resample to this rate [Hz], without aliasing, to leave out frequencies above the model's modes."
        ),
    ] = None,
    loads: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help=f"Load model (docs/loads.md). auto: chosen from the record; {HYPOTHESES_HELP}.",
        ),
    ] = "auto",
    site: Annotated[
        Literal["onshore", "offshore"] | None,
        typer.Option(
            metavar="NAME", help="offshore: waves are likely (docs/effects.md). As the turbine file says by default."
        ),
    ] = None,
    state: Annotated[
        Literal["auto", "operating", "parked"],
        typer.Option(metavar="NAME", help="State of the turbine: operating or parked. auto: by the rotor speed."),
    ] = "auto",
    prior_scale: Annotated[float, typer.Option(help="Centre all priors at the reference values times this.")] = 1.0,
    add_noise: Annotated[
        float,
        typer.Option(metavar="PERCENT", help="Add white noise of this percentage of each sensor's standard deviation."),
    ] = 0.0,
    seed: Annotated[int, typer.Option(metavar="NUMBER", min=0, help="Seed of the added noise.")] = 0,
    in_pieces: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help=(
                'Read the record in pieces of this length ("10 min"), in bounded memory; after an interruption the'
                " same command continues."
            ),
        ),
    ] = None,
    mapping: Mapping = None,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
    no_report: Annotated[bool, typer.Option("--no-report", metavar="", help="Write no report.html.")] = False,
) -> None:
    """Identify stiffness and damping of a turbine from a record."""
    from windsysid.cli.screen import first_screen, identification_parts
    from windsysid.filters import bank_kernel, ekf, smoother
    from windsysid.identification.model.prior import Prior
    from windsysid.kernels.ahead import compile_ahead
    from windsysid.mechanics.sensor_lists import read_sensors
    from windsysid.records.formats import load_mapping
    from windsysid.turbine.file import load_turbine

    folder = output or _default_output(record, overwrite=overwrite, resumes=in_pieces is not None)
    write = claim_output(context, folder, "", record, overwrite=overwrite).write
    asked = _IdentifyRequest(
        record,
        load_turbine(turbine).at(site),
        load_mapping(mapping) if mapping is not None else None,
        read_sensors(sensors) if sensors is not None else None,
        Prior(prior_scale, prior_scale, spread=1.0 if formulation == "force-balance" else None),
        formulation, section, rate, loads, state,
    )  # fmt: skip
    if formulation == "auto":  # spectra come first, then filters; this process is often at the bank before the other
        compile_ahead(ekf.run_kernel, smoother.linearised_kernel, bank_kernel.run_kernel)
    with show_progress("identify") as progress:
        if in_pieces is None:
            found, used = _identify_whole(asked, add_noise, seed, progress)
        else:
            found, used = _identify_in_pieces(asked, _length(in_pieces, formulation, add_noise), folder, progress)
    print_unsaved(found if verbose else first_screen(identification_parts(found)))
    _save(found, used, write, report=not no_report)
    if in_pieces is not None:
        _checkpoint(folder).unlink(missing_ok=True)
    print(
        f"identified in {found.elapsed:.1f} s from {found.samples} samples; results:"
        f" {printable(folder / ('summary.json' if no_report else 'report.html'))}"
    )


def _save(found: "Identification", used: "Record", write: Callable[[dict[str, bytes]], None], *, report: bool) -> None:
    """Save a result, with its report or without."""
    with show_progress("identify") as progress:
        files = found.files()
        if report:
            from windsysid.reports.identification import identification_report

            progress("writing the report")
            files["report.html"] = identification_report(found, used)
        write(files)


def _default_output(record: Path, *, overwrite: bool, resumes: bool) -> Path:
    """Output folder where none is given; that of an interrupted identification in pieces is for its going on only."""
    for folder in numbered(name_of(record)):
        if resumes if _checkpoint(folder).exists() else overwrite or is_free(folder):
            break
    return folder


class _IdentifyRequest(NamedTuple):
    """Job of the identification from the options."""

    record: Path
    turbine: "Turbine"
    mapping: "FileMapping | None"
    sensors: "tuple[Sensor, ...] | None"
    prior: "Prior"
    formulation: Literal["joint", "spectral", "force-balance", "auto"]
    section: tuple[float, float] | None
    rate: float | None
    loads: str
    state: str


def _identify_whole(
    asked: _IdentifyRequest, add_noise: float, seed: int, progress: "Shown"
) -> tuple["Identification", "Record"]:
    """Identify a file that is read as a whole; the section that was used too."""
    from dataclasses import replace

    from windsysid.identification.identify import identify as identify_record
    from windsysid.records.formats import read_record
    from windsysid.results.provenance import mapping_tables, record_hash

    recorded = data = read_record(
        asked.record, mapping=asked.mapping, progress=partial(progress, f"reading {asked.record}")
    )
    sensors = asked.sensors
    if add_noise != 0.0:
        data, sensors = _noisy(data, asked, add_noise, seed)
    found = identify_record(
        data, asked.turbine, sensors=sensors, formulation=asked.formulation, section=asked.section, prior=asked.prior,
        rate=asked.rate, loads=asked.loads, state=asked.state, progress=progress,
    )  # fmt: skip
    if found.provenance is not None:
        traced = found.provenance.with_options(file=path_text(asked.record), mapping=mapping_tables(asked.mapping))
        if add_noise != 0.0:
            traced = traced.with_options(add_noise_percent=add_noise, seed=seed)
            traced = replace(traced, record_hash=record_hash(recorded))
        found = replace(found, provenance=traced)
    return found, data.section(*asked.section) if asked.section else data


def _length(in_pieces: str, formulation: str, add_noise: float) -> float:
    """Length of a piece [s]."""
    if formulation == "force-balance" or add_noise != 0.0:
        raise ConfigurationError("--in-pieces goes with joint or spectral: leave --add-noise out")
    return parse_option("--in-pieces", in_pieces, "s")


def _identify_in_pieces(
    asked: _IdentifyRequest, length: float, output: Path, progress: "Progress"
) -> tuple["Identification", "Record"]:
    """Identify a file piece by piece, going on from where an earlier call was interrupted; the last piece too."""
    from windsysid.identification.streaming.identify_pieces import identify_pieces
    from windsysid.output.progress import hear
    from windsysid.records.formats import iterate_record
    from windsysid.results.provenance import mapping_tables

    record, mapping, section = asked.record, asked.mapping, asked.section
    checkpoint = _checkpoint(output)
    share, reached = 0.0, 0.0
    last: list[Record] = []
    if checkpoint.exists():
        progress(f"going on from {checkpoint}", None)

    def reading(done: float) -> None:
        nonlocal share
        share = done

    def taken(seconds: float) -> None:
        nonlocal reached
        reached = seconds
        progress(f"{record}, {seconds:.0f} s of it taken in", share)

    def pieces() -> Iterator["Record"]:
        for piece in iterate_record(record, length, mapping=mapping, section=section, progress=reading):
            last[:] = [piece]
            yield piece

    try:
        told = {
            "file": path_text(record), "in_pieces_s": length, "section": None if section is None else list(section),
            "mapping": mapping_tables(mapping),
        }  # fmt: skip
        with hear(progress, f"{record}, search for the mode"):
            found = identify_pieces(
                pieces(), asked.turbine, sensors=asked.sensors, prior=asked.prior,
                formulation="spectral" if asked.formulation == "spectral" else "joint", rate=asked.rate,
                loads=asked.loads, state=asked.state, checkpoint=checkpoint, keep_checkpoint=True, progress=taken,
                options=told,
            )  # fmt: skip
    except KeyboardInterrupt:
        where = f"interrupted at {reached:.0f} s: the same command goes on from there ({checkpoint})"
        print(printable(where), file=sys.stderr)
        raise typer.Exit(130) from None
    return found, last[0]


def _checkpoint(output: Path) -> Path:
    """Checkpoint of the segments until the result is saved, next to the output folder."""
    folder = output.resolve()
    return folder.with_name(f".{folder.name}.checkpoint.npz")


def _noisy(
    record: "Record", asked: _IdentifyRequest, percent: float, seed: int
) -> "tuple[Record, tuple[Sensor, ...] | None]":
    """Add noise to the measured channels of a record, and to the noise of the sensors."""
    from windsysid.identification.condition.readings import add_noise, usable_sensors, with_noise
    from windsysid.identification.estimate.force_balance import measured_channels

    if asked.formulation == "force-balance":
        return add_noise(record, measured_channels(record, asked.turbine), percent, seed)[0], asked.sensors
    used = record.section(*asked.section) if asked.section else record
    found = usable_sensors(used, asked.turbine, asked.sensors)
    noisy, added = add_noise(record, [sensor.channel for sensor in found], percent, seed)
    return noisy, with_noise(found, added)
