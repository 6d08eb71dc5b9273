"""Heliostat layouts: the CSV file, the radial-stagger generator and the checks before a run.

NumPy only, so that ``validate`` can read and check a layout without loading the numerical libraries.
"""

from heliosweep.layouts.csv import read_csv, write_csv
from heliosweep.layouts.layout import MAX_HELIOSTATS, Layout, check_layout, too_close
from heliosweep.layouts.radial_stagger import Zone, radial_stagger

__all__ = ["MAX_HELIOSTATS", "Layout", "Zone", "check_layout", "radial_stagger", "read_csv", "too_close", "write_csv"]
