"""Modes from linearisation files: files are sorted into operating points, each is averaged, modes are linked."""

import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.modal.linearisation.coordinates import model_coordinates
from windsysid.modal.linearisation.eigenmodes import ModelModes, model_modes
from windsysid.modal.linearisation.lin_file import LinearisedModel, read_lin_file
from windsysid.modal.linearisation.result import LinearisedModes, OperatingPoint
from windsysid.modal.stability import NEUTRAL_GROWTH, Unstable
from windsysid.modal.tracking import link
from windsysid.units import RPM

__all__ = ["read_linearisation"]

MAX_SPEED_RATIO = 0.01
"""Setting: largest difference of rotor speeds, relative, within one operating point."""

MAX_GAP_RATIO = 1.25
"""Setting: largest gap between azimuths of an operating point, relative to even spacing, without a note."""

ENDING = ".lin"
"""Ending of linearisation files."""


def read_linearisation(
    paths: str | Path | Sequence[str | Path], *, operating: tuple[float, float] | None = None
) -> LinearisedModes:
    """Compute the modes of OpenFAST linearisation files in the fixed frame.

    Files ``X.1.lin``, ``X.2.lin`` … of one name are azimuths of one operating point and are averaged after the
    multi-blade transformation; several names are operating points of one machine, whose modes are linked over rotor
    speed.

    Parameters
    ----------
    paths : str, Path, or sequence of these
        One file, or several in any order.
    operating : (float, float), optional
        Lowest and highest operating speed [rad/s]; those of the files by default.

    Returns
    -------
    LinearisedModes
        ``modes`` with damped frequency [Hz], damping ratio [1], name and participations; ``plot()`` is the Campbell
        diagram.

    Raises
    ------
    ConfigurationError
        If a file is no linearisation or is damaged, the files do not belong together, or the rotor does not have three
        blades.

    See Also
    --------
    modes : Modes of a turbine file or of an identification.

    References
    ----------
    Bir, Multiblade Coordinate Transformation and its Application to Wind Turbine Analysis, NREL/CP-500-42553, 2008.

    Examples
    --------
    A tower with one degree of freedom, in a folder that is deleted afterwards:

    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> heading = "Rotor Speed: 0 rad/s | Azimuth: 0 rad | Number of continuous states: 2 | Order of continuous states:"
    >>> name = "1st tower fore-aft bending mode DOF, m"
    >>> states = f"x | x | 1 0.0 F 2 ED {name} | 2 0.0 F 2 ED First time derivative of {name}/s"
    >>> A = "A: 2 x 2 | 0.0 1.0 | -4.000000000 -0.040000000"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "tower.1.lin"
    ...     _ = path.write_text(f"{heading} | {states} |  | {A}".replace(" | ", chr(10)))
    ...     (mode,) = ws.read_linearisation(path).modes
    >>> print(mode.name, round(mode.frequency.estimate, 4), "Hz", round(mode.damping_ratio.estimate, 4))
    tower fore-aft 0.3183 Hz 0.01
    """
    listed = [paths] if isinstance(paths, str | Path) else list(paths)
    if not listed:
        raise ConfigurationError("linearisation: expected one or more .lin files, got none")
    sets: dict[str, list[LinearisedModel]] = {}
    for path in sorted(map(Path, dict.fromkeys(listed)), key=str):
        sets.setdefault(_set_name(path), []).append(read_lin_file(path))
    points = sorted((_checked(files) for files in sets.values()), key=lambda files: files[0].rotor_speed)
    _check_together(points)
    coordinates = model_coordinates(points[0][0])
    found = [model_modes(files, coordinates) for files in points]
    for files, each in zip(points, found, strict=True):
        if not each.modes:
            raise ConfigurationError(f"{files[0].path}: expected a model that oscillates, got no structural mode")
    return _diagram(points, found, operating)


