"""Connection to an MQTT 5 broker, and the topics and properties of blocks there.

Blocks come on one topic of each turbine, ``windsysid/<turbine>/blocks``. In addition, the service publishes
``windsysid/<turbine>/committed`` (retained: the number of the newest block up to which all are on its disk, as text; of
a named logger ``…/committed/<stream>``) and ``windsysid/<turbine>/refused`` (why a block was not taken).

A publisher that sends again what was lost marks its messages with MQTT 5 user properties: ``sequence`` and ``stream``
of the block, and ``after``, the number of the block that it sent before. Without ``after`` nothing that can still be
sent lies before the block.
"""

import importlib
from collections.abc import Mapping
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from windsysid.errors import ConfigurationError
from windsysid.live.configuration.source_settings import Broker

__all__ = [
    "MAX_PAYLOAD_BYTES", "TOPIC", "Marks", "Topics", "connect", "marks_of", "needed", "new_client", "properties_of",
]  # fmt: skip

TOPIC = "windsysid/{turbine}/blocks"
"""Of blocks."""

MAX_PAYLOAD_BYTES = 2_000_000
"""Of a message [bytes]: the broker hands longer ones to no service."""

KEEPALIVE_SECONDS = 20
"""A connection that is silent for half as long again is lost [s]."""

MAX_CONNECT_SECONDS = 5.0
"""For a connection to be made [s]."""


class Topics:
    """The topics of turbines.

    Parameters
    ----------
    blocks
        Of blocks, with ``{turbine}`` as one of its levels.
    """

    def __init__(self, blocks: str = TOPIC) -> None:
        levels = blocks.split("/")
        if levels.count("{turbine}") != 1 or "#" in blocks or "+" in blocks:
            raise ConfigurationError(f"topic: expected one level '{{turbine}}', no # and no +, got '{blocks[:60]}'")
        self._blocks = blocks
        self._beside = blocks if levels[-1] == "{turbine}" else "/".join(levels[:-1])

    def blocks(self, turbine: str) -> str:
        """Of a turbine's blocks."""
        return self._blocks.replace("{turbine}", turbine)

    def committed(self, turbine: str, stream: str) -> str:
        """Of the number up to which a logger's blocks are committed."""
        return f"{self._beside.replace('{turbine}', turbine)}/committed" + (f"/{stream}" if stream else "")

    def refused(self, turbine: str) -> str:
        """Of blocks that were not taken, and why."""
        return f"{self._beside.replace('{turbine}', turbine)}/refused"


class Marks(NamedTuple):
    """Metadata of a message in addition to the block; None if there are none."""

    sequence: int | None = None
    stream: str = ""
    after: int | None = None


def marks_of(message: Any) -> Marks:
    """The marks of a message; those that are no numbers count as not said."""
    pairs = getattr(message.properties, "UserProperty", None) or ()
    told = {str(key): str(value) for key, value in pairs}
    return Marks(_whole(told.get("sequence")), told.get("stream", ""), _whole(told.get("after")))


def _whole(text: str | None) -> int | None:
    try:
        number = int(text or "")
    except ValueError:
        return None
    return number if abs(number) < 2**63 else None


def properties_of(marks: Marks) -> Any:
    """The marks as properties of a message."""
    told = {"sequence": str(marks.sequence), "stream": marks.stream}
    properties = _properties("PUBLISH")
    properties.UserProperty = list((told if marks.after is None else {**told, "after": str(marks.after)}).items())
    return properties


def needed(module: str, what: str) -> Any:
    """A module of the extra; ConfigurationError where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ConfigurationError(f"{what}; install it with: pip install 'windsysid[live]'") from None


def new_client(broker: Broker, name: str = "", *, manual_ack: bool = False) -> Any:
    """A paho client of MQTT 5 that is not connected yet, and does not connect again by itself.

    Raises
    ------
    ConfigurationError
        If paho is not installed, or the broker's authority cannot be read.
    """
    mqtt = needed("paho.mqtt.client", "MQTT needs paho-mqtt")
    client = mqtt.Client(
        mqtt.CallbackAPIVersion.VERSION2,
        client_id=name,
        protocol=mqtt.MQTTv5,
        reconnect_on_failure=False,
        manual_ack=manual_ack,
    )
    client.connect_timeout = MAX_CONNECT_SECONDS
    if broker.user:
        client.username_pw_set(broker.user, None if broker.password is None else broker.password.value)
    if broker.url.startswith("mqtts://"):
        try:
            client.tls_set(ca_certs=None if broker.ca is None else str(broker.ca))
        except OSError as error:
            raise ConfigurationError(f"ca: '{broker.ca}' is no certificate of an authority ({error})") from None
    return client


def connect(client: Any, broker: Broker, *, clean: bool, properties: Mapping[str, int] | None = None) -> None:
    """Connect and start the client's thread; OSError where there is no broker.

    Parameters
    ----------
    clean
        Whether what the broker kept for this client is thrown away.
    properties
        Of MQTT 5's CONNECT, by name.
    """
    told = _properties("CONNECT")
    for name, value in (properties or {}).items():
        setattr(told, name, value)
    address = urlsplit(broker.url)
    port = address.port or (8883 if address.scheme == "mqtts" else 1883)
    client.connect(address.hostname or "", port, KEEPALIVE_SECONDS, clean_start=clean, properties=told)
    client.loop_start()


def _properties(packet: str) -> Any:
    types = importlib.import_module("paho.mqtt.packettypes").PacketTypes
    return importlib.import_module("paho.mqtt.properties").Properties(getattr(types, packet))
