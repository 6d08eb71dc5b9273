"""Selection of points by keys of the study and labels as text."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from heliosweep.errors import StudyError
from heliosweep.share.fields import chosen, label

DATA = xr.DataArray(
    np.arange(12.0).reshape(2, 3, 1, 2),
    {"tracking": ["one", "two"], "receiver_height": [60.0, 80.0, 100.0], "site": ["A"], "day": [80, 172]},
    name="energy",
)


def test_labels_may_be_text_and_keys_dotted():
    found = chosen(DATA, {"receiver.height": "80", "tracking": "two"}, ["day"])
    assert found.to_numpy().tolist() == [8.0, 9.0]  # dimensions of length 1 need no label
    assert label(DATA, "day", "172") == 172
    dates = xr.DataArray([1.0, 2.0], {"date": np.array(["2021-03-20", "2021-06-21"], "datetime64[ns]")})
    assert float(chosen(dates, {"date": "2021-06-21"})) == 2.0


@pytest.mark.parametrize(
    ("select", "message"),
    [
        ({"tracking": "two"}, r"choose one value of receiver_height \(receiver_height: 60.0, 80.0, 100.0\)"),
        ({"receiver.height": 80.5}, "select.receiver_height: is not in the result; choose from 60.0, 80.0, 100.0"),
        ({"day": 80.7}, r"select.day: is not in the result; choose from 80, 172 \(got 80.7\)"),
        ({"tracking": "too"}, "did you mean 'two'"),
        ({"clearance": 3}, "select.clearance: is not a dimension of the result"),
    ],
)
def test_what_is_not_there_is_named(select, message):
    with pytest.raises(StudyError, match=message):
        chosen(DATA, {"day": 80, **select} if "day" not in select else select)
