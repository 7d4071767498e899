"""The command that sends blocks to a broker."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from windsysid.cli.common import Mapping, app, parse_option, show_progress
from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    from windsysid.live.blocks.block import Block
    from windsysid.live.configuration.source_settings import Broker
    from windsysid.live.sources.publisher import Publisher

__all__ = []

_PASSWORD = "WINDSYSID_MQTT_PASSWORD"
_MIN_FREE_BUFFER_BYTES = 32_000_000
"""Of the buffer, before a record goes on being read [bytes]: what is in a file need not be dropped."""


@app.command()
def publish(
    records: Annotated[
        list[str],
        typer.Argument(metavar="RECORD", help="Files in order of time; - for a logger's JSON blocks, one a line."),
    ],
    turbine: Annotated[str, typer.Option(help="Name of the turbine in the service.")],
    broker: Annotated[str, typer.Option(metavar="URL", help="mqtt://HOST[:PORT], or mqtts:// with TLS.")],
    speed: Annotated[
        float,
        typer.Option(metavar="FACTOR", min=0.0, help="How many times faster than recorded; 0 is as fast as it goes."),
    ] = 1.0,
    block: Annotated[str, typer.Option(help="Length of a block, with its unit.")] = "1 s",
    buffer: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File that keeps uncommitted blocks over restarts; memory by default."),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="MOMENT", help="Start of a record that gives none, such as 2026-01-05T12:00:00Z."),
    ] = None,
    stream: Annotated[str, typer.Option(help="Name of the logger, if the turbine has several.")] = "",
    topic: Annotated[
        str, typer.Option(metavar="TOPIC", show_default=False, help="Of blocks; windsysid/{turbine}/blocks by default.")
    ] = "windsysid/{turbine}/blocks",
    user: Annotated[
        str,
        typer.Option(metavar="NAME", help=f"User of the broker; the password is in --password-file or {_PASSWORD}."),
    ] = "",
    password_file: Annotated[Path | None, typer.Option(help="File with the password.")] = None,
    ca: Annotated[Path | None, typer.Option(help="File of the authority that signed the broker's certificate.")] = None,
    mapping: Mapping = None,
) -> None:
    """Send records, or blocks from a logger, to an MQTT broker: each block is kept until the service has it on disk."""
    from windsysid.live.sources.publisher import Publisher

    seconds = parse_option("--block", block, "s")
    if not 0.0 < seconds <= 600.0:
        raise ConfigurationError(f"--block: expected above 0 s to 10 min, got '{block}'")
    logger = records == ["-"]
    if "-" in records and not logger:
        raise ConfigurationError("RECORD: expected - alone or files, got both")
    to = _broker(broker, user, password_file, ca)
    begin = None if logger else _begin(records, start, mapping)
    publisher = Publisher(to, buffer=buffer, topic=topic)
    sent = known = 0
    try:
        with show_progress("publish") as progress:
            if logger:
                blocks = _from_logger(turbine, stream)
            else:
                blocks = _from_records(records, turbine, begin, seconds, speed, stream, mapping)
            for one in blocks:
                if not logger:
                    publisher.wait(room=_MIN_FREE_BUFFER_BYTES)
                new = publisher.send(one)
                sent, known = sent + new, known + 1 - new
                progress(f"{sent} blocks, {len(publisher.ring)} not committed. {publisher.trouble}")
            while not publisher.wait(1.0):
                progress(f"{sent} blocks, {len(publisher.ring)} not committed. {publisher.trouble}")
    except KeyboardInterrupt:
        print(_interrupted(publisher, sent, buffer), file=sys.stderr)
        raise typer.Exit(130) from None
    finally:
        publisher.close()
    print(_told(publisher, turbine, sent, known))


def _interrupted(publisher: "Publisher", sent: int, buffer: Path | None) -> str:
    kept = f"they are kept in {buffer}" if buffer else "send the records again"
    return f"interrupted: {sent} blocks sent, {len(publisher.ring)} not committed: {kept}"


def _told(publisher: "Publisher", turbine: str, sent: int, known: int) -> str:
    committed = max(0, sent - publisher.refused - publisher.dropped)
    parts = [f"{turbine}: {committed} blocks committed"]
    if known:
        parts.append(f"{known} were sent before")
    if publisher.refused:
        parts.append(f"{publisher.refused} refused, the last: {publisher.trouble}")
    if publisher.dropped:
        parts.append(f"{publisher.dropped} dropped, since the buffer was full")
    return "; ".join(parts)


def _broker(url: str, user: str, password_file: Path | None, ca: Path | None) -> "Broker":
    """Broker settings, checked as in a settings file."""
    from windsysid.live.configuration.source_settings import Broker
    from windsysid.live.configuration.toml_table import TomlTable

    told: dict[str, str] = {"broker": url}
    if password_file is not None:
        told["password_file"] = str(password_file)
    elif os.environ.get(_PASSWORD):
        told["password_env"] = _PASSWORD
    if ca is not None:
        told["ca"] = str(ca)
    faults: list[str] = []
    table = TomlTable("publish", told, Path.cwd(), faults)
    found = Broker(
        table.url("broker", ("mqtt", "mqtts"), hint=f"--password-file or {_PASSWORD}"),
        user, table.secret("password"), table.path("ca", exists="file"),
    )  # fmt: skip
    if faults:
        raise ConfigurationError(faults[0])
    return found


def _begin(records: list[str], start: str | None, mapping: Path | None) -> int | None:
    """The moment that was given for a record that says none; all records are looked at before any is sent."""
    from windsysid.live.sources.cutting import begin_of, moment_ns
    from windsysid.records.formats import iterate_record

    for path in records:
        known = begin_of(next(iterate_record(path, 60.0, mapping=mapping)))
        if known is None and start is None:
            raise ConfigurationError(f"{path}: no start time with its zone: give --start, such as 2026-01-05T12:00:00Z")
        if start is not None and (known is not None or len(records) > 1):
            raise ConfigurationError("--start: expected one record without a start time of its own")
    return None if start is None else moment_ns(start)


def _from_records(
    records: list[str], turbine: str, begin: int | None, seconds: float, speed: float, stream: str, mapping: Path | None
) -> Iterator["Block"]:
    from windsysid.live.sources.replay import begin_or_now, paced, record_blocks

    for path in records:
        known = begin_or_now(path, speed, mapping) if begin is None else begin
        blocks = record_blocks(path, turbine, known, seconds=seconds, stream=stream, mapping=mapping)
        yield from paced(blocks, speed)


def _from_logger(turbine: str, stream: str) -> Iterator["Block"]:
    """Read the blocks of a logger from its lines; a line that is no block is reported and skipped."""
    from dataclasses import replace

    from windsysid.live.blocks.codec import BlockRefused, check, decode

    for number, line in enumerate(sys.stdin.buffer, 1):
        if not line.strip():
            continue
        try:
            block = check(decode(line, turbine=turbine))
        except BlockRefused as error:
            print(f"windsysid: line {number} was not sent: {error}", file=sys.stderr)
        else:
            yield replace(block, stream=block.stream or stream)
