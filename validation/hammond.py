"""Ground resonance of Hammond's helicopter: where it is unstable, and how Coleman's transform and Floquet's theory
agree.

Three states of the lag dampers on two hubs: the table's, softer to move in y than in x, and an isotropic one whose y is
its x in mass, spring and damper. With one lag damper out the blades differ and only Floquet's theory applies. Every
rotor speed from 20 to 500 rpm is looked at in steps of 2 rpm; ends of unstable ranges are then found to 0.01 rpm.
``python -m validation.hammond`` prints the table.

Source: C. E. Hammond, J. American Helicopter Society 19(4), 1974, https://doi.org/10.4050/JAHS.19.14.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.mechanics.compile import compile_model
from windsysid.modal.analysis import ModalSpectrum, analyse
from windsysid.modal.stability import Unstable, unstable_ranges
from windsysid.output.console import render
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine
from windsysid.units import RPM

__all__ = ["DAMPERS", "HUBS", "Case", "compare", "examine"]


SPEEDS = np.arange(20.0, 501.0, 2.0) / RPM

NO_DAMPING = {"c_x": 0.0, "c_y": 0.0, **{f"c_beta_{i}": 0.0 for i in range(1, 5)}}
DAMPERS: Mapping[str, Mapping[str, float]] = {
    "all dampers": {}, "one lag damper out": {"c_beta_1": 0.0}, "no damping at all": NO_DAMPING,
}  # fmt: skip
HUBS = ("table", "isotropic")


class Case(NamedTuple):
    """One state of the helicopter: how it was analysed, where it is unstable, and the greatest difference between the
    two methods.

    The difference is that of exponents in units of Ω, at every tenth speed; None where Coleman's transform does not
    apply.
    """

    dampers: str
    hub: str
    method: str
    unstable: list[Unstable]
    difference: float | None


def helicopter(dampers: str, hub: str) -> Turbine:
    """Hammond's helicopter with some dampers, on one of the two hubs."""
    turbine = load_turbine("hammond").exact()
    values = dict(DAMPERS[dampers])
    if hub == "isotropic":
        v = {**turbine.values, **values}
        values |= {"hub_mass_y": v["hub_mass_x"], "k_y": v["k_x"], "c_y": v["c_x"]}
    return turbine.with_values(values)


def examine(turbine: Turbine, speeds: Array = SPEEDS) -> tuple[str, list[Unstable], float | None]:
    """Method, unstable ranges, and greatest difference between the methods at every tenth speed."""
    model = compile_model(turbine.model)
    p = np.array([turbine.values[name] for name in model.parameters])
    unstable = unstable_ranges(lambda speed: analyse(turbine.model, model, p, speed).growth, speeds)
    if turbine.model.modes().obstacles(dict(zip(model.parameters, p.tolist(), strict=True))):
        return "Floquet", unstable, None
    differences = [
        compare(analyse(turbine.model, model, p, s), analyse(turbine.model, model, p, s, method="Floquet")) / s
        for s in speeds[::10].tolist()
    ]
    return "Coleman", unstable, max(differences)


def compare(one: ModalSpectrum, other: ModalSpectrum) -> float:
    """Greatest distance of exponents [1/s], each with its own partner; infinite where their numbers differ."""
    from scipy.optimize import linear_sum_assignment

    if len(one.exponents) != len(other.exponents):
        return float("inf")
    distance = np.abs(one.exponents[:, None] - other.exponents)
    return float(distance[linear_sum_assignment(distance)].max())


def main() -> None:
    """Print the table."""
    from rich.table import Table

    table = Table(title="Hammond's helicopter, 20 … 500 rpm", title_justify="left")
    for heading in ("dampers", "hub", "method", "unstable [rpm]", "largest growth", "Coleman − Floquet"):
        table.add_column(heading)
    for dampers in DAMPERS:
        for hub in HUBS:
            case = Case(dampers, hub, *examine(helicopter(dampers, hub)))
            ranges = "\n".join(f"{u.low * RPM:.1f} … {u.high * RPM:.1f}" for u in case.unstable) or "nowhere"
            growth = "\n".join(f"{u.growth:.3f} 1/s at {u.worst * RPM:.1f} rpm" for u in case.unstable)
            agreement = "" if case.difference is None else f"{case.difference:.0e} Ω"
            table.add_row(dampers, hub, case.method, ranges, growth, agreement)
    print(render(table))


if __name__ == "__main__":
    main()
