"""
Annual energy and losses
========================

Compute the annual energy on a receiver under clear skies, and the energy lost at each stage.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import heliosweep

layout = heliosweep.radial_stagger(clearance=14.0, inner_radius=60.0, heliostats=200)
centres = np.column_stack([layout.x, layout.y, np.full(layout.x.size, 5.0)])
receiver = heliosweep.Cylinder(height=80.0, radius=1.8, height_extent=5.0)
mirrors = {"width": 9.0, "height": 8.0, "slope_error": 2.0}

# %%
# Compute each hour of every third day, using the direct normal irradiance of Meinel's clear-sky model.

times = pd.date_range("2026-01-01T00:30", "2026-12-31T23:30", freq="1h", tz="Etc/GMT-1")
times = times[times.day_of_year % 3 == 0]
sun = heliosweep.sun_position(times, latitude=37.09, longitude=-2.36)
sun = sun.isel(time=np.flatnonzero(sun.sun_elevation > 5.0))
air_mass = 1.0 / np.sin(np.radians(sun.sun_elevation))
dni = 1361.0 * 0.7 ** (air_mass**0.678)
light = heliosweep.trace_field(centres, receiver, sun.sun_azimuth, sun.sun_elevation, rays=64, **mirrors)

# %%
# The stages are in the order of the light path. The sum of all losses is the incident energy minus the received energy.

chain = {
    "cosine": light.cosine_efficiency,
    "shading": light.shading_efficiency,
    "blocking": light.blocking_efficiency,
    "reflection": 0.9,
    "attenuation": heliosweep.transmittance(np.hypot(layout.x, layout.y)[None, :]),
    "spillage": light.intercept_efficiency,
}
year = heliosweep.annual_energy(dni, 3.0, chain, area=72.0)
incident = float(year.incident_energy.sum()) / 1000
losses = year.loss.sum("heliostat").sel(stage=list(chain)).to_series() / 1000

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
left = incident - losses.cumsum()
axes.bar(["incident", *losses.index, "received"], [incident, *losses, left.iloc[-1]], bottom=[0, *left, 0])
axes.set(xlabel="stage", ylabel="energy [GWh]")
axes.tick_params(axis="x", rotation=30)
plt.show()
