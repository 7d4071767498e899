"""
A hysteretic spring on shaking ground
=====================================

A mass on a hysteretic spring (Bouc–Wen): stiffness, damping and the shape of its loops from one
accelerometer.

Run:  python examples/bouc_wen.py [FILE]

FILE holds the ground acceleration under a heading such as "time [s],ground [g]", El Centro for instance. Without it
the ground is made up. Source: Wu & Smyth 2007, https://doi.org/10.1002/stc.186.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp
from scipy.signal import bilinear, lfilter

import windsysid as ws
from windsysid.simulation.integrate import integrate


def shaken_ground(file: str | None) -> ws.Record:
    """The channel ``ground`` [m/s²] of a file; without a file, an earthquake after Kanai and Tajimi."""
    if file is not None:
        record = ws.read_record(file)
        return ws.Record(record.time, record.values[:, :1], ("ground",), ("m/s^2",))
    corner, damping = 15.0, 0.6  # of firm soil: rad/s; Tajimi, Proc. 2nd WCEE, 1960
    time = np.arange(1500) / 50.0
    soil = bilinear([2.0 * damping * corner, corner**2], [1.0, 2.0 * damping * corner, corner**2], 50.0)
    shaken = lfilter(*soil, np.random.default_rng(0).standard_normal(time.size)) * time * np.exp(-time / 4.0)
    return ws.Record(time, (3.0 * shaken / np.max(np.abs(shaken)))[:, None], ("ground",), ("m/s^2",))


# %%
# m ẍ + c ẋ + k z = −m a_g; x is relative to the ground, the accelerometer is not
x, v, z, ground = sp.symbols("x v z ground", real=True)
m, k, c, beta, gamma, n = sp.symbols("m k c beta gamma n", positive=True)
absolute = -(c * v + k * z) / m
hysteresis = v - beta * abs(v) * abs(z) ** (n - 1) * z - gamma * v * abs(z) ** n
spring = ws.models.Equations(
    "bouc_wen",
    states=(x, v, z),
    inputs=(ground,),
    parameters=(m, k, c, beta, gamma, n),
    loads=(),
    rates=(v, absolute - ground, hysteresis),
)

# %%
# What is recorded: the ground, and the mass with 5 % noise
truth = {"m": 1.0, "k": 9.0, "c": 0.3, "beta": 2.0, "gamma": 1.0, "n": 2.0}
shaken = shaken_ground(sys.argv[1] if len(sys.argv) > 1 else None)
strong = shaken["ground"] * 49.0 / np.max(np.abs(shaken["ground"]))  # to a peak of 5 g: fat loops
model = ws.models.compile_model(spring, [ws.models.Reading("acceleration", absolute, 1.0)])
p = [truth[name] for name in model.parameters]
response = integrate(model, p, strong[:, None], rate=shaken.rate, start=np.zeros(3), substeps=20)
exact = response.readings[:, 0]
noisy = exact + 0.05 * np.std(exact) * np.random.default_rng(0).standard_normal(exact.size)
record = shaken.with_channels({"ground": (strong, "m/s^2"), "acceleration": (noisy, "m/s^2")})

# %%
# Priors: bad starts, known to be bad; the noise is a guess, and learned
result = ws.models.fit(
    spring,
    record,
    parameters=[
        ws.models.Parameter("k", 5.0, 1.5),
        ws.models.Parameter("c", 0.2, 0.5, logarithmic=False),
        ws.models.Parameter("beta", 0.5, 1.5),
        ws.models.Parameter("gamma", 0.5, 1.5),
        ws.models.Parameter("n", 1.1, 1.0),
    ],
    values={"m": 1.0},
    sensors=[ws.models.Reading("acceleration", absolute, noise=0.3)],
    cov=1e-6 * np.eye(3),  # at rest to within a millimetre
)
print(result)
print("truth:", ", ".join(f"{name} {value:g}" for name, value in truth.items()))

_, ax = plt.subplots(figsize=(12.6, 6.9), layout="constrained")
result.plot(ax)
plt.show()
