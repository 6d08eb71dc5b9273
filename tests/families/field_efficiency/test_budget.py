"""Error budgets: parts against runs of changed studies, sums, zero errors, draws, and wrong budgets."""

from typing import Any

import numpy as np
import pytest
import xarray as xr

from heliosweep.errors import StudyError
from heliosweep.families.field_efficiency.drawing import error_budget
from tests.families.field_efficiency.test_energy import BLOCKS
from tests.families.field_efficiency.test_light_files import FACE, PLACES, SHAPES, calibrated, maps, table
from tests.families.studies import computed

OPTICS: dict[str, Any] = {
    **BLOCKS["optics"], "soiling": {"rate": 0.004, "washing_interval": 14},
    "mount_errors": {"azimuth_reference": {"normal": [0, 2]}, "seed": 3}, "tracking_error": 0.5, "rays": 64,
}  # fmt: skip
BUDGET: dict[str, dict[str, Any]] = {
    "misalignment": {"optics.mount_errors.scale": 0}, "slopes": {"optics.slope_error": 0, "optics.tracking_error": 0},
    "tracking method": {"tracking": "spinning_elevation"}, "dirt": {"optics.soiling.rate": 0},
    "air": {"optics.attenuation": "none"},
}  # fmt: skip
YEAR: dict[str, Any] = {**BLOCKS, "tracking": "azimuth_elevation", "optics": OPTICS, "limits": {"dni": 600}}


@pytest.fixture(scope="module")
def budget(small) -> xr.Dataset:
    return computed(small(**YEAR, budget=BUDGET))


def test_parts_sum_to_the_total_loss_and_stages_to_the_rest(budget):
    """Incident energy, less stages without causes, less causes, less interaction, is the energy received."""
    assert budget["budget_part"].values.tolist() == [*BUDGET, "interaction"]
    total = budget["budget_energy"] - budget["field_receiver_energy"]
    assert float(budget["budget_loss"].sum()) == pytest.approx(float(total), rel=1e-12)
    rest = budget["field_incident_energy"] - budget["budget_stage_loss"].sum() - budget["budget_loss"].sum()
    assert float(rest) == pytest.approx(float(budget["field_receiver_energy"]), rel=1e-12)
    assert float(abs(budget["budget_loss"].sel(budget_part="interaction"))) > 1e-3 * float(total)
    assert not budget["budget_stage_loss"].sel(stage="attenuation")


def test_each_energy_is_the_energy_of_a_changed_study(small, budget):
    study = small(**YEAR)

    def energy(*causes: str) -> float:
        changes = {key: value for cause in causes for key, value in BUDGET[cause].items()}
        return float(computed(study.with_(changes) if changes else study)["field_receiver_energy"])

    assert energy() == float(budget["field_receiver_energy"])
    assert energy(*BUDGET) == float(budget["budget_energy"])
    for cause in ("misalignment", "dirt", "tracking method"):
        alone = energy(*(other for other in BUDGET if other != cause))
        assert float(budget["budget_energy"]) - alone == float(budget["budget_loss"].sel(budget_part=cause))
        assert energy(cause) - energy() == float(budget["budget_gain"].sel(budget_cause=cause))


