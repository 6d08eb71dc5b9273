"""Claims of Defieux et al. (2020): what is compared in the result of a study, and the condition that the paper states."""

from collections.abc import Iterator

import xarray as xr

from tests.literature.claims import Claim

PAPER = "Defieux, Caliot and Henault (2020)"

#: Table 1, noisy: method, module, axis, printed, and 5th and 95th percentile of 64 seeds. [%]
NOISY = [
    ("A", 2, "x", 14.6, "9.172", "16.94"),
    ("A", 2, "y", 11.6, "1.131", "26.74"),
    ("A", 3, "x", 14.2, "6.166", "18.14"),
    ("A", 3, "y", 13.1, "5.027", "17.48"),
    ("O1", 2, "x", 16.3, "11.3", "18.16"),
    ("O1", 2, "y", 10.1, "0.4048", "9.537"),
    ("O1", 3, "x", 17.8, "11.88", "18.94"),
    ("O1", 3, "y", 7.1, "0.1281", "9.154"),
    ("O2", 2, "x", 1.5, "0.1657", "4.142"),
    ("O2", 2, "y", 1.6, "0.2992", "9.127"),
    ("O2", 3, "x", 1.1, "0.1171", "4.102"),
    ("O2", 3, "y", 4.2, "0.2739", "6.226"),
]


# fmt: off
def noisy(method: str, module: int, axis: str, printed: float, low: str, high: str) -> Iterator[Claim]:
    """Yield the claims that a number lies between the percentiles."""
    def of(values: xr.DataArray) -> xr.DataArray:
        return values.sel(slope_method=method, sun_profile="noisy", referential="none", module=module)

    least, most = f"relative_error_{axis}_low", f"relative_error_{axis}_high"
    what = ("defieux2020_table1", f"Table 1: {method} noisy, within 5 to 95 % of 64 seeds", "one noisy profile is one draw")
    yield Claim(*what, f"<= {printed} %", low, True, lambda r: of(r[least]), lambda v: v <= printed, {least})
    yield Claim(*what, f">= {printed} %", high, float(high) >= printed, lambda r: of(r[most]), lambda v: v >= printed, {most})


