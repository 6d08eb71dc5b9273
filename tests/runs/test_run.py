"""One run: folders tried out before anything is computed, parts in words, progress."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from heliosweep import api
from heliosweep.grid.regions import Part
from heliosweep.runs import status
from heliosweep.runs.run import place_of
from heliosweep.store.folder import made


def test_a_folder_that_stays_empty_goes(tmp_path):
    with pytest.raises(ZeroDivisionError), made(tmp_path / "a/b"):
        1 / len(list((tmp_path / "a/b").iterdir()))
    assert not list(tmp_path.iterdir())
    with made(tmp_path / "a/b"):
        pass
    assert (tmp_path / "a/b").is_dir()


def test_what_came_into_it_stays(tmp_path):
    with pytest.raises(FileExistsError), made(tmp_path / "a/b"):
        [(tmp_path / "a/b/working").mkdir() for _ in range(2)]
    assert (tmp_path / "a/b/working").is_dir()


def test_a_folder_that_another_run_takes_with_it_is_made_anew(tmp_path, monkeypatch):
    def vanishing(path: Path, **options: bool) -> None:
        touch(path, **options)
        monkeypatch.undo()
        path.unlink()
        path.parent.rmdir()

    touch = Path.touch
    monkeypatch.setattr(Path, "touch", vanishing)
    with made(tmp_path / "a/b"):
        assert (tmp_path / "a/b").is_dir()


def test_words_for_the_place_of_a_part(small):
    study = small(site={"latitude": [0, 20, 40]})
    coordinates = api.family_of(study).coordinates(study)
    region = {"latitude": slice(0, 2), "tracking": slice(1, 2), "heliostat": slice(3, 7)}
    assert place_of(Part("points-00000", "points", region), coordinates) == (
        "latitude 0.0 to 20.0, tracking azimuth_elevation, heliostat 3 to 6"
    )
    assert place_of(Part("points-00000", "points", {}), coordinates) == "all"


def test_lines_without_a_terminal(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(status, "LINE_SECONDS", -1.0)
    with status.show_progress("study", 4, stream) as advance:
        for _ in range(4):
            advance()
    lines = stream.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("study: 25 %, about ")


def test_bar_on_a_terminal():
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    stream = Terminal()
    with status.show_progress("mirrors [/bold] of [m]", 4, stream) as advance:
        advance()
    assert "mirrors [/bold] of [m]" in stream.getvalue()
