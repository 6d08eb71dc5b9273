"""Weather by place from a server on the loopback address, with answers in the form of PVGIS 5.3 and NSRDB PSM4."""

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pandas as pd
import pytest

import heliosweep
from heliosweep import cli
from heliosweep.config.weather_files import read_weather
from heliosweep.errors import HeliosweepError, StudyError

# One day of the year, with round values: G(h), Gb(n), Gd(h), WS10m.
DAY = [(0, 0, 0, 1.7)] * 7 + [
    (60, 180, 42, 1.6), (190, 420, 81, 1.9), (330, 610, 92, 2.1), (430, 700, 98, 2.3), (470, 720, 101, 2.6),
    (450, 705, 99, 2.5), (370, 640, 95, 2.2), (240, 500, 85, 1.9), (95, 250, 55, 1.6),
]  # fmt: skip
DAY += [(0, 0, 0, 1.5)] * (24 - len(DAY))


def pvgis(tracked: bool) -> dict[str, Any]:
    times = pd.date_range("2019-01-01", "2020-01-01", freq="h", inclusive="left")
    keys = ("Gb(i)", "Gd(i)") if tracked else ("Gb(n)", "Gd(h)")
    rows = [
        {("time" if tracked else "time(UTC)"): f"{time:%Y%m%d:%H}{'10' if tracked else '00'}", "G(h)": g, keys[0]: b,
         keys[1]: d, "WS10m": w, **({"Int": 0, "H_sun": 1.0, "T2m": 9.0, "Gr(i)": 0.0} if tracked else {})}
        for time, (g, b, d, w) in zip(times, DAY * 365, strict=True)
    ]  # fmt: skip
    place = {"latitude": 45.0, "longitude": 8.0, "elevation": 250.0}
    place |= {} if tracked else {"irradiance_time_offset": 0.1761}
    outputs: dict[str, Any] = {"hourly": rows} if tracked else {"tmy_hourly": rows, "months_selected": []}
    return {"inputs": {"location": place}, "outputs": outputs, "meta": {"inputs": {}}}


def nsrdb() -> str:
    times = pd.date_range("2019-01-01T00:30", "2020-01-01", freq="h", inclusive="left")
    head = "Source,Location ID,Latitude,Longitude,Time Zone,Elevation,Local Time Zone\nNSRDB,1,36.1,-79.9,-5,270,-5\n"
    rows = (f"{t.year},{t.month},{t.day},{t.hour},30,{d},{b},{g},{w}"
            for t, (g, b, d, w) in zip(times, DAY * 365, strict=True))  # fmt: skip
    return head + "Year,Month,Day,Hour,Minute,DHI,DNI,GHI,Wind Speed\n" + "\n".join(rows) + "\n"


class Answer(BaseHTTPRequestHandler):
    queries: ClassVar[list[tuple[str, dict[str, list[str]]]]] = []

    def do_GET(self) -> None:
        url = urlsplit(self.path)
        query = parse_qs(url.query)
        self.queries.append((url.path, query))
        code, text = 200, nsrdb()
        if query.get("lat") == ["0.0"]:
            code, text = 400, json.dumps({"message": "Location over the sea. Please, select another location"})
        elif query.get("api_key") == ["wrong"]:
            code, text = 403, "API_KEY_INVALID: wrong"
        elif "lat" in query:
            text = json.dumps(pvgis(url.path.endswith("seriescalc")))
        self.send_response(code)
        self.end_headers()
        self.wfile.write(text.encode())

    def log_message(self, *_: Any) -> None:
        """Print nothing."""


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    server = HTTPServer(("127.0.0.1", 0), Answer)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    thread.join()
    server.server_close()


