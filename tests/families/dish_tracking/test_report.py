"""Figures of the family `dish_tracking`: which there are, on which axes, with which words, whatever was swept."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgba

from heliosweep import api
from heliosweep.families.dish_tracking.figures import MOST_FIGURES, OFFSETS, figures
from heliosweep.report.colours import NO_VALUE
from tests.families import gallery
from tests.families.studies import computed

DIRECTIONS = {"axis_tilt_direction": np.arange(0.0, 360, 30)}
DAY = np.array(["2021-06-21"], dtype="datetime64[ns]")
YEAR = np.arange("2021-01-01", "2022-01-01", 7, dtype="datetime64[D]").astype("datetime64[ns]")
LATITUDES = {"latitude": np.arange(-60.0, 61, 10)}
SITES = {"site": ["Dunhuang", "Naqu", "Kunming"]}
#: Keys of swept dimensions and of numbers.
KEYS = {
    **{name: f"errors.{name}" for name in ("axis_tilt", "axis_tilt_direction", *OFFSETS)},
    **{"latitude": "site.latitude", "model": "mount.model", "tolerance": "tolerance"},
}


def result(sweep=None, dates=DAY, required=(), **scalars):
    """Result of a study over any sweep."""
    sweep = dict(sweep or {})
    study = {
        "family": "dish_tracking",
        "time": {
            "clock": "civil",
            "timezone": "+08:00",
            "dates": dates.astype("datetime64[D]").astype(str).tolist(),
            "window": {"start": "07:00", "stop": "21:00", "step": "1 h"},
            "sampling": "left",
        },
        "mount": {"model": "rigid"},
        "errors": {"axis_tilt": 0.1},
        "tolerance": 4,
    }
    if sites := sweep.pop("site", ()):
        study["sites"] = [{"name": name, "latitude": 40.13 - i / 4, "longitude": 94.67} for i, name in enumerate(sites)]
    else:
        study["site"] = {"latitude": 40.13, "longitude": 94.67}
    if len(required):
        study["statistics"] = {"required_factor": list(required)}
    return computed(api.load(study, {KEYS[name]: value for name, value in (sweep | scalars).items()}))


def dark(dataset):
    """The same without a factor on a third of the dates, and on none at the last place."""
    night = xr.DataArray(np.arange(dataset.sizes["date"]) % 3 == 0, dims="date")
    place = dataset["effective_tracking_factor"].dims[0]
    last = xr.DataArray(np.arange(dataset.sizes[place]) == dataset.sizes[place] - 1, dims=place)
    masked = {
        name: array.where(~(night | last) if "date" in array.dims else ~last)
        for name, array in dataset.data_vars.items()
    }
    return dataset.assign(masked)


def perfect(dataset):
    """The same with a factor of one everywhere."""
    return dataset.assign({name: array * 0 + 1 for name, array in dataset.data_vars.items() if array.dtype == float})


STEPS = np.linspace(-1, 1, 9)
CASES = {
    "no sweep": lambda: result(axis_tilt=0.1, model="rigid"),
    "no sweep over a year": lambda: result(dates=YEAR, axis_tilt=0.1, axis_tilt_direction=0.0),
    "no sweep over a year with tilts": lambda: result(dates=YEAR, required=[0.5, 0.7]),
    "directions": lambda: result(DIRECTIONS, axis_tilt=0.1),
    "two directions": lambda: result({"axis_tilt_direction": [-90.0, 90.0]}, dates=YEAR),
    "one direction": lambda: result({"axis_tilt_direction": [30.0]}, dates=YEAR, required=[0.5]),
    "sites": lambda: result({**SITES, **DIRECTIONS}),
    "sites alone": lambda: result(SITES),
    "sites and tilts over a year": lambda: result(
        {**SITES, "axis_tilt": [0.05, 0.1], **DIRECTIONS}, dates=YEAR, required=[0.5, 0.9]
    ),
    "many sites": lambda: result({"site": [f"Place number {i}" for i in range(300)], **DIRECTIONS}),
    "latitudes": lambda: result({**LATITUDES, "axis_tilt": [0.1, 0.2], **DIRECTIONS}, dates=YEAR, required=[0.5, 0.9]),
    "tilts alone": lambda: result({"axis_tilt": np.linspace(0, 0.3, 12)}, dates=YEAR),
    "offsets": lambda: result(
        {**DIRECTIONS, "home_azimuth_offset": STEPS, "home_elevation_offset": STEPS}, axis_tilt=0.1
    ),
    "offset over a year": lambda: result({"home_azimuth_offset": STEPS}, dates=YEAR),
    "models": lambda: result({"model": ["rigid", "untilted_home_axes"], **LATITUDES, **DIRECTIONS}, dates=YEAR),
    "everything": lambda: result(
        {
            **SITES,
            "axis_tilt": [0.1, 0.2],
            **DIRECTIONS,
            "home_azimuth_offset": [-1.0, 0.0, 1.0],
            "tolerance": [4.0, 8.0],
        },
        dates=YEAR,
        required=[0.5],
    ),
    "nights": lambda: dark(result({**LATITUDES, **DIRECTIONS}, dates=YEAR, required=[0.5])),
    "nights at sites": lambda: dark(result({**SITES, **DIRECTIONS, "home_azimuth_offset": STEPS}, dates=YEAR)),
    "two dates": lambda: result(DIRECTIONS, dates=YEAR[:2]),
    "zip": lambda: result({"axis_tilt": [0.1, 0.2]}).assign_coords(
        axis_tilt_direction=("axis_tilt", [0.0, 90.0], {"long_name": "direction", "units": "degree"})
    ),
    "no coordinate": lambda: result({"site": ["a", "b"], **DIRECTIONS}, dates=YEAR).drop_vars("site"),
    "one direction and two sites": lambda: result({"site": ["a", "b"], "axis_tilt_direction": [30.0]}),
    "perfect": lambda: perfect(result({**DIRECTIONS, "axis_tilt": [0.0, 0.1]}, dates=YEAR)),
}


EXPECTED = {
    "no sweep": "",
    "no sweep over a year": "factor_over_year factor_by_month",
    "directions": "factor_over_axis_tilt_direction",
    "sites": "factor_over_axis_tilt_direction directions_over_site",
    "sites alone": "directions_over_site",
    "latitudes": "factor_over_axis_tilt_direction deviation_over_axis_tilt_direction directions_over_latitude "
    "directions_over_axis_tilt factor_over_year factor_by_month months_over_directions extremes latitude_map "
    "tolerable_axis_tilt",
    "offsets": "factor_over_axis_tilt_direction offsets_over_axis_tilt_direction directions_over_offsets "
    "tracking_errors",
}
GALLERY = gallery.Gallery(figures, MOST_FIGURES, CASES, EXPECTED, ("site", "model"), crowd=(8, 20))
one = GALLERY.one


def test_offsets_are_drawn_with_the_other_one_at_zero():
    dataset = GALLERY.result("offsets")
    factor = dataset["effective_tracking_factor"].isel(date=0)
    level, steep = one(dataset, "offsets_over_axis_tilt_direction").figure.axes
    at_zero = factor.sel(home_elevation_offset=0.0)
    np.testing.assert_array_equal(level.get_lines()[0].get_ydata(), at_zero.sel(home_azimuth_offset=-1.0))
    at_zero = factor.sel(home_azimuth_offset=0.0)
    np.testing.assert_array_equal(steep.get_lines()[0].get_ydata(), at_zero.sel(home_elevation_offset=-1.0))
    mean, spread = one(dataset, "directions_over_offsets").figure.axes
    np.testing.assert_allclose(mean.get_lines()[1].get_ydata(), at_zero.mean("axis_tilt_direction"))
    np.testing.assert_allclose(spread.get_lines()[1].get_ydata(), at_zero.std("axis_tilt_direction", ddof=1))


def test_course_of_a_day_stands_on_the_clock():
    hours = np.array([-1.0, 6.0, 12.0, 18.0, 25.0])
    dataset = result({**SITES, **DIRECTIONS}).assign_coords(
        time=DAY[0] + ((hours - 8.0) * 3600e9).astype("timedelta64[ns]"), timezone=("site", ["+08:00"] * 3)
    )
    errors = np.arange(3 * 12 * 5.0).reshape(3, 12, 5)
    dataset["tracking_error"] = ("site", "axis_tilt_direction", "time"), errors
    # over midnight the azimuth from south jumps from 170 to -175 deg
    dataset["solar_azimuth"] = ("site", "time"), np.tile([340.0, 350.0, 5.0, 90.0, 200.0], (3, 1))
    dataset["solar_elevation"] = ("site", "time"), np.tile([-30.0, -20.0, 0.0, 40.0, 10.0], (3, 1))
    azimuth, elevation = one(dataset, "path_of_the_sun").figure.axes
    np.testing.assert_array_equal(elevation.get_lines()[1].get_ydata(), [-20.0, 0.0, 40.0])
    np.testing.assert_array_equal(azimuth.get_lines()[1].get_xdata(), hours[1:4])
    np.testing.assert_allclose(azimuth.get_lines()[1].get_ydata(), [-190.0, -175.0, -90.0])
    course = one(dataset, "error_over_day").figure.axes[2].get_lines()[0]
    np.testing.assert_array_equal(course.get_ydata(), dataset["tracking_error"][2, 0, 1:4])


def test_lines_are_the_factor_of_the_only_date_or_the_mean_over_the_dates():
    one, year = result(DIRECTIONS), result(DIRECTIONS, dates=YEAR)
    for dataset, values, words in (
        (one, one["effective_tracking_factor"].isel(date=0), "on 2021-06-21"),
        (year, year["effective_tracking_factor_mean_over_dates"], "mean over 53 dates from 2021-01-01 to 2021-12-31"),
    ):
        named = next(figures(dataset))
        (line,) = named.figure.axes[0].get_lines()
        np.testing.assert_array_equal(line.get_ydata(), values)
        assert words in named.caption


def test_bars_of_sites_are_mean_and_sample_deviation_over_the_directions():
    dataset = result({**SITES, **DIRECTIONS})
    (axes,) = one(dataset, "directions_over_site").figure.axes
    (bars,) = axes.containers
    factor = dataset["effective_tracking_factor"].isel(date=0).to_numpy()
    (points,) = axes.get_lines()[-1:]
    np.testing.assert_allclose(points.get_ydata(), factor.mean(axis=1))
    half = [np.ptp(segment[:, 1]) / 2 for segment in bars.lines[2][0].get_segments()]
    np.testing.assert_allclose(half, factor.std(axis=1, ddof=1))
    assert [label.get_text() for label in axes.get_xticklabels()] == SITES["site"]


def test_year_shows_the_nearest_of_four_directions_around_the_circle():
    dataset = result({"axis_tilt_direction": [-355.0, -310.0, 80.0, 200.0]}, dates=YEAR)
    named = one(dataset, "factor_over_year")
    names = [text.get_text() for text in named.figure.legends[0].get_texts()]
    assert names == ["\N{MINUS SIGN}355\N{DEGREE SIGN}", "\N{MINUS SIGN}310\N{DEGREE SIGN}", "80\N{DEGREE SIGN}"]
    assert "Shown are 3 of 4 values of direction of the tilt." in named.caption


def test_directions_are_told_by_name_from_south_over_west():
    named = one(GALLERY.result("two directions"), "factor_over_year")
    names = [text.get_text() for text in named.figure.legends[0].get_texts()]
    assert names == ["\N{MINUS SIGN}90\N{DEGREE SIGN} east", "90\N{DEGREE SIGN} west"]
    assert "0 south, 90 west." in one(GALLERY.result("directions"), "factor_over_axis_tilt_direction").caption


def test_months_have_the_deviation_as_band():
    dataset = GALLERY.result("no sweep over a year with tilts")
    axes = one(dataset, "factor_by_month").figure.axes[0]
    mean, deviation = (dataset[f"monthly_effective_tracking_factor_{name}"] for name in ("mean", "std"))
    np.testing.assert_array_equal(axes.get_lines()[0].get_ydata(), mean)
    assert axes.get_lines()[0].get_xdata()[0] == np.datetime64("2021-01-15")
    heights = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert heights.max() == pytest.approx(float((mean + deviation).max()))
    assert heights.min() == pytest.approx(float((mean - deviation).min()))


def test_deviations_and_tolerable_tilts_stand_under_their_names():
    dataset = result({**LATITUDES, **DIRECTIONS}, dates=YEAR[::13], required=[0.5])
    spread, degree = "standard deviation (1)", "\N{DEGREE SIGN}"
    factor, months, south = "effective_tracking_factor", "months_over_directions", {"latitude": 0}
    for name, number, label, values in (
        (months, 0, "mean effective tracking factor (1)", dataset[f"monthly_{factor}_mean_over_directions"][south]),
        (months, 1, spread, dataset[f"monthly_{factor}_std_over_directions"][south]),
        ("deviation_over_axis_tilt_direction", 0, spread, dataset[f"{factor}_std_over_dates"][south]),
        ("tolerable_axis_tilt", 0, f"tolerable tilt ({degree})", dataset["tolerable_axis_tilt"][:, 0, 0]),
    ):
        axes = one(dataset, name).figure.axes[number]
        np.testing.assert_array_equal(axes.get_lines()[0].get_ydata(), values)
        assert axes.get_ylabel() == label


def test_extremes_stand_above_their_dates():
    dataset = result({**SITES, **DIRECTIONS}, dates=YEAR)
    figure = one(dataset, "extremes").figure
    values, dates = figure.axes[:3], figure.axes[3:]
    for place in range(3):
        least, largest = values[place].get_lines()
        np.testing.assert_array_equal(least.get_ydata(), dataset["effective_tracking_factor_min"][place])
        np.testing.assert_array_equal(largest.get_ydata(), dataset["effective_tracking_factor_max"][place])
        for line, name in zip(dates[place].get_lines(), ("date_of_min", "date_of_max"), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), dataset[name][place])
        assert values[place].get_ylim() == values[0].get_ylim()
    assert values[0].get_title() == "Dunhuang (40.13\N{DEGREE SIGN}\N{NO-BREAK SPACE}N)"


def test_map_shows_latitudes_upwards_and_nights_grey():
    dataset = dark(result({**LATITUDES, **DIRECTIONS}, dates=YEAR))
    axes, least = one(dataset, "latitude_map").figure.axes[:2]
    shown = np.ma.filled(axes.collections[0].get_array(), np.nan)
    np.testing.assert_array_equal(shown, dataset["effective_tracking_factor_mean_over_dates"])
    shown_least = np.ma.filled(least.collections[0].get_array(), np.nan)
    np.testing.assert_array_equal(shown_least, dataset["effective_tracking_factor_min"])
    assert np.isnan(shown[-1]).all()
    assert axes.collections[0].get_cmap().get_bad() == pytest.approx(to_rgba(NO_VALUE))


@pytest.mark.usefixtures("unplaced")
def test_largest_error_is_that_of_all_dates_with_a_factor():
    dataset = dark(result({**SITES, "home_azimuth_offset": STEPS}, dates=YEAR))
    mean, largest = one(dataset, "tracking_errors").figure.axes
    for axes, name, reduce in ((mean, "mean_tracking_error", np.nanmean), (largest, "max_tracking_error", np.nanmax)):
        np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), reduce(dataset[name][0], axis=0))
        assert np.isnan(axes.get_lines()[2].get_ydata()).all()


def test_captions_say_where_the_rest_stands():
    dataset = result(
        {"axis_tilt": [0.1, 0.2, 0.3], **LATITUDES, **DIRECTIONS},
        dates=YEAR,
        model="rigid",
        tolerance=4.0,
        home_azimuth_offset=0.0,
    )
    caption = one(dataset, "factor_over_year").caption
    assert "Fixed: tilt of the azimuth axis 0.1\N{DEGREE SIGN} (one of 3), model rigid, tolerance 4 mrad." in caption
    assert "Shown are 4 of 12 values of direction of the tilt and 6 of 13 values of latitude." in caption
    assert "offset" not in caption
