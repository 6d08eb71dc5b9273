"""Mode mount_errors against a second model, by theory of small errors, and cut in every way."""

import itertools
from typing import Any

import numpy as np
import pytest
from scipy import stats

from heliosweep.config.values import Distribution
from heliosweep.families.misalignment.report import remarks
from heliosweep.families.mount_errors import standard_deviates, standard_normals, standard_uniforms, widths_of
from heliosweep.kernels.mounts import ERRORS

from . import studies
from .mount_twin import Twin, solar_vector
from .studies import computed

POSITIONS = studies.MOUNT_ERRORS["heliostats"]["positions"]
HOURS, DAYS = studies.MOUNT_ERRORS["time"]["hours"], studies.MOUNT_ERRORS["time"]["days"]
FIXED = studies.MOUNT_ERRORS["mount_errors"]
KINDS = ("azimuth_elevation", "target_aligned", "polar", "tilt_roll")


def study(**changes: Any) -> Any:
    return studies.study(studies.MOUNT_ERRORS, **changes)


def drawn(samples: int, **errors: Any) -> dict[str, Any]:
    return {"samples": samples, "seed": 7, **errors}


def twins(kind: str = "azimuth_elevation", offsets: tuple[float, float, float] = (0.5, 0.3, 4.0)) -> list[Twin]:
    return [Twin((x, y, z), 100.0, (5.0, -10.0), (1.5, 1.0), kind, 37.4, 20.0, offsets) for x, y, z in POSITIONS]


@pytest.mark.parametrize("kind", KINDS)
def test_fixed_errors_send_the_beam_where_the_twin_says(kind: str) -> None:
    offsets = {"mirror_offset": 0.5, "axis_offset": 0.3, "pedestal_height": 4}
    made = computed(study(mount={"kind": kind, "axis_azimuth": 20, **offsets}))
    for number, twin in enumerate(twins(kind)):
        for day, hour in itertools.product(DAYS, HOURS):
            sun, there = solar_vector(37.4, day, hour), made.isel(heliostat=number).sel(day=day, hour=hour)
            ((y, z),), (real,) = twin.spots(*twin.actual(sun, np.array([list(FIXED.values())]) * 1e-3), sun)
            assert bool(there.is_real) == real
            if real:
                assert [there.spot_y.item(), there.spot_z.item()] == pytest.approx([y, z], abs=2e-10)
                assert bool(there.inside) == twin.inside(np.array([y, z]))


