"""Spots of mounts with errors: mounts aim with the errors that are known, and stand as the actual ones make them.

Work goes in packets of lanes: aiming over instants (of several heliostats where one has few), spots over the same lanes
where there are few samples of the errors, over the samples where there are many. No bit of a spot depends on how spots
are packed.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.aiming import AIM_ROWS, KNOWN, STATE_ROWS, WORK_ROWS, aim_each, aim_lanes, aim_rows
from heliosweep.kernels.mounts.kinematics import TERMS, stand_terms
from heliosweep.kernels.spots.receiver import Setting, face_axes
from heliosweep.kernels.spots.records import (
    HELIOSTAT_ROWS,
    SAMPLE,
    SPOT_ROWS,
    VECTOR,
    base_of,
    heliostat_lanes,
    mount_records,
    sample_terms,
    spot_lanes,
    spread,
    sun_rows,
    transposed,
    whole,
)
from heliosweep.kernels.vectors import PACKET

Floats = NDArray[np.float64]

_MANY = 12
"""Samples from which on lanes are samples."""


def mount_spots(setting: Setting, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike) -> Floats:
    """Spots of heliostats whose mounts have errors, aimed exactly by what is known of the errors.

    Parameters
    ----------
    setting : Setting
        Receiver and mount of P parameter combinations.
    actual : array_like, shape (P or 1, H or 1, K, 6)
        K samples of the errors, in the order of `kinematics.ERRORS`. [rad]
    known : array_like, shape (P or 1, H or 1, 6)
        Errors that the tracking corrects. [rad]
    sun : array_like, shape (P or 1, T, 3)
        Unit vectors to the sun: east, north, up. [1]
    pivots : array_like, shape (P or 1, H, 3)
        Pivots relative to the base of the tower: east, north, up. [m]

    Returns
    -------
    ndarray, shape (3, P, H, T, K)
        Spots y and z on the plane of the receiver, NaN where there is none [m], and the status of each, a code of
        `receiver`.

    Raises
    ------
    ValueError
        If shapes do not agree.
    """
    faces, samples, corrected, suns, places = checked(setting, actual, known, sun, pivots)
    shape = (len(faces), places.shape[1], suns.shape[2], samples.shape[2])
    spots = np.empty((3, *shape))
    if spots.size:
        fill_spots(vectors(setting), faces, samples, corrected, suns, places, spots)
    return spots


def checked(
    setting: Setting, actual: ArrayLike, known: ArrayLike, sun: ArrayLike, pivots: ArrayLike
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Arguments of `mount_spots` as kernels take them: faces (P, 9), errors, sun (P or 1, 3, T), pivots.

    Raises
    ------
    ValueError
        If shapes do not agree.
    """
    count = len(setting.kind)
    samples, corrected, suns, places = (
        np.require(value, np.float64, ["C", "W"]) for value in (actual, known, sun, pivots)
    )
    heliostats = places.shape[1] if places.ndim == 3 else -1
    wanted = (
        (samples, (count, heliostats, None, 6)),
        (corrected, (count, heliostats, 6)),
        (suns, (count, None, 3)),
        (places, (count, heliostats, 3)),
    )
    for array, shape in wanted:
        fits = array.ndim == len(shape) and all(
            size is None or length in ((size, 1) if axis < len(shape) - 1 else (size,))
            for axis, (length, size) in enumerate(zip(array.shape, shape, strict=True))
        )
        if not fits:
            raise ValueError(f"an array of shape {array.shape} where {shape} is wanted")
    faces = np.empty((count, 9))
    for face, azimuth, tilt in zip(faces, setting.face_azimuth, setting.face_tilt, strict=True):
        face[:] = face_axes(float(azimuth), float(tilt)).ravel()
    return faces, samples, corrected, np.ascontiguousarray(np.swapaxes(suns, 1, 2)), places


def vectors(setting: Setting) -> Setting:
    """Setting whose arrays kernels need not compile for anew: writable, contiguous."""
    kind = np.array(setting.kind, np.int64, order="C")
    return Setting(*(np.array(value, np.float64, order="C") for value in setting))._replace(kind=kind)  # type: ignore[arg-type]


