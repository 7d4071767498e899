"""
Blades under wind
=================

A rotor turns in turbulent wind. How stiff and how damped are its blades, when the wind is not measured?
"""

import matplotlib.pyplot as plt

import windsysid as ws

# %%
# 130 s of the scale model. Its blades have 4150 N·m/rad; the air adds damping to them.
record = ws.simulate("verne555", duration=130.0, rate=50.0, loads="wind-feedback", seed=3)

# %%
# The prior is centred 1.2 times off, so that the turbine file is not its own answer.
result = ws.identify(record, "verne555", prior=ws.models.Prior(stiffness=1.2, damping=1.2))
print(result)

# %%
# The damping comes out above the file's: it is the structure's and the air's together.
_, ax = plt.subplots(figsize=(10, 5), layout="constrained")
result.plot(ax)
plt.show()
