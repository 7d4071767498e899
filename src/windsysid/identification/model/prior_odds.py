"""Prior odds of effects by site, from ``prior_odds.toml`` and the table ``[odds]`` of a turbine file.

An effect is included where its posterior odds, prior odds times evidence, are large. Evidence of a load model is
Laplace's. A test by chance alone has a bound for the prior odds onshore; with other odds the log evidence at its bound
moves by as much: half the square of standard deviations, and −log of the chance of Thomson's F. Tests that share one
probability share it in proportion to their prior odds (weighted Bonferroni).

Sources: Kass & Raftery, J. Am. Stat. Assoc. 90, 1995, https://doi.org/10.1080/01621459.1995.10476572; Genovese, Roeder
& Wasserman, Biometrika 93, 2006, https://doi.org/10.1093/biomet/93.3.509.
"""

import math
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from windsysid.checks.limits import LOG_EVIDENCE_STD
from windsysid.configuration import parse_toml
from windsysid.errors import ConfigurationError
from windsysid.spectral.transforms.harmonics import TAPER_COUNT
from windsysid.turbine.turbine import Turbine

__all__ = ["chances_of_rivals", "check_odds", "f_bound", "log_bound", "odds_of", "odds_table", "sigma_bound"]


WAVE_FREQUENCIES_HZ = (0.03, 0.5)
"""Setting: frequencies of waves with periods of 33 to 2 s, which have the prior odds of ``waves``."""


@cache
def odds_table() -> dict[str, dict[str, Any]]:
    """Return for each effect its prior odds ``onshore`` and ``offshore``, and their ``reason``."""
    file = resources.files("windsysid.identification.model") / "prior_odds.toml"
    return parse_toml(file.read_text(encoding="utf-8"))


def check_odds(turbine: Turbine) -> None:
    """Raise ConfigurationError for prior odds of effects that there are not, or that are not greater than 0."""
    for code, odds in turbine.odds.items():
        if code not in odds_table():
            raise ConfigurationError(f"odds: expected effects ({', '.join(odds_table())}); got '{code}'")
        if not 0.0 < odds < math.inf:
            raise ConfigurationError(f"odds: expected finite numbers greater than 0, got {odds!r:.40} for {code}")


def odds_of(code: str, turbine: Turbine, frequency: float = math.nan) -> float:
    """Return the prior odds of an effect at a turbine; those of a narrow-band load at a frequency [Hz] include waves.

    Examples
    --------
    >>> from windsysid.turbine.file import load_turbine
    >>> tower = load_turbine("tower")
    >>> odds_of("narrow_band_load", tower, 0.1), odds_of("narrow_band_load", tower.at("offshore"), 0.1)
    (1.01, 21.0)
    """
    table = odds_table()
    odds = turbine.odds.get(code, table.get(code, table["other"])[turbine.site])
    is_wave = code == "narrow_band_load" and WAVE_FREQUENCIES_HZ[0] <= frequency <= WAVE_FREQUENCIES_HZ[1]
    return float(odds) + (odds_of("waves", turbine) if is_wave else 0.0)


def chances_of_rivals(log_odds: Sequence[float]) -> list[float]:
    """Probabilities of the rivals of an explanation, from their posterior log odds against it.

    The mean of a logistic function over normal errors of the log odds, with standard deviation s = `LOG_EVIDENCE_STD`,
    is that of the log odds over √(1 + π s²/8) (MacKay, Neural Computation 4, 1992,
    https://doi.org/10.1162/neco.1992.4.5.720).

    Examples
    --------
    >>> [round(chance, 2) for chance in chances_of_rivals([0.0])], [round(p, 2) for p in chances_of_rivals([3.0, -3.0])]
    ([0.5], [0.77, 0.05])
    """
    tempered = np.append(0.0, log_odds) / math.sqrt(1.0 + math.pi / 8.0 * LOG_EVIDENCE_STD**2)
    weights = np.exp(tempered - tempered.max())
    return [float(weight) for weight in weights[1:] / weights.sum()]


def log_bound(bound: float, code: str, turbine: Turbine) -> float:
    """Bound on a log likelihood ratio for the prior odds of a turbine, given that for the odds onshore."""
    return bound + math.log(odds_table()[code]["onshore"] / odds_of(code, turbine))


def sigma_bound(bound: float, code: str, turbine: Turbine) -> float:
    """Bound in standard deviations for the prior odds of a turbine, given that for the odds onshore."""
    return math.sqrt(max(2.0 * log_bound(0.5 * bound**2, code, turbine), 0.0))


def f_bound(chance: float, code: str, turbine: Turbine) -> float:
    """Bound on Thomson's F for the prior odds of a turbine, of which chance exceeds that for the odds onshore with a
    probability: (1 + F/(K − 1))^(1 − K) for K tapers."""
    rest = TAPER_COUNT - 1
    return rest * math.expm1(max(log_bound(-math.log(chance), code, turbine), 0.0) / rest)
