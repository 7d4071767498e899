"""The published study, repeated: ten coefficients at once by the paper's filter, on the reference scenario.

Arm A is given the loads, as the printed equations need them; arm B is not, which shows what they cost. Then: twenty
seeds, starts that are off by 0.3 to 3 times, sections that start anywhere, the response of the model with the
identified coefficients, and every other method on the same records.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid.identification.estimate.force_balance import analysis_band, measured_motion
from windsysid.identification.model.prior import Prior
from windsysid.mechanics.compile import compile_model
from windsysid.output.progress import Progress, unheard
from windsysid.results.identification import Identification, coefficient_errors
from windsysid.simulation.integrate import Response, integrate
from windsysid.study.arms import identify_section, record_balance
from windsysid.study.methods import Method, gather, run_methods
from windsysid.study.particles import PUBLISHED_HOURS, identify_section_by_particles
from windsysid.study.published import PUBLISHED, PUBLISHED_SECONDS
from windsysid.study.scenario import RATE, SECTION, StudyReference, simulate_reference
from windsysid.study.wind import DirectionChangeStudy, direction_change_study
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["Study", "run_study"]

CONVERGENCE_SECONDS = 30.0
"""The second averaging window starts so many seconds into the section."""

SEEDS, COMPARED = 20, 10
FACTORS = (0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
STARTS = tuple(np.arange(0.0, 501.0, 50.0))


@dataclass(frozen=True)
class Study:
    """Everything the study found.

    Attributes
    ----------
    turbine, reference
        The scale model and its simulated record.
    arm_a, arm_b
        Identifications with the loads known, and with the loads withheld.
    particles
        Arm A by the particle filter.
    errors
        Average errors of arm A [%], (seeds, 2, n_θ): over the whole section, and from 30 s on.
    covered
        Share of the coefficients of all seeds whose reference lies inside ±2σ at the end.
    histories
        Relative estimates (T,) of `PUBLISHED`'s coefficients, per starting factor.
    sections
        Relative estimate and relative 2σ by coefficient, per start of a 100 s section [s].
    model_response
        The model with arm A's coefficients, run from the reference's state at the start of the section.
    difference
        Greatest relative difference between exact Jacobians and the paper's finite differences, over coefficients and
        samples.
    wind
        The same filter under turbulent wind that changes direction between 20 s and 40 s.
    methods
        Every method on the first `COMPARED` of the seeds.
    """

    turbine: Turbine
    reference: StudyReference
    motion: tuple[Array, Array]
    arm_a: Identification
    arm_b: Identification
    particles: Identification
    errors: Array
    covered: float
    histories: Mapping[float, list[Array]]
    sections: Mapping[float, Mapping[str, tuple[float, float]]]
    model_response: Response
    difference: float
    wind: DirectionChangeStudy
    methods: Sequence[Method]

    @property
    def window(self) -> slice:
        """The section's samples in the whole record."""
        return slice(round(SECTION[0] * RATE), round(SECTION[1] * RATE))

    def summary(self) -> dict[str, Any]:
        """Content of ``summary.json``."""
        summary = self.arm_a.summary()
        names = list(summary["parameters"])
        for name, values in summary["parameters"].items():
            if name in PUBLISHED:
                values["published_error_percent"] = PUBLISHED[name]
        return {
            **summary,
            "published_seconds": PUBLISHED_SECONDS,
            "published_particle_filter_hours": PUBLISHED_HOURS,
            "particle_filter": {"elapsed_s": self.particles.elapsed, **self.particles.summary()["parameters"]},
            "loads_withheld": self.arm_b.summary()["parameters"],
            "average_error_percent": {
                window: {
                    name: {"median": float(np.median(column)), "worst": float(column.max())}
                    for name, column in zip(names, self.errors[:, row].T, strict=True)
                }
                for row, window in enumerate(("whole_section", "from_30_s"))
            },
            "seeds": len(self.errors),
            "covered_by_2_sigma": self.covered,
            "finite_differences_against_exact": self.difference,
            "methods": [method.summary() for method in self.methods],
        }


