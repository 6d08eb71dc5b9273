"""Small studies of each mode, blocks replaced, and what is computed of them."""

from typing import Any

import dask
import xarray as xr

from heliosweep import api
from heliosweep.kernels.mounts import ERRORS
from tests.families.studies import study

__all__ = ["CALIBRATION", "CURVES", "MOUNT_ERRORS", "SWEPT", "Content", "computed", "study"]

Content = dict[str, Any]

SITE = {"latitude": 37.4}
CURVES: Content = {
    "family": "misalignment", "site": SITE, "time": {"clock": "solar", "declination": [23.45], "hours": [8]},
    "receiver": {"height": 143, "azimuth": 0, "tilt": 0, "width": 9, "height_extent": 9},
    "heliostats": {"positions": [[-16, 150, 0], [-120, 600, 0]]},
    "error": {
        "source": ["canting", "encoder", "tilt"],
        "axis": ["elevation", "azimuth", "encoder_azimuth"],
        "size": [-12, 0, 12],
    },
}  # fmt: skip
MOUNT_ERRORS: Content = {
    "family": "misalignment", "mode": "mount_errors", "site": SITE,
    "time": {"clock": "solar", "days": [80, 355], "hours": [8.0, 12.5, 16.0]},
    "receiver": {"height": 100, "azimuth": 5, "tilt": -10, "width": 3, "height_extent": 2},
    "heliostats": {"positions": [[-16.0, 150.0, 7.0], [120.0, 90.0, 5.0], [-200.0, 60.0, 12.0]]},
    "mount": {"mirror_offset": 0.5, "axis_offset": 0.3, "pedestal_height": 4, "axis_azimuth": 20},
    "mount_errors": dict(zip(ERRORS, (1.5, -0.8, 0.7, -1.1, 0.9, -0.6), strict=True)),
}  # fmt: skip
CALIBRATION: Content = {
    "family": "misalignment", "mode": "calibration", "site": SITE,
    "time": {"clock": "solar", "days": [81, 172, 355], "hours": [float(hour) for hour in range(8, 17)]},
    "receiver": {"height": 143, "width": 9, "height_extent": 9},
    "heliostats": {"positions": [[-16.0, 150.0, 0.0], [120.0, 300.0, 5.0], [-60.0, 300.0, 2.0]]},
    "mount": {"mirror_offset": 0.5, "axis_offset": 0.2, "pedestal_height": 4, "axis_azimuth": 20},
    "mount_errors": dict(zip(ERRORS, (1.5, -0.8, 0.9, -1.2, 0.6, -0.7), strict=True)),
}  # fmt: skip
SWEPT: Content = {
    **CURVES, "time": {"clock": "solar", "days": [80, 172], "hours": [8, 12, 16]},
    "mount": {"kind": ["azimuth_elevation", "target_aligned"], "mirror_offset": [0, 0.5]},
    "heliostats": {"positions": [[10 * k - 40, 100 + 7 * k, k] for k in range(9)]}, "detectors": {"lines": [[1, 0, 2]]},
    "error": {"source": ["canting", "tilt"], "axis": ["elevation", "azimuth"], "size": [-3, 0, 3]},
}  # fmt: skip


def computed(made: Any, **chunks: int) -> xr.Dataset:
    """The whole result of a study, cut as told."""
    execution = made.execution.model_copy(update={"chunks": chunks})
    with dask.config.set(scheduler="synchronous"):
        return api.build(made.model_copy(update={"execution": execution})).compute()
