"""The picture of the README and the front page is drawn from its study, and stored to show without a run."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tests.docs.picture import PICTURE, picture


@pytest.mark.long
def test_the_picture_is_drawn_from_the_study(tmp_path):
    with Image.open(PICTURE) as stored:
        kept = np.asarray(stored.convert("L"), float)
    # Fonts and lines may move by a pixel with another matplotlib; another field or other numbers would not pass.
    assert np.mean(np.abs(np.asarray(picture(tmp_path / "energy").convert("L"), float) - kept)) < 4
