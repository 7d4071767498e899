"""Loads that were states, as the filter knew them."""

from typing import NamedTuple

from windsysid._types import Array

__all__ = ["Loads"]


class Loads(NamedTuple):
    """The loads that were states: names, mean and standard deviation after each sample (T, n) [N, N·m]."""

    names: tuple[str, ...]
    mean: Array
    std: Array