def test_measured_surfaces_and_calibrated_mounts_are_causes(small, tmp_path):
    """A map of slopes for each heliostat, canting included, and the errors that a calibration found, halved."""
    layout = {"layout": {"file": table(tmp_path / "field.csv", "x,y,name", PLACES)}}
    found = calibrated(tmp_path, **layout)
    optics = {key: value for key, value in OPTICS.items() if key not in ("slope_error", "mount_errors")}
    surfaces = {"slope_map": maps(tmp_path / "maps.nc", SHAPES, name=["b1", "b2", "b3"])}
    mounts = {"mount_errors": {"calibration": found, "scale": 0.5}}
    causes = {"misalignment": {"optics.mount_errors.scale": 0}, "surfaces": {"optics.slope_map": "none"}}
    blocks = {**YEAR, **layout, "receiver": FACE}
    result = computed(small(**{**blocks, "optics": optics | surfaces | mounts}, budget=causes))

    def energy(more: dict[str, Any]) -> float:
        return float(computed(small(**{**blocks, "optics": optics | more}))["field_receiver_energy"])

    none = {"slope_error": 0}
    halved = {"mount_errors": {"azimuth_reference": 0.75, "tilt_about_north": -0.5}}  # as calibrated() finds them
    loss = result["budget_loss"]
    assert float(result["budget_energy"]) == energy(none)
    assert float(loss.sel(budget_part="surfaces")) == energy(none) - energy(surfaces)
    assert float(loss.sel(budget_part="misalignment")) == pytest.approx(energy(none) - energy(none | halved), rel=1e-6)
    assert float(result["error_scale"]) == 0.5
    with pytest.raises(StudyError, match=r"budget\.x\.optics\.slope_map: must be none"):
        small(**{**blocks, "optics": optics | surfaces}, budget={"x": {"optics.slope_map": "other.nc"}})


def test_nothing_is_lost_to_errors_of_zero(small):
    """Bit for bit, with the rays that the precision chooses."""
    optics = {key: value for key, value in OPTICS.items() if key != "rays"}
    optics |= {"slope_error": 0, "tracking_error": 0, "precision": 1e-2}
    optics["mount_errors"] = OPTICS["mount_errors"] | {"scale": 0}
    causes = {name: BUDGET[name] for name in ("misalignment", "slopes")}
    result = computed(small(**{**YEAR, "optics": optics}, budget=causes))
    assert not result["budget_loss"].any()
    assert not result["budget_gain"].any()
    assert result["budget_energy"] == result["field_receiver_energy"]


def test_causes_do_not_move_the_aim_points(small):
    """Levels of aim depend on the size of the images; smaller images on wider levels would miss the receiver."""
    receiver = {"kind": "cylinder", "height": 30, "radius": 2, "height_extent": 8}
    blocks = {**YEAR, "aim": {"strategy": "spread", "levels": 3}, "receiver": receiver}
    result = computed(small(**blocks, budget={"slopes": {"optics.slope_error": 0}}))
    moved = computed(small(**{**blocks, "optics": OPTICS | {"slope_error": 0}}))
    assert float(result["budget_loss"].sel(budget_part="slopes")) > 0.0
    assert float(result["budget_energy"]) > 1.01 * float(moved["field_receiver_energy"])


def test_losses_of_draws_have_statistics_and_indices(small):
    """The loss to dirt depends on the rate of soiling alone, except for rounding; the energy on both."""
    optics = {key: value for key, value in OPTICS.items() if key != "rays"}
    optics |= {"precision": 1e-2, "slope_error": {"normal": [2, 0.2]}}
    optics["soiling"] = {"rate": {"uniform": [0.002, 0.006]}, "washing_interval": 14}
    causes = {name: BUDGET[name] for name in ("slopes", "dirt")}
    result = computed(small(**{**YEAR, "optics": optics}, budget=causes, sample={"size": 16, "sensitivity": "sobol"}))
    loss = result["budget_loss"]
    np.testing.assert_allclose(
        loss.sum("budget_part"), result["budget_energy"] - result["field_receiver_energy"], rtol=1e-12
    )
    assert float(result["budget_loss_sample_mean"].sel(budget_part="dirt")) > 0
    total = result["budget_loss_total_index"].sel(budget_part="dirt")
    assert float(total.sel(parameter="optics.slope_error")) == pytest.approx(0.0, abs=1e-12)
    assert float(total.sel(parameter="optics.soiling.rate")) > 0.5
    drawing, note = error_budget(result)
    dirt = drawing.axes[0].texts[2].get_text()
    of_dirt, whole = result.sel(budget_part="dirt"), result["budget_energy_sample_mean"]
    mean, deviation = (
        100 * float(of_dirt[f"budget_loss_sample_{name}"] / whole) for name in ("mean", "standard_deviation")
    )
    assert dirt.startswith(f"{mean:.2f} ± {deviation:.2f} % (gain ")
    assert "standard deviation over the draws" in note
