"""Statements that write to a store. None depends on the result of another: a batch is sent to the server at once.

What is there already is left as it is, so that every commit may come again, in whole or in part.
"""

__all__ = [
    "ALARM", "BLOCK", "CHECKPOINT", "CONFIGURATION", "DONE", "EVENTS", "EVERY_SO_MANIETH", "HEALTH", "LEVELS",
    "LEVELS_OF", "RESULT", "RESULTS_OF", "SPECTRA", "SPECTRA_OF", "SPECTRA_REPLACED", "STATUS", "THIN_LEVELS", "TOLD",
]  # fmt: skip

NEW = "NOT EXISTS (SELECT 1 FROM results WHERE turbine = ? AND window_start = ?)"

BLOCK = f"""INSERT INTO blocks (turbine, stream, sequence, start, rate, channels, units, dtype, content, window_start)
    SELECT CAST(? AS TEXT), CAST(? AS TEXT), CAST(? AS BIGINT), CAST(? AS BIGINT), CAST(? AS DOUBLE PRECISION),
        CAST(? AS TEXT), CAST(? AS TEXT), CAST(? AS TEXT), CAST(? AS BYTES), CAST(? AS BIGINT)
    WHERE {NEW} ON CONFLICT (turbine, window_start, stream, sequence) DO NOTHING"""
"""A block of a window that has its result would wait for ever."""

STATUS = """INSERT INTO statuses (turbine, sequences, stream, received, state, rotor_speed, counts, event)
    VALUES (?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (turbine) DO UPDATE SET sequences = excluded.sequences,
        stream = excluded.stream, received = excluded.received, state = excluded.state,
        rotor_speed = excluded.rotor_speed, counts = excluded.counts, event = excluded.event"""

HEALTH = """INSERT INTO healths (turbine, channel, state, since, text, event) VALUES (?, ?, ?, ?, ?, ?)
    ON CONFLICT (turbine, channel) DO UPDATE SET state = excluded.state, since = excluded.since, text = excluded.text,
        event = excluded.event
    WHERE healths.state <> excluded.state OR healths.since <> excluded.since OR healths.text <> excluded.text"""
"""No event where nothing changed."""

ALARM = f"""INSERT INTO alarms (key, turbine, kind, severity, about, opened, earliest, latest, ended, text,
        acknowledged, acknowledged_by, remark, event)
    SELECT CAST(? AS TEXT), CAST(? AS TEXT), CAST(? AS TEXT), CAST(? AS TEXT), CAST(? AS TEXT), CAST(? AS BIGINT),
        CAST(? AS BIGINT), CAST(? AS BIGINT), CAST(? AS BIGINT), CAST(? AS TEXT), CAST(? AS BIGINT), CAST(? AS TEXT),
        CAST(? AS TEXT), CAST(? AS BIGINT)
    WHERE {NEW} ON CONFLICT (key) DO UPDATE SET kind = excluded.kind, severity = excluded.severity,
        about = excluded.about, earliest = excluded.earliest,
        latest = excluded.latest, ended = excluded.ended, text = excluded.text, event = excluded.event,
        acknowledged = coalesce(alarms.acknowledged, excluded.acknowledged),
        acknowledged_by = CASE WHEN alarms.acknowledged IS NULL THEN excluded.acknowledged_by
            ELSE alarms.acknowledged_by END,
        remark = CASE WHEN alarms.acknowledged IS NULL THEN excluded.remark ELSE alarms.remark END"""
"""With a window's result that is there, its alarms are: later ones of the same key are not undone, nor is somebody's
acknowledgement."""

RESULT = """INSERT INTO results (turbine, window_start, window_end, closed, event, content) VALUES (?, ?, ?, ?, ?, ?)
    ON CONFLICT (turbine, window_start) DO NOTHING"""

LEVELS = f"""INSERT INTO levels (turbine, window_start, content)
    SELECT CAST(? AS TEXT), CAST(? AS BIGINT), CAST(? AS BYTES) WHERE {NEW}
    ON CONFLICT (turbine, window_start) DO NOTHING"""

SPECTRA = LEVELS.replace("levels", "spectra")

SPECTRA_REPLACED = "DELETE FROM spectra WHERE turbine = ? AND window_start >= ? AND window_start < ?"
"""Of every hour the last window stays."""

CHECKPOINT = """INSERT INTO checkpoints (turbine, window_start, window_end, content) VALUES (?, ?, ?, ?)
    ON CONFLICT (turbine) DO UPDATE SET window_start = excluded.window_start, window_end = excluded.window_end,
        content = excluded.content
    WHERE excluded.window_start > checkpoints.window_start"""

DONE = "DELETE FROM blocks WHERE turbine = ? AND window_start = ?"

CONFIGURATION = "INSERT INTO configurations (turbine, at, settings, tables) VALUES (?, ?, ?, ?)"

TOLD = "INSERT INTO recipients (name, event) VALUES (?, ?) ON CONFLICT (name) DO UPDATE SET event = excluded.event"

EVENTS = """SELECT event, at, turbine, kind, key FROM (
        SELECT event, received AS at, turbine, 'status' AS kind, '' AS key FROM statuses WHERE event > ?
        UNION ALL SELECT event, since, turbine, 'health', channel FROM healths WHERE event > ?
        UNION ALL SELECT event, coalesce(acknowledged, ended, opened), turbine, 'alarm', key FROM alarms WHERE event > ?
        UNION ALL SELECT event, closed, turbine, 'result', CAST(window_start AS TEXT) FROM (
            SELECT * FROM results WHERE event > ? ORDER BY event LIMIT ?) AS newest
    ) AS journal ORDER BY event LIMIT ?"""

EVERY_SO_MANIETH = """SELECT window_start FROM (
        SELECT window_start, row_number() OVER (ORDER BY window_start DESC) AS place, count(*) OVER () AS windows
        FROM {table} WHERE turbine = ? AND window_start >= ? AND window_start < ?) AS numbered
    WHERE (place - 1) % ((windows + ? - 1) / ?) = 0"""
"""The newest is always among them."""

LEVELS_OF = "SELECT window_start, content FROM levels WHERE turbine = ? AND {windows} ORDER BY window_start"

SPECTRA_OF = LEVELS_OF.replace("levels", "spectra")

RESULTS_OF = """SELECT r.window_start, r.window_end, r.closed, r.content, l.content FROM results r
    LEFT JOIN levels l ON l.turbine = r.turbine AND l.window_start = r.window_start
    WHERE r.turbine = ? AND r.{windows} ORDER BY r.window_start DESC LIMIT ?"""

THIN_LEVELS = """DELETE FROM levels WHERE turbine = ? AND window_start < ? AND EXISTS (SELECT 1 FROM levels later
    WHERE later.turbine = levels.turbine AND later.window_start > levels.window_start AND later.window_start < ?
        AND later.window_start / ? = levels.window_start / ?)"""
"""Of every day the last window stays."""
