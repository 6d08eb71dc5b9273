"""
Efficiency of a field over a day
================================

Compute the cosine, shading and blocking efficiencies of 200 heliostats from sunrise to sunset. Shadows are computed
exactly, as unions of polygons.
"""

import matplotlib.pyplot as plt
import pandas as pd

import heliosweep

layout = heliosweep.radial_stagger(clearance=14.0, inner_radius=60.0, heliostats=200)
field = pd.DataFrame({"x": layout.x, "y": layout.y, "z": 5.0})
times = pd.date_range("2026-03-20T06:00", "2026-03-20T18:00", freq="30min", tz="Etc/GMT-1")
sun = heliosweep.sun_position(times, latitude=37.09, longitude=-2.36)
light = heliosweep.field_efficiency(field, sun.sun_azimuth, sun.sun_elevation, width=9.0, height=8.0, aim=80.0)

# %%
# Plot the mean efficiencies of the field. Shading causes the largest loss when the sun is low.

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for name in ("cosine", "shading", "blocking", "optical"):
    mean = light[f"{name}_efficiency"].mean("heliostat")
    axes.plot(times.hour + times.minute / 60, 100 * mean, label=name)
axes.set(xlabel="local time [h]", ylabel="efficiency [%]", ylim=(0, 102))
axes.legend()

# %%
# Plot the optical efficiency of each heliostat at 9:00. Heliostats west of the tower, opposite the sun, have a higher
# cosine efficiency.

morning = light.optical_efficiency[times.hour == 9][0]
figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
points = axes.scatter(layout.x, layout.y, c=100 * morning, s=14)
axes.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
figure.colorbar(points, label="optical efficiency [%]")
plt.show()