def test_a_typical_year_of_pvgis_becomes_a_file_for_studies(url, tmp_path, capsys):
    file = tmp_path / "site.csv"
    place = ["--latitude", "45", "--longitude", "8"]
    assert cli.main(["weather", "pvgis", *place, "-o", str(file), "--url", url]) == 0
    assert capsys.readouterr().out.split() == [str(file)]
    header = [line for line in file.read_text().splitlines() if line.startswith("#")]
    for words in ("source: PVGIS", "licence: CC BY 4.0", "query: pvlib.iotools.get_pvgis_tmy(45, 8)", "latitude: 45"):
        assert any(words in line for line in header), words
    read = read_weather(file)
    assert (len(read), read.latitude, read.longitude, read.shift) == (8760, 45.0, 8.0, 0.1761)
    np.testing.assert_array_equal(read.dni, [row[1] for row in DAY] * 365)
    np.testing.assert_array_equal(read.wind, [row[3] for row in DAY] * 365)
    study = heliosweep.load({
        "family": "field_efficiency", "tracking": "azimuth_elevation", "site": {"file": str(file)},
        "weather": {"file": str(file)}, "time": {"clock": "weather", "months": [3]}, "receiver": {"height": 50},
        "layout": {"x": [0.0], "y": [60.0]}, "heliostat": {"width": 6, "height": 5, "pivot_height": 4},
    })  # fmt: skip
    assert float(heliosweep.build(study)["field_receiver_energy"]) > 1.0
    assert cli.main(["weather", "pvgis", *place, "-o", str(file), "--url", url]) == 2  # exists
    capsys.readouterr()


def test_a_year_of_pvgis_has_the_beam_of_two_axes(url, tmp_path):
    file = heliosweep.download_weather("pvgis", 45.0, 8.0, tmp_path / "y.csv", year=2019, url=url)
    path, query = Answer.queries[-1]
    assert path == "/seriescalc"
    assert (query["trackingtype"], query["startyear"], query["components"]) == (["2"], ["2019"], ["1"])
    read = read_weather(file)
    np.testing.assert_array_equal(read.dni, [row[1] for row in DAY] * 365)
    assert read.utc[0] == np.datetime64("2019-01-01T00:10")


def test_the_nsrdb_needs_a_key_that_is_not_written(url, tmp_path, monkeypatch):
    monkeypatch.delenv("NSRDB_API_KEY", raising=False)
    with pytest.raises(StudyError, match=r"nsrdb: needs a key: register at .* set NSRDB_API_KEY and NSRDB_EMAIL"):
        heliosweep.download_weather("nsrdb", 36.1, -79.9, tmp_path / "n.csv", url=url)
    monkeypatch.setenv("NSRDB_API_KEY", "hidden")
    monkeypatch.setenv("NSRDB_EMAIL", "someone@example.org")
    for year, names in ((None, "tmy"), (2019, "2019")):
        file = heliosweep.download_weather("nsrdb", 36.1, -79.9, tmp_path / "n.csv", year=year, url=url, force=True)
        assert Answer.queries[-1][1]["names"] == [names]
        assert not {"hidden", "someone"} & set(file.read_text().replace("@", " ").split())
        read = read_weather(file)
        assert (read.latitude, read.longitude, read.shift, read.hours) == (36.1, -79.9, 0.0, 1.0)
        assert read.utc[0] == np.datetime64("2019-01-01T05:30")
        np.testing.assert_array_equal(read.dni, [row[1] for row in DAY] * 365)
    monkeypatch.setenv("NSRDB_API_KEY", "wrong")
    with pytest.raises(HeliosweepError, match=r"nsrdb: no weather data for 36.1, -79.9 deg: API_KEY_INVALID: \.\.\."):
        heliosweep.download_weather("nsrdb", 36.1, -79.9, tmp_path / "other.csv", url=url)


@pytest.mark.parametrize(
    ("place", "message"),
    [((95.0, 8.0), "--latitude: must be between -90 and 90 deg"), ((45.0, 200.0), "--longitude: must be between"),
     ((0.0, 0.0), "pvgis: no weather data for 0, 0 deg: Location over the sea")],
)  # fmt: skip
def test_wrong_places_are_refused(url, tmp_path, place, message):
    with pytest.raises(HeliosweepError, match=message):
        heliosweep.download_weather("pvgis", place[0], place[1], tmp_path / "x.csv", url=url)
    assert not (tmp_path / "x.csv").exists()
