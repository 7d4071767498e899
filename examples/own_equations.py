"""
Equations of your own
=====================

Identify a Duffing oscillator from its accelerometer, the force on it measured.

Run:  python examples/own_equations.py
"""

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp

import windsysid as ws
from windsysid.simulation.integrate import integrate

# %%
# The equations, and what the sensor reads.
q, v, force = sp.symbols("q v force", real=True)
m, c, k, cubic = sp.symbols("m c k cubic", positive=True)
acceleration = (force - c * v - k * q - cubic * q**3) / m
duffing = ws.models.Equations(
    name="duffing", states=(q, v), inputs=(), parameters=(m, c, k, cubic), loads=(force,), rates=(v, acceleration)
)
accelerometer = ws.models.Reading("acceleration", acceleration, noise=0.2)  # a guess: it is 0.5, and learned

# %%
# A record: a sweep of the force, and 0.5 m/s² of noise.
truth = {"m": 1.0, "c": 0.2, "k": 40.0, "cubic": 300.0}
time = np.arange(12000) / 200.0
sweep = 10.0 * np.sin(2.0 * np.pi * np.cumsum(np.linspace(0.4, 2.0, time.size)) / 200.0)

model = ws.models.compile_model(duffing, [accelerometer])
response = integrate(model, [truth[name] for name in model.parameters], sweep[:, None], rate=200.0, start=[0.0, 0.0])
noisy = response.readings[:, 0] + 0.5 * np.random.default_rng(1).standard_normal(time.size)
record = ws.Record(time, np.column_stack([sweep, noisy]), ("force", "acceleration"), ("N", "m/s^2"))

# %%
# The answer.
result = ws.models.fit(
    duffing,
    record,
    parameters=[
        ws.models.Parameter("c", 0.1, 0.5),
        ws.models.Parameter("k", 20.0, 1.0),
        ws.models.Parameter("cubic", 100.0, 1.5),
    ],
    values={"m": 1.0},
    sensors=[accelerometer],
    cov=1e-6 * np.eye(2),  # at rest to within a millimetre
)
print(result)
for name in ("c", "k", "cubic"):
    print(f"{name}: {result[name].estimate:.4g}, truth {truth[name]:g}")

_, ax = plt.subplots(figsize=(12.6, 3.6), layout="constrained")
result.plot(ax)
plt.show()
