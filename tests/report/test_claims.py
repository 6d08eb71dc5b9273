"""Claims of a publication: statistics, differences, bounds, dates, directions, and those that cannot be compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from heliosweep.report.claims import conversion, expected
from heliosweep.report.comparison import (
    compare,
    comparison_csv,
    published_in,
    read_comparison,
    read_published,
    told,
)
from tests.report.test_comparison import problems

SITES = ["Naqu", "Dunhuang", "Haerbin"]
LATITUDES = [31.29, 40.13, 45.42]
DIRECTIONS = np.arange(0.0, 360.0, 15.0)
DATES = np.arange("2021-01-01", "2022-01-01", dtype="datetime64[D]").astype("datetime64[ns]")
DAY = np.arange(DATES.size)


@pytest.fixture(scope="module")
def dataset():
    """A factor with its greatest value at 345 deg, its least on 21 June, that falls with the latitude of the site."""
    shape = np.cos(np.deg2rad(DIRECTIONS + 15.0))
    year = 0.1 * np.cos(2 * np.pi * (DAY - 171) / DATES.size)
    factor = 0.5 - 0.001 * np.array(LATITUDES)[:, None, None] + 0.2 * shape[:, None] - year
    return xr.Dataset(
        {
            "factor": (("site", "direction", "date"), factor, {"units": "1"}),
            "worst_day": (("site",), DATES[[171, 172, 354]]),
            "monthly": (("month",), [3.0, 2.0, 1.0], {"units": "1"}),
            "drift": (("site",), [0.001, 0.002, np.nan], {"units": "rad"}),
        },
        {
            "site": SITES,
            "latitude": ("site", LATITUDES, {"units": "degrees_north"}),
            "direction": ("direction", DIRECTIONS, {"units": "degree"}),
            "date": DATES,
            "month": np.array(["2021-01", "2021-02", "2021-03"], dtype=object),
        },
    )


@pytest.fixture
def row(tmp_path, dataset):
    """Compares one claim, whose coordinates are given as columns."""

    def compared(quantity, published, unit="1", tolerance="", **where):
        path = tmp_path / "table.csv"
        cells = [*where.values(), quantity, published, unit, tolerance]
        path.write_text(
            ",".join([*where, "quantity,published,unit,tolerance"]) + "\n" + ",".join(cells) + "\n", encoding="utf-8"
        )
        return compare(dataset, read_published(path, "A paper", "table.csv")).values[0]

    return compared


CASES = {
    "least of all": ("factor", "0.1545", "1", "0.001", {"site": "Haerbin", "direction": "min", "date": "min"}),
    "greatest less least": ("factor", "0.4", "1", "1e-9", {"site": "Naqu", "direction": "max - min", "date": "max"}),
    "best direction": ("factor", "345", "deg", "0", {"site": "Naqu", "direction": "argmax", "date": "2021-06-21"}),
    "the shorter way round": ("factor", "0", "deg", "15", {"site": "Naqu", "direction": "argmax", "date": "mean"}),
    "one of two directions": (
        "factor", "0 or 165", "deg", "0", {"site": "Naqu", "direction": "argmin", "date": "mean"},
    ),
    "best within a range": (
        "factor", "0", "deg", "0", {"site": "Naqu", "direction": "argmax of 0 to 90", "date": "mean"},
    ),
    "day of the least": ("factor", "2021-06-20", "days", "1", {"site": "Naqu", "direction": "0", "date": "argmin"}),
    "in a month": ("factor", "2021-06", "days", "", {"site": "Naqu", "direction": "0", "date": "argmin"}),
    "falls until June": (
        "factor", "< 0", "1", "", {"site": "Naqu", "direction": "0", "date": "largest step of 2021-01 to 2021-05"},
    ),
    "falls with latitude": ("factor", "< 0", "1", "", {"latitude": "largest step", "direction": "0", "date": "mean"}),
    "correlates with latitude": (
        "factor", "-1", "1", "1e-9", {"latitude": "correlation", "direction": "0", "date": "mean"},
    ),
    "southernmost is best": ("factor", "31.29", "deg", "0", {"latitude": "argmax", "direction": "0", "date": "mean"}),
    "first minus second": ("factor", "> 0", "1", "", {"site": "Naqu - Haerbin", "direction": "min", "date": "min"}),
    "south minus north": (
        "factor", "0.011 to 0.012", "1", "", {
            "latitude": "mean of < 40 - mean of > 40", "direction": "0", "date": "mean",
        },
    ),
    "count": ("factor", "3", "1", "0", {"site": "count > 0.4", "direction": "345", "date": "max"}),
    "dates of a result": ("worst_day", "2021-06-21", "days", "0", {"site": "Naqu"}),
    "months have an order": ("monthly", "< 0", "1", "", {"month": "largest step of 2021-02 to 2021-03"}),
    "month of the least": ("monthly", "2021-03-01", "days", "0", {"month": "argmin"}),
    "another unit": ("drift", "1", "mrad", "1e-9", {"site": "Naqu"}),
    "missing values are left out": ("drift", "2", "mrad", "1e-9", {"site": "max"}),
    "difference of two quantities": (
        "factor - factor", "0", "1", "0", {"site": "max", "direction": "0", "date": "max"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_claims_that_hold_agree(row, name):
    quantity, published, unit, tolerance, where = CASES[name]
    one = row(quantity, published, unit, tolerance, **where)
    assert one.verdict == "agrees", one


@pytest.mark.parametrize(
    ("case", "published", "difference"),
    [
        ("best direction", "0", -15),
        ("one of two directions", "0 or 180", -15),
        ("day of the least", "2021-12-21", -183),
        ("falls with latitude", "> 0", -0.00529),
        ("first minus second", "> 0.1", -0.08587),
        ("south minus north", "0.012 to 0.02", -0.000515),
        ("count", "2", 1),
    ],
)
def test_claims_that_do_not_hold_say_by_how_much(row, case, published, difference):
    quantity, _, unit, tolerance, where = CASES[case]
    one = row(quantity, published, unit, "0" if tolerance else "", **where)
    assert one.verdict == "does not agree"
    assert one.difference == pytest.approx(difference, rel=1e-3, nan_ok=True)


def test_a_bound_is_strict_and_a_missing_value_never_agrees(row):
    same = {"site": "Naqu - Naqu", "direction": "0", "date": "mean"}
    assert row("factor", "> 0", **same).verdict == row("factor", "< 0", **same).verdict == "does not agree"
    assert row("factor", ">= 0", **same).verdict == row("factor", "0 to 1", **same).verdict == "agrees"
    assert row("drift", "> -1000000", "mrad", site="Haerbin").verdict == "does not agree"
    assert row("drift", "> -1000000", "mrad", site="max of Haerbin").verdict == "does not agree"


@pytest.mark.parametrize(
    ("quantity", "published", "unit", "where", "said"),
    [
        ("factor", "1", "1", {"site": "Naqu", "direction": "minimum", "date": "min"},
         "direction must be a number, a range, a bound or a statistic (got 'minimum')"),
        ("factor", "1", "1", {"site": "correlation", "direction": "0", "date": "min"},
         "site has no correlation: its labels are words"),
        ("factor", "1", "1", {"site": "Naqu", "direction": "0 to 90 - 180", "date": "min"},
         "direction '0 to 90' is more than one point: take one of"),
        ("factor", "1", "1", {"site": "Naqu", "direction": "0", "date": "max of 2022"},
         "date has dates (got '2022')"),
        ("factor", "1", "1", {"site": "min", "latitude": "max", "direction": "0", "date": "min"},
         "latitude 'max': taken twice along 'latitude'"),
        ("factor", "Naqu", "1", {"site": "Naqu", "direction": "0", "date": "min"}, "published must be a finite number"),
        ("factor", "1", "", {"site": "Naqu", "direction": "0", "date": "min"}, "unit is empty"),
        ("factor", "2 to 1", "1", {"site": "Naqu", "direction": "0", "date": "min"}, "(got '2 to 1')"),
        ("factor", "1", "1", {"site": "argmin", "direction": "0", "date": "min"}, "site has no argmin"),
        ("factor", "1", "deg", {"site": "Naqu", "direction": "argmin - argmax", "date": "min"}, "of two values"),
        ("worst_day", "2021-06-21", "days", {"site": "max"}, "worst_day is a date, of which site 'max' cannot"),
        ("worst_day - worst_day", "1", "days", {"site": "Naqu"}, "words and differences of dates cannot be compared"),
        ("factor", "1", "1", {"site": "Naqu", "direction": "0", "date": "2022-01"}, "has 2021-01-01, 2021-01-02,"),
        ("factor", "1", "1", {"site": "Naqu", "direction": "0", "date": "argmin"},
         "factor is a date here, which '1' is not"),
        ("drift", "1", "m", {"site": "Naqu"}, "drift is in rad, which cannot be compared with unit 'm'"),
        ("factor - drift", "1", "1", {"site": "Naqu"}, "must be one quantity, or two with the same"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_told_at_its_line(row, quantity, published, unit, where, said):
    [problem] = problems(lambda: row(quantity, published, unit, "0" if unit else "", **where))
    assert problem.startswith("table.csv:2:")
    assert said in problem


TABLE = """claim,direction,site,date,quantity,published,unit,tolerance,reason,computed,verdict
Figure 7a: best direction,argmax,Naqu,mean,factor,345,deg,0,,345,agrees
Figure 7b: worst direction,argmin,Naqu,mean,factor,75,deg,15,steps of 15 deg,165,does not agree
Table 3: day of the least,0,Naqu,argmin,factor,2021-06-21,days,2,sampling,2021-06-21,agrees
Conclusions 2: Naqu above Haerbin,0,Naqu - Haerbin,mean,factor,> 0,1,,,0.01413,agrees
Table 2,0,Naqu,2021-06-21,factor,0.57,1,0.1,measured,0.562,agrees
Figure 1: photograph,,,,,a dish,,,no photograph is made,,cannot be compared
"""


@pytest.fixture
def compared(dataset, tmp_path):
    """Compares the table of claims, of which parts may be replaced."""

    def made(*changes):
        text = TABLE
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "claims.csv"
        path.write_text(text, encoding="utf-8")
        return compare(dataset, read_published(path, "A paper", "claims.csv"))

    return made


def test_a_table_of_claims(compared, dataset):
    found = compared()
    assert [one.verdict for one in found.values] == [
        "agrees", "does not agree", "agrees", "agrees", "agrees", "cannot be compared",
    ]  # fmt: skip
    assert not found.agrees
    assert found.summary == (
        "4 of 5 published values agree, largest difference 90 deg and 0 days and 0.0081, 1 cannot be compared"
    )
    table = found.table(dataset)
    assert table.header[:2] == ["claim", "quantity compared"]
    assert table.header[-2:] == ["reason", "verdict"]
    assert table.rows[1][-7:] == ["165.0", "75", "+90.0", "15", "deg", "steps of 15 deg", "does not agree"]
    assert table.rows[-1][-7:] == ["", "a dish", "", "", "", "no photograph is made", "cannot be compared"]
    assert [kind.split()[0] for kind in table.classes[-2:]] == ["agrees", "apart"]


def test_a_run_that_differs_from_what_the_table_states_says_so(compared):
    assert compared().surprises == []
    changes = [
        (",165,does not agree", ",165,agrees"),
        ("sampling,2021-06-21", "sampling,2021-06-20"),
        (",0.562,", ",0.567,"),
        ("made,,cannot be compared", "made,,agrees"),
    ]
    assert compared(*changes).surprises == [
        "Figure 7b: worst direction: the table states 'agrees', but it does not agree",
        "Table 3: day of the least: the table states that 2021-06-20 is computed, but 2021-06-21 is",
        "Table 2: the table states that 0.567 is computed, but 0.562 is",
        "Figure 1: photograph: the table states 'agrees', but it has no quantity",
    ]


def test_claims_are_stored_and_read_back(compared, tmp_path):
    found = replace(compared(), source="A paper")
    path = tmp_path / "comparison.csv"
    path.write_text(comparison_csv(found), encoding="utf-8")
    again = read_comparison(path)
    assert again == found
    assert again.summary == found.summary
    assert again.surprises == []


def test_figures_mark_points_only(compared, dataset):
    """Numbers of a statistic are no point of a figure."""
    marked = told(dataset, compared().values)
    assert [one.claim for one in published_in(marked, "factor")] == ["Table 2"]


def test_units_of_results_and_tables():
    assert conversion("1", "percent") == 100.0
    assert conversion("degree", "mrad") == pytest.approx(17.453292519943295, rel=1e-15)
    assert conversion("W m-2", "W m-2") == 1.0
    with pytest.raises(ValueError, match="no multiple"):
        conversion("degree", "m")


def test_rounding_is_relative_to_what_is_expected():
    """A bound of 1e-12 is no bound of 1e-9."""
    assert not expected("<= 1e-12").holds(2e-12, 0)
    assert expected("84.45").holds(84.475, 0.025)
    assert not expected("0").holds(1e-15, 0)


def test_a_month_is_all_its_days():
    [(first, last, _)] = expected("2021-06").intervals
    assert last - first == 29
    assert not expected("> 2021-06").holds(last, 0)
    assert expected("> 2021-06").holds(last + 1, 0)
