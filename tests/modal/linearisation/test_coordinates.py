"""Multi-blade coordinates of linearised models."""

import math
from pathlib import Path

import numpy as np
import pytest

from tests.modal.linearisation.whirling_rotor import NAMES, Rotor, lin_text
from windsysid.errors import ConfigurationError
from windsysid.modal.linearisation.coordinates import model_coordinates
from windsysid.modal.linearisation.lin_file import read_lin_file


def test_an_isotropic_rotor_is_constant_in_multi_blade_coordinates(tmp_path: Path):
    files = [read_lin_file(path) for path in Rotor(damping=0.1).write(tmp_path, number="{:25.16E}", azimuths=5)]
    coordinates = model_coordinates(files[0])
    first, *others = (coordinates.transformed(one) for one in files)
    assert np.max(np.abs(files[1].A - files[0].A)) > 1.0
    for other in others:
        np.testing.assert_allclose(other, first, atol=1e-10)


def test_states_are_sorted_by_kind_and_whirls_are_unitary(tmp_path: Path):
    (path,) = Rotor().write(tmp_path, azimuths=1)
    coordinates = model_coordinates(read_lin_file(path))
    U = coordinates.whirls()
    np.testing.assert_allclose(U @ np.conj(U).T, np.eye(10), atol=1e-15)
    assert coordinates.rotates
    shares, structural = coordinates.shares(np.full(10, 0.1))
    assert structural == pytest.approx(1.0)
    kinds = {"tower side-side", "platform heave", "edge collective", "edge forward", "edge backward"}
    assert set(shares) == kinds
    assert list(shares.values()) == pytest.approx([0.2] * 5)


@pytest.mark.parametrize(
    ("module", "description", "kind"),
    [
        ("BD", "Node 2 translational displacement in X, m", "flap collective"),
        ("BD", "Node 2 rotational displacement in Z, rad", "torsion collective"),
        ("AD", "blade #, node 3, x1, -", "aerodynamics collective"),
    ],
)
def test_states_of_other_modules_are_sorted_by_blade(tmp_path: Path, module: str, description: str, kind: str):
    path = tmp_path / "a.1.lin"
    rows = [
        f"{b} 0.0 T 1 {f'BD_{b}' if module == 'BD' else module} {description.replace('#', str(b))}" for b in (1, 2, 3)
    ]
    text = lin_text(-np.eye(3), (), 1.0, 0.0).replace("continuous states:        0", "continuous states:        3")
    path.write_text(text.replace("   ---- ----\n", "   ---- ----\n" + "\n".join(rows) + "\n"))
    shares, structural = model_coordinates(read_lin_file(path)).shares(np.array([0.5, 0.25, 0.25]))
    assert next(iter(shares)) == kind
    assert structural == 0.0


def test_rotating_states_of_two_blades_are_refused(tmp_path: Path):
    path = tmp_path / "a.1.lin"
    path.write_text(lin_text(np.eye(8), NAMES[:4], 1.0, 0.0))
    with pytest.raises(ConfigurationError, match=r"blade' of blades 1, 2 and 3, got 1, 2: the transformation is that"):
        model_coordinates(read_lin_file(path))


def test_a_blade_without_its_rate_is_refused(tmp_path: Path):
    path = tmp_path / "a.1.lin"
    path.write_text(
        lin_text(np.eye(10), NAMES, 1.0, math.pi).replace("derivative of 1st edgewise", "derivative of 2nd")
    )
    with pytest.raises(ConfigurationError, match="is of second order: expected the state and its 'First time"):
        model_coordinates(read_lin_file(path))
