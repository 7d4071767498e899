"""Sentences about innovations of filters."""

from collections.abc import Mapping
from typing import Final

from windsysid.results.sentences.template import LIKELY_MACHINE, Data, Sentence

__all__ = ["INNOVATIONS"]

_OTHER_LOADS = "; likely loads of another kind: try another load model or section"
_AMPLITUDE_CAUSES = {
    ("stiffness", True): "a spring that hardens, or play",
    ("stiffness", False): "a spring that softens: a crack or a loose bolt",
    ("damping", False): "a spring or joint with dry friction",
    ("damping", True): "a spring or joint with nonlinear damping",
}


def _hz(frequency: float, rotor: float) -> str:
    """A frequency, and the harmonic of the rotor that it is: ``3.48 Hz = 3.0P``."""
    return f"{frequency:.3g} Hz" + (f" = {frequency / rotor:.1f}P" if rotor > 0.0 and frequency / rotor > 0.05 else "")


def _at(d: Data) -> str:
    return _hz(d["frequency"], d["rotor_frequency"])


def _unexplained_peak(d: Data) -> str:
    worst, *others = d["channels"]
    also = f" (also {', '.join(others)})" if others else ""
    strong = f"the power of its prediction errors is {d['level']:.2g} times that expected{also}"
    return f"the model does not explain {worst} around {_at(d)}: {strong}"


def _level_over_frequency(d: Data) -> str:
    low, high = (_hz(d[f"{end}_frequency"], d["rotor_frequency"]) for end in ("low", "high"))
    return f"the level of prediction errors goes from {d['low']:.2f} around {low} to {d['high']:.2f} around {high}"


def _grows(d: Data) -> bool:
    """Test whether a coefficient grows with amplitude: stiffness if the statistic is positive, damping if it is
    negative."""
    return (d["sigmas"] > 0.0) is (d["law"] == "stiffness")


INNOVATIONS: Final[Mapping[str, Sentence]] = {
    "channel_level": (
        "prediction errors of {channel} are {ratio:.3g} times as large as the model expects",
        ": likely an instrument (its noise, unit or gain); check it or leave it out",
    ),
    "innovation_level": lambda d: (
        f"the prediction errors are {d['ratio']:.2g} times as large as expected (mean square {d['mean_square']:.3g},"
        f" expected {d['low']:.3f} … {d['high']:.3f}): all intervals are too {'narrow' if d['ratio'] > 1.0 else 'wide'}"
    ),
    "missing_samples": "{channel} is missing in {share:.0f %} of the samples",
    "constant_offset": "{channel} has an offset that the model does not include: give its sensor a bias",
    "unexplained_peak": (_unexplained_peak, _OTHER_LOADS),
    "unexplained_level": (
        lambda d: f"{d['channel']}: prediction errors {d['level']:.2g} times as strong as expected around {_at(d)}",
        _OTHER_LOADS,
    ),
    "far_peak": lambda d: (
        f"{d['channel']} is {d['level']:.2g} times as strong as the model expects around {_at(d)}, far from every "
        "natural frequency"
    ),
    "coloured_innovations": (
        "the prediction errors of {channel} are not white (squared autocorrelations add up to {colour:.2f})"
    ),
    "level_over_frequency": (_level_over_frequency, _OTHER_LOADS),
    "spectral_line": (lambda d: f"{d['channel']} has a sinusoid at {_at(d)}, near a natural frequency", LIKELY_MACHINE),
    "late_blades": (
        lambda d: f"blade channels {'lag' if d['lag'] > 0 else 'lead'} the tower channels ({d['sigmas']:.1f} standard"
        " deviations)",
        ": likely an instrument (a clock lag, a wrong azimuth); align the clocks",
    ),
    "nonstationary_level": (
        "the prediction errors of {channel} vary in level by {variation:.0f %} over the record",
        lambda d: (
            ": likely an instrument (dead, stuck or cut off); choose a steadier section"
            if d["alone"]
            else ": likely loads of varying strength; choose a steadier section"
        ),
    ),
    "heavy_tails": (
        "the prediction errors of {channel} have heavy tails (excess kurtosis {kurtosis:.1f})",
        ": likely impacts, or an instrument with spikes; check its largest readings",
    ),
    "correlated_innovations": (
        "prediction errors of {channels:and} are correlated ({correlation:.2f})",
        ": likely loads on both at once, a misaligned sensor or a clock lag",
    ),
    "too_many_outliers": (
        "{share:.0f %} of the readings of {channel} were left out: too many for outliers, the model is wrong"
    ),
    "gated_readings": "{share:.2g %} of the readings of {channel} were left out as outliers",
    "outlying_innovations": (
        "readings of {channel} that are more than {sigmas:g} standard deviations off ({count}) make up {share:.0f %} "
        "of its squared prediction errors",
        ": remove the spikes",
    ),
    "nonlinear_force": (
        "prediction errors of {channel} are correlated with the cube of {coordinate}",
        ": likely a hardening spring or friction; coefficients hold at this amplitude",
    ),
    "amplitude_dependence": (
        lambda d: f"{d['law']} of {' and '.join(d['coordinates'])} {'grows' if _grows(d) else 'falls'} with amplitude"
        f" ({abs(d['sigmas']):.1f} standard deviations)",
        lambda d: f": likely {_AMPLITUDE_CAUSES[d['law'], _grows(d)]}; it holds at this amplitude only",
    ),
    "correlated_loads": (
        "{loads:and} are correlated ({sigmas:|.1f|} standard deviations)",
        ": likely loads on both at once; choose a section in which the wind comes along one axis",
    ),
}  # fmt: skip
"""For each code its sentence: one part, or a statement and its likely cause with what to do."""
