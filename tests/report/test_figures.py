"""Figures of the family `field_efficiency`: how many, on which scale, with which words, whatever was swept."""

from __future__ import annotations

from functools import cache

import matplotlib
import numpy as np
import pytest
import xarray as xr

from heliosweep.families.field_efficiency import figures as drawing
from heliosweep.families.field_efficiency.figures import figures
from heliosweep.report.style import image
from tests.report.synthetic import BOTH, assert_readable, result, with_series

LATITUDES = {"latitude": [0.0, 15.0, 30.0]}
DAYS = np.repeat([1.0, 80.0, 172.0], 3)
HOURS = np.tile([6.0, 12.0, 18.0], 3)


def drawn(dataset):
    """Figures by name, each laid out."""
    found = {named.name: named for named in figures(dataset)}
    for named in found.values():
        named.figure.draw_without_rendering()
    return found


def one(dataset, name):
    """One figure, and those before it are not laid out."""
    named = next(named for named in figures(dataset) if named.name == name)
    named.figure.draw_without_rendering()
    return named


@cache
def case(name):
    return drawn(CASES[name]())


def maps_of(figure):
    return [axes for axes in figure.axes if "field mean" in axes.get_title() or "points" in axes.get_title()]


def layouts():
    """Two layouts of 7 and 5 heliostats; the second is padded."""
    dataset = result({"layout": ["wide.csv", "dense.csv"], "tracking": BOTH})
    outside = xr.DataArray(np.arange(7) >= 5, dims="heliostat") & xr.DataArray([False, True], dims="layout")
    names = ("cosine_efficiency", "shading_efficiency", "blocking_efficiency", "optical_efficiency")
    dataset = dataset.assign({name: dataset[name].where(~outside) for name in names})
    return dataset.assign_coords({name: dataset[name].where(~outside) for name in ("x", "y", "z")})


def nothing():
    dataset = result({**LATITUDES, "tracking": BOTH})
    return dataset.assign({name: array * np.nan for name, array in dataset.data_vars.items()}).assign_attrs(
        dataset.attrs
    )


def zipped():
    """Tracking tied to the receiver's height on one dimension."""
    dataset = result({"receiver_height": [90.0, 100.0]})
    return dataset.assign_coords(tracking=("receiver_height", list(BOTH)))


def sited():
    dataset = result({"site": ["Almeria", "Alice Springs"], "tracking": BOTH})
    return dataset.assign_coords(latitude=("site", [37.1, -23.7], {"units": "degree", "long_name": "latitude"}))


