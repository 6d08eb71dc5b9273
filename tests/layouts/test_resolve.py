"""The layouts that a study names: swept keys of generators and of the ground, spacings that follow the plant."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from heliosweep import api
from heliosweep.errors import StudyError
from heliosweep.layouts.resolve import Layouts, longest

RINGS = {"clearance": 13, "inner_radius": 50}
PLACE: dict[str, Any] = {"site": {"latitude": 40}, "tracking": "azimuth_elevation"}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("site.wkt").write_text("POLYGON ((-120 -20, 120 -20, 120 180, -120 180, -120 -20))")
    Path("narrow.wkt").write_text("POLYGON ((-60 -20, 60 -20, 60 180, -60 180, -60 -20))")


@pytest.mark.parametrize(
    ("layout", "dims"),
    [
        ({"spiral": {"a": [6, 7], "b": [0.6, 0.7], "inner_radius": 50, "heliostats": 40}}, ["spiral_a", "spiral_b"]),
        ({"spiral": {"a": 6, "b": 0.6, "inner_radius": [40, 50], "heliostats": [30, 40]}},
         ["inner_radius", "heliostat_count"]),
        ({"rows": {"spacing": [14, 15], "distance": [13, 14], "inner_radius": 40, "heliostats": 40}},
         ["row_spacing", "row_distance"]),
        ({"rows": {"spacing": 14, "distance": 13, "azimuth": [0, 30], "pattern": ["straight", "staggered"],
                   "inner_radius": 40, "heliostats": 40}}, ["row_azimuth", "pattern"]),
        ({"radial_stagger": {**RINGS, "rings": 2}, "sectors": [{"azimuth": [0, 90], "width": 60},
                                                              {"azimuth": 180, "width": [20, 50]}]},
         ["sector_azimuth", "sector_width"]),
        ({"radial_stagger": RINGS, "boundary": ["site.wkt", "narrow.wkt"]}, ["boundary"]),
        ({"radial_stagger": RINGS, "boundary": "site.wkt", "margin": [0, 6, 12]}, ["boundary_margin"]),
        ({"radial_stagger": {**RINGS, "rings": 2}, "terrain": {"slope": [0, 5], "azimuth": [0, 180]}},
         ["terrain_slope", "terrain_azimuth"]),
        ({"radial_stagger": {**RINGS, "rings": 2, "spacing": ["delsol", "no_blocking"]}}, ["spacing"]),
    ],
)  # fmt: skip
def test_every_key_can_be_swept(small, layout, dims):
    study = small(**PLACE, layout=layout, receiver={"height": 90})
    layouts = Layouts(study)
    assert [dim.name for dim in layouts.dimensions] == dims
    made = list(layouts)
    assert longest(study) == max(map(len, made))
    different = {(one.x.tobytes(), one.y.tobytes(), one.z.tobytes()) for one in made}
    assert len(different) == len(made) - (2 - 1 if dims[0] == "terrain_slope" else 0)  # level ground has no azimuth
    result = api.build(study)
    assert set(result["x"].dims) == {*dims, "heliostat"}
    count = result["x"].notnull().sum("heliostat")
    np.testing.assert_array_equal(count.transpose(*dims).to_numpy().ravel(), [len(one) for one in made])


def test_a_spacing_follows_the_tower_and_the_mirror(small):
    rings = {"radial_stagger": {**RINGS, "rings": 6, "spacing": "delsol"}}

    def study(height: Any, width: Any) -> Any:
        heliostat = {"width": width, "height": 8, "pivot_height": 5}
        return api.build(small(**PLACE, layout=rings, receiver={"height": height}, heliostat=heliostat))

    result = study([60, 120], [6, 8])
    assert set(result["x"].dims) == {"receiver_height", "heliostat_width", "heliostat"}
    radius: Any = np.hypot(result["x"], result["y"])
    radius = radius.max("heliostat")
    assert (radius.sel(receiver_height=60) > radius.sel(receiver_height=120)).all()
    count = result["x"].notnull().sum("heliostat")
    assert (count.sel(heliostat_width=6) > count.sel(heliostat_width=8)).all()
    alone, swept = study(120, 6).compute(), result.sel(receiver_height=120, heliostat_width=6).compute()
    here = swept["optical_efficiency"].isel(heliostat=slice(alone.sizes["heliostat"]))
    np.testing.assert_array_equal(here, alone["optical_efficiency"])


def test_ids_depend_on_what_files_say_and_not_on_new_keys(small):
    plain = small(**PLACE)
    assert "keep" not in plain.canonical()
    assert plain.canonical()["layout"] == {"radial_stagger": {"clearance": 13.0, "inner_radius": 50.0, "rings": 2}}
    bounded = {"radial_stagger": RINGS, "boundary": "site.wkt"}
    first = small(**PLACE, layout=bounded).study_id
    text = Path("site.wkt").read_text()
    Path("site.wkt").write_text("# drawn again\n" + text)
    assert small(**PLACE, layout=bounded).study_id == first
    Path("site.wkt").write_text(text.replace("180", "190"))
    assert small(**PLACE, layout=bounded).study_id != first


TWO: dict[str, Any] = {**PLACE, "heliostat": {"width": 4, "height": 4, "pivot_height": 5}, "receiver": {"height": 90}}


def test_a_table_in_the_study_is_the_table_of_a_file(small):
    frame = pd.DataFrame({"x": [0.1, 15.0], "y": [60.0, 60.5], "z": [0, 1], "name": ["A, 1", "B"]})
    frame.to_csv("field.csv", index=False)
    columns = {key: frame[key].to_numpy() for key in frame}
    written = [
        Layouts(small(**TWO, layout=layout))[()]
        for layout in ({"file": "field.csv"}, frame, columns, {"table": columns})
    ]
    for layout in written:
        for key in "xyz":
            np.testing.assert_array_equal(getattr(layout, key), frame[key])
        assert layout.columns["name"].tolist() == ["A, 1", "B"]
    study = small(**TWO, layout=frame)
    Path("again.yaml").write_text(study.to_yaml())
    again = api.load("again.yaml")
    assert again.study_id == study.study_id
    result = api.build(again)
    np.testing.assert_array_equal(result["x"], frame["x"])
    assert study.study_id != small(**TWO, layout=frame.assign(z=[0, 2])).study_id


def test_a_table_in_map_coordinates(small):
    Path("plain.csv").write_text("x,y,aim_x,aim_y,aim_z\n0,60,0,0,90\n15,60.5,0,1,90\n")
    Path("map.csv").write_text("x,y,aim_x,aim_y,aim_z\n500000,4000060,500000,4000000,90\n"
                               "500015,4000060.5,500000,4000001,90\n")  # fmt: skip
    plain = Layouts(small(**TWO, layout={"file": "plain.csv"}))[()]
    moved = Layouts(small(**TWO, layout={"file": "map.csv", "origin": [500000, 4000000]}))[()]
    for key in "xyz":
        np.testing.assert_array_equal(getattr(moved, key), getattr(plain, key))
    np.testing.assert_array_equal(moved.columns["aim_y"], [0, 1])
    with pytest.raises(StudyError, match=r"beyond any field: .*'layout.origin: \[east, north\]'"):
        small(**TWO, layout={"file": "map.csv"})


@pytest.mark.parametrize("pattern", ["fields/*.csv", "fields", "fields/[ab].csv"])
def test_a_pattern_or_a_folder_names_the_layouts_of_a_sweep(small, pattern):
    Path("fields").mkdir()
    for name, y in (("b", 70), ("a", 60)):
        Path(f"fields/{name}.csv").write_text(f"x,y\n0,{y}\n")
    study = small(**TWO, layout={"file": pattern})
    assert study.files()["layout.file"] == ("fields/a.csv", "fields/b.csv")
    assert [one.y.tolist() for one in Layouts(study)] == [[60], [70]]


def test_a_column_counts_if_the_study_gives_no_value(small):
    Path("field.csv").write_text("x,y,width,height,pivot_height,reflectivity\n0,60,4,4,5,0.9\n15,60,4,4,6,0.8\n")
    file = {"file": "field.csv"}
    study = small(**PLACE, layout=file, heliostat={}, receiver={"height": 90})
    assert list(study.notes()) == ["field.csv: the column reflectivity is not used: 'optics' is not set"]
    study = small(**TWO, layout=file)
    assert list(study.notes()) == [
        "field.csv: the column pivot_height is not used: 'heliostat.pivot_height' applies to all heliostats: remove it "
        "to use the column",
        "field.csv: the column reflectivity is not used: 'optics' is not set",
    ]
    Path("field.csv").write_text("x,y,width,pivot_height\n0,60,4,5\n15,60,-4,n/a\n")
    with pytest.raises(StudyError) as caught:
        small(**PLACE, layout=file, heliostat={}, receiver={"height": 90})
    assert [str(problem) for problem in caught.value.problems] == [
        "heliostat.height: is missing: give it in m, or as a column 'height' of the layout",
        "field.csv:3: heliostat 1 needs width greater than 0 and at most 1000 m (got -4)",
        "field.csv:3: heliostat 1 needs pivot_height at least 0 and at most 1000 m (got nan)",
    ]


def test_mirrors_in_the_ground_and_ground_that_excludes_nothing_are_noticed(small):
    Path("field.csv").write_text("x,y\n0,60\n15,60\n")
    mirrors = {"receiver": {"height": 90}, "heliostat": {"width": 8, "height": 8, "pivot_height": 3}}
    assert list(small(**PLACE, layout={"file": "field.csv"}, **mirrors).notes()) == [
        "the mirrors of 2 heliostats reach into the ground when upright: the centre of heliostat 0 (line 2) is 3 m "
        "high, half of its mirror height is 4 m"
    ]
    Path("field.csv").write_text("x,y,z\n0,60,4\n15,60,-3\n")  # z of the centres
    mirrors["heliostat"]["pivot_height"] = 0
    assert list(small(**PLACE, layout={"file": "field.csv"}, **mirrors).notes()) == []
    Path("far.wkt").write_text("POLYGON ((29000 31000, 29100 31000, 29100 31100, 29000 31000))")
    study = small(**PLACE, layout={"radial_stagger": {**RINGS, "rings": 2}, "exclude": "far.wkt"})
    assert list(study.notes()) == [
        "layout.exclude: far.wkt is 42,389 m from the nearest heliostat and has no effect; for map coordinates set "
        "'layout.origin: [east, north]' of the tower"
    ]
