"""A three-blade rotor on its support by Newton and Euler, integrated at 1 kHz.

The hub moves by (x, y). Blade i hangs on a link at the radius d and the angle θ = ψ + 2π(i−1)/3, and leads by β: it
points along u = θ + β. With its mass m, first moment S and second moment I about the link, t = (−sin u, cos u), and the
link's acceleration a_L = (ẍ, ÿ) + d (−Ω² cos θ, −Ω² sin θ) at constant rotor speed Ω,

    I β̈ + S t·a_L = −k_β β − c_β β̇ − S g cos u + w_β,
    (m_H + 3m) (ẍ, ÿ) + Σ [S β̈ t − S (Ω+β̇)² (cos u, sin u) − m d Ω² (cos θ, sin θ)] − m_H e Ω² (cos ψ_e, sin ψ_e)
        = −k (x, y) − c (ẋ, ẏ) + w.

These are Eqs (11), (12) and (20) of the paper about static equilibrium. The first gives β̈ by (ẍ, ÿ); what is left are
two linear equations. The classical fourth-order Runge–Kutta method takes steps of 1 ms, with loads at its half steps.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["RATE", "Machine", "accelerations", "move"]

Array = NDArray[np.float64]

RATE = 1000
"""Steps per second [Hz]."""


class Machine(NamedTuple):
    """The packaged scale model in numbers of its own, and effects of a real machine.

    Attributes
    ----------
    hub_mass, blade_mass
        [kg], the latter of each blade.
    k_x, c_x, k_y, c_y
        [N/m], [N·s/m].
    k_beta, c_beta
        Of each blade [N·m/rad], [N·m·s/rad].
    hardening
        By how much the support's springs are stiffer 10 mm off rest, as a share.
    blade_hardening
        The same of the blades, 10 mrad off.
    friction
        Dry friction in the support [N].
    play
        Half the gap in the support's springs [m].
    loosens, loosens_at
        By how much the support's springs are softer from a time on, as a share, and when [s].
    speed
        Ω [rad/s].
    """

    hub_mass: float = 7.0
    blade_mass: tuple[float, float, float] = (2.5, 2.5, 2.5)
    k_x: float = 1800.0
    c_x: float = 12.0
    k_y: float = 1650.0
    c_y: float = 11.0
    k_beta: tuple[float, float, float] = (4150.0, 4150.0, 4150.0)
    c_beta: tuple[float, float, float] = (6.0, 6.0, 6.0)
    hardening: float = 0.0
    blade_hardening: float = 0.0
    friction: float = 0.0
    play: float = 0.0
    loosens: float = 0.0
    loosens_at: float = 0.0
    speed: float = 2.0 * np.pi * 1.16
    length: float = 2.5
    width: float = 0.2
    hinge_offset: float = 0.2
    eccentricity: float = 0.01
    eccentricity_angle: float = 0.3
    gravity: float = 9.80665

    @property
    def truth(self) -> dict[str, float]:
        """The coefficients by their names in windsysid; of springs that loosen, the mean of before and after."""
        mean = 1.0 - 0.5 * self.loosens
        found = {"k_x": mean * self.k_x, "c_x": self.c_x, "k_y": mean * self.k_y, "c_y": self.c_y}
        for i in range(3):
            found |= {f"k_beta_{i + 1}": self.k_beta[i], f"c_beta_{i + 1}": self.c_beta[i]}
        return found

    def numbers(self) -> Array:
        """Arguments of the compiled loops."""
        arm = self.hinge_offset + 0.5 * self.length
        own = (self.length**2 + self.width**2) / 12.0
        m = np.array(self.blade_mass)
        return np.concatenate(
            [
                [self.hub_mass, self.k_x, self.c_x, self.k_y, self.c_y, self.hardening / 0.01**2, self.friction],
                [self.play, self.speed, self.hinge_offset, self.eccentricity, self.eccentricity_angle, self.gravity],
                [self.blade_hardening / 0.01**2],
                m, m * arm, m * (own + arm**2), self.k_beta, self.c_beta, [self.loosens, self.loosens_at],
            ]
        )  # fmt: skip


@njit(cache=True)  # type: ignore[untyped-decorator]
def _spring(k: float, q: float, hardening: float, play: float) -> float:
    if play > 0.0:
        q = q - play if q > play else (q + play if q < -play else 0.0)
    return k * q * (1.0 + hardening * q * q)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _accelerations(v: Array, psi: float, q: Array, r: Array, w: Array, a: Array) -> None:
    """Into a (5,): ẍ, ÿ and β̈ at displacements q, velocities r and loads w (5,)."""
    speed, d, gravity = v[8], v[9], v[12]
    total = v[0]
    stiffness = 1.0 - v[29] if v[29] > 0.0 and psi > speed * v[30] else 1.0
    fx = w[0] - _spring(stiffness * v[1], q[0], v[5], v[7]) - v[2] * r[0]
    fy = w[1] - _spring(stiffness * v[3], q[1], v[5], v[7]) - v[4] * r[1]
    if v[6] > 0.0:
        fx -= v[6] * np.tanh(r[0] / 1e-3)
        fy -= v[6] * np.tanh(r[1] / 1e-3)
    fx += v[0] * v[10] * speed**2 * np.cos(psi + v[11])
    fy += v[0] * v[10] * speed**2 * np.sin(psi + v[11])
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(3):
        m, s, inertia = v[14 + i], v[17 + i], v[20 + i]
        theta = psi + 2.0 * np.pi * i / 3.0
        u = theta + q[2 + i]
        sin, cos = np.sin(u), np.cos(u)
        moment = (
            w[2 + i]
            - _spring(v[23 + i], q[2 + i], v[13], 0.0)
            - v[26 + i] * r[2 + i]
            - s * gravity * cos
            - s * d * speed**2 * np.sin(q[2 + i])
        )
        a[2 + i] = moment / inertia
        turning = (speed + r[2 + i]) ** 2
        fx += s * (a[2 + i] * sin + turning * cos) + m * d * speed**2 * np.cos(theta)
        fy += s * (-a[2 + i] * cos + turning * sin) + m * d * speed**2 * np.sin(theta)
        total += m
        share = s * s / inertia
        xx -= share * sin * sin
        yy -= share * cos * cos
        xy += share * sin * cos
    xx += total
    yy += total
    determinant = xx * yy - xy * xy
    a[0] = (fx * yy - fy * xy) / determinant
    a[1] = (fy * xx - fx * xy) / determinant
    for i in range(3):
        u = psi + 2.0 * np.pi * i / 3.0 + q[2 + i]
        a[2 + i] += v[17 + i] / v[20 + i] * (a[0] * np.sin(u) - a[1] * np.cos(u))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _move(v: Array, loads: Array, step: float, q: Array, r: Array, out: Array) -> None:
    k = np.empty((4, 5))
    s = np.empty((4, 5))
    for n in range(len(out)):
        t = n * step
        _accelerations(v, v[8] * t, q, r, loads[2 * n], k[0])
        out[n] = k[0]
        s[0] = r
        for stage in range(1, 4):
            part = step if stage == 3 else 0.5 * step
            s[stage] = r + part * k[stage - 1]
            at = 2 * n + (2 if stage == 3 else 1)
            _accelerations(v, v[8] * (t + part), q + part * s[stage - 1], s[stage], loads[at], k[stage])
        q += step / 6.0 * (s[0] + 2.0 * s[1] + 2.0 * s[2] + s[3])
        r += step / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3])


def accelerations(machine: Machine, psi: float, q: Array, rates: Array, loads: Array) -> Array:
    """ẍ, ÿ [m/s²] and β̈ [rad/s²] (5,) at azimuth ψ [rad], displacements, velocities and loads (5,), SI."""
    found = np.empty(5)
    _accelerations(machine.numbers(), psi, q, rates, loads, found)
    return found


def move(machine: Machine, loads: Array, start: Array | None = None) -> Array:
    """Accelerations (n, 5) at `RATE`, from loads [N, N·m] at twice that rate (2n + 1, 5), ψ = 0 at first.

    `start` holds the displacements [m, rad] at first (5,), rest by default.
    """
    q = np.zeros(5) if start is None else np.array(start, dtype=np.float64)
    found = np.empty((len(loads) // 2, 5))
    _move(machine.numbers(), np.ascontiguousarray(loads), 1.0 / RATE, q, np.zeros(5), found)
    return found
