"""Filters: each is one module and one `Filter` of pure functions, and passes the one protocol test."""

from windsysid.filters.checkpoint import load_belief, save_belief
from windsysid.filters.ekf import EKF
from windsysid.filters.gaussian import Belief, Filter, Info
from windsysid.filters.iekf import IEKF
from windsysid.filters.smoother import Smoothed, smooth
from windsysid.filters.ukf import UKF

__all__ = [
    "EKF",
    "FILTERS",
    "IEKF",
    "UKF",
    "Belief",
    "Filter",
    "Info",
    "Smoothed",
    "load_belief",
    "save_belief",
    "smooth",
]

FILTERS: tuple[Filter, ...] = (EKF, IEKF, UKF)
"""Every filter there is; the protocol test runs them all."""
