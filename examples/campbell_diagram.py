"""
Campbell diagram with the modes of a result
===========================================

How far does each mode stay from 1P, 3P and 6P over the operating range, and how sure is that?
"""

import matplotlib.pyplot as plt
import numpy as np

import windsysid as ws

# %%
# A running scale model: accelerometers on tower and blades, and the rotor's azimuth.
record = ws.simulate("verne555", duration=60.0, rate=50.0, seed=1)
result = ws.identify(record, "verne555")

# %%
# The curves come from the identified coefficients, with bands.
diagram = ws.modes(result)
print(diagram)

# %%
# Black: the modes as identified, at the rotor speed of the record.
_, ax = plt.subplots(figsize=(8, 6), layout="constrained")
drawn = diagram.plot(ax)
rpm = 60.0 / (2.0 * np.pi) * result.conditions.rotor_speed
for mode in result.modes:
    drawn.axes[0].plot(rpm, mode.frequency.estimate, "ko", ms=5)
plt.show()
