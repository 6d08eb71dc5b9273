"""Results keep CF-1.11 and ACDD-1.3, as the IOOS compliance checker sees it at its strictest.

What it finds all the same is listed with its reason: anything else fails.
"""

import re
import warnings
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import netCDF4
import pytest

from heliosweep import api
from heliosweep.config.source import parse
from heliosweep.families.family import families
from tests.conftest import STUDIES

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from compliance_checker import runner
    from compliance_checker.cf import util

    runner.CheckSuite.load_all_available_checkers()

# The checker asks for these lists of a file's variables thousands of times, and reads the table of names (10 MB) twice
# for each file.
for _name in (
    "get_auxiliary_coordinate_variables", "get_axis_variables", "get_time_variables", "StandardNameTable"
):  # fmt: skip
    setattr(util, _name, lru_cache(1)(getattr(util, _name)))

_PERSON = {"name": "Doe, Jane", "orcid": "0000-0002-1825-0097", "affiliation": "Institute of the Sun"}
DATASET = {
    "creators": [{**_PERSON, "email": "jane@example.org"}], "license": "CC-BY-4.0", "doi": "10.5281/zenodo.1234567",
    "keywords": ["heliostat field"],
}  # fmt: skip

#: What the CF checker says of results that is no fault of theirs, and why.
CF_EXPLAINED = {
    r"^\S+'s spatio-temporal dimensions are not in the recommended order": (
        "CF 2.4 recommends, and does not require, that date and latitude stand last: for maps. Here they are keys of a "
        "study; all dimensions stand in the order of its keys, the one that users and stored results rely on."
    ),
    r"^\S+'s cell_methods name component (time|realization) does not match a dimension": (
        "CF 7.3 lets a standard name stand there, and 7.3.4 says what it means: a method over an axis that is not in "
        "the file. The checker knows dimensions and coordinates only."
    ),
    r"^Dimension 'time' in variable '\S+' is expected to be a coordinate axis": (
        "CF needs no coordinate variable for a dimension; instants on the solar clock, or on several civil clocks, are "
        "told by the auxiliary coordinates day and solar_hour, or utc."
    ),
}
#: What ACDD recommends and results cannot have.
ACDD_EXPLAINED = {
    r"^standard_name$": "the CF table has no names for efficiencies, tracking factors, mount errors and slopes",
    r"^(date_|Attr date_)\w+": "a result holds no clock time, so that the same study gives the same bytes",
    r"^(contributor|publisher)_\w+ not present": "not known before the data set is published",
    r"^(project|program|institution|acknowledgment/acknowledgement) not present": "nothing that a study knows",
    r"^naming_authority not present": "the domain of whoever gives out the id: the study names it, or nobody does",
    r"^creator_type not present": "creators may be people and groups",
    r"^(platform|instrument)\w* not present": "computed, not observed",
    r"^keywords_vocabulary not present": "the keywords are of no vocabulary",
    r"^geospatial_(bounds|vertical)\w* not present": "sites are points, and mirrors have no height above the sea",
    r"^geospatial_(lat|lon)_resolution not present": "sites are points, not a raster",
    r"^Could not find vertical variable": "as above",
    r"^check_time_extents: 'MaskedArray' object has no attribute": "stumbles over sites with fewer instants",
    r"^geospatial_vertical_min/max attribute not found": "as above",
}
#: More that it cannot have where a study gives no latitude or longitude, or no dates.
NO_PLACE = r"^geospatial_(lat|lon)_(min|max|units|min/max attribute) not (present|found)"
NO_DATES = r"^time_coverage_\w+ not present|^Could not find .*time_coverage"


def findings(path: Any, test: str) -> Iterator[str]:
    """Messages of every check that is not passed whole."""
    suite = runner.CheckSuite()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dataset = suite.load_dataset(str(path))
        try:
            ((results, crashes),) = suite.run_all(dataset, [test]).values()
        finally:
            dataset.close()
    for name, (error, _) in crashes.items():
        yield f"{name}: {error}"
    waiting = list(results)
    while waiting:
        result = waiting.pop()
        waiting += result.children or ()
        score = result.value
        passed = score[0] == score[1] if isinstance(score, tuple) else bool(score)
        if not result.children and not passed:
            yield from result.msgs or [str(result.name)]


def unexplained(found: Iterator[str], explained: Mapping[str, str]) -> list[str]:
    return sorted({line for line in found if not any(re.search(pattern, line) for pattern in explained)})


def content_of(name: str) -> dict[str, Any]:
    """A shipped study, or the example of a family, as plain data with the names of its files made whole."""
    if name in families():
        return parse(families()[name].example(), Path(f"{name}.yaml")).data
    text = (STUDIES / f"{name}.yaml").read_text(encoding="utf-8")
    text = re.sub(r"\b((?:layouts|published|sites|spots|images)/\w+\.\w+)", lambda found: str(STUDIES / found[1]), text)
    return parse(text, Path(f"{name}.yaml")).data


def _two_zones(content: dict[str, Any]) -> dict[str, Any]:
    """On the civil clock, where the clocks of the sites differ and one of them loses an hour."""
    sites = [
        {"name": "here", "latitude": 40, "longitude": 10, "timezone": "Europe/Berlin"},
        {"name": "there", "latitude": 30, "longitude": 100, "timezone": "+08:00"},
    ]
    window = {"start": "01:00", "stop": "13:00", "step": "1 h"}
    time = {"clock": "civil", "dates": ["2021-03-28", "2021-06-21"], "window": window}
    return {key: value for key, value in content.items() if key != "site"} | {"sites": sites, "time": time}


FEW = {"layout": {"radial_stagger": {"clearance": 16, "inner_radius": 61.3, "heliostats": 5}}}
CASES: dict[str, Any] = {
    "field_efficiency": lambda: content_of("field_efficiency"),
    "field_efficiency, series": lambda: _two_zones(content_of("field_efficiency")) | {"output": {"time_series": True}},
    "dish_tracking, sites": lambda: content_of("liu2022_table2"),
    "misalignment, two zones": lambda: _two_zones(content_of("misalignment")),
    "misalignment, mount errors": lambda: (
        content_of("mount_error_monte_carlo") | {"time": {"clock": "solar", "days": [80], "hours": [9, 12]}} | FEW
    ),
    "misalignment, calibration": lambda: content_of("calibration_measured"),
    "backward_gazing, field": lambda: (
        (given := content_of("field_of_heliostats"))
        | {"method": ["A"], "referential": ["exact"], "field": given["field"] | FEW}
    ),
    "backward_gazing, measured": lambda: content_of("gazing_measured"),
}


@pytest.fixture(scope="module", params=CASES)
def result(request, tmp_path_factory):
    study = api.load(CASES[request.param]() | {"dataset": DATASET})
    return api.run(study, tmp_path_factory.mktemp("cf") / "result", report=False)


def test_cf(result):
    assert unexplained(findings(result.path, "cf:1.11"), CF_EXPLAINED) == []


def test_acdd(result):
    with netCDF4.Dataset(result.path) as file:
        names = set(file.ncattrs())
        missing = {NO_DATES: ""} if "time_coverage_start" not in names else {}
        single = {r"^time_coverage_resolution not present": "one date"}
        missing |= single if "time_coverage_resolution" not in names else {}
        missing |= {NO_PLACE: ""} if "geospatial_lon_min" not in names else {}
        assert {"title", "summary", "keywords", "creator_name", "license", "processing_level"} <= names
    assert unexplained(findings(result.path, "acdd:1.3"), ACDD_EXPLAINED | missing) == []
