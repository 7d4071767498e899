"""Result of an identification: estimates with their intervals, the history of the search, and the verdict."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.output.answers import Answer
from windsysid.output.table import Table, axes_of
from windsysid.results.estimate import Estimate
from windsysid.results.posterior import Posterior, section_name, unusable_among
from windsysid.results.serialization import finite
from windsysid.results.storage import as_netcdf, attributes_of, variables_of
from windsysid.results.values import IdentificationValues
from windsysid.units import RPM, engineering, unit_text

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

USABLE = ("A", "B")
"""Setting: grades of quantities that may be used."""

__all__ = ["Estimate", "Identification", "coefficient_errors", "finite"]


@dataclass(frozen=True)
class Identification(IdentificationValues, Answer):
    """Result of `windsysid.identify`: estimates, modes, loads and diagnosis.

    Attributes
    ----------
    method, formulation
        The filter or likelihood, and ``joint``, ``spectral`` or ``force-balance``.
    record, turbine
        Names of record and turbine.
    sensors
        Channels that were used as measurements.
    section
        Start and end [s].
    rate, samples, elapsed
        Sampling rate [Hz], number of samples, duration of the computation [s].
    estimates
        One `Estimate` per coefficient.
    modes
        Modes at the record's mean rotor speed, derived from the estimates.
    parameters
        The identified parameters with their filter coordinates.
    time, mean, std
        (T,), (T, n_θ), (T, n_θ): recursive estimates of the filter after each sample, in filter coordinates.
    cov
        (n_θ, n_θ): covariance of the estimates in filter coordinates.
    readings, innovation, whitened
        Names of the readings; innovations (T, m) and the same standardised to unit variance.
    log_likelihood
        Log density of all readings.
    statistics
        Statistics of loads and noise that were learned from the record.
    loads
        Estimated loads at the times of the innovations; None where no load was a state.
    diagnosis
        Whether to trust the result, the reasons against it, and remarks; `findings` has them as data, `notes` in
        sentences.
    machine
        The turbine as it was identified: with the reference values, the degrees of freedom that were used, the record's
        mean rotor speed; None for equations of one's own.
    conditions
        Operating conditions of the turbine.
    provenance
        Record, turbine, sensors, options and version of the result; None where they are not known.
    joint_cov
        Covariance of the coefficients, of the coordinates η of `statistics`, and of `tolerances` in standard deviations
        of their priors, together (n, n), n = n_θ + n_η + n_τ; None where no statistics were learned.
    tolerances
        Estimated errors of instruments and masses within their tolerances; none where they were taken as exact.
    budget
        Contributions to the variance of each interval.
    spectra
        Spectra of the channels under the fit, for figures; none for filters whose equations vary with time.
    """

    def __repr__(self) -> str:
        trusted = "trusted" if self.diagnosis.trusted else "not trusted"
        listed = ", ".join(" ".join((e.name, *engineering(e.unit, e.estimate))) for e in self.estimates[:4])
        listed += ", …" * (len(self.estimates) > 4)
        return (
            f"<{type(self).__name__} of {self.turbine} from {self.record}: {len(self.estimates)} parameters ({listed}),"
            f" {trusted}; print it for the table>"
        )

    @property
    def posterior(self) -> Posterior:
        """The turbine as the record shows it, and how well.

        Raises
        ------
        ConfigurationError
            If equations of one's own were identified, which are no turbine.
        """
        if self.machine is None:
            raise ConfigurationError(f"{self.turbine}: expected a turbine, got equations of one's own")
        values = {e.name: e.estimate for e in self.estimates}
        theta = np.array([q.coordinate(values[q.name]) for q in self.parameters])
        name, known = section_name(self.record, *self.section), self.provenance
        grades = {e.name: e.grade for e in self.estimates}
        return Posterior(
            self.machine.with_values(values), self.parameters, theta, self.cov, name, self.diagnosis.trusted,
            self.conditions, start=None if known is None else known.start,
            record_hash=None if known is None else known.record_hash,
            section=self.section, statistics=self.statistics, joint_cov=self.joint_cov, tolerances=self.tolerances,
            unusable=unusable_among(grades, self.findings, trusted=self.diagnosis.trusted),
            widening={e.name: e.widening for e in self.estimates},
        ).given("masses")  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """The result as plain values: what ``summary.json`` holds."""
        return {
            "method": self.method,
            "formulation": self.formulation,
            "record": self.record,
            "start": None if self.provenance is None else self.provenance.start,
            "turbine": self.turbine,
            "state": next((one.data["state"] for one in self.findings if one.code == "operating_state"), None),
            "sensors": list(self.sensors),
            "section": list(self.section),
            "rotor_speed_rad_s": self.conditions.rotor_speed,
            "wind_speed_m_s": self.conditions.wind_speed,
            "rate_hz": self.rate,
            "samples": self.samples,
            "elapsed_s": self.elapsed,
            "log_likelihood": self.log_likelihood,
            "parameters": {e.name: _estimate_summary(e) for e in self.estimates},
            "modes": [mode.summary() for mode in self.modes],
            "statistics": {s.name: asdict(s) for s in self.statistics},
            "tolerances": {one.name: asdict(one) for one in self.tolerances},
            "budget": self.budget.summary(),
            "diagnosis": self.diagnosis.summary(),
            "findings": [finding.summary() for finding in self.findings],
            "notes": list(self.notes),
            "provenance": None if self.provenance is None else self.provenance.summary(),
        }

    def to_json(self) -> str:
        """`summary` as JSON text; what is not a finite number becomes null."""
        return json.dumps(finite(self.summary()), indent=2) + "\n"

    def to_dataframe(self) -> "pd.DataFrame":
        """Everything that was estimated, one row each: coefficients, frequencies and damping ratios of the modes, and
        statistics of loads and noise; with ``unit``, ``estimate``, ``low``, ``high`` (±2σ) and what the file says."""
        import pandas as pd

        rows: list[tuple[Any, ...]] = [
            (e.name, "coefficient", unit_text(e.unit), e.estimate, e.low, e.high, e.grade, e.reference)
            for e in self.estimates
        ]
        for mode in self.modes:
            rows += mode.dataframe_rows()
        rows += [
            (s.name, "statistic", unit_text(s.unit), s.estimate, s.low, s.high, "", s.given) for s in self.statistics
        ]
        columns = ["name", "quantity", "unit", "estimate", "low", "high", "grade", "in_file"]
        return pd.DataFrame(rows, columns=columns).astype({"in_file": float})

    def to_xarray(self) -> "xr.Dataset":
        """Histories, covariance and innovations as a labelled dataset."""
        import xarray as xr

        return xr.Dataset(variables_of(self), attrs=attributes_of(self))

    def files(self) -> dict[str, bytes]:
        """Files of `save`: ``summary.json``, and ``identification.nc``, which is `to_xarray` as netCDF-4."""
        return {"summary.json": self.to_json().encode(), "identification.nc": as_netcdf(self)}

    def contents(self) -> list[Table | str]:
        """The modes, whether to trust them, the estimates; then what they rest on: loads, noise, the budget, notes."""
        title = f"{self.turbine}, {self.record}: {self.formulation}, {self.method}"
        return [
            title,
            *([self.modes_table()] if self.modes else []),
            str(self.diagnosis),
            *self.usable(),
            self.table(),
            *([self.statistics_table()] if self.statistics else []),
            *([self.budget.table(modes=False)] if self.tolerances else []),
            *self.diagnosis.remarks,
            *self.notes,
        ]

    def usable(self) -> list[str]:
        """Usable part of a result that is not trusted as a whole, in a sentence; empty for one that is."""
        if self.diagnosis.trusted:
            return []
        good = [e.name for e in self.estimates if e.grade in USABLE]
        for mode in self.modes:
            good += [f"{mode.name} {name}" for name, one in mode.quantities if one.grade in USABLE]
        return [f"can still be used (grade A or B): {', '.join(good)}"] if good else []

    def table(self) -> Table:
        """The estimates with their bands, and the references where any is known."""
        headings = ["coefficient", "estimate", "95 % interval", "unit", "grade", "by data"]
        headings += ["file", "differs"] if any(e.reference is not None for e in self.estimates) else []
        rows = []
        for e in self.estimates:
            informed = f"{100.0 * e.informed_by_data:.1f} %"
            rows.append(_estimate_cells(e.name, e.unit, e.grade, informed, asdict(e))[: len(headings)])
            if e.tip is not None:
                unit = "N/m" if e.kind == "stiffness" else "N*s/m"
                rows.append(_estimate_cells("  at the tip", unit, "", "", e.tip)[: len(headings)])
        title = "Stiffness and damping" + axes_of(e.name for e in self.estimates)
        return Table(headings, rows, title if self.machine is not None else "Parameters", words=(0, 3))

    def modes_table(self) -> Table:
        """The modes: frequencies, damping ratios, and how far they are from the nearest harmonic of the rotor."""
        orders, speed = self._harmonics(), self.machine.rotor_speed if self.machine is not None else 0.0
        headings = ["mode", "f ± 95 % [Hz]", "grade", "ζ ± 95 % [%]", "grade"]
        rows = [[*mode.cells()] for mode in self.modes]
        if orders:
            headings.append("from nP")
            rows = [[*row, mode.beside(orders, speed)] for row, mode in zip(rows, self.modes, strict=True)]
        if any(mode.frequency.reference is not None for mode in self.modes):
            headings.append("file")  # so that the modes of a tower fit 80 columns
            rows = [[*row, mode.reference_cell()] for row, mode in zip(rows, self.modes, strict=True)]
        at = f"at {speed * RPM:.3g} rpm" if orders else "with the rotor at rest"
        return Table(headings, rows, f"Modes {at}, fixed frame{axes_of(mode.name for mode in self.modes)}")

    def _harmonics(self) -> tuple[int, ...]:
        """Orders n of the harmonics nP that load a tower most: 1P and multiples of the blades; none at rest."""
        if self.machine is None or self.machine.rotor_speed <= 0.0:
            return ()
        blades = self.machine.model.blades
        return tuple(dict.fromkeys((1, blades, 2 * blades, 3 * blades)))

    def statistics_table(self) -> Table:
        """Statistics of loads and noise."""
        rows = []
        for s in self.statistics:
            value, low, high, given, unit = engineering(s.unit, s.estimate, s.low, s.high, s.given)
            rows.append((s.name, value, f"{low} … {high}", unit, given))
        headings = ("statistic", "estimate", "95 % interval", "unit", "prior")
        return Table(headings, rows, "Loads and noise, learned from the record", words=(0, 3))

    def tolerances_table(self) -> Table:
        """Estimated errors of instruments and masses."""
        rows = [one.cells() for one in self.tolerances]
        return Table(("instrument or body", "tolerance (1σ)", "off by"), rows, "Instruments and masses", words=(0,))


def coefficient_errors(history: Array, reference: float) -> Array:
    """Eq (24): |identified − reference| / |reference| · 100 %, point by point."""
    return np.asarray(np.abs(history - reference) / abs(reference) * 100.0, dtype=np.float64)


def _estimate_cells(name: str, unit: str, grade: str, informed: str, values: Mapping[str, Any]) -> tuple[str, ...]:
    estimate, reference = values["estimate"], values["reference"]
    value, low, high, in_file, unit = engineering(unit, estimate, values["low"], values["high"], reference)
    difference = f"{round(100.0 * (estimate / reference - 1.0), 1) + 0.0:+.1f} %" if reference else ""  # no -0.00 %
    return name, value, f"{low} … {high}", unit, grade, informed, in_file, difference


def _estimate_summary(e: Estimate) -> dict[str, Any]:
    summary: dict[str, Any] = {
        "unit": e.unit, "kind": e.kind, "estimate": e.estimate, "low": e.low, "high": e.high, "std": e.std,
        "grade": e.grade, "informed_by_data": e.informed_by_data, "prior": e.prior,
    }  # fmt: skip
    if e.reference is not None:
        summary["reference"] = e.reference
    if e.average_error_percent is not None:
        summary["average_error_percent"] = e.average_error_percent
    if e.tip is not None:
        summary["tip"] = dict(e.tip)
    return summary
