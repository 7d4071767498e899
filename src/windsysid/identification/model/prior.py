"""Priors of the coefficients, and which of them can be identified."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from windsysid.errors import ConfigurationError
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine

__all__ = ["Prior", "identifiable"]


@dataclass(frozen=True)
class Prior:
    """Centre and width of the priors, relative to the turbine file's reference values.

    Attributes
    ----------
    stiffness, damping
        Factors on the references: the centres of the priors [1]. A prior that is shifted by a factor is widened so that
        it still covers the reference.
    spread
        Relative standard deviation of stiffness and damping; the turbine file's by default.

    Examples
    --------
    >>> import windsysid as ws
    >>> prior = ws.models.Prior(stiffness=1.1, spread=0.2)
    >>> record = ws.simulate("tower", duration=600.0, rate=5.0, seed=1)
    >>> result = ws.identify(record, "tower", prior=prior, formulation="spectral")
    >>> print(f"{result['k_side_side'].prior / 1e6:.2f} MN/m becomes {result['k_side_side'].estimate / 1e6:.2f} MN/m")
    1.95 MN/m becomes 1.77 MN/m
    """

    stiffness: float = 1.0
    damping: float = 1.0
    spread: float | None = None

    def __post_init__(self) -> None:
        for name, factor in (("stiffness", self.stiffness), ("damping", self.damping)):
            if not (math.isfinite(factor) and 0.05 <= factor <= 20.0):
                raise ConfigurationError(
                    f"prior scale of {name}: expected a factor between 0.05 and 20, got {factor:g}; "
                    "for a larger difference, write another turbine file"
                )
        if self.spread is not None and not (math.isfinite(self.spread) and self.spread > 0.0):
            raise ConfigurationError(f"prior spread: expected a positive number, such as 0.3, got {self.spread:g}")

    def parameters(self, turbine: Turbine, names: Sequence[str], *, linear: bool) -> tuple[Parameter, ...]:
        """The parameters `names` of `turbine`; `linear` keeps stiffness unscaled, as the force balance needs it.

        Masses, moments and geometry are centred on their references, however far the coefficients' priors are moved.
        """
        chosen = []
        for name in names:
            reference = turbine.values[name]
            known = turbine.model.coefficient(name)
            if known.kind == "damping":
                centre = reference * self.damping
                spread = max((self.spread or turbine.spread[1]) * abs(centre), abs(centre - reference))
                chosen.append(
                    Parameter(name, centre, spread, False, turbine.critical_damping(known.part), known.kind, known.part)
                )
                continue
            centre = reference * (self.stiffness if known.kind == "stiffness" else 1.0)
            relative = self.spread or turbine.spread[0]
            if linear or known.kind == "geometry":
                spread = max(relative * abs(centre), abs(centre - reference))
                chosen.append(Parameter(name, centre, spread, False, abs(centre), known.kind, known.part))
            else:
                chosen.append(
                    Parameter(
                        name, centre, max(relative, abs(math.log(centre / reference))), kind=known.kind, part=known.part
                    )
                )
        return tuple(chosen)


def identifiable(turbine: Turbine, chosen: Sequence[str] | None = None) -> list[str]:
    """The parameters to identify: those chosen, or the coefficients of the free degrees of freedom.

    Raises
    ------
    ConfigurationError
        If none is chosen, or a chosen parameter is not one of the turbine's, belongs to a locked degree of freedom, or
        has no reference to start from.
    """
    if chosen is None:
        known = [name for name in turbine.model.coefficients if turbine.values[name] != 0.0]
        if not known:
            raise ConfigurationError(f"turbine '{turbine.name}': expected stiffness or damping to identify, got zeros")
        return known
    if isinstance(chosen, str):
        raise TypeError(f"parameters: expected a list of names, got '{chosen}'")
    if not chosen:
        raise ConfigurationError("parameters: expected at least one name; leave them out for all coefficients")
    usable = [name for name, value in turbine.values.items() if value != 0.0 and turbine.model.acts(name)]
    for name in chosen:
        if name not in usable:
            raise ConfigurationError(
                f"parameter '{name}' cannot be identified here: expected some of {', '.join(usable)}"
            )
    return list(dict.fromkeys(chosen))
