"""Sentences about spectra: frequency ranges, and findings against their intervals."""

from collections.abc import Mapping
from typing import Final

from windsysid.results.sentences.template import Data, Sentence

__all__ = ["SPECTRA"]


def _hz(frequencies: list[float]) -> str:
    return f"{', '.join(f'{frequency:.3g}' for frequency in frequencies)} Hz"


def _in_bands(d: Data) -> str:
    places = ", ".join(f"{name} near {frequency:.3g} Hz" for name, frequency in d["modes"].items())
    return f"frequency ranges around modes: {places}; rotor harmonics were removed"


SPECTRA: Final[Mapping[str, Sentence]] = {
    "narrow_resonance": (
        "the narrowest resonance has {count:.2g} equivalent degrees of freedom; intervals are validated from {least:g}:"
        " choose a longer record"
    ),
    "narrow_resonance_in_pieces": (
        "the narrowest resonance has {count:.2g} equivalent degrees of freedom in a piece; intervals are validated from"
        " {least:g}: choose longer pieces"
    ),
    "narrow_resonance_in_bands": (
        "the narrowest resonance of the {part} has {count:.2g} equivalent degrees of freedom; intervals are validated"
        " from {least:g}: choose a longer record"
    ),
    "narrow_resonance_in_bands_of_pieces": (
        "the narrowest resonance of the {part} has {count:.2g} equivalent degrees of freedom; intervals are validated"
        " from {least:g}: choose longer pieces"
    ),
    "long_record_under_wind": (
        "intervals under wind are validated up to {duration:.3g} s: in a longer record they omit the error of the load"
        " model"
    ),
    "unexplained_power": (
        "the power of {channel} is {ratio:.2g} times that of the model at {low:.3g} … {high:.3g} Hz: loads or"
        " motion are not as modelled there"
    ),
    "unlisted_vibration": (
        "{channel}: most of its vibration, strongest at {frequency:.3g} Hz, belongs to no listed mode: it is a load, or"
        " a mode too wide or too near another"
    ),
    "modes_not_found": lambda d: (
        "modes of the turbine file that were not found: "
        f"{', '.join(f'{name} ({f:.4g} Hz)' for name, f in sorted(d['modes'].items(), key=lambda pair: pair[1]))}"
    ),
    "nonstationary": (
        "the power of {channel} is {ratio:.2g} times larger in one half than in the other at {low:.3g} …"
        " {high:.3g} Hz: not"
        " stationary; choose a steadier section"
    ),
    "stationarity_untestable": (
        "no frequency range is free of rotor harmonics in both halves: stationarity cannot be tested; choose a section"
        " of steadier rotor speed"
    ),
    "too_short_for_stationarity": "the record is too short for a test of stationarity: choose a longer one",
    "one_block": "one block only: stationarity cannot be tested; choose a longer record",
    "halves_disagree_in_bands": (
        "the halves of the record differ in {quantity} ({change:+.2g %}, probability {chance:.0f %}): structure changed"
    ),
    "class_disagrees_in_bands": lambda d: (
        f"{' and '.join(d['modes'])} alone gives a stiffness of the blades that differs by {100 * d['change']:+.2g} %:"
        " the turbine file has this mode at another frequency; check its masses and roll"
    ),
    "narrower_bands_disagree": (
        "narrower frequency ranges do not agree on {quantity} ({change:+.2g %}): the model does not fit there"
    ),
    "segments_without_spectrum": "the model has no spectrum like that of some segments: choose another section",
    "faint_peak": lambda d: (
        f"no distinct peak of {' and '.join(d['modes'])} near {_hz(d['frequencies'])}: choose a longer record, or a"
        " narrower prior"
    ),
    "ambiguous_peak": lambda d: (
        f"{' and '.join(d['modes'])} may be the peak at {_hz(d['frequencies'])} or that at {_hz(d['others'])}: give a"
        " narrower prior ([prior] in the turbine file)"
    ),
    "varying_rotor_speed": (
        "the rotor's speed varies by ±{variation:.2g %} (standard deviation), and spectra assume a constant speed"
    ),
    "lag_angle": lambda d: f"the blades' mean lag angle is {1e3 * d['angle']:.1f} ± {2e3 * d['std']:.1f} mrad",
    "ranges_read": lambda d: (
        f"fitted at {', '.join(f'{low:.3g} … {high:.3g} Hz' for low, high in d['ranges'])}; rotor harmonics removed"
    ),
    "bands_read": _in_bands,
    "blocks_read": lambda d: (
        f"read in {d['blocks']:g} block{'s' * (d['blocks'] != 1)} of {d['duration']:.4g} s, at {d['low']:.3g} …"
        f" {d['high']:.3g} Hz"
    ),
}  # fmt: skip
"""For each code its sentence: one part, or a statement and its likely cause with what to do."""
