"""The same bytes of a result, however the work is cut and wherever it is done."""

from typing import Any

import numpy as np
import pytest

from heliosweep import api
from heliosweep.errors import PlanError
from heliosweep.kernels.mounts import ERRORS
from heliosweep.layouts import resolve
from heliosweep.store.folder import result_digest
from tests.conftest import SMALL
from tests.families.backward_gazing.test_field import SMALL as GAZING_FIELD
from tests.families.backward_gazing.test_study import SMALL as GAZING
from tests.families.field_efficiency.test_energy import BLOCKS, LIMITS
from tests.families.field_efficiency.test_optics import OPTICS
from tests.families.misalignment import test_detectors as detectors
from tests.families.misalignment.studies import CALIBRATION, CURVES, MOUNT_ERRORS, SWEPT, Content
from tests.families.misalignment.test_mount_errors import ALL_DRAWN

ALONE = {"scheduler": "synchronous", "workers": 1}
THREADS = {"scheduler": "threads", "workers": 2}
EVERY_WAY: list[Content] = [
    THREADS | {"chunks": {"latitude": 2, "tracking": 1, "heliostat": 7}},
    {"chunks": {"heliostat": 11, "time": 4}},
]
YEAR: Content = {**SMALL, **BLOCKS, "limits": LIMITS}
OPTICAL: Content = {
    **SMALL, "site": {"latitude": 40}, "tracking": "spinning_elevation",
    "time": {
        "clock": "solar", "days": {"start": 1, "stop": 365, "step": 10}, "hours": {"start": 0, "stop": 24, "step": 1},
        "sampling": "midpoint",
    },
    "layout": {"radial_stagger": {"clearance": 13, "inner_radius": 90, "heliostats": 16}},
    "heliostat": {**SMALL["heliostat"], "focus": "slant"},
    "receiver": {"kind": "rectangle", "height": 60, "azimuth": 0, "tilt": -20, "width": 7, "height_extent": 7},
    "optics": OPTICS,
}  # fmt: skip
DRAWN = {name: {"normal": [0.1, 2.0]} for name in ERRORS} | {"seed": 7}

CASES: dict[str, tuple[Content, list[Content]]] = {
    "annual": (SMALL, EVERY_WAY),
    "series": (SMALL | {"output": {"time_series": True, "field_series": True, "compression": "zlib"}}, EVERY_WAY[1:]),
    "kept": (
        SMALL | {"keep": {"heliostats": [10, 30], "by": "optical_efficiency"}, "output": {"time_series": True}},
        [THREADS | {"chunks": {"kept_heliostats": 1, "time": 3, "latitude": 1}}],
    ),
    "optics": (OPTICAL | {"output": {"time_series": True}}, [{"chunks": {"heliostat": 7, "time": 100}}]),
    "energy": (
        YEAR | {"output": {"time_series": True, "field_series": True, "compression": "zlib"}},
        [THREADS | {"chunks": {"heliostat": 3, "time": 1000}}],
    ),
    "images": (GAZING | {
        "cameras": {"noise": 0.01, "seed": [0, 1], "radius": [0.2, 0.3]}, "sun_profile": ["jose", "noisy"],
        "defects": {"canting": {"2": [0, -1]}, "waviness": 0.2, "canting_scale": [0.5, 1]}, "output": {"maps": True},
    }, [THREADS | {"chunks": {"sun_profile": 2, "canting_scale": 2}}, {"chunks": {"camera_radius": 1}}]),
    "images of a field": (GAZING_FIELD | {
        "field": {
            "latitude": 37.4, "day": 81, "hours": [12], "receiver_height": [80, 95], "pivot_height": 7,
            "layout": {"radial_stagger": {"clearance": 15, "inner_radius": 90, "heliostats": 4}},
        },
        "cameras": {"noise": 0.01},
    }, [THREADS | {"chunks": {"heliostat": 1}}, THREADS | {"chunks": {"heliostat": 3, "receiver_height": 2}}]),
    "curves": (SWEPT | {
        "mount": {"kind": ["azimuth_elevation", "target_aligned"], "mirror_offset": 0.5},
        "mount_errors": {"azimuth_reference": [0, 1], "tilt_about_east": 2}, "beam": {"divergence": 4},
    }, [THREADS | {"chunks": {"heliostat": 2, "error_size": 1}}, THREADS | {"chunks": {"source": 1, "mount_kind": 1}}]),
    "drawn": (
        MOUNT_ERRORS | {"mount_errors": {**DRAWN, "samples": 31, "scale": [0, 1, 2]}},
        [THREADS, *({"chunks": chunks} for chunks in ({"heliostat": 2, "error_scale": 1}, {"error_scale": 2}))],
    ),
    "detectors": (CALIBRATION | {
        "mode": "detectors", "time": {"clock": "solar", "days": [80, 172], "hours": [8, 12, 16]},
        "mount_errors": {**DRAWN, "samples": 3, "scale": [0.5, 1.0]},
        "detectors": {
            "arrays": [{"points": [[-9, -8], [9, -8], [9, 9]]}, {"points": [[-8, -9], [-8, 9]]}],
            "parameters": [2, 4, 6], "noise": 0.02, "rounds": 2,
        },
    }, [THREADS | {"chunks": {"heliostat": 1, "parameters": 1}}, THREADS | {"chunks": {"heliostat": 2}}]),
    "calibration": (CALIBRATION | {
        "mount_errors": {**DRAWN, "samples": 3, "scale": [0.5, 1.0]},
        "calibration": {"parameters": [4, 6], "noise": 0.02, "days_used": [1, 2]},
    }, [THREADS | {"chunks": chunks} for chunks in
        ({"heliostat": 1, "parameters": 1}, {"heliostat": 2, "days_used": 1})]),
}  # fmt: skip


