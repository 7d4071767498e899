"""Bring your own equations: identify a Duffing oscillator from its accelerometer.

Run:  python examples/own_equations.py
"""

from dataclasses import dataclass

import numpy as np
import sympy as sp

import windsysid as ws
from windsysid.simulate import integrate

q, v, f = sp.symbols("q v f", real=True)
m, c, k, cubic = sp.symbols("m c k cubic", real=True, positive=True)
acceleration = (f - c * v - k * q - cubic * q**3) / m
duffing = ws.Equations(
    name="duffing", states=(q, v), inputs=(), parameters=(m, c, k, cubic), loads=(f,), rates=(v, acceleration)
)


@dataclass(frozen=True)
class Accelerometer:
    """A sensor of one's own: its channel, what it reads, its noise and its bias."""

    channel: str
    expression: sp.Expr
    noise: float
    bias: float = 0.0


truth = {"m": 1.0, "c": 0.2, "k": 40.0, "cubic": 300.0}
sensors = [Accelerometer("acceleration", acceleration, noise=0.5)]
rate, samples = 50.0, 6000
rng = np.random.default_rng(1)
force = 10.0 * np.sin(2.0 * np.pi * np.cumsum(np.linspace(0.4, 2.0, samples)) / rate)[:, None]

model = ws.compile_model(duffing, sensors)
response = integrate(model, [truth[name] for name in model.parameters], force, rate=rate, start=[0.0, 0.0])
readings = response.readings + 0.5 * rng.standard_normal(response.readings.shape)

statespace = ws.compose(
    duffing,
    rate=rate,
    values=truth,
    parameters=[ws.Parameter(name, 1.2 * truth[name], 0.3) for name in ("c", "k", "cubic")],
    sensors=sensors,
    cov=np.diag([1e-6, 1e-6]),
)
belief, info = ws.EKF.run(statespace, ws.EKF.init(statespace), force, readings)
for i, parameter in enumerate(statespace.parameters, start=2):
    low, value, high = (parameter.physical(info.mean[-1, i] + s * info.std[-1, i]) for s in (-2.0, 0.0, 2.0))
    print(f"{parameter.name:6} {value:8.3f}   ±2σ {low:8.3f} … {high:8.3f}   truth {truth[parameter.name]:g}")
