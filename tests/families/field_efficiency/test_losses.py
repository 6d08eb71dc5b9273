"""Shade of the tower and horizon: against exact polygons, rays and pvlib; refused input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pvlib
import pytest

import heliosweep
from heliosweep import api
from heliosweep.errors import StudyError
from tests.families.field_efficiency.test_energy import BLOCKS, PLAIN, TMY3
from tests.families.studies import computed

HORIZON = [[0, 9], [90, 20], [180, 8], [270, 12], [300, 15]]
SHORT = {"clock": "weather", "months": [3, 12]}


@pytest.fixture(scope="session")
def year(small):
    def make(**blocks: Any) -> Any:
        return small(**{**BLOCKS, "tracking": "azimuth_elevation", "time": SHORT, **blocks})

    return make


def of_site(**keys: Any) -> dict[str, Any]:
    return {"site": {"file": str(TMY3), **keys}}


def test_a_tower_shades_the_mirrors_of_a_study(small):
    """As by the function on arrays; by default it ends at the receiver."""
    blocks = {"site": None, "tracking": "azimuth_elevation",
              "time": {"clock": "sun", "azimuth": [100, 180, 260], "elevation": 25}}  # fmt: skip
    found = computed(small(**blocks, tower={"radius": [2.0, 6.0]}))
    places = np.stack([found.x, found.y, found.z + 5.0], axis=1)
    sun = found["sun_azimuth"].to_numpy(), 25.0
    for radius in (2.0, 6.0):
        wanted = heliosweep.field_efficiency(
            places, *np.broadcast_arrays(*sun), width=9.0, height=8.0, aim=60.0, tower=(radius, 60.0)
        )
        values = found.sel(tower_radius=radius)
        for name in ("shading", "optical"):
            np.testing.assert_allclose(
                values[f"{name}_efficiency"].transpose("sun_azimuth", "heliostat"),
                wanted[f"{name}_efficiency"],
                rtol=1e-13,
            )
    assert (found["shading_efficiency"].min(["sun_azimuth", "heliostat"]) < 0.9).all()


def test_the_tower_is_a_stage_of_the_energy(year):
    """Rays and polygons agree, and the stages are the incident less the received energy."""
    tower = {"tower": {"radius": 3, "top": 28}}
    blocks = {**PLAIN, "receiver": {"height": 30}}
    exact, bare = (computed(year(**blocks, **more)) for more in (tower, {}))
    traced = computed(
        year(**tower, receiver={**BLOCKS["receiver"], "radius": 3}, optics={**BLOCKS["optics"], "rays": 512})
    )
    for found in (exact, traced):
        lost = float(found["field_incident_energy"] - found["field_receiver_energy"])
        assert float(found["loss"].sum()) == pytest.approx(lost, rel=1e-12)
        assert (found["loss"] >= -1e-9).all()
    assert exact["stage"].values.tolist()[:4] == ["stow", "cosine", "tower", "shading"]
    assert float(exact["loss"].sel(stage="tower")) > 3.0
    assert float(traced["loss"].sel(stage="tower")) == pytest.approx(float(exact["loss"].sel(stage="tower")), rel=0.05)
    # Aim points on the cylinder turn the mirrors of the traced field a little.
    assert "tower" not in bare["stage"].values
    shade = [
        float(one["loss"].sel(stage=[s for s in ("tower", "shading") if s in one["stage"]]).sum())
        for one in (exact, bare)
    ]
    assert shade[0] > shade[1]


def test_the_sun_below_the_horizon_is_down(year, tmp_path):
    """Against pvlib's position of the sun and its way of interpolating a horizon."""
    file, meta = pvlib.iotools.read_tmy3(TMY3, map_variables=True)
    found = computed(year(**PLAIN, **of_site(horizon={"table": HORIZON}), limits={"dni": 200}))
    middles = file.index - pd.Timedelta("30min")
    some = np.isin(middles.month, (3, 12))
    sun = pvlib.solarposition.get_solarposition(middles, meta["latitude"], meta["longitude"], meta["altitude"])
    azimuth, elevation = zip(*HORIZON, (360, 9), strict=True)
    # In hours of sunrise and sunset the sun of the lit part is below 8 deg, as the sun of the whole hour.
    behind = (sun["elevation"] < np.interp(sun["azimuth"], azimuth, elevation)).to_numpy()
    lost = 1e-6 * 72.0 * 20 * file["dni"].to_numpy()[behind & some].sum()
    assert float(found["loss"].sel(stage="horizon")) == pytest.approx(lost, rel=1e-12)
    assert lost > 1.0
    free = computed(year(**PLAIN, limits={"dni": 200}))
    assert float(found["field_incident_energy"]) == float(free["field_incident_energy"])
    hours = float(found["hours_lost"].sum() + found["hours_used"])
    assert hours == float(free["hours_lost"].sum() + free["hours_used"])
    (tmp_path / "horizon.csv").write_text("azimuth,elevation\n" + "".join(f"{a},{e}\n" for a, e in HORIZON))
    read = computed(year(**PLAIN, **of_site(horizon={"file": str(tmp_path / "horizon.csv")}), limits={"dni": 200}))
    assert (read["loss"] == found["loss"]).all()


