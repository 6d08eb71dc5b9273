"""Heliostat layouts: CSV files, generators with their ground data, and checks before a run.

These modules import only NumPy, so that ``validate`` can check a layout without loading other numerical libraries.
Shapely, SciPy and xarray are loaded only if a layout has polygons or a grid of ground heights.
"""

from heliosweep.layouts.layout import MAX_HELIOSTATS, Layout, check_layout, read_csv, too_close, write_csv
from heliosweep.layouts.patterns import radial_stagger

__all__ = ["MAX_HELIOSTATS", "Layout", "check_layout", "radial_stagger", "read_csv", "too_close", "write_csv"]
