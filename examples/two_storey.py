"""
Storeys of a frame on shaking ground
====================================

A two-storey shear frame: storey stiffness and damping from an accelerometer on each floor.

Run:  python examples/two_storey.py [FILE]

FILE holds the ground acceleration under a heading such as "time [s],ground [g]", El Centro for instance. Without it
the ground is made up. Frames of this kind: Yang et al. 2006, https://doi.org/10.1002/stc.84.
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
# The frame, its state relative to the ground.
x_1, x_2, v_1, v_2, ground = sp.symbols("x_1 x_2 v_1 v_2 ground", real=True)
m_1, m_2, k_1, k_2, c_1, c_2 = sp.symbols("m_1 m_2 k_1 k_2 c_1 c_2", positive=True)
lower = k_1 * x_1 + c_1 * v_1
upper = k_2 * (x_2 - x_1) + c_2 * (v_2 - v_1)
first, second = (upper - lower) / m_1, -upper / m_2  # absolute accelerations
frame = ws.models.Equations(
    "two_storey",
    states=(x_1, x_2, v_1, v_2),
    inputs=(ground,),
    parameters=(m_1, m_2, k_1, k_2, c_1, c_2),
    loads=(),
    rates=(v_1, v_2, first - ground, second - ground),
)


def accelerometers(noise: float) -> list[ws.models.Reading]:
    """One on each floor."""
    return [ws.models.Reading("floor_1", first, noise), ws.models.Reading("floor_2", second, noise)]


# %%
# What is recorded: the ground, and both floors with 5 % noise.
truth = {"m_1": 1.0, "m_2": 1.0, "k_1": 12.0, "k_2": 10.0, "c_1": 0.6, "c_2": 0.5}
shaken = shaken_ground(sys.argv[1] if len(sys.argv) > 1 else None)
model = ws.models.compile_model(frame, accelerometers(1.0))
p = [truth[name] for name in model.parameters]
response = integrate(model, p, shaken["ground"][:, None], rate=shaken.rate, start=np.zeros(4), substeps=20)
noise = 0.05 * response.readings.std(axis=0)
noisy = response.readings + noise * np.random.default_rng(0).standard_normal(response.readings.shape)
record = shaken.with_channels({"floor_1": (noisy[:, 0], "m/s^2"), "floor_2": (noisy[:, 1], "m/s^2")})

# %%
# Priors far off, and the noise a guess.
result = ws.models.fit(
    frame,
    record,
    parameters=[ws.models.Parameter(name, 2.0, 1.5) for name in ("k_1", "k_2")]
    + [ws.models.Parameter(name, 0.2, 0.5, logarithmic=False) for name in ("c_1", "c_2")],
    values={"m_1": 1.0, "m_2": 1.0},
    sensors=accelerometers(0.1),  # a guess of the noise; it is learned
    cov=1e-6 * np.eye(4),  # at rest to within a millimetre
)
print(result)
print("truth:", ", ".join(f"{name} {value:g}" for name, value in truth.items()))

_, ax = plt.subplots(figsize=(12.6, 6.9), layout="constrained")
result.plot(ax)
plt.show()
