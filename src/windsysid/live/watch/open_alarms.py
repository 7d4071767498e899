"""The alarms of one turbine that the engine itself opens and ends: of its sensors and of its data."""

from windsysid.live.store.contents import Alarm, Severity
from windsysid.live.windows.streams import Verdict, sensor_alarm
from windsysid.live.windows.timeline import SECOND

__all__ = ["TOO_LATE", "OpenAlarms"]

TOO_LATE = (
    "blocks came too late: their windows have results already. The logger's clock was set back, or they were held up;"
    " set the clock, or raise lateness"
)

QUIET_NS = 600 * SECOND
"""A stream without a refused or late block for so long [ns] has none any more."""


class OpenAlarms:
    """Open alarms, one for each cause; every method returns the alarms that have changed."""

    def __init__(self, turbine: str) -> None:
        self.turbine = turbine
        self._open: dict[str, Alarm] = {}
        self._heard: dict[str, int] = {}

    def restore(self, alarm: Alarm) -> None:
        """Go on with an alarm that the store has as open; those of the structure are the watch's."""
        if alarm.kind == "data":
            self._open[alarm.key.split(":")[-2]] = alarm
        elif alarm.kind == "sensor":
            self._open[_cause(alarm.about, alarm.key.split(":")[-2])] = alarm

    def sensor(self, verdict: Verdict) -> list[Alarm]:
        """A channel's fault began, became another one, or is over."""
        changed = self.ended(_cause(verdict.channel, verdict.state), verdict.at)
        if verdict.state == "good":
            return changed + self.ended(_cause(verdict.channel, "drift"), verdict.at)
        alarm = self._open[_cause(verdict.channel, verdict.state)] = sensor_alarm(self.turbine, verdict)
        return [*changed, alarm]

    def data(self, cause: str, severity: Severity, text: str, now: int) -> list[Alarm]:
        """Something is wrong with the stream; an alarm that is open already stays as it is."""
        self._heard[cause] = now
        if cause in self._open:
            return []
        key = f"{self.turbine}:data:{cause}:{now}"
        alarm = self._open[cause] = Alarm(key, self.turbine, "data", severity, "", now, now, now, None, text)
        return [alarm]

    def ended(self, cause: str, at: int) -> list[Alarm]:
        """A cause is gone."""
        alarm = self._open.pop(cause, None)
        return [] if alarm is None else [alarm._replace(ended=at)]

    def quiet(self, now: int) -> list[Alarm]:
        """End the alarms about refused and late blocks."""
        gone = [cause for cause in ("refused", "too late") if now - self._heard.get(cause, 0) > QUIET_NS]
        return [alarm for cause in gone for alarm in self.ended(cause, now)]


def _cause(channel: str, state: str) -> str:
    """Key of a cause: drift comes from windows, other faults from blocks, and they do not end each other."""
    return f"{'drift' if state == 'drift' else 'sensor'}:{channel}"
