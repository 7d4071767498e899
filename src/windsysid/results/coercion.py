"""A posterior given as a result, as the folder of one, or as it is."""

from pathlib import Path
from typing import TypeAlias

from windsysid.errors import ConfigurationError
from windsysid.results.identification import Identification
from windsysid.results.posterior import Posterior, load_posterior

__all__ = ["PosteriorLike", "as_posterior"]

PosteriorLike: TypeAlias = Posterior | Identification | str | Path


def as_posterior(given: PosteriorLike) -> Posterior:
    """A posterior from itself, a result, or the folder that a result was saved in; else ConfigurationError."""
    if isinstance(given, Posterior):
        return given
    if isinstance(given, Identification):
        return given.posterior
    if isinstance(given, str | Path):
        return load_posterior(given)
    raise ConfigurationError(
        "result: expected what identify returned, a Posterior, or the folder it was saved in, got"
        f" {type(given).__name__}"
    )
