"""Mode detectors: crossings of arrays, the misalignment from them, the closed loop, and tables of crossings."""

from typing import Any

import numpy as np
import pytest

from heliosweep.families.misalignment.calibration import NEITHER, NO_AZIMUTH, SEEN
from heliosweep.families.misalignment.report import remarks
from heliosweep.families.misalignment.study import ERRORS, MOUNTS
from heliosweep.kernels.calibration import ESTIMATED

from . import studies
from .mount_twin import solar_vector

BELOW, BESIDE = {"points": [[-12, -8], [12, -8]]}, {"points": [[8, -12], [8, 12]]}
AROUND = [{"points": [[-9, -9], [9, -9], [9, 9]]}, {"points": [[-9, -8.9], [-9, 9], [8.9, 9]]}]
TRUE = dict(zip(ERRORS, (1.5, -0.8, 0.9, -1.2, 0.0, 0.0), strict=True))
BASE: dict[str, Any] = {
    **{key: studies.CALIBRATION[key] for key in ("family", "site", "heliostats")}, "mode": "detectors",
    "time": {"clock": "solar", "days": [81, 172], "hours": [8, 10, 12, 14, 16]},
    "receiver": {"height": 143, "width": 9, "height_extent": 9},
    "mount": {"mirror_offset": 0.5, "axis_offset": 0.2, "pedestal_height": 4, "axis_azimuth": 20},
    "detectors": {"arrays": [BELOW, BESIDE]}, "mount_errors": TRUE,
}  # fmt: skip


def study(detectors: dict[str, Any] | None = None, **blocks: Any) -> Any:
    given = {**BASE["detectors"], **(detectors or {})}
    return studies.study(BASE, detectors={key: value for key, value in given.items() if value is not None}, **blocks)


def computed(detectors: dict[str, Any] | None = None, **blocks: Any) -> Any:
    return studies.computed(study(detectors, **blocks))


@pytest.mark.parametrize("kind", MOUNTS)
@pytest.mark.parametrize("parameters", [2, 4])
def test_errors_are_recovered_exactly_and_the_loop_leaves_nothing(kind, parameters):
    true = TRUE if parameters == 4 else {"azimuth_reference": 1.5, "elevation_reference": -0.8}
    result = computed(
        {"arrays": AROUND, "parameters": parameters}, mount={**BASE["mount"], "kind": kind}, mount_errors=true
    )
    assert (result.calibration_status == ESTIMATED).all()
    off = np.abs(result.estimated_error - result.true_error)
    assert float(off.isel(parameter=slice(2)).max()) < (1e-12 if parameters == 2 else 5e-12)
    assert float(off.max()) < 5e-12
    assert (result.beam_error_rms.sel(round=0) > 1).all()
    assert float(result.beam_error_rms.sel(round=1).max()) < 5e-12
    assert float(result.spot_distance_rms.sel(round=1).max()) < 1e-11
    assert (result.round_hit_fraction.sel(round=1) == 1).all()


def test_remarks_name_the_limit_of_the_condition_number_that_the_study_gives():
    said = " ".join(remarks(computed({"condition_limit": 1.5})))
    assert "a condition number above 1.5 (up to " in said


DRAWN = {name: {"normal": [0, 2]} for name in ERRORS[:4]} | {"samples": 150, "seed": 3}


def test_intervals_hold_the_truth():
    """95 % intervals hold 95 %: of 450 mounts from all instants, and of single instants."""
    result = computed({"noise": 0.02, "parameters": [2, 4]}, mount_errors=DRAWN)
    four = result.sel(parameters=4)
    ratio = ((four.estimated_error - four.true_error) / four.standard_error).isel(parameter=slice(4)).to_numpy()
    assert 0.93 < np.mean(np.abs(ratio) < 1.96) < 0.97
    assert 0.95 < ratio.std() < 1.05
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(four.covariance, axis1=-2, axis2=-1))[..., :4], four.standard_error[..., :4], rtol=1e-12
    )
    np.testing.assert_allclose(four.residual_rms.mean(), 0.02, rtol=0.1)
    # Two parameters cannot take up tilts: what is left is no noise.
    two = result.sel(parameters=2)
    assert float(two.residual_rms.median()) > 5 * 0.02
    references = {name: {"normal": [0, 2]} for name in ERRORS[:2]} | {"samples": 60, "seed": 3}
    single = computed({"noise": 0.02}, mount_errors=references)
    for column, name in enumerate(("azimuth", "elevation")):
        off = single[f"instant_{name}_error"] - single.true_error.isel(parameter=column)
        ratio = (off / single[f"instant_{name}_standard_error"]).to_numpy()
        assert 0.93 < np.mean(np.abs(ratio[np.isfinite(ratio)]) < 1.96) < 0.97


def test_correcting_instant_by_instant_needs_no_model_of_the_mount():
    """Without noise it leaves what the turn of the mirror about its normal, which two angles do not know, moves."""
    loop = computed({"correction": "instant", "rounds": 3, "parameters": 2})
    left = loop.beam_error_rms.to_numpy()
    assert (left[:, 0] > 1).all()
    assert (left[:, 1:] < 0.2).all()
    assert computed({"rounds": 3, "parameters": 2}).beam_error_rms.sel(round=3).min() > 0.5