@pytest.mark.parametrize(("content", "executions"), CASES.values(), ids=CASES)
def test_same_bytes_however_it_is_cut(content: Content, executions: list[Content], tmp_path: Any) -> None:
    digests = {
        result_digest(api.run({**content, "execution": how}, tmp_path / str(number), report=False).path)
        for number, how in enumerate((ALONE, *executions))
    }
    assert len(digests) == 1


def rings(**keys: Any) -> dict[str, Any]:
    return {"radial_stagger": {"clearance": 13, "inner_radius": 50} | keys}


@pytest.mark.parametrize(
    ("layout", "axis"),
    [
        (rings(rings=2, clearance={"start": 13, "stop": 14, "num": 10**6}), "clearance"),
        (rings(heliostats={"start": 1, "stop": 10**6, "step": 1}), "heliostat_count"),
    ],
)
def test_too_many_layouts_are_refused_before_one_is_made(small, monkeypatch, layout, axis):
    study = small(layout=layout, heliostat={"width": 5, "height": 5, "pivot_height": 4})
    monkeypatch.setattr(resolve, "_generated", None)
    with pytest.raises(PlanError, match=f"layouts are more than .*; shrink '{axis}' first"):
        api.plan(study)


#: Studies whose layout is replaced.
LAYOUT_AXIS_CASES: dict[str, dict[str, Any]] = {
    "field": {**SMALL, "output": {"field_geometry": True, "tracking_angles": True}},
    "energy": {**SMALL, **BLOCKS, "limits": LIMITS}, "curves": CURVES, "errors of mounts": MOUNT_ERRORS,
    "drawn errors": {**MOUNT_ERRORS, "mount_errors": {**ALL_DRAWN, "samples": 9, "seed": 7}},
    "calibration": {**CALIBRATION, "calibration": {"parameters": 4, "noise": 0.01}}, "detectors": detectors.BASE,
}  # fmt: skip


@pytest.mark.parametrize("content", LAYOUT_AXIS_CASES.values(), ids=LAYOUT_AXIS_CASES)
def test_a_layout_beside_a_longer_one_gives_what_it_gives_alone(content):
    if content["family"] == "misalignment":
        content = {**content, "heliostats": {"pivot_height": 5}, "receiver": {**content["receiver"], "tilt": -60}}

    def result(count: Any) -> Any:
        layout = rings(inner_radius=60, heliostats=count)
        return api.build(api.load({**content, "layout": layout})).compute()

    both, alone = result([3, 5]), result(3)
    assert both.sizes["heliostat"] == 5
    first = both.sel(heliostat_count=3)
    for name, values in alone.data_vars.items():
        here = first[name]
        if "heliostat" in values.dims:
            padding = here.isel(heliostat=slice(3, None))
            missing = padding.isnull() if padding.dtype.kind in "fM" else padding <= 0
            assert bool(missing.all()) or name == "true_error", name  # which is told of every number
            here = here.isel(heliostat=slice(3))
        np.testing.assert_array_equal(here, values, err_msg=str(name))
