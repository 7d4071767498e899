"""Construction of sources from settings."""

from windsysid.live.configuration.settings import Settings
from windsysid.live.configuration.source_settings import MqttSettings, OpcuaSettings, ReplaySettings, SourceSettings
from windsysid.live.sources.folder import FolderSource
from windsysid.live.sources.mqtt import MqttSource
from windsysid.live.sources.opcua import OpcuaSource
from windsysid.live.sources.replay import Replay
from windsysid.live.sources.source import BlockSource

__all__ = ["sources_of"]


def sources_of(settings: Settings) -> list[BlockSource]:
    """The sources of a settings file, not yet running.

    Raises
    ------
    ConfigurationError
        If one cannot be made.
    """
    names = [member.name for member in settings.turbines]
    mappings = {member.name: member.mapping for member in settings.turbines}
    return [_source(one, names, mappings) for one in settings.sources]


def _source(one: SourceSettings, names: list[str], mappings: dict[str, str | None]) -> BlockSource:
    if isinstance(one, ReplaySettings):
        return Replay(one.record, one.turbine, speed=one.speed, begin=one.start, mapping=mappings[one.turbine])
    if isinstance(one, MqttSettings):
        return MqttSource(one.broker, names, topic=one.topic, client=one.client)
    if isinstance(one, OpcuaSettings):
        return OpcuaSource(
            one.server, one.turbine, one.nodes, every=one.every, user=one.user, password=one.password,
            secured=one.secured,
        )  # fmt: skip
    return FolderSource(one.path, one.turbine, pattern=one.pattern, mapping=mappings[one.turbine])
