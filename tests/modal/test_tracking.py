"""Modes linked from speed to speed."""

import numpy as np

from windsysid.modal.analysis import ModalSpectrum
from windsysid.modal.tracking import bends, link

SPEEDS = np.linspace(1.0, 2.0, 11)


def spectrum(speed):
    """Modes at 5 and 3.5 Ω rad/s, which cross at Ω = 1.43; the first goes with θ."""
    exponents = np.array([-0.1 + 5.0j, -0.2 + 3.5j * speed])
    order = np.argsort(np.abs(exponents))
    names = np.array(["tower x", "lag forward"])[order]
    return ModalSpectrum(
        exponents[order],
        tuple(names),
        np.eye(2, dtype=np.complex128)[order],
        np.array([[1j], [0j]])[order],
        -0.1,
        "Coleman",
    )


def test_modes_that_cross_keep_their_curves():
    curves = link([spectrum(speed) for speed in SPEEDS], SPEEDS, 5, np.array([[0.04]]))
    tower, lag = sorted(curves, key=lambda curve: curve.name, reverse=True)
    np.testing.assert_allclose(tower.frequency, np.hypot(0.1, 5.0) / (2 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(lag.frequency, np.hypot(0.2, 3.5 * SPEEDS) / (2 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(tower.frequency_std, 0.2 * 5.0 / np.hypot(0.1, 5.0) / (2 * np.pi), rtol=1e-12)
    np.testing.assert_array_equal(lag.frequency_std, 0.0)


def test_straight_curves_do_not_bend_and_a_jump_does():
    curves = link([spectrum(speed) for speed in SPEEDS], SPEEDS, 5, np.zeros((1, 1)))
    assert not bends([curve for curve in curves if curve.name == "tower x"], SPEEDS)
    ends = [spectrum(speed) for speed in SPEEDS[:6]]
    ends += [
        one._replace(**{k: getattr(one, k)[:1] for k in ("exponents", "names", "shapes", "slopes")})
        for one in map(spectrum, SPEEDS[6:])
    ]
    assert bends(link(ends, SPEEDS, 2, np.zeros((1, 1))), SPEEDS)
