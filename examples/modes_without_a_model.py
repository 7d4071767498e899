"""
Modes and shapes without a model
================================

Accelerometers on the floors of a building, unmeasured wind or traffic, and no model. Which modes are there?
"""

import matplotlib.pyplot as plt
import numpy as np

import windsysid as ws
from windsysid.simulation.examples import building

# %%
# Ten minutes of a frame of five storeys whose truth is known, 50 Hz, 1 % of noise.
measured, truth = building()

# %%
# No rate, no order, no band has to be given.
found = ws.oma(measured)
print(found)
print("truth:", ", ".join(f"{f:.3f} Hz {100 * zeta:.2f} %" for f, zeta in truth))

# %%
# The shapes over the height, with ±2σ. A shape is 1 in the channel that moves most.
floors = np.arange(len(measured.channels) + 1)
figure, axes = plt.subplots(1, len(found.modes), sharey=True, figsize=(9, 4), layout="constrained", squeeze=False)
for ax, mode in zip(axes[0], found.modes, strict=True):
    shape = np.concatenate([[0.0], np.real(mode.shape)])
    band = np.concatenate([[0.0], 2.0 * np.asarray(mode.shape_std)])
    ax.errorbar(shape, floors, xerr=band, marker="o", capsize=3)
    ax.axvline(0.0, color="0.7", lw=0.8)
    ax.set_title(f"{mode.frequency.estimate:.3f} Hz")
    ax.set_xlabel("shape")
axes[0, 0].set_ylabel("storey")
plt.show()
