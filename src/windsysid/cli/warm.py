"""The command that compiles ahead of time: for images, clusters and wheels."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from windsysid.cli.common import app, show_progress
from windsysid.output.console import printable

if TYPE_CHECKING:
    from windsysid.output.progress import Progress
    from windsysid.turbine.turbine import Turbine

__all__ = []

RECORD_PERIODS, SAMPLES_PER_PERIOD = 90.0, 10.0
"""Setting: length of a simulated record in periods of the slowest mode, and its rate in samples per fastest period."""


@app.command()
def warm(
    portable: Annotated[
        bool,
        typer.Option(
            "--portable", metavar="", help="Compile for any recent processor of this kind, not only for this one."
        ),
    ] = False,
) -> None:
    """Compile in advance what commands compile at first use, for container images, clusters and wheels."""
    from windsysid.kernels.cache import cache_folder, compile_anew

    compile_anew(portable=portable)
    from windsysid.turbine.file import load_turbine, packaged_turbines

    with show_progress("warm") as progress:
        for name in packaged_turbines():
            _use(load_turbine(name), progress)
        _repeat_study(progress)
    kernels = sum(1 for _ in (cache_folder() / "kernels").glob("*.kernel"))
    print(printable(f"{kernels} kernels in {cache_folder()}"))


def _use(turbine: "Turbine", progress: "Progress") -> None:
    """Simulate a record of a turbine and analyse it in every way."""
    from windsysid.identification.identify import identify
    from windsysid.simulation.record import simulate_record
    from windsysid.spectral.oma.analyse import analyse_vibration

    frequencies = [turbine.natural_frequency(name) / (2.0 * math.pi) for name in turbine.model.coordinates]
    progress(f"{turbine.name}: simulating", None)
    record = simulate_record(
        turbine, duration=RECORD_PERIODS / min(frequencies), rate=SAMPLES_PER_PERIOD * max(frequencies), seed=1
    )
    progress(f"{turbine.name}: identifying", None)
    identify(record, turbine)
    identify(record, turbine, formulation="joint", loads="broadband")
    analyse_vibration(record, turbine=turbine)


def _repeat_study(progress: "Progress") -> None:
    from windsysid.study.run import run_study

    run_study(0, progress)
