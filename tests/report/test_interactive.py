"""What the interactive plots of a page are made of: which views, which numbers, and that no word becomes a script."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest
import xarray as xr

from heliosweep.families.registry import families
from heliosweep.report import payload
from heliosweep.report.interactive import digest, interactive, policy, script_json
from heliosweep.report.page import write_report
from heliosweep.report.payload import PAGE_VALUES, shares, thinned, view_payload, wanted
from heliosweep.report.views import View, default_views, usable
from tests.report.synthetic import BOTH, result, with_series

EVIL = "</script><!-- \u2028\u2029 <script>alert(1)</script> & ]]>"


def numbers(made, name):
    array = made["arrays"][name]
    values = np.frombuffer(base64.b64decode(array["data"]), dtype="<f4")
    return xr.DataArray(values.reshape(array["shape"]), dims=array["dims"])


def declared(family, data):
    return getattr(families()[family], "views")(data)  # noqa: B009 (not every family has it)


def test_views_of_a_field():
    data = result({"latitude": [0.0, 15.0, 30.0], "tracking": BOTH}, heliostats=40)
    field, curves = usable(data, declared("field_efficiency", data))
    assert (field.kind, field.quantities[0], field.less) == ("field", "optical_efficiency", "tracking")
    assert (curves.kind, curves.along) == ("curves", ("latitude",))
    made = view_payload(data, field)
    assert numbers(made, "optical_efficiency").to_numpy() == pytest.approx(100 * data["optical_efficiency"].to_numpy())
    assert made["dims"]["latitude"]["texts"] == ["0°", "15° N", "30° N"]
    assert made["dims"]["tracking"]["kind"] == "word"
    assert made["thinned"] == ""
    assert made["arrays"]["place_width"]["shape"] == []


@pytest.mark.parametrize("family", list(families()))
def test_families_have_no_views_of_what_they_do_not_know(family):
    data = xr.Dataset({"number": 1.0}, attrs={"study": json.dumps({"family": family})})
    assert usable(data, declared(family, data)) == []


def test_views_that_dimensions_allow():
    sizes = {"z": 4, "y": 5, "heliostat": 8, "hour": 6, "mode": 2}

    def zeros(*dims):
        return dims, np.zeros([sizes[dim] for dim in dims])

    labels = {"hour": np.arange(6.0), "mode": ["a", "b"], "x": ("heliostat", np.arange(8.0))}
    data = xr.Dataset(
        {"picture": zeros("mode", "z", "y"), "each": zeros("heliostat", "hour"), "course": zeros("mode", "hour")},
        {**labels, "heliostat": np.arange(8), "z": np.arange(4.0), "y": np.arange(5.0)},
    )
    found = {view.kind: view.quantities for view in usable(data, default_views(data))}
    assert found == {
        "raster": ("picture",),
        "curves": ("course",),
    }  # y is a side of the picture, no place of heliostats
    assert usable(data.drop_vars("picture").assign_coords(y=("heliostat", np.ones(8))).drop_dims("z"), ()) == []


def test_flags_dates_and_constants_are_not_drawn():
    flag = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "no yes"}
    data = xr.Dataset(
        {
            "status": ("hour", np.zeros(4, np.int8), flag),
            "when": ("hour", np.zeros(4, "datetime64[ns]")),
            "one": ("mode", [1.0, 2.0]),
        },
        {"hour": np.arange(4.0)},
    )
    assert usable(data, default_views(data)) == []


def test_large_sweeps_are_thinned_to_the_budget_and_say_so():
    sizes = {"latitude": 49, "date": 365, "tilt": 6, "direction": 24}
    labels = {dim: np.arange(size, dtype=float) for dim, size in sizes.items()}
    data = xr.Dataset({"factor": (tuple(sizes), np.random.default_rng(1).random(list(sizes.values())))}, labels)
    view = View("curves", "Days", ("factor",), ("date",))
    made = view_payload(data, view, 100_000)
    kept = numbers(made, "factor")
    assert 50_000 < kept.size <= 100_000
    assert kept.sizes["direction"] == 24
    dates = np.array(made["dims"]["date"]["values"]).astype(int)
    assert dates[0] == 0
    assert dates[-1] == 364
    assert kept[-1, 3, 2, 1] == pytest.approx(data["factor"][-1, dates[3], 2, 1].item())
    assert f"{dates.size} of 365 values of date" in made["thinned"]
    assert wanted(data, view) == data["factor"].size


def test_pixels_stay_at_the_same_distance():
    side = np.linspace(0, 1, 147)
    data = xr.Dataset({"a": (("z", "y"), np.zeros((147, 147)))}, {"z": side, "y": side})
    kept, _ = thinned(data, View("raster", "", ("a",), ("z", "y")), ["a"], 6000)
    assert set(np.diff(kept["z"])) == set(np.diff(kept["y"])) == {2}


def test_a_budget_that_nothing_fits_drops_the_last_quantities_first():
    data = xr.Dataset({name: (("mode", "heliostat"), np.zeros((4, 500))) for name in "abc"}, {"mode": list("wxyz")})
    kept, names = thinned(data, View("field", "", tuple("abc"), ("heliostat",)), list("abc"), 2500)
    assert names == ["a"]
    assert {dim: index.size for dim, index in kept.items()} == {"mode": 4, "heliostat": 500}
    kept, _ = thinned(data, View("field", "", ("a",), ("heliostat",)), ["a"], 600)
    assert kept["mode"].size * kept["heliostat"].size <= 600


def test_small_wishes_are_granted():
    assert shares([10, 1000, 400, 10], 620) == [10, 300, 300, 10]
    assert shares([10, 20], 100) == [10, 20]
    assert sum(shares([10**9] * 7, PAGE_VALUES)) <= PAGE_VALUES


def test_quantities_without_any_value_are_left_out():
    data = xr.Dataset(
        {name: ("hour", [end, end, end]) for name, end in (("a", np.nan), ("b", 1.0))}, {"hour": [1, 2, 3]}
    )
    view = View("curves", "", ("a", "b"), ("hour",))
    assert [one["name"] for one in view_payload(data, view)["quantities"]] == ["b"]
    assert [one["name"] for one in view_payload(data[["a"]], View("curves", "", ("a",), ("hour",)))["quantities"]] == [
        "a"
    ]


def test_words_of_the_program_lose_their_underscores_and_names_keep_them():
    labels = {key: ["tilt_x", "b_c"] for key in ("parameter", "site")}
    data = xr.Dataset({"a": (tuple(labels), np.ones((2, 2)))}, labels)
    made = view_payload(data, View("curves", "", ("a",), ("parameter",), colours={"b c": "#000000"}))
    assert made["dims"]["parameter"]["texts"] == ["tilt x", "b c"]
    assert made["dims"]["site"]["texts"] == ["tilt_x", "b_c"]
    assert made["colours"] == {"b c": "#000000"}


def test_large_arrays_are_read_in_parts(monkeypatch):
    data = xr.Dataset({"a": (("one", "mode", "hour"), np.arange(600.0).reshape(1, 6, 100))}, {"hour": np.arange(100.0)})
    view = View("curves", "", ("a",), ("hour",))
    whole = view_payload(data, view, 200)
    monkeypatch.setattr(payload, "WHOLE", 50)
    assert view_payload(data.chunk({"hour": 7}), view, 200) == whole


def test_layouts_of_a_sweep_stand_where_each_has_its_heliostats():
    data = result({"layout": ["a.csv", "b.csv"]}, heliostats=8).drop_vars(["x", "y"])
    places = np.arange(16.0).reshape(2, 8)
    data = data.assign_coords(x=(("layout", "heliostat"), places), y=(("layout", "heliostat"), -places))
    (view,) = usable(data, [View("field", "", ("optical_efficiency",), ("heliostat",))])
    assert numbers(view_payload(data, view), "place_x").to_numpy() == pytest.approx(places)
    assert usable(data, [View("field", "", ("field_optical_efficiency",), ("heliostat",))]) == []


def test_instants_are_told_by_what_runs_along_them():
    labels = {"day": ("time", [81, 172]), "hour": ("time", [9.5, 12.0], {"units": "h"})}
    data = with_series(result({"tracking": BOTH}, heliostats=9), labels)
    found = usable(data, declared("field_efficiency", data))
    assert [view.kind for view in found] == ["field", "field"]
    assert view_payload(data, found[1])["dims"]["time"]["texts"] == ["day 81, hour 9.5 h", "day 172, hour 12 h"]


def test_missing_and_infinite_values_have_one_pattern_of_bits():
    data = xr.Dataset({"a": ("hour", [1.0, np.nan, np.inf, -np.nan])}, {"hour": np.arange(4.0)})
    made = view_payload(data, View("curves", "", ("a",), ("hour",)))
    raw = base64.b64decode(made["arrays"]["a"]["data"])
    assert raw[4:8] == raw[8:12] == raw[12:16]


def test_words_stay_words_in_scripts():
    text = script_json({EVIL: [EVIL]})
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text) == {EVIL: [EVIL]}
    data = result({"latitude": [0.0, 1.0, 2.0], "tracking": [EVIL, "b"]}, attrs={"title": EVIL})
    data["optical_efficiency"].attrs["long_name"] = EVIL
    made = interactive(data, declared("field_efficiency", data))
    assert "<script>alert" not in made.body + made.end
    assert made.end.count("</script>") == 1 + len(made.scripts)


def test_only_known_scripts_run():
    data = result({"latitude": [0.0, 1.0, 2.0]})
    made = interactive(data, default_views(data))
    sources = made.end.split("<script>")[1:]
    assert tuple(digest(source.removesuffix("\n").removesuffix("</script>")) for source in sources) == made.scripts
    rules = policy(made.scripts)
    assert all(f"'{script}'" in rules for script in made.scripts)
    assert "default-src 'none'" in rules
    assert "unsafe-eval" not in rules
    assert "script-src 'none'" in policy(())


@pytest.mark.slow
def test_the_largest_page_stays_small(tmp_path):
    data = result({"latitude": [*range(-60, 61, 2)], "tracking": BOTH, "receiver_height": [80, 100, 120]}, 5000)
    data.to_netcdf(tmp_path / "result.nc", engine="netcdf4")
    page = write_report(tmp_path)
    assert page.stat().st_size < 6e6
    assert "Thinned for this page" in page.read_text(encoding="utf-8")


def test_only_what_has_an_order_is_joined():
    labels = {"parameter": ["tilt_x", "b"], "month": ["January", "May"], "module": [1, 2], "hour": [9.0, 12.0]}
    labels["camera_seed"] = [4, 5]
    data = xr.Dataset({"a": (tuple(labels), np.ones((2, 2, 2, 2, 2)))}, labels)
    dims = view_payload(data, View("curves", "", ("a",), ("hour",)))["dims"]
    assert [dim for dim, told in dims.items() if told["joined"]] == ["month", "hour"]


@pytest.mark.parametrize("family", list(families()))
def test_titles_of_curves_name_what_is_drawn_over_what(family):
    labels = {"module": [1, 2], "hour": [9.0, 12.0, 15.0]}
    data = xr.Dataset({"a": (("module", "hour"), np.ones((2, 3)), {"long_name": "slope of all"})}, labels)
    views = [*default_views(data), *declared(family, data)]
    made = [view_payload(data, view) for view in usable(data, views) if view.kind == "curves"]
    assert made[0]["title"] == "Slope of all over hour"
    assert not {one["title"] for one in made} & {"", "Curves", "Over what is swept", "Modules"}
    text = interactive(data, default_views(data)).body
    assert ">Slope of all over hour</h3>" in text


def test_words_of_many_values_take_no_look_at_other_coordinates(monkeypatch):
    data = result({"latitude": [0.0, 15.0, 30.0]}, heliostats=300)
    (view,) = usable(data, [View("field", "", ("optical_efficiency",), ("heliostat",))])
    data = data.assign_coords(heliostat=np.arange(300))
    seen: list[int] = []

    def word(value: xr.DataArray) -> str:
        seen.append(len(value.coords))
        return str(value.item())

    monkeypatch.setattr(payload, "_word", word)
    assert view_payload(data, view)["dims"]["heliostat"]["texts"] == [str(number) for number in range(300)]
    assert set(seen) == {0}
