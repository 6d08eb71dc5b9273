"""
Flux on a cylindrical receiver
==============================

Trace rays from 200 heliostats at noon, first with all mirrors aimed at the middle of the receiver, then with three
aim levels.
"""

import matplotlib.pyplot as plt
import numpy as np

import heliosweep

layout = heliosweep.radial_stagger(clearance=14.0, inner_radius=60.0, heliostats=200)
centres = np.column_stack([layout.x, layout.y, np.full(layout.x.size, 5.0)])
receiver = heliosweep.Cylinder(height=80.0, radius=3.0, height_extent=9.0)
mirrors = {"width": 9.0, "height": 8.0, "slope_error": 1.5, "sun_shape": "limb_darkened"}
noon = {"sun_azimuth": 180.0, "sun_elevation": 53.0, "dni": 900.0, "rays": 4096, "flux_map": (24, 48)}

# %%
# Each aim point is on the receiver surface, at the azimuth of its heliostat. Consecutive heliostats in the list aim at
# different heights.

azimuth = np.arctan2(layout.x, layout.y)
levels = 80.0 + 2.0 * (np.arange(layout.x.size) % 3 - 1)
aims = np.column_stack([3.0 * np.sin(azimuth), 3.0 * np.cos(azimuth), levels])
cases = {
    "one level": heliosweep.trace_field(centres, receiver, **mirrors, **noon),
    "three levels": heliosweep.trace_field(centres, receiver, aim=aims, **mirrors, **noon),
}

# %%
# Three aim levels reduce the peak flux, but some light misses the top and bottom edges of the receiver.

figure, axes = plt.subplots(2, 1, figsize=(7, 5.4), sharex=True, layout="constrained")
top = max(float(light.peak_flux) for light in cases.values())
for panel, (name, light) in zip(axes, cases.items(), strict=True):
    image = panel.imshow(light.flux_map, origin="lower", extent=(0, 360, 75.5, 84.5), aspect="auto", vmax=top)
    arrives = 100 * float(light.intercept_efficiency.mean())
    panel.set(title=f"{name}: peak {float(light.peak_flux):.0f} kW/m², intercept {arrives:.1f} %", ylabel="height [m]")
axes[1].set(xlabel="azimuth on the receiver, clockwise from north [°]")
figure.colorbar(image, ax=axes, label="flux [kW/m²]")
plt.show()
