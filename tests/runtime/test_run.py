"""One run: folders tried out before anything is computed, files that are watched, parts in words."""

from __future__ import annotations

import os

import pytest

from heliosweep import workflow
from heliosweep.errors import HeliosweepError
from heliosweep.grid.slabs import Part
from heliosweep.runtime.execute import place
from heliosweep.runtime.folder import made
from heliosweep.runtime.inputs import Inputs


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


def test_words_for_the_place_of_a_part(small):
    study = small(site={"latitude": [0, 20, 40]})
    coordinates = workflow.family_of(study).coordinates(study)
    region = {"latitude": slice(0, 2), "tracking": slice(1, 2), "heliostat": slice(3, 7)}
    assert place(Part("points-00000", "points", region), coordinates) == (
        "latitude 0.0 to 20.0, tracking azimuth_elevation, heliostat 3 to 6"
    )
    assert place(Part("points-00000", "points", {}), coordinates) == "all"


def test_inputs(tmp_path, small, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "layout.csv"
    path.write_text("x,y\n0,100\n20,100\n")
    watched = Inputs(small(layout={"file": "layout.csv"}))
    watched.check()
    os.utime(path, (1e9, 1e9))
    watched.check()  # the same words
    path.write_text("x,y\n0,100\n20,110\n")
    with pytest.raises(HeliosweepError, match=r"layout\.csv: was edited while the study ran"):
        watched.check()
    path.write_text("x,y\n0,100\n20,100\n")
    watched.check()
    path.unlink()
    with pytest.raises(HeliosweepError, match=r"layout\.csv"):
        watched.check()


def test_no_files_no_watching(small):
    Inputs(small()).check()
