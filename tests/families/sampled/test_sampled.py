"""Studies with draws from the file to the result: the same bytes whatever the engine, the cut and a kill."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from SALib.analyze import morris
from scipy import stats

from heliosweep import api, open_result
from heliosweep.config.sample import Design, levels, problem
from heliosweep.families.family import families, study_classes
from heliosweep.grid import plan as lazy
from heliosweep.grid import statistics
from heliosweep.grid.regions import in_result

from .functions import G_FUNCTION, ISHIGAMI, Functions, FunctionStudy, g_function, ishigami, total

ANGLE = {"uniform": [-np.pi, np.pi]}
THREE = {"x1": ANGLE, "x2": ANGLE, "x3": ANGLE}
NORMALS = {"x1": {"normal": [1, 0.5]}, "x2": {"normal": [2, 0.25]}, "x3": {"normal": [0, 0.1]}}


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> Functions:
    """The family of test functions among the others."""
    family = Functions()
    every = {**families(), "functions": family}
    monkeypatch.setattr(api, "families", lambda: every)
    monkeypatch.setattr("heliosweep.families.lookup.families", lambda: every)
    monkeypatch.setattr(api, "study_classes", lambda: {**study_classes(), "functions": FunctionStudy})
    return family


def study(inputs: dict[str, Any], sample: dict[str, Any], **more: Any) -> Any:
    return api.load({"family": "functions", "inputs": inputs, "sample": sample, **more})


def run(asked: Any, folder: Path, **more: Any) -> Any:
    with api.run(asked, folder, report=False, **more).open() as result:
        return result.load()


def test_indices_of_ishigami(tmp_path: Path) -> None:
    asked = study(THREE, {"size": 256, "seed": 1, "sensitivity": "sobol"}, scale=[1, 5])
    result = run(asked, tmp_path)
    assert result.sizes["sample"] == 256 * 5
    assert list(result["parameter"].values) == ["inputs.x1", "inputs.x2", "inputs.x3"]
    for place in range(2):  # a factor on the result changes no index
        for kind, expected in zip(("first_order", "total"), ISHIGAMI, strict=True):
            found = result[f"value_{kind}_index"].values[place]
            half = result[f"value_{kind}_interval"].values[place]
            assert np.all(np.abs(found - expected) <= 1.5 * half)
    assert not np.any(result["constant_total_index"])
    assert "each" not in result
    assert result["each_sample_mean"].dims == ("scale", "heliostat")
    remarks = list(api.family_of(asked).remarks(result))
    assert any("value" in line and "increase the sample size" in line for line in remarks)


def test_a_sum_of_normals(tmp_path: Path) -> None:
    result = run(study(NORMALS, {"size": 1024, "statistics": {"percentiles": [5, 50, 95]}}), tmp_path)
    mean, deviation = 1 + 2 * 2, (0.5**2 + (2 * 0.25) ** 2 + (3 * 0.1) ** 2) ** 0.5
    error = result["total_sample_standard_error"].item()
    assert 0 < error < 0.01
    assert abs(result["total_sample_mean"].item() - mean) < 4 * error
    best = {ending for ending in ("mean", "percentile", "standard_deviation", "standard_error")
            if result[f"total_sample_{ending}"].attrs.get("best_value") == "largest"}  # fmt: skip
    assert best == {"mean", "percentile"}
    assert result["total_sample_standard_deviation"].item() == pytest.approx(deviation, rel=0.02)
    spread = 1.6448536269514722 * deviation
    np.testing.assert_allclose(result["total_sample_percentile"], [mean - spread, mean, mean + spread], atol=0.05)
    np.testing.assert_allclose(result["each_sample_mean"], mean * np.arange(1000), rtol=1e-3)
    np.testing.assert_allclose(
        result["each_sample_percentile"][:, 2], result["total_sample_percentile"][2].item() * np.arange(1000)
    )
    monthly = result["monthly_sample_mean"].transpose("month", "heliostat")
    np.testing.assert_allclose(monthly, np.outer([1, 2, 3], result["each_sample_mean"]), rtol=1e-12)
    x = np.stack([result[f"x{k}"].values for k in (1, 2, 3)], axis=-1)
    assert result["total"].values.tobytes() == total(x).tobytes()
    assert result["x1"].attrs["distribution"] == "normal: mean 1, standard deviation 0.5"
    assert "8 independently scrambled Sobol sequences" in result.attrs["sample_design"]


def test_every_draw_is_stored_where_asked(tmp_path: Path) -> None:
    few = run(study(NORMALS, {"size": 32}), tmp_path / "few")
    all_ = run(study(NORMALS, {"size": 32, "statistics": {"every_draw": True}}), tmp_path / "all")
    assert all_["each"].dims == ("heliostat", "sample")
    assert "each" not in few
    for name in few.data_vars:
        assert few[name].values.tobytes() == all_[name].values.tobytes(), name


@pytest.mark.parametrize("sensitivity", ["", "sobol", "morris", "local"])
def test_any_cut_and_engine_gives_the_same_bytes(
    sensitivity: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sample: dict[str, Any] = {"sensitivity": sensitivity} if sensitivity else {}
    sample |= {"size": 32} if sensitivity != "local" else {}
    digests = set()
    for number, chunks in enumerate(({}, {"sample": 7}, {"sample": 16, "scale": 1})):
        execution = {"chunks": chunks, "scheduler": ("threads", "synchronous", "threads")[number]}
        if number == 2:
            monkeypatch.setattr(lazy, "PASS_BYTES", 400_000)  # many passes over the chunks
        asked = study(THREE, sample, scale=[1, 2, 3], execution=execution)
        digests.add(api.run(asked, tmp_path / str(number), report=False).path.read_bytes())
        built = api.build(asked).compute()
        assert list(built.data_vars) == list(in_result(api.family_of(asked).variables(asked)))
        with open_result(tmp_path / str(number)) as result:
            assert all(built[name].values.tobytes() == result[name].values.tobytes() for name in built.data_vars)
    assert len(digests) == 1


@pytest.mark.parametrize("more", [{"sensitivity": "sobol"}, {"design": "random"}])
def test_a_longer_sample_begins_with_the_draws_of_a_shorter_one(more: dict[str, str], tmp_path: Path) -> None:
    def sized(size: int) -> Any:
        return study(NORMALS, {"size": size, **more, "statistics": {"every_draw": True}}, scale=[1, 2])

    short, long = (run(sized(size), tmp_path / str(size)) for size in (64, 256))
    for name in ("each", "x1", "x2", "x3"):
        first = long[name].values[..., : short.sizes["sample"]]
        assert first.tobytes() == short[name].values.tobytes(), name


def test_draws_of_names(small: Any, tmp_path: Path) -> None:
    names = ["azimuth_elevation", "spinning_elevation"]
    drawn = {"discrete": {"values": names, "weights": [0.25, 0.75]}}
    asked = small(site={"latitude": 40}, tracking=drawn, sample={"size": 16, "sensitivity": "sobol"})
    swept = api.build(small(site={"latitude": 40}, tracking=names)).compute()["field_optical_efficiency"]
    with api.run(asked, tmp_path).open() as result:
        found = result["field_optical_efficiency"]
        np.testing.assert_array_equal(found, swept.sel(tracking=result["tracking"].values))
        mean = 0.25 * swept[0].item() + 0.75 * swept[1].item()
        assert result["field_optical_efficiency_sample_mean"].item() == pytest.approx(mean, rel=1e-2)
        assert result["field_optical_efficiency_total_index"].values == pytest.approx([1.0], abs=0.4)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "could not be drawn" not in page
    assert "azimuth elevation (0.25)" in page


def test_a_page_of_each_kind_is_drawn(tmp_path: Path) -> None:
    for sensitivity, wanted in {
        "": {"distribution", "leading_key", "over_scale"},
        "sobol": {"distribution", "sensitivity", "leading_key", "over_scale"},
        "morris": {"sensitivity"},
        "local": {"sensitivity"},
    }.items():
        folder = tmp_path / (sensitivity or "draws")
        sample: dict[str, Any] = {"sensitivity": sensitivity} if sensitivity else {}
        sample |= {"size": 16} if sensitivity != "local" else {}
        run(study(THREE, sample, scale=[1, 2]), folder)
        page = api.report(folder).read_text(encoding="utf-8")
        assert "could not be drawn" not in page
        assert {path.stem for path in (folder / "figures").glob("*.png")} == wanted
        assert "Drawn keys" in page
        assert json.loads((folder / "manifest.json").read_text())["remarks"] is not None


Function = Callable[[NDArray[np.float64]], NDArray[np.float64]]
KNOWN: list[tuple[Function, NDArray[np.float64], NDArray[np.float64]]] = [
    (lambda u: ishigami(np.pi * (2 * u - 1)), *ISHIGAMI),
    (g_function, *G_FUNCTION),
]


def _indices(function: Function, count: int, kind: str, size: int, seed: int) -> tuple[NDArray[np.float64], ...]:
    design = Design(kind, size, seed, tuple(range(count)), "sobol")
    return statistics.sobol_indices(function(design.points()), design)


@pytest.mark.parametrize("kind", ["sobol", "random"])
@pytest.mark.parametrize(("function", "first", "whole"), KNOWN, ids=["ishigami", "g_function"])
def test_indices_are_those_of_the_closed_form(
    function: Function, first: NDArray[np.float64], whole: NDArray[np.float64], kind: str
) -> None:
    found = _indices(function, len(first), kind, 2048, 3)
    assert np.all(np.abs(found[0] - first) <= 1.5 * found[1])
    assert np.all(np.abs(found[2] - whole) <= 1.5 * found[3])
    assert np.all(found[3] < 0.1)


@pytest.mark.parametrize("kind", ["sobol", "random"])
def test_groups_and_keys_without_effect(kind: str) -> None:
    design = Design(kind, 256, 1, (0, 1, 0, 2), "sobol")
    u = design.points()
    first, first_half, whole, whole_half = statistics.sobol_indices(u[:, 0] * u[:, 2], design)
    np.testing.assert_allclose(first, [1, 0, 0], atol=0.2)
    np.testing.assert_array_equal(whole[1:], 0.0)
    np.testing.assert_array_equal(whole_half[1:], 0.0)
    assert first_half.shape == (3,)
    for found in statistics.sobol_indices(np.full((2, len(design)), 7.0), design):
        np.testing.assert_array_equal(found, np.zeros((2, 3)))
    missing = np.where(np.arange(len(design)) == 5, np.nan, u[:, 0])
    assert all(np.isnan(found).all() for found in statistics.sobol_indices(missing, design))


def test_elementary_effects_are_those_of_salib() -> None:
    design = Design("sobol", 50, 2, (0, 1, 2), "morris")
    u = design.points()
    values = (u[:, 0] - 0.4) ** 2 + 3 * u[:, 1] * u[:, 2]  # effects of both signs
    found = statistics.elementary_effects(np.stack([values, 2 * values]), design)
    expected = morris.analyze(problem(design), levels(design), values, num_levels=4)
    for mine, name in zip(found, ("mu", "mu_star", "sigma"), strict=True):
        np.testing.assert_allclose(mine, np.outer([1, 2], np.asarray(expected[name], float)), rtol=1e-9)


def test_single_steps() -> None:
    design = Design("sobol", 0, 0, (0, 1), "local")
    z = stats.norm.ppf(design.points())
    down, up = statistics.single_steps(3 * z[:, 0] - z[:, 1] ** 2)
    np.testing.assert_allclose(down, [-3, -1], atol=1e-12)
    np.testing.assert_allclose(up, [3, -1], atol=1e-12)


@pytest.mark.parametrize("kind", ["sobol", "latin_hypercube", "random"])
def test_errors_of_means_tell_how_far_they_are_off(kind: str) -> None:
    off = []
    for seed in range(60):
        design = Design(kind, 128, seed, (0, 1, 2))
        u = design.points()
        mean, deviation, error = statistics.mean_of_draws(np.prod(u, axis=1) ** 2, design)
        off.append((mean - 1 / 27) / error)
        assert deviation == pytest.approx((1 / 125 - 1 / 729) ** 0.5, rel=0.5)
    # Student's t with 7 degrees of freedom for sequences has a deviation of 1.18.
    assert 0.75 < np.std(off) / {"sobol": 1.18, "random": 1.0, "latin_hypercube": 0.75}[kind] < 1.35


def test_the_deviation_of_draws_is_that_of_a_sample() -> None:
    mean, deviation, error = statistics.mean_of_draws(np.array([2.0, 4.0, 4.0, 6.0]), Design("random", 4, 0, (0,)))
    np.testing.assert_allclose([mean, deviation, error], [4, (8 / 3) ** 0.5, (8 / 3) ** 0.5 / 2], rtol=1e-14)
