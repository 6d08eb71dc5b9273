"""Time zones come from the package that the results name; one way from the wall clock to universal time."""

import datetime as dt
import os
import subprocess
import sys
from importlib import resources

import pytest

from heliosweep.config.times import parse_timezone, suggestion, to_utc

#: Prints the offset of Berlin in summer, as a study gets it.
_SCRIPT = """
import datetime as dt, pickle
from heliosweep.config.times import parse_timezone
noon = dt.datetime(2021, 6, 21, 12)
for found in (parse_timezone("Europe/Berlin"), pickle.loads(pickle.dumps(parse_timezone("Europe/Berlin")))):
    print(noon.replace(tzinfo=found).utcoffset())
"""


def test_false_data_of_the_system_change_nothing(tmp_path):
    (tmp_path / "Europe").mkdir()
    tokyo = resources.files("tzdata").joinpath("zoneinfo", "Asia", "Tokyo").read_bytes()
    (tmp_path / "Europe" / "Berlin").write_bytes(tokyo)
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT],
        env={**os.environ, "PYTHONTZPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["2:00:00", "2:00:00"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("CEST", ""), ("UTC+2", "'+02:00'"), ("GMT-7", "'-07:00'"), ("UTC +5:30", "'+05:30'"), ("Mars", ""),
        ("+2", "'+02:00'"), ("Berlin", "'Europe/Berlin'"), ("los angeles", "'America/Los_Angeles'"),
        ("europe/berlin", "'Europe/Berlin'"),
    ],
)  # fmt: skip
def test_hints_name_zones_whose_offset_can_be_meant(text, said):
    assert suggestion(text) == said


@pytest.mark.parametrize(
    ("timezone", "wall", "utc", "is_shown"),
    [
        ("Europe/Berlin", "2024-06-21 12:30:00.5", "2024-06-21 10:30:00.5", True),
        ("Europe/Berlin", "2024-03-31 01:59:59", "2024-03-31 00:59:59", True),
        ("Europe/Berlin", "2024-03-31 02:00:00", "2024-03-31 01:00:00", False),
        ("Europe/Berlin", "2024-03-31 02:59:59.5", "2024-03-31 01:00:00", False),
        ("Europe/Berlin", "2024-03-31 03:00:00", "2024-03-31 01:00:00", True),
        ("Europe/Berlin", "2024-10-27 02:30:00", "2024-10-27 00:30:00", True),  # the first of two
        ("Europe/Berlin", "2024-10-27 03:00:00", "2024-10-27 02:00:00", True),
        ("Australia/Lord_Howe", "2024-10-06 02:15:00", "2024-10-05 15:30:00", False),  # half an hour
        ("Pacific/Apia", "2011-12-30 12:00:00", "2011-12-30 10:00:00", False),  # a day that was left out
        ("America/St_Johns", "2024-01-01 00:00:00", "2024-01-01 03:30:00", True),
        ("-03:30", "2024-01-01 24:00:00", "2024-01-02 03:30:00", True),
    ],
)
def test_wall_clock(timezone, wall, utc, is_shown):
    day, _, clock = wall.partition(" ")
    seconds = sum(float(part) * unit for part, unit in zip(clock.split(":"), (3600, 60, 1), strict=True))
    found = to_utc(dt.date.fromisoformat(day), seconds, parse_timezone(timezone))
    assert found == (dt.datetime.fromisoformat(f"{utc}+00:00"), is_shown)
