"""The commands for many records of many turbines: batch and report."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from windsysid.cli.common import Mapping, app, parse_option, show_progress

__all__ = []


@app.command()
def batch(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE...", help='Files, folders, or patterns in quotes, such as "data/*/*.parquet".'),
    ],
    output: Annotated[Path, typer.Option(metavar="ARCHIVE", help="Folder of the archive; added to if it is there.")],
    turbine: Annotated[
        str | None, typer.Option(help="Of all records: a packaged turbine (windsysid turbines) or a TOML file.")
    ] = None,
    fleet: Annotated[Path | None, typer.Option(help="TOML file of several turbines (docs/fleet.md).")] = None,
    sensors: Annotated[
        Path | None, typer.Option(help="TOML list of sensors; the turbine's usual ones by default.")
    ] = None,
    mapping: Mapping = None,
    scada: Annotated[Path | None, typer.Option(help="SCADA statistics with dates: CSV, Parquet, …")] = None,
    scada_mapping: Annotated[Path | None, typer.Option(help="TOML file that says what its columns are.")] = None,
    formulation: Annotated[
        Literal["spectral", "joint", "auto"],
        typer.Option(help="spectral: stationary records, cheap. joint: filters, ten times the time. auto: both."),
    ] = "spectral",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; one for each processor by default.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers take the records instead.")
    ] = None,
    limit: Annotated[str, typer.Option(help="Time that a record may take, with its unit.")] = "10 min",
) -> None:
    """Identify all records of folders into one archive: what is new, interruptible, a row for each record."""
    from windsysid.fleet.batch import batch as take

    seconds = parse_option("--limit", limit, "s")
    try:
        with show_progress("batch") as progress:
            found = take(
                sources, archive=output, turbine=turbine, fleet=fleet, sensors=sensors, mapping=mapping, scada=scada,
                scada_mapping=scada_mapping, formulation=formulation, workers=workers, scheduler=scheduler,
                limit=seconds, progress=progress,
            )  # fmt: skip
    except KeyboardInterrupt:
        print(f"interrupted: what was found is in {output}; the same command goes on from there", file=sys.stderr)
        raise typer.Exit(130) from None
    print(found)
