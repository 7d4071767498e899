"""Filters: each is one module and one `Filter` of pure functions, and passes the one protocol test."""

from windsysid.filters.ekf import EKF
from windsysid.filters.gaussian import Belief, Filter, Info

__all__ = ["EKF", "FILTERS", "Belief", "Filter", "Info"]

FILTERS: tuple[Filter, ...] = (EKF,)
"""Every filter there is; the protocol test runs them all."""
