"""What the figures of the family share: which points of a result they show, and how they call them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
import xarray as xr

from heliosweep.report.colours import COLOURS, DASHES, MARKERS
from heliosweep.report.selection import Point, Shown, evenly

if TYPE_CHECKING:
    from heliosweep.report.pictures import Raster

METHOD, REFERENTIAL, MODULE, PROFILE, HOUR = "slope_method", "referential", "module", "sun_profile", "hour"
HELIOSTAT, CAMERA = "heliostat", "camera"
#: Directions, as the ends of variables and as words.
DIRECTIONS = {"x": "horizontal", "y": "vertical"}
#: Dimensions that are drawn from, not swept.
SEEDS = ("profile_seed", "camera_seed", "defect_seed")
#: Methods from the best to the first; those that need no referential; and referentials in the order of the paper.
BEST = ("LM", "O2", "O1", "A")
DIRECT = ("O2", "LM")
EXACT = ("exact", "roll", "none")
#: Profiles of one figure, modules of one figure.
MOST_SORTS, MOST_MODULES = 2, 4

METHOD_COLOURS = {"A": COLOURS[0], "O1": COLOURS[1], "O2": COLOURS[2], "LM": COLOURS[3]}
_MARKS = dict(zip(METHOD_COLOURS, MARKERS, strict=False))
_DASHES = {"none": DASHES[0], "roll": DASHES[1], "exact": DASHES[2], "": DASHES[0]}


class Way(NamedTuple):
    """A method with a referential, which only A and O1 need, and where it stands in the result."""

    method: str
    referential: str
    """Empty where none is needed."""
    point: Point

    @property
    def name(self) -> str:
        """Both in words."""
        return f"{self.method}, {self.referential}" if self.referential else self.method

    @property
    def look(self) -> dict[str, Any]:
        """Colour and marker of the method, dashes of the referential."""
        return {
            "color": METHOD_COLOURS.get(self.method, "#000000"),
            "marker": _MARKS.get(self.method, "X"),
            "linestyle": _DASHES.get(self.referential, "-"),
        }


class Gazing(Shown):
    """A result of the family, of which figures show methods, profiles of the sun and modules."""

    titles: ClassVar = {
        PROFILE: "profile",
        METHOD: "method",
        REFERENTIAL: "referential",
        MODULE: "module",
        HOUR: "solar time",
        "sun_azimuth": "azimuth of the sun",
        "sun_elevation": "elevation of the sun",
        "camera_radius": "radius of the cameras",
        "camera_noise": "noise of the cameras",
        "camera_seed": "seed of the cameras",
        "profile_noise": "noise of the profile",
        "profile_seed": "seed of the profile",
        "profile_error": "error of the profile",
        "defect_seed": "seed of the waviness",
        "canting_scale": "factor on the canting",
        "waviness": "waviness",
        "gain_error": "error of gain",
        "image_level": "images",
    }
    labels: ClassVar = {HOUR: "solar time (h)"}
    typical: ClassVar = {
        METHOD: BEST,
        REFERENTIAL: EXACT,
        **dict.fromkeys(SEEDS, ()),
        "sun_azimuth": 30.0,
        "sun_elevation": 60.0,
        "camera_radius": 0.24,
        "canting_scale": 1.0,
        "profile_error": 0.0,
        "gain_error": 0.0,
        HOUR: 12.0,
    }
    not_swept = frozenset({METHOD, REFERENTIAL, MODULE, HELIOSTAT, HOUR, CAMERA, "y", "z", *SEEDS})
    told: ClassVar = {
        **dict.fromkeys(("sun_azimuth", "sun_elevation", "camera_radius", "latitude", "day")),
        PROFILE: "",
        **dict.fromkeys(("camera_noise", "gain_error", "profile_error", "waviness"), 0.0),
        "canting_scale": 1.0,
    }
    longest = 30

    def note(self, stands: Point, *shown: Iterable[Point], unsaid: str = "") -> str:
        """Sentences for a caption; of methods that need no referential, none is told."""
        direct = METHOD in stands and self.value(METHOD, stands[METHOD]) in DIRECT
        kept = {dim: index for dim, index in stands.items() if not (direct and dim == REFERENTIAL)}
        return super().note(kept, *shown, unsaid=unsaid)

    def ways(self, quantity: str, every: bool = True) -> list[Way]:
        """Methods with each of their referentials, or with the first alone."""
        dims, found = self.result[quantity].dims, []
        for i in range(self.result.sizes[METHOD]) if METHOD in dims else [-1]:
            method = self._word(METHOD, i)
            for j in range(self.result.sizes[REFERENTIAL]) if REFERENTIAL in dims else [-1]:
                if j > 0 and (method in DIRECT or not every):
                    break
                point = {dim: index for dim, index in ((METHOD, i), (REFERENTIAL, j)) if index >= 0}
                found.append(Way(method, "" if method in DIRECT or j < 0 else self._word(REFERENTIAL, j), point))
        return found

    def best_ways(self, quantity: str) -> list[Way]:
        """Each method once, with the best referential there is."""
        rank = {name: place for place, name in enumerate(EXACT)}
        found: dict[str, Way] = {}
        for way in sorted(self.ways(quantity), key=lambda way: rank.get(way.referential, len(rank))):
            found.setdefault(way.method, way)
        return sorted(found.values(), key=lambda way: way.point.get(METHOD, 0))

    def _word(self, dim: str, index: int) -> str:
        """Name along a dimension, also where it has but one that is a coordinate without it."""
        if index >= 0:
            return self.value(dim, index)
        single = dim in self.result.coords and self.result[dim].size == 1
        return str(self.result[dim].item()) if single else ""

    def sort_dim(self, quantity: str) -> str:
        """Dimension of words that figures compare: the sun's profile, else another swept one, such as arrangement."""
        dims = [str(dim) for dim in self.result[quantity].dims]
        words = [dim for dim in dims if dim not in self.not_swept and self.coordinate(dim).dtype.kind in "OU"]
        return PROFILE if PROFILE in dims or not words else words[0]

    def sorts(self, quantity: str) -> list[dict[str, int]]:
        """Points along `sort_dim`; an empty one where there is none."""
        dim = self.sort_dim(quantity)
        return self.chosen(dim if dim in self.result[quantity].dims else None, MOST_SORTS)

    def modules(self, quantity: str, most: int = MOST_MODULES) -> list[dict[str, int]]:
        """Modules that are shown: those with entered canting, else some of those that there are."""
        if MODULE not in self.result[quantity].dims:
            return [{}]
        numbers = self.coordinate(MODULE).to_numpy()
        entered = canting(self.result)
        canted = [i for i, number in enumerate(numbers) if any(entered.get(int(number), ()))]
        order = canted or list(range(numbers.size))
        return [{MODULE: order[i]} for i in evenly(len(order), most)]

    def raster(self, array: xr.DataArray, title: str = "") -> Raster:
        """Picture of the mirror with its modules."""
        from heliosweep.report.pictures import Raster

        sides = [f"module_{name}" for name in ("y", "z", "width", "height")]
        outlines: list[tuple[str, float, float, float, float]] = []
        if set(sides) <= set(self.result.coords) and all(self.result[side].dims == (MODULE,) for side in sides):
            rows = np.stack([self.result[side].to_numpy() for side in sides], axis=-1)
            numbers = self.coordinate(MODULE).to_numpy()
            outlines = [
                (f"{number:g}", float(y), float(z), float(wide), float(high))
                for number, (y, z, wide, high) in zip(numbers, rows, strict=True)
            ]
        return Raster(array.transpose("z", "y").astype(float), title, outlines)

    def has_plane(self, quantity: str) -> bool:
        """Whether pictures of a variable can be drawn."""
        return {"y", "z"} <= set(self.result[quantity].dims) and {"y", "z"} <= set(self.result.coords)


def study(result: xr.Dataset) -> dict[str, Any]:
    """Study file of a result, where it is told."""
    found = json.loads(result.attrs.get("study", "{}"))
    return found if isinstance(found, dict) else {}


def canting(result: xr.Dataset) -> dict[int, tuple[float, float]]:
    """Canting that was entered, horizontal and vertical by the module's number, without its factor. [mrad]"""
    given = study(result).get("defects", {}).get("canting", {})
    return {int(key): (float(pair[0]), float(pair[1])) for key, pair in given.items()}