def test_arrays_that_are_missed_are_flagged():
    far = {"arrays": [BELOW, {"points": [[-60, 60], [-59, 60]]}], "parameters": 2}
    result = computed(far, heliostats={"positions": BASE["heliostats"]["positions"][1:]})
    assert (result.misses_array.sel(detector=1) == 1).all()
    assert (result.misses_array.sel(detector=0) == 0).all()
    missed = result.detector_status == NO_AZIMUTH
    assert float(missed.mean()) > 0.7
    assert result.detector_status.isin([SEEN, NO_AZIMUTH]).all()
    assert (np.isnan(result.instant_azimuth_error) == missed).all()
    assert (result.crossed_fraction.sel(trace="elevation", detector=0) == 1).all()
    said = list(remarks(result))
    assert said[0].startswith("the traces of 2 of 2 heliostats")
    assert f"at {int(missed.sum())} of 20 instants the azimuth trace crosses no array (detector_status 2)" in said
    nothing = computed({"arrays": [{"points": [[300, 300], [301, 300]]}]})
    assert (nothing.detector_status == NEITHER).all()
    assert (nothing.crossings_used == 0).all()
    assert "no usable crossings" in " ".join(remarks(nothing))
    np.testing.assert_array_equal(nothing.beam_error_rms.sel(round=1), nothing.beam_error_rms.sel(round=0))
    assert np.isnan(nothing.corrected_azimuth).all()


def test_a_crossing_at_a_corner_or_an_end_is_one():
    """Corners are laid where a trace crosses a straight array; due north of the tower at noon also at y = 0."""
    blocks = {
        "heliostats": {"positions": [[0, 150, 0]]},
        "time": {"clock": "solar", "days": [81], "hours": [9, 12, 15]},
    }
    straight = {"arrays": [{"points": [[-40, -8], [40, -8]]}], "noise": None, "pitch": None}
    seen = computed(straight, **blocks).crossing_y.isel(heliostat=0, day=0, trace=0, crossing=0).to_numpy().ravel()
    assert np.isfinite(seen).all()
    for hour, y in enumerate(seen.tolist()):
        bent = {"arrays": [{"points": [[-40, -8], [y, -8], [40, -9]]}, {"points": [[y, -8], [40, -8]]}]}
        result = computed(bent, **blocks).isel(heliostat=0, day=0, hour=hour, trace=0)
        found = np.isfinite(result.crossing_y).sum("crossing")
        assert (found == 1).all()
        np.testing.assert_allclose(result.crossing_y.isel(crossing=0), y, atol=1e-9)


def table(tmp_path: Any, result: Any, noise: float = 0.0, **columns: str) -> str:
    """Crossings of a result as a table, with sun vectors; the columns replace."""
    rng, rows = np.random.default_rng(1), ["heliostat,trace,y,z,sun_x,sun_y,sun_z"]
    for h in range(result.sizes["heliostat"]):
        for day in result.day.to_numpy():
            for hour in result.hour.to_numpy():
                sun = ",".join(map(repr, solar_vector(37.4, int(day), float(hour)).tolist()))
                here = result.isel(heliostat=h).sel(day=day, hour=hour)
                for trace in ("elevation", "azimuth"):
                    y, z = (here[f"crossing_{side}"].sel(trace=trace).to_numpy().ravel() for side in "yz")
                    for i in np.flatnonzero(np.isfinite(y)):
                        # Along the array: the first is level, the second upright.
                        shift = noise * rng.normal()
                        level = i < here.sizes["crossing"]
                        rows.append(
                            f"{h},{trace},{float(y[i] + shift * level)!r},{float(z[i] + shift * (not level))!r},{sun}"
                        )
    path = tmp_path / "crossings.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return str(path)


def test_a_table_of_crossings_tells_the_errors(tmp_path):
    made = computed()
    measured = {"crossings": table(tmp_path, made)}
    found = computed(measured, mount_errors=None)
    np.testing.assert_allclose(found.estimated_error[:, :4], made.true_error[:, :4], atol=1e-11)
    np.testing.assert_allclose(found.corrected_azimuth, made.corrected_azimuth, atol=1e-11)
    assert float(np.abs(found.crossing_residual).max()) < 1e-11
    aligned = computed(mount_errors={"azimuth_reference": 0})
    np.testing.assert_array_equal(found.crossing_y, aligned.crossing_y)
    noisy = computed({"crossings": table(tmp_path, made, 0.02)}, mount_errors=None)
    stated = computed({"crossings": table(tmp_path, made, 0.02), "noise": 0.02}, mount_errors=None)
    np.testing.assert_allclose(noisy.standard_error[:, :4], stated.standard_error[:, :4], rtol=0.5)
    assert float(np.abs((noisy.estimated_error - made.true_error) / noisy.standard_error).max()) < 4
    for name in ("true_error", "beam_error_rms", "spot_y_before"):
        assert name not in found
