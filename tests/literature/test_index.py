"""Statements of the tables of published numbers and of the claims, also the negative ones, and their index."""

from __future__ import annotations

import pytest

from tests.literature.index import BEGIN, CLAIMS, END, README, index, names, stale, table

#: Studies that take long: their own tests run them once, and check the same.
LONG = ("defieux2020_table1",)
STUDIES_OF_CLAIMS = sorted({one.study for every in CLAIMS.values() for one in every if one.value} - {*LONG})


@pytest.mark.parametrize(
    "name",
    [
        # four million rays take 0.3 GB
        pytest.param(name, marks=pytest.mark.long) if name.startswith("round_robin_2025") else name
        for name in names()
        if name not in LONG
    ],
)
def test_each_number_and_verdict_is_the_stated_one(name):
    assert table(name).compared().surprises == []


@pytest.mark.parametrize("name", STUDIES_OF_CLAIMS)
def test_each_claim_is_as_stated(name):
    assert stale(name) == []


def test_the_index_of_papers_is_that_of_the_tables():
    """After a change of a table or claim: ``make index``. Each row has a verdict, and each table one study."""
    tables = [*map(table, names())]
    assert all(row.stated_verdict for one in tables for row in one.table.values)
    assert len({one.path for one in tables}) == len(tables)
    written = README.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    assert written.strip() == index(tables).strip()
