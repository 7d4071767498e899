"""The command that finds modes from ambient vibration."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from windsysid.cli.common import (
    Json,
    Mapping,
    Output,
    Overwrite,
    Verbose,
    app,
    claim_output,
    name_of,
    print_answer,
    show_progress,
)
from windsysid.errors import ConfigurationError
from windsysid.output.console import printable

if TYPE_CHECKING:
    from windsysid.spectral.oma.result import OperationalModes

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
    records: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORD",
            help="CSV, Parquet, netCDF, MATLAB, TDMS, OpenFAST … (docs/records.md); several of one structure in one "
            "state, with sensors in common, are analysed together.",
        ),
    ],
    output: Output = None,
    sensors: Annotated[
        list[Path] | None,
        typer.Option(
            help=(
                "TOML list of channels with positions and directions (docs/oma.md), one for all records or one for "
                "each; the record's accelerometers by default."
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
            help="Frequency range to find modes in [Hz]; may be repeated; found from the spectra by default.",
        ),
    ] = None,
    limits: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--range",
            metavar="LOW HIGH",
            help="Frequency range to search [Hz]; the lowest two dozen bands by default.",
        ),
    ] = None,
    section: Annotated[
        tuple[float, float] | None, typer.Option(metavar="START END", help="Part of the record to use [s].")
    ] = None,
    decay: Annotated[
        bool, typer.Option("--decay", metavar="", help="The records are free decays, after a release or a shock.")
    ] = False,
    modes: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Modes that were added and removed by hand in the page (TOML, docs/oma.md)."),
    ] = None,
    mapping: Mapping = None,
    json: Json = False,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
    no_report: Annotated[
        bool, typer.Option("--no-report", metavar="", help="Write no report.html and no figures.")
    ] = False,
) -> None:
    """Identify the modes of any structure from ambient vibration: frequencies, damping, shapes; no model needed."""
    from windsysid.modal.marks import read_mode_marks
    from windsysid.records.formats import load_mapping, read_record
    from windsysid.reports.loading import kept

    inputs = (*records, *(sensors or []), *filter(None, [modes]))
    to = claim_output(context, output, name_of(records[0], "oma"), *inputs, overwrite=overwrite, json=json)
    rules = load_mapping(mapping) if mapping is not None else None
    lists = _sensor_lists(sensors or [], len(records))
    if band and (decay or modes):
        raise ConfigurationError(
            f"--band cannot be combined with {'--decay' if decay else '--modes'}: expected one of them"
        )
    marks = read_mode_marks(modes) if modes is not None else None
    analyse: Callable[..., OperationalModes]
    if decay:
        from windsysid.modal.decays.analyse import analyse_decays

        analyse = partial(analyse_decays, marks=marks)
    else:
        from windsysid.spectral.oma.analyse import analyse_vibration

        analyse = partial(analyse_vibration, bands=list(map(_band, band)) if band else marks)
    with show_progress("oma") as progress:
        found = analyse(
            [read_record(path, mapping=rules, progress=partial(progress, f"reading {path}")) for path in records],
            sensors=lists, turbine=turbine, limits=limits, section=section, progress=progress,
        )  # fmt: skip
    print_answer(found, json=json, verbose=verbose)
    if to.folder is None:
        return
    with show_progress("oma") as progress:
        progress("writing the report")
        to.write({"summary.json": found.to_json().encode(), **kept(found)} if no_report else found.files())
    if not json:
        print(f"results: {printable(to.folder / ('summary.json' if no_report else 'report.html'))}")


def _sensor_lists(paths: list[Path], records: int) -> Any:
    """The list of sensors for all records, one for each, or None."""
    from windsysid.spectral.oma.sensors import read_modal_sensors

    lists = [read_modal_sensors(path) for path in paths]
    if len(lists) > 1 and len(lists) != records:
        raise ConfigurationError(
            f"--sensors: expected one list for all records, or {records}, one for each, got {len(lists)}"
        )
    return lists if len(lists) > 1 else lists[0] if lists else None


def _band(text: str) -> tuple[float, float]:
    """Two frequencies."""
    try:
        low, high = map(float, text.split())
    except ValueError:
        raise ConfigurationError(
            f"--band: expected two frequencies in Hz, such as --band 0.9 1.1, got '{text}'"
        ) from None
    return low, high
