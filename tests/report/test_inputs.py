"""What went into a study, as the table on its page says it, and what came out where the family makes no table."""

import pytest

from heliosweep import api
from heliosweep.report.tables import inputs
from tests.conftest import STUDIES


def rows(name):
    table = inputs(api.load(STUDIES / f"{name}.yaml"))
    assert table is not None
    return [list(row) for row in zip(*(column.values for column in table.columns), strict=True)]


def test_what_is_swept_drawn_and_fixed_stands_in_this_order():
    assert rows("chong2012_table2")[:5] == [
        ["latitude", "0, 15, 30°", "swept, 3 values", "site.latitude"],
        ["sun-tracking method", "spinning elevation, azimuth elevation", "swept, 2 values", "tracking"],
        ["dates", "365 days of the year, 1 to 365", "", ""],
        ["hours", "8 to 16 h on the solar clock, 41 instants a day, sampling inclusive", "", ""],
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
