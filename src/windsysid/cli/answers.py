"""The commands that answer from turbines and results: plan, compare, damping, monitor, modes."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    from windsysid.modal.campbell import Campbell

from windsysid.cli.common import (
    Json,
    NamesTurbine,
    Output,
    Overwrite,
    TurbineOption,
    Verbose,
    app,
    claim_output,
    compared,
    kept_of,
    name_of,
    parse_option,
    print_and_save,
    results_of,
    rotor_speeds,
    show_progress,
)
from windsysid.cli.fleet import watch_archive

__all__ = []


@app.command(cls=NamesTurbine)
def plan(
    context: typer.Context,
    turbine: TurbineOption,
    sensors: Annotated[
        Path | None, typer.Option(help="TOML list of the planned sensors; the turbine's usual ones by default.")
    ] = None,
    duration: Annotated[str, typer.Option(help="Planned length, with its unit.")] = "10 min",
    rate: Annotated[float, typer.Option(help="Samples per second [Hz].")] = 100.0,
    parameters: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME",
            help="Coefficients to plan for; all by default. Masses and geometry are unknown only if named.",
        ),
    ] = None,
    within: Annotated[
        float, typer.Option(metavar="PERCENT", help="Target: 95 % interval, ± this share of the value.")
    ] = 20.0,
    load_scale: Annotated[float, typer.Option(help="Factor on the loads of the turbine file.")] = 1.0,
    rotor_speed: Annotated[
        str | None, typer.Option(help='With its unit, such as "12 rpm"; the turbine\'s usual one by default.')
    ] = None,
    state: Annotated[
        Literal["operating", "parked"],
        typer.Option(metavar="NAME", help="State of the turbine file: operating or parked."),
    ] = "operating",
    formulation: Annotated[
        Literal["joint", "spectral", "auto"],
        typer.Option(
            help="Formulation of the later identification. spectral: a rotor in wind. auto: what suits the"
            " file's loads."
        ),
    ] = "auto",
    seed: Annotated[int, typer.Option(metavar="NUMBER", min=0, help="Seed of the simulated vibration.")] = 0,
    output: Output = None,
    json: Json = False,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
) -> None:
    """Plan a measurement: the accuracy of each coefficient with these sensors, and the time that it needs."""
    from windsysid.identification.planning.plan import plan as plan_record
    from windsysid.mechanics.sensor_lists import read_sensors
    from windsysid.turbine.file import load_turbine

    to = claim_output(context, output, name_of(turbine, "plan"), overwrite=overwrite, json=json)
    machine = load_turbine(turbine).in_state(state)
    if not 0.0 < within <= 1000.0:
        raise ConfigurationError(f"--within: expected a percentage above 0 and up to 1000, got {within:g}")
    listed = read_sensors(sensors) if sensors is not None else None
    asked = [name.strip() for name in parameters.split(",")] if parameters is not None else None
    seconds = parse_option("--duration", duration, "s")
    turning = parse_option("--rotor-speed", rotor_speed, "rad/s") if rotor_speed is not None else None
    with show_progress("plan") as progress:
        found = plan_record(
            machine, sensors=listed, duration=seconds, rate=rate, parameters=asked, within=within / 100.0,
            load_scale=load_scale,
            rotor_speed=turning, formulation=formulation, seed=seed, progress=progress,
        )  # fmt: skip
    print_and_save(found, to, json=json, verbose=verbose)


@app.command()
def compare(
    context: typer.Context,
    before: Annotated[
        Path, typer.Argument(help="Folder that windsysid identify or oma wrote: the record to compare with.")
    ],
    after: Annotated[list[Path], typer.Argument(help="One or more folders of later records.")],
    output: Output = None,
    json: Json = False,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
) -> None:
    """Compare the results of records: which coefficients changed, by how much, and with which odds."""
    from json import dumps

    from windsysid.monitoring.comparison import compare as compare_results

    given = before, *after
    before, *after = compared(given)
    if output is not None and len(after) > 1:
        raise ConfigurationError("--output goes with two folders: compare one later record at a time")
    places = [
        claim_output(
            context, output, name_of(later, "compare"), *kept_of(given, "compare"), overwrite=overwrite, json=json
        )
        for later in after
    ]
    comparisons = []
    with show_progress("compare") as progress:
        for i, later in enumerate(after):
            progress(f"comparing {later}", i / len(after))
            comparisons.append(compare_results(before, later))
    if json and len(after) > 1:
        print(dumps([found.summary() for found in comparisons], indent=2))
        return
    for i, (found, to) in enumerate(zip(comparisons, places, strict=True)):
        print(end="\n" if i else "")
        print_and_save(found, to, json=json, verbose=verbose)


@app.command()
def damping(
    context: typer.Context,
    results: Annotated[
        list[Path],
        typer.Argument(
            help="Folders that windsysid identify wrote: one turbine, parked and running, in several winds."
        ),
    ],
    output: Output = None,
    json: Json = False,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
) -> None:
    """Separate structural and aerodynamic damping, from records in several states of operation."""
    from windsysid.monitoring.damping import separate_damping
    from windsysid.results.posterior import load_posterior

    kept, results = kept_of(results, "damping"), results_of(results, "identify")
    to = claim_output(context, output, name_of(results[0], "damping"), *kept, overwrite=overwrite, json=json)
    with show_progress("damping") as progress:
        known = []
        for i, folder in enumerate(results):
            progress(f"reading {folder}", i / len(results))
            known.append(load_posterior(folder))
        progress("separating structural and aerodynamic damping")
        found = separate_damping(known)
    print_and_save(found, to, json=json, verbose=verbose)


@app.command()
def monitor(
    context: typer.Context,
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT|ARCHIVE",
            help="Folders that windsysid identify or oma wrote, by date if known; or an archive of batch.",
        ),
    ],
    turbine: Annotated[str | None, typer.Option(help="Only this turbine of an archive, with a report.")] = None,
    covariates: Annotated[
        Path | None,
        typer.Option(
            help="CSV with a line for each folder: time or folder, and covariates, such as temperature and wind."
        ),
    ] = None,
    alarms_per_year: Annotated[float, typer.Option(help="False alarms that are accepted in a year of records.")] = 0.1,
    output: Output = None,
    json: Json = False,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
) -> None:
    """Detect drifts and jumps over many records, with dates and sizes, at a stated rate of false alarms."""
    from windsysid.fleet.archive import is_archive, turbines_of
    from windsysid.monitoring.series import read_blocks
    from windsysid.monitoring.watch import watch

    if len(results) == 1 and is_archive(results[0]):
        if covariates is not None:
            raise ConfigurationError("--covariates: an archive has its states and SCADA in it: leave the file out")
        names = turbines_of(results[0]) if turbine is None else (turbine,)
        if len(names) > 1 and output is not None:
            raise ConfigurationError("--output goes with one turbine: give --turbine, or take windsysid report")
        to = None
        if len(names) == 1:
            name = name_of(results[0], f"{names[0]}-monitor")
            to = claim_output(context, output, name, *results, overwrite=overwrite, json=json)
        watch_archive(results[0], names, alarms_per_year, to, json=json, verbose=verbose)
        return
    if turbine is not None:
        raise ConfigurationError("--turbine goes with an archive that windsysid batch wrote")
    kept, results = kept_of(results, "monitor"), results_of(results, "identify", "oma")
    inputs = (*kept, *([] if covariates is None else [covariates]))
    to = claim_output(context, output, name_of(results[0], "monitor"), *inputs, overwrite=overwrite, json=json)
    with show_progress("monitor") as progress:
        progress(f"watching {len(results)} results")
        found = watch(read_blocks(results, covariates), alarms_per_year=alarms_per_year)
    print_and_save(found, to, json=json, verbose=verbose)


@app.command(cls=NamesTurbine)
def modes(
    context: typer.Context,
    sources: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="RESULT|FILE.lin",
            help="Folder that identify wrote: intervals are those of its posterior; or .lin files of OpenFAST.",
        ),
    ] = None,
    turbine: Annotated[
        str | None,
        typer.Option(help="In place of a result: a packaged turbine (windsysid turbines) or a TOML file."),
    ] = None,
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
    measured: Annotated[
        list[Path] | None,
        typer.Option(
            help="Folder that windsysid oma wrote: its modes are matched, with odds, and drawn as points; may be "
            "given several times."
        ),
    ] = None,
    output: Output = None,
    json: Json = False,
    verbose: Verbose = False,
    overwrite: Overwrite = False,
) -> None:
    """Compute modes over rotor speed (Campbell diagram): frequencies, damping, distance from harmonics, stability."""
    from windsysid.modal.linearisation.read import ENDING, read_linearisation
    from windsysid.modal.matching.match import on_diagram
    from windsysid.modal.sweep import find_modes
    from windsysid.results.posterior import load_posterior
    from windsysid.spectral.oma.known_modes import as_modes
    from windsysid.turbine.file import load_turbine

    given: list[str | Path] = [*(sources or []), *filter(None, [turbine])]
    linearised = turbine is None and any(Path(one).suffix.lower() == ENDING for one in given)
    if not given or (len(given) > 1 and not linearised):
        raise ConfigurationError("modes: expected a folder that identify wrote, .lin files, or --turbine; one of these")
    if linearised and speeds is not None:
        raise ConfigurationError("--speeds: the rotor speeds are those of the .lin files: leave it out")
    inputs = (*(sources or []), *(measured or []))
    to = claim_output(context, output, name_of(given[0], "modes"), *inputs, overwrite=overwrite, json=json)
    known = [as_modes(folder) for folder in measured or []]
    diagram, working = rotor_speeds("--speeds", speeds), rotor_speeds("--operating", operating)
    with show_progress("modes") as progress:
        if linearised:
            found: Campbell = read_linearisation(given, operating=working)
        else:
            machine = load_turbine(turbine) if turbine is not None else load_posterior(given[0])
            found = find_modes(machine, speeds=diagram, operating=working, progress=progress)
        model = found if turbine is None else load_turbine(turbine)
        points = [mode for one in known for mode in on_diagram(one, model)]
    print_and_save(found.with_measured(points), to, json=json, verbose=verbose)
