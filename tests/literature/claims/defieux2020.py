"""Claims of Defieux et al. (2020): what is compared in the result of a study, and the condition that the paper states."""

from __future__ import annotations

from tests.literature.claims import Claim, claims

PAPER = "Defieux, Caliot and Henault (2020)"

# fmt: off
CLAIMS: list[Claim] = [
    *claims(
        "defieux2020_figures", "nothing to compute",
        ("Figure 1: a heliostat of THEMIS and the principle", "a photograph and a drawing"),
    ),
    *claims(
        "defieux2020_figures", "their scale is not printed; those here are the figure images",
        ("Figure 2: four images of the heliostat", "pictures"),
    ),
    *claims(
        "defieux2020_figures", "nothing to compute",
        ("Figures 3 and 4: frames and method O2", "drawings"),
    ),
    *claims(
        "defieux2020_figures", "the acquisitions are not published; a median image goes in as sun.image",
        ("Figure 5: median of 100 acquisitions of the sun", "a picture and a curve"),
    ),
    *claims(
        "defieux2020_figures", "no contamination along X",
        ("Figure 8: slopes of O2 under a clean profile", "-0.01 to 0.01 mrad", "2.112e-05", True, lambda r: r.canting_x.sel(slope_method="O2", sun_profile="jose", referential="none", module=2), lambda v: -0.01 <= v <= 0.01),
        ("Figure 8: slopes of O2 under a clean profile", "-0.01 to 0.01 mrad", "2.255e-05", True, lambda r: r.canting_x.sel(slope_method="O2", sun_profile="jose", referential="none", module=3), lambda v: -0.01 <= v <= 0.01),
    ),
    *claims(
        "defieux2020_table1", "one noisy profile is one draw",
        ("Table 1: A noisy, within 5 to 95 % of 64 seeds", "<= 14.6 %", "9.172", True, lambda r: r.relative_error_x_low.sel(slope_method="A", sun_profile="noisy", referential="none", module=2), lambda v: v <= 14.6),
        ("Table 1: A noisy, within 5 to 95 % of 64 seeds", ">= 14.6 %", "16.94", True, lambda r: r.relative_error_x_high.sel(slope_method="A", sun_profile="noisy", referential="none", module=2), lambda v: v >= 14.6),
        ("Table 1: A noisy, within 5 to 95 % of 64 seeds", "<= 11.6 %", "1.131", True, lambda r: r.relative_error_y_low.sel(slope_method="A", sun_profile="noisy", referential="none", module=2), lambda v: v <= 11.6),
        ("Table 1: A noisy, within 5 to 95 % of 64 seeds", ">= 11.6 %", "26.74", True, lambda r: r.relative_error_y_high.sel(slope_method="A", sun_profile="noisy", referential="none", module=2), lambda v: v >= 11.6),
        ("Table 1: A noisy, within 5 to 95 % of 64 seeds", "<= 14.2 %", "6.166", True, lambda r: r.relative_error_x_low.sel(slope_method="A", sun_profile="noisy", referential="none", module=3), lambda v: v <= 14.2),
        ("Table 1: A noisy, within 5 to 95 % of 64 seeds", ">= 14.2 %", "18.14", True, lambda r: r.relative_error_x_high.sel(slope_method="A", sun_profile="noisy", referential="none", module=3), lambda v: v >= 14.2),
        ("Table 1: A noisy, within 5 to 95 % of 64 seeds", "<= 13.1 %", "5.027", True, lambda r: r.relative_error_y_low.sel(slope_method="A", sun_profile="noisy", referential="none", module=3), lambda v: v <= 13.1),
        ("Table 1: A noisy, within 5 to 95 % of 64 seeds", ">= 13.1 %", "17.48", True, lambda r: r.relative_error_y_high.sel(slope_method="A", sun_profile="noisy", referential="none", module=3), lambda v: v >= 13.1),
        ("Table 1: O1 noisy, within 5 to 95 % of 64 seeds", "<= 16.3 %", "11.3", True, lambda r: r.relative_error_x_low.sel(slope_method="O1", sun_profile="noisy", referential="none", module=2), lambda v: v <= 16.3),
        ("Table 1: O1 noisy, within 5 to 95 % of 64 seeds", ">= 16.3 %", "18.16", True, lambda r: r.relative_error_x_high.sel(slope_method="O1", sun_profile="noisy", referential="none", module=2), lambda v: v >= 16.3),
        ("Table 1: O1 noisy, within 5 to 95 % of 64 seeds", "<= 10.1 %", "0.4048", True, lambda r: r.relative_error_y_low.sel(slope_method="O1", sun_profile="noisy", referential="none", module=2), lambda v: v <= 10.1),
        ("Table 1: O1 noisy, within 5 to 95 % of 64 seeds", ">= 10.1 %", "9.537", False, lambda r: r.relative_error_y_high.sel(slope_method="O1", sun_profile="noisy", referential="none", module=2), lambda v: v >= 10.1),
        ("Table 1: O1 noisy, within 5 to 95 % of 64 seeds", "<= 17.8 %", "11.88", True, lambda r: r.relative_error_x_low.sel(slope_method="O1", sun_profile="noisy", referential="none", module=3), lambda v: v <= 17.8),
        ("Table 1: O1 noisy, within 5 to 95 % of 64 seeds", ">= 17.8 %", "18.94", True, lambda r: r.relative_error_x_high.sel(slope_method="O1", sun_profile="noisy", referential="none", module=3), lambda v: v >= 17.8),
        ("Table 1: O1 noisy, within 5 to 95 % of 64 seeds", "<= 7.1 %", "0.1281", True, lambda r: r.relative_error_y_low.sel(slope_method="O1", sun_profile="noisy", referential="none", module=3), lambda v: v <= 7.1),
        ("Table 1: O1 noisy, within 5 to 95 % of 64 seeds", ">= 7.1 %", "9.154", True, lambda r: r.relative_error_y_high.sel(slope_method="O1", sun_profile="noisy", referential="none", module=3), lambda v: v >= 7.1),
        ("Table 1: O2 noisy, within 5 to 95 % of 64 seeds", "<= 1.5 %", "0.1657", True, lambda r: r.relative_error_x_low.sel(slope_method="O2", sun_profile="noisy", referential="none", module=2), lambda v: v <= 1.5),
        ("Table 1: O2 noisy, within 5 to 95 % of 64 seeds", ">= 1.5 %", "4.142", True, lambda r: r.relative_error_x_high.sel(slope_method="O2", sun_profile="noisy", referential="none", module=2), lambda v: v >= 1.5),
        ("Table 1: O2 noisy, within 5 to 95 % of 64 seeds", "<= 1.6 %", "0.2992", True, lambda r: r.relative_error_y_low.sel(slope_method="O2", sun_profile="noisy", referential="none", module=2), lambda v: v <= 1.6),
        ("Table 1: O2 noisy, within 5 to 95 % of 64 seeds", ">= 1.6 %", "9.127", True, lambda r: r.relative_error_y_high.sel(slope_method="O2", sun_profile="noisy", referential="none", module=2), lambda v: v >= 1.6),
        ("Table 1: O2 noisy, within 5 to 95 % of 64 seeds", "<= 1.1 %", "0.1171", True, lambda r: r.relative_error_x_low.sel(slope_method="O2", sun_profile="noisy", referential="none", module=3), lambda v: v <= 1.1),
        ("Table 1: O2 noisy, within 5 to 95 % of 64 seeds", ">= 1.1 %", "4.102", True, lambda r: r.relative_error_x_high.sel(slope_method="O2", sun_profile="noisy", referential="none", module=3), lambda v: v >= 1.1),
        ("Table 1: O2 noisy, within 5 to 95 % of 64 seeds", "<= 4.2 %", "0.2739", True, lambda r: r.relative_error_y_low.sel(slope_method="O2", sun_profile="noisy", referential="none", module=3), lambda v: v <= 4.2),
        ("Table 1: O2 noisy, within 5 to 95 % of 64 seeds", ">= 4.2 %", "6.226", True, lambda r: r.relative_error_y_high.sel(slope_method="O2", sun_profile="noisy", referential="none", module=3), lambda v: v >= 4.2),
    ),
    *claims(
        "defieux2020_table1", "1.3; as for Table 1",
        ("Results: A is contaminated along X by about 15 %", "15 %", "14.7", True, lambda r: r.relative_error_x_median.sel(slope_method="A", sun_profile="jose", referential="none").where(r.module.isin([2, 3])).mean("module"), lambda v: abs(v - 15) <= 1.3),
    ),
    *claims(
        "defieux2020_table1", "0.4; half of the number: neither nothing nor twice as much passes",
        ("Results: A is off along Y by about 0.8 %", "0.8 %", "1.94", False, lambda r: r.relative_error_y_median.sel(slope_method="A", sun_profile="jose", referential="none").where(r.module.isin([2, 3])).mean("module"), lambda v: abs(v - 0.8) <= 0.4),
    ),
    *claims(
        "defieux2020_table1", "the published means rise by 11.6 points",
        ("Results: noise makes A worse along Y, not along X", "> 5 %", "9.962", True, lambda r: (r.relative_error_y_median.sel(slope_method="A", referential="none", sun_profile="noisy") - r.relative_error_y_median.sel(slope_method="A", referential="none", sun_profile="jose")).where(r.module.isin([2, 3])).mean("module"), lambda v: v > 5),
    ),
    *claims(
        "defieux2020_table1", "the published means fall by 0.7 points",
        ("Results: noise makes A worse along Y, not along X", "-2 to 2 %", "-1.069", True, lambda r: (r.relative_error_x_median.sel(slope_method="A", referential="none", sun_profile="noisy") - r.relative_error_x_median.sel(slope_method="A", referential="none", sun_profile="jose")).where(r.module.isin([2, 3])).mean("module"), lambda v: -2 <= v <= 2),
    ),
    *claims(
        "defieux2020_table1", "without noise both solve the same equations",
        ("Results: clean, O1 is contaminated less than A", "< 0 %", "0.1892", False, lambda r: (r.relative_error_x_median.sel(sun_profile="jose", referential="none", slope_method="O1") - r.relative_error_x_median.sel(sun_profile="jose", referential="none", slope_method="A")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    ),
    *claims(
        "defieux2020_table1", "means of both modules",
        ("Results: noisy, O1 is better than A along Y", "< 0 %", "-7.966", True, lambda r: (r.relative_error_y_median.sel(sun_profile="noisy", referential="none", slope_method="O1") - r.relative_error_y_median.sel(sun_profile="noisy", referential="none", slope_method="A")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
        ("Results: noisy, O1 is worse than A along X", "> 0 %", "1.265", True, lambda r: (r.relative_error_x_median.sel(sun_profile="noisy", referential="none", slope_method="O1") - r.relative_error_x_median.sel(sun_profile="noisy", referential="none", slope_method="A")).where(r.module.isin([2, 3])).mean("module"), lambda v: v > 0),
        ("Results: O2 is more accurate than O1", "< 0 %", "-14.86", True, lambda r: (r.relative_error_x_median.sel(sun_profile="jose", referential="none", slope_method="O2") - r.relative_error_x_median.sel(sun_profile="jose", referential="none", slope_method="O1")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
        ("Results: O2 is more accurate than O1", "< 0 %", "-1.935", True, lambda r: (r.relative_error_y_median.sel(sun_profile="jose", referential="none", slope_method="O2") - r.relative_error_y_median.sel(sun_profile="jose", referential="none", slope_method="O1")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
        ("Results: O2 is more accurate than O1", "< 0 %", "-13.41", True, lambda r: (r.relative_error_x_median.sel(sun_profile="noisy", referential="none", slope_method="O2") - r.relative_error_x_median.sel(sun_profile="noisy", referential="none", slope_method="O1")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
        ("Results: O2 is more accurate than O1", "< 0 %", "-0.9953", True, lambda r: (r.relative_error_y_median.sel(sun_profile="noisy", referential="none", slope_method="O2") - r.relative_error_y_median.sel(sun_profile="noisy", referential="none", slope_method="O1")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    ),
    *claims(
        "defieux2020_table1", "along X noise does not worsen A in the paper either",
        ("Results: noise costs O2 less than A along Y", "< 0 %", "-7.027", True, lambda r: ((r.relative_error_y_median.sel(referential="none", slope_method="O2") - r.relative_error_y_median.sel(referential="none", slope_method="A")).sel(sun_profile="noisy") - (r.relative_error_y_median.sel(referential="none", slope_method="O2") - r.relative_error_y_median.sel(referential="none", slope_method="A")).sel(sun_profile="jose")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    ),
    *claims(
        "defieux2020_table1", "means of both modules; here noise costs O1 less than the published 6.7 points",
        ("Results: noise costs O2 less than O1 along Y", "< 0 %", "0.9395", False, lambda r: ((r.relative_error_y_median.sel(referential="none", slope_method="O2") - r.relative_error_y_median.sel(referential="none", slope_method="O1")).sel(sun_profile="noisy") - (r.relative_error_y_median.sel(referential="none", slope_method="O2") - r.relative_error_y_median.sel(referential="none", slope_method="O1")).sel(sun_profile="jose")).where(r.module.isin([2, 3])).mean("module"), lambda v: v < 0),
    ),
    *claims(
        "defieux2020_table1", "a bound",
        ("Results: clean, O2 is off by less than 1 %", "< 1 %", "0.00147", True, lambda r: r.relative_error_x_median.sel(slope_method="O2", sun_profile="jose", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 1),
        ("Results: clean, O2 is off by less than 1 %", "< 1 %", "0.002118", True, lambda r: r.relative_error_y_median.sel(slope_method="O2", sun_profile="jose", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 1),
    ),
    *claims(
        "defieux2020_table1", "of 64 seeds all; the larger error of both modules",
        ("Conclusion: noisy, O2 is off by less than 4.5 %", "64", "61.0", False, lambda r: (r.relative_error_x.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module") < 4.5).sum("profile_seed"), lambda v: v == 64),
        ("Conclusion: noisy, O2 is off by less than 4.5 %", "64", "36.0", False, lambda r: (r.relative_error_y.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module") < 4.5).sum("profile_seed"), lambda v: v == 64),
    ),
    *claims(
        "defieux2020_table1", "95th percentile of 64 seeds",
        ("Conclusion: noisy, O2 is better than the aim of 10 %", "< 10 %", "4.142", True, lambda r: r.relative_error_x_high.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 10),
        ("Conclusion: noisy, O2 is better than the aim of 10 %", "< 10 %", "9.127", True, lambda r: r.relative_error_y_high.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 10),
    ),
    *claims(
        "defieux2020_table1", "percent of 1 mrad; 95th percentile of 64 seeds",
        ("Abstract: slopes within 0.05 mrad RMS, mean of a module", "< 5 %", "4.142", True, lambda r: r.relative_error_x_high.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 5),
        ("Abstract: slopes within 0.05 mrad RMS, mean of a module", "< 5 %", "9.127", False, lambda r: r.relative_error_y_high.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 5),
    ),
    *claims(
        "defieux2020_table1", "noisy profile, no camera noise; the worse module, median of 64 seeds",
        ("Abstract: slopes within 0.05 mrad RMS, single pixels", "< 0.05 mrad", "0.1642", False, lambda r: r.slope_rms_x.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module").median("profile_seed"), lambda v: v < 0.05),
        ("Abstract: slopes within 0.05 mrad RMS, single pixels", "< 0.05 mrad", "0.1427", False, lambda r: r.slope_rms_y.sel(slope_method="O2", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module").median("profile_seed"), lambda v: v < 0.05),
    ),
    *claims(
        "defieux2020_table1", "percent of 1 mrad; 95th percentile of 64 seeds",
        ("Abstract: slopes within 0.05 mrad RMS, mean of a module, LM (not of the paper)", "< 5 %", "3.487", True, lambda r: r.relative_error_x_high.sel(slope_method="LM", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 5),
        ("Abstract: slopes within 0.05 mrad RMS, mean of a module, LM (not of the paper)", "< 5 %", "6.035", False, lambda r: r.relative_error_y_high.sel(slope_method="LM", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module"), lambda v: v < 5),
    ),
    *claims(
        "defieux2020_table1", "noisy profile, no camera noise; the worse module, median of 64 seeds",
        ("Abstract: slopes within 0.05 mrad RMS, single pixels, LM (not of the paper)", "< 0.05 mrad", "0.1278", False, lambda r: r.slope_rms_x.sel(slope_method="LM", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module").median("profile_seed"), lambda v: v < 0.05),
        ("Abstract: slopes within 0.05 mrad RMS, single pixels, LM (not of the paper)", "< 0.05 mrad", "0.1128", False, lambda r: r.slope_rms_y.sel(slope_method="LM", sun_profile="noisy", referential="none").where(r.module.isin([2, 3])).max("module").median("profile_seed"), lambda v: v < 0.05),
    ),
    *claims(
        "defieux2020_table1", "evaluations of the merit at a pixel; medians of 64 seeds, of which A needs none",
        ("Results: O1 takes longer than A", "> 0", "82.57", True, lambda r: (r.evaluations.sel(sun_profile="noisy", slope_method="O1") - r.evaluations.sel(sun_profile="noisy", slope_method="A")).median("profile_seed"), lambda v: v > 0),
    ),
    *claims(
        "defieux2020_table1", "evaluations of the merit at a pixel; medians of 64 seeds; here one of O2 takes a tenth longer too",
        ("Results: O2 is faster than O1", "< 0", "4.591", False, lambda r: (r.evaluations.sel(sun_profile="noisy", slope_method="O2") - r.evaluations.sel(sun_profile="noisy", slope_method="O1")).median("profile_seed"), lambda v: v < 0),
    ),
]
