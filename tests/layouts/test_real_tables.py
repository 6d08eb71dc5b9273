"""Tables as other programs and users write them, with values from independent computations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from heliosweep import api
from heliosweep.layouts import read_csv
from heliosweep.layouts.layout import read_text

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
    found = efficiencies(layout={"file": str(DATA / "solarpilot_parametric.csv")}, **mirrors)
    assert found == pytest.approx((86.66, 98.89), abs=0.006)  # of the table alone, without the parameters before it


def test_every_mirror_has_its_own_height():
    layout = read_csv(DATA / "own_heights.csv")
    assert set(layout.values("pivot_height")) == {3, 4.5, 6}
    time = {"time": {"clock": "sun", "azimuth": [120, 180], "elevation": [15, 50]}, "receiver": {"height": 84}}
    file = {"file": str(DATA / "own_heights.csv")}
    assert efficiencies(layout=file, heliostat={}, **time) == pytest.approx((67.9577, 76.8982), abs=1e-4)
    study = api.load({"family": "field_efficiency", "tracking": "azimuth_elevation", "layout": file,
                      "heliostat": {"pivot_height": 4}, **time})  # fmt: skip
    (note,) = study.notes()
    assert note.endswith("the column pivot_height is not used: 'heliostat.pivot_height' applies to all heliostats: "
                         "remove it to use the column")  # fmt: skip


#: Traced with 1e6 rays of an independent program: intercept of a cylinder at the file's focal lengths, 300 m and 80 m.
FOCAL = {None: ([0.7713, 0.3573], 5e-4), "slant": ([0.9984, 0.9797], 4e-4)}


@pytest.mark.parametrize("focus", [None, "slant"])
def test_focal_lengths_of_single_heliostats(focus):
    study = api.load({
        "family": "field_efficiency", "tracking": "azimuth_elevation",
        "time": {"clock": "sun", "azimuth": 180, "elevation": 45},
        "layout": {"file": str(DATA / "solarpilot_focal.csv")},
        "heliostat": {"width": 6, "height": 6, "pivot_height": 3, **({} if focus is None else {"focus": focus})},
        "receiver": {"kind": "cylinder", "height": 50, "radius": 1.5, "height_extent": 3},
        "optics": {"sun_shape": {"kind": "pillbox"}, "slope_error": 1},
    })  # fmt: skip
    expected, error = FOCAL[focus]
    found = api.build(study)["intercept_efficiency"].to_numpy().ravel()
    np.testing.assert_allclose(found, expected, atol=3 * error)
    assert any("focal_x, focal_y are not used" in note for note in study.notes()) == (focus == "slant")


def test_properties_reach_the_result():
    layout = read_csv(DATA / "properties.csv")
    optics = {"sun_shape": {"kind": "pillbox"}}
    blocks: dict[str, Any] = {
        "family": "field_efficiency", "tracking": "azimuth_elevation",
        "time": {"clock": "sun", "azimuth": 180, "elevation": 50},
        "heliostat": {"width": 6, "height": 6, "pivot_height": 4},
        "receiver": {"kind": "cylinder", "height": 84, "radius": 1.5, "height_extent": 3},
    }  # fmt: skip
    own = api.load({**blocks, "layout": {"file": str(DATA / "properties.csv")}, "optics": optics})
    result = api.build(own).compute()
    notes = list(own.notes())
    labels = "focal_length, layout_canting, layout_tracking, zone"
    assert notes[0].endswith(f"results do not depend on the columns {labels}, which are labels")
    assert len(notes) == 3
    assert notes[1].endswith("the column availability is not used: 'availability' is not set")
    assert "aim_x, aim_y, aim_z" in notes[2]
    for slope, reflectivity, focus in ((1.0, 0.9, 100.0), (5.0, 0.1, 50.0)):
        same = api.load({
            **blocks, "layout": {"x": layout.x, "y": layout.y},
            "heliostat": {**blocks["heliostat"], "focus": focus},
            "optics": {**optics, "slope_error": slope, "reflectivity": reflectivity, "cleanliness": 0.5},
        })  # fmt: skip
        rows = np.flatnonzero(layout.columns["slope_error"] == slope)
        alone = api.build(same).compute()
        for name in ("intercept_efficiency", "total_efficiency"):
            found, wanted = (one[name].to_numpy().ravel()[rows] for one in (result, alone))
            np.testing.assert_allclose(found, wanted, atol=0.012, rtol=0.01, err_msg=name)


@pytest.mark.parametrize(
    "text",
    [
        "Ost;Nord\n0;100\n50,5;100\n",
        "Este,Norte\n0,100\n50.5,100\n",
        "# x y z\n0.0 100.0 0.0\n50.5 100.0 0.0\n",  # numpy.savetxt(..., header="x y z")
        "# x,y\r\n0.0,100.0\r\n50.5,100.0\r\n",
        "# x and y in metres\nx,y\n0.0,100.0\n50.5,100.0\n",
    ],
)
def test_titles_of_other_languages_and_of_numpy(text):
    layout = read_text(text, "field.csv")
    assert layout.x.tolist() == [0.0, 50.5]
    assert layout.y.tolist() == [100.0, 100.0]