def run_study(seed: int = 0, progress: Progress = unheard) -> Study:
    """Run the whole study; `progress` is called with the name of the step and its completed share."""
    turbine = load_turbine("verne555").exact()
    progress("simulating the 600 s reference record", None)
    reference = simulate_reference(turbine, seed)
    progress("arm A: loads known", None)
    loads = reference.inputs[:, 3:]
    with_loads = record_balance(turbine, reference, loads)
    arm_a = identify_section(turbine, reference, with_loads)
    by_differences = identify_section(turbine, reference, record_balance(turbine, reference, loads, "differences"))
    progress("arm A by the particle filter", None)
    particles = identify_section_by_particles(turbine, reference, with_loads)
    progress("arm B: loads withheld", None)
    arm_b = identify_section(turbine, reference, record_balance(turbine, reference, None))

    shown = list(PUBLISHED)
    histories = {}
    for i, factor in enumerate(FACTORS):
        progress("starts off by 0.3 to 3 times", i / len(FACTORS))
        found = identify_section(turbine, reference, with_loads, prior=Prior(factor, factor, spread=1.0))
        histories[factor] = [found.history(name)[0] / turbine.values[name] for name in shown]
    sections = {}
    for i, start in enumerate(STARTS):
        progress("sections that start anywhere", i / len(STARTS))
        found = identify_section(turbine, reference, with_loads, (start, start + SECTION[1] - SECTION[0]))
        sections[float(start)] = {
            name: (found[name].estimate / turbine.values[name], 2.0 * found[name].std / turbine.values[name])
            for name in shown
        }
    errors, covered = [], []
    for number in range(SEEDS):
        progress(f"seed {number + 1} of {SEEDS}", number / SEEDS)
        other = simulate_reference(turbine, number)
        found = identify_section(turbine, other, record_balance(turbine, other, other.inputs[:, 3:]))
        errors.append(average_errors(found))
        covered += [e.low <= (e.reference or 0.0) <= e.high for e in found.estimates]

    progress("wind that changes direction", None)
    wind = direction_change_study(seed)
    methods = []
    for number in range(COMPARED):
        progress(f"the methods side by side: record {number + 1} of {COMPARED}", number / COMPARED)
        methods += run_methods(turbine, number)
    progress("the response of the identified model", None)
    motion = measured_motion(reference.record, turbine, cutoff=analysis_band(turbine)[0] / 2.0)
    return Study(
        turbine=turbine,
        reference=reference,
        motion=(motion.displacement, motion.velocity),
        arm_a=arm_a,
        arm_b=arm_b,
        particles=particles,
        errors=np.array(errors),
        covered=float(np.mean(covered)),
        histories=histories,
        sections=sections,
        model_response=_respond(turbine, arm_a, reference),
        difference=float(np.max(np.abs(by_differences.mean / arm_a.mean - 1.0))),
        wind=wind,
        methods=gather(methods),
    )


def average_errors(identification: Identification) -> Array:
    """Average error (Eq 24) of every coefficient [%], (2, n_θ): over the whole section, and from 30 s on."""
    late = int(np.searchsorted(identification.time, identification.time[0] + CONVERGENCE_SECONDS))
    rows = np.empty((2, len(identification.estimates)))
    for i, e in enumerate(identification.estimates):
        errors = coefficient_errors(identification.history(e.name)[0], e.reference or 1.0)
        rows[:, i] = errors.mean(), errors[late:].mean()
    return rows


def _respond(turbine: Turbine, found: Identification, reference: StudyReference) -> Response:
    """The section once more, by the model with the identified coefficients, from the reference's first state."""
    identified = turbine.with_values({e.name: e.estimate for e in found.estimates})
    model = compile_model(turbine.model)
    p = np.array([identified.values[name] for name in model.parameters])
    window = slice(round(SECTION[0] * RATE), round(SECTION[1] * RATE))
    return integrate(model, p, reference.inputs[window], rate=RATE, start=reference.response.states[window][0])
