"""
Spot displacement caused by an error
====================================

Compute the path of the spot on the receiver as an error increases, for three types of error.
"""

import matplotlib.pyplot as plt
import numpy as np

import heliosweep

size = np.linspace(-20.0, 20.0, 81)  # mrad
place = {"pivot": (60.0, 100.0, 4.0), "aim": 50.0, "width": 5.0, "height_extent": 4.0}
errors = [("canting", "azimuth"), ("encoder", "encoder_azimuth"), ("tilt", "elevation")]

# %%
# Each curve is part of a conic. The tracking tolerance is the smallest error that moves the spot out of the aperture.

figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
for source, axis in errors:
    curve = heliosweep.deviation_curve(150.0, 40.0, size=size, source=source, axis=axis, **place)
    tolerance = float(curve.tracking_tolerance)
    axes.plot(curve.spot_y, curve.spot_z, label=f"{source}, {axis.replace('_', ' ')}: {tolerance:.1f} mrad")
axes.add_patch(plt.Rectangle((-2.5, -2.0), 5.0, 4.0, fill=False, linestyle="--"))
axes.set(xlabel="horizontal position on the receiver [m]", ylabel="vertical position [m]", aspect="equal")
axes.legend(title="tracking tolerance", loc="lower right")
plt.show()
