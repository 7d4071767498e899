"""Operational modal analysis: the modes of any structure from its ambient vibration, no model needed.

The spectra of the readings are searched for peaks; in each band around one or a few of them the modes are the most
probable ones under loads that nobody measured (`modal_model`), as many as the evidence asks for (`order`), with their
bands (Laplace). What was found says where the bands should have been, so that they are placed once more
(`mode_search`). Then each mode is doubted (`modal_checks`). Several records of one structure have their modes in common
(`several`).
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from windsysid.errors import ConfigurationError
from windsysid.kernels.threads import one_thread
from windsysid.mechanics.sensors import Sensor
from windsysid.output.progress import Progress, unheard
from windsysid.records.coercion import RecordLike, as_record
from windsysid.records.record import Record
from windsysid.spectral.clock_lag import aligned, clock_lags, lag_doubt
from windsysid.spectral.modal_bands.images import with_images
from windsysid.spectral.oma.assemble import Single, result_of
from windsysid.spectral.oma.condition import Readings, prepare_readings, transforms
from windsysid.spectral.oma.describe import described, named, with_neighbours, with_references, without_flanks
from windsysid.spectral.oma.multi_setup import join
from windsysid.spectral.oma.result import Doubt, OperationalModes
from windsysid.spectral.oma.search import covered_note, modes_of, search_modes
from windsysid.spectral.oma.sensors import ModalSensor
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["analyse_vibration"]

Sensors = Sequence[Sensor | ModalSensor | str]


@one_thread()
def analyse_vibration(
    record: "RecordLike | Sequence[RecordLike]",
    *,
    sensors: "Sensors | Sequence[Sensors] | None" = None,
    turbine: "TurbineLike | None" = None,
    bands: Sequence[tuple[float, float]] | None = None,
    limits: tuple[float, float] | None = None,
    section: tuple[float, float] | None = None,
    progress: Progress = unheard,
) -> OperationalModes:
    """Find the modes of a structure from its ambient vibration.

    Parameters
    ----------
    record
        Any record: readings of acceleration, velocity, displacement, strain or load. Where a rotor turns, with
        rotor_azimuth, blades' readings go into multi-blade coordinates. A list of records is one structure in one
        state: with the same sensors, or with some in common while others moved (setups).
    sensors
        Sensors or names of channels, or such a list for each record; by default the turbine's, or else the record's
        accelerometers. Sensors of several records that have a position and a direction are the same where these are;
        others where their channels are.
    turbine
        Its sensors are used, and its modes are named where one is near.
    bands
        (lowest, highest) [Hz], one for each group of modes that are near each other; found from the spectra where none
        are given.
    limits
        Between which frequencies bands are sought [Hz]; by default from the lowest on, up to a number of bands that a
        note tells where there are more.
    section
        Start and end [s].
    progress
        Told what is being done and its share that is done, 0 to 1; None where nobody knows.

    Returns
    -------
    OperationalModes
        Frequencies [Hz], damping ratios and shapes with their bands, and what speaks against them.

    Raises
    ------
    ConfigurationError, RecordError
        If there is nothing to analyse, a channel cannot be used, or records have no sensor in common.
    """
    begun = time.process_time()
    several = isinstance(record, list | tuple)
    records = [
        as_record(each) for each in (cast("list[RecordLike]", record) if several else [cast("RecordLike", record)])
    ]
    if not records:
        raise ConfigurationError("records: expected one at least, got an empty list")
    machine = None if turbine is None else as_turbine(turbine)
    lists = _sensors_of_each(sensors, len(records))
    singles = [
        _analysed(each, listed, machine, bands, limits, section, progress)
        for each, listed in zip(records, lists, strict=True)
    ]
    progress("the result", None)
    found = result_of(singles[0]) if len(singles) == 1 else join(singles)
    modes = with_references(named(found.modes, found.channels), machine, found.rotor_hz)
    if found.doubts:
        of_record = Doubt("record", f"the record is doubtful: {found.doubts[0]}")
        modes = [replace(mode, grounds=(*mode.grounds, of_record)) for mode in modes]
    return replace(found, modes=tuple(modes), elapsed=time.process_time() - begun)


def _sensors_of_each(sensors: "Sensors | Sequence[Sensors] | None", count: int) -> "list[Sensors | None]":
    """The sensor list of each record."""
    if sensors is None or not any(isinstance(one, list | tuple) for one in sensors):
        return [sensors] * count  # type: ignore[list-item]
    lists = [list(one) for one in sensors if isinstance(one, list | tuple)]
    if len(lists) != len(sensors) or len(lists) != count:
        raise ConfigurationError(
            f"sensors: expected one list for all records, or {count}, one for each, got {len(sensors)}"
        )
    return [*lists]


def _analysed(
    whole: Record,
    sensors: "Sensors | None",
    machine: Turbine | None,
    bands: Sequence[tuple[float, float]] | None,
    limits: tuple[float, float] | None,
    section: tuple[float, float] | None,
    progress: Progress,
) -> Single:
    """One record's modes."""
    used = whole.section(*section) if section is not None else whole
    if sensors is None and machine is not None:
        sensors = [sensor for sensor in machine.sensors if sensor.channel in used] or None
    progress("lines and multi-blade coordinates", None)
    readings = prepare_readings(used, sensors)
    single = _searched(whole, readings, bands, limits, progress)
    lags = clock_lags(single.modes, readings)
    sure = [lag for lag in lags if not lag.others]
    if sure:
        progress("alignment of channels", None)
        single = _searched(whole, aligned(readings, sure), bands, limits, progress)
    unsure = [lag_doubt(single.readings.names[lag.channel], lag) for lag in lags if lag.others]
    return single._replace(readings=single.readings._replace(doubts=(*single.readings.doubts, *unsure)))


def _searched(
    whole: Record,
    readings: Readings,
    bands: Sequence[tuple[float, float]] | None,
    limits: tuple[float, float] | None,
    progress: Progress,
) -> Single:
    """Search and check the modes in readings of a record."""
    found = search_modes(readings, bands, limits, progress)
    noted = readings
    if found.reached is not None:
        further = (
            f"modes were sought up to {found.reached:.4g} Hz: peaks go on beyond it, give --range LOW HIGH for them"
        )
        noted = noted._replace(high=found.reached, notes=(*noted.notes, further))
    noted = noted._replace(notes=(*noted.notes, *map(covered_note, found.covered)))
    progress("checks", None)
    parts = [[transforms(readings, part) for part in _parts(readings.samples, count)] for count in (2, 4)]
    parted = without_flanks([described(one, parts, noted) for one in found.bands if modes_of(one)])
    modes = sorted((mode for band in parted for mode in with_neighbours(band)), key=lambda mode: mode.frequency)
    return Single(whole, noted, found, tuple(with_images(modes, found.frequency, found.values)))


def _parts(samples: int, count: int) -> list[slice]:
    """So many equal parts of a record."""
    length = samples // count
    return [slice(i * length, (i + 1) * length) for i in range(count)]
