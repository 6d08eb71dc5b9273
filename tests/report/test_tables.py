"""Tables: numbers with their decimals, ranges, points of a sweep in the right order."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from heliosweep.report.tables import Column, Table, default_tables, headlines, numbers, ranges


def test_a_result_without_common_dimensions_has_ranges():
    result = xr.Dataset(
        {
            "spot": (
                ("hour", "heliostat"),
                np.array([[1.0, np.nan], [-3.0, 2.0]]),
                {"long_name": "spot", "units": "m"},
            ),
            "share": ("heliostat", [0.5, 1.0], {"long_name": "share", "units": "1"}),
            "status": ((), 1, {"flag_values": [0, 1], "flag_meanings": "no yes"}),
        }
    )
    rows = list(zip(*(column.values for column in ranges(result, ["share"]).columns), strict=True))
    assert [row[0] for row in rows] == ["share", "spot"]  # headlines first, flags not at all
    assert rows[1] == ("spot", "\N{MINUS SIGN}3", "1", "2", "m")
    whole, others = default_tables(result.drop_vars("status"))
    assert whole.columns[1].values == [0.5, 1.0]
    assert others.columns[0].values == ["spot"]


@pytest.mark.parametrize(("best", "order"), [("largest", [6, 5, 4, 3, 2, 1]), ("smallest", [1, 2, 3, 4, 5, 6])])
def test_six_points_are_sorted_and_fewer_become_columns(best, order):
    attrs = {"units": "m", "best_value": best}
    data = xr.Dataset({"size": ("tilt", [3.0, 1.0, 2.0, 6.0, 5.0, 4.0], attrs), "area": ("tilt", np.ones(6)),
                       "cost": ("tilt", np.ones(6))}, {"tilt": range(6)})  # fmt: skip
    printed = numbers(data, ["tilt"], [data[name] for name in ("size", "area", "cost")], "Sizes").printed()
    assert [float(row[1]) for row in printed["rows"]] == order
    few = data.isel(tilt=slice(2))
    printed = numbers(few, ["tilt"], [few[name] for name in ("size", "area", "cost")], "Sizes").printed()
    assert printed["header"] == ["", "0", "1", ""]
    assert printed["rows"][0] == ["size", "3", "1", "m"]


def test_a_frame_has_full_numbers_units_and_errors():
    table = Table(
        "Errors", [Column("mount", ["A", "B"]), Column("error", [1.23456789, 2.0], "mrad", errors=[0.01, 0.5])]
    )
    frame = table.frame()
    assert list(frame) == ["mount", "error (mrad)", "standard error of error (mrad)"]
    assert frame["error (mrad)"].tolist() == [1.23456789, 2.0]
    assert table.printed()["rows"] == [("A", "1.235 \N{PLUS-MINUS SIGN} 0.010"), ("B", "2.00 \N{PLUS-MINUS SIGN} 0.50")]


def test_a_headline_names_the_heliostat():
    tolerance = xr.DataArray(
        [6.7, 14.1, 9.0], dims="heliostat", attrs={"units": "mrad", "long_name": "least tolerance"}
    )
    names = ("heliostat", ["H020", "H021", "H022"])
    result = xr.Dataset({"minimum_tolerance": tolerance}, {"heliostat": [0, 1, 2], "name": names})
    (headline,) = headlines(result, ["minimum_tolerance"])
    assert str(headline).startswith("least tolerance: 6.7")
    assert headline.note == "minimum at heliostat H020"
