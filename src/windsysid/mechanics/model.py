"""Interface of a mechanical model: its degrees of freedom, parameters, equations and readings.

`Model` can be compiled. `MechanicalModel` is the structure of a turbine file: the rest of the package uses this
interface only, and neither a model's class nor the spelling of its parameters. A user's model derives from
`MechanicalModel`, defines what has no default, and is known to turbine files after `register_model`.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, Self, TypeVar

from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    import sympy as sp

    from windsysid._types import Array, Complex
    from windsysid.mechanics.equations import Equations
    from windsysid.mechanics.rotor import RotorModel


__all__ = [
    "MODELS", "Coefficient", "Coordinate", "FixedAxes", "Kind", "MechanicalModel", "ModalAxes", "Model",
    "register_model",
]  # fmt: skip


Kind = Literal["stiffness", "damping", "inertia", "geometry", ""]
"""Kind of a parameter; empty where it is none of these."""


@dataclass(frozen=True)
class Coefficient:
    """Parameter of a mechanical model: name, kind and unit.

    Attributes
    ----------
    name, unit
        ``k_x``, SI unit.
    kind
        Stiffness and inertia are positive and identified on a logarithmic scale; damping may be negative.
    part
        The degree of freedom that it belongs to, which can be locked, or any other word.

    Examples
    --------
    >>> import windsysid as ws
    >>> ws.models.TowerModel().parameters[0]
    Coefficient(name='mass_side_side', kind='inertia', unit='kg', part='side_side')
    """

    name: str
    kind: Kind
    unit: str
    part: str


@dataclass(frozen=True)
class Coordinate:
    """Free degree of freedom of a mechanical model.

    Attributes
    ----------
    name
        ``x``, ``beta_1`` …
    unit
        Unit of its displacement, ``m`` or ``rad``.
    group
        Group of degrees of freedom with similar loads: the prior ties their levels, ``load_rms_<name>``.
    blade
        Number of the hinged blade that it moves; 0 for the support.

    Examples
    --------
    >>> import windsysid as ws
    >>> ws.models.RotorModel(y="locked", lag="locked").freedoms
    (Coordinate(name='x', unit='m', group='support', blade=0),)
    """

    name: str
    unit: Literal["m", "rad"]
    group: str
    blade: int = 0

    @property
    def load(self) -> str:
        """Name of the load on it."""
        return f"load_{self.name}"

    @property
    def load_unit(self) -> str:
        """SI unit of the load on it: a force or a moment."""
        return "N" if self.unit == "m" else "N*m"


class Model(Protocol):
    """Input of compilation: a `MechanicalModel`, or any `Equations`."""

    @property
    @abstractmethod
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""

    @abstractmethod
    def equations(self) -> "Equations":
        """The symbolic equations."""

    @abstractmethod
    def readings(self, sensors: Sequence[Any]) -> "list[sp.Expr]":
        """The symbolic readings of the sensors."""

    def readings_across(self, sensors: Sequence[Any]) -> "list[sp.Expr | None]":
        """Readings with each sensor's axis rotated by 90° in the plane of motion; None where that changes nothing, as
        by default."""
        return [None] * len(sensors)

    def role(self, name: str) -> tuple[Kind, str]:
        """Kind of a parameter and the part that it belongs to; by default as its equations tell
        (`windsysid.mechanics.equations.Equations.role`)."""
        return self.equations().role(name)


class ModalAxes(Protocol):
    """The coordinates in which a structure's equations are constant, or nearly so, and in which its modes have
    names."""

    @property
    def turns(self) -> bool:
        """True if the equations depend on the rotor's azimuth or speed."""

    @property
    def hinged_blades(self) -> int:
        """Number of blades that lag by themselves."""

    @property
    def averages(self) -> bool:
        """True if the remaining dependence on the azimuth may be averaged over a turn."""

    def obstacles(self, values: Mapping[str, float]) -> list[str]:
        """Why the equations are not constant in these coordinates, a phrase each; empty where they are."""

    def transform(self, psi: "Array") -> "Array":
        """T(ψ) of q = T ξ with its first and second derivative to ψ (3, K, n, n), at azimuths (K,)."""

    def weights(self, values: Mapping[str, float]) -> "Array":
        """Mass of each coordinate (n,) [kg or kg·m²]."""

    def name(self, shape: "Complex") -> str:
        """Name of a mode from its shape (n,), each displacement times the root of its mass."""


@dataclass(frozen=True)
class FixedAxes:
    """`ModalAxes` of a structure with constant equations; a mode is named after its largest displacement."""

    model: "MechanicalModel"
    prefix: str = ""
    turns: bool = False
    hinged_blades: int = 0
    averages: bool = False

    def obstacles(self, values: Mapping[str, float]) -> list[str]:
        """None."""
        return []

    def transform(self, psi: "Array") -> "Array":
        """The identity, and zeros (3, K, n, n)."""
        import numpy as np

        n = len(self.model.coordinates)
        T = np.zeros((3, len(psi), n, n))
        T[0] = np.eye(n)
        return T

    def weights(self, values: Mapping[str, float]) -> "Array":
        """Mass or inertia of each degree of freedom (n,)."""
        import numpy as np

        return np.array([self.model.inertia(name, values) for name in self.model.coordinates])

    def name(self, shape: "Complex") -> str:
        """The degree of freedom with most of the energy."""
        return self.prefix + self.model.coordinates[int((abs(shape) ** 2).argmax())].replace("_", "-")


