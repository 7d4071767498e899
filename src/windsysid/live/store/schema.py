"""The tables of a store, the same in SQLite and PostgreSQL: `BYTES` stands for what each calls a column of bytes.

There is no journal of events. Every row that a page shows carries the number of the event that wrote it last, so that
a page that was closed for a week receives each row once, and a stream of a thousand blocks a second leaves one row a
turbine.
"""

__all__ = ["STEPS"]

STEPS: tuple[tuple[str, ...], ...] = (
    (
        "CREATE TABLE windsysid_store (version INTEGER NOT NULL, last_event BIGINT NOT NULL)",
        "INSERT INTO windsysid_store VALUES (0, 0)",
        """CREATE TABLE configurations (
            turbine TEXT NOT NULL, at BIGINT NOT NULL, settings TEXT NOT NULL, tables TEXT NOT NULL,
            PRIMARY KEY (turbine, at))""",
        """CREATE TABLE blocks (
            turbine TEXT NOT NULL, window_start BIGINT NOT NULL, stream TEXT NOT NULL, sequence BIGINT NOT NULL,
            start BIGINT NOT NULL, rate DOUBLE PRECISION NOT NULL, channels TEXT NOT NULL, units TEXT NOT NULL,
            dtype TEXT NOT NULL, content BYTES NOT NULL, PRIMARY KEY (turbine, window_start, stream, sequence))""",
        """CREATE TABLE statuses (
            turbine TEXT NOT NULL PRIMARY KEY, sequences TEXT NOT NULL, stream BIGINT NOT NULL,
            received BIGINT NOT NULL, state TEXT NOT NULL, rotor_speed DOUBLE PRECISION, counts TEXT NOT NULL,
            event BIGINT NOT NULL)""",
        """CREATE TABLE healths (
            turbine TEXT NOT NULL, channel TEXT NOT NULL, state TEXT NOT NULL, since BIGINT NOT NULL,
            text TEXT NOT NULL, event BIGINT NOT NULL, PRIMARY KEY (turbine, channel))""",
        """CREATE TABLE results (
            turbine TEXT NOT NULL, window_start BIGINT NOT NULL, window_end BIGINT NOT NULL, closed BIGINT NOT NULL,
            event BIGINT NOT NULL, content BYTES NOT NULL, PRIMARY KEY (turbine, window_start))""",
        "CREATE INDEX results_by_event ON results (event)",
        """CREATE TABLE levels (
            turbine TEXT NOT NULL, window_start BIGINT NOT NULL, content BYTES NOT NULL,
            PRIMARY KEY (turbine, window_start))""",
        """CREATE TABLE checkpoints (
            turbine TEXT NOT NULL PRIMARY KEY, window_start BIGINT NOT NULL, window_end BIGINT NOT NULL,
            content BYTES NOT NULL)""",
        """CREATE TABLE alarms (
            key TEXT NOT NULL PRIMARY KEY, turbine TEXT NOT NULL, kind TEXT NOT NULL, severity TEXT NOT NULL,
            about TEXT NOT NULL, opened BIGINT NOT NULL, earliest BIGINT NOT NULL, latest BIGINT NOT NULL,
            ended BIGINT, text TEXT NOT NULL, acknowledged BIGINT, acknowledged_by TEXT NOT NULL,
            remark TEXT NOT NULL, event BIGINT NOT NULL)""",
        "CREATE INDEX alarms_by_time ON alarms (opened)",
        "CREATE INDEX alarms_by_event ON alarms (event)",
    ),
    ("CREATE TABLE recipients (name TEXT NOT NULL PRIMARY KEY, event BIGINT NOT NULL)",),
    (
        """CREATE TABLE spectra (
            turbine TEXT NOT NULL, window_start BIGINT NOT NULL, content BYTES NOT NULL,
            PRIMARY KEY (turbine, window_start))""",
    ),
)
"""Steps from each version of a store to the next; the version of a store is the number of its steps."""