def _diagram(
    points: Sequence[Sequence[LinearisedModel]], found: Sequence[ModelModes], operating: tuple[float, float] | None
) -> LinearisedModes:
    """The answer, of operating points by rotor speed."""
    speeds = np.array([float(np.mean([one.rotor_speed for one in files])) for files in points])
    banded = any(mode.frequency.std > 0.0 for each in found for mode in each.modes)
    usual, first = len(points) - 1, points[-1][0]
    curves = link([each.spectrum for each in found], speeds, usual, np.eye(2), shortest=1)
    blades = found[usual].spectrum.method == "Coleman"
    return LinearisedModes(
        turbine=first.description or first.path.stem, record=None, banded=banded, speeds=speeds, usual=usual,
        operating=operating or (float(speeds[0]), float(speeds[-1])),
        orders=(1, 3, 6) if speeds[-1] > 0.0 and blades else (), curves=curves,
        unstable=tuple(_unstable(speeds, found)), ground_resonance=(), method=found[usual].spectrum.method,
        notes=tuple(_notes(points, found)),
        points=tuple(
            OperatingPoint(
                float(speed), files[0].wind_speed, tuple(one.path.name for one in files),
                tuple(one.azimuth for one in files), min(one.digits for one in files), each.modes,
            )
            for speed, files, each in zip(speeds, points, found, strict=True)
        ),
    )  # fmt: skip


def _set_name(path: Path) -> str:
    """Name of the operating point of a file: its path without azimuth number and ending."""
    if path.suffix.lower() != ENDING:
        raise ConfigurationError(f"{path}: expected a linearisation file ending in {ENDING}, got '{path.suffix}'")
    return re.sub(r"\.\d+$", "", str(path.with_suffix("")))


def _checked(files: list[LinearisedModel]) -> list[LinearisedModel]:
    """Files of one operating point: one rotor speed."""
    first = files[0]
    for one in files[1:]:
        if abs(one.rotor_speed - first.rotor_speed) > MAX_SPEED_RATIO * abs(first.rotor_speed):
            raise ConfigurationError(
                f"{one.path}: expected the rotor speed of {first.path.name}, {first.rotor_speed * RPM:.4g} rpm, got "
                f"{one.rotor_speed * RPM:.4g} rpm: give each operating point its own name"
            )
    return files


def _check_together(points: Sequence[Sequence[LinearisedModel]]) -> None:
    """Refuse files of different models, and two operating points at one rotor speed."""
    first = points[0][0]
    for one in itertools.chain.from_iterable(points):
        if one.states != first.states:
            raise ConfigurationError(
                f"{one.path}: expected the {len(first.states)} states of {first.path.name}, got {len(one.states)} or "
                "others: give files of one model"
            )
    for (a, *_), (b, *_) in itertools.pairwise(points):
        if b.rotor_speed - a.rotor_speed <= MAX_SPEED_RATIO * b.rotor_speed:
            raise ConfigurationError(
                f"{b.path}: expected another rotor speed than {a.path.name}, got {b.rotor_speed * RPM:.4g} rpm in "
                "both: give operating points of one rotor speed one at a time"
            )


def _unstable(speeds: Array, found: Sequence[ModelModes]) -> list[Unstable]:
    """Ranges of operating points in which a structural mode grows."""
    ranges = []
    rows = [(float(s), each.spectrum.growth) for s, each in zip(speeds, found, strict=True)]
    for grows, group in itertools.groupby(rows, key=lambda row: row[1] > NEUTRAL_GROWTH * max(row[0], 1.0)):
        if grows:
            inside = list(group)
            worst = max(inside, key=lambda row: row[1])
            ranges.append(Unstable(inside[0][0], inside[-1][0], worst[1], worst[0]))
    return ranges


def _notes(points: Sequence[Sequence[LinearisedModel]], found: Sequence[ModelModes]) -> list[str]:
    """Notes for a reader of the answer."""
    notes = ["Frequencies are damped, Im λ / 2π, in the fixed frame."]
    if found[-1].spectrum.method == "Coleman":
        notes.append("Multi-blade transformation of three blades (Bir 2008), averaged over the azimuths of each set.")
        uneven = [files[0].path.name for files in points if files[0].rotor_speed > 0.0 and _uneven(files)]
        if uneven:
            notes.append(
                f"{uneven[0][:60]}{' and others' if len(uneven) > 1 else ''}: azimuths do not cover a turn evenly: "
                "what varies once per turn is not averaged."
            )
    if found[-1].left_out:
        notes.append(f"{found[-1].left_out} oscillations of first-order states (air, waves) are left out.")
    return notes


def _uneven(files: Sequence[LinearisedModel]) -> bool:
    """Test whether the azimuths of an operating point leave a part of the turn out."""
    turn = 2.0 * math.pi
    angles = np.sort([one.azimuth % turn for one in files])
    gaps = np.diff([*angles, angles[0] + turn])
    return len(files) < 3 or float(np.max(gaps)) > MAX_GAP_RATIO * turn / len(files)
