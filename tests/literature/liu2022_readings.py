"""Readings of the model of Liu, Peng and Yan (2022), doi 10.3390/en15093261, and which claims each meets.

The text copy has lost signs, and leaves open what leans, what carries an offset of the home position, the hours and the
mean. Every combination of `CHOICES` is computed from vectors, independently of the package but for the sun, and judged
by what Table 2 and the text on Figures 5 and 7 to 10 say of 21 June. ``python -m tests.literature.liu2022_readings``
prints the result of all, as studies/README.md tells it.
"""

import itertools
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from heliosweep.sun import sun_vectors

#: Latitude and longitude [deg], and mean and standard deviation of Table 2.
TABLE = {
    "Dunhuang": (40.13, 94.67, 0.57234, 0.04874), "Naqu": (31.29, 92.04, 0.5868, 0.04935),
    "Delingha": (37.22, 97.23, 0.56715, 0.05539), "Kunming": (25.0, 102.39, 0.58612, 0.06537),
    "Baotou": (40.32, 109.53, 0.53792, 0.07072), "Haerbin": (45.42, 125.15, 0.49776, 0.08238),
}  # fmt: skip
PLACES = {place: row[:2] for place, row in TABLE.items()}
MEAN, STD = ({place: row[part] for place, row in TABLE.items()} for part in (2, 3))
EAST = ("Baotou", "Haerbin")
DIRECTIONS = np.arange(0.0, 360.0, 15.0)
OFFSETS = (0.2, -0.2, 0.4, -0.4)

#: What the mount does without an offset; the first of each is the model `untilted_home_axes`.
CHOICES = {
    "leans": ("azimuth axis", "azimuth and elevation axes", "azimuth and focal axes", "whole mount"),
    "towards": ("foot", "top"), "phi": ("to the west", "to the east"), "psi": ("from east", "from south"),
    "raised about": ("axis turned about the leaning axis", "axis turned about the vertical"),
    "axis": ("unit vector", "Eq. 4, arccos"), "error": ("angle", "sum of two components"),
    "hours": ("7 to 21", "sun up", "8 to 18"),
}  # fmt: skip
#: What an offset does, and what is taken of the directions.
OFFSET_CHOICES: dict[str, Any] = {
    "carried by": ("focal axis", "focal and elevation axis", "elevation axis"), "gamma1": (1.0, -1.0),
    "gamma2": (1.0, -1.0), "mean over": ("all directions", "0 to 165 deg"),
}  # fmt: skip


def turned(v, n, angle):
    """Rodrigues' formula as printed, also for an axis that is no unit vector (Eq. 7)."""
    c, s = np.cos(angle)[..., np.newaxis], np.sin(angle)[..., np.newaxis]
    return v * c + np.cross(n, v) * s + n * np.sum(n * v, axis=-1, keepdims=True) * (1.0 - c)


