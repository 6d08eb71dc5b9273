"""Distributions in study files, and the draws that follow from them."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from heliosweep.config.load import load_mapping
from heliosweep.config.sample import Design, design_of, drawn_keys, parameter_names
from heliosweep.config.study import yaml_text
from heliosweep.config.values import LEAST, Drawn
from heliosweep.errors import StudyError

from .conftest import REGISTRY

SCIPY = {
    Drawn("normal", (3.0, 0.5)): stats.norm(3.0, 0.5),
    Drawn("truncated_normal", (3.0, 0.5, 2.8, 4.0)): stats.truncnorm(-0.4, 2.0, 3.0, 0.5),
    Drawn("truncated_normal", (0.0, 1.0, 5.0, 7.0)): stats.truncnorm(5.0, 7.0),
    Drawn("uniform", (-1.0, 2.0)): stats.uniform(-1.0, 3.0),
    Drawn("triangular", (1.0, 1.5, 4.0)): stats.triang(0.5 / 3.0, 1.0, 3.0),
    Drawn("triangular", (1.0, 4.0, 4.0)): stats.triang(1.0, 1.0, 3.0),
    Drawn("lognormal", (2.0, 0.3)): stats.lognorm(0.3, scale=2.0),
}


@pytest.mark.parametrize("drawn", SCIPY, ids=lambda drawn: drawn.words())
def test_quantiles_are_those_of_scipy(drawn: Drawn) -> None:
    probability = np.concatenate([[LEAST, 1 - LEAST], np.linspace(0.001, 0.999, 999)])
    np.testing.assert_allclose(drawn.quantile(probability), SCIPY[drawn].ppf(probability), rtol=1e-9, atol=1e-12)
    least, largest = drawn.ends()
    assert least <= drawn.quantile(probability).min()
    assert drawn.quantile(probability).max() <= largest * (1 + 1e-12)


def test_discrete_values_come_as_often_as_their_weights_say() -> None:
    drawn = Drawn("discrete", (3.0, 1.0, 2.0), (0.5, 0.2, 0.3))
    values = drawn.quantile((np.arange(1000) + 0.5) / 1000)
    assert [int(np.sum(values == value)) for value in drawn.parts] == [500, 200, 300]
    assert drawn.ends() == (1.0, 3.0)


def test_sobol_sequences_are_even_and_independent() -> None:
    points = Design("sobol", 1024, 5, (0, 1)).points()
    for sequence in range(8):
        own = points[sequence::8]
        assert np.all(np.histogram(own[:, 0], 128, (0, 1))[0] == 1)  # one in each of as many strata
    products = [points[sequence::8].prod(axis=1).mean() for sequence in range(8)]
    assert len(np.unique(products)) == 8
    assert abs(np.mean(products) - 0.25) < 3 * np.std(products, ddof=1) / 8**0.5


@pytest.mark.parametrize("kind", ["sobol", "latin_hypercube", "random"])
def test_correlated_normals(kind: str) -> None:
    content = _study({"normal": [11, 0.02]}, {"normal": [12, 0.1]}, {"uniform": [90, 100]}) | {
        "sample": {"size": 4096, "design": kind, "correlation": [
            ["heliostat.width", "heliostat.height", 0.8], ["heliostat.height", "receiver.height", -0.4]]},
    }  # fmt: skip
    drawn = drawn_keys(load_mapping(content, REGISTRY))
    assert list(drawn) == ["heliostat.width", "heliostat.height", "receiver.height"]
    width, height, receiver = (each.values() for each in drawn.values())
    found = np.corrcoef([width, height, stats.norm.ppf((receiver - 90) / 10)])
    np.testing.assert_allclose(found, [[1, 0.8, 0], [0.8, 1, -0.4], [0, -0.4, 1]], atol=0.05)
    assert abs(height.mean() - 12) < 0.01
    assert abs(height.std() - 0.1) < 0.005


def _study(width: object, height: object, receiver: object) -> dict[str, object]:
    return {
        "family": "field_efficiency",
        "site": {"latitude": [0, 30]},
        "tracking": "spinning_elevation",
        "time": {"clock": "solar", "hours": {"start": 8, "stop": 16, "step": 1}},
        "layout": {"radial_stagger": {"clearance": 18, "inner_radius": 60, "rings": 2}},
        "heliostat": {"width": width, "height": height, "pivot_height": 7},
        "receiver": {"height": receiver},
    }


def test_drawn_keys_are_one_dimension_crossed_with_sweeps() -> None:
    content = _study({"normal": ["11 m", "2 cm"]}, 11, {"discrete": {"values": [90, 100]}}) | {"sample": {"size": 32}}
    study: Any = load_mapping(content, REGISTRY)
    assert {dim.name: len(dim) for dim in study.dimensions()} == {"latitude": 2, "sample": 32}
    assert study.heliostat.width == Drawn("normal", (11.0, 0.02))
    assert study.heliostat.width.values().shape == (32,)
    assert set(study.receiver.height.values()) == {90.0, 100.0}
    # The study as it is stored says the same, and its id depends on the draws alone.
    again = load_mapping(study.resolved(), REGISTRY)
    assert again == study
    assert again.study_id == study.study_id
    assert "truncated" not in yaml_text(study.resolved())
    more: Any = load_mapping(content | {"sample": {"size": 64}}, REGISTRY)
    assert more.study_id != study.study_id
    np.testing.assert_array_equal(more.heliostat.width[:32], study.heliostat.width.values())


def test_tied_keys_share_their_draws() -> None:
    tied = {"zip": [["heliostat_height", "heliostat.width"]], "sample": {"size": 32, "sensitivity": "sobol"}}
    content = _study({"uniform": [10, 11]}, {"normal": [12, 0.1]}, {"uniform": [90, 100]})
    study: Any = load_mapping(content | tied, REGISTRY)
    assert design_of(study).parameters == 2
    assert parameter_names(study) == ["heliostat.width", "receiver.height"]
    width, height = (study.heliostat.width.values() - 10), study.heliostat.height.values()
    np.testing.assert_allclose(stats.norm(12, 0.1).cdf(height), width, atol=1e-9)
    assert load_mapping(study.resolved(), REGISTRY) == study
    apart = load_mapping(content | {"sample": tied["sample"]}, REGISTRY)
    assert apart.study_id != study.study_id


def test_names_and_whole_numbers_are_drawn_from_a_list() -> None:
    content = _study({"normal": [11, 0.02]}, 11, 95)
    drawn = {"discrete": {"values": ["azimuth_elevation", "spinning_elevation"], "weights": [0.25, 0.75]}}
    study: Any = load_mapping(content | {"tracking": drawn, "sample": {"size": 64}}, REGISTRY)
    names = study.tracking.values()
    assert names.count("azimuth_elevation") == 16
    assert study.tracking[1:3] == (study.tracking[1], study.tracking[2]) == names[1:3]
    assert [dim.name for dim in study.dimensions()] == ["latitude", "sample"]
    assert study.tracking.words() == "discrete: azimuth elevation (0.25), spinning elevation (0.75)"
    assert load_mapping(study.resolved(), REGISTRY) == study
    for wrong, message in (
        ({"normal": [1, 2]}, "names are drawn from {discrete"),
        ({"discrete": {"values": ["azimuth"]}}, r"tracking.discrete.values\[0\]: unknown choice"),
    ):
        with pytest.raises(StudyError, match=message):
            load_mapping(content | {"tracking": wrong, "sample": {"size": 64}}, REGISTRY)
    rings = {"radial_stagger": {"clearance": 18, "inner_radius": 60, "rings": {"normal": [2, 1]}}}
    with pytest.raises(StudyError, match=r"rings.normal: unknown key; whole numbers are drawn from {discrete"):
        load_mapping(content | {"layout": rings, "sample": {"size": 64}}, REGISTRY)
    with pytest.raises(StudyError, match="cannot be drawn"):
        load_mapping(content | {"sample": {"size": 64, "design": drawn}}, REGISTRY)


def test_a_normal_distribution_that_hardly_exceeds_a_bound_is_cut_there_and_noted() -> None:
    """Six standard deviations beyond a bound, such as of a reflectivity of 0.94 +- 0.01, are 9.9e-10 of the draws."""
    content = _study(11, 11, 95) | {"sample": {"size": 32}}
    content["heliostat"] = {"width": 11, "height": 11, "pivot_height": {"normal": [7, 1.35]}}  # must be at least 0
    study: Any = load_mapping(content, REGISTRY)
    drawn = drawn_keys(study)["heliostat.pivot_height"]
    assert drawn.kind == "truncated_normal"
    least, largest = drawn.parts[2:]
    assert least == 0
    assert largest == pytest.approx(7 + 1.35 * stats.norm.isf(LEAST), rel=2e-4)
    assert drawn.cut == pytest.approx(stats.norm.sf(7 / 1.35), rel=1e-6)
    note = next(iter(study.notes()))
    assert note.startswith(
        "heliostat.pivot_height: a fraction of 1e-07 of the normal draws would be out of bounds; "
        "the distribution is truncated to"
    )
    assert load_mapping(study.resolved(), REGISTRY).study_id == study.study_id
    probability = np.linspace(0.01, 0.99, 99)
    np.testing.assert_allclose(drawn.quantile(probability), stats.norm(7, 1.35).ppf(probability), rtol=1e-5)
