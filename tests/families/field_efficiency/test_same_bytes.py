"""One study, one file: the same bytes for any scheduler, worker count and chunking."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from heliosweep import api
from heliosweep.store.read import file_digest

EXECUTIONS: list[dict[str, Any]] = [
    {"scheduler": "synchronous", "workers": 1},
    {"scheduler": "threads", "workers": 3},
    {"scheduler": "processes", "workers": 2},
    {"chunks": {"heliostat": 7}},
    {"chunks": {"latitude": 2, "tracking": 1, "heliostat": 1000}},
    {"chunks": {"heliostat": 11, "time": 4}},
]


OUTPUTS: dict[str, dict[str, Any]] = {
    "annual": {"time_series": False},
    "compressed series": {"time_series": True, "compression": "zlib"},
    "series of the field": {"time_series": True, "field_series": True},
}


@pytest.mark.parametrize("output", OUTPUTS)
def test_same_bytes(small, tmp_path, output):
    digests = set()
    for number, execution in enumerate(EXECUTIONS):
        study = small(execution=execution, output=OUTPUTS[output])
        digests.add(file_digest(api.run(study, tmp_path / str(number), report=False).path))
    assert len(digests) == 1


def test_time_series_do_not_change_the_annual_numbers(small, tmp_path):
    """`output` is no part of the study's identity, so annual values must have the same bits with and without series."""
    plain, series = (small(output={"time_series": on}) for on in (False, True))
    assert plain.study_id == series.study_id
    with (
        api.run(plain, tmp_path / "plain", report=False).open() as annual,
        api.run(series, tmp_path / "series", report=False).open() as both,
    ):
        for name in annual.data_vars:
            np.testing.assert_array_equal(annual[name], both[name])
        for name in ("cosine", "shading", "blocking", "optical"):
            mean = both[f"instantaneous_{name}_efficiency"].mean("time")
            np.testing.assert_allclose(mean, both[f"{name}_efficiency"], rtol=1e-13)
