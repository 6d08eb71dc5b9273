"""What the interactive plots of a page are made of: which views, which numbers, and that no word becomes a script."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pytest
import xarray as xr
from bokeh.document import Document
from matplotlib import colormaps
from matplotlib.colors import to_hex

from heliosweep.errors import HeliosweepError
from heliosweep.families.family import Family, families
from heliosweep.report import interactive, payload
from heliosweep.report.colours import DIFFERENCES, VALUES, shade
from heliosweep.report.page import digest, render, write_report
from heliosweep.report.payload import PAGE_VALUES, shares, thinned, view_payload, wanted
from heliosweep.report.views import View, default_views, usable
from tests.report.synthetic import BOTH, result, with_series

pytestmark = pytest.mark.usefixtures("undamaged")

EVIL = "</script><!-- \u2028\u2029 <script>alert(1)</script> & ]]>"


def numbers(made, name):
    """Numbers of a quantity, or of a side of the places of mirrors."""
    array = made["places"].get(name) or next(one for one in made["quantities"] if one["name"] == name)
    return xr.DataArray(array["values"].reshape(array["shape"]), dims=array["dims"])


@pytest.mark.parametrize("name", [VALUES, DIFFERENCES])
def test_colours_are_those_of_the_figures(name):
    assert [shade(name, i / 255) for i in range(256)] == [to_hex(colormaps[name](i)) for i in range(256)]


def declared(family, data):
    return families()[family].views(data)


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
    assert made["places"]["width"]["shape"] == []


def test_a_family_without_views_of_its_own_has_those_of_any_result():
    plain = type("Plain", (Family,), {"__module__": "tests.report"})()  # a package with none of the modules of a family
    data = xr.Dataset({"a": ("hour", [1.0, 2.0, 4.0])}, {"hour": [1.0, 2.0, 3.0]})
    assert list(plain.views(data)) == list(default_views(data))
    assert [view.quantities for view in usable(data, plain.views(data))] == [("a",)]
    assert list(plain.tables(data)) == list(plain.figures(data)) == []


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
    dates = made["dims"]["date"]["at"].astype(int)
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
    made = view_payload(data, View("curves", "", ("a",), ("parameter",)))
    assert made["dims"]["parameter"]["texts"] == ["tilt x", "b c"]
    assert made["dims"]["site"]["texts"] == ["tilt_x", "b_c"]


def test_large_arrays_are_read_in_parts(monkeypatch):
    data = xr.Dataset({"a": (("one", "mode", "hour"), np.arange(600.0).reshape(1, 6, 100))}, {"hour": np.arange(100.0)})
    view = View("curves", "", ("a",), ("hour",))
    whole = numbers(view_payload(data, view, 200), "a")
    monkeypatch.setattr(payload, "WHOLE", 50)
    assert numbers(view_payload(data.chunk({"hour": 7}), view, 200), "a").identical(whole)


def test_layouts_of_a_sweep_stand_where_each_has_its_heliostats():
    data = result({"layout": ["a.csv", "b.csv"]}, heliostats=8).drop_vars(["x", "y"])
    places = np.arange(16.0).reshape(2, 8)
    data = data.assign_coords(x=(("layout", "heliostat"), places), y=(("layout", "heliostat"), -places))
    (view,) = usable(data, [View("field", "", ("optical_efficiency",), ("heliostat",))])
    assert numbers(view_payload(data, view), "x").to_numpy() == pytest.approx(places)
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
    raw = numbers(made, "a").to_numpy().tobytes()
    assert raw[4:8] == raw[8:12] == raw[12:16]


def written(folder, data):
    """The page of a result of no known family."""
    data.to_netcdf(folder / "result.nc", engine="netcdf4")
    return write_report(folder, lambda _: None)


def test_words_stay_words_in_scripts(tmp_path):
    data = result({"latitude": [0.0, 1.0, 2.0], "tracking": [EVIL, "b"]}, attrs={"title": EVIL})
    data["optical_efficiency"].attrs["long_name"] = EVIL
    text = written(tmp_path, data).read_text(encoding="utf-8")
    assert "<script>alert" not in text
    plots = text.partition('<script type="application/json" id="heliosweep-plots">')[2].partition("</script>")[0]
    assert not set("<>&\u2028\u2029") & set(plots)
    assert EVIL in json.dumps(json.loads(plots), ensure_ascii=False)
    assert text.count("</script>") == 4


def test_only_known_scripts_run(tmp_path):
    text = written(tmp_path, result({"latitude": [0.0, 1.0, 2.0]})).read_text(encoding="utf-8")
    sources = [source.partition("</script>")[0] for source in text.split("<script>")[1:]]
    (rules,) = re.findall('http-equiv="Content-Security-Policy" content="([^"]*)"', text)
    allowed = " ".join(f"'{digest(source)}'" for source in sources)
    assert rules.split("; ") == [
        "default-src 'none'",
        "img-src data:",
        "style-src 'unsafe-inline'",
        f"script-src {allowed}",
        "base-uri 'none'",
    ]
    assert len(sources) == 3
    assert "script-src 'none'" in render("index.html", title="Studies", scripts=(), studies=(), families=())


def test_a_script_that_ends_a_script_is_refused():
    with pytest.raises(HeliosweepError, match="holds the end of a script"):
        interactive._harmless("'</SCRIPT>'")


@pytest.mark.slow
def test_the_largest_page_stays_small(tmp_path):
    data = result({"latitude": [*range(-60, 61, 2)], "tracking": BOTH, "receiver_height": [80, 100, 120]}, 5000)
    page = written(tmp_path, data)
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
    frames, _ = interactive.explore(data, default_views(data))
    assert frames[0]["title"] == "Slope of all over hour"


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


def test_lines_look_as_in_the_figures_and_many_are_shades_of_one_scale():
    few = interactive._looks(["a", "b c"], {"b c": "#000000"})
    assert few is not None
    assert [one["color"] for one in few] == ["#0072B2", "#000000"]
    assert few[0]["dash"] != few[1]["dash"]
    many = interactive._looks([str(i) for i in range(20)], {})
    assert many is not None
    assert len({one["color"] for one in many}) == 20
    assert {(one["mark"], *one["dash"]) for one in many} == {("circle",)}
    assert interactive._looks([str(i) for i in range(27)], {}) is interactive._looks(["one"], {}) is None


def test_differences_have_one_scale_about_zero():
    data = result({"latitude": [0.0, 15.0], "tracking": BOTH}, heliostats=40)
    made = view_payload(data, View("field", "", ("optical_efficiency",), ("heliostat",), less="tracking"))
    plain, first, second = made["quantities"][0]["shown"]
    spread = 100 * np.abs(data["optical_efficiency"].diff("tracking")).max().item()
    assert first["high"] == -first["low"] == pytest.approx(spread)
    assert (plain["unit"], second["unit"]) == ("%", "percentage points")
    assert second["label"].endswith("less that of azimuth-elevation (percentage points)")


def test_equal_steps_and_equal_ratios():
    labels = {"hour": [15.0, 9.0, 12.0], "height": [1.0, 10.0, 100.0], "width": [1.0, 2.0, 4.0]}
    data = xr.Dataset({"a": (tuple(labels), np.arange(27.0).reshape(3, 3, 3))}, labels)
    made = view_payload(data, View("curves", "", ("a",), tuple(labels)))
    assert [one["kind"] for one in made["dims"].values()] == ["number", "power", "number"]
    assert made["dims"]["height"]["at"] == pytest.approx([0, 1, 2])
    assert made["dims"]["hour"]["texts"] == ["9", "12", "15"]
    assert numbers(made, "a")[:, 0, 0].to_numpy() == pytest.approx([9, 18, 0])


@pytest.mark.parametrize(
    "label", ["short (m)", "place on the mirror, to the right as seen from the target, " * 4, "W" * 199]
)
def test_labels_fit_a_narrow_plot(label):
    lines = payload.fold(label, 30).split("\n")
    assert len(lines) <= payload.MOST_FOLDS
    assert all(len(line) <= 30 for line in lines)
    assert (" ".join(lines).replace("\N{NO-BREAK SPACE}", " ") == label) == (label == "short (m)")


def test_maps_know_the_edges_of_the_field_its_ground_and_signs():
    data = result({"latitude": [0.0, 15.0]}, heliostats=40)
    data = data.assign_coords(z=0.1 * data["y"]).assign_attrs(layout_boundary="POLYGON ((-9 -9, 9 -9, 9 9, -9 -9))")
    data["cosine_efficiency"] = data["cosine_efficiency"] - 0.75
    view = View("field", "", ("optical_efficiency", "cosine_efficiency"), ("heliostat",))
    made = view_payload(data, view)
    assert [ring.tolist() for ring in made["areas"]["boundary"]] == [[[-9, -9], [9, -9], [9, 9], [-9, -9]]]
    assert numbers(made, "z").to_numpy() == pytest.approx(0.1 * data["y"].to_numpy())
    assert [one["shown"][0]["signed"] for one in made["quantities"]] == [False, True]
    _, plots = interactive.explore(data, [view])
    assert "MultiLine" in json.dumps(plots, default=str)
    assert (
        "z"
        not in view_payload(result(heliostats=9), View("field", "", ("optical_efficiency",), ("heliostat",)))["places"]
    )


def test_bokeh_knows_all_that_its_client_is_given(caplog):
    labels: dict[str, Any] = {
        "method": ["LM", EVIL],
        "date": np.arange("2021-01-01", "2021-02-10", dtype="datetime64[D]").astype("datetime64[ns]"),
        "height": np.geomspace(1, 1000, 5),
        "hour": [9.0, 12.0, 15.0],
        "z": np.linspace(-1, 1, 30),
        "y": np.linspace(1, -1, 20),
    }
    arrays = {"slope": ("method", "z", "y"), "factor": ("method", "date", "height", "hour"), "u": ("method", "hour")}
    mirror = xr.Dataset({name: (dims, np.ones([len(labels[dim]) for dim in dims])) for name, dims in arrays.items()})
    mirror = mirror.assign(v=mirror["u"]).assign_coords(labels)
    plane = View("plane", "", ("u",), ("hour",), lines=("method",), against={"u": "v"}, outline=(8.0, 6.0))
    field = result({"latitude": [0.0, 15.0], "tracking": BOTH}, heliostats=40)
    field = field.assign_attrs(layout_boundary="POLYGON ((-9 -9, 9 -9, 9 9, -9 -9))")
    fields = View("field", "", ("optical_efficiency",), ("heliostat",), less="tracking")
    drawn = [
        *interactive.explore(mirror, [*default_views(mirror), plane])[1].values(),
        *interactive.explore(field, [fields])[1].values(),
    ]
    kinds, bare = set[str](), {"title": "", "config": {"type": "object", "name": "DocumentConfig", "id": "config"}}
    for item in drawn:
        doc: Any = {**bare, **item["doc"]}
        document = Document.from_json(doc)
        document.validate()
        (plot,) = document.roots
        assert plot.id == item["root_id"]
        kinds |= {type(one).__name__ for one in plot.references()}
    assert caplog.messages == []  # of attributes that it does not know
    assert {"Image", "Rect", "MultiLine", "Line", "DatetimeAxis", "FixedTicker", "AdaptiveTicker"} <= kinds
    read = plot.tags[0]["quantities"][0]["values"]
    assert 100 * field["optical_efficiency"].to_numpy().ravel() == pytest.approx(read, rel=1e-6)
