"""Record: readings of the instruments of one turbine over time, as one labelled table in SI units.

`Record` holds the time t_k (T,) and the values y_k (T, m), one row per sample and one column per channel.
NaN means that a channel is missing at that sample, everywhere in this package. Channels are named
``<point>_<direction>_<quantity>``: ``tower_x_acceleration``, ``blade_1_lag_displacement``, ``rotor_azimuth``.
Readers and writers of files live in `windsysid.records.formats`.
"""

from __future__ import annotations

import difflib
import json
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from windsysid.errors import ConfigurationError, RecordError
from windsysid.output.console import printable
from windsysid.output.pages import pages
from windsysid.records.checks import MAX_OFF_STEPS, Array, check_channels, check_rows, refuse_gaps, refuse_outside
from windsysid.records.labelled import Labelled, of_dataset, of_frame
from windsysid.records.moments import tidy
from windsysid.records.quantities import check_quantity, implied_unit, missing_units
from windsysid.records.stamps import grid_behind, usual_step
from windsysid.units import UNITS, canonical, si_unit, to_si

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["AS_WRITTEN", "LOW_PASS", "RATE_DOUBT", "STAMPS", "Array", "Record"]

AS_WRITTEN = "as written: "
"""Prefix of a unit that windsysid does not know: the values are kept as in the file, not converted."""

LOW_PASS = "low_pass_hz"
"""Attribute of a record that went through a low-pass when its rate was lowered: the frequency [Hz]."""

RATE_DOUBT = "rate_doubt"
"""Attribute of a record whose file may give a wrong rate: the reason."""

STAMPS = "time_stamps"
"""Attribute of a record whose rows share time stamps: how the rows were placed on a regular grid."""

TICKS_PER_STEP = 64
"""Ticks per median step to which the times of an unequally sampled record are rounded: 0.08 ms at 100 Hz, at most."""

_OFF_GRID = 0.1  # of a step: beyond this a time stamp does not belong to a uniform grid