def test_a_horizon_counts_without_weather(small):
    """The mean is over the instants with the sun above the horizon alone; below it the series is missing."""
    place = {"latitude": 37, "longitude": -2}
    time = {"clock": "solar", "days": [80], "hours": {"start": 6, "stop": 18, "step": 1}, "sampling": "inclusive"}
    blocks = {"time": time, "tracking": "azimuth_elevation", "output": {"time_series": True}}
    free, walled = (
        computed(small(**blocks, site=place | more))
        for more in ({}, {"horizon": {"table": [[0, 0], [90, 30], [180, 0]]}})
    )
    each = free["instantaneous_cosine_efficiency"]
    sun = heliosweep.sun_position_solar(37.0, np.arange(6.0, 19.0), day=80)
    wall = np.interp(sun.sun_azimuth, [0, 90, 180, 360], [0, 30, 0, 0])
    seen = ((sun.sun_elevation > wall) & (sun.sun_elevation > 0)).to_numpy()
    assert 3 < seen.sum() < each.notnull().any("heliostat").sum()
    np.testing.assert_array_equal(walled["instantaneous_cosine_efficiency"].notnull().all("heliostat"), seen)
    np.testing.assert_allclose(walled["cosine_efficiency"], each[seen].mean("time"), rtol=1e-12)


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ({"tower": {"radius": 0}}, "tower.radius: must be"),
        ({"tower": {"radius": 30}}, "tower.radius: must be less than the distance of the mirrors: .* within the tower"),
        ({"tower": {"radius": 3, "top": 29.5}}, "tower.top: covers the receiver: must be at most 28.5 m"),
        (of_site(horizon={}), "site.horizon: give exactly one of 'table' and 'file'"),
        (of_site(horizon={"table": [[0, 70]]}), r"site.horizon.table\[0\]: must have an elevation between -30 and 60"),
        (of_site(horizon={"table": [[0, 5], [360, 6]]}), r"site.horizon.table\[1\]: gives another elevation"),
        (of_site(horizon={"table": [[0, 5, 1]]}), r"site.horizon.table\[0\]: must"),
        (of_site(horizon={"file": "none.csv"}), "site.horizon.file: no such file"),
    ],
)
def test_wrong_losses_are_refused(year, blocks, message):
    with pytest.raises(StudyError, match=message):
        api.plan(year(**blocks))


def test_wrong_rows_of_a_horizon_are_located(year, tmp_path):
    path = tmp_path / "horizon.csv"
    path.write_text("azimuth,elevation\n0,5\n90,abc\n180,80\n")
    with pytest.raises(StudyError) as error:
        computed(year(**PLAIN, **of_site(horizon={"file": str(path)})))
    assert {(problem.line, problem.column) for problem in error.value.problems} == {(3, 4), (4, 5)}
