"""What is computed in one block: NumPy arrays over (swept dimensions, dates) in the units of the study file.

Every array of a block has all swept dimensions, of length 1 where it does not vary. The sun of a site is computed once
and shared by all mounts of the block.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from heliosweep.families.dish_tracking import statistics, variables
from heliosweep.families.dish_tracking.config import DishTime, Ephemeris
from heliosweep.families.dish_tracking.windows import Place, windows_of
from heliosweep.kernels import tracking

MODEL_CODES = {"rigid": tracking.RIGID, "untilted_home_axes": tracking.UNTILTED_HOME_AXES}

#: Tilts that are tried before the interval is halved, so many times: to 1e-13 of it. [deg]
SCAN, BISECTIONS = (0.0, *np.geomspace(1e-3, 45.0, 48).tolist()), 43
EVALUATIONS = len(SCAN) + BISECTIONS

#: A block's arrays begin with those of the place (latitude, longitude [deg], altitude [m], time zone) and the model.
PLACE = 4


def daily(*arrays: np.ndarray, time: DishTime, ephemeris: Ephemeris, clip: bool) -> np.ndarray:
    """Tracking factor and mean and largest error of every date.

    Parameters
    ----------
    *arrays : ndarray
        Latitude, longitude [deg], altitude [m], time zone, model; tilt, its direction, home azimuth and elevation
        offset [deg]; tolerance [mrad].
    time : DishTime
        Dates and window.
    ephemeris : Ephemeris
        Settings of the sun.
    clip : bool
        Whether each error counts at most the tolerance.

    Returns
    -------
    ndarray, shape (3, *swept dimensions, dates)
        In the order of `variables.DAILY`; NaN where no instant of a date counts.
    """
    shape = np.broadcast_shapes(*(array.shape for array in arrays))
    result = np.empty((len(variables.DAILY), *shape, len(time.date_list())))
    for (*place, model), (tilt, *angles, tolerance), region in _each_place(arrays[: PLACE + 1], arrays[PLACE + 1 :]):
        windows = windows_of(time, _place(place), ephemeris)
        factor, errors = _factors(model, windows, tilt, angles, tolerance, clip)
        for row, values in zip(result, (factor, errors.mean * 1e3, errors.largest * 1e3), strict=True):
            row[region] = values
    return result


def empty_windows(*place: np.ndarray, time: DishTime, ephemeris: Ephemeris) -> np.ndarray:
    """1 where no instant of a date counts, shape (1, *swept dimensions of the site, dates)."""
    days = len(time.date_list())
    result = np.empty((1, *np.broadcast_shapes(*(array.shape for array in place)), days), np.int8)
    for values, _, region in _each_place(place, ()):
        result[0][region] = np.isnan(windows_of(time, _place(values), ephemeris).total.ravel()[:days])
    return result


def tolerable(*arrays: np.ndarray, time: DishTime, ephemeris: Ephemeris, clip: bool) -> np.ndarray:
    """Largest tilt whose least daily factor is the required one.

    Parameters
    ----------
    *arrays : ndarray
        As for `daily` but the tilt, then the required factors, which come last and alone. [1]
    time, ephemeris, clip
        As for `daily`.

    Returns
    -------
    ndarray, shape (1, *swept dimensions, required factors)
        Degrees.
    """
    required = arrays[-1].reshape(-1)
    shape = np.broadcast_shapes(*(array.shape for array in arrays[:-1]))
    result = np.empty((1, *shape, required.size))
    for (*place, model), (*angles, tolerance), region in _each_place(arrays[: PLACE + 1], arrays[PLACE + 1 : -1]):
        windows = windows_of(time, _place(place), ephemeris)
        wide = [angle[..., np.newaxis] for angle in angles]

        def least(
            tilt: np.ndarray,
            model: str = model,
            windows: tracking.Windows = windows,
            wide: Sequence[np.ndarray] = wide,
            tolerance: np.ndarray = tolerance,
        ) -> np.ndarray:
            factor, _ = _factors(model, windows, tilt, wide, tolerance[..., np.newaxis], clip)
            return statistics.over_dates(factor)[2]

        result[0][region] = largest_tilt(least, required)
    return result


def largest_tilt(least: Callable[[np.ndarray], np.ndarray], required: np.ndarray) -> np.ndarray:
    """Largest tilt whose least daily factor is at least the required one.

    With home offsets a tilt can make up for an offset, so that the factor rises before it falls: the tilts of `SCAN`
    are tried first, and the interval after the last that suffices is halved. A range of good tilts narrower than a step
    of the scan, beyond all others, is not seen.

    Parameters
    ----------
    least : callable
        Tilts of shape (..., R) [deg] -> least daily factors of all dates, of the same shape after broadcasting.
    required : ndarray, shape (R,)
        Required factors. [1]

    Returns
    -------
    ndarray, shape (..., R)
        0 where no tilt suffices; NaN where the largest of the scan still does, or where no date has a factor. [deg]
    """
    tried = [least(np.full(required.size, tilt)) for tilt in SCAN]
    low = np.zeros(tried[0].shape)
    high = np.zeros(tried[0].shape)
    for tilt, beyond, factor in zip(SCAN, [*SCAN[1:], np.nan], tried, strict=True):
        enough = factor >= required
        low, high = np.where(enough, tilt, low), np.where(enough, beyond, high)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        enough = least(middle) >= required
        low, high = np.where(enough, middle, low), np.where(enough, high, middle)
    return np.where(np.isnan(tried[0]) | np.isnan(high), np.nan, low)


def _factors(
    model: str,
    windows: tracking.Windows,
    tilt: np.ndarray,
    angles: Sequence[np.ndarray],
    tolerance: np.ndarray,
    clip: bool,
) -> tuple[np.ndarray, tracking.WindowErrors]:
    """Daily factors [1] and errors [rad] for angles in degrees and a tolerance in mrad."""
    limit = tolerance * 1e-3
    direction, azimuth, elevation = (np.radians(angle) for angle in angles)
    errors = tracking.window_errors(
        MODEL_CODES[model],
        windows,
        np.radians(tilt),
        direction,
        azimuth,
        elevation,
        tolerance=limit if clip else None,
    )
    counted = errors.clipped if clip else errors.mean
    return tracking.effective_tracking_factor(counted, limit[..., np.newaxis]), errors


def _place(values: Sequence[Any]) -> Place:
    latitude, longitude, altitude, timezone = values
    return Place(float(latitude), float(longitude), float(altitude), str(timezone))


def _each_place(
    place: Sequence[np.ndarray], others: Sequence[np.ndarray]
) -> Iterator[tuple[tuple[Any, ...], list[np.ndarray], tuple[slice, ...]]]:
    """Walk over the sites of a block: values of the site, what belongs to it of the others, region of the block."""
    shape = np.broadcast_shapes(*(array.shape for array in place))
    for index in np.ndindex(shape):
        region = tuple(slice(i, i + 1) if size > 1 else slice(None) for i, size in zip(index, shape, strict=True))
        values = tuple(array[tuple(np.minimum(index, np.array(array.shape) - 1))] for array in place)
        yield values, [array[_varying(region, array)] for array in others], region


def _varying(region: tuple[slice, ...], array: np.ndarray) -> tuple[slice, ...]:
    """The region, but whole where the array does not vary."""
    return tuple(span if size > 1 else slice(None) for span, size in zip(region, array.shape, strict=True))
