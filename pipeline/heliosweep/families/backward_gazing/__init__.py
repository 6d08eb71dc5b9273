"""Slopes of mirrors from four camera images of the reflected sun: simulated, of whole fields, and measured.

After P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heliosweep.families.family import Family

if TYPE_CHECKING:
    import xarray as xr


def _mode(mode: str) -> Any:
    """Return the module of a mode."""
    return import_module(f"{__name__}.{'measured' if mode == 'measured' else 'simulated'}")


def _remarks(result: xr.Dataset) -> Iterable[str]:
    found: Iterable[str] = _mode(str(result.attrs["mode"])).remarks(result)
    return found


FAMILY = Family(
    "backward_gazing",
    "slopes of mirrors from four camera images of the reflected sun",
    f"{__name__}.study:BackwardGazingStudy",
    lambda study: _mode(study.mode).computation(study),
    example=Path(__file__).with_name("default.yaml"),
    references=("Defieux, Caliot and Henault (2020), AIP Conf. Proc. 2303, 100002, doi 10.1063/5.0029270",),
    keywords=("heliostat", "slope error", "canting", "backward gazing"),
    headlines=("relative_error_x_median", "slope_rms_x", "canting_x"),
    figures=f"{__name__}.figures:figures",
    remarks=_remarks,
)