CLAIMS: list[Claim] = [
    Claim("defieux2020_figures", "Figure 1: a heliostat of THEMIS and the principle", "nothing to compute", "a photograph and a drawing"),
    Claim("defieux2020_figures", "Figure 2: four images of the heliostat", "their scale is not printed; this study shows such images in the figure images", "pictures"),
    Claim("defieux2020_figures", "Figures 3 and 4: frames and method O2", "nothing to compute", "drawings"),
    Claim("defieux2020_figures", "Figure 5: median of 100 acquisitions of the sun", "the acquisitions are not published; a study reads a median image as sun.image", "a picture and a curve"),
    Claim("defieux2020_figures", "Figure 8: slopes of O2 for a clean profile", "no contamination along X", "-0.01 to 0.01 mrad", "2.112e-05", True, lambda r: r.canting_x.sel(slope_method="O2", sun_profile="jose", referential="none", module=2), lambda v: -0.01 <= v <= 0.01),
    Claim("defieux2020_figures", "Figure 8: slopes of O2 for a clean profile", "no contamination along X", "-0.01 to 0.01 mrad", "2.255e-05", True, lambda r: r.canting_x.sel(slope_method="O2", sun_profile="jose", referential="none", module=3), lambda v: -0.01 <= v <= 0.01),
    *(claim for row in NOISY for claim in noisy(*row)),
    Claim("defieux2020_table1", "Results: A is contaminated along X by about 15 %", "1.3; as for Table 1", "15 %", "14.7", True, lambda r: r.relative_error_x_median.sel(slope_method="A", sun_profile="jose", referential="none").where(r.module.isin([2, 3])).mean("module"), lambda v: abs(v - 15) <= 1.3),
    Claim("defieux2020_table1", "Results: the error of A along Y is about 0.8 %", "0.4; half of the printed number; this tolerance rejects both zero and twice the number", "0.8 %", "1.94", False, lambda r: r.relative_error_y_median.sel(slope_method="A", sun_profile="jose", referential="none").where(r.module.isin([2, 3])).mean("module"), lambda v: abs(v - 0.8) <= 0.4),
    Claim("defieux2020_table1", "Results: noise increases the error of A along Y but not along X", "the published means rise by 11.6 points", "> 5 %", "9.962", True, lambda r: (r.relative_error_y_median.sel(slope_method="A", referential="none", sun_profile="noisy") - r.relative_error_y_median.sel(slope_method="A", referential="none", sun_profile="jose")).where(r.module.isin([2, 3])).mean("module"), lambda v: v > 5),
    Claim("defieux2020_table1", "Results: noise increases the error of A along Y but not along X", "the published means fall by 0.7 points", "-2 to 2 %", "-1.069", True, lambda r: (r.relative_error_x_median.sel(slope_method="A", referential="none", sun_profile="noisy") - r.relative_error_x_median.sel(slope_method="A", referential="none", sun_profile="jose")).where(r.module.isin([2, 3])).mean("module"), lambda v: -2 <= v <= 2),
    Claim("defieux2020_table1", "Results: clean, O1 is contaminated less than A", "without noise both methods solve the same equations", "< 0 %", "0.1892", False, lambda r: (r.relative_error_x_median.sel(sun_profile="jose", referential="none", slope_method="O1") - r.relative_error_x_median.sel(sun_profile="jose", referential="none", slope_method="A")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    Claim("defieux2020_table1", "Results: noisy, O1 is better than A along Y", "means of both modules", "< 0 %", "-7.966", True, lambda r: (r.relative_error_y_median.sel(sun_profile="noisy", referential="none", slope_method="O1") - r.relative_error_y_median.sel(sun_profile="noisy", referential="none", slope_method="A")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    Claim("defieux2020_table1", "Results: noisy, O1 is worse than A along X", "means of both modules", "> 0 %", "1.265", True, lambda r: (r.relative_error_x_median.sel(sun_profile="noisy", referential="none", slope_method="O1") - r.relative_error_x_median.sel(sun_profile="noisy", referential="none", slope_method="A")).where(r.module.isin([2, 3])).mean("module"), lambda v: v > 0),
    Claim("defieux2020_table1", "Results: O2 is more accurate than O1", "means of both modules", "< 0 %", "-14.86", True, lambda r: (r.relative_error_x_median.sel(sun_profile="jose", referential="none", slope_method="O2") - r.relative_error_x_median.sel(sun_profile="jose", referential="none", slope_method="O1")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    Claim("defieux2020_table1", "Results: O2 is more accurate than O1", "means of both modules", "< 0 %", "-1.935", True, lambda r: (r.relative_error_y_median.sel(sun_profile="jose", referential="none", slope_method="O2") - r.relative_error_y_median.sel(sun_profile="jose", referential="none", slope_method="O1")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    Claim("defieux2020_table1", "Results: O2 is more accurate than O1", "means of both modules", "< 0 %", "-13.41", True, lambda r: (r.relative_error_x_median.sel(sun_profile="noisy", referential="none", slope_method="O2") - r.relative_error_x_median.sel(sun_profile="noisy", referential="none", slope_method="O1")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    Claim("defieux2020_table1", "Results: O2 is more accurate than O1", "means of both modules", "< 0 %", "-0.9953", True, lambda r: (r.relative_error_y_median.sel(sun_profile="noisy", referential="none", slope_method="O2") - r.relative_error_y_median.sel(sun_profile="noisy", referential="none", slope_method="O1")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    Claim("defieux2020_table1", "Results: noise increases the error of O2 along Y less than that of A", "noise does not increase the error of A along X in the paper either", "< 0 %", "-7.027", True, lambda r: ((r.relative_error_y_median.sel(referential="none", slope_method="O2") - r.relative_error_y_median.sel(referential="none", slope_method="A")).sel(sun_profile="noisy") - (r.relative_error_y_median.sel(referential="none", slope_method="O2") - r.relative_error_y_median.sel(referential="none", slope_method="A")).sel(sun_profile="jose")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    Claim("defieux2020_table1", "Results: noise increases the error of O2 along Y less than that of O1", "means of both modules; noise increases the error of O1 here by less than the published 6.7 points", "< 0 %", "0.9395", False, lambda r: ((r.relative_error_y_median.sel(referential="none", slope_method="O2") - r.relative_error_y_median.sel(referential="none", slope_method="O1")).sel(sun_profile="noisy") - (r.relative_error_y_median.sel(referential="none", slope_method="O2") - r.relative_error_y_median.sel(referential="none", slope_method="O1")).sel(sun_profile="jose")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    Claim("defieux2020_table1", "Results: clean, the error of O2 is below 1 %", "a bound", "< 1 %", "0.00147", True, lambda r: r.relative_error_x_median.sel(slope_method="O2", sun_profile="jose", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 1),
    Claim("defieux2020_table1", "Results: clean, the error of O2 is below 1 %", "a bound", "< 1 %", "0.002118", True, lambda r: r.relative_error_y_median.sel(slope_method="O2", sun_profile="jose", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 1),
    Claim("defieux2020_table1", "Conclusion: noisy, the error of O2 is below 4.5 %", "the claim requires all 64 seeds; the larger of the errors of both modules", "64", "61.0", False, lambda r: (r.relative_error_x.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module") < 4.5).sum("profile_seed"), lambda v: v == 64),
    Claim("defieux2020_table1", "Conclusion: noisy, the error of O2 is below 4.5 %", "the claim requires all 64 seeds; the larger of the errors of both modules", "64", "36.0", False, lambda r: (r.relative_error_y.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module") < 4.5).sum("profile_seed"), lambda v: v == 64),
    Claim("defieux2020_table1", "Conclusion: noisy, the error of O2 is below the target of 10 %", "95th percentile of 64 seeds", "< 10 %", "4.142", True, lambda r: r.relative_error_x_high.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 10),
    Claim("defieux2020_table1", "Conclusion: noisy, the error of O2 is below the target of 10 %", "95th percentile of 64 seeds", "< 10 %", "9.127", True, lambda r: r.relative_error_y_high.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 10),
    Claim("defieux2020_table1", "Abstract: slopes within 0.05 mrad RMS, mean of a module", "percent of 1 mrad; 95th percentile of 64 seeds", "< 5 %", "4.142", True, lambda r: r.relative_error_x_high.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 5),
    Claim("defieux2020_table1", "Abstract: slopes within 0.05 mrad RMS, mean of a module", "percent of 1 mrad; 95th percentile of 64 seeds", "< 5 %", "9.127", False, lambda r: r.relative_error_y_high.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 5),
    Claim("defieux2020_table1", "Abstract: slopes within 0.05 mrad RMS, single pixels", "noisy profile, no camera noise; the worse module, median of 64 seeds", "< 0.05 mrad", "0.1642", False, lambda r: r.slope_rms_x.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module").median("profile_seed"), lambda v: v < 0.05),
    Claim("defieux2020_table1", "Abstract: slopes within 0.05 mrad RMS, single pixels", "noisy profile, no camera noise; the worse module, median of 64 seeds", "< 0.05 mrad", "0.1427", False, lambda r: r.slope_rms_y.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module").median("profile_seed"), lambda v: v < 0.05),
    Claim("defieux2020_table1", "Abstract: slopes within 0.05 mrad RMS, mean of a module, LM (not in the paper)", "percent of 1 mrad; 95th percentile of 64 seeds", "< 5 %", "3.487", True, lambda r: r.relative_error_x_high.sel(slope_method="LM", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 5),
    Claim("defieux2020_table1", "Abstract: slopes within 0.05 mrad RMS, mean of a module, LM (not in the paper)", "percent of 1 mrad; 95th percentile of 64 seeds", "< 5 %", "6.035", False, lambda r: r.relative_error_y_high.sel(slope_method="LM", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 5),
    Claim("defieux2020_table1", "Abstract: slopes within 0.05 mrad RMS, single pixels, LM (not in the paper)", "noisy profile, no camera noise; the worse module, median of 64 seeds", "< 0.05 mrad", "0.1278", False, lambda r: r.slope_rms_x.sel(slope_method="LM", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module").median("profile_seed"), lambda v: v < 0.05),
    Claim("defieux2020_table1", "Abstract: slopes within 0.05 mrad RMS, single pixels, LM (not in the paper)", "noisy profile, no camera noise; the worse module, median of 64 seeds", "< 0.05 mrad", "0.1128", False, lambda r: r.slope_rms_y.sel(slope_method="LM", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module").median("profile_seed"), lambda v: v < 0.05),
    Claim("defieux2020_table1", "Results: O1 takes longer than A", "evaluations of the merit function per pixel, of which A needs none; medians of 64 seeds", "> 0", "82.57", True, lambda r: (r.evaluations.sel(sun_profile="noisy", slope_method="O1") - r.evaluations.sel(sun_profile="noisy", slope_method="A")).median("profile_seed"), lambda v: v > 0),
    Claim("defieux2020_table1", "Results: O2 is faster than O1", "evaluations of the merit function per pixel; medians of 64 seeds; each evaluation of O2 also takes a tenth longer here", "< 0", "4.591", False, lambda r: (r.evaluations.sel(sun_profile="noisy", slope_method="O2") - r.evaluations.sel(sun_profile="noisy", slope_method="O1")).median("profile_seed"), lambda v: v < 0),
]