@cache
def sun(place: str, hours: str) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth from south, west positive, and elevation on 21 June 2021. [rad]"""
    times = np.arange(0.125, 24.0, 0.25) if hours == "sun up" else np.arange(7.0, 21.0, 0.5)
    times = np.arange(8.25, 18.0, 0.5) if hours == "8 to 18" else times
    if hours.startswith("from"):
        start, stop = map(float, hours.split()[1::2])
        times = np.arange(start, stop, 0.5)
    stamps = np.datetime64("2021-06-20T16:00", "ns") + (times * 3600e9).astype("timedelta64[ns]")
    east, north, up = sun_vectors(stamps, *PLACES[place], 0.0, 69.0).T
    kept = (up > 0.0) | (hours != "sun up")
    return np.arctan2(-east, -north)[kept], np.arcsin(up)[kept]


def factor(place, reading, gamma1=0.0, gamma2=0.0, carried="focal axis"):
    """Effective tracking factor in each of `DIRECTIONS`, tilt 0.1 deg, tolerance 4 mrad; offsets in degrees."""
    azimuth, elevation = (values[:, np.newaxis] for values in sun(place, reading["hours"]))
    psi = azimuth + (np.pi / 2 if reading["psi"] == "from east" else 0.0)
    phi = np.radians(DIRECTIONS) * (1.0 if reading["phi"] == "to the west" else -1.0)
    tilt = np.radians(0.1) * (1.0 if reading["towards"] == "foot" else -1.0)
    one = np.ones(np.broadcast(psi, phi).shape)

    def vector(*parts):
        return np.stack([one * part for part in parts], axis=-1)

    s = vector(-np.cos(psi) * np.cos(elevation), np.sin(psi) * np.cos(elevation), np.sin(elevation))
    linear = reading["axis"] != "unit vector"
    lean, height = (tilt, 1.0) if linear else (np.sin(tilt), np.cos(tilt))
    azimuth_axis, vertical = vector(lean * np.sin(phi), lean * np.cos(phi), -height), vector(0.0, 0.0, 1.0)
    elevation_axis, focal_axis = vector(0.0, 1.0, 0.0), vector(-1.0, 0.0, 0.0)
    g1, g2 = np.radians([gamma1, gamma2])
    if carried != "elevation axis":
        focal_axis = vector(-np.cos(g1) * np.cos(g2), -np.sin(g1), np.cos(g1) * np.sin(g2))
    if carried != "focal axis":
        elevation_axis = turned(elevation_axis, vertical, g1 * one)
    u = vector(np.cos(phi), -np.sin(phi), 0.0)
    if reading["leans"] in ("azimuth and elevation axes", "whole mount"):
        elevation_axis = turned(elevation_axis, u, tilt * one)
    if reading["leans"] in ("azimuth and focal axes", "whole mount"):
        focal_axis = turned(focal_axis, u, tilt * one)
    about = -vertical if reading["raised about"].endswith("vertical") else azimuth_axis
    focus = turned(focal_axis, azimuth_axis, psi * one)
    focus = turned(focus, turned(elevation_axis, about, psi * one), elevation * one)
    if reading["error"] == "angle" and linear:
        error = np.arccos(np.clip(np.sum(s * focus, axis=-1), -1.0, 1.0))
    elif reading["error"] == "angle":
        error = 2.0 * np.arcsin(np.linalg.norm(focus - s, axis=-1) / 2.0)
    else:
        across = vector(np.sin(psi), np.cos(psi), 0.0)
        error = sum(np.abs(np.sum(focus * along, axis=-1)) for along in (across, np.cross(s, across)))
    return 1.0 - np.mean(error, axis=0) / 4e-3


def window_fit(divisor: int) -> tuple[float, float, float, float]:
    """Return the best fit to the 12 numbers of Table 2 with deviations by 1/n (divisor 24) or 1/(n - 1) (divisor 23).

    Windows of whole and half hours, first from 6 to 9 h and last from 19 to 22 h, and tolerances from 3.5 to 4.5 mrad.
    Returns the root mean square of the 12 differences, the first and last hour, and the tolerance [mrad].
    """
    first, found = {key: words[0] for key, words in CHOICES.items()}, []
    for start, stop in itertools.product(np.arange(6.0, 9.5, 0.5), np.arange(19.0, 22.5, 0.5)):
        reading = first | {"hours": f"from {start} to {stop}"}
        error = np.array([4.0 * (1.0 - factor(place, reading)) for place in PLACES])
        spread = error.std(axis=1) * np.sqrt(len(DIRECTIONS) / divisor)
        for tolerance in np.arange(3.5, 4.55, 0.05):
            means = 1.0 - error.mean(axis=1) / tolerance - list(MEAN.values())
            deviations = spread / tolerance - list(STD.values())
            distance = float(np.sqrt(np.mean(np.concatenate([means, deviations]) ** 2)))
            found.append((distance, float(start), float(stop), float(tolerance)))
    return min(found)


def among(values, *directions):
    """Whether a place among `DIRECTIONS` is one of some."""
    return bool(np.isin(DIRECTIONS[values], directions))


def judged(reading) -> Iterator[tuple[dict, dict[str, bool]]]:
    """Each choice of what an offset does, and which claims hold with it."""
    factors = {place: factor(place, reading) for place in PLACES}
    home = factors["Dunhuang"]
    mean = {place: one.mean() for place, one in factors.items()}
    std = {place: one.std(ddof=1) for place, one in factors.items()}
    west = [place for place in PLACES if place not in EAST]
    claims = {
        "Table 2: means": all(abs(mean[place] - MEAN[place]) <= 0.0065 for place in PLACES),
        "Table 2: deviations": all(abs(std[place] - STD[place]) <= 0.0035 for place in PLACES),
        "5: best at 0": among(home.argmax(), 0, 180),
        "5: worst at 90": among(home.argmin(), 90, 270),
        "9: worst at 90": all(among(one.argmin(), 90, 270) for one in factors.values()),
        "9: best at 15": all(among(one.argmax(), 15, 195) for one in factors.values()),
        "9: Baotou and Haerbin lowest": bool(
            np.all(np.max([factors[p] for p in EAST], axis=0) <= np.min([factors[p] for p in west], axis=0))
        ),
        "10: Baotou and Haerbin lowest": max(mean[p] for p in EAST) < min(mean[p] for p in west),
        "10: Baotou and Haerbin least steady": min(std[p] for p in EAST) > max(std[p] for p in west),
    }
    for carried in OFFSET_CHOICES["carried by"]:
        level = {g: factor("Dunhuang", reading, g, 0.0, carried) for g in OFFSETS}
        steep = {g: factor("Dunhuang", reading, 0.0, g, carried) for g in OFFSETS}
        for sign1, sign2, over in itertools.product(
            *(OFFSET_CHOICES[key] for key in ("gamma1", "gamma2", "mean over"))
        ):
            h, v = {g: level[sign1 * g] for g in OFFSETS}, {g: steep[sign2 * g] for g in OFFSETS}
            part = slice(None) if over == "all directions" else slice(12)
            hm, vm = ({g: one[part].mean() for g, one in both.items()} for both in (h, v))
            hs, vs = ({g: one[part].std(ddof=1) for g, one in both.items()} for both in (h, v))
            yield (
                {"carried by": carried, "gamma1": sign1, "gamma2": sign2, "mean over": over},
                claims
                | {
                    "7a: best at 345": among(h[0.2].argmax(), 345, 165),
                    "7a: worst at 0": among(h[0.2].argmin(), 0, 180),
                    "7b: best at 75": among(v[0.2].argmax(), 75, 255),
                    "7b: worst at 345": among(v[0.2].argmin(), 345, 165),
                    "8: horizontal better below 0": all(hm[g] > vm[g] for g in OFFSETS if g < 0),
                    "8: vertical better above 0": all(hm[g] < vm[g] for g in OFFSETS if g > 0),
                    "8: horizontal steadier": all(hs[g] < vs[g] for g in OFFSETS),
                    "8: offsets lower the mean": all(
                        home[part].mean() > m[g] > m[2 * g] for m in (hm, vm) for g in (0.2, -0.2)
                    ),
                    "8: offsets raise the deviation": all(
                        d[g] > home[part].std(ddof=1) for d in (hs, vs) for g in OFFSETS
                    ),
                },
            )


def main() -> None:
    """Print how many readings meet each claim, alone and with Table 2, and those that meet the most."""
    found = []
    for values in itertools.product(*CHOICES.values()):
        reading = dict(zip(CHOICES, values, strict=True))
        found += [(sum(claims.values()), reading | choice, claims) for choice, claims in judged(reading)]
    names = list(found[0][2])
    print(len(found), "readings,", len(names), "claims")
    print("Table 2 with 1/n:", window_fit(24), "with 1/(n - 1):", window_fit(23))
    for name in names:
        fitting = [claims for _, _, claims in found if claims["Table 2: means"]]
        print(f"{name:40} {sum(c[name] for *_, c in found):6} {sum(c[name] for c in fitting):4} of {len(fitting)}")
    both = ("7a: best at 345", "7a: worst at 0")
    print("best and worst of 7a:", sum(all(claims[name] for name in both) for *_, claims in found))
    most = max(count for count, *_ in found)
    for _, reading, claims in (one for one in found if one[0] == most):
        print(most, reading, "not:", [name for name, holds in claims.items() if not holds])


if __name__ == "__main__":
    main()
