"""Colours of figures and pages that colour-blind readers can distinguish."""

from __future__ import annotations

#: Lines, in the order of use: blue, vermilion, green, pink, sky blue, orange, black of Okabe and Ito (2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
DASHES = ("-", (0, (4, 1.6)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)), (0, (8, 2)), (0, (2, 1.2)), (0, (4, 1, 1, 1, 1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

#: Maps of values, and of differences about zero, by matplotlib's names.
VALUES = "viridis"
DIFFERENCES = "RdBu_r"

#: Colour of missing values.
NO_VALUE = "#c8c8c8"
