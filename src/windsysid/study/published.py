"""Errors and times of the published study."""

__all__ = ["PUBLISHED", "PUBLISHED_SECONDS"]

PUBLISHED = {"k_x": 0.23, "k_y": 0.66, "k_beta_1": 1.60, "c_x": 5.41, "c_y": 4.53, "c_beta_1": 0.01}
"""Published average errors of the extended Kalman filter [%]."""

PUBLISHED_SECONDS = 30.0
"""Published computing time of the extended Kalman filter [s]."""
