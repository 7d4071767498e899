"""Filters: each is one module and one `Filter` of pure functions, and passes the one protocol test."""

from windsysid._lazy import naming_arguments
from windsysid.filters.checkpoint import load_belief, save_belief
from windsysid.filters.ekf import EKF
from windsysid.filters.iekf import IEKF
from windsysid.filters.particles.cloud import Cloud
from windsysid.filters.particles.filter import ParticleFilter
from windsysid.filters.particles.raoblackwell import Mixture, MixtureInfo, RaoBlackwellised, SplitModel
from windsysid.filters.particles.weights import ParticleInfo, degeneracy
from windsysid.filters.protocol import Belief, Filter, Info
from windsysid.filters.smoother import Smoothed, smooth
from windsysid.filters.ukf import UKF

__all__ = [
    "EKF", "FILTERS", "IEKF", "UKF", "Belief", "Cloud", "Filter", "Info", "Mixture", "MixtureInfo", "ParticleFilter",
    "ParticleInfo", "RaoBlackwellised", "Smoothed", "SplitModel", "degeneracy", "load_belief", "save_belief", "smooth",
]  # fmt: skip

FILTERS: tuple[Filter, ...] = (EKF, IEKF, UKF)
"""Every filter there is; the protocol test runs them all."""

globals().update({name: naming_arguments(name, globals()[name]) for name in __all__})
