"""Look at a record before anything is identified from it: faults, spectra, and the part worth using.

`inspect_record` is the one function; it reads nothing and writes nothing, so a notebook, the command line and a test
use it alike. Its parts: `faults` (of the clock, of channels and of the order of rows), `plausibility` (units and
contradictions), `screening` (all of them, for identifications too), `spectra` (what vibrates), `sections` (which part
to use), `stops` (of the rotor), `figures` and `report`.
"""

from typing import TYPE_CHECKING

import numpy as np

from windsysid.checks.limits import HARMONIC_HALF_WIDTH_SHARE
from windsysid.errors import ConfigurationError
from windsysid.inspection.channels import Kind, most_telling
from windsysid.inspection.fault import Fault, Severity
from windsysid.inspection.inspection import Inspection
from windsysid.inspection.limits import MIN_MODAL_SAMPLES, MIN_SAMPLES
from windsysid.inspection.rotor import Rotor
from windsysid.inspection.screening import examine
from windsysid.inspection.sections import Proposal, propose, propose_longest
from windsysid.inspection.spectra import Spectrogram, Spectrum, cleaned, expected_modes, spectra, spectrogram
from windsysid.inspection.stops import Stop, find_stops
from windsysid.kernels.threads import one_thread
from windsysid.records.coercion import MappingLike, RecordLike, as_record
from windsysid.records.formats.contents.source import reading_notes
from windsysid.records.record import Record
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.units import RPM

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine

__all__ = ["Fault", "Inspection", "Proposal", "Stop", "inspect_record"]


@one_thread()
def inspect_record(
    record: RecordLike,
    turbine: "TurbineLike | None" = None,
    section_length: float | None = None,
    *,
    mapping: "MappingLike | None" = None,
) -> Inspection:
    """Inspect a record: faults, vibration spectra, and the sections worth using.

    Parameters
    ----------
    record : Record, str, Path, pandas.DataFrame or xarray.Dataset
        Any record: channels (T,); NaN is a missing sample.
    turbine : Turbine, str or Path, optional
        Turbine whose modes and usual sensors are expected; without it only the rotor's harmonics are marked.
    section_length : float, optional
        Length of the sections to propose [s]; a shorter record is assessed as a whole. By default the whole record is
        proposed if it is about as good as its best 100 s, otherwise the longest sections that are.
    mapping : str, Path or Mapping, optional
        Mapping file with the names, units and signs of channels, where `record` is a path (`read_record`).

    Returns
    -------
    Inspection
        Faults, the worst first; spectra with their peaks [Hz]; proposed sections [s].

    Raises
    ------
    RecordError
        If `record` is a file that cannot be read, or a table whose columns have no unit.
    ConfigurationError
        If `section_length` is not a positive time, or `turbine` or `mapping` is wrong.

    See Also
    --------
    read_record : Read a record from a file.
    identify : Identification from a record.

    Notes
    -----
    A fault is ``unusable`` (leave the channel or the samples out), a ``warning`` (correct it) or a ``note``.

    References
    ----------
    Welch, IEEE Trans. Audio and Electroacoustics 15(2), 1967, doi:10.1109/TAU.1967.1161901 (spectra).

    Examples
    --------
    >>> import windsysid as ws
    >>> found = ws.inspect(ws.simulate("tower", duration=120.0, rate=10.0), "tower")
    >>> for spectrum in found.spectra:
    ...     print(spectrum.channel, [(round(one.frequency, 2), one.matches) for one in spectrum.peaks])
    tower_x_acceleration [(0.31, ('tower side-side', 'tower fore-aft'))]
    tower_z_acceleration [(0.32, ('tower side-side', 'tower fore-aft', '2P')), (0.59, ('3P',)), (4.91, ())]
    >>> [(one.start, round(one.end)) for one in found.proposals]
    [(0.0, 120)]
    """
    record, turbine = as_record(record, mapping), None if turbine is None else as_turbine(turbine)
    if section_length is not None and not 0.0 < section_length < np.inf:
        raise ConfigurationError(f"section_length: expected a positive time in seconds, got {section_length:g}")
    findings, usable, rotor = examine(record, turbine)
    findings = [*_too_short(record), *findings]
    first = () if turbine is None else tuple(s.channel for s in turbine.sensors if s.channel in record)

    notes = reading_notes(record.attributes)
    blades = turbine.model.blades if turbine is not None else _blades(record, notes)
    modes, over_speed = _modes(turbine, rotor, notes)
    assumed = _nominal_rotor(record, turbine, rotor)
    notes += _rotor_notes(rotor, assumed)
    chosen = _spectral_channels(record, usable, first, notes)
    found, pictures = _frequencies(record, chosen, findings, assumed, modes, blades, notes)
    return Inspection(
        record=record,
        turbine=None if turbine is None else turbine.name,
        findings=tuple(findings),
        rotor=rotor,
        blades=blades,
        modes=modes,
        modes_over_speed=over_speed,
        spectra=found,
        spectrograms=pictures,
        proposals=_proposals(record, usable, rotor, findings, section_length),
        stops=find_stops(record, rotor, usable),
        notes=tuple(notes),
        first=first,
    )


