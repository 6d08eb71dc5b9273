"""The same bytes of a result, however the work is cut and wherever it is done."""

from __future__ import annotations

from typing import Any

import pytest

from heliosweep import api
from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.store.read import file_digest

from .studies import CALIBRATION, CURVES, MOUNT_ERRORS, Content, study

ALONE = {"scheduler": "synchronous", "workers": 1}
THREADS = {"scheduler": "threads", "workers": 2}
PROCESSES = {"scheduler": "processes", "workers": 2}
DRAWN = {name: {"normal": [0.1, 2.0]} for name in ERRORS} | {"seed": 7}

SWEPT: Content = {
    **CURVES,
    "time": {"clock": "solar", "days": [80, 172], "hours": [8, 12, 16]},
    "mount": {"kind": ["azimuth_elevation", "target_aligned"], "mirror_offset": [0, 0.5]},
    "heliostats": {"positions": [[10 * k - 40, 100 + 7 * k, k] for k in range(9)]},
    "detectors": {"lines": [[1, 0, 2]]},
    "error": {"source": ["canting", "tilt"], "axis": ["elevation", "azimuth"], "size": [-3, 0, 3]},
}
CASES: dict[str, tuple[Content, list[Content]]] = {
    "curves": (
        SWEPT,
        [
            THREADS | {"chunks": {"heliostat": 2, "error_size": 1}},
            PROCESSES | {"chunks": {"heliostat": 4, "mirror_offset": 1, "source": 1}},
        ],
    ),
    "drawn": (
        MOUNT_ERRORS | {"mount_errors": {**DRAWN, "samples": 31, "scale": [0, 1, 2]}},
        [THREADS, *({"chunks": chunks} for chunks in ({"heliostat": 2, "error_scale": 1}, {"error_scale": 2}))],
    ),
    "swept": (
        MOUNT_ERRORS | {"mount_errors": MOUNT_ERRORS["mount_errors"] | {"collimation": [0, 1, 2]}},
        [THREADS | {"chunks": {"heliostat": 1}}],
    ),
    "combined": (
        SWEPT
        | {
            "mount": {"kind": ["azimuth_elevation", "target_aligned"], "mirror_offset": 0.5},
            "mount_errors": {"azimuth_reference": [0, 1], "tilt_about_east": 2},
            "beam": {"divergence": 4},
        },
        [THREADS | {"chunks": {"heliostat": 2, "error_size": 1}}, THREADS | {"chunks": {"source": 1, "mount_kind": 1}}],
    ),
    "detectors": (
        CALIBRATION
        | {
            "mode": "detectors",
            "time": {"clock": "solar", "days": [80, 172], "hours": [8, 12, 16]},
            "mount_errors": {**DRAWN, "samples": 3, "scale": [0.5, 1.0]},
            "detectors": {
                "arrays": [{"points": [[-9, -8], [9, -8], [9, 9]]}, {"points": [[-8, -9], [-8, 9]]}],
                "parameters": [2, 4, 6],
                "noise": 0.02,
                "rounds": 2,
            },
        },
        [THREADS | {"chunks": {"heliostat": 1, "parameters": 1}}, THREADS | {"chunks": {"heliostat": 2}}],
    ),
    "calibration": (
        CALIBRATION
        | {
            "mount_errors": {**DRAWN, "samples": 3, "scale": [0.5, 1.0]},
            "calibration": {"parameters": [4, 6], "noise": 0.02, "days_used": [1, 2]},
        },
        [
            THREADS | {"chunks": {"heliostat": 1, "parameters": 1}},
            THREADS | {"chunks": {"heliostat": 2, "days_used": 1}},
        ],
    ),
}


@pytest.mark.parametrize(("content", "executions"), CASES.values(), ids=CASES)
def test_same_bytes_however_it_is_cut(content: Content, executions: list[Content], tmp_path: Any) -> None:
    digests = {
        file_digest(api.run(study(content, execution=how), tmp_path / str(number), report=False).path)
        for number, how in enumerate((ALONE, *executions))
    }
    assert len(digests) == 1
