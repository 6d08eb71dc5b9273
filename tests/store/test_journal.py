"""The journal of a run: what a line says, and what of a damaged one is believed."""

from __future__ import annotations

import json

import pytest

from heliosweep.store.journal import Journal


def test_written_and_read(tmp_path):
    path = tmp_path / "journal.jsonl"
    journal = Journal.read(path)
    assert not journal.done
    journal.write("points-00000", sha256="ab", seconds=1.5)
    journal.write("points-00001", failed="ValueError: é", seconds=0.25)
    for known in (journal, Journal.read(path)):
        assert known.done == {"points-00000": "ab"}
        assert known.failed == {"points-00001": "ValueError: é"}
        assert known.seconds == 1.75
    assert [json.loads(line)["part"] for line in path.read_text().splitlines()] == ["points-00000", "points-00001"]


def test_the_last_word_counts(tmp_path):
    journal = Journal(tmp_path / "journal.jsonl")
    journal.write("a", failed="once")
    journal.write("a", sha256="1")
    journal.write("b", sha256="2")
    journal.write("b", dropped="damaged")
    journal.write("c", sha256="3")
    journal.write("c", failed="again")
    again = Journal.read(journal.path)
    assert (again.done, again.failed) == ({"a": "1"}, {"c": "again"})


@pytest.mark.parametrize("torn", [b"{", b'{"part": "b", "sha256": "2"}', b"\xff\xfe", b"\0" * 50, b"\r"])
def test_a_torn_line_is_cut_off_by_the_next(tmp_path, torn):
    path = tmp_path / "journal.jsonl"
    Journal(path).write("a", sha256="1")
    whole = path.read_bytes()
    path.write_bytes(whole + torn)
    journal = Journal.read(path)
    assert journal.done == {"a": "1"}
    assert path.read_bytes() == whole + torn  # reading changes nothing: another run may be at work
    journal.write("c", sha256="3")
    assert Journal.read(path).done == {"a": "1", "c": "3"}
    assert len(path.read_bytes().splitlines()) == 2


def test_what_is_no_line_is_passed_over(tmp_path):
    path = tmp_path / "journal.jsonl"
    bad = [
        b"",
        b"[]",
        b"null",
        b'"a"',
        b'{"sha256": "1"}',
        b'{"part": "a", "seconds": "long"}',
        b"\xff",
        b"[" * 10**5,
        b"\r",
    ]
    path.write_bytes(b"\n".join([*bad, b'{"part": "b", "sha256": "2"}', b""]))
    journal = Journal.read(path)
    assert (journal.done, journal.failed) == ({"b": "2"}, {})
    journal.write("c", sha256="3")
    assert Journal.read(path).done == {"b": "2", "c": "3"}
