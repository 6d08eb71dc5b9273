"""The measured-like images of `studies/images`, made by the camera-image level with noise and 12 bit.

To make them again: python -m tests.families.backward_gazing.make_images studies/images
"""

import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, PngImagePlugin

from heliosweep.kernels.gazing.geometry import (
    MirrorGrid,
    Scene,
    camera_set,
    camera_square,
    heliostat,
    image_set,
    mirror_grid,
    module_spheres,
    pinholes,
    scene,
    themis_8,
    waviness,
)
from heliosweep.kernels.profiles import EPS_MAX, disc_profile, falling_envelope, jose, normal_draws, render

Floats = NDArray[np.float64]

NAMES = ("upper_left", "upper_right", "lower_left", "lower_right")
SHAPE, FOCAL, PIXEL = (176, 176), 2350.0, 0.05
SUN, TARGET, DISTANCE = (30.0, 60.0), (0.0, 44.0), 120.0
#: Planted: rad, and m.
CANTING = 1e-3 * np.array(
    [[0.0, 0.0], [0.0, -1.0], [0.0, 1.0], [0.2, 0.1], [0.0, 0.0], [0.4, 0.2], [-0.3, 0.0], [0.0, 0.0]]
)
POINTING, TRUE_FOCAL, WAVES = (0.15e-3, -0.1e-3), 119.0, (0.1e-3, 1.0, 3)
#: Of the sensors: relative to the sun's centre, levels.
NOISE, BITS, DARK, WHITE = 0.004, 12, 64.0, np.array([3100.0, 3180.0, 3050.0, 3120.0])
ROLLS = (0.8, -0.5, 0.3, -1.1)
SUN_RADIUS, SUN_WHITE = 60.0, 3300.0


class Planted(NamedTuple):
    """The truth."""

    layout: Scene
    grid: MirrorGrid
    slopes: Floats
    """On the grid, shape (2, N). [rad]"""
    images: Floats
    """On the grid, without cameras, shape (4, N). [1]"""


def layout() -> Scene:
    """The scene."""
    sun, target = tuple(np.radians(SUN)), tuple(np.radians(TARGET))
    return scene(sun, target, camera_square(0.24), DISTANCE, 120.0)


@cache
def fine_waves() -> tuple[MirrorGrid, Floats]:
    """The waviness on a fine grid."""
    fine = mirror_grid(themis_8(), PIXEL / 5)
    return fine, waviness(fine, *WAVES)


def planted() -> Planted:
    """True slopes on the mirror's grid."""
    grid, (fine, waves) = mirror_grid(themis_8(), PIXEL), fine_waves()
    field = np.full((2, fine.module.size), np.nan)
    field[:, fine.place] = waves
    wavy = field.reshape(2, *fine.module.shape)[:, 2::5, 2::5].reshape(2, -1)[:, grid.place]
    spheres = module_spheres(themis_8(), TRUE_FOCAL, CANTING, POINTING)
    images, slopes = image_set(layout(), grid, jose(), spheres, np.ascontiguousarray(wavy))
    return Planted(layout(), grid, slopes, images)


def levels(images: Floats, white: float, noise: float, gain_error: Floats | float, seed: int) -> Floats:
    """Images (K, rows, columns) in levels of a sensor above `DARK`, with noise and saturation."""
    out = DARK + images * (white * (1.0 + np.broadcast_to(gain_error, len(images))))[:, np.newaxis, np.newaxis]
    for i, image in enumerate(out):
        image += white * noise * normal_draws(seed, 8 + i, image.size).reshape(image.shape)
    return np.rint(np.clip(out, 0.0, 2.0**BITS - 1.0))


@cache
def camera_levels(supersampling: int = 4, seed: int = 5, noise: float = NOISE) -> Floats:
    """The four images, shape (4, rows, columns). [levels]"""
    here = layout()
    mirror = heliostat(themis_8(), TRUE_FOCAL, CANTING, POINTING, fine_waves())
    cameras = pinholes(here, SHAPE, FOCAL, roll=np.radians(ROLLS))
    seen = camera_set(here, cameras, SHAPE, jose(), mirror, supersampling)
    gains = WHITE / WHITE[0] - 1.0
    return levels(seen, WHITE[0], noise, gains, seed)


def sun_levels() -> Floats:
    """An image of the sun. [levels]"""
    side, fine = int(2 * SUN_RADIUS) + 20, 5
    place = (np.arange(side * fine) + 0.5) / fine - 0.5
    far = np.hypot(place - 0.5 * side + 0.8, place[:, np.newaxis] - 0.5 * side + 0.3)
    disc = render(jose(), far * (EPS_MAX / SUN_RADIUS)).reshape(side, fine, side, fine).mean(axis=(1, 3))
    return levels(disc[np.newaxis], SUN_WHITE, NOISE, 0.0, 6)[0]


def metadata(camera: int) -> dict[str, float]:
    """What the file of a camera says of it."""
    place = camera_square(0.24)[camera]
    return {
        "FOCALPIX": FOCAL, "ROLL": ROLLS[camera], "CAMERAY": round(float(place[0]), 6),
        "CAMERAZ": round(float(place[1]), 6), "DARK": DARK, "WHITE": DARK + float(WHITE[camera]), "SATURATE": 4095.0,
        "SUNAZ": SUN[0], "SUNEL": SUN[1], "TARGETAZ": TARGET[0], "TARGETEL": TARGET[1], "DISTANCE": DISTANCE,
    }  # fmt: skip


def write_png(path: Path, image: Floats, said: dict[str, float]) -> None:
    """A PNG of 16 bit with text."""
    texts = PngImagePlugin.PngInfo()
    for key, value in said.items():
        texts.add_text(key, f"{value:.10g}")
    Image.fromarray(image.astype(np.uint16)).save(path, pnginfo=texts, compress_level=9)


def main(folder: Path) -> None:
    """Write the set."""
    folder.mkdir(parents=True, exist_ok=True)
    for camera, (name, image) in enumerate(zip(NAMES, camera_levels(), strict=True)):
        write_png(folder / f"{name}.png", image, metadata(camera))
    sun = sun_levels()
    pixel = 1e3 * EPS_MAX / SUN_RADIUS
    write_png(folder / "sun.png", sun, {"PIXANGLE": pixel, "DARK": DARK, "SATURATE": 4095.0})
    disc = disc_profile(sun - DARK)
    angle = np.linspace(0.0, pixel * disc.radius, len(disc.brightness))
    rows = [f"{a:.5f},{b:.5f}" for a, b in zip(angle, falling_envelope(disc.brightness), strict=True)]
    head = ["# medians over rings of sun.png, made to fall from the centre to the edge", "angle,brightness"]
    (folder / "sun_profile.csv").write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
