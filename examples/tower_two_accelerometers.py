"""
Frequency and damping of a tower from two accelerometers
=========================================================

Ten minutes of a running turbine, two accelerometers at the tower top. What are the tower's modes, and how sure is that?
"""

import matplotlib.pyplot as plt

import windsysid as ws

# %%
# A record. Your own is read by ``ws.read_record("FILE.csv")``.
record = ws.simulate("tower", duration=600.0, rate=20.0, seed=1)

# %%
# The turbine file says where the search begins. The answer begins with frequency and damping of each mode, their
# bands of ±2σ, the distance from nP, and whether the result is to be trusted.
result = ws.identify(record, "tower")
print(result)

# %%
# Each coefficient with its band, with the prior and the turbine file.
_, ax = plt.subplots(figsize=(10, 3), layout="constrained")
result.plot(ax)
plt.show()
