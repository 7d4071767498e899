"""The errors windsysid raises on bad input: what was wrong, what was expected, what was got, what to do."""

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = [
    "ConfigurationError", "NumericalError", "OutputError", "RecordError", "StoreError", "UnknownTimeError",
    "WindsysidError",
    "one_line_of_numerics",
]  # fmt: skip


class WindsysidError(Exception):
    """Base of every error that windsysid raises on purpose; its text is one line fit for a user."""


class RecordError(WindsysidError, ValueError):
    """A record cannot be read or does not hold what is asked of it."""


class UnknownTimeError(RecordError):
    """A file can be read but does not give its times: a rate, a column or a unit is missing."""


class ConfigurationError(WindsysidError, ValueError):
    """A turbine, sensor list or option is wrong."""


class OutputError(WindsysidError, OSError):
    """A result cannot be written where it was asked for."""


class StoreError(WindsysidError):
    """The store of a live service cannot be opened, read or written."""


class NumericalError(WindsysidError, ValueError):
    """A numerical operation failed on values that were read without complaint."""


@contextmanager
def one_line_of_numerics(what: str) -> Iterator[None]:
    """Turn errors of arithmetic, of linear algebra and of arrays that leave `what` into a `NumericalError` of one line.

    Whoever looks for the place finds the first error as its cause.
    """
    try:
        yield
    except WindsysidError:
        raise
    except (ArithmeticError, ValueError) as error:  # numpy.linalg.LinAlgError is a ValueError
        said = " ".join(str(error).split())
        raise NumericalError(
            f"{what} failed in a numerical operation ({type(error).__name__}: {said[:100]}): check units, the turbine "
            "file and the priors, or take another section"
        ) from error
