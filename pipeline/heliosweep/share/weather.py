"""Weather files downloaded through pvlib, with source, licence and query in their headers."""

from __future__ import annotations

import datetime as dt
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.files import write_whole
from heliosweep.lazy import pvlib
from heliosweep.store.folder import target_file

#: Data source and licence of each weather service.
SERVICES = {
    "pvgis": {"source": "PVGIS, European Commission, Joint Research Centre, https://re.jrc.ec.europa.eu",
              "licence": "CC BY 4.0, European Union"},
    "nsrdb": {"source": "NSRDB PSM4, National Laboratory of the Rockies (NREL), https://nsrdb.nlr.gov",
              "licence": "CC BY 3.0 US, National Laboratory of the Rockies (NREL)"},
}  # fmt: skip
#: Environment variables with the NSRDB key and the email address of its owner.
KEY, EMAIL = "NSRDB_API_KEY", "NSRDB_EMAIL"


def download_weather(
    service: str, latitude: float, longitude: float, target: str | os.PathLike[str], *, year: int | None = None,
    url: str | None = None, force: bool = False,
) -> Path:  # fmt: skip
    """Download hourly weather for a location as a file for `weather.file` or `site.file`.

    Parameters
    ----------
    service : {'pvgis', 'nsrdb'}
        Weather service. For the NSRDB, set the environment variables ``NSRDB_API_KEY`` (key) and ``NSRDB_EMAIL`` (email
        address of its owner).
    latitude, longitude : float
        Coordinates of the location, positive north and east. [deg]
    target : path
        CSV file to write.
    year : int, optional
        Calendar year (default: a typical year).
    url : str, optional
        Address of the service (default: the address in pvlib).
    force : bool
        If True, replace an existing file.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StudyError
        If a value is out of range, if the key is missing, or if the file exists.
    HeliosweepError
        If the service cannot be reached, rejects the query, or returns no irradiance.
    """
    for key, value, most in (("--latitude", latitude, 90.0), ("--longitude", longitude, 180.0)):
        if not abs(value) <= most:
            raise StudyError(Problem(f"must be between {-most:g} and {most:g} deg (got {value:g})", key))
    if service not in SERVICES:
        raise StudyError(Problem(f"must be one of {', '.join(SERVICES)} (got {service})", "service"))
    path = target_file(target, force)
    personal = {"api_key": os.environ.get(KEY), "email": os.environ.get(EMAIL)} if service == "nsrdb" else {}
    if None in personal.values():
        message = f"needs a key: register at https://developer.nlr.gov and set {KEY} and {EMAIL}"
        raise StudyError(Problem(message, service))
    try:
        data, place, query = _downloaded(service, latitude, longitude, year, url, personal)
    except (OSError, ValueError, KeyError) as error:  # errors in the request, the JSON text or the data
        text = str(error)
        for secret in filter(None, personal.values()):
            text = text.replace(secret, "...")
        raise HeliosweepError(f"{service}: no weather data for {latitude:g}, {longitude:g} deg: {text}") from None
    data = data.rename(columns={"poa_direct": "dni"})  # PVGIS column for a tracked plane
    if "dni" not in data or data["dni"].isna().any():
        raise HeliosweepError(f"{service}: the response has no direct normal irradiance, or values are missing")
    header = {
        **SERVICES[service], "query": query, "downloaded": f"{dt.datetime.now(dt.UTC):%F}",
        "latitude": f"{latitude:g}", "longitude": f"{longitude:g}", **place,
    }  # fmt: skip
    data.index = data.index.map(lambda time: time.isoformat(timespec="minutes"))
    columns = [name for name in ("dni", "ghi", "dhi", "wind_speed", "temp_air") if name in data]
    table = data[columns].to_csv(index_label="time", lineterminator="\n")
    write_whole(path, "".join(f"# {key}: {value}\n" for key, value in header.items()) + table)
    return path


def _downloaded(
    service: str, latitude: float, longitude: float, year: int | None, url: str | None, personal: Mapping[str, Any]
) -> tuple[Any, ...]:
    given = {**personal, **({} if url is None else {"url": url})}
    if service == "nsrdb":
        name = "get_nsrdb_psm4_tmy" if year is None else "get_nsrdb_psm4_aggregated"
        given |= {} if year is None else {"year": year}
    elif year is None:
        name = "get_pvgis_tmy"
    else:  # beam irradiance on a plane tracked about two axes is direct normal
        name = "get_pvgis_hourly"
        given |= {"start": year, "end": year, "components": True, "trackingtype": 2}
    data, meta = getattr(pvlib.iotools, name)(latitude, longitude, **given)
    location = meta if service == "nsrdb" else meta["inputs"]["location"]
    found = {"altitude": f"{float(location['altitude' if service == 'nsrdb' else 'elevation']):g}"}
    if service == "nsrdb":
        found["rows"] = "middle of the interval"
    elif (offset := location.get("irradiance_time_offset")) is not None:
        found["Irradiance Time Offset (h)"] = f"{offset:g}"
    return data, found, f"pvlib.iotools.{name}({latitude:g}, {longitude:g}{'' if year is None else f', year {year}'})"
