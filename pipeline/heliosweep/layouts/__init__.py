"""Heliostat layouts: the CSV file, the generators with their ground, and the checks before a run.

NumPy only, so that ``validate`` can read and check a layout without loading the numerical libraries; shapely, SciPy
and xarray are loaded if a layout names polygons or a grid of heights.
"""

from heliosweep.layouts.layout import MAX_HELIOSTATS, Layout, check_layout, read_csv, too_close, write_csv
from heliosweep.layouts.patterns import radial_stagger

__all__ = ["MAX_HELIOSTATS", "Layout", "check_layout", "radial_stagger", "read_csv", "too_close", "write_csv"]
