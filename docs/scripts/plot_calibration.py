"""
Calibration of a heliostat
==========================

Estimate the errors of a heliostat mount from spots on a target, and compute the commands that correct these errors.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import heliosweep

times = pd.date_range("2026-06-21T07:00", "2026-06-21T17:00", freq="30min", tz="Etc/GMT-1")
sun = heliosweep.sun_position(times, latitude=37.09, longitude=-2.36)
suns = sun.sun_azimuth, sun.sun_elevation
place = {"pivot": (45.0, 150.0, 4.0), "aim": 100.0}
# true mount errors [mrad]
truth = {"azimuth_reference": 3.0, "elevation_reference": -1.0, "tilt_about_north": -1.5, "tilt_about_east": 0.5}
spots = heliosweep.mount_spots(*suns, errors=truth, **place)
noise = np.random.default_rng(1).normal(0.0, 0.05, (2, times.size))  # m
measured = spots.spot_y + noise[0], spots.spot_z + noise[1]

# %%
# Estimate the mount errors and their standard errors by robust least squares.

mount = heliosweep.calibrate_mount(*suns, *measured, **place)
table = mount[["estimated_error", "standard_error"]].to_pandas()
print(table.assign(true=pd.Series(truth)).round(2))

# %%
# With the corrected commands, the spots hit the aim point.

after = heliosweep.mount_spots(*suns, errors=truth, corrected=mount.estimated_error, **place)
figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
axes.plot(*measured, "o", label="measured")
axes.plot(after.spot_y, after.spot_z, ".", label="after calibration")
axes.plot(0, 0, "k+", markersize=12, label="aim point")
axes.set(xlabel="horizontal position on the target [m]", ylabel="vertical position [m]", aspect="equal")
axes.legend()
plt.show()
