"""Batch studies of solar-concentrator tracking and optics: one YAML file in, one NetCDF data set out."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"
__all__ = [
    "Cylinder",
    "HeliosweepError",
    "PlanError",
    "Rectangle",
    "RunInterrupted",
    "StudyError",
    "__version__",
    "annual_energy",
    "availability",
    "build",
    "calibrate_mount",
    "capital_cost",
    "choose_aims",
    "comparison_page",
    "detector_inversion",
    "deviation_curve",
    "dish_intercept",
    "download_weather",
    "efficiency_table",
    "energy_losses",
    "error_budget",
    "error_changes",
    "exceedance",
    "field_efficiency",
    "field_scene",
    "flux_limited_aims",
    "flux_maps",
    "gazing_scene",
    "grid_slopes",
    "hflcal",
    "horizon_elevation",
    "image_radius",
    "layout_of",
    "levelized_cost",
    "load",
    "logspace",
    "monthly_sums",
    "mount_angles",
    "mount_spots",
    "open_result",
    "pack_result",
    "plan",
    "plant_electricity",
    "radial_stagger",
    "read_layout",
    "read_paint",
    "read_paint_spots",
    "read_slope_map",
    "receiver_heat",
    "reconstruct_slopes",
    "render_images",
    "run",
    "save",
    "status",
    "study",
    "sun_position",
    "sun_position_solar",
    "sweep",
    "to_frame",
    "tolerable_tilt",
    "tower_electricity",
    "trace_field",
    "trace_year",
    "tracking_error",
    "tracking_factor",
    "transmittance",
    "write_corrections",
    "write_csv",
    "write_layout",
    "write_paint_spots",
    "write_paint_study",
    "write_table",
    "write_xlsx",
]

if TYPE_CHECKING:
    from heliosweep.aiming import choose_aims, flux_limited_aims
    from heliosweep.api import (
        build,
        comparison_page,
        efficiency_table,
        flux_maps,
        load,
        open_result,
        plan,
        plant_electricity,
        run,
        save,
        status,
        study,
    )
    from heliosweep.config.values import logspace, sweep
    from heliosweep.dish import dish_intercept, tolerable_tilt, tracking_error, tracking_factor
    from heliosweep.economics import capital_cost, levelized_cost
    from heliosweep.energy import (
        annual_energy,
        availability,
        energy_losses,
        error_budget,
        exceedance,
        monthly_sums,
        receiver_heat,
        transmittance,
    )
    from heliosweep.errors import HeliosweepError, PlanError, RunInterrupted, StudyError
    from heliosweep.families.field_efficiency.light_files import read_slope_map
    from heliosweep.field import field_efficiency
    from heliosweep.gazing import gazing_scene, grid_slopes, reconstruct_slopes, render_images
    from heliosweep.layouts.paint import read_paint, read_paint_spots
    from heliosweep.layouts.patterns import radial_stagger
    from heliosweep.light import Cylinder, Rectangle, field_scene, hflcal, image_radius, trace_field, trace_year
    from heliosweep.mounts import (
        calibrate_mount,
        detector_inversion,
        deviation_curve,
        error_changes,
        mount_angles,
        mount_spots,
    )
    from heliosweep.share.archive import pack_result
    from heliosweep.share.electricity import tower_electricity
    from heliosweep.share.fields import (
        layout_of,
        read_layout,
        write_corrections,
        write_layout,
        write_paint_spots,
        write_paint_study,
    )
    from heliosweep.share.frames import to_frame, write_csv, write_xlsx
    from heliosweep.share.sam import write_table
    from heliosweep.share.weather import download_weather
    from heliosweep.sun import horizon_elevation, sun_position, sun_position_solar

#: Modules of public names that are not in `api`.
_MODULES = {
    **dict.fromkeys(("HeliosweepError", "PlanError", "RunInterrupted", "StudyError"), "errors"),
    **dict.fromkeys(("logspace", "sweep"), "config.values"),
    **dict.fromkeys(("layout_of", "read_layout", "write_corrections", "write_layout"), "share.fields"),
    **dict.fromkeys(("write_paint_spots", "write_paint_study"), "share.fields"),
    **dict.fromkeys(("read_paint", "read_paint_spots"), "layouts.paint"),
    "radial_stagger": "layouts.patterns",
    **dict.fromkeys(("to_frame", "write_csv"), "share.frames"),
    **dict.fromkeys(
        ("Cylinder", "Rectangle", "field_scene", "hflcal", "image_radius", "trace_field", "trace_year"), "light"
    ),
    **dict.fromkeys(("dish_intercept", "tolerable_tilt", "tracking_error", "tracking_factor"), "dish"),
    **dict.fromkeys(("choose_aims", "flux_limited_aims"), "aiming"),
    **dict.fromkeys(("gazing_scene", "grid_slopes", "reconstruct_slopes", "render_images"), "gazing"),
    "read_slope_map": "families.field_efficiency.light_files",
    **dict.fromkeys(
        ("calibrate_mount", "detector_inversion", "deviation_curve", "error_changes", "mount_angles", "mount_spots"),
        "mounts",
    ),
    **dict.fromkeys(
        (
            "annual_energy",
            "availability",
            "energy_losses",
            "error_budget",
            "exceedance",
            "monthly_sums",
            "receiver_heat",
            "transmittance",
        ),
        "energy",
    ),
    **dict.fromkeys(("capital_cost", "levelized_cost"), "economics"),
    "field_efficiency": "field",
    "tower_electricity": "share.electricity",
    **dict.fromkeys(("horizon_elevation", "sun_position", "sun_position_solar"), "sun"),
    "write_table": "share.sam",
    "download_weather": "share.weather",
    "write_xlsx": "share.frames",
    "pack_result": "share.archive",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that the command line starts quickly."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES.get(name, 'api')}"), name)


def _accessor(dataset: Any) -> Any:
    return import_module(f"{__name__}.accessor").HeliosweepAccessor(dataset)


if "xarray" in sys.modules and not hasattr(sys.modules["xarray"].Dataset, "heliosweep"):
    # If xarray is already imported, register the accessor now. Importing xarray here would be slow.
    sys.modules["xarray"].register_dataset_accessor("heliosweep")(_accessor)


def __dir__() -> list[str]:
    """List all public names, including those that are not imported yet."""
    return __all__
