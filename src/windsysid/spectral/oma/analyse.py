"""Operational modal analysis: the modes of any structure from its ambient vibration, without a model.

Spectral peaks of the readings give frequency bands; in each band, with one or a few modes, the modes are the most
probable ones under unmeasured random loads (`modal_bands.model`), as many as the evidence supports
(`modal_bands.model_order`), with intervals by Laplace's approximation. Bands are then placed anew around the modes
(`search`), and each mode is checked (`modal_bands.check`). Several records of one structure have common modes
(`multi_setup`).
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from windsysid.errors import ConfigurationError
from windsysid.inspection.bodies import name_a_turbine
from windsysid.inspection.rotor import rotor_of
from windsysid.kernels.threads import one_thread
from windsysid.mechanics.sensors import Sensor
from windsysid.modal.marks import ModeMarks
from windsysid.modal.matching.match import with_references
from windsysid.output.progress import Progress, unheard
from windsysid.records.coercion import MappingLike, RecordLike, as_records
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.spectral.modal_bands.images import with_bound_motions
from windsysid.spectral.modal_bands.limits import COMB_ODDS
from windsysid.spectral.modal_bands.load_peaks import with_comb_odds, with_harmonic_odds, with_load_odds
from windsysid.spectral.modal_bands.part_scores import SEGMENTS
from windsysid.spectral.oma.assemble import RecordAnalysis, result_of
from windsysid.spectral.oma.clock_lag import aligned, clock_lags, lag_doubt
from windsysid.spectral.oma.condition import Readings, prepare_readings, transforms
from windsysid.spectral.oma.describe import described, named, without_skirts
from windsysid.spectral.oma.mode import Doubt, OperationalMode
from windsysid.spectral.oma.multi_setup import join
from windsysid.spectral.oma.result import OperationalModes
from windsysid.spectral.oma.search import covered_note, modes_of, search_modes, with_added
from windsysid.spectral.oma.sensors import ModalSensor, geometry_of
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["Sensors", "analyse_vibration", "sensors_of_each"]

Sensors = Sequence[Sensor | ModalSensor | str]


@one_thread()
def analyse_vibration(
    record: "RecordLike | Sequence[RecordLike]",
    *,
    sensors: "Sensors | Sequence[Sensors] | None" = None,
    turbine: "TurbineLike | None" = None,
    bands: "Sequence[tuple[float, float]] | ModeMarks | None" = None,
    limits: tuple[float, float] | None = None,
    section: tuple[float, float] | None = None,
    mapping: "MappingLike | None" = None,
    progress: Progress = unheard,
) -> OperationalModes:
    """Identify the modes of a structure from its ambient vibration (operational modal analysis).

    The analysis is Bayesian, in the frequency domain. Peaks of the singular values of the spectral matrix give
    frequency bands. In each band the most probable modes under unmeasured random loads are found, as many as the
    evidence supports.

    Parameters
    ----------
    record : Record, str, Path, pandas.DataFrame or xarray.Dataset, or a sequence of these
        Acceleration, velocity, displacement, strain or load (T,), uniformly sampled; NaN is a missing sample. If a
        rotor turns, the sensors on blades are transformed into multi-blade coordinates by ``rotor_azimuth`` [rad].
        Several records must be of one structure in one state, with the same sensors, or with some in common while
        others moved (multi-setup).
    sensors : sequence of Sensor, ModalSensor or str, or a sequence of these, optional
        Sensors or names of channels, or a list of them for each record; by default those of the turbine, or else the
        record's accelerometers. Sensors of several records with a position and a direction are the same if these are;
        others if their channels are.
    turbine : Turbine, str or Path, optional
        Gives the sensors, and names to modes near those of the turbine file.
    bands : sequence of (float, float), or ModeMarks, optional
        Lowest and highest frequency [Hz] of each group of close modes; by default found from the spectra. Or modes that
        were added and removed by hand (`windsysid.results.read_mode_marks`): all others are found from the spectra.
    limits : (float, float), optional
        Frequency range of the search for bands [Hz]; by default from the lowest frequency on, up to a largest number of
        bands. A note names the end of the search if there are more.
    section : (float, float), optional
        Start and end of the part to use [s]; the whole record by default.
    mapping : str, Path or Mapping, optional
        Mapping file with the names, units and signs of channels, where `record` is a path (`read_record`).
    progress : callable, optional
        Called as ``progress(step, share)`` with the present step, a str, and the share that is done, 0 to 1, or None
        if that is unknown.

    Returns
    -------
    OperationalModes
        ``modes``: frequencies [Hz], damping ratios [1] and complex shapes (n,) at the n channels, with their 95 %
        intervals and grades; ``singular_values`` (F, k) of the spectral matrix at ``frequency`` (F,) [Hz].

    Raises
    ------
    RecordError
        If a record cannot be read or is too short.
    ConfigurationError
        If there is no record, a channel cannot be used, or records have no sensor in common.

    See Also
    --------
    free_decay : Modes from the decay after a release, without load.
    identify : Stiffness and damping of a turbine.
    modes : Modes of a turbine file over rotor speed (Campbell diagram).

    Notes
    -----
    Damping needs a long record: at least 100 cycles of the mode, better 1000. There is no model order to choose, as in
    stochastic subspace identification (SSI): the evidence selects the number of modes of a band, and `save` draws a
    stabilisation diagram for comparison.

    References
    ----------
    - Au, Operational Modal Analysis, Springer 2017.
    - Brincker & Ventura, Introduction to Operational Modal Analysis, Wiley 2015.

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("nrel5mw", duration=600.0, rate=5.0, seed=1)
    >>> found = ws.oma(record)
    >>> for mode in found.modes:
    ...     f, zeta = mode.frequency, mode.damping_ratio
    ...     print(f"{mode.name}: {f.estimate:.3f} Hz ({f.grade}), damping {100 * zeta.estimate:.1f} % ({zeta.grade})")
    tower x: 0.315 Hz (C), damping 0.2 % (C)
    lag backward: 0.893 Hz (A), damping 0.9 % (A)
    lag collective: 1.112 Hz (A), damping 0.3 % (A)
    lag forward: 1.306 Hz (A), damping 0.4 % (A)
    """
    begun = time.process_time()
    records = as_records(record, mapping)
    machine = None if turbine is None else as_turbine(turbine)
    request = _AnalysisOptions(machine, bands, limits, section, progress)
    lists = sensors_of_each(sensors, len(records))
    singles = [_analysed(each, listed, request) for each, listed in zip(records, lists, strict=True)]
    progress("the result", None)
    found = result_of(singles[0]) if len(singles) == 1 else join(singles)
    nodes, drawn = geometry_of(sensors)
    found = replace(found, nodes=nodes, lines_drawn=drawn)
    modes = with_references(named(found.modes, found.channels), found.channels, machine, found.rotor_hz)
    ranges = request.given or [(r.low, r.high) for r in (single.found.spectrum.readings for single in singles)]
    findings = {one.channels: one for one in (*found.findings, *_not_found(modes, ranges))}
    found = replace(found, findings=tuple(findings.values()))
    if found.doubts:
        of_record = Doubt("record", f"the record is doubtful: {found.doubts[0]}")
        modes = [replace(mode, grounds=(*mode.grounds, of_record)) for mode in modes]
    return replace(found, modes=tuple(modes), elapsed=time.process_time() - begun)


def _not_found(modes: Sequence[OperationalMode], ranges: Sequence[tuple[float, float]]) -> list[Finding]:
    """Remark on modes of the turbine file in the searched ranges [Hz] that none of the modes is."""
    taken = {mode.candidates[0].name for mode in modes if mode.candidates}
    rest = {one.name: one.frequency or 0.0 for mode in modes[:1] for one in mode.candidates if one.name not in taken}
    missing = {name: f for name, f in rest.items() if any(low < f < high for low, high in ranges)}
    return [Finding("modes_not_found", "remark", {"modes": missing})] * bool(missing)


class _AnalysisOptions(NamedTuple):
    """Options of `analyse_vibration` for each record."""

    turbine: Turbine | None
    bands: "Sequence[tuple[float, float]] | ModeMarks | None"
    limits: tuple[float, float] | None
    section: tuple[float, float] | None
    progress: Progress

    @property
    def marks(self) -> ModeMarks:
        """Modes that were added and removed by hand."""
        return self.bands if isinstance(self.bands, ModeMarks) else ModeMarks()

    @property
    def given(self) -> Sequence[tuple[float, float]] | None:
        """Bands in place of those of the spectra."""
        return None if isinstance(self.bands, ModeMarks) else self.bands


def sensors_of_each(sensors: "Sensors | Sequence[Sensors] | None", count: int) -> "list[Sensors | None]":
    """Sensor list of each record."""
    if sensors is None or not any(isinstance(one, list | tuple) for one in sensors):
        return [sensors] * count  # type: ignore[list-item]
    lists = [list(one) for one in sensors if isinstance(one, list | tuple)]
    if len(lists) != len(sensors) or len(lists) != count:
        raise ConfigurationError(
            f"sensors: expected one list for all records, or {count}, one for each, got {len(sensors)}"
        )
    return [*lists]


def _analysed(record: Record, sensors: "Sensors | None", request: _AnalysisOptions) -> RecordAnalysis:
    """Analyse one record; align channels with an unambiguous clock lag, and search again."""
    used = record.section(*request.section) if request.section is not None else record
    request.progress("lines and multi-blade coordinates", None)
    readings = prepare_readings(used, _sensors_in(used, request.turbine) if sensors is None else sensors)
    single = _searched(record, readings, request)
    lags = clock_lags(single.modes, readings)
    if clear := [lag for lag in lags if not lag.others]:
        request.progress("alignment of channels", None)
        single = _searched(record, aligned(readings, clear), request)
    doubts = [lag_doubt(single.readings.names[lag.channel], lag) for lag in lags if lag.others]
    return single._replace(readings=single.readings._replace(doubts=(*single.readings.doubts, *doubts)))


def _sensors_in(record: Record, turbine: Turbine | None) -> "Sensors | None":
    """Sensors of the turbine that the record has; None if there are none."""
    return [sensor for sensor in turbine.sensors if sensor.channel in record] or None if turbine is not None else None


def _searched(record: Record, readings: Readings, request: _AnalysisOptions) -> RecordAnalysis:
    """Search the modes in readings of a record, and check them."""
    marks = request.marks
    found = search_modes(readings, request.given, request.limits, request.progress)
    found = with_added(found, marks.add, request.progress)
    noted = readings
    if found.reached is not None:
        further = (
            f"modes were searched up to {found.reached:.4g} Hz: there are peaks above it; give a"
            " frequency range for them"
        )
        noted = noted._replace(high=found.reached, notes=(*noted.notes, further))
    noted = noted._replace(notes=(*noted.notes, *map(covered_note, found.covered)))
    request.progress("checks", None)
    segments = [[transforms(readings, part) for part in _parts(readings.samples, count)] for count in SEGMENTS]
    bands = without_skirts([described(one, segments, noted) for one in found.bands if modes_of(one)])
    modes, noted = _without_removed([mode for band in bands for mode in band], marks, noted)
    checked = with_load_odds(with_bound_motions(modes, found.spectrum.frequency, found.spectrum.values))
    checked = _with_rotor_odds(checked, readings.used, request)
    return RecordAnalysis(record, noted, found, tuple(checked))


def _with_rotor_odds(modes: list[OperationalMode], used: Record, request: _AnalysisOptions) -> list[OperationalMode]:
    """Modes with the odds of harmonics of a rotor, of which the speed may be recorded or not."""
    rotor = rotor_of(used)
    if rotor is not None:
        speed = abs(rotor.mean) / (2.0 * math.pi)
        return with_harmonic_odds(modes, speed, rotor.variation) if rotor.turns else modes
    of_turbine = request.turbine is not None or name_a_turbine(used.channels)
    return with_comb_odds(modes, COMB_ODDS[0 if of_turbine else 1])


def _without_removed(
    modes: list[OperationalMode], marks: ModeMarks, readings: Readings
) -> tuple[list[OperationalMode], Readings]:
    """Modes by rising frequency without those that were removed by hand, and readings with a note on each mark."""
    for low, high in marks.add:  # a mode of another band is there twice
        modes = [
            m for m in modes if not low <= m.frequency.estimate <= high or (low <= m.band[0] and m.band[1] <= high)
        ]
    modes, notes = sorted(modes, key=lambda mode: mode.frequency.estimate), list(readings.notes)
    notes += [f"modes were fitted between {low:.4g} and {high:.4g} Hz, as marked by hand" for low, high in marks.add]
    kept, removed = marks.kept([(mode.frequency.estimate, mode.half_width) for mode in modes])
    return [modes[i] for i in kept], readings._replace(notes=(*notes, *removed))


def _parts(samples: int, count: int) -> list[slice]:
    """Divide a record into equal parts."""
    length = samples // count
    return [slice(i * length, (i + 1) * length) for i in range(count)]
