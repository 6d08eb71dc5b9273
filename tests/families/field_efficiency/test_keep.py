"""A field that is cut: the best are kept, and computed as the layout that they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from heliosweep import api
from heliosweep.families.family import families
from heliosweep.families.lookup import family_of_result
from heliosweep.share.fields import layout_of, write_layout
from tests.families.field_efficiency.test_energy import BLOCKS
from tests.families.studies import computed

DESIGN = {"day": 80, "solar_hour": 12, "dni": 950}
RINGS = {"radial_stagger": {"clearance": 13, "inner_radius": 50, "rings": 5}}
#: A polar field with all that a year and the way of the light give.
YEAR: dict[str, Any] = {
    **BLOCKS,
    "tracking": "azimuth_elevation",
    "layout": {"radial_stagger": {"clearance": 13, "inner_radius": 25, "heliostats": 20}},
    "design_point": DESIGN,
}
PLACE = {"site": {"latitude": 40}, "tracking": "azimuth_elevation"}


def by_itself(study_of: Any, blocks: dict[str, Any], cut: xr.Dataset, path: Any) -> xr.Dataset:
    """The kept heliostats as a layout of their own."""
    write_layout(layout_of(cut), path)
    mirror = {key: value for key, value in blocks["heliostat"].items() if key not in ("width", "height")}
    return computed(study_of(**{**blocks, "layout": {"file": str(path)}, "heliostat": mirror}))


@pytest.mark.parametrize(
    ("blocks", "keep"),
    [
        (YEAR, {"heliostats": 9, "by": "receiver_energy"}),
        (YEAR | {"aim": {"strategy": "spread", "levels": 3}}, {"field_power": 0.5, "by": "energy_per_mirror_area"}),
    ],
)  # fmt: skip
def test_a_cut_field_is_the_field_of_the_heliostats_that_are_kept(small, tmp_path, blocks, keep):
    output: dict[str, Any] = {"time_series": True, "field_geometry": True, "tracking_angles": True}
    output["flux_map"] = {"columns": 4, "rows": 3}
    cut = computed(small(**blocks, keep=keep, output=output))
    alone = by_itself(small, {**blocks, "output": output}, cut, tmp_path / "kept.csv")
    rows = np.flatnonzero(cut["kept"] == 1)
    assert 1 < rows.size < cut.sizes["heliostat"]
    for name, values in alone.data_vars.items():
        of = cut[name].isel(heliostat=rows) if "heliostat" in values.dims else cut[name]
        np.testing.assert_array_equal(of, values, err_msg=str(name))
    for name in cut.data_vars:
        if "heliostat" in cut[name].dims and name not in ("kept", "selection_rank"):
            assert cut[name].where(cut["kept"] == 0).isnull().all(), name


def test_no_heliostat_is_kept_that_ranks_below_one_left_out(small):
    keep: dict[str, Any] = {"heliostats": [10, 60], "by": ["optical_efficiency", "design_point_optical_efficiency"]}
    cut = computed(small(layout=RINGS, keep=keep, design_point=DESIGN))
    whole = computed(small(layout=RINGS, design_point=DESIGN))
    for number in (10, 60):
        here = cut.sel(kept_heliostats=number)
        assert (here["kept"].sum("heliostat") == number).all()
        assert (here["field_heliostats"] == number).all()
        assert (here["selection_rank"].where(here["kept"] == 1).max("heliostat") == number).all()
    for name in keep["by"]:
        here, value = cut.sel(kept_by=name), whole[name]
        assert (
            value.where(here["kept"] == 1).min("heliostat") >= value.where(here["kept"] == 0).max("heliostat")
        ).all()
        ranked = here["selection_rank"].broadcast_like(here["kept"]).transpose(..., "heliostat").to_numpy() - 1
        values = value.broadcast_like(here["kept"]).transpose(*here["kept"].dims).to_numpy()
        values = np.moveaxis(values, here["kept"].dims.index("heliostat"), -1)
        assert (np.diff(np.take_along_axis(values, np.argsort(ranked, axis=-1), axis=-1)) <= 0).all()
        # Without the others, each has no more shade and no more in its way.
        for effect in ("shading", "blocking"):
            gain = here[f"{effect}_efficiency"] - whole[f"{effect}_efficiency"]
            assert float(gain.min()) >= -1e-12
            assert float(gain.max()) > 0


def test_a_field_for_a_power_is_the_smallest_of_the_best(small):
    study = small(**PLACE, layout=RINGS, design_point=DESIGN, keep={"field_power": 4, "by": "optical_efficiency"})
    cut = computed(study)
    number = int(cut["kept"].sum())
    assert float(cut["design_point_power"]) >= 4
    fewer = small(**PLACE, layout=RINGS, design_point=DESIGN,
                  keep={"heliostats": number - 1, "by": "optical_efficiency"})  # fmt: skip
    assert float(computed(fewer)["design_point_power"]) < 4
    area = 72.0
    power = area * 950e-6 * cut["design_point_optical_efficiency"].sum()
    assert float(cut["design_point_power"]) == pytest.approx(float(power), rel=1e-12)


def test_a_power_that_the_field_has_not_is_told(small, tmp_path, caplog):
    keep = {"field_power": [4, 50], "by": "optical_efficiency"}
    study = small(**PLACE, layout=RINGS, design_point=DESIGN, keep=keep)
    with api.run(study, tmp_path, report=False).open() as result:
        assert result["kept"].isel(kept_power=1).all()
    assert "1 of 2 fields have less than keep.field_power, 8.003 MW although all" in caplog.text


@pytest.mark.parametrize(
    ("keep", "first", "end"),
    [
        ({"field_power": 0.5, "by": "receiver_energy"}, "field_heliostats", "smallest"),
        ({"heliostats": 9, "by": "receiver_energy"}, "field_energy_per_mirror_area", "largest"),
    ],
)
def test_the_headlines_of_a_cut_field_are_what_is_asked_for(small, tmp_path, keep, first, end):
    """The fewest heliostats that have a power, or the most energy per mirror area; with number, area and power."""
    done = api.run(small(**YEAR, keep=keep), tmp_path / "cut", report=False)
    with done.open() as result:
        family = family_of_result(result)
        assert family is not None
        assert family.headlines[0] == first
        assert families()["field_efficiency"].headlines[0] == "levelized_cost_of_heat"  # of other results
        assert result[first].attrs["best_value"] == end
    text = done.summary()
    for words in ("number of heliostats: ", "area of all mirrors: ", "power on the receiver at the design point: "):
        assert words in text
