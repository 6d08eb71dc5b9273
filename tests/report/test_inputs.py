"""What went into a study, as the table on its page says it, and what came out where the family makes no table."""

import numpy as np
import pytest
import xarray as xr

from heliosweep import api
from heliosweep.report.inputs import inputs
from heliosweep.report.labels import NOTHING
from heliosweep.report.sections import number_texts, ranges, results
from tests.conftest import STUDIES


def rows(name):
    table = inputs(api.load(STUDIES / f"{name}.yaml"), [("dates", "day 80 of the year")])
    assert table is not None
    return [list(row) for row in table.rows]


def test_what_is_swept_drawn_and_fixed_stands_in_this_order():
    assert rows("chong2012_table2")[:4] == [
        ["latitude", "0, 15, 30°", "swept, 3 values", "site.latitude"],
        ["sun-tracking method", "spinning elevation, azimuth elevation", "swept, 2 values", "tracking"],
        ["dates", "day 80 of the year", "", ""],
        ["layout: file", "chong2012.csv", "fixed", "layout.file"],
    ]
    found = rows("mount_error_monte_carlo")
    drawn = [row for row in found if row[2].startswith("drawn")]
    assert drawn[0] == [
        "azimuth reference error", "normal, mean 0, standard deviation 3\N{NO-BREAK SPACE}mrad", "drawn",
        "mount_errors.azimuth_reference",
    ]  # fmt: skip
    assert len(drawn) == 6
    kinds = [row[2].partition(",")[0] for row in found]
    assert kinds == sorted(kinds, key=["swept", "drawn", "", "fixed"].index)


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_study_has_a_table_without_paths_and_defaults(path):
    found = rows(path.stem)
    assert len(found) > 2
    for name, value, how, key in found:
        assert name
        assert value
        assert "/" not in value.replace("W/m2", "").replace("m/s", "").replace("/m", "")
        assert "None" not in value
        assert not key.startswith(("time", "title", "execution", "output", "dataset"))
        assert how or not key


def test_nothing_known_is_no_table():
    assert inputs(None, []) is None


def test_a_result_without_common_dimensions_tells_ranges():
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
    table = ranges(result, ["share"])
    assert [row[0] for row in table.rows] == ["share", "spot"]  # headlines first, flags not at all
    assert table.rows[1] == ["spot", "\N{MINUS SIGN}3", "1", "2", "m", "hour, heliostat"]
    whole, others = results(result.drop_vars("status"), ())["tables"]
    assert ([row[1] for row in whole.rows], [row[0] for row in others.rows]) == (["0.50", "1.00"], ["spot"])
    apart = result.drop_vars(["status", "share"]).assign(other=("day", [1.0]))
    (shown,) = results(apart, ())["tables"]
    assert shown.label == "Ranges over the dimensions"


def test_small_numbers_have_powers_of_ten():
    small = number_texts(np.array([0.0, 2.6e-6, -7.21e-5, np.nan]))
    assert [text.replace("\N{MINUS SIGN}", "-") for text in small] == ["0", "2.6e-06", "-7.21e-05", NOTHING]
    assert number_texts(np.array([0.0, 2.6e-6, 0.00721])) == ["0.00000", "0.00000", "0.00721"]
