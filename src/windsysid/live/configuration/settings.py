"""The settings of a live service: one TOML file, checked as a whole.

    store = "store.sqlite"

    [[turbine]]
    name = "T01"
    turbine = "tower"

    [[source]]
    kind = "mqtt"
    broker = "mqtts://broker.site.example:8883"

docs/live.md lists every key. Paths are relative to the file's own folder. Secrets stand in files or environment
variables, never here.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from windsysid.configuration import parse_toml, read_toml
from windsysid.errors import ConfigurationError, unreadable
from windsysid.fleet.members import Member
from windsysid.live.configuration.source_settings import (
    Broker,
    FolderSettings,
    ReplaySettings,
    SourceSettings,
    broker_of,
    source_of,
)
from windsysid.live.configuration.toml_table import Secret, TomlTable
from windsysid.live.store.keep import span
from windsysid.turbine.file import packaged_turbines

__all__ = ["LogSettings", "MqttNotice", "PageSettings", "Settings", "SettingsError", "WebhookNotice", "read_settings"]

LOOPBACK = ("127.0.0.1", "::1", "localhost")
SEVERITIES = ("notice", "warning", "alarm")
MIN_LEARNING_WINDOWS = 12
"""Windows that the watch learns from at least."""


class SettingsError(ConfigurationError):
    """A settings file is wrong.

    Attributes
    ----------
    lines
        All that is wrong: file, table, key, what was expected, what was got.
    """

    def __init__(self, lines: list[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = lines


@dataclass(frozen=True)
class WebhookNotice:
    """Alarms as JSON to a web address, from a severity on."""

    url: Secret
    token: Secret | None
    severity: str


@dataclass(frozen=True)
class MqttNotice:
    """Alarms as retained messages of a broker, from a severity on; the topic holds ``{turbine}`` and ``{alarm}``."""

    broker: Broker
    topic: str
    severity: str


NoticeSettings = WebhookNotice | MqttNotice


@dataclass(frozen=True)
class PageSettings:
    """Address of the page, and access to it.

    Attributes
    ----------
    port
        0 takes any that is free.
    reader, operator
        Tokens: one that sees, one that acknowledges too. Without any, everybody on this machine may do both.
    certificate, key
        Files of the page's own TLS.
    """

    host: str = "127.0.0.1"
    port: int = 8420
    reader: Secret | None = None
    operator: Secret | None = None
    certificate: Path | None = None
    key: Path | None = None


@dataclass(frozen=True)
class LogSettings:
    """Format and level of the log."""

    format: Literal["text", "json"] = "text"
    level: str = "info"


@dataclass(frozen=True)
class Settings:
    """Settings of a service.

    Attributes
    ----------
    store
        A path, or the URL of a PostgreSQL database.
    turbines
        As fleet files have them.
    window, lateness, silence
        Seconds: of a window, that a block may come late, and after which a turbine counts as silent.
    workers
        Processes that estimate; as many as processors where None.
    alarms_per_year
        False alarms that are accepted of a turbine in a year.
    learn
        Windows that the watch learns from before it tests.
    keep
        How long the store keeps what: table [keep] as it stands.
    """

    store: str
    turbines: tuple[Member, ...]
    sources: tuple[SourceSettings, ...] = ()
    notices: tuple[NoticeSettings, ...] = ()
    page: PageSettings = PageSettings()
    log: LogSettings = LogSettings()
    window: float = 600.0
    lateness: float = 30.0
    silence: float = 300.0
    formulation: str = "spectral"
    workers: int | None = None
    alarms_per_year: float = 0.1
    learn: int = 144
    keep: dict[str, str] = field(default_factory=dict)


def read_settings(path: str | Path) -> Settings:
    """The settings of a file.

    Raises
    ------
    SettingsError
        With all that is wrong in it, one line each.
    """
    path = Path(path)
    try:
        tables = parse_toml(read_toml(path))
    except (OSError, ValueError) as error:
        raise SettingsError([unreadable(path, "a settings file as in docs/live.md", error)]) from None
    faults: list[str] = []
    found = _settings(TomlTable(str(path), tables, path.resolve().parent, faults))
    if faults:
        raise SettingsError(faults)
    return found


def _settings(file: TomlTable) -> Settings:
    store = _store(file)
    window = file.time("window", "10 min", "1 min", "2 h")
    lateness = file.time("lateness", "30 s", "0 s", "1 h")
    silence = file.time("silence", "5 min", "10 s", "7 d")
    learn = file.time("learn", "1 d", "10 min", "60 d")
    formulation = file.choice("formulation", ("spectral", "joint", "auto"), "spectral")
    workers = file.whole("workers", None, 1, 256)
    alarms = file.number("alarms_per_year", 0.1, 1e-3, 100.0)
    turbines = _turbines(file)
    sources = _sources(file, turbines)
    notices = [told for table in file.tables("notify", "notify") if (told := _notice(table)) is not None]
    page, log, keep = _page(file.table("page")), _log(file.table("log")), _keep(file.table("keep"))
    file.done()
    return Settings(
        store=store, turbines=turbines, sources=sources, notices=tuple(notices), page=page, log=log,
        window=window, lateness=lateness, silence=silence, formulation=formulation, workers=workers,
        alarms_per_year=alarms, learn=max(round(learn / window), MIN_LEARNING_WINDOWS), keep=keep,
    )  # fmt: skip


def _store(file: TomlTable) -> str:
    if "://" in str(file.given.get("store")) and not str(file.given["store"]).startswith("sqlite:"):
        return file.url("store", ("postgresql", "postgres"), hint="the environment variable PGPASSWORD, or ~/.pgpass")
    named = file.text("store", expected="a path, or postgresql://USER@HOST/DATABASE, in quotes", needed=True)
    path = file.folder / named.removeprefix("sqlite:").removeprefix("//")
    if named and not path.parent.is_dir():
        file.fault(f"store: the folder '{path.parent}' does not exist: create it, writable by the service's user")
    return str(path)


def _turbines(file: TomlTable) -> tuple[Member, ...]:
    members = [made for table in file.tables("turbine", "turbine") if (made := _turbine(table)) is not None]
    if not file.given.get("turbine"):
        file.fault("[[turbine]] is missing: expected one table or more, with name and turbine")
    names = [member.name for member in members]
    for name in sorted({name for name in names if names.count(name) > 1}):
        file.fault(f"[[turbine]]: two are called '{name}': give each a name of its own")
    return tuple(members)


def _sources(file: TomlTable, turbines: tuple[Member, ...]) -> tuple[SourceSettings, ...]:
    names = [member.name for member in turbines]
    sources = [made for table in file.tables("source", "source") if (made := source_of(table, names)) is not None]
    read = {one.turbine for one in sources if isinstance(one, FolderSettings | ReplaySettings)}
    for one in turbines:
        if one.mapping is not None and one.name not in read:
            what = "mapping is only for the sources folder and replay: remove it"
            file.fault(f"[[turbine]] '{one.name}': {what}")
    if not file.given.get("source"):
        file.fault("[[source]] is missing: expected one table or more, of kind mqtt, folder, opcua or replay")
    return tuple(sources)


def _turbine(table: TomlTable) -> Member | None:
    name = table.text("name", needed=True)
    machine = table.text("turbine", expected="a packaged turbine or a path, in quotes", needed=True)
    optional = ("mapping", "sensors")
    files = {key: path for key in optional if (path := table.path(key, exists="file")) is not None}
    table.done()
    if not (name and machine):
        return None
    if machine not in packaged_turbines():
        machine = str((table.folder / machine).resolve())
    try:
        member = Member(name, machine, **{key: str(path) for key, path in files.items()})
        if all(map(Path.is_file, files.values())):
            member.settings("spectral")
    except ConfigurationError as error:
        table.fault(" ".join(str(error).split()))
        return None
    return member


def _notice(table: TomlTable) -> NoticeSettings | None:
    kind, made = table.choice("kind", ("webhook", "mqtt")), None
    if kind:
        severity = table.choice("severity", SEVERITIES, "warning")
        made = _webhook(table, severity) if kind == "webhook" else _mqtt_notice(table, severity)
        table.done()
    return made


def _webhook(table: TomlTable, severity: str) -> WebhookNotice | None:
    secret = table.secret("url")
    if secret is None:  # an address that is no secret may stand in the file
        hidden = any(key in table.given for key in ("url_file", "url_env"))
        plain = table.url("url", ("https", "http"), needed=not hidden, hint="token_file, as a bearer token")
        secret = Secret(plain) if plain else None
    token = table.secret("token")
    return None if secret is None else WebhookNotice(secret, token, severity)


def _mqtt_notice(table: TomlTable, severity: str) -> MqttNotice:
    topic = table.text("topic", "windsysid/{turbine}/alarms/{alarm}")
    if "{alarm}" not in topic or "#" in topic or "+" in topic:
        table.fault(f"topic: expected '{{alarm}}' in it and neither # nor +, got '{topic[:60]}'")
    return MqttNotice(broker_of(table), topic, severity)


def _page(table: TomlTable) -> PageSettings:
    host, port = table.text("host", "127.0.0.1"), table.whole("port", 8420, 0, 65535)
    reader, operator = table.secret("reader_token"), table.secret("operator_token")
    certificate, key = table.path("certificate", exists="file"), table.path("key", exists="file")
    asked = any(f"{who}_token_{how}" in table.given for who in ("reader", "operator") for how in ("file", "env"))
    if host not in LOOPBACK and not asked:
        table.fault(
            f"host: '{host[:60]}' can be reached from other machines: give reader_token_file and operator_token_file"
        )
    if (certificate is None) != (key is None):
        table.fault("certificate and key: expected both or neither, got one")
    table.done()
    return PageSettings(host, port or 0, reader, operator, certificate, key)


def _log(table: TomlTable) -> LogSettings:
    form = table.choice("format", ("text", "json"), "text")
    level = table.choice("level", ("debug", "info", "warning", "error"), "info")
    table.done()
    return LogSettings("json" if form == "json" else "text", level)


def _keep(table: TomlTable) -> dict[str, str]:
    def right(it: Any) -> bool:
        try:
            return isinstance(it, str) and span(it) != 0
        except ConfigurationError:
            return False

    keys = ("results", "levels", "alarms")
    expected = 'a span in quotes, such as "30 days", "10 years" or "forever"'
    kept = {key: table.value(key, expected, right, "") for key in keys}
    table.done()
    return {key: said for key, said in kept.items() if said}
