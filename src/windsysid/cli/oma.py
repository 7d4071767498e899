"""The command that finds modes from ambient vibration."""

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from windsysid.cli.common import Mapping, Overwrite, app, claim_output, show_progress
from windsysid.errors import ConfigurationError

__all__ = []


class _WithBands(TyperCommand):
    """A command whose option --band takes two numbers, any number of times, which Typer has no type for."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        joined: list[str] = []
        rest = list(args)
        while rest:
            joined.append(rest.pop(0))
            if joined[-1] == "--band" and len(rest) > 1:
                joined.append(f"{rest.pop(0)} {rest.pop(0)}")
        return super().parse_args(ctx, joined)


@app.command(cls=_WithBands)
def oma(
    context: typer.Context,
    record: Annotated[Path, typer.Argument(help="CSV, Parquet, netCDF, or OpenFAST .out / .outb.")],
    output: Annotated[Path, typer.Option(help="Folder for report.html, modes.png and summary.json.")],
    sensors: Annotated[
        Path | None,
        typer.Option(
            help=(
                "TOML list of channels with positions and directions (docs/oma.md); the record's accelerometers by "
                "default."
            )
        ),
    ] = None,
    turbine: Annotated[
        str | None,
        typer.Option(help="Take the sensors of this turbine and name its modes: a packaged name or a TOML file."),
    ] = None,
    band: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LOW HIGH",
            help=r"A band to find modes in \[Hz]; may be given several times; found from the spectra by default.",
        ),
    ] = None,
    section: Annotated[
        tuple[float, float] | None, typer.Option(metavar="START END", help=r"Part of the record to use \[s].")
    ] = None,
    mapping: Mapping = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
    overwrite: Overwrite = False,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report.html and no figures.")] = False,
) -> None:
    """Modes of any structure from its ambient vibration: frequencies, damping, shapes, no model needed."""
    from windsysid.records.formats import load_mapping, read_record
    from windsysid.spectral.modal_sensors import read_modal_sensors
    from windsysid.spectral.oma import analyse_vibration

    write = claim_output(context, output, record, overwrite=overwrite)
    rules = load_mapping(mapping) if mapping is not None else None
    listed = read_modal_sensors(sensors) if sensors is not None else None
    bands = [_band(text) for text in band] if band else None
    with show_progress("oma") as progress:
        data = read_record(
            record, mapping=rules, progress=lambda done: progress(f"reading {record}, {100 * done:.0f} %")
        )
        found = analyse_vibration(
            data, sensors=listed, turbine=turbine, bands=bands, section=section, progress=progress
        )
    print(found.to_json().rstrip() if json else found)
    with show_progress("oma") as progress:
        progress("writing the report")
        write({"summary.json": found.to_json().encode()} if no_report else found.files())
    if not json:
        print(f"results: {output / ('summary.json' if no_report else 'report.html')}")


def _band(text: str) -> tuple[float, float]:
    """Two frequencies."""
    try:
        low, high = map(float, text.split())
    except ValueError:
        raise ConfigurationError(
            f"--band: expected two frequencies in Hz, such as --band 0.9 1.1, got '{text}'"
        ) from None
    return low, high
