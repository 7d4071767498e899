"""Errors of windsysid on bad input: what is wrong, expected and received values, and advice."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = [
    "ConfigurationError", "NumericalError", "OutputError", "RecordError", "StoreError", "UnknownTimeError",
    "WindsysidError", "as_numerical_error", "unreadable",
]  # fmt: skip


class WindsysidError(Exception):
    """Base class of all errors of windsysid; the text is one line for the user."""


class RecordError(WindsysidError, ValueError):
    """A record cannot be read, or lacks what a function needs."""


class UnknownTimeError(RecordError):
    """A file can be read but does not give its times: a rate, a column or a unit is missing."""


class ConfigurationError(WindsysidError, ValueError):
    """A turbine, a sensor list, an option or a folder of results is wrong."""


class OutputError(WindsysidError, OSError):
    """A file or a folder cannot be written."""


class StoreError(WindsysidError):
    """The store of a live service cannot be opened, read or written."""


class NumericalError(WindsysidError, ValueError):
    """A numerical operation failed, although the input was valid."""


def unreadable(path: str | Path, expected: str, error: Exception) -> str:
    """Describe an input file that cannot be opened or decoded, in the same sentence for every kind of file."""
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return f"{path}: no such file, expected {expected}; check the name and the folder"
    if isinstance(error, IsADirectoryError):
        return f"{path}: is a folder, expected {expected}; name one of the files in it"
    if isinstance(error, OSError):
        return f"{path}: cannot be read ({error.strerror or error}), expected {expected}; check its permissions"
    return f"{path}: is not {expected} ({' '.join(str(error).split())[:120]}); correct it"


@contextmanager
def as_numerical_error(what: str) -> Iterator[None]:
    """Turn arithmetic, linear algebra and array errors in `what` into a `NumericalError` of one line.

    The original error is its ``__cause__``.
    """
    try:
        yield
    except WindsysidError:
        raise
    except (ArithmeticError, ValueError) as error:  # numpy.linalg.LinAlgError is a ValueError
        text = " ".join(str(error).split())
        raise NumericalError(
            f"{what} failed in a numerical operation ({type(error).__name__}: {text[:100]}): check units, turbine "
            "file and priors, or choose another section"
        ) from error
