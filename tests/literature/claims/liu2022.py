"""Claims of Liu, Peng and Yan (2022): what is compared in the result of a study, and the condition that the paper states."""

from __future__ import annotations

import xarray as xr

from tests.literature.claims import Claim, between, claims, days, turn

PAPER = "Liu, Peng and Yan (2022)"

# fmt: off
CLAIMS: list[Claim] = [
    *claims(
        "liu2022_daylight", "a correlation over six sites that explains half of the variance",
        ("Conclusion 2 by daylight, the paper's mount: the lower the latitude, the better", "< -0.7", "-0.9614", True, lambda r: xr.corr(r.effective_tracking_factor_mean_over_directions.sel(date="2021-06-21", model="untilted_home_axes"), r.latitude, "site"), lambda v: v < -0.7),
        ("Conclusion 2 by daylight, the paper's mount: the lower the longitude, the better", "< -0.7", "-0.3485", False, lambda r: xr.corr(r.effective_tracking_factor_mean_over_directions.sel(date="2021-06-21", model="untilted_home_axes"), r.longitude, "site"), lambda v: v < -0.7),
        ("Conclusion 2 by daylight, the paper's mount: the lower the latitude, the steadier", "> 0.7", "0.7384", True, lambda r: xr.corr(r.effective_tracking_factor_std_over_directions.sel(date="2021-06-21", model="untilted_home_axes"), r.latitude, "site"), lambda v: v > 0.7),
        ("Conclusion 2 by daylight, the paper's mount: the lower the longitude, the steadier", "> 0.7", "0.7122", True, lambda r: xr.corr(r.effective_tracking_factor_std_over_directions.sel(date="2021-06-21", model="untilted_home_axes"), r.longitude, "site"), lambda v: v > 0.7),
        ("Conclusion 2 by daylight over the year, the paper's mount: the lower the latitude, the better", "< -0.7", "0.9031", False, lambda r: xr.corr(r.effective_tracking_factor_mean_over_directions.sel(model="untilted_home_axes").mean("date"), r.latitude, "site"), lambda v: v < -0.7),
        ("Conclusion 2 by daylight, a rigid mount: the lower the latitude, the better", "< -0.7", "0.9726", False, lambda r: xr.corr(r.effective_tracking_factor_mean_over_directions.sel(date="2021-06-21", model="rigid"), r.latitude, "site"), lambda v: v < -0.7),
        ("Conclusion 2 by daylight, a rigid mount: the lower the longitude, the better", "< -0.7", "0.7129", False, lambda r: xr.corr(r.effective_tracking_factor_mean_over_directions.sel(date="2021-06-21", model="rigid"), r.longitude, "site"), lambda v: v < -0.7),
        ("Conclusion 2 by daylight, a rigid mount: the lower the latitude, the steadier", "> 0.7", "0.2284", False, lambda r: xr.corr(r.effective_tracking_factor_std_over_directions.sel(date="2021-06-21", model="rigid"), r.latitude, "site"), lambda v: v > 0.7),
        ("Conclusion 2 by daylight, a rigid mount: the lower the longitude, the steadier", "> 0.7", "-0.5958", False, lambda r: xr.corr(r.effective_tracking_factor_std_over_directions.sel(date="2021-06-21", model="rigid"), r.longitude, "site"), lambda v: v > 0.7),
        ("Conclusion 2 by daylight over the year, a rigid mount: the lower the latitude, the better", "< -0.7", "0.9980", False, lambda r: xr.corr(r.effective_tracking_factor_mean_over_directions.sel(model="rigid").mean("date"), r.latitude, "site"), lambda v: v < -0.7),
    ),
    *claims(
        "liu2022_solstice", "",
        ("Figure 5: falls with the tilt in every direction", "< 0", "-0.1773", True, lambda r: r.effective_tracking_factor.sel(home_azimuth_offset=0, home_elevation_offset=0).sortby("axis_tilt").diff("axis_tilt").max("axis_tilt").max("axis_tilt_direction"), lambda v: v < 0),
    ),
    *claims(
        "liu2022_solstice", "7.5; half a step of the paper's 24 directions",
        ("Figure 5: best directions", "0 or 180 deg", "0", True, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.05, home_azimuth_offset=0, home_elevation_offset=0).idxmax("axis_tilt_direction"), lambda v: turn(v, 0) <= 7.5 or turn(v, 180) <= 7.5),
        ("Figure 5: worst directions", "90 or 270 deg", "90", True, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.05, home_azimuth_offset=0, home_elevation_offset=0).idxmin("axis_tilt_direction"), lambda v: turn(v, 90) <= 7.5 or turn(v, 270) <= 7.5),
        ("Figure 5: best directions", "0 or 180 deg", "0", True, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0).idxmax("axis_tilt_direction"), lambda v: turn(v, 0) <= 7.5 or turn(v, 180) <= 7.5),
        ("Figure 5: worst directions", "90 or 270 deg", "90", True, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0).idxmin("axis_tilt_direction"), lambda v: turn(v, 90) <= 7.5 or turn(v, 270) <= 7.5),
        ("Figure 5: best directions", "0 or 180 deg", "0", True, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.25, home_azimuth_offset=0, home_elevation_offset=0).idxmax("axis_tilt_direction"), lambda v: turn(v, 0) <= 7.5 or turn(v, 180) <= 7.5),
        ("Figure 5: worst directions", "90 or 270 deg", "90", True, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.25, home_azimuth_offset=0, home_elevation_offset=0).idxmin("axis_tilt_direction"), lambda v: turn(v, 90) <= 7.5 or turn(v, 270) <= 7.5),
    ),
    *claims(
        "liu2022_solstice", "rounding of the paper's numbers",
        ("Figure 5: opposite directions are alike", "-0.0005 to 0.0005", "1.99e-05", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0, axis_tilt_direction=0) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0, axis_tilt_direction=180)), lambda v: -0.0005 <= v <= 0.0005),
    ),
    *claims(
        "liu2022_solstice", "7.5; half a step of the paper's 24 directions",
        ("Figure 7a: best directions", "165 or 345 deg", "345", True, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0.2, home_elevation_offset=0).idxmax("axis_tilt_direction"), lambda v: turn(v, 165) <= 7.5 or turn(v, 345) <= 7.5),
    ),
    *claims(
        "liu2022_solstice", "a tenth of the figure's range; the offset adds to the lean in one direction and takes from it in the other",
        ("Figure 7a: the two best directions are alike", "-0.05 to 0.05", "0.5532", False, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0.2, home_elevation_offset=0, axis_tilt_direction=345) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0.2, home_elevation_offset=0, axis_tilt_direction=165)), lambda v: -0.05 <= v <= 0.05),
    ),
    *claims(
        "liu2022_solstice", "7.5; half a step of the paper's 24 directions; of the readings of the model that meet Table 2, none",
        ("Figure 7a: worst directions", "0 or 180 deg", "135", False, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0.2, home_elevation_offset=0).idxmin("axis_tilt_direction"), lambda v: turn(v, 0) <= 7.5 or turn(v, 180) <= 7.5),
    ),
    *claims(
        "liu2022_solstice", "7.5; half a step of the paper's 24 directions; the text has 225 with the words for 255",
        ("Figure 7b: best directions", "75 or 255 deg", "255", True, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.2).idxmax("axis_tilt_direction"), lambda v: turn(v, 75) <= 7.5 or turn(v, 255) <= 7.5),
    ),
    *claims(
        "liu2022_solstice", "7.5; half a step of the paper's 24 directions",
        ("Figure 7b: worst directions", "165 or 345 deg", "90", False, lambda r: r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.2).idxmin("axis_tilt_direction"), lambda v: turn(v, 165) <= 7.5 or turn(v, 345) <= 7.5),
    ),
    *claims(
        "liu2022_solstice", "",
        ("Figure 7a: opposite offsets have opposite trends", "> 0", "0.5534", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, axis_tilt_direction=345, home_azimuth_offset=0.2) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, axis_tilt_direction=345, home_azimuth_offset=-0.2)), lambda v: v > 0),
        ("Figure 7a: opposite offsets have opposite trends", "< 0", "-0.5529", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, axis_tilt_direction=165, home_azimuth_offset=0.2) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, axis_tilt_direction=165, home_azimuth_offset=-0.2)), lambda v: v < 0),
        ("Figure 7b: opposite offsets have opposite trends", "> 0", "0.8469", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, axis_tilt_direction=255, home_elevation_offset=0.2) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, axis_tilt_direction=255, home_elevation_offset=-0.2)), lambda v: v > 0),
        ("Figure 7b: opposite offsets have opposite trends", "< 0", "-0.8472", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, axis_tilt_direction=75, home_elevation_offset=0.2) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, axis_tilt_direction=75, home_elevation_offset=-0.2)), lambda v: v < 0),
        ("Figure 7: a larger offset in azimuth is worse in every direction", "< 0", "-0.2482", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0.2) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0)).max("axis_tilt_direction"), lambda v: v < 0),
        ("Figure 7: a larger offset in azimuth is worse in every direction", "< 0", "-0.2485", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=-0.2) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0)).max("axis_tilt_direction"), lambda v: v < 0),
        ("Figure 7: a larger offset in azimuth is worse in every direction", "< 0", "-0.7842", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0.4) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0.2)).max("axis_tilt_direction"), lambda v: v < 0),
        ("Figure 7: a larger offset in azimuth is worse in every direction", "< 0", "-0.7842", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=-0.4) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=-0.2)).max("axis_tilt_direction"), lambda v: v < 0),
    ),
    *claims(
        "liu2022_solstice", "two of 24 directions gain: there the offset makes up for a part of the tilt",
        ("Figure 7: a larger offset in elevation is worse in every direction", "< 0", "0.003418", False, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.2) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0)).max("axis_tilt_direction"), lambda v: v < 0),
        ("Figure 7: a larger offset in elevation is worse in every direction", "< 0", "0.003576", False, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=-0.2) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0)).max("axis_tilt_direction"), lambda v: v < 0),
    ),
    *claims(
        "liu2022_solstice", "",
        ("Figure 7: a larger offset in elevation is worse in every direction", "< 0", "-0.8037", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.4) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.2)).max("axis_tilt_direction"), lambda v: v < 0),
        ("Figure 7: a larger offset in elevation is worse in every direction", "< 0", "-0.8038", True, lambda r: (r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=-0.4) - r.effective_tracking_factor.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=-0.2)).max("axis_tilt_direction"), lambda v: v < 0),
        ("Figure 8 and conclusion 1: an offset in azimuth lowers the mean", "< 0", "-0.5493", True, lambda r: (r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0.2) - r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0)), lambda v: v < 0),
        ("Figure 8 and conclusion 1: an offset in azimuth lowers the mean", "< 0", "-0.5493", True, lambda r: (r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=-0.2) - r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0)), lambda v: v < 0),
        ("Figure 8 and conclusion 1: an offset in azimuth lowers the mean", "< 0", "-0.8225", True, lambda r: (r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0.4) - r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0.2)), lambda v: v < 0),
        ("Figure 8 and conclusion 1: an offset in azimuth lowers the mean", "< 0", "-0.8225", True, lambda r: (r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=-0.4) - r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=-0.2)), lambda v: v < 0),
        ("Figure 8 and conclusion 1: an offset in azimuth raises the standard deviation", "> 0", "0.1471", True, lambda r: (r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0.2) - r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0)), lambda v: v > 0),
        ("Figure 8 and conclusion 1: an offset in azimuth raises the standard deviation", "> 0", "0.1471", True, lambda r: (r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=-0.2) - r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0)), lambda v: v > 0),
        ("Figure 8 and conclusion 1: an offset in azimuth raises the standard deviation", "> 0", "0.1575", True, lambda r: (r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0.4) - r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0)), lambda v: v > 0),
        ("Figure 8 and conclusion 1: an offset in azimuth raises the standard deviation", "> 0", "0.1575", True, lambda r: (r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=-0.4) - r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_elevation_offset=0, home_azimuth_offset=0)), lambda v: v > 0),
        ("Figure 8 and conclusion 1: an offset in elevation lowers the mean", "< 0", "-0.5054", True, lambda r: (r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.2) - r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0)), lambda v: v < 0),
        ("Figure 8 and conclusion 1: an offset in elevation lowers the mean", "< 0", "-0.5051", True, lambda r: (r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=-0.2) - r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0)), lambda v: v < 0),
        ("Figure 8 and conclusion 1: an offset in elevation lowers the mean", "< 0", "-0.8389", True, lambda r: (r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.4) - r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.2)), lambda v: v < 0),
        ("Figure 8 and conclusion 1: an offset in elevation lowers the mean", "< 0", "-0.839", True, lambda r: (r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=-0.4) - r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=-0.2)), lambda v: v < 0),
        ("Figure 8 and conclusion 1: an offset in elevation raises the standard deviation", "> 0", "0.2505", True, lambda r: (r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.2) - r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0)), lambda v: v > 0),
        ("Figure 8 and conclusion 1: an offset in elevation raises the standard deviation", "> 0", "0.2506", True, lambda r: (r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=-0.2) - r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0)), lambda v: v > 0),
        ("Figure 8 and conclusion 1: an offset in elevation raises the standard deviation", "> 0", "0.2686", True, lambda r: (r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0.4) - r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0)), lambda v: v > 0),
        ("Figure 8 and conclusion 1: an offset in elevation raises the standard deviation", "> 0", "0.2686", True, lambda r: (r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=-0.4) - r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0, home_elevation_offset=0)), lambda v: v > 0),
    ),
    *claims(
        "liu2022_solstice", "-0.7714 is the mean here with the offset in elevation; by Equations 14 and 17 the sign of an offset does not matter",
        ("Figure 8: horizontal better than vertical below 0", "> -0.7714", "-0.7992", False, lambda r: r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=-0.4, home_elevation_offset=0), lambda v: v > -0.7714),
    ),
    *claims(
        "liu2022_solstice", "0.3166 is the deviation here with the offset in elevation",
        ("Figure 8: horizontal is steadier than vertical", "< 0.3166", "0.2054", True, lambda r: r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=-0.4, home_elevation_offset=0), lambda v: v < 0.3166),
    ),
    *claims(
        "liu2022_solstice", "0.0675 is the mean here with the offset in elevation; by Equations 14 and 17 the sign of an offset does not matter",
        ("Figure 8: horizontal better than vertical below 0", "> 0.0675", "0.0233", False, lambda r: r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=-0.2, home_elevation_offset=0), lambda v: v > 0.0675),
    ),
    *claims(
        "liu2022_solstice", "0.2985 is the deviation here with the offset in elevation",
        ("Figure 8: horizontal is steadier than vertical", "< 0.2985", "0.195", True, lambda r: r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=-0.2, home_elevation_offset=0), lambda v: v < 0.2985),
    ),
    *claims(
        "liu2022_solstice", "0.0672 is the mean here with the offset in elevation; by Equations 14 and 17 the sign of an offset does not matter",
        ("Figure 8: vertical better than horizontal above 0", "< 0.0672", "0.0233", True, lambda r: r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0.2, home_elevation_offset=0), lambda v: v < 0.0672),
    ),
    *claims(
        "liu2022_solstice", "0.2985 is the deviation here with the offset in elevation",
        ("Figure 8: horizontal is steadier than vertical", "< 0.2985", "0.1951", True, lambda r: r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0.2, home_elevation_offset=0), lambda v: v < 0.2985),
    ),
    *claims(
        "liu2022_solstice", "-0.7717 is the mean here with the offset in elevation; by Equations 14 and 17 the sign of an offset does not matter",
        ("Figure 8: vertical better than horizontal above 0", "< -0.7717", "-0.7992", True, lambda r: r.effective_tracking_factor_mean_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0.4, home_elevation_offset=0), lambda v: v < -0.7717),
    ),
    *claims(
        "liu2022_solstice", "0.3166 is the deviation here with the offset in elevation",
        ("Figure 8: horizontal is steadier than vertical", "< 0.3166", "0.2054", True, lambda r: r.effective_tracking_factor_std_over_directions.sel(axis_tilt=0.1, home_azimuth_offset=0.4, home_elevation_offset=0), lambda v: v < 0.3166),
    ),
    *claims(
        "liu2022_table2", "the text names no number of them; drawn in path_of_the_sun.png",
        ("Figure 4: paths of the sun on the summer solstice", "curves of azimuth and elevation at six sites"),
    ),
    *claims(
        "liu2022_table2", "drawings of the dish, its axes and the factor, without numbers",
        ("Figures 1 to 3 and 6", "drawings"),
    ),
    *claims(
        "liu2022_table2", "a list of literature",
        ("Table 1", "earlier work"),
    ),
    *claims(
        "liu2022_table2", "no result has it; the third power of the tilt over three is 1.59e-6 deg, the rest is the rounding of an arccos",
        ("Section 2.1: the linear axis is 1.71e-6 deg off at 0.25 deg", "1.71e-6 deg"),
    ),
    *claims(
        "liu2022_table2", "near the best directions Baotou is above Dunhuang",
        ("Figure 9: Baotou and Haerbin are below the other sites in every direction", "> 0", "-0.00755", False, lambda r: (r.effective_tracking_factor.where(r.site.isin(["Dunhuang", "Naqu", "Delingha", "Kunming"])).min("site") - r.effective_tracking_factor.where(r.site.isin(["Baotou", "Haerbin"])).max("site")).min("axis_tilt_direction"), lambda v: v > 0),
    ),
    *claims(
        "liu2022_table2", "7.5; half a step of the paper's 24 directions",
        ("Figure 9: worst directions", "90 or 270 deg", "90", True, lambda r: r.effective_tracking_factor.sel(site="Dunhuang").idxmin("axis_tilt_direction"), lambda v: turn(v, 90) <= 7.5 or turn(v, 270) <= 7.5),
        ("Figure 9: worst directions", "90 or 270 deg", "105", False, lambda r: r.effective_tracking_factor.sel(site="Naqu").idxmin("axis_tilt_direction"), lambda v: turn(v, 90) <= 7.5 or turn(v, 270) <= 7.5),
        ("Figure 9: worst directions", "90 or 270 deg", "105", False, lambda r: r.effective_tracking_factor.sel(site="Delingha").idxmin("axis_tilt_direction"), lambda v: turn(v, 90) <= 7.5 or turn(v, 270) <= 7.5),
        ("Figure 9: worst directions", "90 or 270 deg", "105", False, lambda r: r.effective_tracking_factor.sel(site="Kunming").idxmin("axis_tilt_direction"), lambda v: turn(v, 90) <= 7.5 or turn(v, 270) <= 7.5),
        ("Figure 9: worst directions", "90 or 270 deg", "90", True, lambda r: r.effective_tracking_factor.sel(site="Baotou").idxmin("axis_tilt_direction"), lambda v: turn(v, 90) <= 7.5 or turn(v, 270) <= 7.5),
        ("Figure 9: worst directions", "90 or 270 deg", "90", True, lambda r: r.effective_tracking_factor.sel(site="Haerbin").idxmin("axis_tilt_direction"), lambda v: turn(v, 90) <= 7.5 or turn(v, 270) <= 7.5),
    ),
    *claims(
        "liu2022_table2", "7.5; half a step of the paper's 24 directions; opposite directions are alike",
        ("Figure 9: best direction", "15 or 195 deg", "0", False, lambda r: r.effective_tracking_factor.sel(site="Dunhuang").idxmax("axis_tilt_direction"), lambda v: turn(v, 15) <= 7.5 or turn(v, 195) <= 7.5),
        ("Figure 9: best direction", "15 or 195 deg", "195", True, lambda r: r.effective_tracking_factor.sel(site="Naqu").idxmax("axis_tilt_direction"), lambda v: turn(v, 15) <= 7.5 or turn(v, 195) <= 7.5),
        ("Figure 9: best direction", "15 or 195 deg", "195", True, lambda r: r.effective_tracking_factor.sel(site="Delingha").idxmax("axis_tilt_direction"), lambda v: turn(v, 15) <= 7.5 or turn(v, 195) <= 7.5),
        ("Figure 9: best direction", "15 or 195 deg", "195", True, lambda r: r.effective_tracking_factor.sel(site="Kunming").idxmax("axis_tilt_direction"), lambda v: turn(v, 15) <= 7.5 or turn(v, 195) <= 7.5),
        ("Figure 9: best direction", "15 or 195 deg", "195", True, lambda r: r.effective_tracking_factor.sel(site="Baotou").idxmax("axis_tilt_direction"), lambda v: turn(v, 15) <= 7.5 or turn(v, 195) <= 7.5),
        ("Figure 9: best direction", "15 or 195 deg", "15", True, lambda r: r.effective_tracking_factor.sel(site="Haerbin").idxmax("axis_tilt_direction"), lambda v: turn(v, 15) <= 7.5 or turn(v, 195) <= 7.5),
    ),
    *claims(
        "liu2022_table2", "",
        ("Figure 10: Baotou and Haerbin have the least means", "> 0", "0.02852", True, lambda r: (r.effective_tracking_factor_mean_over_directions.where(r.site.isin(["Dunhuang", "Naqu", "Delingha", "Kunming"])).min("site") - r.effective_tracking_factor_mean_over_directions.where(r.site.isin(["Baotou", "Haerbin"])).max("site")), lambda v: v > 0),
        ("Figure 10: Baotou and Haerbin have the largest standard deviations", "< 0", "-0.005364", True, lambda r: (r.effective_tracking_factor_std_over_directions.where(r.site.isin(["Dunhuang", "Naqu", "Delingha", "Kunming"])).max("site") - r.effective_tracking_factor_std_over_directions.where(r.site.isin(["Baotou", "Haerbin"])).min("site")), lambda v: v < 0),
        ("Section 4.3: Dunhuang is better and steadier than Baotou", "> 0", "0.03006", True, lambda r: (r.effective_tracking_factor_mean_over_directions.sel(site="Dunhuang") - r.effective_tracking_factor_mean_over_directions.sel(site="Baotou")), lambda v: v > 0),
        ("Section 4.3: Dunhuang is better and steadier than Baotou", "< 0", "-0.02001", True, lambda r: (r.effective_tracking_factor_std_over_directions.sel(site="Dunhuang") - r.effective_tracking_factor_std_over_directions.sel(site="Baotou")), lambda v: v < 0),
    ),
    *claims(
        "liu2022_table2", "the paper's own Table 2 has Naqu above Kunming and Dunhuang above Delingha",
        ("Conclusion 2: the lower the latitude, the better", "< 0", "0.003691", False, lambda r: r.effective_tracking_factor_mean_over_directions.sortby("latitude").diff("site").max("site"), lambda v: v < 0),
    ),
    *claims(
        "liu2022_table2", "in the paper's own Table 2 Kunming is the least steady but Baotou and Haerbin",
        ("Conclusion 2: the lower the latitude, the steadier", "> 0", "-0.01612", False, lambda r: r.effective_tracking_factor_std_over_directions.sortby("latitude").diff("site").min("site"), lambda v: v > 0),
    ),
    *claims(
        "liu2022_table3", "8; within 8 days of an extreme the factor changes by 0.0001 to 0.0014, and the table has three decimals",
        ("Table 3: date of the least factor", "2021-06-21", "2021-06-20", True, lambda r: r.date_of_min.sel(axis_tilt_direction=0), lambda v: days(v, "2021-06-21") <= 8),
        ("Table 3: date of the least factor", "2021-12-12", "2021-12-12", True, lambda r: r.date_of_min.sel(axis_tilt_direction=15), lambda v: days(v, "2021-12-12") <= 8),
        ("Table 3: date of the least factor", "2021-12-10", "2021-12-09", True, lambda r: r.date_of_min.sel(axis_tilt_direction=30), lambda v: days(v, "2021-12-10") <= 8),
        ("Table 3: date of the least factor", "2021-12-05", "2021-12-04", True, lambda r: r.date_of_min.sel(axis_tilt_direction=45), lambda v: days(v, "2021-12-05") <= 8),
        ("Table 3: date of the least factor", "2021-11-27", "2021-11-26", True, lambda r: r.date_of_min.sel(axis_tilt_direction=60), lambda v: days(v, "2021-11-27") <= 8),
        ("Table 3: date of the least factor", "2021-11-01", "2021-11-10", False, lambda r: r.date_of_min.sel(axis_tilt_direction=75), lambda v: days(v, "2021-11-01") <= 8),
        ("Table 3: date of the least factor", "2021-05-01", "2021-05-10", False, lambda r: r.date_of_min.sel(axis_tilt_direction=90), lambda v: days(v, "2021-05-01") <= 8),
        ("Table 3: date of the least factor", "2021-06-01", "2021-05-24", True, lambda r: r.date_of_min.sel(axis_tilt_direction=105), lambda v: days(v, "2021-06-01") <= 8),
        ("Table 3: date of the least factor", "2021-06-01", "2021-06-06", True, lambda r: r.date_of_min.sel(axis_tilt_direction=120), lambda v: days(v, "2021-06-01") <= 8),
        ("Table 3: date of the least factor", "2021-06-19", "2021-06-12", True, lambda r: r.date_of_min.sel(axis_tilt_direction=135), lambda v: days(v, "2021-06-19") <= 8),
        ("Table 3: date of the least factor", "2021-06-16", "2021-06-15", True, lambda r: r.date_of_min.sel(axis_tilt_direction=150), lambda v: days(v, "2021-06-16") <= 8),
        ("Table 3: date of the least factor", "2021-06-19", "2021-06-18", True, lambda r: r.date_of_min.sel(axis_tilt_direction=165), lambda v: days(v, "2021-06-19") <= 8),
        ("Table 3: date of the largest factor", "2021-02-05", "2021-03-06", False, lambda r: r.date_of_max.sel(axis_tilt_direction=0), lambda v: days(v, "2021-02-05") <= 8),
        ("Table 3: date of the largest factor", "2021-08-01", "2021-08-27", False, lambda r: r.date_of_max.sel(axis_tilt_direction=15), lambda v: days(v, "2021-08-01") <= 8),
        ("Table 3: date of the largest factor", "2021-07-01", "2021-06-27", True, lambda r: r.date_of_max.sel(axis_tilt_direction=30), lambda v: days(v, "2021-07-01") <= 8),
        ("Table 3: date of the largest factor", "2021-07-01", "2021-06-29", True, lambda r: r.date_of_max.sel(axis_tilt_direction=45), lambda v: days(v, "2021-07-01") <= 8),
        ("Table 3: date of the largest factor", "2021-07-01", "2021-07-02", True, lambda r: r.date_of_max.sel(axis_tilt_direction=60), lambda v: days(v, "2021-07-01") <= 8),
        ("Table 3: date of the largest factor", "2021-07-01", "2021-07-08", True, lambda r: r.date_of_max.sel(axis_tilt_direction=75), lambda v: days(v, "2021-07-01") <= 8),
        ("Table 3: date of the largest factor", "2021-02-01", "2021-01-24", True, lambda r: r.date_of_max.sel(axis_tilt_direction=90), lambda v: days(v, "2021-02-01") <= 8),
        ("Table 3: date of the largest factor", "2021-01-01", "2021-01-09", True, lambda r: r.date_of_max.sel(axis_tilt_direction=105), lambda v: days(v, "2021-01-01") <= 8),
        ("Table 3: date of the largest factor", "2021-01-01", "2021-01-02", True, lambda r: r.date_of_max.sel(axis_tilt_direction=120), lambda v: days(v, "2021-01-01") <= 8),
    ),
    *claims(
        "liu2022_table3", "8; within 8 days of an extreme the factor changes by 0.0001 to 0.0014, and the table has three decimals; the year ends at its start value",
        ("Table 3: date of the largest factor", "2021-01-01 or 2021-12-31", "2021-12-31", True, lambda r: r.date_of_max.sel(axis_tilt_direction=135), lambda v: days(v, "2021-01-01") <= 8 or days(v, "2021-12-31") <= 8),
        ("Table 3: date of the largest factor", "2021-01-01 or 2021-12-31", "2021-12-30", True, lambda r: r.date_of_max.sel(axis_tilt_direction=150), lambda v: days(v, "2021-01-01") <= 8 or days(v, "2021-12-31") <= 8),
    ),
    *claims(
        "liu2022_table3", "8; within 8 days of an extreme the factor changes by 0.0001 to 0.0014, and the table has three decimals",
        ("Table 3: date of the largest factor", "2021-01-01", "2021-01-11", False, lambda r: r.date_of_max.sel(axis_tilt_direction=165), lambda v: days(v, "2021-01-01") <= 8),
    ),
    *claims(
        "liu2022_table3", "0.646 is the least factor at 0 deg",
        ("Section 4.4: the least factor at 0 deg is above the largest at 30 to 105 deg", "< 0.646", "0.6149", True, lambda r: r.effective_tracking_factor_max.where(between(r.axis_tilt_direction, 30, 105)).max("axis_tilt_direction"), lambda v: v < 0.646),
    ),
    *claims(
        "liu2022_year", "7.5; half a step of the paper's 24 directions; Table 3 has 0.646 to 0.705 at 0 deg and 0.621 to 0.757 at 165",
        ("Figure 11a: best directions", "0 or 180 deg", "345", False, lambda r: r.effective_tracking_factor_mean_over_dates.idxmax("axis_tilt_direction"), lambda v: turn(v, 0) <= 7.5 or turn(v, 180) <= 7.5),
    ),
    *claims(
        "liu2022_year", "7.5; half a step of the paper's 24 directions; opposite directions are alike",
        ("Figure 11a: worst direction", "75 or 255 deg", "75", True, lambda r: r.effective_tracking_factor_mean_over_dates.idxmin("axis_tilt_direction"), lambda v: turn(v, 75) <= 7.5 or turn(v, 255) <= 7.5),
    ),
    *claims(
        "liu2022_year", "'relatively small' is read as below the median",
        ("Figure 11b: steadier at 0, 90, 180 and 270 deg", "< 0", "-0.01358", True, lambda r: (r.effective_tracking_factor_std_over_dates.where(r.axis_tilt_direction.isin([0, 90, 180, 270])).max("axis_tilt_direction") - r.effective_tracking_factor_std_over_dates.median("axis_tilt_direction")), lambda v: v < 0),
    ),
    *claims(
        "liu2022_year", "step from month to month; 30 to 60 deg do, 15 and 75 deg have a second crest",
        ("Figure 12: 15 to 75 deg rise to the middle of the year", "> 0", "-0.002573", False, lambda r: r.monthly_effective_tracking_factor_mean.where(between(r.month, "2021-01", "2021-05")).dropna("month", how="all").sortby("month").diff("month").min("month").where(between(r.axis_tilt_direction, 15, 75)).min("axis_tilt_direction"), lambda v: v > 0),
    ),
    *claims(
        "liu2022_year", "step from month to month; 30 and 45 deg do",
        ("Figure 12: 15 to 75 deg fall from the middle of the year", "< 0", "0.008396", False, lambda r: r.monthly_effective_tracking_factor_mean.where(between(r.month, "2021-07", "2021-12")).dropna("month", how="all").sortby("month").diff("month").max("month").where(between(r.axis_tilt_direction, 15, 75)).max("axis_tilt_direction"), lambda v: v < 0),
    ),
    *claims(
        "liu2022_year", "step from month to month; 105 deg turns in May",
        ("Figure 12: 105 to 165 deg fall to the middle of the year", "< 0", "-0.01327", True, lambda r: r.monthly_effective_tracking_factor_mean.where(between(r.month, "2021-01", "2021-05")).dropna("month", how="all").sortby("month").diff("month").max("month").where(between(r.axis_tilt_direction, 105, 165)).max("axis_tilt_direction"), lambda v: v < 0),
    ),
    *claims(
        "liu2022_year", "step from month to month; 120 to 165 deg turn in June",
        ("Figure 12: 105 to 165 deg rise from the middle of the year", "> 0", "0.005283", True, lambda r: r.monthly_effective_tracking_factor_mean.where(between(r.month, "2021-06", "2021-12")).dropna("month", how="all").sortby("month").diff("month").min("month").where(between(r.axis_tilt_direction, 105, 165)).min("axis_tilt_direction"), lambda v: v > 0),
    ),
    *claims(
        "liu2022_year", "two crests, in March and October, above January, June and December",
        ("Figure 12: 0 deg is a wave", "> 0", "0.009037", True, lambda r: (r.monthly_effective_tracking_factor_mean.sel(axis_tilt_direction=0).where(r.month.isin(["2021-03", "2021-10"])).min("month") - r.monthly_effective_tracking_factor_mean.sel(axis_tilt_direction=0).where(r.month.isin(["2021-01", "2021-06", "2021-12"])).max("month")), lambda v: v > 0),
    ),
    *claims(
        "liu2022_year", "step from month to month",
        ("Figure 13: the mean falls from January to June", "< 0", "-0.001102", True, lambda r: r.monthly_effective_tracking_factor_mean_over_directions.where(between(r.month, "2021-01", "2021-06")).dropna("month", how="all").sortby("month").diff("month").max("month"), lambda v: v < 0),
        ("Figure 13: the mean rises from July to December", "> 0", "0.0037", True, lambda r: r.monthly_effective_tracking_factor_mean_over_directions.where(between(r.month, "2021-07", "2021-12")).dropna("month", how="all").sortby("month").diff("month").min("month"), lambda v: v > 0),
        ("Figure 13: the standard deviation falls from January to June", "< 0", "-0.004894", True, lambda r: r.monthly_effective_tracking_factor_std_over_directions.where(between(r.month, "2021-01", "2021-06")).dropna("month", how="all").sortby("month").diff("month").max("month"), lambda v: v < 0),
        ("Figure 13: the standard deviation rises from July to December", "> 0", "0.006098", True, lambda r: r.monthly_effective_tracking_factor_std_over_directions.where(between(r.month, "2021-07", "2021-12")).dropna("month", how="all").sortby("month").diff("month").min("month"), lambda v: v > 0),
    ),
    *claims(
        "liu2022_year", "May is worse than July",
        ("Figure 13: worst in June and July", "< 0", "0.002953", False, lambda r: (r.monthly_effective_tracking_factor_mean_over_directions.where(between(r.month, "2021-06", "2021-07")).max("month") - r.monthly_effective_tracking_factor_mean_over_directions.where(between(r.month, "2021-01", "2021-05") | between(r.month, "2021-08", "2021-12")).min("month")), lambda v: v < 0),
    ),
    *claims(
        "liu2022_year", "",
        ("Figure 13: steadiest in June and July", "< 0", "-0.004894", True, lambda r: (r.monthly_effective_tracking_factor_std_over_directions.where(between(r.month, "2021-06", "2021-07")).max("month") - r.monthly_effective_tracking_factor_std_over_directions.where(between(r.month, "2021-01", "2021-05") | between(r.month, "2021-08", "2021-12")).min("month")), lambda v: v < 0),
        ("Conclusion 3: first and fourth quarter are the best", "> 0", "0.0037", True, lambda r: (r.monthly_effective_tracking_factor_mean_over_directions.where(between(r.month, "2021-01", "2021-03") | between(r.month, "2021-10", "2021-12")).min("month") - r.monthly_effective_tracking_factor_mean_over_directions.where(between(r.month, "2021-04", "2021-09")).max("month")), lambda v: v > 0),
    ),
    *claims(
        "liu2022_year", "rounding of the paper's numbers; its own Table 3 has 0.621 to 0.757 at 165 deg",
        ("Section 4.4: no direction is better than 0 deg", ">= -0.0005", "-0.01216", False, lambda r: (r.effective_tracking_factor_mean_over_dates.sel(axis_tilt_direction=0) - r.effective_tracking_factor_mean_over_dates.max("axis_tilt_direction")), lambda v: v >= -0.0005),
    ),
    *claims(
        "liu2022_year", "rounding of the paper's numbers",
        ("Section 4.4: no direction is steadier than 0 deg", "<= 0.0005", "0.005096", False, lambda r: (r.effective_tracking_factor_std_over_dates.sel(axis_tilt_direction=0) - r.effective_tracking_factor_std_over_dates.min("axis_tilt_direction")), lambda v: v <= 0.0005),
    ),
    *claims(
        "liu2022_year", "above the median",
        ("Conclusion 3: 0 deg has a good factor and is steady", "> 0", "0.09505", True, lambda r: (r.effective_tracking_factor_mean_over_dates.sel(axis_tilt_direction=0) - r.effective_tracking_factor_mean_over_dates.median("axis_tilt_direction")), lambda v: v > 0),
    ),
    *claims(
        "liu2022_year", "below the median",
        ("Conclusion 3: 0 deg has a good factor and is steady", "< 0", "-0.01358", True, lambda r: (r.effective_tracking_factor_std_over_dates.sel(axis_tilt_direction=0) - r.effective_tracking_factor_std_over_dates.median("axis_tilt_direction")), lambda v: v < 0),
    ),
]
