"""Tables as other programs and users write them, with values from independent computations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from heliosweep import api
from heliosweep.layouts import read_csv

DATA = Path(__file__).parents[1] / "data" / "layouts"
CORNERS: dict[str, Any] = {"clock": "sun", "azimuth": [120, 180], "elevation": [15, 60]}
#: Field optical efficiency of the NSTTF, minimum and maximum [%]: exact cosine, shading and blocking of the positions
#: alone, which a ray count over 120 heliostats confirms within 5e-4.
NSTTF = (69.9608, 93.5509)


def efficiencies(**blocks: Any) -> tuple[float, float]:
    """Return the minimum and maximum of the field's optical efficiency. [%]"""
    study = api.load({"family": "field_efficiency", "tracking": "azimuth_elevation", "time": CORNERS, **blocks})
    values = 100 * api.build(study)["field_optical_efficiency"].compute()
    return float(values.min()), float(values.max())


def test_the_table_of_opencsp():
    layout = read_csv(DATA / "opencsp_nsttf.csv")
    assert len(layout) == 218
    assert (layout.x[0], layout.y[0], layout.z[0], layout.columns["name"][0]) == (92.61, 57.92, 5.45, "5E10")
    assert layout.labels == (
        "num_facets", "num_rows", "num_cols", "layout_pivot_height", "pivot_offset", "facet_width", "facet_height",
    )  # fmt: skip
    mirrors = {"heliostat": {"width": 6.1, "height": 6.1, "pivot_height": 0}, "receiver": {"height": 62}}
    file = {"file": str(DATA / "opencsp_nsttf.csv")}
    assert efficiencies(layout=file, **mirrors) == pytest.approx(NSTTF, abs=1e-4)


def test_the_parametric_export_of_solarpilot():
    layout = read_csv(DATA / "solarpilot_parametric.csv")
    assert (layout.x.tolist(), layout.y.tolist()) == ([-30, 0, 30], [80, 80, 80])
    mirrors = {"heliostat": {"width": 6, "height": 6, "pivot_height": 3}, "receiver": {"height": 90}}
    # Of the table alone, without the parameters before it.
    assert efficiencies(layout={"file": str(DATA / "solarpilot_parametric.csv")}, **mirrors) == pytest.approx(
        (86.66, 98.89), abs=0.006
    )
