"""What the kernels of each family compute, as digests of bits: run as a program, compiled for another processor.

`python -m tests.kernels.processors FAMILY ...` prints, as JSON, the digests of each result, and the widest registers
of the machine code: `xmm` (SSE2), `ymm` (AVX2) or `zmm` (AVX-512).
"""

import hashlib
import json
import re
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

Named = Iterator[tuple[str, Any]]


def field() -> Named:
    """Shading, blocking, unions of three and more, mirrors through one another's planes, a packet cut short."""
    from heliosweep.kernels.field.efficiency import field_series, field_sums, sorted_field
    from tests.kernels.field.fields import scattered, suns

    rng = np.random.default_rng(21)
    sun = np.concatenate((suns(rng, 90, 1.0, 20.0), suns(rng, 60, 0.2, 80.0)))
    for spacing in (6.0, 11.0):
        mirrors = sorted_field(*scattered(rng, 50, spacing))
        for tracking in (0, 1):
            yield f"sums {spacing:g} {tracking}", field_sums(mirrors, tracking, sun, 0, 50)[0]
            yield f"series {spacing:g} {tracking}", field_series(mirrors, tracking, sun, 0, 50)


def dish() -> Named:
    """Sun vectors, and errors of windows at small and at large tilts."""
    from heliosweep.grid.sun import sun_vectors
    from heliosweep.kernels.dish import RIGID, UNTILTED_HOME_AXES, pack_windows, window_errors

    utc = np.datetime64("2021-01-03T00:00", "ns") + np.arange(3000) * np.timedelta64(9973, "s")
    sun = sun_vectors(utc, 40.13, -3.7, 650.0)
    yield "sun", sun
    windows = pack_windows(sun[sun[:, 2] > 0.0], [0, 333, 700, 1101])
    tilt, direction = np.radians([[0.1], [2.0], [30.0]]), np.linspace(-3.0, 3.0, 7)
    for model in (RIGID, UNTILTED_HOME_AXES):
        for tolerance in (None, 1e-2):
            found = window_errors(model, windows, tilt, direction, 1e-3, -2e-3, tolerance)
            for name, values in found._asdict().items():
                if values is not None:
                    yield f"{name} {model} {tolerance}", values


def curves() -> Named:
    """Deviation curves of all mounts: spots, conics, tolerances, lines of detectors."""
    from heliosweep.kernels.spots.curves import deviation_curves
    from heliosweep.kernels.spots.deviation import (
        AZIMUTH,
        CANTING,
        ELEVATION,
        ENCODER,
        ENCODER_AZIMUTH,
        TILT,
        deviation_spots,
    )
    from tests.kernels.spots.test_mount_spots import KINDS, pivots, setting, suns

    errors = [(CANTING, ELEVATION), (CANTING, AZIMUTH), (ENCODER, ENCODER_AZIMUTH), (TILT, ELEVATION)]
    source, axis = np.repeat(errors, len(KINDS), axis=0).T
    curve = setting(KINDS * len(errors), axis_offset=0.0, pedestal=0.0), source, axis
    sky = suns(7), pivots(5)
    for size in (-4e-3, 0.0, 3e-3):
        yield f"spots {size:g}", deviation_spots(*curve, np.full(len(source), size), *sky)
    yield from _parts("curves", deviation_curves(*curve, *sky, [[1.0, 0.0, 1.0], [0.6, 0.8, -2.0]]))


def mounts() -> Named:
    """Spots of mounts with errors, and their statistics."""
    from heliosweep.kernels.spots.mount_spots import mount_spots
    from heliosweep.kernels.spots.statistics import spot_statistics
    from tests.kernels.spots.test_mount_spots import KINDS, errors, pivots, setting, suns

    points, sky = len(KINDS), (suns(7), pivots(5))
    actual, known = errors(points, 5, 75), errors(points, 5, seed=3, spread=1e-3)
    yield from _parts("spots", mount_spots(setting(KINDS), actual[:, :, 0], known, *sky))
    yield from _parts("statistics", spot_statistics(setting(KINDS), actual, known, *sky))


def calibration() -> Named:
    """Errors of mounts found from noisy spots."""
    from tests.kernels.spots.test_calibration import Case

    yield from _parts("calibration", Case(noise=0.02, seeds=5).calibrate())


def gazing() -> Named:
    """Images of backward gazing, and the slopes that each method finds in them."""
    from heliosweep.kernels.gazing.geometry import themis_8, transfers
    from heliosweep.kernels.gazing.rendering import image_set, module_spheres
    from heliosweep.kernels.gazing.slopes import fit_slopes, search_slopes
    from heliosweep.kernels.sun.profiles import jose
    from tests.kernels.gazing.twin import by_kernels, paper_canting, paper_grid, paper_scene

    layout, grid, profile = paper_scene(), paper_grid(0.2), jose()
    y, z = grid.pixel_y, grid.pixel_z
    images, true = image_set(layout, grid, profile, module_spheres(themis_8(), 120.0, paper_canting()))
    yield "images", images
    yield "true slopes", true
    slopes, _ = by_kernels(images, layout, profile, y, z, transfers(layout))
    yield "A", slopes
    yield from _parts("O1", search_slopes(layout, profile, images, true))
    yield from _parts("O2", search_slopes(layout, profile, images, slopes[0], [y, z]))
    yield from _parts("LM", fit_slopes(layout, profile, images, slopes[0], [y, z]))


def _parts(name: str, found: Any) -> Named:
    """What a kernel's face returns, array by array."""
    if hasattr(found, "_asdict"):
        found = found._asdict()
    elif hasattr(found, "__dict__"):
        found = vars(found)
    elif isinstance(found, tuple):
        found = {str(number): part for number, part in enumerate(found)}
    if not isinstance(found, dict):
        yield name, found
        return
    for key, part in found.items():
        if part is not None:
            yield from _parts(f"{name} {key}", part)


FAMILIES = {each.__name__: each for each in (field, dish, curves, mounts, calibration, gazing)}


def digests(family: str) -> dict[str, str]:
    """Digest of the bits of each result of a family; one NaN is as good as another."""
    found = {}
    for name, values in FAMILIES[family]():
        array = np.array(values)
        if array.dtype == np.float64:
            array[np.isnan(array)] = np.nan
        found[name] = hashlib.sha256(array.tobytes()).hexdigest()
    return found


def registers() -> str:
    """The widest registers that a loop uses that could use any."""
    from heliosweep.kernels.compiled import kernel

    space: dict[str, Any] = {}
    exec("def add(a, b):\n    for k in range(a.shape[0]):\n        a[k] += b[k]", space)  # no file: never cached
    loop = kernel(space["add"])
    loop(np.ones(64), np.ones(64))
    (assembly,) = loop.inspect_asm().values()
    return max(re.findall(r"%([xyz]mm)", assembly), default="none")


if __name__ == "__main__":
    json.dump({"registers": registers(), **{family: digests(family) for family in sys.argv[1:]}}, sys.stdout)
