"""Tables of a finished result: those of a calibration, and of mounts with drawn errors."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.figures import HELIOSTAT, MOST_ROWS, PARAMETER, Spots, rows_of
from heliosweep.report.contents import Table
from heliosweep.report.labels import NOTHING, flag_text, is_flag, number_text
from heliosweep.report.selection import at

_ERRORS, _SPREAD = "estimated_error", "standard_error"

#: Variables beside the errors in a table, what their columns are called, and decimals.
_BESIDE = (
    ("spots_used", "spots", 0),
    ("crossings_used", "crossings", 0),
    ("condition_number", "condition number", 1),
    ("residual_rms", "residual rms (m)", 3),
    ("leave_one_out_rms", "leave-one-out rms (m)", 3),
    ("uncalibrated_beam_residual_rms", "beam residual without calibration (mrad)", 2),
    ("beam_residual_rms", "with it (mrad)", 2),
    ("least_known_direction", "least known", 0),
    ("calibration_status", "status", 0),
)


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Tables of a result; none where its variables have numbers of the whole."""
    shown = Spots(result)
    return chain(_calibration(shown), _mount_errors(shown))


def _calibration(shown: Spots) -> Iterator[Table]:
    """Errors found with their standard errors, a row for each heliostat and point of the sweep; how well known."""
    result = shown.result
    if not {_ERRORS, _SPREAD} <= set(result.data_vars) or not {PARAMETER, HELIOSTAT} <= set(result[_ERRORS].dims):
        return
    dims = [dim for dim in shown.swept(_ERRORS) if dim != "sample"]
    if np.prod([result.sizes[dim] for dim in (*dims, HELIOSTAT)]) > MOST_ROWS:
        dims = []
    stands = {**shown.fixed(_ERRORS, PARAMETER, HELIOSTAT, *dims), **shown.best(_ERRORS, *dims)}
    points, note = rows_of(shown, [*dims, HELIOSTAT])
    known = [i for i in range(result.sizes[PARAMETER]) if at(result[_ERRORS], stands, {PARAMETER: i}).notnull().any()]
    beside = [(result[name], title, decimals) for name, title, decimals in _BESIDE if name in result]
    errors, others = [], []
    for point in points:
        found, error = (at(result[name], stands, point).to_numpy() for name in (_ERRORS, _SPREAD))
        names = [
            shown.heliostat(point) if dim == HELIOSTAT else shown.value(dim, index) for dim, index in point.items()
        ]
        errors.append(names + [_with_error(found[i], error[i]) for i in known])
        values = [float(at(other, stands, point)) for other, *_ in beside]
        cells = [
            flag_text(other, value) if is_flag(other) else number_text(value, decimals)
            for value, (other, _, decimals) in zip(values, beside, strict=True)
        ]
        others.append(names + cells)
    head = [*map(shown.title, dims), "heliostat"]
    first = range(len(head))
    notes = [f"Errors found \N{PLUS-MINUS SIGN} their standard errors.{note}{shown.note(stands)}"]
    if known:
        titles = [f"{shown.parameter(i)} (mrad)" for i in known]
        yield Table("Mount errors found", [*head, *titles], errors, frozenset(first), notes)
    if beside:
        words = {*first, *(len(head) + i for i, (other, *_) in enumerate(beside) if is_flag(other))}
        titles = [title for _, title, _ in beside]
        yield Table("How well they are known", [*head, *titles], others, frozenset(words), [] if known else notes[1:])


def _with_error(value: float, error: float) -> str:
    """A number with its standard error, to two digits of that."""
    if not np.isfinite(value):
        return NOTHING
    known = np.isfinite(error) and error > 0
    decimals = int(np.clip(1 - np.floor(np.log10(error)), 0, 4)) if known else 3
    return f"{number_text(value, decimals)} \N{PLUS-MINUS SIGN} {number_text(error, decimals)}"


def _mount_errors(shown: Spots) -> Iterator[Table]:
    """Hits of drawn mounts over each day, of all heliostats and of the worst; spread of their spots."""
    result, name = shown.result, "day_hit_fraction"
    if not {name, "spot_y_variance", "spot_z_variance"} <= set(result.data_vars):
        return
    hits = result[name]
    if HELIOSTAT not in hits.dims:
        return
    dims = [str(dim) for dim in hits.dims if dim != HELIOSTAT]
    several = result.sizes[HELIOSTAT] > 1
    points, note = rows_of(shown, dims)
    rows = []
    for point in points:
        values = 100 * at(hits, point).to_numpy()
        known = np.isfinite(values)
        row = [shown.value(dim, index) for dim, index in point.items()]
        row.append(number_text(float(values[known].mean()), 1) if known.any() else NOTHING)
        if several:
            worst = int(np.nanargmin(values)) if known.any() else 0
            row.append(number_text(float(values[worst]), 1))
            differ = known.any() and values[worst] < values[known].max()
            row.append(shown.heliostat({**point, HELIOSTAT: worst}) if differ else NOTHING)
        for variance in ("spot_y_variance", "spot_z_variance"):
            spots = at(result[variance], point).to_numpy()
            spots = spots[np.isfinite(spots)]
            row.append(number_text(float(np.sqrt(np.median(spots))), 2) if spots.size else NOTHING)
        rows.append(row)
    head = [*(shown.title(dim) for dim in dims), "spots inside (%)"]
    head += ["of the worst heliostat (%)", "worst heliostat"] if several else []
    head += ["spread to the right (m)", "spread upwards (m)"]
    words = {*range(len(dims)), *([len(dims) + 2] if several else [])}
    among = f", mean of {result.sizes[HELIOSTAT]:,} heliostats" if several else ""
    said = (
        f"Spots inside: part of all draws and hours with sun in which the centre of the beam is inside the "
        f"aperture{among}. Spread: standard deviation over the draws, median over "
        f"{'heliostats and ' if several else ''}hours.{note}"
    )
    yield Table("Hits of mounts with drawn errors", head, rows, frozenset(words), [said])
