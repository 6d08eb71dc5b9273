"""Every script of the gallery runs and draws figures with labelled axes."""

import runpy
from pathlib import Path

import matplotlib
import pytest
from matplotlib import pyplot

from .pages import DOCS


@pytest.mark.parametrize("script", sorted((DOCS / "scripts").glob("plot_*.py")), ids=lambda script: script.stem)
def test_script_draws_labelled_axes(script: Path) -> None:
    matplotlib.use("agg")
    runpy.run_path(str(script))
    figures = [pyplot.figure(number) for number in pyplot.get_fignums()]
    pyplot.close("all")
    assert figures
    for figure in figures:
        assert any(axes.get_xlabel() for axes in figure.axes)
        assert any(axes.get_ylabel() for axes in figure.axes)