class MechanicalModel(Model, Protocol):
    """Protocol of a mechanical model to derive from. Members with a body are defaults.

    Attributes
    ----------
    kind
        The word that names it in a turbine file.
    blades
        Number of blades of the rotor, whose harmonics excite the structure; 0 where there is none.
    samples_per_period
        Samples per period of the fastest degree of freedom [1] to which records are resampled; None: the record's own.
    required_inputs
        Inputs that a record must have, because the equations depend on them.
    """

    kind: ClassVar[str]
    blades: int = 0
    samples_per_period: ClassVar[float | None] = None
    required_inputs: ClassVar[tuple[str, ...]] = ()

    @property
    @abstractmethod
    def freedoms(self) -> tuple[Coordinate, ...]:
        """The free degrees of freedom, in the order of the state vector."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Coefficient, ...]:
        """Every parameter of the equations."""

    @abstractmethod
    def inertia(self, coordinate: str, values: Mapping[str, float]) -> float:
        """Mass [kg] or inertia [kg·m²] that moves with `coordinate` when the others are held, at `values`."""

    @abstractmethod
    def stiffness(self, coordinate: str, values: Mapping[str, float], rotor_speed: float) -> float:
        """Stiffness of `coordinate` [N/m or N·m/rad] with the others fixed, at coefficients `values`, the rotor
        turning at `rotor_speed` [rad/s]."""

    def __hash__(self) -> int:
        """Models with the same equations are one."""
        return hash(self.signature)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the known inputs u, in the order of the equations (`windsysid.signals.inputs`)."""
        return ()

    def lock_unseen(self, sensors: Sequence[Any]) -> tuple[Self, tuple[str, ...]]:
        """The model with those degrees of freedom locked that none of `sensors` sees, and their names; by default all
        stay free."""
        return self, ()

    def bodies(self) -> Mapping[str, tuple[str, ...]]:
        """Inertias of each body, by its name: parts with a common error form one body. By default those of each
        part."""
        found: dict[str, tuple[str, ...]] = {}
        for known in self.parameters:
            if known.kind == "inertia":
                found[known.part] = (*found.get(known.part, ()), known.name)
        return found

    def modes(self) -> ModalAxes:
        """The coordinates in which modes are found and named."""
        return FixedAxes(self)

    @property
    def rotor(self) -> "RotorModel | None":
        """The structure as a rotor on its support, which the wind loads of turning blades need; None for any other."""
        return None

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the free degrees of freedom."""
        return tuple(freedom.name for freedom in self.freedoms)

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the generalised loads: a force or moment on each free degree of freedom."""
        return tuple(freedom.load for freedom in self.freedoms)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states: displacements, then velocities."""
        return (*self.coordinates, *(f"{name}_rate" for name in self.coordinates))

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the stiffness and damping coefficients of the free degrees of freedom."""
        order = {name: i for i, name in enumerate(self.coordinates)}
        found = [c for c in self.parameters if c.kind in ("stiffness", "damping") and c.part in order]
        return tuple(c.name for c in sorted(found, key=lambda c: order[c.part]))

    def coefficient(self, name: str) -> Coefficient:
        """The parameter of that name.

        Raises
        ------
        ConfigurationError
            If there is none.
        """
        for known in self.parameters:
            if known.name == name:
                return known
        names = ", ".join(known.name for known in self.parameters)
        raise ConfigurationError(f"no parameter '{name}' in a model of the kind '{self.kind}': expected one of {names}")

    def role(self, name: str) -> tuple[Kind, str]:
        """Kind of a parameter and the part that it belongs to, as declared; empty where there is none of that name."""
        return next(((known.kind, known.part) for known in self.parameters if known.name == name), ("", ""))

    def coefficients_of(self, coordinate: str, kind: str) -> tuple[str, ...]:
        """Names of the coefficients of one `kind` that belong to `coordinate`."""
        return tuple(c.name for c in self.parameters if c.part == coordinate and c.kind == kind)

    def freedom(self, name: str) -> Coordinate:
        """The free degree of freedom of that name, or whose load has that name.

        Raises
        ------
        ConfigurationError
            If there is none.
        """
        for freedom in self.freedoms:
            if name in (freedom.name, freedom.load):
                return freedom
        raise ConfigurationError(
            f"no degree of freedom or load '{name}': expected one of {', '.join(self.coordinates)}"
        )

    def acts(self, name: str) -> bool:
        """True if the parameter `name` has an effect: false for stiffness and damping of locked coordinates."""
        kinds = {c.name: c.kind for c in self.parameters}
        return name in self.coefficients or kinds.get(name) in ("inertia", "geometry")

    def natural_frequency(self, coordinate: str, values: Mapping[str, float], rotor_speed: float) -> float:
        """ω [rad/s] of `coordinate` when the others are held, at coefficients `values` and `rotor_speed` [rad/s]."""
        return math.sqrt(self.stiffness(coordinate, values, rotor_speed) / self.inertia(coordinate, values))


MODELS: dict[str, type[MechanicalModel]] = {}
"""The mechanical models that a turbine file can name, by kind."""

M = TypeVar("M", bound=type[MechanicalModel])


def register_model(model: M) -> M:
    """Register a mechanical model by its `kind`, for turbine files and results; for use as a decorator of its class.

    Parameters
    ----------
    model : type
        A class derived from `MechanicalModel`.

    Returns
    -------
    type
        The class itself.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from typing import ClassVar
    >>> import windsysid as ws
    >>> @ws.models.register_model
    ... @dataclass(frozen=True)
    ... class TwoBladedTower(ws.models.TowerModel):
    ...     kind: ClassVar[str] = "two-bladed tower"
    ...     blades: int = 2
    >>> TwoBladedTower().blades, [one.name for one in TwoBladedTower().freedoms]
    (2, ['side_side', 'fore_aft'])
    """
    MODELS[model.kind] = model
    return model