CASES = {
    "table": lambda: result({**LATITUDES, "tracking": BOTH}),
    "one heliostat": lambda: result({**LATITUDES, "tracking": BOTH}, heliostats=1),
    "no sweep": lambda: result(latitude=30.0, tracking="azimuth_elevation"),
    "tracking alone": lambda: result({"tracking": BOTH}, latitude=-15.0),
    "one method": lambda: result({"latitude": np.arange(-60.0, 61, 5)}, tracking="spinning_elevation"),
    "sites": sited,
    "layouts": layouts,
    "zip": zipped,
    "no value": nothing,
    "many": lambda: result(
        {"clearance": [1.0, 10.0, 100.0], "receiver_height": [80.0, 90.0], **LATITUDES, "tracking": BOTH}
    ),
    "no coordinate": lambda: result({"layout": ["a", "b"]}).drop_vars("layout"),
    "series": lambda: with_series(
        result({**LATITUDES, "tracking": BOTH}), {"day": ("time", DAYS), "solar_hour": ("time", HOURS)}
    ),
    "series of declinations": lambda: with_series(
        result({"tracking": BOTH}), {"declination": ("time", DAYS / 10), "solar_hour": ("time", HOURS)}
    ),
    "series of dates": lambda: with_series(
        result(),
        {"time": ("time", np.arange("2026-06-20T04", "2026-06-22T20", 60, dtype="datetime64[m]").astype("M8[ns]"))},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_axes_say_what_they_are_and_nothing_is_cut_off(name):
    for named in case(name).values():
        assert_readable(named)


def test_one_map_for_each_method_and_latitude():
    found = case("table")
    assert list(found) == ["field_maps", "difference_maps"]
    titles = [axes.get_title().splitlines()[0] for axes in maps_of(found["field_maps"].figure)]
    assert titles == [
        f"{method}, latitude {latitude}"
        for method in ("spinning-elevation", "azimuth-elevation")
        for latitude in ("0\N{DEGREE SIGN}", "15\N{DEGREE SIGN} N", "30\N{DEGREE SIGN} N")
    ]
    assert len(maps_of(found["difference_maps"].figure)) == 3


def test_maps_show_the_values_in_their_places_on_one_scale():
    dataset = result({"latitude": np.arange(-60.0, 61, 20), "tracking": BOTH})
    found = drawn(dataset)
    sheets = [named for name, named in found.items() if name.startswith("field_maps")]
    assert len(sheets) == 2
    assert all("Shown are 6 of 7 values of latitude" in named.caption for named in sheets)
    shown = [axes for named in sheets for axes in maps_of(named.figure)]
    assert len(shown) == 12
    assert len({axes.collections[0].get_clim() for axes in shown}) == 1
    low, high = shown[0].collections[0].get_clim()
    first = shown[0].collections[0]
    np.testing.assert_array_equal(first.get_array(), 100 * dataset["optical_efficiency"].isel(latitude=0, tracking=0))
    assert low <= 100 * float(dataset["optical_efficiency"].min())
    assert high >= 100 * float(dataset["optical_efficiency"].max())
    centres = np.array([path.vertices[:4].mean(axis=0) for path in first.get_paths()])
    np.testing.assert_allclose(centres, np.stack([dataset["x"], dataset["y"]], axis=-1), atol=1e-9)


def test_maps_have_equal_axes_and_the_tower():
    figure = case("table")["field_maps"].figure
    width, height = figure.get_size_inches()
    for axes in maps_of(figure):
        box = axes.get_position()
        x, y = (high - low for low, high in (axes.get_xlim(), axes.get_ylim()))
        assert box.width * width / x == pytest.approx(box.height * height / y)
        assert [line.get_marker() for line in axes.lines] == ["^"]  # the tower


def test_differences_are_spinning_minus_azimuth_whatever_the_order():
    dataset = result({**LATITUDES, "tracking": BOTH[::-1]})
    figure = one(dataset, "difference_maps").figure
    optical = 100 * dataset["optical_efficiency"].isel(latitude=0)
    expected = optical.sel(tracking="spinning_elevation") - optical.sel(tracking="azimuth_elevation")
    squares = maps_of(figure)[0].collections[0]
    np.testing.assert_allclose(squares.get_array(), expected)
    low, high = squares.get_clim()
    assert low == -high


def test_southern_latitudes():
    found = case("tracking alone")
    assert "latitude 15\N{DEGREE SIGN} S" in maps_of(found["field_maps"].figure)[0].get_title()


def test_sites_are_named_with_their_latitude():
    titles = [axes.get_title() for axes in maps_of(case("sites")["field_maps"].figure)]
    assert "azimuth-elevation, Alice Springs (23.7\N{DEGREE SIGN}\N{NO-BREAK SPACE}S)" in titles[3]


def test_padded_heliostats_are_left_out():
    shown = maps_of(case("layouts")["field_maps"].figure)
    assert [len(axes.collections[0].get_paths()) for axes in shown] == [7, 5, 7, 5]


def test_efficiency_against_latitude():
    dataset = result({"latitude": [-30.0, -10.0, 10.0, 30.0], "tracking": BOTH})
    panels = one(dataset, "efficiency_over_latitude").figure.axes
    assert [axes.get_ylabel().split()[0] for axes in panels] == ["optical", "cosine", "shading", "blocking"]
    for axes in panels:
        assert [line.get_label() for line in axes.lines] == ["spinning-elevation", "azimuth-elevation"]
    values = panels[2].lines[1].get_ydata()
    np.testing.assert_array_equal(values, 100 * dataset["field_shading_efficiency"].sel(tracking="azimuth_elevation"))


def test_sweeps_of_several_numbers_draw_a_few_figures_and_say_which():
    found = case("many")
    assert list(found) == [
        "efficiency_over_clearance",
        "efficiency_over_receiver_height",
        "field_maps",
        "difference_maps",
    ]
    assert found["efficiency_over_clearance"].figure.axes[0].get_xscale() == "log"
    assert "receiver height 80 m" in found["efficiency_over_clearance"].caption
    assert "clearance 10 m (one of 3), receiver height 80 m (one of 2)" in found["field_maps"].caption


def test_large_fields_are_drawn():
    found = drawn(result({"tracking": BOTH}, heliostats=4000))
    assert maps_of(found["field_maps"].figure)[0].collections[0].get_array().size == 4000


def test_days_of_a_series(monkeypatch):
    dataset = CASES["series"]()
    read = set()
    means = drawing.field_means

    def noted(here, part):
        read.add((part.start, part.stop))
        return means(here, part)

    monkeypatch.setattr(drawing, "field_means", noted)
    named = one(dataset, "day_courses")
    panels = named.figure.axes
    assert len(panels) == 6
    assert [line.get_label() for line in panels[0].lines] == ["day 80 (March equinox)", "day 172 (June solstice)"]
    assert read == {(3, 6), (6, 9)}
    series = dataset["instantaneous_optical_efficiency"].isel(latitude=0, tracking=0, time=slice(3, 6))
    np.testing.assert_allclose(panels[0].lines[0].get_ydata(), 100 * series.mean("heliostat"))
    np.testing.assert_array_equal(panels[0].lines[0].get_xdata(), [6, 12, 18])


def test_means_are_weighted_by_area_and_read_in_pieces(monkeypatch):
    dataset = with_series(result(heliostats=2), {"day": ("time", [1.0, 1, 1]), "solar_hour": ("time", [6.0, 12, 18])})
    dataset = dataset.assign_coords(heliostat_width=("heliostat", [1.0, 3.0]))
    whole = drawing.field_means(dataset, slice(0, 3))
    monkeypatch.setattr(drawing, "PIECE", 1)
    np.testing.assert_array_equal(drawing.field_means(dataset, slice(0, 3)), whole)
    one, other = dataset["instantaneous_optical_efficiency"].to_numpy()[1]
    assert np.isnan(whole[0])
    assert whole[1] == pytest.approx(100 * (one + 3 * other) / 4)


def test_drawing_leaves_no_trace_and_is_the_same_every_time():
    before = dict(matplotlib.rcParams)
    first = [image(named.figure) for named in figures(CASES["table"]())]
    assert dict(matplotlib.rcParams) == before
    assert first == [image(named.figure) for named in figures(CASES["table"]())]


@pytest.mark.parametrize("kind", ["svg", "pdf"])
def test_vector_images_are_the_same_every_time(kind):
    one, other = (image(next(iter(figures(CASES["tracking alone"]()))).figure, kind) for _ in range(2))
    assert one == other
