"""Draw the pictures of the README and the front page: ``python docs/_ext/picture.py`` writes them.

The picture of a report page needs chromium.
"""

import io
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

from heliosweep import api
from heliosweep.report.draw import draw, image

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs/_static/front.png"
PAGE = ROOT / "docs/_static/page.png"
WIDTH, HEIGHT = 1200, 420


def picture(folder: Path) -> Image.Image:
    """Draw field map and losses of the study `surround_energy` side by side; the study runs in a folder."""
    study = api.load(ROOT / "studies" / "surround_energy.yaml")
    with api.run(study, folder, report=False).open() as result:
        one = result.isel(tracking=[0]).load()
    figures = {named.name: named.figure for named in draw(one, api.family_of(study).figures(one))}
    parts = [Image.open(io.BytesIO(image(figures[name]))).convert("RGB") for name in ("field_maps", "energy_losses")]
    whole = Image.new("RGB", (WIDTH, HEIGHT), "white")
    left = 0
    for part, width in zip(parts, (WIDTH // 3, WIDTH - WIDTH // 3), strict=True):
        scale = min(width / part.width, HEIGHT / part.height)
        part = part.resize((round(part.width * scale), round(part.height * scale)), Image.Resampling.LANCZOS)
        whole.paste(part, (left + (width - part.width) // 2, (HEIGHT - part.height) // 2))
        left += width
    return whole


def page(folder: Path) -> Image.Image:
    """Take a picture of the first screen of a report page; `picture` has computed the result in the folder."""
    api.report(folder)
    shot = folder / "shot.png"
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=1200,800"]
    subprocess.run(["chromium", *options, f"--screenshot={shot}", f"file://{folder}/report.html"], check=True)
    return Image.open(shot).convert("RGB").quantize(128)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        picture(Path(folder)).save(PICTURE, optimize=True)
        page(Path(folder)).save(PAGE, optimize=True)