def _nominal_rotor(record: Record, turbine: "Turbine | None", rotor: Rotor | None) -> Rotor | None:
    """The rotor as recorded, or else one that turns at the speed of the turbine file."""
    if rotor is not None or turbine is None or turbine.rotor_speed <= 0.0:
        return rotor
    return Rotor(np.full(record.samples, turbine.rotor_speed), "turbine file")


def _rotor_notes(rotor: Rotor | None, nominal: Rotor | None) -> list[str]:
    """Note on the source of rotor harmonics, or that there are none."""
    if rotor is None and nominal is not None:
        return [
            f"No usable rotor speed or azimuth in the record: harmonics are those of the turbine file's"
            f" {nominal.mean * RPM:.3g} rpm."
        ]
    if rotor is None:
        return [
            "No usable rotor speed or azimuth in the record: harmonics of the rotor cannot be marked, nor its"
            " steadiness judged."
        ]
    return [] if rotor.turns else ["The rotor stands still: there are no harmonics."]


def _spectral_channels(record: Record, usable: dict[str, Kind], first: tuple[str, ...], notes: list[str]) -> list[str]:
    """Usable channels of vibration, or else of power and rotor speed that vary."""
    vibrating = [name for name in most_telling(record, first) if name in usable]
    if vibrating:
        return vibrating
    operating = [name for name, kind in usable.items() if kind in ("power", "rotor speed")]
    chosen = [name for name in operating if np.nanstd(record[name]) > 0.0]
    instead = f": spectra of {' and '.join(chosen)} instead." if chosen else ", so no spectra."
    notes.append("No channel measures vibration" + instead)
    return chosen


def _proposals(
    record: Record, usable: dict[str, Kind], rotor: Rotor | None, findings: list[Fault], length: float | None
) -> tuple[Proposal, ...]:
    """Sections of a length, or the longest ones that are as good as short ones; none of a record that is too short."""
    if record.samples < MIN_SAMPLES:
        return ()
    if length is None:
        return propose_longest(record, usable, rotor, findings)
    return propose(record, usable, rotor, findings, length)


def _too_short(record: Record) -> list[Fault]:
    """Find a record with too few samples for identification or for operational modal analysis."""
    if record.samples >= MIN_MODAL_SAMPLES:
        return []
    severity: Severity = "unusable" if record.samples < MIN_SAMPLES else "note"
    data = {"identify": MIN_SAMPLES, "oma": MIN_MODAL_SAMPLES}
    return [Fault("", "too short", severity, record.samples, data=data)]


def _blades(record: Record, notes: list[str]) -> int:
    numbers = [int(c.split("_")[1]) for c in record.channels if c.startswith("blade_") and c.split("_")[1].isdecimal()]
    if numbers:
        return max(numbers)
    notes.append("The number of blades is not known: three are assumed.")
    return 3


def _modes(
    turbine: "Turbine | None", rotor: Rotor | None, notes: list[str]
) -> tuple[tuple[tuple[str, float, float], ...], tuple[tuple[float, tuple[tuple[str, float, float], ...]], ...]]:
    if turbine is None:
        return (), ()
    speed = rotor.mean if rotor is not None else turbine.rotor_speed
    if rotor is None:
        notes.append(f"Modes are those at the usual rotor speed of {turbine.name}, {speed * RPM:.4g} rpm.")
    found = tuple(expected_modes(turbine, speed))
    if not found:
        notes.append(f"{turbine.name}: a rotor with fewer than three free blades has no modes in the fixed frame.")
    if rotor is None or rotor.variation < HARMONIC_HALF_WIDTH_SHARE:
        return found, ()
    low, high = np.percentile(rotor.speed, (0.5, 99.5))
    speeds = np.linspace(float(low), float(high), 9)
    return found, tuple((float(s), tuple(expected_modes(turbine, float(s)))) for s in speeds)


def _frequencies(
    record: Record, chosen: list[str], findings: list[Fault], rotor: Rotor | None,
    modes: tuple[tuple[str, float, float], ...], blades: int, notes: list[str],
) -> tuple[tuple[Spectrum, ...], tuple[Spectrogram, ...]]:  # fmt: skip
    """Spectra of all chosen channels, spectrograms of the first on the support and the first on a blade."""
    if not chosen:
        return (), ()
    time, values, rate, remark = cleaned(record, chosen, findings)
    found = spectra(values, rate, chosen, {name: record.unit(name) for name in chosen}, rotor, modes, blades)
    notes += [remark] if remark else []
    notes += [] if found else [f"{record.samples} samples are too few for a spectrum."]
    on_grid = None if rotor is None else Rotor(np.interp(time, record.time, rotor.speed), rotor.source)
    on_blade = [name for name in chosen[1:] if name.startswith("blade")]
    pictures = (
        spectrogram(time, values[:, chosen.index(name)], rate, name, record.unit(name), on_grid)
        for name in (chosen[0], *on_blade[:1])
    )
    return found, tuple(filter(None, pictures))
