"""Figures and tables of energy hold the numbers of the result; there are none where there is nothing to show."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from heliosweep import api
from heliosweep.families.field_efficiency import figures_energy as drawing
from heliosweep.families.field_efficiency import interactive
from heliosweep.families.field_efficiency.figures import figures
from heliosweep.families.field_efficiency.tables import tables
from heliosweep.report import sections
from heliosweep.report.views import usable
from tests.report.synthetic import assert_readable

BLOCKS: dict[str, Any] = {
    "site": None,
    "sites": [
        {"name": "A", "latitude": 37, "longitude": -6, "timezone": "+01:00"},
        {"name": "B", "latitude": -23, "longitude": 15, "timezone": "+01:00"},
    ],
    "time": {
        "clock": "civil", "dates": ["2025-03-21", "2025-06-21", "2025-12-21"],
        "window": {"start": "04:00", "stop": "22:00", "step": 1}, "sampling": "midpoint",
    },
    "weather": {"clear_sky": {"model": "meinel"}},
    "limits": {"dni": 200, "sun_elevation": 15},
    "design_point": {"day": 80, "solar_hour": 12, "dni": 900},
    "heliostat": {"width": 9, "height": 8, "pivot_height": 5, "focus": "slant"},
    "receiver": {"kind": "cylinder", "height": 60, "radius": 2, "height_extent": 4},
    "optics": {
        "sun_shape": {"kind": "pillbox"}, "slope_error": 2, "reflectivity": 0.9, "attenuation": "delsol_clear",
        "method": "gaussian",
    },
    "output": {"field_series": True},
}  # fmt: skip
PLAIN = {"optics": None, "receiver": {"height": 60}, "heliostat": {"width": 9, "height": 8, "pivot_height": 5}}
NEW = {"energy_losses", "monthly_energy", "energy_by_rank", "factor_maps", "duration_curves", "hours_lost"}


@pytest.fixture(scope="module")
def energy(small) -> xr.Dataset:
    return api.build(small(**BLOCKS)).compute()


@pytest.fixture(scope="module")
def drawn(energy) -> dict[str, Any]:
    return {one.name: one for one in figures(energy)}


def bars(axes: Any) -> np.ndarray:
    """Start and length of all horizontal bars, from the top."""
    return np.array([(patch.get_x(), patch.get_width()) for patch in axes.patches])


def points(result: xr.Dataset) -> list[dict[str, int]]:
    """Points in the order of the panels: methods beside each other, sites below each other."""
    return [{"site": site, "tracking": method} for site in range(2) for method in range(2)]


def test_all_figures_are_there_and_readable(drawn, energy):
    assert set(drawn) == NEW | {"field_maps", "difference_maps"}
    for one in drawn.values():
        one.figure.draw_without_rendering()
        assert_readable(one, {"stage", "month", "site", "rank of the heliostat"})


def test_bars_of_the_waterfall_lead_from_incident_to_received(drawn, energy):
    panels = drawn["energy_losses"].figure.axes
    for axes, point in zip(panels, points(energy), strict=True):
        here, found = energy.isel(point), bars(axes)
        words = [label.get_text() for label in panels[2 * point["site"]].get_yticklabels()]
        assert words[:2] == ["incident", "stow (limits)"]
        assert words[2:] == [*here["stage"].to_numpy()[1:], "on the receiver"]
        np.testing.assert_allclose(found[0], [0, here["field_incident_energy"]], rtol=1e-12)
        np.testing.assert_allclose(found[-1], [0, here["field_receiver_energy"]], rtol=1e-12)
        np.testing.assert_allclose(found[1:-1, 1], here["loss"], rtol=1e-12)
        ends = np.append(found[1:-1].sum(axis=1), found[-1, 1])  # each bar ends where the one above begins
        np.testing.assert_allclose(ends, [found[0, 1], *found[1:-1, 0]], rtol=1e-9)
        text = axes.texts[-1].get_text()
        received = 100 * float(here["field_receiver_energy"] / here["field_incident_energy"])
        assert text.endswith(f"({received:.1f} %)")


def test_stages_that_take_nothing_are_left_out(small):
    result = api.build(small(**{**BLOCKS, **PLAIN, "limits": None, "output": {}})).compute()
    found = {one.name: one for one in figures(result)}
    words = [label.get_text() for label in found["energy_losses"].figure.axes[0].get_yticklabels()]
    assert words == ["incident", "cosine", "shading", "blocking", "sent to the receiver"]
    assert not {"hours_lost", "duration_curves", "factor_maps"} & set(found)
    assert "sent to the receiver" in found["energy_losses"].caption
    assert next(iter(tables(result))).header[2] == "energy sent to the receiver"


def test_months(drawn, energy):
    for site, axes in enumerate(drawn["monthly_energy"].figure.axes):
        heights = np.array([patch.get_height() for patch in axes.patches]).reshape(3, 12)
        np.testing.assert_allclose(heights[0], energy["monthly_incident_energy"].isel(site=site, tracking=0))
        np.testing.assert_allclose(heights[1:], energy["monthly_receiver_energy"].isel(site=site))
        assert set(np.flatnonzero(heights[1])) == {2, 5, 11}
        assert axes.get_title().startswith("AB"[site])


def test_ranks_fall_and_their_shares_add_up_to_the_whole(drawn, energy):
    each, share = drawn["energy_by_rank"].figure.axes
    for line, total, point in zip(each.lines, share.lines, points(energy), strict=True):
        here = energy.isel(point)
        np.testing.assert_array_equal(line.get_xdata(), np.arange(1, energy.sizes["heliostat"] + 1))
        assert (np.diff(line.get_ydata()) <= 0).all()
        assert line.get_ydata()[0] == here["energy_per_mirror_area"].max()
        np.testing.assert_allclose(total.get_ydata()[-1], 100)
        np.testing.assert_allclose(
            total.get_ydata()[0], 100 * here["receiver_energy"].max() / here["receiver_energy"].sum()
        )


def test_below_a_duration_curve_lies_the_energy(drawn, energy):
    panels = drawn["duration_curves"].figure.axes
    assert [axes.get_ylabel().split(" (")[0].replace("\n", " ") for axes in panels[:2]] == [
        "direct normal irradiance",
        "power of the field",
    ]
    for site in range(2):
        (dni,), powers = panels[2 * site].lines, panels[2 * site + 1].lines
        area = float(energy["field_mirror_area"][site, 0])
        assert _area(dni) * area * 1e-6 == pytest.approx(float(energy["field_incident_energy"][site, 0]))
        for method, line in enumerate(powers):
            assert _area(line) == pytest.approx(float(energy["field_receiver_energy"][site, method]))
            assert line.get_xdata()[-1] == pytest.approx(float(energy["hours_used"][site, method]))


def _area(line: Any) -> float:
    hours, values = line.get_data()
    return float(np.sum(np.diff(hours, prepend=0.0) * values))


def test_hours_used_and_lost(drawn, energy):
    (axes,) = drawn["hours_lost"].figure.axes
    found = bars(axes).reshape(3, 2, 2)  # used, dni, sun_elevation; no wind is known
    np.testing.assert_allclose(found[0, :, 1], energy["hours_used"].isel(tracking=0))
    np.testing.assert_allclose(found[1:, :, 1], energy["hours_lost"].isel(tracking=0, cause=[0, 1]).T)
    np.testing.assert_allclose(found[1:, :, 0], found[:-1].sum(axis=2))


def test_maps_of_factors_and_of_energy(drawn, energy):
    panels = [axes for axes in drawn["factor_maps"].figure.axes if axes.get_title()]
    here = energy.isel(site=0, tracking=0)
    for axes, name in zip(panels, drawing._FACTORS, strict=True):
        np.testing.assert_allclose(axes.collections[0].get_array(), 100 * here[name])
        assert axes.get_title() == f"field mean {100 * float(here[f'field_{name}']):.2f} %"
    assert "spinning-elevation" in drawn["factor_maps"].caption
    assert "A" in drawn["factor_maps"].caption
    first = drawn["field_maps"].figure.axes[0]
    np.testing.assert_allclose(first.collections[0].get_array(), here["energy_per_mirror_area"])
    assert f"field mean {float(here['field_energy_per_mirror_area']):.4f} MWh/m\N{SUPERSCRIPT TWO}" in first.get_title()
    assert "MWh" in " ".join(axes.get_xlabel() for axes in drawn["difference_maps"].figure.axes)


def test_the_first_table_answers(energy):
    first, losses, design, means = sections.results(energy, tables(energy))["tables"]
    assert list(zip(first.header, first.units, strict=True))[2:] == [
        ("energy on the receiver", "MWh"), ("efficiency", "%"), ("power at the design point", "MW"),
        ("mirror area", "m\N{SUPERSCRIPT TWO}"), ("heliostats", ""),
        ("energy per mirror area", "MWh/m\N{SUPERSCRIPT TWO}"), ("hours used", "h"),
    ]  # fmt: skip
    for row, point in zip(first.rows, points(energy), strict=True):
        here = energy.isel(point)
        efficiency = 100 * here["field_receiver_energy"] / here["field_incident_energy"]
        names = (
            "design_point_power",
            "field_mirror_area",
            "field_heliostats",
            "field_energy_per_mirror_area",
            "hours_used",
        )
        wanted = [here["field_receiver_energy"], efficiency, *(here[name] for name in names)]
        for text, value in zip(row[2:], wanted, strict=True):  # to half of the last digit
            text = text.replace(",", "")
            assert float(text) == pytest.approx(float(value), abs=0.501 * 10.0 ** -len(text.partition(".")[2]))
    assert "not those of a year" in first.notes[0]
    for row in losses.rows:
        received = 100 - sum(map(float, row[3:]))
        assert received == pytest.approx(float(first.rows[losses.rows.index(row)][3]), abs=0.05)
    assert design.header[2:5] == ["power", "total", "optical"]  # sizes stand in the first
    assert means.header[2:4] == ["total", "optical"]


def test_sums_over_a_year_are_called_so(energy):
    hours = xr.full_like(energy["hours_used"], 4400.0)
    year = energy.assign(hours_used=hours - energy["hours_lost"].sum("cause"))
    assert "Sums over the 4,400 h of a year with the sun above the horizon." in next(iter(tables(year))).notes[0]


def test_a_design_point_alone_and_the_flux_that_is_there(small):
    result = api.build(small(design_point=BLOCKS["design_point"])).compute()
    assert not NEW & {one.name for one in figures(result)}
    first, _ = tables(result.assign(peak_flux=result["design_point_power"].assign_attrs(units="kW m-2")))
    assert first.label == "Power and efficiencies of the field at the design point"
    assert first.header[2:6] == ["power", "mirror area", "heliostats", "peak flux"]
    assert float(first.rows[0][2]) == pytest.approx(float(result["design_point_power"][0, 0]), abs=0.005)


def test_old_results_have_their_figures_and_no_tables_of_energy(small):
    result = api.build(small()).compute()
    assert [one.name for one in figures(result)] == ["field_maps", "difference_maps"]
    assert list(tables(result)) == []


def test_sun_that_never_rises(small):
    sites = [{"name": "dark", "latitude": 85, "longitude": 0, "timezone": "+00:00"}, BLOCKS["sites"][0]]
    time = {**BLOCKS["time"], "dates": ["2025-12-21"]}
    result = api.build(small(**{**BLOCKS, "sites": sites, "time": time})).compute()
    for one in figures(result):
        one.figure.draw_without_rendering()
    assert "\N{EN DASH}" in next(iter(tables(result))).rows[0]


def test_views_of_energy(energy):
    views = {view.title: view for view in usable(energy, interactive.views(energy))}
    assert views["Energy and efficiency of every heliostat"].quantities[:2] == (
        "energy_per_mirror_area",
        "total_efficiency",
    )
    assert views["Energy of the field by month"].along == ("month",)
    assert "field_power" in views["Power of the field"].quantities


def test_curves_over_a_swept_number(small):
    optics = {**BLOCKS["optics"], "slope_error": [1, 3]}
    site = {key: value for key, value in BLOCKS["sites"][0].items() if key != "name"}
    result = api.build(small(**{**BLOCKS, "optics": optics, "sites": None, "site": site})).compute()
    found = {one.name: one for one in figures(result)}
    panels = {axes.get_ylabel(): axes for axes in found["efficiency_over_slope_error"].figure.axes}
    label, *rest = panels
    assert label == "energy per mirror area (MWh/m\N{SUPERSCRIPT TWO})"
    assert rest == [f"{name} efficiency (%)" for name in ("total", "intercept")]  # the others do not change
    assert "cosine efficiency, shading efficiency, blocking efficiency" in found["efficiency_over_slope_error"].caption
    for method, line in enumerate(panels[label].lines):
        wanted = result["field_energy_per_mirror_area"].isel(tracking=method)
        np.testing.assert_allclose(np.asarray(line.get_ydata()), wanted)
    assert len(found["hours_lost"].figure.axes[0].get_yticks()) == 1  # the hours do not depend on what is swept
