"""Sentences about loads, locked coordinates, and the choice of a formulation."""

from collections.abc import Mapping
from typing import Final

from windsysid.results.sentences.template import LIKELY_MACHINE, Data, Sentence, fill
from windsysid.units import engineering, engineering_unit

__all__ = ["LOADS_WITHHELD", "MODEL"]

LOADS_WITHHELD = (
    "Stationary loads supply what damping dissipates, E[f v] = c E[v²]: a balance without them biases damping and "
    "stiffness. Use the joint formulation."
)
"""Note on a force balance without its loads."""
_TOTAL = "damping is total: structure and aerodynamics"
_WHY_CHOSEN = {
    "explains": "it explains the record", "as before": "as before",
    "loads hardly matter": "loads have little influence in this record",
}  # fmt: skip
_WHY_STATE = {
    "given": "as given", "pitch": "blades are feathered", "speed": "rotor speed {share:.3g %} of the usual one",
    "unknown": "no rotor speed is recorded; if the turbine is parked, give that as its state",
}  # fmt: skip
_MAY_DECIDE = ": another section may decide"


def _load_model_chosen(d: Data) -> str:
    name, reason = f"load model {d['model']}", d["reason"]
    if reason != "evidence":
        return name + (f": {_WHY_CHOSEN[reason]}" if reason in _WHY_CHOSEN else "")
    others = ", ".join(f"{other} by {odds:.0f}" for other, odds in d["rivals"].items())
    rest = "" if d["explained"] else ", though it does not explain all of it"
    return f"{name}: its log evidence beats {others} on the first {d['duration']:.3g} s{rest}"


def _loads_of_spectra(d: Data) -> str:
    others = ", ".join(f"{other} by {odds:.0f}" for other, odds in d["rivals"].items())
    part = ", of a fifth of the record" if d["part"] else ""
    why = f" (log evidence over {others}{part})" if others else ""
    return f"loads: {d['loads']}, learned from the record with the noise{why}; {_TOTAL}"


def _sinusoidal_force(d: Data) -> str:
    at = f"{d['order']}P" if d["order"] else f"{d['frequency']:.4g} Hz"
    factor, unit = engineering_unit(d["unit"], d["amplitude"])
    return f"{d['load']} has a sinusoid of {d['amplitude'] / factor:.2g} ± {2.0 * d['std'] / factor:.1g} {unit} at {at}"


def _cause_of_force(d: Data) -> str:
    cause = {0: "a machine", 1: "an imbalance of the rotor"}.get(d["order"], "a load that turns with the rotor")
    return f": likely {cause}; the estimates take it into account"


MODEL: Final[Mapping[str, Sentence]] = {
    "operating_state": lambda d: fill(
        f"the turbine is {{state}} ({_WHY_STATE[d['why']]}); the prior of damping is that of this state", d
    ),
    "loads_known": f"all loads are known, the noise learned from the record; {_TOTAL}",
    "loads_are_states": (
        "loads are states ({loads}), their statistics and the noise learned from the record; " + _TOTAL
    ),
    "loads_of_spectra": _loads_of_spectra,
    "loads_in_bands": (
        "loads: in each frequency range peaks at harmonics of the rotor and a level, learned with the noise"
    ),
    "damping_is_total": _TOTAL,
    "load_model_chosen": _load_model_chosen,
    "load_model_caution": "{text}",
    "loads_withheld": "loads withheld: {loads}. " + LOADS_WITHHELD,
    "loads_missing": "the force balance omits loads that act, which biases damping",
    "low_pass_unknown_to_loads": (
        "the record was low-pass filtered at {low_pass:.3g} Hz, which the model of {loads} omits: damping may be too "
        "low"
    ),
    "narrow_band_load": (
        lambda d: (
            f"a narrow-band load of {' '.join(engineering(d['unit'], d['rms']))} rms acts on {d['load']} at"
            f" {d['frequency']:.4g} Hz ({100.0 * d['width']:.2g} % damped)"
        ),
        ": likely a machine or waves; the estimates take it into account",
    ),
    "narrow_band_load_preferred": (
        "a narrow-band load at {frequency:.3g} Hz explains the spectra better (log odds {gain:.0f})",
        ": likely loads of a machine; try the load model narrow-band",
    ),
    "narrow_band_load_ambiguous": (
        "the narrow-band load at {frequency:.3g} Hz has another explanation (probability {chance:.3g %}); {quantity}"
        " would change by {sigmas:.1f} σ",
        _MAY_DECIDE,
    ),
    "narrow_band_load_possible": (
        "a narrow-band load at {frequency:.3g} Hz is possible (probability {chance:.3g %}); {quantity} would change by"
        " {sigmas:.1f} σ",
        _MAY_DECIDE,
    ),
    "tone_removed": ("a sinusoid at {frequency:.4g} Hz was removed from the readings", ": likely a machine"),
    "tone_left": ("a sinusoid at {frequency:.4g} Hz remains", LIKELY_MACHINE),
    "rotor_harmonic_left": (
        "the rotor harmonic {order}P remains",
        ": likely loads that turn with the rotor; try another section",
    ),
    "sinusoidal_force": (_sinusoidal_force, _cause_of_force),
    "rotor_harmonic": (
        "the rotor harmonic {order}P is taken into account: an imbalance of the rotor, or masses off within their"
        " tolerances"
    ),
    "effect_not_tested": "a {effect} could not be tested for ({error})",
    "effect_not_included": "a {effect} matters, but the model cannot include it ({error}): choose another section",
    "spectral_as_filters_fail": "spectral formulation, which filters cannot check ({error}): choose another section",
    "joint_as_spectra_do_not_apply": "joint formulation, as spectra do not apply ({error})",
    "joint_as_spectra_are_doubtful": "joint formulation, as spectra are in doubt ({because})",
    "joint_as_loads_are_broad": (
        "joint formulation: broad loads explain the record, and spectra around the modes assume wind"
    ),
    "joint_with_spectra": "joint formulation; spectra were computed, too",
    "joint_agrees": "joint formulation; spectra agree within {sigmas:.1f} standard deviations",
    "spectral_under_wind": "spectral formulation: wind drives a turning rotor",
    "spectral_as_clock_drifts": (
        "spectral formulation: a clock drifts, and filters are sensitive to interpolation between samples"
    ),
    "spectral_with_filters": (
        "spectral formulation: the record is stationary, and no degree of freedom rotates; filters were computed, too"
    ),
    "spectral_agrees": (
        "spectral formulation: the record is stationary, and no degree of freedom rotates; filters agree within"
        " {sigmas:.1f} standard deviations"
    ),
    "formulations_disagree": lambda d: (
        f"filters and spectra disagree on {d['quantity']} by {d['sigmas']:.1f} standard deviations:"
        f" {'blades move that no channel measures: record them' if d['unseen_blades'] else 'loads are not as modelled'}"
    ),
    "bands_suppose_wind": (
        "broad loads explain the record, and spectra around the modes assume wind: use the joint formulation"
    ),
    "coefficient_not_positive": "{quantity} is not positive",
    "particle_weights": "{text}",
}  # fmt: skip
"""For each code its sentence: one part, or a statement and its likely cause with what to do."""
