"""The sources of a live service, as its settings describe them."""

from dataclasses import dataclass
from pathlib import Path

from windsysid.live.configuration.toml_table import Secret, TomlTable

__all__ = [
    "Broker", "Certificates", "FolderSettings", "MqttSettings", "OpcuaSettings", "ReplaySettings", "SourceSettings",
    "broker_of", "source_of",
]  # fmt: skip


@dataclass(frozen=True)
class Broker:
    """Connection to an MQTT broker.

    Attributes
    ----------
    url
        ``mqtt://HOST[:PORT]``, or ``mqtts://`` with TLS.
    ca
        File of the authority that signed the broker's certificate; the system's authorities where None.
    """

    url: str
    user: str = ""
    password: Secret | None = None
    ca: Path | None = None


@dataclass(frozen=True)
class MqttSettings:
    """Blocks from a broker.

    Attributes
    ----------
    topic
        With ``{turbine}`` where the turbine's name stands.
    client
        Under this name the broker keeps what was not acknowledged.
    """

    broker: Broker
    topic: str
    client: str


@dataclass(frozen=True)
class FolderSettings:
    """Records that appear in a folder.

    Attributes
    ----------
    turbine
        Whose they are.
    pattern
        Of their names.
    """

    path: Path
    turbine: str
    pattern: str


@dataclass(frozen=True)
class OpcuaSettings:
    """Channels of a SCADA server.

    Attributes
    ----------
    nodes
        Node and unit of each channel.
    every
        How often they are read [s].
    secured
        How the service and the server know each other, and encrypt; None for neither.
    """

    server: str
    turbine: str
    nodes: dict[str, tuple[str, str]]
    every: float
    user: str = ""
    password: Secret | None = None
    secured: "Certificates | None" = None


@dataclass(frozen=True)
class Certificates:
    """Files (PEM or DER) by which a client and an OPC UA server know each other.

    Attributes
    ----------
    certificate, key
        The client's own; the certificate names its application URI.
    server_certificate
        The one that the server must have.
    """

    certificate: Path
    key: Path
    server_certificate: Path


@dataclass(frozen=True)
class ReplaySettings:
    """A record that is played.

    Attributes
    ----------
    speed
        How many times faster than it was recorded; 0 is as fast as it goes.
    start
        The moment of its time 0 [ns since 1970]; None for its own, or now.
    """

    record: Path
    turbine: str
    speed: float
    start: int | None = None


SourceSettings = MqttSettings | FolderSettings | OpcuaSettings | ReplaySettings


def source_of(table: TomlTable, names: list[str]) -> SourceSettings | None:
    """The source that a table describes, of turbines of these names; faults are the table's."""
    kinds = {"mqtt": _mqtt, "folder": _folder, "opcua": _opcua, "replay": _replay}
    kind = table.choice("kind", tuple(kinds))
    made = kinds[kind](table, names) if kind else None
    if made is not None:
        table.done()
    return made


def broker_of(table: TomlTable) -> Broker:
    """The broker that a table describes."""
    return Broker(
        url=table.url("broker", ("mqtt", "mqtts")), user=table.text("user"), password=table.secret("password"),
        ca=table.path("ca", exists="file"),
    )  # fmt: skip


def _mqtt(table: TomlTable, names: list[str]) -> MqttSettings:
    broker = broker_of(table)
    topic = table.text("topic", "windsysid/{turbine}/blocks")
    if topic.split("/").count("{turbine}") != 1 or "#" in topic or "+" in topic:
        table.fault(f"topic: expected one level '{{turbine}}' and neither # nor +, got '{topic[:60]}'")
    return MqttSettings(broker, topic, table.text("client", "windsysid-live"))


def _folder(table: TomlTable, names: list[str]) -> FolderSettings | None:
    path = table.path("path", needed=True, exists="folder")
    turbine, pattern = _one_of(table, names), table.text("pattern", "*")
    return None if path is None else FolderSettings(path, turbine, pattern)


def _opcua(table: TomlTable, names: list[str]) -> OpcuaSettings:
    server, turbine = table.url("server", ("opc.tcp",)), _one_of(table, names)
    every = table.time("every", "1 s", "10 ms", "1 h")
    user, password = table.text("user"), table.secret("password")
    secured = _certificates(table)
    nodes = {}
    for node in table.tables("node", "source.node"):
        channel, identifier, unit = (node.text(key, needed=True) for key in ("channel", "node", "unit"))
        nodes[channel] = (identifier, unit)
        node.done()
    if not table.given.get("node"):
        table.fault("[[source.node]] is missing: expected one table or more, with channel, node and unit")
    return OpcuaSettings(server, turbine, nodes, every, user, password, secured)


def _certificates(table: TomlTable) -> Certificates | None:
    keys = ("certificate", "key", "server_certificate")
    given = [path for key in keys if (path := table.path(key, exists="file")) is not None]
    missing = [key for key in keys if key not in table.given]
    if 0 < len(missing) < len(keys):
        table.fault(f"certificate, key and server_certificate: expected all three or none, got no {missing[0]}")
    return Certificates(*given) if len(given) == len(keys) else None


def _replay(table: TomlTable, names: list[str]) -> ReplaySettings | None:
    record, turbine = table.path("record", needed=True, exists="file"), _one_of(table, names)
    speed, start = table.number("speed", 1.0, 0.0, 1e6), table.moment("start")
    return None if record is None else ReplaySettings(record, turbine, speed, start)


def _one_of(table: TomlTable, names: list[str]) -> str:
    found: str = table.value("turbine", "the name of a [[turbine]]", lambda it: it in names, "", needed=True)
    return found
