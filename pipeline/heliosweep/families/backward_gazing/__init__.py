"""Slopes of mirrors from four camera images of the reflected sun: simulated, of whole fields, and measured.

After P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from heliosweep.config.sweep import ends
from heliosweep.families.modules import ModuleFamily

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.backward_gazing.study import BackwardGazingStudy


class BackwardGazing(ModuleFamily):
    """The family; see `heliosweep.families.family.Family`. Each mode computes in a module of its own name."""

    name = "backward_gazing"
    title = "slopes of mirrors from four camera images of the reflected sun"
    references = ("Defieux, Caliot and Henault (2020), AIP Conf. Proc. 2303, 100002, doi 10.1063/5.0029270",)
    keywords = ("heliostat", "slope error", "canting", "backward gazing")
    headlines = ("relative_error_x_median", "slope_rms_x", "canting_x")

    def mode(self, study: BackwardGazingStudy) -> str:
        """``measured``, ``field``, or ``simulated`` of one heliostat."""
        return "measured" if study.mode == "measured" else "simulated" if study.field is None else "field"

    def module(self, name: str, mode: str = "") -> Any:
        """The module of a mode for ``compute``, else the one that all modes share."""
        return import_module(f"{__name__}.{mode if name == 'compute' else name}")

    def remarks(self, result: xr.Dataset) -> Iterable[str]:
        """What the user should be told of a finished result."""
        said: Iterable[str] = self.module("compute", str(result.attrs["mode"])).remarks(result)
        return said

    def prepare(self, study: BackwardGazingStudy) -> tuple[float, bool]:
        """Load or compile the kernels of the study's methods; seconds it took, and whether something was compiled."""
        from heliosweep.kernels.warm import warm_gazing

        cameras = study.mode == "measured" or "camera" in ends(study.cameras.images)
        return warm_gazing(study.method, cameras=cameras)


FAMILY = BackwardGazing()
