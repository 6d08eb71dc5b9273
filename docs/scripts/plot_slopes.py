"""
Slopes of a mirror from four images
===================================

Simulate images of the sun's reflection in a mirror, taken by four cameras near the target, and compute the slopes of
the mirror from these images.
"""

import matplotlib.pyplot as plt
import numpy as np

import heliosweep

scene = heliosweep.gazing_scene(sun_azimuth=30.0, sun_elevation=60.0, target_azimuth=0.0, target_elevation=44.0)
y = z = np.linspace(-3.0, 3.0, 61)
true_x = 0.3 * np.sin(2.0 * np.pi * y / 3.0) * np.ones((z.size, 1))  # mrad
true_y = 0.2 * np.cos(2.0 * np.pi * z / 4.0)[:, None] * np.ones(y.size)
images = heliosweep.render_images(scene, true_x, true_y, y, z)
noisy = images + np.random.default_rng(1).normal(0.0, 0.004, images.shape)

figure, axes = plt.subplots(1, 4, figsize=(9, 2.8), sharey=True, layout="constrained")
for panel, image in zip(axes, noisy, strict=True):
    shown = panel.pcolormesh(y, z, image, cmap="gray")
    panel.set(xlabel="y [m]", aspect="equal")
axes[0].set(ylabel="z [m]")
figure.colorbar(shown, ax=axes, label="brightness")

# %%
# Compute the slopes from the four images, and the error of the horizontal slope.

slopes = heliosweep.reconstruct_slopes(scene, noisy)
panels = {"horizontal": slopes.slope_x, "vertical": slopes.slope_y, "horizontal error": slopes.slope_x - true_x}
figure, axes = plt.subplots(1, 3, figsize=(9, 3.2), sharey=True, layout="constrained")
for panel, (name, values) in zip(axes, panels.items(), strict=True):
    shown = panel.pcolormesh(y, z, values, cmap="RdBu_r", vmin=-0.35, vmax=0.35)
    panel.set(title=name, xlabel="y [m]", aspect="equal")
axes[0].set(ylabel="z [m]")
figure.colorbar(shown, ax=axes, label="slope [mrad]")
plt.show()
