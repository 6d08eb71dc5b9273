"""Table 1 of Defieux, Caliot and Henault (2020), doi 10.1063/5.0029270, from the shipped studies.

The paper prints neither where sun and cameras stood nor the modules and the profile it measured; the studies assume
them. What is asked here is what the paper claims, and what the studies' description in `studies/README.md` states.
"""

from __future__ import annotations

from contextlib import chdir
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from heliosweep import api
from heliosweep.report.comparison import AGREES, compare, read_published
from tests.conftest import STUDIES

TABLE = read_published(STUDIES / "published" / "defieux2020_table1.csv")
PAPER = ("A", "O1", "O2")
NUMBERS = [f"Table 1: {method} {profile}" for method in PAPER for profile in ("clean", "noisy")]
PUBLISHED = [one for one in TABLE.values if one.claim in NUMBERS]


def result_of(name: str, **blocks: Any) -> Any:
    """What a shipped study computes with some of its blocks replaced: fewer points or methods have the same numbers."""
    content = yaml.safe_load((STUDIES / f"{name}.yaml").read_text(encoding="utf-8"))
    with chdir(STUDIES):
        return api.build(api.load(content | blocks)).compute()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The run of the table's study."""
    folder = tmp_path_factory.mktemp("defieux2020") / "out"
    study = api.load(STUDIES / "defieux2020_table1.yaml", {"execution.memory": "700 MB"})
    return api.run(study, folder, report=False)


@pytest.fixture(scope="module")
def result(run):
    with run.open() as stored:
        return stored.load()


@pytest.fixture(scope="module")
def table(result):
    """Errors over (profile, seed, method, module, axis), without a referential. [%]"""
    result = result.sel(module=[2, 3], referential="none")
    both = [
        result[f"relative_error_{axis}"].transpose("sun_profile", "profile_seed", "slope_method", "module")
        for axis in "xy"
    ]
    assert result["slope_method"].values.tolist() == [*PAPER, "LM"]
    return np.stack(both, axis=-1)


def test_clean_a_and_o1_miss_the_rotation_of_the_field(table):
    """About 15 % on X, sin 8.6 deg; 2 % on Y, where the paper has 0.7 to 2.1."""
    clean = table[0, 0]
    assert clean[:2, :, 0] == pytest.approx(np.full((2, 2), 14.75), abs=0.3)
    assert clean[:2, :, 1] == pytest.approx(np.full((2, 2), 1.95), abs=0.25)


def test_clean_o2_and_lm_are_exact(table):
    """At most 0.02 %, where the paper has 0.5: its optimiser's tolerance."""
    assert table[0, :, 2:].max() < 0.02
    assert (table[0] == table[0, :1]).all()  # nothing of it is random


def test_noisy_o2_is_the_best_of_the_paper_s_methods(table):
    """Without a referential: in every one of 64 seeds by the root mean square of its four errors and by the largest."""
    for reduce in (lambda errors: np.sqrt(np.mean(errors**2, axis=(2, 3))), lambda errors: errors.max(axis=(2, 3))):
        size = reduce(table[1])
        assert np.mean(size[:, 2] < size[:, :2].min(axis=1)) >= 0.95
    both = np.hypot(table[1, ..., 0], table[1, ..., 1])  # X and Y together, each module by itself
    assert np.mean(both[:, 2] < both[:, :2].min(axis=1)) >= 0.95
    each = np.mean(table[1, :, 2] < table[1, :, :2].min(axis=1), axis=0)
    assert (each[:, 0] >= 0.95).all()  # X alone
    assert (each[:, 1] > 0.5).all()  # Y alone: O1 is often as good
    assert (each[:, 1] < 0.8).all()


def test_noisy_o2_is_seldom_the_best_where_the_others_know_the_geometry(result):
    """With the referentials roll and exact, by the root mean square of the four errors."""
    result = result.sel(module=[2, 3], sun_profile="noisy")
    for referential in ("roll", "exact"):
        here = [result[f"relative_error_{axis}"].sel(referential=referential) for axis in "xy"]
        errors = np.stack([one.transpose("profile_seed", "slope_method", "module") for one in here], axis=-1)
        size = np.sqrt(np.mean(errors**2, axis=(2, 3)))
        assert 0.3 < np.mean(size[:, 2] < size[:, :2].min(axis=1)) < 0.5


def test_noisy_lm_is_better_than_o2(table):
    size = np.sqrt(np.mean(table[1] ** 2, axis=(2, 3)))
    assert np.mean(size[:, 3] < size[:, 2]) >= 0.9
    medians = np.median(table[1], axis=0)
    assert (medians[3] < medians[2]).all()
    assert (medians[1, :, 1] < medians[0, :, 1]).all()  # on Y, O1 is less sensitive to noise than A
    assert medians[2] == pytest.approx(np.array([[1.6, 3.5], [1.3, 2.3]]), abs=0.1)
    assert medians[3] == pytest.approx(np.array([[1.0, 1.2], [0.9, 1.7]]), abs=0.1)


