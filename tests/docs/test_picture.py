"""The picture of the README and the home page is what its study draws; it is kept so that both show without a run."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from heliosweep import api
from heliosweep.report.draw import draw
from heliosweep.report.style import image
from tests.conftest import ROOT, STUDIES


def test_the_picture_is_what_the_study_draws(tmp_path):
    study = api.load(STUDIES / "chong2012_maps.yaml")
    with api.run(study, tmp_path / "maps", report=False).open() as result:
        figures = {named.name: named.figure for named in draw(result, api.family_of(study).figures(result))}
    drawn = _grey(io.BytesIO(image(figures["field_maps"])))
    kept = _grey(ROOT / "docs/_static/field_maps.png").resize(drawn.size)
    # Fonts and lines may fall a pixel apart with another matplotlib; another field or other numbers would not pass.
    assert np.mean(np.abs(np.asarray(drawn, float) - np.asarray(kept, float))) < 4


def _grey(file: io.BytesIO | Path) -> Image.Image:
    """A picture on white, in shades of grey."""
    picture = Image.open(file).convert("RGBA")
    return Image.alpha_composite(Image.new("RGBA", picture.size, "white"), picture).convert("L")
