"""The errors windsysid raises on bad input: what was wrong, what was expected, what was got, what to do."""

__all__ = ["ConfigurationError", "OutputError", "RecordError", "StoreError", "WindsysidError"]


class WindsysidError(Exception):
    """Base of every error that windsysid raises on purpose; its text is one line fit for a user."""


class RecordError(WindsysidError, ValueError):
    """A record cannot be read or does not hold what is asked of it."""


class ConfigurationError(WindsysidError, ValueError):
    """A turbine, sensor list or option is wrong."""


class OutputError(WindsysidError, OSError):
    """A result cannot be written where it was asked for."""


class StoreError(WindsysidError):
    """The store of a live service cannot be opened, read or written."""
