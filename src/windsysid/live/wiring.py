"""From settings to the sources that they mean."""

from windsysid.live.settings import ReplaySettings, Settings, SourceSettings
from windsysid.live.sources.replay import Replay
from windsysid.live.sources.source import Source

__all__ = ["sources_of"]


def sources_of(settings: Settings) -> list[Source]:
    """The sources of a settings file, not yet running.

    Raises
    ------
    ConfigurationError
        If one cannot be made.
    """
    mappings = {member.name: member.mapping for member in settings.turbines}
    return [_source(one, mappings) for one in settings.sources]


def _source(one: SourceSettings, mappings: dict[str, str | None]) -> Source:
    if isinstance(one, ReplaySettings):
        return Replay(one.record, one.turbine, speed=one.speed, mapping=mappings[one.turbine])
    raise NotImplementedError
