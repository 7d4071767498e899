"""The commands for many records of many turbines: batch and report."""

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from windsysid.cli.common import (
    Destination,
    Json,
    Mapping,
    Output,
    Overwrite,
    Verbose,
    app,
    claim_output,
    name_of,
    numbered,
    parse_option,
    print_and_save,
    show_progress,
)
from windsysid.errors import ConfigurationError
from windsysid.output.console import printable

if TYPE_CHECKING:
    from windsysid.monitoring.changes import Watch

__all__ = ["watch_archive"]


@app.command()
def batch(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE", help='Files, folders, or patterns in quotes, such as "data/*/*.parquet".'),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="ARCHIVE",
            help="Folder of the archive; an existing one is extended. By default results/NAME-batch, next to records.",
        ),
    ] = None,
    turbine: Annotated[
        str | None, typer.Option(help="Turbine of all records: a packaged one (windsysid turbines) or a TOML file.")
    ] = None,
    fleet: Annotated[Path | None, typer.Option(help="TOML file of several turbines (docs/fleet.md).")] = None,
    sensors: Annotated[
        Path | None, typer.Option(help="TOML list of sensors; the turbine's usual ones by default.")
    ] = None,
    mapping: Mapping = None,
    scada: Annotated[Path | None, typer.Option(help="SCADA statistics with dates: CSV, Parquet, …")] = None,
    scada_mapping: Annotated[Path | None, typer.Option(help="TOML file that describes its columns.")] = None,
    formulation: Annotated[
        Literal["spectral", "joint", "auto"],
        typer.Option(metavar="NAME", help="spectral: stationary records, cheap. joint: filters, slower. auto: both."),
    ] = "spectral",
    workers: Annotated[
        int | None,
        typer.Option(metavar="NUMBER", min=1, help="Processes on this machine; one for each processor by default."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers take the records instead.")
    ] = None,
    limit: Annotated[str, typer.Option(help="Time that a record may take, with its unit.")] = "10 min",
) -> None:
    """Identify all new records in folders, into one archive with a row for each; may be interrupted."""
    from windsysid.fleet.archive import is_archive, read_table, turbines_of
    from windsysid.fleet.batch import batch as take
    from windsysid.fleet.series import unidentified

    seconds = parse_option("--limit", limit, "s")
    archive = output or _archive_of(sources)
    try:
        with show_progress("batch") as progress:
            found = take(
                sources, archive=archive, turbine=turbine, fleet=fleet, sensors=sensors, mapping=mapping, scada=scada,
                scada_mapping=scada_mapping, formulation=formulation, workers=workers, scheduler=scheduler,
                limit=seconds, progress=progress,
            )  # fmt: skip
    except KeyboardInterrupt:
        told = f"interrupted: the results so far are in {archive}; the same command goes on from there"
        print(printable(told), file=sys.stderr)
        raise typer.Exit(130) from None
    print(found)
    names = turbines_of(archive) if is_archive(archive) else ()
    why = unidentified(read_table(archive, name, ("status", "why")) for name in names)
    print(printable(why or f"next: windsysid report {archive}"))


def _archive_of(sources: Sequence[str]) -> Path:
    """Archive for records of a folder where none is given: the one that has records of it, else one that is new."""
    from windsysid.fleet.archive import has_records_of, is_archive
    from windsysid.fleet.remote import is_remote

    fixed = re.split(r"[*?\[]", sources[0])[0]
    home = fixed if is_remote(fixed) or Path(fixed).is_dir() else str(Path(fixed).parent)
    for folder in numbered(name_of(home, "batch")):
        if not folder.exists() or (is_archive(folder) and has_records_of(folder, home)):
            break
    return folder


@app.command()
def report(
    context: typer.Context,
    archive: Annotated[
        Path,
        typer.Argument(
            metavar="ARCHIVE|RESULT", help="Folder that windsysid batch wrote, or a result whose page is drawn again."
        ),
    ],
    output: Output = None,
    alarms_per_year: Annotated[
        float, typer.Option(help="False alarms that are accepted in a year, all turbines together.")
    ] = 0.1,
    json: Json = False,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
) -> None:
    """Report on all turbines of an archive on one page: outliers, jumps, availability, failing sensors."""
    from windsysid.fleet.overview import oversee
    from windsysid.reports.loading import Reported, holds_result

    to = claim_output(context, output, name_of(archive, "report"), archive, overwrite=overwrite, json=json)
    if holds_result(archive):
        print_and_save(Reported(archive), to, json=json, verbose=verbose)
        return
    with show_progress("report") as progress:
        found = oversee(archive, alarms_per_year=alarms_per_year, progress=progress)
    print_and_save(found, to, json=json, verbose=verbose)


def watch_archive(
    archive: Path, names: Sequence[str], alarms_per_year: float, to: Destination | None, *, json: bool, verbose: bool
) -> None:
    """Watch turbines of an archive; the answer of a single one is saved."""
    from json import dumps

    found, short = _watch_each(archive, names, alarms_per_year)
    if to is not None:
        print_and_save(found[names[0]], to, json=json, verbose=verbose)
    elif json:
        print(dumps({name: one.summary() for name, one in found.items()}, indent=2))
    else:
        print(*(f"{name}: {one.sentence}" for name, one in found.items()), sep="\n")
        print(*(f"{name} is not watched: {why}" for name, why in short.items()), sep="\n", end="\n" if short else "")


def _watch_each(
    archive: Path, names: Sequence[str], alarms_per_year: float
) -> tuple[dict[str, "Watch"], dict[str, str]]:
    """Result of each turbine's watch, and why others cannot be watched; ConfigurationError if none can."""
    from windsysid.fleet.series import archive_blocks
    from windsysid.monitoring.watch import watch

    found: dict[str, Watch] = {}
    short: dict[str, str] = {}
    with show_progress("monitor") as progress:
        for i, name in enumerate(names):
            progress(f"watching {name}", i / len(names))
            try:
                found[name] = watch(archive_blocks(archive, name), alarms_per_year=alarms_per_year)
            except ConfigurationError as error:
                short[name] = str(error)
    if not found:
        raise ConfigurationError(f"no turbine can be watched; {names[0]}: {short[names[0]]}")
    return found, short
