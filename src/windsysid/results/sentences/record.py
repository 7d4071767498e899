"""Sentences about the record: its faults, its preprocessing, and its stationarity."""

from collections.abc import Mapping
from typing import Final

from windsysid.results.sentences.template import Data, Sentence, Template

__all__ = ["RECORD"]

FAULTS = (
    "azimuth_jumps", "azimuth_scatter", "clipping", "coarse_steps", "constant", "contradiction", "copied_passage",
    "copy", "frozen", "gaps", "irregular_sampling", "lost_rows", "lost_samples", "missing", "overrun", "pace",
    "repeated_rows", "sampling_rate", "short_gaps", "silent", "spikes", "unit",
)  # fmt: skip
"""Kinds of faults of a record (`windsysid.inspection`), as codes; their texts come with the data."""


def _locked(d: Data) -> str:
    if d["coordinate"] == "lag":
        return "no blade channels: the blades are locked, and only the support's coefficients are identified"
    return f"no channel measures {d['coordinate'].replace('_', '-')}: it is locked"


def _resampled(d: Data) -> str:
    said = f"resampled from {d['recorded']:.4g} to {d['rate']:.3g} Hz"
    if d["lost_mode"] is not None:
        said += (
            f", which removes the mode near {d['lost_mode']:.3g} Hz from the record but not from the model: do not "
            "use the results of this mode"
        )
    return said + (f", {_steps(d)}" if d["steps"] > 1 else "")


def _steps(d: Data) -> str:
    return f"{d['steps']} steps of the equations for each reading"


def _offsets(d: Data) -> str:
    off = ", ".join(f"{name} by {value:.2g} {d['units'][name]}" for name, value in d["offsets"].items())
    return f"offsets of readings are estimated, too: {off}"


def _drifts(d: Data) -> str:
    drifts = ", ".join(f"{name} by {value:.2g} {d['units'][name]} per second" for name, value in d["drifts"].items())
    drifting = f", and drifts are estimated too: {drifts}" if drifts else ""
    return f"random-walk bias: slow variations of {', '.join(d['channels'])} are removed{drifting}"


def _clock_drift(d: Data) -> str:
    ppm, std, pace = 1e6 * abs(d["rate"]), 1e6 * d["std"], "slowly" if d["rate"] < 0.0 else "fast"
    by = f"the clock of the logger {d['logger']} runs {ppm:.3g} ± {std:.2g} ppm too {pace}, by {d['by']}"
    return f"{by}: its readings were aligned"


def _regressor(what: str) -> Template:
    """The sentence of a waveform: its size with an interval of two standard deviations, and which estimate it
    shifts."""

    def of(d: Data) -> str:
        size = what.format_map({**d, "wide": 2.0 * d.get("std", 0.0)})
        if not d["quantities"]:
            return f"{size}: estimates hardly change with it"
        return f"{size}: without it {d['quantities'][0]} would change by {d['sigmas']:.1f} σ"

    return of


def _pieces(d: Data) -> str:
    kept = "" if d["kept"] is None else f": prediction errors, states and loads of the last {d['kept']:.0f} s are kept"
    return f"processed in segments{kept}"


def _blocks(d: Data) -> str:
    size = f"{d['turns']} turns" if d["turns"] else f"{d['duration']:.4g} s"
    faded = f", which count as {d['weight']:.3g}: the older, the less they count" if d["weight"] is not None else ""
    return f"processed in segments: {d['blocks']} blocks of {size}{faded}"


def _azimuth_and_speed(d: Data) -> str:
    how = "faster" if d["ratio"] > 1.0 else "slower"
    return (
        f"rotor_azimuth turns {100.0 * abs(d['ratio'] - 1.0):.2g} % {how} than rotor_speed: if time is wrong,"
        " the error of stiffness is twice that; check the sampling rate and both channels"
    )


def _fault(code: str) -> Template:
    """The text of a fault after its channels, or of the first of several pieces of a record that have it."""

    def filled(d: Data) -> str:
        many = f"{code.replace('_', ' ')} in {d['pieces']} pieces; the first: " if d["pieces"] > 1 else ""
        return f"{', '.join(d['channels']) or 'record'}: {many}{d['text']}"

    return filled


RECORD: Final[Mapping[str, Sentence]] = {
    "transient": (
        "the rms of {channels[0]} falls {ratio:.2g}-fold (a transient, such as a free decay); checks that assume"
        " stationary loads fail: compare other records"
    ),
    "burst": (
        "{share:.0f %} of the power of {channel} is between {start:.4g} and {end:.4g} s of the record: a blow, a "
        "pull or a start; choose a section without it"
    ),
    "late_burst": (
        "{share:.0f %} of the power of {channel} is between {start:.4g} and {end:.4g} s of the record: a blow, a "
        "pull or a start; choose a section that begins after it"
    ),
    "azimuth_contradicts_speed": _azimuth_and_speed,
    "dead_channel": (
        lambda d: f"no vibration in {d['channels'][0]}"
        + (f" and {len(d['channels']) - 1} more" if len(d["channels"]) > 1 else "")
        + ", only noise",
        ": likely an instrument (no power, a broken cable); check it or leave it out",
    ),
    "blade_passing_on_mode": (
        "the blades pass steadily at {frequency:.3g} Hz ({blades}P), on the mode at {mode:.3g} Hz, and cannot be "
        "distinguished from it: take a section at another speed"
    ),
    "blade_passing_in_mode": (
        "{blades}P at {frequency:.3g} Hz is within the half-width of the mode at {mode:.3g} Hz ({damping:.0f %}"
        " damping) and may be part of it: take a section at another speed"
    ),
    "blade_passing_unresolved": (
        "{blades}P is at {frequency:.3g} Hz and a mode at {mode:.3g} Hz: the record resolves differences of"
        " {resolution:.2g} Hz only; take a longer section"
    ),
    "blade_passing_near_mode": (
        "the blades pass at {frequency:.3g} Hz ({blades}P), near {coordinate} at {mode:.3g} Hz: their load was not"
        " modelled; use the joint formulation"
    ),
    "missing_samples_bridged": "{count} missing samples of {channel} were interpolated",
    **{code: _fault(code) for code in FAULTS},
    "coordinate_locked": _locked,
    "blades_locked_unseen": (
        "no channel measures the blades, so they are locked: the support's stiffness may be off by more than its"
        " interval; add a blade sensor (docs/tower.md)"
    ),
    "resampled": _resampled,
    "steps_of_equations": _steps,
    "sensor_offsets": _offsets,
    "wandering_offsets": _drifts,
    "clock_drift": _clock_drift,
    "bias": _regressor("{channel} has an offset of {size:.2g} ± {wide:.1g} {unit}"),
    "trend": _regressor("{channel} has a trend of {size:.2g} {unit} rms"),
    "step": _regressor("{channel} steps by {size:.2g} ± {wide:.1g} {unit} at {time:.4g} s"),
    "drift_moved_readings": (
        "readings of a drifting clock were interpolated to the samples: filters are sensitive to that; use the "
        "spectral formulation"
    ),
    "outliers": "{count} of {read} samples of {channel} were left out as outliers (beyond {sigmas:g}σ)",
    "balance_filtered": "both sides of the balance filtered to {low:.2f}–{high:.2f} Hz with zero phase",
    "pieces": _pieces,
    "blocks": _blocks,
}  # fmt: skip
"""For each code its sentence: one part, or a statement and its likely cause with what to do."""
