"""Before anything is measured: how well will a set of sensors see each coefficient, and after how long?

A record of the planned kind is simulated and its Fisher information taken, for coefficients and statistics of loads
and noise together, which are not known either: at the turbine file's values for filters, and as identification
itself computes it for spectra (`windsysid.identification.planning.formulations`). After the first seconds, in which a
filter finds the state, information grows in proportion to time, so that for a record of T seconds

    I(T) = I(t₀) + (T − t₀) İ,     σ(T) = √ diag I(T)⁻¹,

the Cramér–Rao bound from the data alone, without any prior but the tolerances of instruments and masses, in coordinates
∂ ln p: every σ is relative. For one mode driven by a broadband load and well measured it is σ_k/k = 2 √(ζ / ωT) and
σ_c/c = 1/√(ζωT). The information is a sum of squares over a simulated record and scatters like the energy of the
vibration does; how much is said (`windsysid.identification.planning.information`). Source: Kay, Fundamentals of
Statistical Signal Processing: Estimation Theory (Prentice Hall 1993), ch. 3; Ljung, System Identification (2nd ed.
1999), ch. 7.4 and 9.3.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from windsysid._types import Array
from windsysid.checks.identifiability import describe_information, standard_deviations
from windsysid.errors import ConfigurationError
from windsysid.identification.model.prior import identifiable
from windsysid.identification.model.turbine_problem import seen_by
from windsysid.identification.planning.formulations import BY_FORMULATION, Planned
from windsysid.inspection.sentences import percent
from windsysid.kernels.threads import one_thread
from windsysid.mechanics.sensors import Sensor
from windsysid.output.answers import SummarisedAnswer
from windsysid.output.progress import Progress, unheard
from windsysid.output.table import Table
from windsysid.results.budget import Budget, budget_of
from windsysid.results.finding import Finding
from windsysid.results.posterior import SIGMAS
from windsysid.results.tolerance import Tolerance
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.turbine.turbine import Turbine
from windsysid.units import spell

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Plan", "plan"]

MAX_PLANNED_SECONDS = 10.0 * 365.25 * 86400.0
"""Setting: longest duration [s] that a plan searches, ten years."""


CONVERGENCE_PERIODS = 5.0
"""Setting: periods of the slowest mode in which the filter finds the state."""

SAMPLES_PER_PERIOD = 20.0
"""Setting: samples per period of the fastest mode beyond which the simulation samples no faster than it must."""


@dataclass(frozen=True, eq=False)
class Plan(SummarisedAnswer):
    """Result of `windsysid.plan`: expected accuracy of each coefficient over the length of the record.

    Attributes
    ----------
    turbine, sensors
        Names of the turbine and of the channels.
    rotor_speed, rate, duration
        [rad/s], [Hz], [s].
    within
        Required accuracy: ±2σ relative to the value [1].
    names, unknown
        The unknown parameters, then the statistics of loads and noise; the number of parameters among them.
    asked
        The parameters of interest.
    start_seconds, start, growth
        t₀ [s], I(t₀) and İ [1/s] in relative coordinates (n, n).
    accuracy
        Relative standard error of the σ here, from the scatter of the simulated record.
    locked
        Parameters of interest whose degree of freedom no sensor measures.
    notes
        Remarks.
    tolerances
        Errors of instruments and masses within their tolerances: the last of `names`.
    kinds
        Kind of each of `coefficients`: ``stiffness``, ``damping`` …
    """

    turbine: str
    sensors: tuple[str, ...]
    rotor_speed: float
    rate: float
    duration: float
    within: float
    names: tuple[str, ...]
    unknown: int
    asked: tuple[str, ...]
    start_seconds: float
    start: Array
    growth: Array
    accuracy: float
    locked: tuple[str, ...]
    notes: tuple[str, ...]
    tolerances: tuple[Tolerance, ...] = ()
    kinds: Mapping[str, str] = field(default_factory=dict)

    def information(self, duration: float) -> Array:
        """I(T) (n, n) of a record of `duration` [s], not shorter than t₀."""
        return self.start + max(duration - self.start_seconds, 0.0) * self.growth

    def band(self, name: str, duration: float | None = None) -> float:
        """Relative ±2σ of the parameter `name` after `duration` [s], as planned by default; infinite where not seen."""
        if name in self.locked:
            return math.inf
        sigma = standard_deviations(self.information(self.duration if duration is None else duration))
        return SIGMAS * float(sigma[self.names.index(name)])

    def needed(self, name: str) -> float:
        """Duration [s] after which ±2σ of the parameter `name` is within the wish; infinite if that takes more than ten
        years."""
        low = high = self.start_seconds
        while self.band(name, high) > self.within:  # after ten years rounding would hide what tolerances leave open
            if high >= MAX_PLANNED_SECONDS:
                return math.inf
            low, high = high, min(2.0 * high, MAX_PLANNED_SECONDS)
        for _ in range(60):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if self.band(name, middle) <= self.within else (middle, high)
        return high

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each coefficient: ``name``, ``band``, its relative ±2σ after the planned duration, and ``needed``,
        the duration [s] after which it is as wished; infinite where it is not seen, or never."""
        import pandas as pd

        names = list(self.coefficients)
        bands, needed = [self.band(name) for name in names], [self.needed(name) for name in names]
        return pd.DataFrame({"name": names, "band": bands, "needed": needed})

    @cached_property
    def budget(self) -> Budget:
        """Uncertainty budget after the planned duration; empty if something is not observable."""
        information = self.information(self.duration)
        if not np.isfinite(standard_deviations(information)).all():
            return Budget()
        size = np.sqrt(np.diag(information))
        cov = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
        rows = [(name, slope) for name, slope in zip(self.names, np.eye(len(cov))[: self.unknown], strict=False)]
        return budget_of(rows, cov, slice(self.unknown, len(cov) - len(self.tolerances)), self.tolerances)

    @cached_property
    def directions(self) -> tuple[str, ...]:
        """Combinations that these sensors do not determine after the planned duration, a sentence each."""
        found = describe_information(self.names, self.information(self.duration), aside=self.names[self.unknown :])
        return tuple(map(str, found))

    def answer(self, name: str) -> str:
        """Will these sensors see `name` in time, and if not, how long do they need?"""
        band, needed, wish = self.band(name), self.needed(name), percent(self.within)
        if name in self.locked:
            return f"{name}: never; no sensor responds to this degree of freedom"
        if math.isinf(band):
            return f"{name}: never; these sensors cannot observe it"
        after = f"±{percent(band)} after {spell(self.duration)}"
        if band <= self.within:
            return (
                f"{name}: yes, {after}; ±{wish} {'before' if needed <= self.start_seconds else 'after'} "
                f"{spell(needed, 2)}"
            )
        return f"{name}: no, {after}; ±{wish} {'never' if math.isinf(needed) else f'after {spell(needed, 2)}'}"

    @property
    def verdict(self) -> str:
        """One line on all that was requested."""
        needed = {name: self.needed(name) for name in self.asked}
        late = sorted((name for name in self.asked if self.band(name) > self.within), key=lambda name: needed[name])
        wish = f"within ±{percent(self.within)} (95 % interval) in {spell(self.duration)}"
        if not late:
            last = max(self.asked, key=lambda name: needed[name])
            when = f"{'before' if needed[last] <= self.start_seconds else 'after'} {spell(needed[last], 2)}"
            return f"yes: every requested interval is reached {wish}; the last is {last}, {when}"
        times = [f"{name} ({'never' if math.isinf(needed[name]) else spell(needed[name], 2)})" for name in late]
        return f"no: not known {wish}: {', '.join(times)}"

    @property
    def sentence(self) -> str:
        """The verdict with a capital and a full stop."""
        return f"{self.verdict[0].upper()}{self.verdict[1:]}."

    @property
    def answers(self) -> list[str]:
        """An answer for each parameter that was requested by name; none where that is all of them."""
        return [self.answer(name) for name in self.asked] if set(self.asked) != set(self.coefficients) else []

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The parameters of the table: all that are unknown, and those requested that no sensor sees."""
        return (*self.names[: self.unknown], *self.locked)

    @property
    def headings(self) -> tuple[str, str, str]:
        """Of the table."""
        return ("parameter", f"± 95 % after {spell(self.duration)}", f"±{percent(self.within)} after")

    @property
    def rows(self) -> list[tuple[str, str, str]]:
        """Of the table: name, ±2σ after the planned duration, and the duration that the wish needs."""
        rows = []
        for name in self.coefficients:
            band, needed = self.band(name), self.needed(name)
            early = "< " if needed <= self.start_seconds else ""
            seen = "not seen" if math.isinf(band) else percent(band)
            rows.append((name, seen, "never" if math.isinf(needed) else early + spell(needed, 2)))
        return rows

    def table(self) -> Table:
        """`rows`."""
        title = f"{self.turbine}: {len(self.sensors)} sensors, {spell(self.duration)} at {self.rate:g} Hz"
        return Table(self.headings, self.rows, title)

    def summary(self) -> dict[str, Any]:
        """Plan as plain values: the content of ``summary.json``."""
        return {
            "turbine": self.turbine,
            "sensors": list(self.sensors),
            "rotor_speed_rad_s": self.rotor_speed,
            "rate_hz": self.rate,
            "duration_s": self.duration,
            "within_percent": 100.0 * self.within,
            "verdict": self.verdict,
            "parameters": {
                name: {"two_sigma_percent": 100.0 * self.band(name), "needed_s": self.needed(name),
                "answer": self.answer(name)}
                for name in self.coefficients
            },
            "budget": self.budget.summary(),
            "directions": list(self.directions),
            "relative_accuracy": self.accuracy,
            "notes": list(self.notes),
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"<Plan of {self.turbine}: {self.sentence}; print it for the table>"

    def contents(self) -> list[Table | str]:
        """The sentence, the answers for each parameter, the tables, the notes."""
        budget = [self.budget.table()] if self.tolerances and self.budget.rows else []
        return [self.sentence, self.table(), *self.answers, *self.directions, *budget, *self.notes]


@one_thread()
def plan(
    turbine: TurbineLike,
    *,
    sensors: Sequence[Sensor] | None = None,
    duration: float = 600.0,
    rate: float = 100.0,
    parameters: Sequence[str] | None = None,
    within: float = 0.2,
    load_scale: float = 1.0,
    rotor_speed: float | None = None,
    formulation: Literal["auto", "joint", "spectral"] = "auto",
    seed: int = 0,
    progress: Progress = unheard,
) -> Plan:
    """Predict how accurately a planned record will identify the coefficients of `turbine`, and how long it has to be.

    Parameters
    ----------
    turbine : Turbine, str or Path
        A turbine, the name of a packaged one, or the path of a TOML file.
    sensors : sequence of Sensor, optional
        Instruments; the turbine's usual ones by default.
    duration, rate : float, default 600 and 100
        Length [s] and sampling rate [Hz] of the planned record.
    parameters : sequence of str, optional
        Parameters of interest; all coefficients by default. The coefficients of all free degrees of freedom are always
        unknown, masses and geometry only if they are named here.
    within : float, default 0.2
        Required accuracy: ±2σ relative to the value [1].
    load_scale : float, default 1
        Factor on the loads of the turbine file [1].
    rotor_speed : float, optional
        Rotor speed [rad/s]; the turbine's usual one by default.
    formulation : {"auto", "joint", "spectral"}, default "auto"
        Formulation that will identify the record (`windsysid.identify`). ``"joint"``: Kalman filter, under the loads of
        the turbine file. ``"spectral"``: spectra; under wind where a rotor turns. ``"auto"``: spectral where the
        structure has no rotating degrees of freedom and the planned record is long enough for it, else joint.
    seed : int, default 0
        Seed of the simulated record.
    progress : callable, optional
        Called as ``progress(step, share)`` with the present step, a str, and the share that is done, 0 to 1, or None
        if that is unknown.

    Returns
    -------
    Plan
        ``band(name, duration)``: ±2σ of a coefficient, relative to its value [1], for a length of record [s];
        ``needed(name)``: the length [s] that the required accuracy needs; ``directions``: combinations of parameters
        that the sensors do not determine.

    Raises
    ------
    ConfigurationError
        If a name is unknown, a number out of range, or the sensor list empty.

    See Also
    --------
    identify : Identification from a record.
    simulate : A record of the turbine's sensors.

    Notes
    -----
    The accuracy is the Cramér–Rao bound from the data alone, without priors of the coefficients.

    References
    ----------
    - Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, Prentice Hall 1993, ch. 3.
    - Ljung, System Identification, 2nd ed., Prentice Hall 1999, ch. 7.4 and 9.3.

    Examples
    --------
    >>> import windsysid as ws
    >>> planned = ws.plan("tower", duration=600.0, rate=5.0)
    >>> print(str(planned).splitlines()[0])
    No: not known within ±20 % (95 % interval) in 10 min: c_fore_aft (28 min), c_side_side (2.6 h).
    """
    _require_positive("within", within, 10.0)
    turbine = _as_planned(as_turbine(turbine), sensors, load_scale, rotor_speed)
    _check_record(turbine, duration, rate)
    if formulation not in BY_FORMULATION:
        raise ConfigurationError(f"formulation: expected {', '.join(BY_FORMULATION)}; got '{formulation}'")
    known = identifiable(turbine)
    asked = identifiable(turbine, parameters) if parameters is not None else known
    notes: list[Finding] = []
    seen = seen_by(turbine, turbine.sensors, notes)
    unknown = tuple(name for name in dict.fromkeys([*known, *asked]) if seen.model.acts(name))
    slowest, fastest, damping = _time_scales(seen)
    finding = min(CONVERGENCE_PERIODS * 2.0 * math.pi / slowest, duration)
    thinning = max(1, int(rate / (SAMPLES_PER_PERIOD * fastest / (2.0 * math.pi))))
    planned = Planned(seen, unknown, rate, duration, damping, finding, thinning, seed, progress)
    told = BY_FORMULATION[formulation](planned)
    draft = Plan(
        turbine.name, tuple(sensor.channel for sensor in turbine.sensors), turbine.rotor_speed, rate, duration, within,
        told.names, len(unknown), tuple(asked), finding, told.start, told.growths.mean(axis=0), 0.0,
        tuple(name for name in asked if name not in unknown), (*map(str, notes), *told.notes), told.tolerances,
        {name: turbine.model.role(name)[0] for name in (*unknown, *asked)},
    )  # fmt: skip
    accuracy = _accuracy(draft, told.growths, told.length * damping)
    return replace(draft, accuracy=accuracy, notes=(*draft.notes, f"these numbers are accurate to {percent(accuracy)}"))


def _as_planned(
    turbine: Turbine, sensors: Sequence[Sensor] | None, load_scale: float, rotor_speed: float | None
) -> Turbine:
    """The turbine with the planned sensors, loads and rotor speed, which are checked."""
    _require_positive("load scale", load_scale, 1e6)
    turning = turbine.rotor_speed if rotor_speed is None else rotor_speed
    if not (math.isfinite(turning) and 0.0 <= turning <= 1e3):
        raise ConfigurationError(f"rotor speed: expected a number from 0 (parked) to 1000 rad/s, got {turning:g}")
    chosen = turbine.sensors if sensors is None else tuple(sensors)
    if not chosen:
        raise ConfigurationError(
            "the sensor list is empty: expected at least one sensor; leave it out for the usual ones"
        )
    loads = tuple(replace(load, rms=load.rms * load_scale) for load in turbine.loads)
    air = turbine.aerodynamic_tolerance if turning else 0.0
    return replace(turbine, sensors=chosen, rotor_speed=turning, aerodynamic_tolerance=air, loads=loads)


def _require_positive(what: str, value: float, most: float) -> None:
    if not (math.isfinite(value) and 0.0 < value <= most):
        raise ConfigurationError(f"{what}: expected a positive number of at most {most:g}, got {value:g}")


def _check_record(turbine: Turbine, duration: float, rate: float) -> None:
    """Refuse a record of the turbine that is too short, endless, or too slow for its modes."""
    _require_positive("rate", rate, 1e5)
    least, why = turbine.least_duration
    if not (math.isfinite(duration) and least <= duration <= MAX_PLANNED_SECONDS):
        raise ConfigurationError(f"duration: expected {why} to ten years, got {duration:g} s: plan another record")
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    if fastest / rate > 0.6:
        raise ConfigurationError(
            f"rate: expected at least {fastest / 0.6:.3g} samples per second for a mode at "
            f"{fastest / (2.0 * math.pi):.3g} Hz, got {rate:g}"
        )


def _time_scales(turbine: Turbine) -> tuple[float, float, float]:
    """Slowest and fastest natural frequency [rad/s] and the slowest decay ζω [1/s] of the free degrees of freedom."""
    frequencies = {name: turbine.natural_frequency(name) for name in turbine.model.coordinates}
    moving = [w for w in frequencies.values() if w > 0.0] or [turbine.rotor_speed]
    return min(moving), max(moving), turbine.slowest_decay


def _accuracy(draft: Plan, growths: Array, relaxations: float) -> float:
    """Relative standard error of σ after the planned duration, the worst of what is seen: a jackknife over the blocks,
    and not less than what the energy of so many relaxations leaves.
    """
    whole = growths.sum(axis=0)
    n = len(growths)
    sigmas = np.array([
        standard_deviations(replace(draft, growth=(whole - growth) / (n - 1)).information(draft.duration))
        for growth in growths
    ])  # fmt: skip
    logs = np.log(sigmas[:, : draft.unknown][:, np.isfinite(sigmas[:, : draft.unknown]).all(axis=0)])
    return float(
        np.sqrt((n - 1) / n * np.square(logs - logs.mean(axis=0)).sum(axis=0)).max(initial=0.5 / math.sqrt(relaxations))
    )