@dataclass(frozen=True, eq=False, repr=False)
class Record:
    """A labelled time series with units.

    Parameters
    ----------
    time : array_like (T,)
        Time [s], finite and strictly increasing, T ≥ 2.
    values : array_like (T, m)
        One column per channel, in the SI unit of `units`; NaN where a channel is missing. Infinity is
        refused.
    channels : tuple of str (m,)
        Names, each once.
    units : tuple of str (m,)
        SI units, one per channel, ``"1"`` for a ratio. A unit that windsysid does not know is spelt
        ``"as written: <unit>"`` and means that nothing was converted.
    name : str
        Name of the record, such as the file name; characters that cannot be printed become ``?``.
    attributes : mapping of str to str
        Free text about the record, kept in netCDF.
    start : str, optional
        The moment of time 0 in ISO 8601, with its zone: ``2021-07-07T12:00:00Z``. Without a zone it is local time of
        which the zone is unknown; None if the moment is not known.

    Raises
    ------
    RecordError
        If shapes disagree, a name occurs twice, a unit is not SI, the time does not increase or a value is
        infinite.

    Notes
    -----
    Arrays are shared, not copied, where their type allows it: do not write into them.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> time = np.arange(0.0, 10.0, 0.1)
    >>> record = ws.Record(time, np.sin(time)[:, None], ("tower_x_acceleration",), ("m/s^2",))
    >>> record.samples, record.unit("tower_x_acceleration")
    (100, 'm/s^2')
    """

    time: Array
    values: Array
    channels: tuple[str, ...]
    units: tuple[str, ...]
    name: str = "record"
    attributes: Mapping[str, str] = field(default_factory=dict)
    start: str | None = None

    def __post_init__(self) -> None:
        try:
            time = np.ascontiguousarray(self.time, dtype=np.float64)
            values = np.ascontiguousarray(self.values, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise RecordError(f"time and values of a record must be numbers: {error}") from error
        channels, units = tuple(self.channels), tuple(self.units)
        if time.ndim != 1 or values.shape != (time.size, len(channels)) or len(units) != len(channels):
            raise RecordError(
                f"expected time (T,), values (T, m), m channels and m units, got time {time.shape}, "
                f"values {values.shape}, {len(channels)} channels and {len(units)} units"
            )
        check_channels(channels)
        check_rows(time, values, channels)
        set_field = object.__setattr__  # the dataclass is frozen
        set_field(self, "time", time)
        set_field(self, "values", values)
        set_field(self, "name", printable(self.name))
        set_field(self, "channels", channels)
        set_field(self, "units", tuple(map(_checked_unit, units, channels)))
        set_field(self, "attributes", {str(key): str(text) for key, text in self.attributes.items()})
        if self.start is not None:
            try:
                set_field(self, "start", tidy(self.start))
            except ValueError as error:
                raise RecordError(f"start: {error}") from error

    @property
    def samples(self) -> int:
        """Number of samples T."""
        return self.time.size

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def rate(self) -> float:
        """Sampling rate [Hz]: the mean of all steps that are nearer to the median step than to a gap."""
        return 1.0 / usual_step(self.time)

    @cached_property
    def is_uniform(self) -> bool:
        """True if every sample lies on one uniform time grid, to a thousandth of a step."""
        step = self.duration / (self.samples - 1)
        grid = self.time[0] + step * np.arange(self.samples)
        return bool(np.max(np.abs(self.time - grid)) <= MAX_OFF_STEPS * step)

    @cached_property
    def has_grid(self) -> bool:
        """Test whether `on_uniform_grid` finds a grid that every sample belongs to."""
        try:
            self.on_uniform_grid()
        except RecordError:
            return False
        return True

    def __contains__(self, channel: object) -> bool:
        return channel in self.channels

    def __getitem__(self, channel: str) -> Array:
        """The values (T,) of one channel, as a copy.

        Raises
        ------
        RecordError
            If the record has no such channel.
        """
        return self.values[:, self._column(channel)].copy()

    def unit(self, channel: str) -> str:
        """The unit of one channel; RecordError if the record has no such channel."""
        return self.units[self._column(channel)]

    def __repr__(self) -> str:
        listed = ", ".join(
            f"{name}\N{NO-BREAK SPACE}[{unit}]" for name, unit in zip(self.channels, self.units, strict=True)
        )
        heading = (
            f"Record '{self.name}': {self.samples} samples at {self.rate:.6g} Hz, {self.duration:.6g} s, "
            f"{len(self.channels)} channels"
        )
        body = textwrap.wrap(listed, 100, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)
        return "\n".join([heading, *body]).replace("\N{NO-BREAK SPACE}", " ")

    def section(self, start: float, end: float) -> Record:
        """The samples with start ≤ t < end, their times kept as they are.

        Parameters
        ----------
        start, end : float
            [s], on the record's own clock; inside the record to within one sampling step.

        Raises
        ------
        RecordError
            If the section is empty, holds a single sample, or reaches outside the record.
        """
        low, high = np.searchsorted(self.time, (start, end), side="left")
        first, last = float(self.time[0]), float(self.time[-1])
        refuse_outside(start, end, int(high - low), first, last, usual_step(self.time))
        return replace(self, time=self.time[low:high], values=self.values[low:high])

    def select(self, channels: Iterable[str]) -> Record:
        """Record with only these channels, in this order; RecordError for one that is missing."""
        columns = [self._column(channel) for channel in channels]
        return replace(
            self,
            values=self.values[:, columns],
            channels=tuple(self.channels[i] for i in columns),
            units=tuple(self.units[i] for i in columns),
        )

    def with_channels(self, channels: Mapping[str, tuple[npt.ArrayLike, str]]) -> Record:
        """A new record with channels replaced, or added at the end.

        Parameters
        ----------
        channels : mapping of str to (array_like (T,), str)
            Name to values and unit; any unit that windsysid knows, the values are converted to SI.

        Raises
        ------
        RecordError
            If an array is not (T,), a unit is unknown or a value is infinite.
        """
        columns = {name: (self.values[:, i], self.units[i]) for i, name in enumerate(self.channels)}
        for name, (values, unit) in channels.items():
            array = np.asarray(values, dtype=np.float64)
            if array.shape != self.time.shape:
                raise RecordError(f"channel '{name}': expected values {self.time.shape}, got {array.shape}")
            columns[name] = convert(array, unit, f"channel '{name}'")
        return replace(
            self,
            values=_table([values for values, _ in columns.values()], self.samples),
            channels=tuple(columns),
            units=tuple(unit for _, unit in columns.values()),
        )

    def with_name(self, name: str) -> Record:
        """Record under another name."""
        return replace(self, name=name)

    def on_uniform_grid(self) -> Record:
        """The record on a uniform time grid at its own rate; rows that were not recorded become NaN.

        The grid starts at the first sample. Nothing is interpolated: each sample keeps its values and moves
        to the grid point it belongs to, at most a tenth of a step away; farther, where time stamps scatter but readings
        show that they were taken on a grid (`windsysid.records.stamps`).

        Raises
        ------
        RecordError
            If a sample is farther than that from the grid, or the gaps dwarf the data.
        """
        if self.is_uniform:
            return self
        step = usual_step(self.time)
        elapsed = self.time - self.time[0]
        index = np.rint(elapsed / step)
        step = float(elapsed @ index / (index @ index))  # least squares through the first sample
        index = np.rint(elapsed / step)
        off = np.abs(elapsed - step * index) / step
        off[1:][np.diff(index) == 0.0] = 0.5  # two samples on one grid point: one of them is half a step off
        begin = float(self.time[0])
        if np.any(off > _OFF_GRID):
            behind = grid_behind(self.time, self._smooth(), step)
            if behind is None:
                k = int(np.argmax(off > _OFF_GRID))
                raise RecordError(
                    f"irregular sampling: sample {k} at {self.time[k]:.9g} s is {100 * off[k]:.0f} % of a step off"
                    f" {1 / step:.6g} Hz, expected at most {100 * _OFF_GRID:.0f} %; resample the record first"
                )
            begin, step, index = behind
        rows = int(index[-1]) + 1
        if rows > 10 * self.samples + 1_000_000:
            refuse_gaps(self.name, self.time, rows)
        values = np.full((rows, len(self.channels)), np.nan)
        values[index.astype(np.int64)] = self.values
        return replace(self, time=np.asarray(begin + step * np.arange(rows), dtype=np.float64), values=values)

    def _smooth(self) -> Array:
        """The values with angles as their cosine and sine, which do not jump (T, ≥ m)."""
        angles = [unit == "rad" for unit in self.units]
        turning = self.values[:, angles]
        return np.hstack([self.values[:, np.logical_not(angles)], np.cos(turning), np.sin(turning)])

    def on_own_times(self) -> Record:
        """The record for filters: on a uniform grid where its times allow that, else each sample at its own time.

        Such times are rounded to a `TICKS_PER_STEP`-th of the median step, so that few intervals occur; rows that then
        fall together are kept as one, with the later values where both have some.
        """
        try:
            return self.on_uniform_grid()
        except RecordError:
            tick = usual_step(self.time) / TICKS_PER_STEP
        index = np.rint((self.time - self.time[0]) / tick).astype(np.int64)
        first = np.concatenate([[True], np.diff(index) > 0])
        row = np.cumsum(first) - 1
        values = np.full((row[-1] + 1, len(self.channels)), np.nan)
        for target, given in zip(row, self.values, strict=True):
            values[target] = np.where(np.isnan(given), values[target], given)
        return replace(self, time=self.time[0] + tick * index[first], values=values)

    def intervals(self) -> tuple[Array, npt.NDArray[np.int64]]:
        """The sampling intervals that occur (S,) [s], and which of them led to each sample (T,); 0 for the first."""
        if self.is_uniform:
            return np.array([1.0 / self.rate]), np.zeros(self.samples, dtype=np.int64)
        grain = 1e-6 * usual_step(self.time)
        steps, which = np.unique(np.rint(np.diff(self.time) / grain).astype(np.int64), return_inverse=True)
        return np.asarray(grain * steps, dtype=np.float64), np.concatenate([[0], which.ravel()]).astype(np.int64)

    @property
    def marks(self) -> dict[str, str]:
        """Attributes of a record's dataset: start, name, and channels in their order."""
        return {
            **({} if self.start is None else {"start_time": self.start}),
            "windsysid_name": self.name,
            "windsysid_channels": json.dumps(self.channels, ensure_ascii=False),
        }

    def to_xarray(self) -> xr.Dataset:
        """As an `xarray.Dataset`: one variable (time,) with ``units`` per channel, and the attributes."""
        import xarray as xr

        columns = {
            name: ("time", self.values[:, i].copy(), {"units": self.units[i]}) for i, name in enumerate(self.channels)
        }
        return xr.Dataset(
            columns,
            coords={"time": ("time", self.time.copy(), {"units": "s"})},
            attrs={**self.attributes, **self.marks},
        )

    def to_dataframe(self) -> pd.DataFrame:
        """A column for each channel, called ``name [unit]``, and ``time`` [s] as the index: as functions of windsysid
        take it back."""
        import pandas as pd

        columns = [f"{name} [{unit}]" for name, unit in zip(self.channels, self.units, strict=True)]
        return pd.DataFrame(self.values.copy(), index=pd.Index(self.time.copy(), name="time"), columns=columns)

    def _repr_html_(self) -> str:
        """Show the channels with their units, to be unfolded, and their figure, in a notebook."""
        found: str = self.to_xarray()._repr_html_() + pages().fragment(self, [])
        return found

    def plot(self, ax: Axes | None = None) -> Figure:
        """Draw the channels over time, the first twelve of them.

        Parameters
        ----------
        ax
            Axes that ``subplots`` or ``add_subplot`` made, whose place the panels take; a new figure by default.

        Returns
        -------
        Figure
            The figure, or the part of it where `ax` was.

        Raises
        ------
        ConfigurationError
            If `ax` was placed by hand.
        """
        drawn: Figure = pages().figure(self, ax)
        return drawn

    @classmethod
    def from_xarray(cls, dataset: xr.Dataset) -> Record:
        """A record from a dataset whose variables are (time,), with time [s] as numbers or dates.

        Units other than SI are converted. A variable without ``units`` is refused where its name says a quantity, and
        kept ``as written: unknown`` where it says none.

        Raises
        ------
        RecordError
            If there is no such time, a variable has other dimensions or is not a number, or a unit is
            missing or unknown.
        """
        return cls.from_labelled(of_dataset(dataset), "give the variable its attribute units")

    @classmethod
    def from_dataframe(cls, frame: pd.DataFrame) -> Record:
        """A record from a pandas frame whose columns are called ``name [unit]``.

        Units may also stand in ``frame.attrs["units"]``, by column. The time is a column ``time``, otherwise the index,
        in seconds or as dates; dates give the start too, with the zone that they have. Units are treated as in
        `from_xarray`.

        Raises
        ------
        RecordError
            If a column is there twice or is not a number, a unit is missing or unknown, or the time is neither seconds
            nor dates.
        """
        return cls.from_labelled(of_frame(frame), "call the column '{}'")

    @classmethod
    def from_array(
        cls, values: npt.ArrayLike, rate: float, *,
        channels: Sequence[str] | None = None, units: str | Sequence[str] = "m/s^2",
    ) -> Record:  # fmt: skip
        """A record from an array, uniformly sampled from time 0 on.

        Parameters
        ----------
        values : array_like (T,) or (T, m)
            A row per sample and a column per channel; NaN is a missing value.
        rate : float
            Samples per second [Hz].
        channels : sequence of str (m,), optional
            Names; ``channel_1`` … by default.
        units : str or sequence of str (m,), default "m/s^2"
            Unit of all channels or of each, converted to SI. Without it, all are accelerations in m/s².

        Raises
        ------
        RecordError
            If these are no numbers, numbers of channels disagree, or a unit is unknown.

        Examples
        --------
        >>> import numpy as np
        >>> import windsysid as ws
        >>> values = np.random.default_rng(0).normal(size=(600, 2))
        >>> record = ws.Record.from_array(values, rate=10.0, channels=("floor_1", "floor_2"), units="mm/s^2")
        >>> record.channels, record.units, record.samples
        (('floor_1', 'floor_2'), ('m/s^2', 'm/s^2'), 600)
        """
        try:
            table, rate = np.atleast_2d(np.asarray(values, dtype=np.float64).T).T, float(rate)
            samples, m = table.shape
            named = [f"channel_{i + 1}" for i in range(m)] if channels is None else channels
            names, said = np.atleast_1d(named).astype(str).tolist(), np.broadcast_to(units, m).tolist()
        except (TypeError, ValueError) as error:
            raise RecordError(f"from_array: expected values (T, m), a rate in Hz, and m units: {error}") from error
        if len(names) != m or m >= samples or not 0.0 < rate < np.inf:
            got = f"got values {table.shape}, {len(names)} channels, rate {rate:g}"
            raise RecordError(f"from_array: expected values (T, m), a row per sample, m channels, and a rate; {got}")
        check_channels(tuple(names))
        columns: dict[str, tuple[Any, str | None]] = dict(zip(names, zip(table.T, said, strict=True), strict=True))
        return cls.from_labelled(Labelled(columns, np.arange(samples) / rate, None, {}, "array"), "give units")

    @classmethod
    def from_labelled(cls, table: Labelled, how: str) -> Record:
        """A record from a labelled table that was taken apart; `how` a user writes a unit there.

        Raises
        ------
        RecordError
            If a channel that must have a unit has none, or its values are no numbers.
        """
        given = {name: unit or f"{AS_WRITTEN}unknown" for name, (_, unit) in table.columns.items()}
        values = {name: _numbers(column, name) for name, (column, _) in table.columns.items()}
        unsaid = [name for name in given if given[name] == f"{AS_WRITTEN}unknown" and implied_unit(name)]
        if unsaid:
            raise RecordError(missing_units([(name, values[name]) for name in unsaid], how))
        columns = [convert(values[name], given[name], f"'{name}'") for name in given]
        return cls(
            table.time,
            _table([values for values, _ in columns], table.time.size),
            tuple(given),
            tuple(unit for _, unit in columns),
            name=table.name,
            attributes=table.attributes,
            start=table.start,
        )

    def _column(self, channel: str) -> int:
        if channel in self.channels:
            return self.channels.index(channel)
        close = difflib.get_close_matches(channel, self.channels, n=3)
        hint = f"did you mean {_listed(close)}?" if close else f"it has {_listed(self.channels)}"
        raise RecordError(f"record '{self.name}' has no channel '{channel}': {hint}")


def convert(values: Array, unit: str, what: str) -> tuple[Array, str]:
    """`values` in SI and the SI unit; RecordError naming `what` if the unit is unknown."""
    if unit.startswith(AS_WRITTEN):
        return values, unit
    try:
        factor = to_si(1.0, unit)
    except ConfigurationError as error:
        raise RecordError(f"{what}: {error}") from error
    return (values if factor == 1.0 else values * factor), si_unit(unit)


def _checked_unit(unit: str, channel: str) -> str:
    if unit.startswith(AS_WRITTEN):
        return unit
    try:
        known = canonical(unit)
    except ConfigurationError as error:
        raise RecordError(f"channel '{channel}': {error}") from error
    check_quantity(channel, unit)
    si, factor = UNITS[known]
    if factor != 1.0:
        raise RecordError(
            f"channel '{channel}' is in '{unit}': a record holds SI, expected '{si}'; "
            "convert the values, or add them by with_channels, which does"
        )
    return si


def _table(columns: list[Array], samples: int) -> Array:
    return np.column_stack(columns) if columns else np.empty((samples, 0))


def _numbers(column: npt.ArrayLike, name: str) -> Array:
    values = np.asarray(column)
    if values.dtype.kind not in "fiu":
        raise RecordError(f"'{name}': expected numbers, got {values.dtype}; leave it out or convert it")
    return np.asarray(values, dtype=np.float64)


def _listed(names: Iterable[str], most: int = 12) -> str:
    names = list(names)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) + more) or "none"
