"""Blocks of a study for its direct normal irradiance (DNI) and for the limits of operation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import ConfigDict, Field

from heliosweep.config.block import Block
from heliosweep.config.faults import Fault
from heliosweep.config.sweep import Sweep, ends
from heliosweep.config.times import TimeZone
from heliosweep.config.values import Choice, FileName, Quantity

MODELS = {
    "ineichen": "Ineichen and Perez (2002), by Linke turbidity",
    "simplified_solis": "Ineichen (2008), by aerosol optical depth and precipitable water",
    "meinel": "Meinel and Meinel (1976): 1367 * 0.7^(AM^0.678) W/m2, AM the air mass",
    "ashrae": "ASHRAE (1972): A exp(-B / sin(elevation)), A and B by month",
}

LABELS = {
    "start": "the start of the interval",
    "middle": "its middle",
    "end": "its end",
}


def _of(model: str, title: str, default: str, unit: str, low: float, high: float) -> Quantity:
    description = f"{title[0].upper()}{title[1:]}, for {model}; by default {default}"
    return Quantity(description, unit, ge=low, le=high, title=title)


class ClearSky(Block):
    """Irradiance of a sky without clouds."""

    model: Annotated[
        str | Sweep,
        Choice("Clear-sky model", MODELS, dimension="clear_sky_model", title="clear-sky model"),
    ]
    linke_turbidity: Annotated[
        float | Sweep | None,
        _of("ineichen", "Linke turbidity", "the value for the place and date in pvlib's table", "1", 1, 20),
    ] = None
    aerosol_optical_depth: Annotated[
        float | Sweep | None,
        _of("simplified_solis", "aerosol optical depth at 700 nm", "0.1", "1", 0, 0.45),
    ] = None
    precipitable_water: Annotated[
        float | Sweep | None,
        _of("simplified_solis", "precipitable water", "1 cm", "cm", 0.2, 10),
    ] = None

    def rules(self) -> Iterator[Fault]:
        """Check that keys of the air belong to the model."""
        for key, model in KEYS_OF.items():
            if getattr(self, key) is not None and model not in ends(self.model):
                yield Fault(f"is only for the model {model}; remove it", (key,))


#: Keys of the air, and their models.
KEYS_OF = {
    "linke_turbidity": "ineichen",
    "aerosol_optical_depth": "simplified_solis",
    "precipitable_water": "simplified_solis",
}
#: Names of the dimensions of swept weather and limits.
DIMENSIONS = ("weather", "clear_sky_model", *KEYS_OF, "dni_limit", "sun_elevation_limit", "wind_speed_limit")


class Weather(Block):
    """Direct normal irradiance: a weather file, or a clear sky."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["file"]}, {"required": ["clear_sky"]}]})

    file: Annotated[
        str | Sweep | None,
        FileName(
            "Weather file: EPW, TMY3, SAM CSV (PSM of the NSRDB), PVGIS, CAMS, NASA POWER, Solargis, SolarAnywhere, or "
            "CSV with columns of time and dni [W/m2] and optional wind_speed [m/s]; with several 'sites' one file for "
            "each, in their order, or one for all",
            sweep=True, dimension="weather", title="weather file",
        ),
    ] = None  # fmt: skip
    label: Annotated[
        str | None,
        Choice(
            "Part of its interval that the time of a row marks; default: the convention of the format",
            LABELS,
            sweep=False,
        ),
    ] = None
    offset: Annotated[
        float | None,
        Quantity(
            "Time from the time of a row to the instant of its sun, instead of label", "h", ge=-2, le=2, sweep=False
        ),
    ] = None  # fmt: skip
    timezone: Annotated[
        str | None,
        TimeZone(
            "Time zone of times without an offset: an offset (+08:00) or an IANA name; default: the zone in the file"
        ),
    ] = None  # fmt: skip
    dni_factor: Annotated[
        float | Sweep | None,
        Quantity("Factor on the direct normal irradiance, for the spread between years or of the sensor; 1 where left "
                 "out", "1", gt=0, le=2, title="factor on the direct normal irradiance"),
    ] = None  # fmt: skip
    clear_sky: Annotated[ClearSky | None, Field(description="A sky without clouds, on the civil clock")] = None

    def rules(self) -> Iterator[Fault]:
        """Check that there is a file or a clear sky, not both."""
        if (self.file is None) == (self.clear_sky is None):
            yield Fault("give exactly one of 'file' and 'clear_sky'", show_value=False)
        for key in ("label", "offset", "timezone"):
            if self.file is None and getattr(self, key) is not None:
                yield Fault("is for a weather file; remove it", (key,))
        if self.label is not None and self.offset is not None:
            yield Fault("give 'label' or 'offset', one of them", ("offset",))


class Limits(Block):
    """Conditions under which the field works."""

    dni: Annotated[
        float | Sweep | None,
        Quantity("Least direct normal irradiance", "W/m2", ge=0, le=1412, dimension="dni_limit",
                 title="least direct normal irradiance"),
    ] = None  # fmt: skip
    sun_elevation: Annotated[
        float | Sweep | None,
        Quantity("Least elevation of the sun", "deg", ge=0, le=90, dimension="sun_elevation_limit",
                 title="least elevation of the sun"),
    ] = None  # fmt: skip
    wind_speed: Annotated[
        float | Sweep | None,
        Quantity("Largest wind speed; the field works if it is unknown", "m/s", gt=0, le=100,
                 dimension="wind_speed_limit", title="largest wind speed"),
    ] = None  # fmt: skip