def test_published_values_lie_within_the_spread_of_the_seeds(table):
    """All 12 noisy values within all seeds; the table of claims asks whether within 5 to 95 %."""
    noisy = [one for one in PUBLISHED if one.where["sun_profile"] == "noisy"]
    assert len(noisy) == 12
    for one in noisy:
        method, module = PAPER.index(one.where["slope_method"]), int(one.where["module"]) - 2
        errors = table[1, :, method, module, "xy".index(one.quantity[15])]
        assert errors.min() <= one.published <= errors.max(), one


def test_under_4_5_percent_is_a_matter_of_luck(table):
    """The paper's claim for O2 with a measured profile, all four numbers together."""
    assert 0.4 < np.mean((table[1, :, 2] < 4.5).all(axis=(1, 2))) < 0.7
    assert np.mean((table[1, :, 3] < 4.5).all(axis=(1, 2))) > 0.85


def test_contamination_grows_with_the_sun_s_azimuth():
    result = result_of("sun_azimuth_contamination", method=["A", "LM"]).sel(module=[2, 3])
    a, azimuth = result["slope_bias_x"].sel({"slope_method": "A"}), result["sun_azimuth"]
    none = np.abs(a.sel(referential="none"))
    assert float(none.sel(sun_azimuth=0).max()) < 0.002  # the sun in the target's plane
    assert float(none.sel(sun_azimuth=30, sun_elevation=60).mean()) == pytest.approx(0.147, abs=0.003)
    assert (none.sel(module=2, sun_azimuth=azimuth[azimuth >= 0]).diff("sun_azimuth") > 0).all()
    assert float(np.abs(a.sel(referential="exact")).max()) < 0.01
    assert 0.02 < float(np.abs(a.sel(referential="roll")).max()) < 0.1
    assert float(np.abs(result["slope_bias_x"].sel({"slope_method": "LM"})).max()) < 3e-4


def test_profile_and_gain_limit_the_method():
    """One percent of angular radius costs about 2 % of slope; one of gain 3 % on module 3, 6 % on module 2."""
    result = (
        result_of("profile_error", method=["LM"], profile_error=[0, 0.01])
        .sel({"slope_method": "LM", "module": [2, 3]})
        .isel(referential=0)
    )
    wide = result["relative_error_y"].sel(profile_error=0.01, gain_error=0)
    bright = result["relative_error_y"].sel(profile_error=0, gain_error=0.01)
    assert wide.to_numpy() == pytest.approx(np.array([1.84, 2.12]), abs=0.1)
    assert bright.to_numpy() == pytest.approx(np.array([6.0, 3.1]), abs=0.2)
    assert float(result["relative_error_y"].sel(profile_error=0, gain_error=0).max()) < 0.01


def test_near_cameras_see_more_and_far_ones_more_precisely():
    cameras = {"radius": {"start": 0.06, "stop": 0.42, "step": 0.06}, "noise": 0.005, "bits": 12}
    cameras |= {"arrangement": "square", "seed": [0, 1]}
    result = result_of("camera_radius", method=["LM"], cameras=cameras).sel({"slope_method": "LM"}).isel(referential=0)
    bound = result["cramer_rao_bound_y"].sel(canting_scale=0).mean(["camera_seed", "module"])
    assert (bound.diff("camera_radius") < 0).all()
    seen = (result["lit_cameras"].sel(module=2).mean("camera_seed") == 1).sum("canting_scale")
    assert (seen.diff("camera_radius") <= 0).all()
    all_lit = result["lit_cameras"].sel(module=2, camera_radius=0.24).mean("camera_seed")
    assert float(all_lit.sel(canting_scale=1.25)) == 1.0 > float(all_lit.sel(canting_scale=1.5))  # 1.36 mrad


def test_a_field_is_measured_far_from_the_tower_and_under_a_sun_behind_it():
    result = result_of("field_of_heliostats", method=["LM"], referential=["exact"])
    lm = result.sel({"slope_method": "LM", "referential": "exact"})
    seen = lm["usable_fraction"] > 0.9
    assert [int(seen.sel(hour=hour).sum()) for hour in (9, 12, 15)] == pytest.approx([126, 144, 126], abs=5)
    assert float(lm["incidence"].where(seen).max()) < 35
    assert float(lm["slope_rms_x"].where(seen).max()) < 0.09
    east, west = lm["usable_fraction"].sel(hour=9), lm["usable_fraction"].sel(hour=15)
    assert float(east.mean()) == pytest.approx(float(west.mean()), abs=0.02)  # the field is symmetric


def test_claims(result):
    """Every verdict and number is the one that the table states, also where the paper's claim does not hold here."""
    assert compare(result, TABLE).surprises == []
    assert sum(one.stated_verdict == AGREES for one in PUBLISHED) == 16  # of 24, as the documentation says


def test_no_error_at_all_is_not_what_was_published(result):
    """Zero and twice what was published are beyond every tolerance of the 24 numbers."""
    for factor in (0.0, 2.0):
        for one in compare(result, TABLE).values:
            if one.claim in NUMBERS:
                assert not replace(one, computed=factor * one.published + 1e-6 * (factor - 1.0)).agrees
