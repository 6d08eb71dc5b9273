"""Tables of a finished result: those of a calibration, and of mounts with drawn errors."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import xarray as xr

from heliosweep.families.misalignment.calibration import figures as calibration
from heliosweep.families.misalignment.figures import Spots
from heliosweep.families.misalignment.mount_errors import figures as mount_errors
from heliosweep.report.contents import Table


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Tables of a result; none where its variables have numbers of the whole."""
    shown = Spots(result)
    return chain(calibration.tables(shown), mount_errors.tables(shown))
