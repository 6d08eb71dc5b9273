"""Time zones come from the package that the results name; one way from the wall clock to universal time."""

from __future__ import annotations

import datetime as dt
import os
import pickle
import subprocess
import sys
import zoneinfo
from importlib import resources

import pandas as pd
import pytest

from heliosweep.config.zones import names, parse_timezone, to_utc, zone

#: Prints the offset of Berlin in summer, as a study gets it, and as Python would give it.
_SCRIPT = """
import datetime as dt, pickle, zoneinfo
from heliosweep.config.zones import parse_timezone
noon = dt.datetime(2021, 6, 21, 12)
for found in (parse_timezone("Europe/Berlin"), pickle.loads(pickle.dumps(parse_timezone("Europe/Berlin")))):
    print(noon.replace(tzinfo=found).utcoffset())
print(noon.replace(tzinfo=zoneinfo.ZoneInfo("Europe/Berlin")).utcoffset())
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
    assert done.stdout.split() == ["2:00:00", "2:00:00", "9:00:00"]


def test_every_name_of_the_package():
    assert len(names()) > 500
    for name in names():
        assert zone(name).key == name
    assert {"UTC", "Asia/Calcutta", "US/Eastern", "America/Argentina/Buenos_Aires"} <= names()


@pytest.mark.parametrize(
    "name", ["", ".", "..", "Europe", "europe/berlin", "../zones", "/etc/localtime", "a\0b", "tzdata"]
)
def test_no_other_file(name):
    with pytest.raises(KeyError):
        zone(name)


def test_one_object_for_a_name_and_no_other_state():
    assert parse_timezone("Europe/Berlin") is zone("Europe/Berlin")
    assert pickle.loads(pickle.dumps(zone("Europe/Berlin"))) is zone("Europe/Berlin")
    assert zoneinfo.ZoneInfo("Europe/Berlin") is not zone("Europe/Berlin")


def test_pandas_takes_it():
    times = pd.date_range("2021-03-28T00:00", periods=4, freq="h", tz="UTC").tz_convert(zone("Europe/Berlin"))
    assert [time.hour for time in times] == [1, 3, 4, 5]
    local = pd.Timestamp("2021-06-21T12:00").tz_localize(zone("Europe/Berlin"))
    assert local.utcoffset() == dt.timedelta(hours=2)


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
