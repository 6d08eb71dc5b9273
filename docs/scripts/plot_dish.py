"""
A dish on a tilted axis
=======================

Compute the effective tracking factor of a dish with a tilted azimuth axis, and the maximum tilt for a required factor.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import heliosweep

times = pd.date_range("2026-06-21T06:00", "2026-06-21T18:00", freq="5min", tz="Etc/GMT-8")
sun = heliosweep.sun_position(times, latitude=38.0, longitude=114.0)
sun = sun.where(sun.sun_elevation > 5.0, drop=True)
tilt = np.linspace(0.0, 0.3, 31)  # deg
directions = {"north or south": 0.0, "east or west": 90.0}

# %%
# The tracking factor decreases linearly with the tilt angle and depends on the tilt direction.

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for name, azimuth in directions.items():
    factor = heliosweep.tracking_factor(sun.sun_azimuth, sun.sun_elevation, tilt, azimuth, tolerance=4.0)
    most = heliosweep.tolerable_tilt(sun.sun_azimuth, sun.sun_elevation, 0.8, azimuth, tolerance=4.0)
    axes.plot(tilt, factor, label=f"tilt towards {name}: 0.8 at {most:.3f}°")
axes.axhline(0.8, color="0.6", linewidth=0.8)
axes.set(xlabel="tilt of the azimuth axis [°]", ylabel="effective tracking factor")
axes.legend()
plt.show()
