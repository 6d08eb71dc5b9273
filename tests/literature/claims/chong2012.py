"""Claims of Chong and Tan (2012): what is compared in the result of a study, and the condition that the paper states."""

from __future__ import annotations

from heliosweep import image_radius
from tests.literature.claims import Claim, between, claims, turn

PAPER = "Chong and Tan (2012)"

# fmt: off
CLAIMS: list[Claim] = [
    *claims(
        "chong2012_maps", "",
        ("Figure 6a: none below 77.5 %", ">= 77.5 %", "78.24", True, lambda r: 100 * r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation").min("heliostat"), lambda v: v >= 77.5),
    ),
    *claims(
        "chong2012_maps", "0.001; rounding",
        ("Figure 6a: north as south (rings 1 to 4)", "0 %", "0.0000", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation").where(between(r.ring, 1, 4)).where(r.y > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation").where(between(r.ring, 1, 4)).where(r.y < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
    ),
    *claims(
        "chong2012_maps", "0.001; the outer rings have a gap in the south",
        ("Figure 6a: north as south (all rings)", "0 %", "-0.0955", False, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation").where(r.y > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation").where(r.y < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
    ),
    *claims(
        "chong2012_maps", "",
        ("Figure 6a: north and south above east and west", "> 0 %", "0.7798", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation").where(between(r.azimuth, 0, 45) | between(r.azimuth, 315, 360) | between(r.azimuth, 135, 225)).mean("heliostat") - r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation").where(between(r.azimuth, 45, 135) | between(r.azimuth, 225, 315)).mean("heliostat")), lambda v: v > 0),
        ("Figure 6b: none below 75.0 %", ">= 75.0 %", "75.66", True, lambda r: 100 * r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation").min("heliostat"), lambda v: v >= 75.0),
    ),
    *claims(
        "chong2012_maps", "0.001; rounding",
        ("Figure 6b: north as south (rings 1 to 4)", "0 %", "0.0000", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation").where(between(r.ring, 1, 4)).where(r.y > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation").where(between(r.ring, 1, 4)).where(r.y < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
    ),
    *claims(
        "chong2012_maps", "0.001; the outer rings have a gap in the south",
        ("Figure 6b: north as south (all rings)", "0 %", "-0.1368", False, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation").where(r.y > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation").where(r.y < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
    ),
    *claims(
        "chong2012_maps", "",
        ("Figure 6b: north and south above east and west", "> 0 %", "1.0399", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation").where(between(r.azimuth, 0, 45) | between(r.azimuth, 315, 360) | between(r.azimuth, 135, 225)).mean("heliostat") - r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation").where(between(r.azimuth, 45, 135) | between(r.azimuth, 225, 315)).mean("heliostat")), lambda v: v > 0),
        ("Figure 6: spinning-elevation better on the whole", "> 0 %", "1.080", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation") - r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation")).mean("heliostat"), lambda v: v > 0),
    ),
    *claims(
        "chong2012_maps", "0.001; rounding",
        ("Figure 6a: east as west", "0 %", "0.0000", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation").where(r.x > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation").where(r.x < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
        ("Figure 6b: east as west", "0 %", "0.0000", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation").where(r.x > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation").where(r.x < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
        ("Figure 7a: east as west", "0 %", "0.0000", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=15, tracking="spinning_elevation").where(r.x > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=15, tracking="spinning_elevation").where(r.x < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
    ),
    *claims(
        "chong2012_maps", "",
        ("Figure 7a: the north is much better", "> 0 %", "4.966", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=15, tracking="spinning_elevation").where(r.y > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=15, tracking="spinning_elevation").where(r.y < -1e-9).mean("heliostat")), lambda v: v > 0),
    ),
    *claims(
        "chong2012_maps", "0.001; rounding",
        ("Figure 7b: east as west", "0 %", "0.0000", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=15, tracking="azimuth_elevation").where(r.x > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=15, tracking="azimuth_elevation").where(r.x < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
    ),
    *claims(
        "chong2012_maps", "",
        ("Figure 7b: the north is much better", "> 0 %", "4.308", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=15, tracking="azimuth_elevation").where(r.y > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=15, tracking="azimuth_elevation").where(r.y < -1e-9).mean("heliostat")), lambda v: v > 0),
    ),
    *claims(
        "chong2012_maps", "0.001; rounding",
        ("Figure 8a: east as west", "0 %", "0.0000", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=30, tracking="spinning_elevation").where(r.x > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=30, tracking="spinning_elevation").where(r.x < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
    ),
    *claims(
        "chong2012_maps", "",
        ("Figure 8a: the north is much better", "> 0 %", "8.503", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=30, tracking="spinning_elevation").where(r.y > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=30, tracking="spinning_elevation").where(r.y < -1e-9).mean("heliostat")), lambda v: v > 0),
    ),
    *claims(
        "chong2012_maps", "0.001; rounding",
        ("Figure 8b: east as west", "0 %", "0.0000", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=30, tracking="azimuth_elevation").where(r.x > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=30, tracking="azimuth_elevation").where(r.x < -1e-9).mean("heliostat")), lambda v: abs(v) <= 0.001),
    ),
    *claims(
        "chong2012_maps", "",
        ("Figure 8b: the north is much better", "> 0 %", "7.669", True, lambda r: 100 * (r.factored_efficiency.sel(latitude=30, tracking="azimuth_elevation").where(r.y > 1e-9).mean("heliostat") - r.factored_efficiency.sel(latitude=30, tracking="azimuth_elevation").where(r.y < -1e-9).mean("heliostat")), lambda v: v > 0),
    ),
    *claims(
        "chong2012_maps", "the paper claims an advantage on the whole and at all latitudes; it does not hold for each heliostat",
        ("Figure 6: heliostats with spinning-elevation not better", "< 1", "40", False, lambda r: ((r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation") - r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation")) < 0).sum("heliostat"), lambda v: v < 1),
        ("Figure 6: least gain of a heliostat by spinning-elevation", ">= 0 %", "-0.8085", False, lambda r: 100 * (r.factored_efficiency.sel(latitude=0, tracking="spinning_elevation") - r.factored_efficiency.sel(latitude=0, tracking="azimuth_elevation")).min("heliostat"), lambda v: v >= 0),
        ("Figure 7: heliostats with spinning-elevation not better", "< 1", "24", False, lambda r: ((r.factored_efficiency.sel(latitude=15, tracking="spinning_elevation") - r.factored_efficiency.sel(latitude=15, tracking="azimuth_elevation")) < 0).sum("heliostat"), lambda v: v < 1),
        ("Figure 7: least gain of a heliostat by spinning-elevation", ">= 0 %", "-1.0824", False, lambda r: 100 * (r.factored_efficiency.sel(latitude=15, tracking="spinning_elevation") - r.factored_efficiency.sel(latitude=15, tracking="azimuth_elevation")).min("heliostat"), lambda v: v >= 0),
        ("Figure 8: heliostats with spinning-elevation not better", "< 1", "47", False, lambda r: ((r.factored_efficiency.sel(latitude=30, tracking="spinning_elevation") - r.factored_efficiency.sel(latitude=30, tracking="azimuth_elevation")) < 0).sum("heliostat"), lambda v: v < 1),
        ("Figure 8: least gain of a heliostat by spinning-elevation", ">= 0 %", "-1.303", False, lambda r: 100 * (r.factored_efficiency.sel(latitude=30, tracking="spinning_elevation") - r.factored_efficiency.sel(latitude=30, tracking="azimuth_elevation")).min("heliostat"), lambda v: v >= 0),
    ),
    *claims(
        "chong2012_south", "1e-9; rounding",
        ("Section 3: a southern field is the northern one turned (spinning-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.cosine_efficiency.sel(tracking="spinning_elevation", latitude=30) - r.cosine_efficiency.sel(tracking="spinning_elevation", latitude=-30)).min("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (spinning-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.cosine_efficiency.sel(tracking="spinning_elevation", latitude=30) - r.cosine_efficiency.sel(tracking="spinning_elevation", latitude=-30)).max("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (spinning-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.shading_efficiency.sel(tracking="spinning_elevation", latitude=30) - r.shading_efficiency.sel(tracking="spinning_elevation", latitude=-30)).min("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (spinning-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.shading_efficiency.sel(tracking="spinning_elevation", latitude=30) - r.shading_efficiency.sel(tracking="spinning_elevation", latitude=-30)).max("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (spinning-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.blocking_efficiency.sel(tracking="spinning_elevation", latitude=30) - r.blocking_efficiency.sel(tracking="spinning_elevation", latitude=-30)).min("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (spinning-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.blocking_efficiency.sel(tracking="spinning_elevation", latitude=30) - r.blocking_efficiency.sel(tracking="spinning_elevation", latitude=-30)).max("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (spinning-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.optical_efficiency.sel(tracking="spinning_elevation", latitude=30) - r.optical_efficiency.sel(tracking="spinning_elevation", latitude=-30)).min("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (spinning-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.optical_efficiency.sel(tracking="spinning_elevation", latitude=30) - r.optical_efficiency.sel(tracking="spinning_elevation", latitude=-30)).max("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (azimuth-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.cosine_efficiency.sel(tracking="azimuth_elevation", latitude=30) - r.cosine_efficiency.sel(tracking="azimuth_elevation", latitude=-30)).min("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (azimuth-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.cosine_efficiency.sel(tracking="azimuth_elevation", latitude=30) - r.cosine_efficiency.sel(tracking="azimuth_elevation", latitude=-30)).max("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (azimuth-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.shading_efficiency.sel(tracking="azimuth_elevation", latitude=30) - r.shading_efficiency.sel(tracking="azimuth_elevation", latitude=-30)).min("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (azimuth-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.shading_efficiency.sel(tracking="azimuth_elevation", latitude=30) - r.shading_efficiency.sel(tracking="azimuth_elevation", latitude=-30)).max("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (azimuth-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.blocking_efficiency.sel(tracking="azimuth_elevation", latitude=30) - r.blocking_efficiency.sel(tracking="azimuth_elevation", latitude=-30)).min("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (azimuth-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.blocking_efficiency.sel(tracking="azimuth_elevation", latitude=30) - r.blocking_efficiency.sel(tracking="azimuth_elevation", latitude=-30)).max("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (azimuth-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.optical_efficiency.sel(tracking="azimuth_elevation", latitude=30) - r.optical_efficiency.sel(tracking="azimuth_elevation", latitude=-30)).min("heliostat"), lambda v: abs(v) <= 1e-09),
        ("Section 3: a southern field is the northern one turned (azimuth-elevation)", "0 %", "0.0000000000", True, lambda r: 100 * (r.optical_efficiency.sel(tracking="azimuth_elevation", latitude=30) - r.optical_efficiency.sel(tracking="azimuth_elevation", latitude=-30)).max("heliostat"), lambda v: abs(v) <= 1e-09),
    ),
    *claims(
        "chong2012_table1", "a pitch of 15 deg is given for rings 1 to 4",
        ("Table 1: heliostats of the rings", "24", "24.0", True, lambda r: (r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([1])) > 0).sum("heliostat"), lambda v: v == 24),
        ("Table 1: heliostats of the rings", "24", "24.0", True, lambda r: (r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([2])) > 0).sum("heliostat"), lambda v: v == 24),
        ("Table 1: heliostats of the rings", "24", "24.0", True, lambda r: (r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([3])) > 0).sum("heliostat"), lambda v: v == 24),
        ("Table 1: heliostats of the rings", "24", "24.0", True, lambda r: (r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([4])) > 0).sum("heliostat"), lambda v: v == 24),
        ("Table 1: heliostats of the rings", "44", "44.0", True, lambda r: (r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([5])) > 0).sum("heliostat"), lambda v: v == 44),
        ("Table 1: heliostats of the rings", "44", "44.0", True, lambda r: (r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([6])) > 0).sum("heliostat"), lambda v: v == 44),
        ("Table 1: heliostats of the rings", "44", "44.0", True, lambda r: (r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([7])) > 0).sum("heliostat"), lambda v: v == 44),
        ("Table 1: heliostats of the rings", "44", "44.0", True, lambda r: (r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([8])) > 0).sum("heliostat"), lambda v: v == 44),
        ("Table 1: heliostats of the rings", "45", "45.0", True, lambda r: (r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([9])) > 0).sum("heliostat"), lambda v: v == 45),
    ),
    *claims(
        "chong2012_table1", "0.05; printed to 0.1 m; the radii of rings 1 and 5 are inputs of the generator",
        ("Table 1: radii of the rings", "61.3 m", "61.264", True, lambda r: r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([1])).mean("heliostat"), lambda v: abs(v - 61.3) <= 0.05),
        ("Table 1: radii of the rings", "74.6 m", "74.590", True, lambda r: r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([2])).mean("heliostat"), lambda v: abs(v - 74.6) <= 0.05),
        ("Table 1: radii of the rings", "86.6 m", "86.639", True, lambda r: r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([3])).mean("heliostat"), lambda v: abs(v - 86.6) <= 0.05),
        ("Table 1: radii of the rings", "97.2 m", "97.206", True, lambda r: r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([4])).mean("heliostat"), lambda v: abs(v - 97.2) <= 0.05),
        ("Table 1: radii of the rings", "114 m", "114.002", True, lambda r: r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([5])).mean("heliostat"), lambda v: abs(v - 114) <= 0.05),
        ("Table 1: radii of the rings", "127.6 m", "127.571", True, lambda r: r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([6])).mean("heliostat"), lambda v: abs(v - 127.6) <= 0.05),
        ("Table 1: radii of the rings", "140.5 m", "140.512", True, lambda r: r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([7])).mean("heliostat"), lambda v: abs(v - 140.5) <= 0.05),
        ("Table 1: radii of the rings", "152.8 m", "152.760", True, lambda r: r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([8])).mean("heliostat"), lambda v: abs(v - 152.8) <= 0.05),
        ("Table 1: radii of the rings", "164.3 m", "164.257", True, lambda r: r.tower_distance.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([9])).mean("heliostat"), lambda v: abs(v - 164.3) <= 0.05),
    ),
    *claims(
        "chong2012_table1", "0.005; printed to 0.01 deg",
        ("Table 1: target angles of the rings", "55.16 deg", "55.1551", True, lambda r: r.target_elevation.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([1])).mean("heliostat"), lambda v: abs(v - 55.16) <= 0.005),
        ("Table 1: target angles of the rings", "49.72 deg", "49.7151", True, lambda r: r.target_elevation.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([2])).mean("heliostat"), lambda v: abs(v - 49.72) <= 0.005),
        ("Table 1: target angles of the rings", "45.45 deg", "45.4465", True, lambda r: r.target_elevation.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([3])).mean("heliostat"), lambda v: abs(v - 45.45) <= 0.005),
        ("Table 1: target angles of the rings", "42.15 deg", "42.1544", True, lambda r: r.target_elevation.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([4])).mean("heliostat"), lambda v: abs(v - 42.15) <= 0.005),
        ("Table 1: target angles of the rings", "37.67 deg", "37.6651", True, lambda r: r.target_elevation.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([5])).mean("heliostat"), lambda v: abs(v - 37.67) <= 0.005),
        ("Table 1: target angles of the rings", "34.60 deg", "34.5983", True, lambda r: r.target_elevation.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([6])).mean("heliostat"), lambda v: abs(v - 34.60) <= 0.005),
        ("Table 1: target angles of the rings", "32.06 deg", "32.0582", True, lambda r: r.target_elevation.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([7])).mean("heliostat"), lambda v: abs(v - 32.06) <= 0.005),
        ("Table 1: target angles of the rings", "29.94 deg", "29.9448", True, lambda r: r.target_elevation.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([8])).mean("heliostat"), lambda v: abs(v - 29.94) <= 0.005),
        ("Table 1: target angles of the rings", "28.18 deg", "28.1801", True, lambda r: r.target_elevation.sel(tracking="spinning_elevation", sun_elevation=15).where(r.ring.isin([9])).mean("heliostat"), lambda v: abs(v - 28.18) <= 0.005),
    ),
    *claims(
        "chong2012_table1", "a drawing without positions or numbers; the figure mirror_outlines of this study shows the same of real heliostats",
        ("Figure 4: shadow and blocked part of a mirror", "drawing"),
    ),
    *claims(
        "chong2012_table1", "the distance that meets the radii of the table is 15.99 m, 2.8 % more than the diagonal of 15.56 m",
        ("Section 2.4: neighbours are almost a diagonal of a mirror apart", "almost equal"),
    ),
    *claims(
        "chong2012_table2", "0.05; one decimal is printed",
        ("Conclusions: spinning-elevation 0.8 to 1 points better", "0.8 to 1 %", "0.8161", True, lambda r: 100 * (r.field_efficiency_factored.sel(tracking="spinning_elevation") - r.field_efficiency_factored.sel(tracking="azimuth_elevation")).min("latitude"), lambda v: 0.75 <= v <= 1.05),
        ("Conclusions: spinning-elevation 0.8 to 1 points better", "0.8 to 1 %", "0.985", True, lambda r: 100 * (r.field_efficiency_factored.sel(tracking="spinning_elevation") - r.field_efficiency_factored.sel(tracking="azimuth_elevation")).max("latitude"), lambda v: 0.75 <= v <= 1.05),
    ),
    *claims(
        "chong2012_table2", "0.000001; rounding",
        ("Conclusions: the cosine is the same for both", "0 %", "0.0000000", True, lambda r: 100 * (r.field_cosine_efficiency.sel(tracking="spinning_elevation") - r.field_cosine_efficiency.sel(tracking="azimuth_elevation")).max("latitude"), lambda v: abs(v) <= 1e-06),
    ),
    *claims(
        "chong2012_table2", "",
        ("Conclusions: spinning-elevation has less blocking", "> 0 %", "0.7973", True, lambda r: 100 * (r.field_blocking_efficiency.sel(tracking="spinning_elevation") - r.field_blocking_efficiency.sel(tracking="azimuth_elevation")).min("latitude"), lambda v: v > 0),
        ("Conclusions: spinning-elevation has less shadowing", "> 0 %", "0.1513", True, lambda r: 100 * (r.field_shading_efficiency.sel(tracking="spinning_elevation") - r.field_shading_efficiency.sel(tracking="azimuth_elevation")).min("latitude"), lambda v: v > 0),
        ("Section 3: field efficiency highest at the equator (spinning-elevation)", "0 deg", "0.0", True, lambda r: r.field_efficiency_factored.sel(tracking="spinning_elevation").idxmax("latitude"), lambda v: turn(v, 0) <= 0),
        ("Section 3: field efficiency falls with latitude (spinning-elevation)", "< 0 %", "-1.028", True, lambda r: 100 * r.field_efficiency_factored.sel(tracking="spinning_elevation").sortby("latitude").diff("latitude").max("latitude"), lambda v: v < 0),
        ("Section 3: cosine falls with latitude (spinning-elevation)", "< 0 %", "-0.5153", True, lambda r: 100 * r.field_cosine_efficiency.sel(tracking="spinning_elevation").sortby("latitude").diff("latitude").max("latitude"), lambda v: v < 0),
        ("Section 3: shading falls with latitude (spinning-elevation)", "< 0 %", "-0.5662", True, lambda r: 100 * r.field_shading_efficiency.sel(tracking="spinning_elevation").sortby("latitude").diff("latitude").max("latitude"), lambda v: v < 0),
        ("Section 3: field efficiency highest at the equator (azimuth-elevation)", "0 deg", "0.0", True, lambda r: r.field_efficiency_factored.sel(tracking="azimuth_elevation").idxmax("latitude"), lambda v: turn(v, 0) <= 0),
        ("Section 3: field efficiency falls with latitude (azimuth-elevation)", "< 0 %", "-0.9709", True, lambda r: 100 * r.field_efficiency_factored.sel(tracking="azimuth_elevation").sortby("latitude").diff("latitude").max("latitude"), lambda v: v < 0),
        ("Section 3: cosine falls with latitude (azimuth-elevation)", "< 0 %", "-0.5153", True, lambda r: 100 * r.field_cosine_efficiency.sel(tracking="azimuth_elevation").sortby("latitude").diff("latitude").max("latitude"), lambda v: v < 0),
        ("Section 3: shading falls with latitude (azimuth-elevation)", "< 0 %", "-0.5905", True, lambda r: 100 * r.field_shading_efficiency.sel(tracking="azimuth_elevation").sortby("latitude").diff("latitude").max("latitude"), lambda v: v < 0),
        ("Section 3: blocking falls with latitude (spinning-elevation)", "< 0 %", "-0.03266", True, lambda r: 100 * r.field_blocking_efficiency.sel(tracking="spinning_elevation").sortby("latitude").diff("latitude").max("latitude"), lambda v: v < 0),
        ("Section 3: blocking rises with latitude (azimuth-elevation)", "> 0 %", "0.008192", True, lambda r: 100 * r.field_blocking_efficiency.sel(tracking="azimuth_elevation").sortby("latitude").diff("latitude").min("latitude"), lambda v: v > 0),
    ),
    *claims(
        "chong2012_table2", "the paper's own Table 2 shows the opposite",
        ("Conclusions: blocking falls with latitude (azimuth-elevation)", "< 0 %", "0.1159", False, lambda r: 100 * r.field_blocking_efficiency.sel(tracking="azimuth_elevation").sortby("latitude").diff("latitude").max("latitude"), lambda v: v < 0),
    ),
    *claims(
        "chong2012_table2", "drawings without numbers",
        ("Figures 1 to 3", "coordinate systems"),
    ),
    *claims(
        "chong2012_table2", "a drawing without numbers",
        ("Figure 5", "flow chart"),
    ),
    *claims(
        "chong2012_motion", "published in an earlier paper, without its motors; here the total travel of both axes over the year is compared, without the way back overnight",
        ("Introduction: tracking takes less power", "4.8 to 9.3 %", "-7.62", False, lambda r: 100 * (1 - ((r.primary_angle_travel + r.secondary_angle_travel).mean("heliostat").sel(tracking="spinning_elevation") / (r.primary_angle_travel + r.secondary_angle_travel).mean("heliostat").sel(tracking="azimuth_elevation")).min("latitude")), lambda v: 4.8 <= v <= 9.3),
    ),
    *claims(
        "chong2012_motion", "the travel of the secondary axis alone is shorter, by more than is printed",
        ("Introduction: tracking takes less power (secondary axis alone)", "4.8 to 9.3 %", "13.45", False, lambda r: 100 * (1 - (r.secondary_angle_travel.mean("heliostat").sel(tracking="spinning_elevation") / r.secondary_angle_travel.mean("heliostat").sel(tracking="azimuth_elevation")).max("latitude")), lambda v: 4.8 <= v <= 9.3),
    ),
    *claims(
        "chong2012_image", "5; root mean square radius of the light of a year with the sun's disc, mirrors with two focal lengths against spheres",
        ("Introduction: the solar image is smaller", "30 %", "26.35", True, lambda r: 100 * (1 - image_radius(r.energy_flux_map).sel(tracking="spinning_elevation", layout="chong2012_toroid.csv") / image_radius(r.energy_flux_map).sel(tracking="azimuth_elevation", layout="chong2012_sphere.csv")), lambda v: abs(v - 30) <= 5),
    ),
    *claims(
        "chong2012_image", "5; the image of a sphere focused on the target does not depend on the tracking method",
        ("Introduction: the solar image is smaller (spherical mirrors for both)", "30 %", "-0.01", False, lambda r: 100 * (1 - image_radius(r.energy_flux_map).sel(tracking="spinning_elevation", layout="chong2012_sphere.csv") / image_radius(r.energy_flux_map).sel(tracking="azimuth_elevation", layout="chong2012_sphere.csv")), lambda v: abs(v - 30) <= 5),
    ),
]
