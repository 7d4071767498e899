"""The commands that make, look at and list: simulate, inspect, turbine, turbines, study."""

import shlex
from dataclasses import replace
from datetime import date, timedelta
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from windsysid.cli.common import (
    HYPOTHESES_HELP,
    Mapping,
    NamesTurbine,
    Output,
    Overwrite,
    TurbineOption,
    Verbose,
    app,
    claim_output,
    name_of,
    numbered,
    print_and_save,
    print_table,
    show_progress,
)
from windsysid.output.console import printable
from windsysid.units import RPM

__all__ = []


@app.command()
def study(
    context: typer.Context,
    output: Output = None,
    seed: Annotated[int, typer.Option(metavar="NUMBER", min=0, help="Seed of the simulated record.")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Repeat the published study: ten coefficients at once by the paper's extended Kalman filter."""
    from windsysid.study.report import error_table, study_files
    from windsysid.study.run import run_study

    to = claim_output(context, output, "study", overwrite=overwrite)
    with show_progress("study") as progress:
        found = run_study(seed, progress)
    table = error_table(found)
    print_table(table.headings, table.rows, table.caption)
    print(f"extended Kalman filter: {found.arm_a.elapsed:.3f} s for {found.arm_a.samples} samples (published: 30 s)")
    print(f"SIR particle filter: {found.particles.elapsed:.2f} s (published: 103 h)")
    with show_progress("study") as progress:
        progress("writing the report")
        to.write(study_files(found))
    assert to.folder is not None
    print(f"results: {printable(to.folder / 'report.html')}")


@app.command()
def simulate(
    turbine: TurbineOption,
    output: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Record to write: .csv or .nc. By default results/TURBINE.csv, or -2 …."),
    ] = None,
    duration: Annotated[float, typer.Option(help="Length [s].")] = 600.0,
    rate: Annotated[float, typer.Option(help="Samples per second [Hz].")] = 100.0,
    loads: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help=(
                "Loads on the turbine. random: the turbine file's own loads; wind: turbulent wind on the blades;"
                f" wind-feedback: with aerodynamic damping; {HYPOTHESES_HELP}."
            ),
        ),
    ] = "random",
    seed: Annotated[int, typer.Option(metavar="NUMBER", min=0, help="Seed of loads and noise.")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Simulate a record of a turbine's sensors."""
    from windsysid.records.formats import claim_record
    from windsysid.simulation.record import simulate_record
    from windsysid.turbine.file import load_turbine

    machine = load_turbine(turbine)
    target = output or next(path for path in numbered(name_of(turbine), ".csv") if overwrite or not path.exists())
    claimed = claim_record(target, overwrite=overwrite, inputs=[turbine])
    with claimed as write, show_progress("simulate") as progress:
        progress(f"{duration:g} s of {machine.name} at {rate:g} Hz")
        record = simulate_record(machine, duration=duration, rate=rate, seed=seed, loads=loads)
        record = replace(record, start=_start_of(seed))
        progress(f"writing {target}")
        write(record)
    print(record)
    print(f"record: {printable(target)}")


def _start_of(seed: int) -> str:
    """When a simulated record begins: each seed has its own day of a century, so that records can be put in order."""
    return f"{date(2020, 1, 1) + timedelta(days=seed % 36_500)}T00:00:00Z"


@app.command(name="inspect")
def inspect_command(
    context: typer.Context,
    record: Annotated[Path, typer.Argument(help="CSV, Parquet, netCDF, MATLAB, TDMS, OpenFAST … (docs/records.md).")],
    turbine: Annotated[
        str | None, typer.Option(help="Mark the modes of this turbine: a packaged name or a TOML file.")
    ] = None,
    output: Output = None,
    mapping: Mapping = None,
    section_length: Annotated[
        float | None, typer.Option(help="Length of the sections to propose [s]; by default the longest good ones.")
    ] = None,
    write_mapping: Annotated[
        Path | None,
        typer.Option(help="Write a proposed mapping, with open questions, to this TOML file, and stop."),
    ] = None,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
) -> None:
    """Inspect a record: faults, spectra, and the sections that are fit for identification."""
    if write_mapping is not None:
        _write_mapping(record, mapping, write_mapping, overwrite=overwrite)
        return
    from windsysid.inspection import inspect_record
    from windsysid.records.formats import read_record
    from windsysid.turbine.file import load_turbine

    to = claim_output(context, output, name_of(record, "inspect"), record, overwrite=overwrite)
    machine = load_turbine(turbine) if turbine is not None else None
    with show_progress("inspect") as progress:
        data = read_record(record, mapping=mapping, progress=partial(progress, f"reading {record}"))
        progress(f"looking at {data.samples} samples")
        found = inspect_record(data, machine, section_length=section_length)
    print_and_save(found, to, verbose=verbose)


def _write_mapping(record: Path, mapping: Path | None, target: Path, *, overwrite: bool) -> None:
    """Propose a mapping for a record and write it."""
    from windsysid.inspection.proposal import propose_mapping
    from windsysid.output.files import claim_file

    with claim_file(target, overwrite=overwrite, inputs=filter(None, [record, mapping])) as write:
        with show_progress("inspect") as progress:
            progress(f"reading {record}")
            found = propose_mapping(record, mapping)
        print(found)
        write(lambda file: file.write(found.to_toml().encode()))
    print(printable(f"mapping: {target}; correct it, then: windsysid inspect {record} --mapping {target}"))


@app.command()
def examples(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder for them.")] = Path("examples"),
) -> None:
    """Write a folder of example records, with a README that has a command for each."""
    from windsysid.simulation.examples import write_examples

    with show_progress("examples") as progress:
        written = write_examples(folder, progress)
    print(*(printable(path) for path in written), sep="\n")
    enter = "" if folder == Path() else f"cd {shlex.quote(str(folder))}; "
    print(printable(f"next: {enter}windsysid identify tower_year1.csv --turbine tower"))


@app.command()
def turbine(
    model: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL", help="Main file of OpenFAST (.fst) or HAWC2 (.htc), windIO (.yaml), or a drawing (.csv)."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Turbine file to write; printed by default.")
    ] = None,
    kind: Annotated[
        Literal["tower", "rotor"],
        typer.Option(metavar="NAME", help="tower: both directions, rigid rotor. rotor: side-side, with blades."),
    ] = "tower",
    overwrite: Overwrite = False,
) -> None:
    """Make a turbine file from the model of another program."""
    from windsysid.output.files import claim_file
    from windsysid.turbine.models.read import model_files, turbine_file_from

    if output is None:
        print(turbine_file_from(model, kind), end="")
        return
    with claim_file(output, overwrite=overwrite, inputs=model_files(model)) as write:
        text = turbine_file_from(model, kind)
        write(lambda file: file.write(text.encode()))
    print(printable(f"turbine: {output}; check what it assumes, then: windsysid identify RECORD --turbine {output}"))


@app.command(cls=NamesTurbine)
def turbines(
    turbine: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Print the file of this one: `--turbine NAME > my.toml` begins your own."),
    ] = None,
) -> None:
    """List the packaged turbines, or print the file of one."""
    from windsysid.turbine.file import load_turbine, packaged_file, packaged_turbines

    if turbine is not None:
        print(packaged_file(turbine), end="")
        return
    rows, machines = [], {name: load_turbine(name) for name in packaged_turbines()}
    for name, machine in machines.items():
        free = ", ".join(machine.model.coordinates)
        rows.append((name, f"{machine.rotor_speed * RPM:.4g} rpm", free, machine.description))
    print_table(("turbine", "speed", "degrees of freedom", "description"), rows, "Packaged turbines")
    for name, machine in machines.items():
        print(f"{name}: {machine.source}")
        print(f"  assumed: {', '.join(machine.assumed)}")
