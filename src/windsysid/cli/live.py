"""The commands that follow turbines while they run: live and export."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from windsysid.cli.common import app, name_of, numbered
from windsysid.errors import ConfigurationError
from windsysid.output.console import printable

if TYPE_CHECKING:
    from windsysid.live.configuration.settings import Settings
    from windsysid.live.sources.source import BlockSource

__all__ = ["export", "live"]

MAX_FAULTS = 5
"""Setting: largest number of faults of a CONFIG that are printed; `--check` prints all."""


@app.command()
def live(
    config: Annotated[
        Path | None, typer.Argument(metavar="CONFIG", help="TOML file of turbines and sources (docs/live.md).")
    ] = None,
    demo: Annotated[
        bool,
        typer.Option(
            "--demo", metavar="", help="Follow three simulated towers, faster than real time; nothing is stored."
        ),
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER", min=0, max=65535, help="Port of the page, instead of the one that CONFIG says; 0: any."
        ),
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", metavar="", help="Do not open the page of the demo.")
    ] = False,
    check: Annotated[bool, typer.Option("--check", metavar="", help="Check CONFIG and report its errors.")] = False,
) -> None:
    """Monitor turbines while they run: estimates, alarms and a web page; no sample is lost."""
    from dataclasses import replace
    from functools import partial

    if demo == (config is not None):
        raise ConfigurationError("live: expected a CONFIG, or --demo to look around; docs/live.md has a first CONFIG")
    _needs_extra()
    from windsysid.live.configuration.settings import LogSettings, PageSettings
    from windsysid.live.logs import start_log
    from windsysid.live.service import listen, serve
    from windsysid.output.console import render

    if demo:
        from windsysid.live.demo import demo as make
        from windsysid.live.demo import story

        page = PageSettings() if port is None else PageSettings(port=port)
        settings, sources = make(page)
        start_log(LogSettings(level="warning"))
        listening = listen(page, any_near=port is None)
        note = story(sources)
        print(render(note), flush=True)
        ready = partial(_show, browser=not no_browser)
        raise typer.Exit(serve(settings, sources, listening, ready=ready, note=note))
    assert config is not None
    settings = _settings(config, whole=check)
    if port is not None:
        settings = replace(settings, page=replace(settings.page, port=port))
    from windsysid.live.configuration.wiring import sources_of

    fed: list[BlockSource] = sources_of(settings)
    if check:
        print(printable(f"{config}: valid; {_count(len(settings.turbines))}, store {settings.store}"))
        print(*(f"source: {source.describe()}" for source in fed), sep="\n")
        return
    start_log(settings.log)
    listening = listen(settings.page)
    raise typer.Exit(serve(settings, fed, listening, ready=partial(_show, browser=False)))


@app.command()
def export(
    store: Annotated[str, typer.Argument(metavar="STORE", help="Store of a live service: its file, or postgresql://…")],
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="ARCHIVE", help="Folder of an archive, as of batch; added to. By default results/STORE-export."
        ),
    ] = None,
    levels: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Also write estimates over time: netCDF, one file for each turbine."),
    ] = None,
) -> None:
    """Write the results of a live service as an archive that report and monitor read; the service may run meanwhile."""
    from windsysid.cli.common import show_progress
    from windsysid.live.store import open_store
    from windsysid.live.store.export import export_levels, export_results

    archive = output or next(numbered(name_of(store.partition("?")[0], "export")))
    opened = open_store(store, read_only=True)
    try:
        with show_progress("export") as progress:
            progress("rows of windows")
            added = export_results(opened, archive)
            if levels is not None:
                progress("levels")
                export_levels(opened, levels)
    finally:
        opened.close()
    for turbine, rows in added.items():
        print(f"{turbine}: {rows} rows added")
    print(printable(f"archive: {archive}" + ("" if levels is None else f"; levels: {levels}")))


def _settings(config: Path, *, whole: bool) -> "Settings":
    """The settings of a file, or what is wrong with it, a line for each fault, and exit code 2."""
    from windsysid.live.configuration.settings import SettingsError, read_settings

    try:
        return read_settings(config)
    except SettingsError as error:
        shown = error.lines if whole else error.lines[:MAX_FAULTS]
        left = len(error.lines) - len(shown)
        more = [f"and {left} more: windsysid live --check {config} lists all"] if left else []
        for line in (*shown, *more):
            print(f"windsysid: {printable(line)}", file=sys.stderr)
        raise typer.Exit(2) from None


def _show(url: str, *, browser: bool) -> None:
    print(f"page: {url} (Ctrl-C ends)", flush=True)
    if browser:
        import threading
        import webbrowser

        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def _needs_extra() -> None:
    from importlib.util import find_spec

    for module in ("fastapi", "uvicorn", "httpx", "mqtt5", "pyarrow"):
        if find_spec(module) is None:
            raise ConfigurationError(f"windsysid live needs {module}; install it with: pip install 'windsysid[live]'")


def _count(turbines: int) -> str:
    return "1 turbine" if turbines == 1 else f"{turbines} turbines"
