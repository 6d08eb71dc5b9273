"""What the tables of published numbers state: the numbers, the verdicts, also the negative ones, and their index."""

from __future__ import annotations

import pytest

from tests.literature.index import BEGIN, END, README, claims, index

TABLES = list(claims())

#: Studies that take long: their own tests run them once, and ask the same.
LONG = ("defieux2020_table1",)


@pytest.mark.parametrize("one", [one for one in TABLES if one.name not in LONG], ids=lambda one: one.name)
def test_each_number_and_verdict_is_the_stated_one(one):
    assert one.compared().surprises == []


def test_each_row_states_a_verdict_and_each_table_has_one_study():
    for one in TABLES:
        for row in one.table.values:
            assert row.stated_verdict, f"{one.table.file}:{row.line}"
    assert len({one.path for one in TABLES}) == len(TABLES)


def test_the_index_of_papers_is_that_of_the_tables():
    """After a change of a table: ``make index``."""
    written = README.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    assert written.strip() == index(TABLES).strip()
