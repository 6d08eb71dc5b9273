"""Tables of the family `misalignment`: errors found with their standard errors, hits of drawn mounts."""

from __future__ import annotations

import numpy as np
import pytest

from heliosweep.families.misalignment.figures import MOST_ROWS, figures
from heliosweep.families.misalignment.tables import tables
from tests.families.misalignment import report_results as results

PM = "\N{PLUS-MINUS SIGN}"


def measured(**options):
    """Calibration from measured spots of two named heliostats; the second has too few spots."""
    dataset = results.calibration(pivots=results.POSITIONS[:2], parameters=2, **options).drop_vars("true_error")
    spots = {name: array.to_numpy().reshape(2, -1) for name, array in dataset.items() if str(name).startswith("spot_")}
    dataset = dataset.drop_dims(["day", "hour"]).assign({name: (("heliostat", "spot"), y) for name, y in spots.items()})
    dataset["calibration_status"].values[:] = [0, 1]
    return dataset.assign_coords(name=("heliostat", np.array(["A1", "B7"], object)))


def test_errors_found_have_their_standard_errors_and_their_status_in_words():
    dataset = measured()
    dataset["estimated_error"].values[:, :2] = [[1.234, -0.5], [np.nan, np.nan]]
    dataset["standard_error"].values[:, :2] = [[0.012, 0.25], [np.nan, np.nan]]
    found, known = tables(dataset)
    assert found.header == ["heliostat", "azimuth reference (mrad)", "elevation reference (mrad)"]
    assert found.rows[0] == ["A1: (\N{MINUS SIGN}16, 150, 0) m", f"1.234 {PM} 0.012", f"\N{MINUS SIGN}0.50 {PM} 0.25"]
    assert found.rows[1][1:] == ["\N{EN DASH}"] * 2
    assert known.header[-1] == "status"
    assert [row[-1] for row in known.rows] == ["estimated", "fewer spots than the errors need"]
    assert known.words == {0, len(known.header) - 2, len(known.header) - 1}  # the error known least, the status


def test_measured_spots_have_a_caption_of_their_own():
    (caption,) = [named.caption for named in figures(measured()) if named.name == "before_after"]
    assert "leave-one-out" in caption
    assert "corrects" not in caption
    assert "outliers among them" in caption
    synthetic = next(iter(figures(results.calibration()))).caption
    assert "corrects" in synthetic
    assert "leave-one-out" not in synthetic


def test_rows_are_few_and_the_note_says_of_how_many():
    found, _ = tables(results.calibration({"noise": [0.01, 0.05]}, pivots=results.field()))
    assert len(found.rows) == MOST_ROWS
    assert f"Shown are {MOST_ROWS} of 317 rows" in found.notes[0]
    assert "(one of 2)" in found.notes[0]


def test_each_point_of_a_small_sweep_has_its_rows():
    found, _ = tables(results.calibration({"noise": [0.01, 0.05]}, pivots=results.POSITIONS[:3]))
    assert [row[0] for row in found.rows] == ["0.01 m"] * 3 + ["0.05 m"] * 3


def test_hits_of_draws_name_the_worst_heliostat():
    dataset = results.draws({"error_scale": [1.0, 2.0]}, days=(172,))
    dataset["day_hit_fraction"].values[:] = np.linspace(1, 0.5, 6)[:, np.newaxis]
    dataset["day_hit_fraction"].values[1] = 1
    dataset["spot_y_variance"].values[:] = 4.0
    (table,) = tables(dataset)
    assert table.rows[0][:5] == ["1", "172", "75.0", "50.0", "heliostat 5: (200, 500, 0) m"]
    assert table.rows[1][:5] == ["2", "172", "100.0", "100.0", "\N{EN DASH}"]
    assert table.rows[0][5] == "2.00"
    assert table.words == {0, 1, 4}


@pytest.mark.parametrize("dataset", [results.curves(), results.draws(pivots=results.POSITIONS[:1])])
def test_tables_fit_their_headers(dataset):
    for table in tables(dataset):
        assert all(len(row) == len(table.header) for row in table.rows)


def test_nothing_known_is_no_error():
    for dataset in (results.calibration(), results.draws()):
        dataset = dataset * np.nan
        assert all(cell != "nan" for table in tables(dataset) for row in table.rows for cell in row)
