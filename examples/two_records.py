"""
Is my tower softer than last year?
==================================

A record of last year and one of this year, by the same sensors. What moved, and how sure is that?
"""

import matplotlib.pyplot as plt

import windsysid as ws

# %%
# In between, the side-side stiffness fell by 3 %.
turbine = ws.load_turbine("tower")
softer = turbine.with_values({"k_side_side": 0.97 * turbine.values["k_side_side"]})
last_year = ws.identify(ws.simulate(turbine, duration=600.0, rate=20.0, seed=1), turbine)
this_year = ws.identify(ws.simulate(softer, duration=600.0, rate=20.0, seed=2), turbine)

# %%
# The prior, which both results share, does not count: only what the records themselves say.
moved = ws.compare(last_year, this_year)
print(moved)

_, ax = plt.subplots(figsize=(12, 4), layout="constrained")
moved.plot(ax)
plt.show()
