"""The command line: reads options, calls the library, prints. Heavy modules are imported by the command that needs them."""

import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn, Protocol

import typer

from windsysid import __version__
from windsysid.console import show_what_can_be_shown
from windsysid.errors import ConfigurationError, WindsysidError

if TYPE_CHECKING:
    from windsysid.formats.mapping import Mapping as FileMapping
    from windsysid.formulation import Prior
    from windsysid.mechanics.sensors import Sensor
    from windsysid.record import Record
    from windsysid.result import Identification, Posterior
    from windsysid.turbine import Turbine

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Identify the stiffness and damping of a wind turbine from its vibration.",
)

TurbineOption = Annotated[
    str, typer.Option("--turbine", help="A packaged turbine (windsysid turbines lists them) or a TOML file.")
]
Mapping = Annotated[
    Path | None, typer.Option(help="TOML file that says what a record's columns are (docs/records.md).")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace results that are already there.")]


def main() -> None:
    """Run the command line: bad input ends in one line on standard error and exit code 2."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends as Ctrl-C does: nothing half done is left
    show_what_can_be_shown()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except WindsysidError as error:
        _refuse(str(error))
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        path = str(error.filename or "")
        where = f"{path if len(path) <= 80 else f'…{path[-80:]}'}: " if path else ""
        _refuse(f"{where}{error.strerror or error}: check the path, its permissions and the space left")
    except MemoryError as error:
        _refuse(f"out of memory ({error}): take a shorter record, --section, a lower --rate, or --in-pieces")


def _refuse(message: str) -> NoReturn:
    """Say in one line what was wrong."""
    print(f"windsysid: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(2)


@app.callback(invoke_without_command=True)
def _options(version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False) -> None:
    if version:
        print(f"windsysid {__version__}")
        raise typer.Exit
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("windsysid: %(message)s"))
    logger = logging.getLogger("windsysid")
    logger.handlers = [handler]
    logger.setLevel(logging.INFO)


@app.command()
def study(
    context: typer.Context,
    output: Annotated[Path, typer.Option(help="Folder for report.html, summary.json and identification.nc.")] = Path(
        "results/study"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated record.")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Repeat the published study: ten coefficients at once by the paper's extended Kalman filter."""
    from windsysid.study.report import error_table, study_files
    from windsysid.study.run import run_study

    write = _claimed(context, output, overwrite=overwrite)
    with _progress("study") as progress:
        found = run_study(seed, progress)
    table = error_table(found)
    _print_table(table.headings, table.rows, table.caption)
    print(f"extended Kalman filter: {found.arm_a.elapsed:.3f} s for {found.arm_a.samples} samples (published: 30 s)")
    print(f"SIR particle filter: {found.particles.elapsed:.2f} s (published: 103 h)")
    with _progress("study") as progress:
        progress("writing the report")
        write(study_files(found))
    print(f"report: {output / 'report.html'}")


@app.command()
def simulate(
    turbine: TurbineOption,
    output: Annotated[Path, typer.Option(help="Record to write: .csv or .nc.")],
    duration: Annotated[float, typer.Option(help=r"Length \[s].")] = 600.0,
    rate: Annotated[float, typer.Option(help="Samples per second [Hz].")] = 100.0,
    loads: Annotated[
        Literal["random", "wind", "wind-feedback"],
        typer.Option(
            help="random: the turbine file's. wind: turbulent wind on the blades; wind-feedback: with aerodynamic damping."
        ),
    ] = "random",
    seed: Annotated[int, typer.Option(min=0, help="Seed of loads and noise.")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Simulate what a turbine's sensors record."""
    from windsysid.formats import claim_record
    from windsysid.simulate import simulate_record
    from windsysid.turbine import load_turbine

    machine = load_turbine(turbine)
    with claim_record(output, overwrite=overwrite) as write, _progress("simulate") as progress:
        progress(f"{duration:g} s of {machine.name} at {rate:g} Hz")
        record = simulate_record(machine, duration=duration, rate=rate, seed=seed, loads=loads)
        progress(f"writing {output}")
        write(record)
    print(record)
    print(f"record: {output}")


@app.command()
def identify(
    context: typer.Context,
    record: Annotated[Path, typer.Argument(help="CSV, Parquet, netCDF, or OpenFAST .out / .outb.")],
    turbine: TurbineOption,
    output: Annotated[Path, typer.Option(help="Folder for report.html, summary.json and identification.nc.")],
    sensors: Annotated[
        Path | None, typer.Option(help="TOML list of the record's sensors; the turbine's usual ones by default.")
    ] = None,
    formulation: Annotated[
        Literal["joint", "force-balance"],
        typer.Option(help="joint: from accelerometers, loads as states. force-balance: the published study's."),
    ] = "joint",
    section: Annotated[
        tuple[float, float] | None, typer.Option(metavar="START END", help=r"Part of the record to use \[s].")
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            help=r"Readings per second to resample to \[Hz], without aliasing: leave out what is faster than the model."
        ),
    ] = None,
    loads: Annotated[
        Literal["auto", "broadband", "second-order", "rotor-wind"],
        typer.Option(help="What the loads are taken for (docs/loads.md); auto: the record chooses."),
    ] = "auto",
    prior_scale: Annotated[float, typer.Option(help="Centre every prior this many times off its reference.")] = 1.0,
    add_noise: Annotated[
        float,
        typer.Option(metavar="PERCENT", help="Add white noise of this percentage of each sensor's standard deviation."),
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the added noise.")] = 0,
    in_pieces: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help='Take the record in piece by piece ("10 min"), in bounded memory; interrupted, the same command goes on.',
        ),
    ] = None,
    mapping: Mapping = None,
    overwrite: Overwrite = False,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report.html.")] = False,
) -> None:
    """Identify stiffness and damping of a turbine from a record."""
    from dataclasses import replace

    from windsysid.formats import load_mapping, read_record
    from windsysid.formulation import Prior
    from windsysid.identification import identify as identify_record
    from windsysid.mechanics.sensors import read_sensors
    from windsysid.provenance import mapping_tables, record_hash
    from windsysid.turbine import load_turbine

    write = _claimed(context, output, record, overwrite=overwrite)
    machine = load_turbine(turbine)
    rules = load_mapping(mapping) if mapping is not None else None
    listed = read_sensors(sensors) if sensors is not None else None
    prior = Prior(prior_scale, prior_scale, spread=None if formulation == "joint" else 1.0)
    with _progress("identify") as progress:
        if in_pieces is not None:
            if formulation != "joint" or section is not None or rate is not None or add_noise != 0.0 or loads != "auto":
                raise ConfigurationError(
                    "--in-pieces goes with the joint formulation on a whole record: leave --section, --rate, --loads and --add-noise out"
                )
            length = _quantity("--in-pieces", in_pieces, "s")
            found, used = _identified_in_pieces(record, machine, listed, prior, rules, length, output, progress)
        else:
            recorded = data = read_record(
                record, mapping=rules, progress=lambda done: progress(f"reading {record}, {100 * done:.0f} %")
            )
            if add_noise != 0.0:
                data, listed = _noisy(data, machine, listed, formulation, section, add_noise, seed)
            progress(f"{formulation} formulation, {data.samples} samples")
            found = identify_record(
                data, machine, sensors=listed, formulation=formulation, section=section, prior=prior, rate=rate, loads=loads
            )  # fmt: skip
            used = data.section(*section) if section else data
            if found.provenance is not None:
                traced = found.provenance.with_options(file=str(record), mapping=mapping_tables(rules))
                if add_noise != 0.0:
                    traced = traced.with_options(add_noise_percent=add_noise, seed=seed)
                    traced = replace(traced, record_hash=record_hash(recorded))
                found = replace(found, provenance=traced)
    print(found)
    with _progress("identify") as progress:
        files = found.files()
        if not no_report:
            from windsysid.report import identification_report

            progress("writing the report")
            files["report.html"] = identification_report(found, used)
        write(files)
    if in_pieces is not None:
        _checkpoint(output).unlink(missing_ok=True)
    print(
        f"{found.samples} samples in {found.elapsed:.2f} s; results: {output / ('summary.json' if no_report else 'report.html')}"
    )


def _identified_in_pieces(
    record: Path,
    machine: "Turbine",
    listed: Sequence["Sensor"] | None,
    prior: "Prior",
    mapping: "FileMapping | None",
    length: float,
    output: Path,
    progress: Callable[[str], None],
) -> tuple["Identification", "Record"]:
    """Identify a file piece by piece, going on from where an earlier call was interrupted; the last piece too."""
    from windsysid.formats import iterate_record
    from windsysid.provenance import mapping_tables
    from windsysid.stream import identify_pieces

    checkpoint = _checkpoint(output)
    share, reached = 0.0, 0.0
    last: list[Record] = []
    if checkpoint.exists():
        progress(f"going on from {checkpoint}")

    def reading(done: float) -> None:
        nonlocal share
        share = done

    def taken(seconds: float) -> None:
        nonlocal reached
        reached = seconds
        progress(f"{100 * share:.0f} % of {record}, {seconds:.0f} s of it taken in")

    def pieces() -> Iterator["Record"]:
        for piece in iterate_record(record, length, mapping=mapping, progress=reading):
            last[:] = [piece]
            yield piece

    try:
        told = {"file": str(record), "in_pieces_s": length, "mapping": mapping_tables(mapping)}
        found = identify_pieces(
            pieces(),
            machine,
            sensors=listed,
            prior=prior,
            checkpoint=checkpoint,
            keep_checkpoint=True,
            progress=taken,
            options=told,
        )
    except KeyboardInterrupt:
        print(f"interrupted at {reached:.0f} s: the same command goes on from there ({checkpoint})", file=sys.stderr)
        raise typer.Exit(130) from None
    return found, last[0]


def _checkpoint(output: Path) -> Path:
    """Where what pieces have told so far is kept until the result is saved: beside the output folder."""
    folder = output.resolve()
    return folder.with_name(f".{folder.name}.checkpoint.npz")


@app.command(name="inspect")
def inspect_command(
    context: typer.Context,
    record: Annotated[Path, typer.Argument(help="CSV, Parquet, netCDF, or OpenFAST .out / .outb.")],
    turbine: Annotated[
        str | None, typer.Option(help="Mark the modes of this turbine: a packaged name or a TOML file.")
    ] = None,
    output: Annotated[Path | None, typer.Option(help="Folder for report.html, figures and inspection.json.")] = None,
    mapping: Mapping = None,
    section_length: Annotated[float, typer.Option(help="Length of the sections to propose \\[s].")] = 100.0,
    overwrite: Overwrite = False,
) -> None:
    """Look at a record: its health, its spectra, and the sections worth using."""
    from windsysid.formats import read_record
    from windsysid.inspect import inspect_record
    from windsysid.turbine import load_turbine

    write = _claimed(context, output, record, overwrite=overwrite)
    machine = load_turbine(turbine) if turbine is not None else None
    with _progress("inspect") as progress:
        data = read_record(
            record, mapping=mapping, progress=lambda done: progress(f"reading {record}, {100 * done:.0f} %")
        )
        progress(f"{data.samples} samples")
        found = inspect_record(data, machine, section_length=section_length)
    _tell(found, output, write)


@app.command()
def plan(
    context: typer.Context,
    turbine: Annotated[str, typer.Argument(help="A packaged turbine (windsysid turbines lists them) or a TOML file.")],
    sensors: Annotated[
        Path | None, typer.Option(help="TOML list of the planned sensors; the turbine's usual ones by default.")
    ] = None,
    duration: Annotated[str, typer.Option(help="Planned length, with its unit.")] = "10 min",
    rate: Annotated[float, typer.Option(help=r"Samples per second \[Hz].")] = 100.0,
    parameters: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME",
            help="What is asked for; all coefficients by default. Masses and geometry are unknown only if named.",
        ),
    ] = None,
    within: Annotated[float, typer.Option(metavar="PERCENT", help="Wished for: ±2σ within this of the value.")] = 20.0,
    load_scale: Annotated[float, typer.Option(help="Loads this many times the turbine file's.")] = 1.0,
    rotor_speed: Annotated[
        str | None, typer.Option(help='With its unit, such as "12 rpm"; the turbine\'s usual one by default.')
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated vibration.")] = 0,
    output: Annotated[Path | None, typer.Option(help="Folder for report.html, plan.png and summary.json.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Before measuring: how well will these sensors see each coefficient, and after how long?"""
    from windsysid.mechanics.sensors import read_sensors
    from windsysid.planning import plan as plan_record
    from windsysid.turbine import load_turbine

    write = _claimed(context, output, overwrite=overwrite)
    machine = load_turbine(turbine)
    listed = read_sensors(sensors) if sensors is not None else None
    asked = [name.strip() for name in parameters.split(",")] if parameters is not None else None
    seconds = _quantity("--duration", duration, "s")
    turning = _quantity("--rotor-speed", rotor_speed, "rad/s") if rotor_speed is not None else None
    with _progress("plan") as progress:
        found = plan_record(
            machine, sensors=listed, duration=seconds, rate=rate, parameters=asked, within=within / 100.0, load_scale=load_scale,
            rotor_speed=turning, seed=seed, progress=progress,
        )  # fmt: skip
    _tell(found, output, write, json=json)


@app.command()
def compare(
    context: typer.Context,
    before: Annotated[Path, typer.Argument(help="Folder that windsysid identify wrote: the record to compare with.")],
    after: Annotated[list[Path], typer.Argument(help="One or more folders of later records.")],
    output: Annotated[Path | None, typer.Option(help="Folder for report.html, changes.png and summary.json.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Between records: which coefficients moved, by how much, and how sure that is."""
    from json import dumps

    from windsysid.comparison import compare as compare_results
    from windsysid.result import load_posterior

    if output is not None and len(after) > 1:
        raise ConfigurationError("--output goes with two folders: compare one later record at a time")
    write = _claimed(context, output, before, *after, overwrite=overwrite)
    first = load_posterior(before)
    comparisons = [compare_results(first, load_posterior(later)) for later in after]
    if len(after) == 1:
        _tell(comparisons[0], output, write, json=json)
    elif json:
        print(dumps([found.summary() for found in comparisons], indent=2))
    else:
        print(*comparisons, sep="\n\n")


@app.command()
def damping(
    context: typer.Context,
    results: Annotated[
        list[Path],
        typer.Argument(
            help="Folders that windsysid identify wrote: one turbine, parked and running, in several winds."
        ),
    ],
    output: Annotated[Path | None, typer.Option(help="Folder for report.html, damping.png and summary.json.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Structural against aerodynamic damping: what records in several states tell of each, or why they do not."""
    from windsysid.damping import separate_damping
    from windsysid.result import load_posterior

    write = _claimed(context, output, *results, overwrite=overwrite)
    found = separate_damping([load_posterior(folder) for folder in results])
    _tell(found, output, write, json=json)


@app.command()
def monitor(
    context: typer.Context,
    results: Annotated[
        list[Path],
        typer.Argument(
            help="Folders that windsysid identify wrote; records that say when they began are put in order."
        ),
    ],
    covariates: Annotated[
        Path | None,
        typer.Option(
            help="CSV with a line for each folder: time or folder, and what else moved, such as temperature and wind."
        ),
    ] = None,
    alarms_per_year: Annotated[float, typer.Option(help="False alarms that are accepted in a year of records.")] = 0.1,
    output: Annotated[Path | None, typer.Option(help="Folder for report.html, monitor.png and summary.json.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Over many records: what drifted, what jumped, when and by how much, at a stated rate of false alarms."""
    from windsysid.blocks import read_blocks
    from windsysid.monitor import watch

    inputs = (*results, *([] if covariates is None else [covariates]))
    write = _claimed(context, output, *inputs, overwrite=overwrite)
    found = watch(read_blocks(results, covariates), alarms_per_year=alarms_per_year)
    _tell(found, output, write, json=json)


@app.command()
def modes(
    context: typer.Context,
    source: Annotated[
        str,
        typer.Argument(
            metavar="TURBINE|RESULT",
            help="A packaged turbine, a TOML file, or a folder that identify wrote: with the bands of its posterior.",
        ),
    ],
    speeds: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="FROM TO",
            help='Rotor speeds of the diagram, such as "0 rpm" "20 rpm"; 0.1 to 1.3 times the usual one by default.',
        ),
    ] = None,
    operating: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="FROM TO", help="Operating range, with its unit; 10 % around the usual speed by default."),
    ] = None,
    output: Annotated[Path | None, typer.Option(help="Folder for report.html, campbell.png and summary.json.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Frequencies and damping ratios against rotor speed, distance from the rotor's harmonics, stability."""
    from windsysid.campbell import find_modes
    from windsysid.result import load_posterior
    from windsysid.turbine import load_turbine, packaged_turbines

    write = _claimed(context, output, source, overwrite=overwrite)
    if source in packaged_turbines() or source.endswith(".toml"):
        machine: Turbine | Posterior = load_turbine(source)
    elif Path(source).is_dir():
        machine = load_posterior(source)
    else:
        raise ConfigurationError(
            f"no turbine and no result '{source}': expected one of {', '.join(packaged_turbines())}, the path of a .toml file, "
            "or a folder that identify wrote"
        )
    diagram, working = _speeds("--speeds", speeds), _speeds("--operating", operating)
    with _progress("modes") as progress:
        found = find_modes(machine, speeds=diagram, operating=working, progress=progress)
    _tell(found, output, write, json=json)


@app.command()
def turbines() -> None:
    """List the packaged turbines."""
    from windsysid.turbine import load_turbine, packaged_turbines

    rows = []
    for name in packaged_turbines():
        machine = load_turbine(name)
        free = ", ".join(machine.model.coordinates)
        rows.append((name, f"{machine.rotor_speed * 30.0 / 3.141592653589793:.4g} rpm", free, machine.description))
    _print_table(("turbine", "speed", "degrees of freedom", "description"), rows, "Packaged turbines")
    for name in packaged_turbines():
        machine = load_turbine(name)
        print(f"{name}: {machine.source}")
        print(f"  assumed: {', '.join(machine.assumed)}")


def _noisy(
    record: "Record", turbine: "Turbine", sensors: "tuple[Sensor, ...] | None", formulation: str,
    section: tuple[float, float] | None, percent: float, seed: int,
) -> "tuple[Record, tuple[Sensor, ...] | None]":  # fmt: skip
    """The record with noise added to what will be measured, and the sensors told of it."""
    from windsysid.forcebalance import measured_channels
    from windsysid.identification import add_noise, usable_sensors, with_noise

    if formulation == "force-balance":
        return add_noise(record, measured_channels(record, turbine), percent, seed)[0], sensors
    found = usable_sensors(record.section(*section) if section else record, turbine, sensors)
    noisy, added = add_noise(record, [sensor.channel for sensor in found], percent, seed)
    return noisy, with_noise(found, added)


def _quantity(option: str, text: str, unit: str) -> float:
    """A number with its unit, in SI."""
    from windsysid.units import parse_quantity

    try:
        return parse_quantity(text, unit)
    except ConfigurationError as error:
        raise ConfigurationError(f"{option}: {error}; got '{text}'") from None


_Write = Callable[[dict[str, bytes]], None]


def _claimed(context: typer.Context, output: Path | None, *inputs: str | Path, overwrite: bool) -> _Write:
    """Take the output folder before any work, until the command ends; what writes a result there."""
    from windsysid.output import claim

    if output is None:
        return lambda _: None
    return context.with_resource(claim(output, overwrite=overwrite, inputs=inputs))


class _Answer(Protocol):
    def to_json(self) -> str: ...

    def files(self) -> dict[str, bytes]: ...


def _tell(found: _Answer, output: Path | None, write: _Write, *, json: bool = False) -> None:
    """Print an answer, then save it with its report where asked: what cannot be saved has been seen."""
    print(found.to_json().rstrip() if json else found)
    if output is not None:
        with _progress("report") as progress:
            progress("writing the report")
            write(found.files())
        if not json:
            print(f"report: {output / 'report.html'}")


def _speeds(option: str, given: tuple[str, str] | None) -> tuple[float, float] | None:
    """Two rotor speeds with their units, in rad/s."""
    return None if given is None else (_quantity(option, given[0], "rad/s"), _quantity(option, given[1], "rad/s"))


@contextmanager
def _progress(title: str) -> Iterator[Any]:
    """Say on standard error what is being done: a spinner on a terminal, nothing in a pipe."""
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True)
    spinner = "dots" if console.encoding.startswith("utf") else "line"
    with console.status(Text(title), spinner=spinner) as status:  # a Text, since Rich takes a str for markup
        yield lambda text: status.update(Text(f"{title}: {text}"))


def _print_table(headings: Any, rows: Any, title: str) -> None:
    from rich.table import Table

    from windsysid.console import render

    table = Table(title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading)
    for row in rows:
        table.add_row(*row)
    print(render(table))


if __name__ == "__main__":
    main()
