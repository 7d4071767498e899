"""
Months of estimates: what drifts, what jumps
============================================

A frequency and a temperature for every record, three months long. Did the structure change, or was it the weather?
"""

from datetime import UTC, datetime

import matplotlib.pyplot as plt
import numpy as np

from windsysid.monitoring.series import RecordBlocks
from windsysid.monitoring.watch import watch

# %%
# One estimate of a stiffness every two hours, known to 0.5 %. It falls by 2 % when a day is warmer by 20 degrees, and
# by 3 % for good after 60 days.
rng = np.random.default_rng(1)
days = np.arange(90 * 12) / 12.0
warmth = 10.0 * np.sin(2.0 * np.pi * days / 90.0) + 5.0 * np.sin(2.0 * np.pi * days) + rng.normal(size=days.size)
logarithm = -0.001 * warmth + np.where(days > 60.0, np.log(0.97), 0.0)
std = np.full((days.size, 1), 0.005)
blocks = RecordBlocks(
    names=("k_x",),
    time=86400.0 * days,
    theta=(logarithm + 0.005 * rng.normal(size=days.size))[:, None],
    std=std,
    logarithmic=(True,),
    reference=(1.4e6,),
    units=("N/m",),
    covariates=warmth[:, None],
    covariate_names=("temperature",),
    begin=datetime(2026, 1, 1, tzinfo=UTC),
)

# %%
# The watch learns the level, its slope with temperature and how much records scatter, and tells a jump from them.
watched = watch(blocks)
print(watched)

_, ax = plt.subplots(figsize=(11, 4), layout="constrained")
watched.plot(ax)
plt.show()