@kernel
def fill_spots(
    setting: Setting, faces: Floats, actual: Floats, known: Floats, sun: Floats, pivots: Floats, spots: Floats
) -> None:
    """Spots of all parameter combinations, see `mount_spots`."""
    heliostats, instants, samples = spots.shape[2], spots.shape[3], spots.shape[4]
    many = samples >= _MANY
    group = 1 if many else max(1, PACKET // instants)
    # Set up as many heliostats at once as there are lanes.
    block, apart = PACKET // group * group, 1 if many else PACKET
    frame, mounts, record = np.empty(9), np.empty(KNOWN * apart), np.empty(samples * SAMPLE * apart)
    room = np.empty(HELIOSTAT_ROWS * PACKET)
    terms, corrected = np.empty(samples * TERMS), np.empty(TERMS)
    rows, state, work = np.empty(AIM_ROWS * PACKET), np.empty(STATE_ROWS * PACKET), np.empty(WORK_ROWS * PACKET)
    suns, one_sun, one_state = np.empty(3 * PACKET), np.empty(3 * PACKET), np.empty(STATE_ROWS * PACKET)
    sample, out = np.empty(SAMPLE * PACKET), np.empty(SPOT_ROWS * PACKET)
    table = np.empty((whole(samples, PACKET) // PACKET if many else 0, SAMPLE * PACKET))
    for p in range(len(faces)):
        a, n = min(p, len(actual) - 1), min(p, len(known) - 1)
        errors, corrections = actual[a].reshape(-1), known[n].reshape(-1)
        base = base_of(setting, p)
        light, places = sun[min(p, len(sun) - 1)], pivots[min(p, len(pivots) - 1)]
        face, offset, axis_offset = faces[p], setting.mirror_offset[p], setting.axis_offset[p]
        for first in range(0, heliostats, group):
            here = min(group, heliostats - first)
            own = 0 if many else first % block
            if many:
                if first == 0 or known.shape[1] > 1:
                    stand_terms(corrections, 6 * min(first, known.shape[1] - 1), corrected, 0)
                if first == 0 or actual.shape[1] > 1:
                    sample_terms(errors, min(first, actual.shape[1] - 1), samples, terms)
                mount_records(base, places, first, face, corrected, terms, samples, frame, mounts, record, 0)
                transposed(record, samples, table)
            elif first % block == 0:
                known_apart = 6 if known.shape[1] > 1 else 0
                actual_apart = 6 * samples if actual.shape[1] > 1 else 0
                heliostat_lanes(
                    base, places, first, min(block, heliostats - first), face, corrections, known_apart,
                    errors, actual_apart, samples, room, mounts, record,
                )  # fmt: skip
            for start in range(0, instants, PACKET):
                count = min(PACKET, instants - start)
                if first == 0 or instants > PACKET:
                    sun_rows(light, start, count, suns)
                full = whole(here * count, VECTOR)
                if instants == 1 and not many:
                    aim_each(mounts, suns, full, rows)
                else:
                    for i in range(here):
                        end = full if i == here - 1 else (i + 1) * count
                        aim_rows(mounts, suns, i * count, end, rows, own + i, apart)
                aim_lanes(rows, state, work, offset, axis_offset, full)
                if many:
                    for t in range(count):
                        spread(state, suns, t, one_state, one_sun)
                        for b in range(len(table)):
                            lanes = min(PACKET, samples - b * PACKET)
                            spot_lanes(
                                table[b], one_state, one_sun, face, offset, axis_offset, out, whole(lanes, VECTOR)
                            )
                            for m in range(3):
                                for k in range(lanes):
                                    spots[m, p, first, start + t, b * PACKET + k] = out[m * PACKET + k]
                    continue
                for k in range(samples):
                    _spread_samples(record, k, own, here, count, full, instants == 1, sample)
                    spot_lanes(sample, state, suns, face, offset, axis_offset, out, full)
                    for m in range(3):
                        for i in range(here):
                            for t in range(count):
                                spots[m, p, first + i, start + t, k] = out[m * PACKET + i * count + t]


@inline
def _spread_samples(record, k, own, here, count, full, each, sample):
    """Copy what `sample_record` made of sample k to the lanes of each heliostat; the last one has those left over.

    Heliostats from lane `own` of the record on; where `each` lane is another heliostat, copies are all there is to do.
    """
    first = max(k * SAMPLE * PACKET, 0)
    if each:
        for i in range(SAMPLE * PACKET):
            sample[i] = record[first + i]
        return
    for i in range(here):
        end = full if i == here - 1 else (i + 1) * count
        for m in range(SAMPLE):
            value = record[first + m * PACKET + own + i]
            for lane in range(m * PACKET + i * count, m * PACKET + end):
                sample[lane] = value
