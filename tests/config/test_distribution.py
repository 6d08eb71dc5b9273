"""Numbers that may be drawn at random: forms, units, what is refused, schema and identity."""

from pathlib import Path
from typing import Annotated, Any, Literal

import pytest

from heliosweep.config.blocks import Block
from heliosweep.config.load import load, load_mapping
from heliosweep.config.study import Study, plain
from heliosweep.config.values import Distribution, Uncertain

OFFSET = Uncertain("Offset of the reference", "mrad", ge=-1000, le=1000)


class Errors(Block):
    """Two numbers of a made-up family."""

    azimuth: Annotated[Any, OFFSET]
    elevation: Annotated[Any, OFFSET] = 0.0


class Made(Study):
    """A made-up family."""

    family: Literal["made"]
    errors: Errors


REGISTRY = {"made": Made}


@pytest.mark.parametrize(
    ("raw", "distribution"),
    [
        ({"normal": [0, 1.5], "samples": 1000, "seed": 7}, Distribution("normal", (0.0, 1.5), 1000, 7)),
        ({"normal": ["1 mrad", "200 urad"]}, Distribution("normal", (1.0, 0.2))),
        ({"uniform": (-1, 3), "seed": 0}, Distribution("uniform", (-1.0, 3.0), None, 0)),
        ({"uniform": [2, 2], "samples": 1}, Distribution("uniform", (2.0, 2.0), 1)),
        ({"normal": [0, 1], "seed": 2**53 - 1}, Distribution("normal", (0.0, 1.0), None, 2**53 - 1)),
        ({"normal": [-0.0, 0]}, Distribution("normal", (0.0, 0.0))),
    ],
)
def test_distributions(raw: dict[str, Any], distribution: Distribution) -> None:
    read = OFFSET.read(raw)
    assert read == distribution
    assert hash(read) == hash(distribution)
    assert OFFSET.read(read.spec()) == read


def test_moments() -> None:
    normal, uniform = OFFSET.read({"normal": [1, 2]}), OFFSET.read({"uniform": [-1, 5]})
    assert (normal.mean, normal.width) == (1.0, 2.0)
    assert (uniform.mean, uniform.width) == (2.0, 3.0)
    assert Distribution("uniform", (-1e300, 1e300)).width == 1e300


def test_a_study_keeps_its_distributions(tmp_path: Path) -> None:
    drawn = {"normal": [0, "1.5 mrad"], "samples": 10, "seed": 7}
    study = load_mapping({"family": "made", "errors": {"azimuth": drawn, "elevation": [0, 1]}}, REGISTRY)
    assert study.errors.azimuth == Distribution("normal", (0.0, 1.5), 10, 7)
    assert list(study.sweeps()) == ["errors.elevation"]
    assert plain(study)["errors"]["azimuth"] == {"normal": [0.0, 1.5], "samples": 10, "seed": 7}
    path = tmp_path / "again.yaml"
    path.write_text(study.to_yaml(), encoding="utf-8")
    again = load(path, REGISTRY)
    assert again == study
    assert again.study_id == study.study_id
    other = load_mapping({"family": "made", "errors": {"azimuth": drawn | {"seed": 8}, "elevation": [0, 1]}}, REGISTRY)
    assert other.study_id != study.study_id
    object_given = {"family": "made", "errors": {"azimuth": study.errors.azimuth, "elevation": [0, 1]}}
    assert load_mapping(object_given, REGISTRY) == study
