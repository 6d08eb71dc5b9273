"""Statements of the tables of published numbers and of the claims, also the negative ones, and their index."""

from __future__ import annotations

import pytest

from tests.literature.index import BEGIN, CLAIMS, END, README, index, stale, tables

TABLES = list(tables())
#: Studies that take long: their own tests run them once, and check the same.
LONG = ("defieux2020_table1",)
STUDIES_OF_CLAIMS = sorted({one.study for every in CLAIMS.values() for one in every if one.value} - {*LONG})


@pytest.mark.parametrize(
    "one",
    [
        # Four million rays take 0.5 GB.
        pytest.param(one, marks=pytest.mark.long) if one.name == "round_robin_2025" else one
        for one in TABLES
        if one.name not in LONG
    ],
    ids=lambda one: one.name,
)
def test_each_number_and_verdict_is_the_stated_one(one):
    assert one.compared().surprises == []


@pytest.mark.parametrize("name", STUDIES_OF_CLAIMS)
def test_each_claim_is_as_stated(name):
    assert stale(name) == []


def test_each_row_states_a_verdict_and_each_table_has_one_study():
    for one in TABLES:
        for row in one.table.values:
            assert row.stated_verdict, f"{one.table.file}:{row.line}"
    assert len({one.path for one in TABLES}) == len(TABLES)


def test_the_index_of_papers_is_that_of_the_tables():
    """After a change of a table or claim: ``make index``."""
    written = README.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    assert written.strip() == index(TABLES).strip()