DRAWN: dict[str, Any] = {
    "azimuth_reference": {"normal": [0.5, 3.0]}, "elevation_reference": {"uniform": [-4, 4]},
    "tilt_about_east": {"normal": [0, 2]}, "tilt_about_north": 0.4, "collimation": {"normal": [0, 3], "seed": 99},
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_statistics_are_those_of_the_twin_with_the_same_draws(kind: str) -> None:
    samples, percentiles = 15, [0, 30, 75]
    offsets = {"mirror_offset": 0.5, "axis_offset": 0.3, "pedestal_height": 4}
    drawing = study(
        mount={"kind": kind, "axis_azimuth": 20, **offsets}, mount_errors=drawn(samples, **DRAWN, scale=1.5),
        statistics={"percentiles": percentiles}, time={"clock": "solar", "days": [172], "hours": [9, 13.5, 23]},
    )  # fmt: skip
    assert drawing.mount_errors is not None
    made = computed(drawing).squeeze("day")
    errors = drawing.mount_errors.errors()
    mean = np.array([error.mean if isinstance(error, Distribution) else error for error in errors], float)
    draws = (mean + 1.5 * widths_of(errors) * standard_deviates(errors, range(3), samples, 7)) * 1e-3
    for number, twin in enumerate(twins(kind)):
        for j, hour in enumerate((9.0, 13.5)):
            sun = solar_vector(37.4, 172, hour)
            normals, centres = twin.actual(sun, draws[number])
            spots, real = twin.spots(normals, centres, sun)
            there = made.isel(heliostat=number, hour=j)
            assert there.real_fraction.item() == real.mean()
            assert there.hit_fraction.item() == twin.inside(spots).mean()
            y, z = spots[real].T
            covariance = np.cov(y, z)
            found = [there[f"spot_{name}"].item() for name in ("y_mean", "z_mean")]
            assert found == pytest.approx([y.mean(), z.mean()], abs=1e-9)
            found = [there[f"spot_{name}"].item() for name in ("y_variance", "z_variance", "yz_covariance")]
            assert found == pytest.approx([covariance[0, 0], covariance[1, 1], covariance[0, 1]], abs=1e-9)
            for axis in range(2):
                left = [twin.remaining(*pair, sun, axis) for pair in zip(normals, centres, strict=True)]
                expected = np.percentile(np.array(left) * 1e3, percentiles)
                np.testing.assert_allclose(there.remaining_tolerance[:, axis], expected, atol=1e-7)
    dark = made.isel(hour=2)
    assert np.all(dark.spot_status == 3)
    dark = dark.drop_vars("spot_status")
    assert all(bool(dark[name].isnull().all()) for name in dark.data_vars if "hour" in made[name].dims)
    np.testing.assert_allclose(made.day_hit_fraction, made.hit_fraction[:, :2].mean("hour"), rtol=1e-14)
    np.testing.assert_allclose(made.field_hit_fraction, made.hit_fraction.mean("heliostat"), rtol=1e-14)


ALL_DRAWN: dict[str, Any] = {name: {"normal": [0.1, 2.0]} for name in ERRORS}


def test_behind_the_receiver_nothing_hits() -> None:
    positions = [[0, 100, 5], [0, -100, 5], [10, 0, 5]]
    face = {"height": 100, "width": 3, "height_extent": 3}
    fixed = computed(study(heliostats={"positions": positions}, receiver=face, mount_errors={"collimation": 0}))
    assert fixed.inside.any(["day", "hour"]).values.tolist() == [True, False, False]
    made = computed(study(heliostats={"positions": positions}, receiver=face, mount_errors=drawn(9, **ALL_DRAWN)))
    assert np.all(made.real_fraction.isel(heliostat=slice(1, None)) == 0)
    assert np.all(made.hit_fraction.isel(heliostat=slice(1, None)) == 0)
    assert np.all(made.remaining_tolerance.isel(heliostat=slice(1, None)) == 0)
    assert bool(made.spot_y_mean.isel(heliostat=slice(1, None)).isnull().all())
    assert any("no draw" in remark for remark in remarks(made))
    assert any("behind" in remark for remark in remarks(fixed))


def test_the_blind_cone_has_no_spots_and_is_counted() -> None:
    """The sun opposite the target: the normal is the vertical, along the primary axis, and an axis offset swings it."""
    place: dict[str, Any] = {
        "receiver": {"height": 100, "width": 3, "height_extent": 3},
        "heliostats": {"positions": [[0, 100, 0], [-16, 150, 7]]}, "sun": {"azimuth": 0, "elevation": 45}, "time": None,
        "mount": {"axis_offset": 0.2},
    }  # fmt: skip
    for errors in ({"collimation": 0}, drawn(9, collimation={"normal": [0, 0.1]})):
        made = computed(study(**place, mount_errors=errors))
        assert made.spot_status.values.ravel().tolist() == [4, 0]
        for name in ("spot_y", "spot_z") if "spot_y" in made else ("spot_y_mean", "spot_z_mean", "spot_y_variance"):
            assert np.isnan(made[name].values.ravel()).tolist() == [True, False]
        said = [remark for remark in remarks(made) if "blind cone" in remark]
        assert said == ["1 of 2 rays require a mount to point into its blind cone: no spot (spot_status 4)"]


FIRST_UNIFORMS = [[0.8720734548204873, 0.29536538151378366, 0.4200976785072422]]
FIRST_NORMALS = [0.10897874404606084, -0.10851255368496111]


def test_the_first_draws_of_a_seed_never_change() -> None:
    """Numbers of this version, written down: a change of the generator is a change of every stored result."""
    assert standard_uniforms(7, 0, [0], 3).tolist() == FIRST_UNIFORMS
    assert standard_normals(7, 5, [316], 2) == pytest.approx(np.array([FIRST_NORMALS]), rel=1e-14)


@pytest.mark.parametrize("stream", [0, 5])
def test_normal_draws_are_normal(stream: int) -> None:
    draws = standard_normals(7, stream, range(200), 1000)
    assert stats.kstest(draws.ravel(), "norm").pvalue > 0.01
    # Within heliostats, too, and not only in the mixture: uniform p-values.
    each = [stats.kstest(row, "norm").pvalue for row in draws]
    assert stats.kstest(each, "uniform").pvalue > 0.01
    moments = draws.mean(), draws.var(), stats.skew(draws, axis=None), stats.kurtosis(draws, axis=None)
    errors = np.sqrt(np.array([1.0, 2.0, 6.0, 24.0]) / draws.size)
    assert np.all(np.abs(np.array(moments) - [0.0, 1.0, 0.0, 0.0]) < 4 * errors)


def test_draws_are_independent_between_heliostats_errors_samples_and_seeds() -> None:
    samples = 20_000
    series = [standard_normals(seed, stream, range(4), samples) for seed in (0, 1) for stream in range(6)]
    stacked = np.concatenate(series)
    correlation = np.corrcoef(stacked) - np.eye(len(stacked))
    pairs = len(stacked) * (len(stacked) - 1) / 2
    limit = stats.norm.isf(0.005 / pairs) / np.sqrt(samples)
    assert np.abs(correlation).max() < limit
    lagged = np.array([np.corrcoef(row[1:], row[:-1])[0, 1] for row in stacked])
    assert np.abs(lagged).max() < stats.norm.isf(0.005 / len(stacked)) / np.sqrt(samples)
    squares = np.corrcoef(stacked**2) - np.eye(len(stacked))
    assert np.abs(squares).max() < 1.5 * limit


def test_fewer_samples_and_heliostats_are_the_first_of_more() -> None:
    many = standard_normals(3, 1, range(50), 1000)
    assert np.array_equal(standard_normals(3, 1, [17, 4, 49], 10), many[[17, 4, 49], :10])
    for first in (1, 3, 517):
        assert np.array_equal(standard_normals(3, 1, range(5), 20, first), many[:5, first : first + 20])


def test_errors_of_all_kinds() -> None:
    errors = [
        Distribution("normal", (1.0, 2.0)),
        0.25,
        Distribution("uniform", (-1.0, 3.0), seed=11),
        Distribution("normal", (5.0, 0.0)),
    ]
    deviates = standard_deviates(errors, range(30), 500, seed=7)
    assert deviates.shape == (30, 500, 4)
    assert widths_of(errors).tolist() == [2.0, 0.0, 2.0, 0.0]
    assert np.array_equal(deviates[..., 0], standard_normals(7, 0, range(30), 500))
    assert np.all(deviates[..., 1] == 0.0)
    assert stats.kstest(deviates[..., 2].ravel(), "uniform", args=(-1.0, 2.0)).pvalue > 0.01
    assert np.array_equal(deviates[..., 2], 2.0 * standard_uniforms(11, 2, range(30), 500) - 1.0)
